"""A sign that is lost: of a thermometer that logs |T|, or of a gyro in some of the logs; both are
refused before a number is fitted.
"""

import tomllib

import pandas as pd
import pytest

import calibkit
from calibkit.check import thermometers
from calibkit.records.frame import Log
from conftest import ROOT
from written_logs import sample_logs

CASE = "temp_case_degc"


def fit(name, logs):
    """Fit logs by a shipped recipe."""
    recipe = tomllib.loads((ROOT / "recipes" / f"{name}.toml").read_text(encoding="utf-8"))
    return calibkit.fit(recipe, logs=logs, runs=None, date="2026-11-27")


@pytest.mark.parametrize("name", ["fog_thermal", "thermal"])
def test_a_thermometer_without_sign_is_refused(name):
    """Logs that pass 0 °C, their case temperature as |T|."""
    logs = {file: log.assign(**{CASE: log[CASE].abs()}) for file, log in sample_logs(name).items()}
    with pytest.raises(calibkit.CalibkitError, match="without its sign"):
        fit(name, logs)


def lost_sign(time, degc):
    """What is found in a log of these temperatures."""
    frame = pd.DataFrame({"time_s": time, CASE: degc})
    return thermometers.find_lost_sign(Log("a", "a.csv", "a", len(frame), frame), CASE)


@pytest.mark.parametrize("name", ["fog_thermal", "thermal"])
@pytest.mark.parametrize("lowest_degc", [0.0, 0.1, 0.9])
def test_logs_that_come_near_zero_are_not_refused(name, lowest_degc):
    """Sample logs, moved so that the lowest reading is just above 0 °C."""
    for log in sample_logs(name).values():
        degc = log[CASE] - log[CASE].min() + lowest_degc
        assert lost_sign(log["time_s"], degc) == []


def test_a_gyro_whose_sign_was_turned_in_some_logs_is_refused():
    """All cooling logs with the opposite sign: twice the rate at rest lies between the groups."""
    logs = {
        file: log.assign(gyro_dph=-log["gyro_dph"]) if "cooling" in file else log
        for file, log in sample_logs("fog_thermal").items()
    }
    with pytest.raises(calibkit.CalibkitError, match="sign was turned"):
        fit("fog_thermal", logs)
