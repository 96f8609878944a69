"""Runs of a day with date-times and one chamber file for all of them: joined by what the stamps of
both loggers say.
"""

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe
from calibkit.errors import FrameError
from calibkit.instruments.bias import simulate_fog as simulate

DAY = pd.Timestamp("2026-03-05 08:00:00")
BEGINS = {"ramp_heating_05": 0.0, "ramp_cooling_05": 6 * 3600.0}
ISO, GERMAN = "%Y-%m-%d %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S"
RECIPE = """
procedure = "fog_thermal"
[drift]
model = "gradient_rate"
order = 0
[logs]
files = ["ramp*.csv"]
[columns.time_s]
from = "Zeit"
[chamber]
files = ["chamber.csv"]
provides = ["temp_env_degc"]
%s
[chamber.columns]
time_s = { from = "Time" }
temp_env_degc = { from = "PV", unit = "degC" }
"""
SAME = 'clock = "same"'
ESTIMATE = (
    'clock = "estimate"\nshared = "temp_env_degc"\nlog_column = { from = "air probe", unit ='
    ' "degC" }'
)


@pytest.fixture(scope="module")
def ramps():
    """Return the columns of two simulated ramps, one up and one down."""
    logs = simulate.campaign(3).logs
    return {
        log: {name: np.asarray(values, float) for name, values in logs[f"{log}.csv"].items()}
        for log in BEGINS
    }


def write(folder, ramps, *, head=20.0, behind=0.0, day=DAY, own=ISO, chamber=GERMAN):
    """Write both runs and the chamber's file of the day, which begins `head` seconds before the
    first run, on a clock `behind` seconds behind.
    """
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(1)
    times, air = [], []
    for log, begins in BEGINS.items():
        columns, time = ramps[log], ramps[log]["time_s"] + begins
        probe = np.round(columns["temp_env_degc"] + 0.4 + rng.normal(0.0, 0.05, time.size), 2)
        frame = {"Zeit": written(day, time, own), "temp_case_degc": columns["temp_case_degc"]}
        frame |= {"gyro_dph": columns["gyro_dph"], "air probe": probe}
        pd.DataFrame(frame).to_csv(folder / f"{log}.csv", index=False)
        times.append(time)
        air.append(columns["temp_env_degc"])
    grid = np.arange(-head, times[-1][-1] + 300.0, 5.0)
    pv = np.round(np.interp(grid, np.concatenate(times), np.concatenate(air)), 1)
    stamps = written(day, grid - behind, chamber)
    pd.DataFrame({"Time": stamps, "PV": pv}).to_csv(folder / "chamber.csv", index=False)


def written(day, seconds, form):
    """Return seconds as a logger writes them."""
    instants = day + pd.to_timedelta(np.round(seconds, 3), unit="s")
    if form == "excel":
        return (instants - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1)
    return seconds if form == "seconds" else instants.strftime(form)


def joined(folder, log, table=SAME):
    """Return a joined log."""
    spec = instruments.parse_recipe(recipe.Source("r.toml", RECIPE % table))
    return instruments.find(spec.procedure).read(spec, folder, f"{log}.csv")


def off(log, ramps):
    """Return the rms error [°C] of a log's air."""
    columns = ramps[log.name]
    air = np.interp(log.frame["time_s"], columns["time_s"], columns["temp_env_degc"])
    return float(np.sqrt(np.mean((log.frame["temp_env_degc"] - air) ** 2)))


@pytest.mark.parametrize("head", [20.0, 600.0])
def test_a_chamber_file_that_begins_earlier_is_laid_on_the_log_by_its_stamps(head, tmp_path, ramps):
    """A head start of 20 s or of ten minutes, in the morning and in the afternoon: each run gets
    the air of its own hours.
    """
    write(tmp_path, ramps, head=head)
    for name in BEGINS:
        assert off(joined(tmp_path, name), ramps) < 0.12


def test_clocks_that_differ_are_estimated_from_a_file_of_the_whole_day(tmp_path, ramps):
    """37 s behind, ten minutes earlier: found within 3 u from the hours of the run alone."""
    write(tmp_path, ramps, head=600.0, behind=37.0)
    for name in BEGINS:
        log = joined(tmp_path, name, ESTIMATE)
        offset, u = log.clock
        assert abs(offset - 37.0) < 3.0 * u < 2.0
        assert off(log, ramps) < 0.12
        assert " s behind (estimated)" in log.reading[0]
        assert log.reading[0].split("clock of chamber.csv ")[1].startswith(("36.9", "37"))


def test_a_stated_offset_is_added_to_the_stamps_of_the_chamber(tmp_path, ramps):
    """A clock 37 s behind is offset_s = 37, whenever the file begins."""
    write(tmp_path, ramps, head=600.0, behind=37.0)
    table = 'clock = "stated"\noffset_s = 37.0\nstandard_uncertainty_s = 0.5'
    log = joined(tmp_path, "ramp_cooling_05", table)
    assert off(log, ramps) < 0.12
    assert "37 s behind (stated)" in log.reading[0]


@pytest.mark.parametrize(
    ("own", "chamber", "day"),
    [
        (ISO, "excel", DAY),
        ("%H:%M:%S.%f", "%H:%M:%S", DAY),
        ("%H:%M:%S.%f", "%H:%M:%S", DAY + pd.Timedelta(hours=13)),
        ("%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%d %H:%M:%S+0000", DAY),
        ("%m/%d/%Y %H:%M:%S", GERMAN, DAY + pd.Timedelta(days=20)),
    ],
)
def test_stamps_of_one_kind_are_compared_however_they_are_written(
    own, chamber, day, tmp_path, ramps
):
    """Spreadsheet days, times of day (also past midnight), zones, the American order."""
    write(tmp_path, ramps, own=own, chamber=chamber, day=day)
    spec = SAME
    text = RECIPE % spec
    if chamber == "excel":
        text = text.replace('from = "Time"', 'from = "Time", time_format = "excel"')
    made = instruments.parse_recipe(recipe.Source("r.toml", text))
    for name in BEGINS:
        log = instruments.find("fog_thermal").read(made, tmp_path, f"{name}.csv")
        assert off(log, ramps) < 0.12


@pytest.mark.parametrize(
    ("own", "chamber", "words"),
    [
        ("seconds", GERMAN, "the log has numbers and chamber.csv has date-times"),
        (ISO, "%H:%M:%S", "the log has date-times and chamber.csv has times of day"),
        (ISO, "%d/%m/%Y %H:%M:%S", "chamber.csv has stamps without a certain date"),
        (ISO, "%Y-%m-%d %H:%M:%S+0100", "chamber.csv has date-times with a zone"),
    ],
)
def test_stamps_of_two_kinds_are_not_called_one_clock(own, chamber, words, tmp_path, ramps):
    """What relates them is unknown: refused, with what to state."""
    write(tmp_path, ramps, own=own, chamber=chamber)
    with pytest.raises(FrameError, match=words) as refused:
        joined(tmp_path, "ramp_heating_05")
    assert 'clock = "stated", offset_s' in refused.value.hint
