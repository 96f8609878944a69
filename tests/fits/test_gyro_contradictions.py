"""Runs of pairs and triads that contradict the others are named."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit.errors import FitError
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import flags

RATES = np.linspace(-100.0, 100.0, 9)
AXES = np.eye(3) + 1e-3 * np.array([[0.0, 3.0, -2.0], [4.0, 0.0, 2.5], [-3.5, 1.5, 0.0]])
SCALES = np.array([1.00e4, 1.01e4, 0.98e4])


def log(rng, turned, degc, scale=1.0):
    """A run about an axis, of three gyros whose scale factors follow temperature."""
    K = SCALES * (1.0 + 1e-5 * (degc - 25.0)) * scale * (AXES @ turned)
    frame = {"time_s": 40.0 * np.arange(RATES.size), "table_rate_dps": RATES}
    frame["temp_case_degc"] = np.full(RATES.size, degc)
    for gyro, slope in zip("xyz", K, strict=True):
        frame[f"gyro_{gyro}_lsb"] = slope * RATES + 20.0 + 0.5 * rng.standard_normal(RATES.size)
    return pd.DataFrame(frame)


def flags_of_triad(change):
    """Flags of twelve logs, one of which is changed."""
    rng = np.random.default_rng(4)
    logs = {
        f"about_{name}_{k}.csv": log(rng, axis, degc)
        for k, degc in enumerate((-40.0, 0.0, 25.0, 60.0))
        for name, axis in zip("xyz", np.eye(3), strict=True)
    }
    change(logs)
    recipe = {
        "procedure": "gyro_triad",
        "logs": {"files": ["*.csv"]},
        "axes": {name: [f"about_{name}*.csv"] for name in "xyz"},
        "plateaus": {"one_row": True},
        "site": {"latitude_deg": 34.2},
    }
    flags = calibkit.fit(recipe, logs=logs, runs=None, date="2026-11-26").flags
    return [flag for flag in flags if "other logs" in flag]


def turn(logs):
    """Turn the sign of y in a log about x."""
    logs["about_x_3.csv"]["gyro_y_lsb"] *= -1.0


def swap(logs):
    """Swap x and y in a log about z."""
    both = ["gyro_x_lsb", "gyro_y_lsb"]
    logs["about_z_0.csv"][both] = logs["about_z_0.csv"][both[::-1]].to_numpy()


def add(logs):
    """Tilt the base in a log about y."""
    logs["about_y_2.csv"]["gyro_z_lsb"] += 10.0 * RATES


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (turn, ["about_x_3.csv: about x the sign of gyro y is turned"]),
        (swap, ["about_z_0.csv: about z gyros x and y are swapped"]),
        (add, ["about_y_2.csv: about y either gyro z contradicts the other logs"]),
        (lambda logs: None, []),
    ],
    ids=["sign", "swapped", "tilted", "sound"],
)
def test_a_log_whose_cross_axes_contradict_the_others_is_named(change, expected):
    """Twelve logs at four temperatures: the one that was changed, its gyro and the cause; none
    where nothing was.
    """
    flags = flags_of_triad(change)
    assert len(flags) == len(expected)
    for flag, text in zip(flags, expected, strict=True):
        assert flag.startswith(text)


def test_a_run_of_a_pair_with_another_setting_is_named():
    """Three runs about each axis, one with K 2000 ppm off."""
    rng = np.random.default_rng(8)
    logs = {}
    for name, axis in zip("ab", np.eye(3)[:2], strict=True):
        for k in range(3):
            scale = 1.002 if (name, k) == ("b", 1) else 1.0
            columns = {"gyro_x_lsb": "gyro_a_lsb", "gyro_y_lsb": "gyro_b_lsb"}
            frame = log(rng, axis, 25.0, scale).rename(columns=columns)
            logs[f"about_{name}_{k}.csv"] = frame.drop(columns="gyro_z_lsb")
    recipe = {
        "procedure": "gyro_pair",
        "logs": {"files": ["*.csv"]},
        "pair": {"axis_a": "about_a*.csv", "axis_b": "about_b*.csv"},
        "plateaus": {"one_row": True},
    }
    run = calibkit.fit(recipe, logs=logs, runs=None, date="2026-11-26")
    (named,) = [flag for flag in run.flags if "off the other runs" in flag]
    assert named.startswith("b_about_b: K of about_b_1.csv is 1999 ppm off")
    assert run.document["verdict"] == "rejected"


RATE_TABLE = {
    "procedure": "rate_table",
    "logs": {"files": ["*.csv"]},
    "plateaus": {"one_row": True},
    "acceptance": {"max_residual_over_noise": 10.0},
}


@pytest.mark.parametrize(
    ("scale", "verdict"),
    [(1.0, "accepted"), (1.0005, "accepted"), (1.01, "rejected"), (-1.0, "rejected")],
)
def test_a_run_of_another_gyro_or_sign_is_rejected(scale, verdict):
    """One of six runs over temperature with 1 % more counts, or of the other sign: K is that of
    neither; 500 ppm, which may be a bend of K(T), are flagged alone.
    """
    rng = np.random.default_rng(11)
    logs = {
        f"run{k}.csv": log(rng, np.eye(3)[0], degc, scale if k == 4 else 1.0).drop(
            columns=["gyro_y_lsb", "gyro_z_lsb"]
        )
        for k, degc in enumerate((25.0, 25.0, 25.0, -40.0, 0.0, 60.0))
    }
    run = calibkit.fit(RATE_TABLE, logs=logs, runs=None, date="2026-11-26")
    assert run.document["verdict"] == verdict
    assert any("run4.csv" in flag for flag in run.flags) == (scale != 1.0)


def test_a_gyro_that_does_not_follow_the_table_is_refused_by_name():
    """Noise in the column of the gyro, as of a broken cable."""
    rng = np.random.default_rng(12)
    frame = log(rng, np.eye(3)[0], 25.0).drop(columns=["gyro_y_lsb", "gyro_z_lsb"])
    frame["gyro_x_lsb"] = 20.0 * rng.standard_normal(len(frame))
    with pytest.raises(FitError, match=r"cut\.csv: gyro x does not follow the table"):
        calibkit.fit(RATE_TABLE, logs={"cut.csv": frame}, runs=None, date="2026-11-26")


def test_runs_at_two_temperatures_say_that_k_is_their_mean():
    """K over temperature needs a third temperature, and the flag says so."""
    rng = np.random.default_rng(13)
    logs = {
        f"run{k}.csv": log(rng, np.eye(3)[0], degc).drop(columns=["gyro_y_lsb", "gyro_z_lsb"])
        for k, degc in enumerate((-40.0, 60.0))
    }
    flags = calibkit.fit(RATE_TABLE, logs=logs, runs=None, date="2026-11-26").flags
    assert any("runs at two temperatures do not show how K changes" in flag for flag in flags)


@pytest.mark.parametrize("count", [2, 3])
def test_of_two_runs_that_contradict_each_other_neither_is_called_the_wrong_one(count):
    """A third run tells which one it is."""
    K = np.array([100.0, 101.0, 100.0])[:count]
    runs = [
        SimpleNamespace(temp_degc=25.0, log=SimpleNamespace(file=f"{k}.csv")) for k in range(count)
    ]
    value = Value(K, np.full(count, 1e-4), np.full(count, 20.0))
    (flag,) = flags.of_contradicted_runs("gyro x", runs, value)
    assert ("1.csv" in flag, "0.csv" in flag) == (True, count == 2)
