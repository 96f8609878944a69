"""What an export says of the columns that its quantities were made of: sign, scale, unit, and text
that is safe in C.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.firmware import sources
from calibkit.firmware.chain import ChainCorrection
from outputs.firmware_runs import cached


def lines(spec, structure, *corrections):
    """Lines of a chain under a recipe, with what its instrument states."""
    chain = SimpleNamespace(structure=structure, corrections=corrections, derived={})
    conventions = instruments.optional(spec.procedure, "conventions")
    stated = () if conventions is None else conventions(spec)
    return sources.describe_sources(spec, chain, stated)


def drift(overrides):
    """Lines of a drift chain under a recipe with overrides."""
    spec = instruments.parse_recipe(recipe.find("fog_thermal", overrides))
    taken = SimpleNamespace(
        inputs=[SimpleNamespace(name="temp_case_degc", unit="degC")],
        outputs=[SimpleNamespace(name="drift_dph")],
    )
    return lines(spec, taken, ChainCorrection("drift_dph", "gyro_dph"))


def test_a_sign_and_a_unit_of_the_recipe_become_the_factor_of_the_logged_column():
    """With sign = -1 and °/s in the log the indication is -3600 times the column."""
    said = drift(
        (
            'columns.gyro_dph={from="Kreisel [°/s]",sign=-1}',
            'columns.temp_case_degc={from="T",unit="degF"}',
        )
    )
    assert (
        "indication    gyro_dph [deg/h] = -3600 * column 'Kreisel [\\xb0/s]' [deg/s] (recipe: sign"
        " = -1)" in said
    )
    assert said[0].startswith(
        "input         temp_case_degc [degC] = 0.5555555556 * column 'T' [degF] - 17.77777778 "
    )


def test_the_factor_is_what_reading_the_log_gives(tmp_path):
    """Scale, offset, sign and unit together give the numbers that the reader gives."""
    from calibkit.logs import mapping

    spec = instruments.parse_recipe(
        recipe.find(
            "fog_thermal",
            ('columns.gyro_dph={from="G",unit="deg/s",scale=2.5,offset=-0.5,sign=-1}',),
        )
    )
    said = drift(('columns.gyro_dph={from="G",unit="deg/s",scale=2.5,offset=-0.5,sign=-1}',))
    log = tmp_path / "a.csv"
    log.write_text(
        "time_s,temp_case_degc,temp_env_degc,G\n0,20,20,0.1\n1,20,20,0.3\n2,20,20,-0.2\n",
        encoding="utf-8",
    )
    read = mapping.read_file(spec, log, "a.csv", ("gyro_dph",)).frame["gyro_dph"].to_numpy()
    assert (
        "gyro_dph [deg/h] = -9000 * column 'G' [deg/s] + 1800 (recipe: sign = -1, scale = 2.5,"
        " offset = -0.5)" in said[1]
    )
    np.testing.assert_allclose(read, -9000 * np.array([0.1, 0.3, -0.2]) + 1800, rtol=1e-12)


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (
            "lagged",
            (
                "input temp_case_degc [degC] = column 'temp_case_degc'",
                "indication gyro_dph [deg/h] = ",
            ),
        ),
        (
            "k",
            (
                "input accel_x_g [g] = ",
                "convention accelerometers in and out: positive along gravity",
            ),
        ),
        ("rate", ("input gyro_x_lsb [", "sign feed and correct")),
        ("scale", ("indication gyro_x_dph [deg/h] = ", "indication gyro_y_dph [deg/h] = ")),
    ],
)
def test_header_source_blob_and_table_say_it(run, words, tmp_path, tmp_path_factory, calibkit):
    """Every target holds the lines, and verifies."""
    folder = cached(run, tmp_path_factory).run.folder
    for target, names in (("c", ("cal.h", "cal.c")), ("blob", ("cal.bin",)), ("csv", ("cal.csv",))):
        out = tmp_path / target
        assert calibkit("export", folder, "--target", target, "--out", out).code == 0
        for name in names:
            text = " ".join(
                (out / name).read_bytes().decode("ascii", "replace").replace("\n *", " ").split()
            )
            assert all(word in text for word in words), (name, text[:2000])
            assert calibkit("verify", out / name).code == 0
