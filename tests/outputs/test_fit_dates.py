"""A fit that is dated before the revision before it: flagged, and the flag says what selection by
date does.
"""

import json

import numpy as np
import pandas as pd
import pytest

import calibkit as api
from calibkit.history import dates
from calibkit.records import clock, store
from calibkit.records.coefficients import Criterion
from calibkit.report.summary import Summary
from conftest import ROOT
from kept import keep, model


def flags(runs, date, *, accepted=True):
    """Flags of r003 of S-1 with a date."""
    limit = Criterion("K", 1.0, 2.0, "1", accepted)
    return dates.flag_earlier_runs(Summary("", (), (), (limit,)), runs, "S-1", 3, date).flags


@pytest.fixture
def two_years(tmp_path):
    """Return a folder with two runs of S-1, of 2022 and 2023."""
    for year in (2022, 2023):
        keep(tmp_path, model({"K": (10.0, "1/deg", 0.02)}), date=f"{year}-01-01")
    return tmp_path


@pytest.mark.parametrize("date", ["2021-05-01", "2022-05-01"])
def test_the_flag_says_what_selection_by_date_then_does(two_years, date):
    """Between the two dates of the flag, and there alone, the run is found by date; without a date
    it is always found.
    """
    (said,) = flags(two_years, date)
    until, other = {"2021-05-01": ("2022-01-01", "r001"), "2022-05-01": ("2023-01-01", "r002")}[
        date
    ]
    assert (
        said
        == f"effective from {date}, before r002's 2023-01-01: by date r003 is in force from {date}"
        f" until {until}, from then on {other} again; without a date S-1 is r003, the newest"
        " revision"
    )
    keep(two_years, model({"K": (10.0, "1/deg", 0.02)}), date=date)
    assert store.find(f"S-1@{date}", two_years).name == "r003"
    assert store.find(f"S-1@{until}", two_years).name == other
    assert store.find("S-1", two_years).name == "r003"


def test_an_earlier_revision_that_cannot_be_read_is_named(two_years):
    """Its date is not known; the new run is dated by the others."""
    path = two_years / "S-1" / "r001" / "run.json"
    path.write_text(path.read_text(encoding="utf-8").replace("S-1", "S-2"), encoding="utf-8")
    (said,) = flags(two_years, "2024-01-01")
    assert said.startswith("S-1@r001 cannot be read: ")


def test_fit_says_it_and_keeps_it(tmp_path, calibkit):
    """On the first fit nothing, on one that is dated before it a line, which run.json holds too."""
    call = (
        "fit",
        "inclinometer",
        "--data",
        ROOT / "datasets" / "inclinometer",
        "--serial",
        "S",
        "--out",
        tmp_path,
    )
    first, second = (
        calibkit(*call, "--date", day, "--json") for day in ("2026-10-05", "2026-01-01")
    )
    assert not [flag for flag in first.json["flags"] if "effective" in flag]
    (said,) = [flag for flag in second.json["flags"] if "effective" in flag]
    assert said.startswith("effective from 2026-01-01, before r001's 2026-10-05: ")
    assert (
        said
        in json.loads((tmp_path / "S" / "r002" / "run.json").read_text(encoding="utf-8"))["flags"]
    )
    assert calibkit("verify", tmp_path / "S" / "r002").code == 0


DATED = """
procedure = "bias_temperature"
[logs]
files = ["*.csv"]
[polynomials]
abscissa = "temp_case_degc"
bias = [{ indication = "gyro_dph", order = 1 }]
"""


def fit_dated(calibkit, folder, begins, *more):
    """Fit two warm-ups that begin at some times, on the day and on the day after, or whenever."""
    (folder / "logs").mkdir(parents=True)
    rng = np.random.default_rng(1)
    for day in range(2):
        seconds = pd.to_timedelta(10 * np.arange(400), unit="s")
        stamps = (pd.Timestamp(begins) + pd.Timedelta(days=day) + seconds) if begins else None
        table = {"time_s": 10.0 * np.arange(400) if stamps is None else stamps.strftime(ISO)}
        table["temp_case_degc"] = np.round(20.0 + 30.0 * np.arange(400) / 400, 3)
        table["gyro_dph"] = np.round(5.0 + 0.01 * np.arange(400) + rng.normal(0, 0.1, 400), 3)
        pd.DataFrame(table).to_csv(folder / "logs" / f"{day}.csv", index=False)
    (folder / "r.toml").write_text(DATED, encoding="utf-8")
    arguments = ("--data", folder / "logs", "--serial", "S", "--out", folder / "runs")
    outcome = calibkit("fit", folder / "r.toml", *arguments, *more)
    assert outcome.code == 0, outcome.err
    run = store.load(folder / "runs" / "S" / "r001")
    return outcome, run.document["effective_from"]


ISO = "%Y-%m-%d %H:%M:%S"


def test_coefficients_hold_from_the_last_row_of_logs_with_dates(tmp_path, calibkit):
    """The last log ends past midnight; --date states another date; both are said."""
    outcome, date = fit_dated(calibkit, tmp_path / "a", "2025-03-05 23:30:00")
    assert date == "2025-03-07"
    assert "effective from 2025-03-07, the date of the last row of the logs" in outcome.err
    outcome, date = fit_dated(calibkit, tmp_path / "b", "2025-03-05 23:30:00", "--date=2025-04-01")
    assert date == "2025-04-01"
    assert "effective from" not in outcome.err
    run = api.fit(tmp_path / "a" / "r.toml", tmp_path / "a" / "logs", serial="T", runs=tmp_path)
    assert run.document["effective_from"] == "2025-03-07"


@pytest.mark.parametrize("begins", ["", "1970-01-01 00:10:00"])
def test_without_dates_coefficients_hold_from_today(begins, tmp_path, calibkit):
    """Plain seconds, and a clock that was never set."""
    outcome, date = fit_dated(calibkit, tmp_path, begins)
    assert date == clock.date_or_today(None)
    assert "effective from" not in outcome.err
