"""A wrong latitude, an outlier, a log that the correction makes worse: each is named, and does
not pass for noise.
"""

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import instruments, recipe
from calibkit.instruments.inclinometer import stations
from conftest import ROOT

DATA = ROOT / "datasets" / "inclinometer"


def fitted(folder, *overrides):
    """Model of each gyro and the flags of a fit."""
    spec = instruments.parse_recipe(recipe.find("inclinometer", overrides))
    found = instruments.find(spec.procedure).fit(spec, folder, ["stations.csv"], instruments.silent)
    return {model.name: model for model in found.results[0].models}, found.summary.flags


@pytest.fixture(scope="module")
def healthy():
    """The sample stations as they are."""
    return fitted(DATA)


@pytest.mark.parametrize("off", [0.2, -0.2])
def test_a_wrong_latitude_is_flagged_and_the_right_one_named(off, healthy):
    """0.2° off: both gyros scatter by several times what their readings explain, and fit the true
    34.2° to 0.1°.
    """
    assert not any("latitude" in flag for flag in healthy[1])
    _, flags = fitted(DATA, f"site.latitude_deg={34.2 + off}")
    named = [flag for flag in flags if "the stations fit a latitude of" in flag]
    assert len(named) == 2
    for flag in named:
        said = float(flag.partition("a latitude of ")[2].partition("°")[0])
        assert said == pytest.approx(34.2, abs=0.1)
        assert f"site.latitude_deg says {34.2 + off:g}°" in flag


@pytest.mark.parametrize(
    ("column", "add", "said"),
    [
        ("gyro_x_dph", 2.0, "the gyro does not close by 1 deg/h"),
        ("gyro_x_dph", -0.5, "the gyro does not close by 0.25 deg/h"),
        ("accel_x_g", 0.01, "the accel does not close by 0.005 g"),
    ],
)
@pytest.mark.parametrize("method", ["four_differences", "least_squares"])
def test_one_wild_reading_is_refused_and_is_no_noise_of_the_others(
    column, add, said, method, healthy, tmp_path
):
    """s0 stays within a standard uncertainty of the fit without it; the noise was 0.167 °/h for
    0.008 before.
    """
    frame = pd.read_csv(DATA / "stations.csv")
    frame.loc[41, column] += add
    frame.to_csv(tmp_path / "stations.csv", index=False)
    models, flags = fitted(tmp_path, f"stations.method={method}")
    assert [
        flag
        for flag in flags
        if flag.startswith("station 11: x not used: an outlier") and said in flag
    ]
    clean = healthy[0]["x"]
    assert models["x"].value("s0") == pytest.approx(
        clean.value("s0"), abs=clean.coefficients[0].standard_uncertainty
    )
    assert models["x"].value("gyro_noise") == pytest.approx(clean.value("gyro_noise"), rel=0.1)
    assert models["y"].value("s0") == pytest.approx(healthy[0]["y"].value("s0"), rel=1e-9)


def test_a_validation_that_came_out_worse_is_flagged(tmp_path, calibkit):
    """Logs that were corrected before: the azimuths are worse after than before, and the validation
    says by how much.
    """
    runs = tmp_path / "runs"
    calibkit("fit", "inclinometer", "--data", DATA, "--serial", "S", "--out", runs)
    (path,) = (DATA / "withheld").glob("*.csv")
    frame = pd.read_csv(path)
    for axis in "xy":
        frame[f"gyro_{axis}_dph"] *= 1.0085
    (tmp_path / "logs").mkdir()
    frame.to_csv(tmp_path / "logs" / "stations.csv", index=False)
    for data, told in ((tmp_path / "logs", True), (DATA / "withheld", False)):
        out = tmp_path / f"{told}.json"
        outcome = calibkit("validate", "S", "--runs", runs, "--data", data, "--out", out)
        flags = json.loads(out.read_text(encoding="utf-8"))["flags"]
        assert any("s(T) does not hold here" in flag for flag in flags) == told
        assert ("s(T) does not hold here" in " ".join(outcome.out.split())) == told


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32), st.integers(stations.FEWEST_CLOSING, 40), st.sampled_from([1, 2, 5]))
def test_noise_alone_is_seldom_wild_and_a_wild_station_does_not_move_the_usual(seed, count, dof):
    """Of normal noise none is found (one in a thousand campaigns may have one); a hundredfold
    station is, alone.
    """
    rng = np.random.default_rng(seed)
    squares, dofs = rng.chisquare(dof, count), np.full(count, dof)
    clean = stations.find_outliers(squares, dofs, stations.usual_square(squares, dofs))
    assert clean.sum() <= 1
    outliers = squares.copy()
    outliers[0] = dof * 1e4 * stations.usual_square(squares, dofs)
    found = stations.find_outliers(outliers, dofs, stations.usual_square(outliers, dofs))
    assert found[0]
    assert found[1:].sum() <= clean[1:].sum() + 1


def test_few_stations_and_the_last_digit_make_nobody_wild():
    """Seven stations have no majority; closures of a last digit or two are the last digit's."""
    squares = np.array([1.0] * 6 + [1e6])
    assert not stations.find_outliers(squares, np.ones(7, dtype=np.int64), 1.0).any()
    digits = np.array([0.0] * 11 + [1.0])
    assert not stations.find_outliers(digits, np.ones(12, dtype=np.int64), 1.0 / 12.0 * 1.2).any()
    assert np.isnan(stations.usual_square(digits, np.zeros(12, dtype=np.int64)))
