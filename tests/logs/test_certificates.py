"""Reference instruments are corrected by their own certificates at ingestion, and the run says
so.
"""

import json

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.instruments.bias import simulate_fog as simulate

TABLE = """
[[correction]]
column = "temp_case_degc"
certificate = "T-2026-118"
instrument = "Pt100 no. 7"
indication = [%s]
correction = [%s]
"""


def read(folder, points="-60.0, 0.0, 100.0", added="0.3, 0.1, -0.3", extra=""):
    """Return the case temperature of a log, read with and without the correction, and the corrected
    log.
    """
    source = recipe.find("fog_thermal")
    logs = []
    for text in (source.text, source.text + TABLE % (points, added) + extra):
        spec = instruments.parse_recipe(recipe.Source("r.toml", text))
        logs.append(instruments.find(spec.procedure).read(spec, folder, "ramp_heating_05.csv"))
    return *(log.frame["temp_case_degc"].to_numpy() for log in logs), logs[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with one simulated ramp."""
    made = tmp_path_factory.mktemp("logs")
    content = simulate.campaign(3).files()["ramp_heating_05.csv"]
    (made / "ramp_heating_05.csv").write_bytes(content)
    return made


def test_corrections_are_interpolated_and_recorded(folder):
    """Each row is corrected by the straight line between the certificate's points; the reading
    names the certificate.
    """
    plain, corrected, log = read(folder)
    expected = [np.interp(t, [-60.0, 0.0, 100.0], [0.3, 0.1, -0.3]) for t in plain]
    np.testing.assert_allclose(corrected - plain, expected, atol=1e-12)
    assert any("T-2026-118 of Pt100 no. 7" in line for line in log.reading)


def test_the_run_records_the_correction(folder, tmp_path, calibkit):
    """run.json lists certificate and points, and says of each log by how much it was corrected."""
    path = tmp_path / "r.toml"
    path.write_text(
        recipe.find("fog_thermal").text + TABLE % ("-60.0, 100.0", "0.2, 0.2"), encoding="utf-8"
    )
    call = ("fit", path, "--data", folder, "--serial", "S", "--out", tmp_path / "runs")
    pinned = ("--set", "drift.model=gradient_rate", "--set", "drift.order=0")  # of one ramp
    assert calibkit(*call, *pinned).code in (0, 1)
    document = json.loads(
        (tmp_path / "runs" / "S" / "r001" / "run.json").read_text(encoding="utf-8")
    )
    assert document["corrections"][0]["certificate"] == "T-2026-118"
    assert "corrected by +0.2 to +0.2 degC" in json.dumps(document["inputs"])


def test_beyond_the_certificate_is_refused_or_held_aloud(folder, tmp_path, calibkit):
    """Outside the certificate's points a log is refused with its line; held corrections are
    said.
    """
    path = tmp_path / "r.toml"
    path.write_text(
        recipe.find("fog_thermal").text + TABLE % ("0.0, 40.0", "0.1, 0.2"), encoding="utf-8"
    )
    outcome = calibkit("check", path, "--data", folder)
    assert outcome.code == 3
    assert "ramp_heating_05.csv:2: column 'temp_case_degc'" in outcome.out
    assert "the range of certificate T-2026-118" in outcome.out
    *_, log = read(folder, "0.0, 40.0", "0.1, 0.2", 'beyond = "hold"\n')
    assert any("rows beyond it" in line for line in log.reading)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("temp_case_degc", "gyro_dph"), "no reference instrument"),
        (("0.3, 0.1", "0.1"), "3 indications and 2 corrections"),
        (("-60.0, 0.0", "0.0, -60.0"), "must ascend"),
    ],
)
def test_a_correction_that_cannot_be_meant_is_a_recipe_error(
    change, words, folder, tmp_path, calibkit
):
    """What is calibrated is not corrected; points pair up and ascend: exit 2 with the table's
    line.
    """
    path = tmp_path / "r.toml"
    table = (TABLE % ("-60.0, 0.0, 100.0", "0.3, 0.1, -0.3")).replace(*change)
    path.write_text(recipe.find("fog_thermal").text + table, encoding="utf-8")
    outcome = calibkit("check", path, "--data", folder)
    assert outcome.code == 2
    assert words in outcome.err
    assert "r.toml:" in outcome.err
