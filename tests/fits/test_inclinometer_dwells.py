"""Continuous logs of an inclinometer: the tool stands, turns to the next position, stands again."""

import numpy as np
import pandas as pd
import pytest

from calibkit.records import store
from conftest import ROOT

STANDS_S, TURNS_S = 60, 9


def continuous(stations, seed, *, gyro_noise=0.0, moved=False):
    """Return a log at 1 Hz of a row-a-position log; while the tool turns it reads what no attitude
    has.
    """
    rng = np.random.default_rng(seed)
    parts, clock = [], 0.0
    for row in stations.itertuples():
        stand = pd.DataFrame([row._asdict()] * STANDS_S).drop(columns="Index")
        turn = stand.iloc[:TURNS_S].copy()
        turn["position_deg"] = (
            row.position_deg + 90.0 * (np.arange(TURNS_S) + 1.0) / (TURNS_S + 1.0)
        ) % 360.0
        turn[["gyro_x_dph", "gyro_y_dph"]] = 5e2
        part = pd.concat([stand, turn], ignore_index=True)
        part["time_s"] = clock + np.arange(len(part))
        clock += len(part)
        for axis in "xy":
            part[f"gyro_{axis}_dph"] += gyro_noise * rng.standard_normal(len(part))
        parts.append(part)
    log = pd.concat(parts, ignore_index=True)
    # an encoder that stands on 0° reads a little below or above it
    log.loc[::2, "position_deg"] = (log.loc[::2, "position_deg"] - 0.02) % 360.0
    return log.iloc[2 * (STANDS_S + TURNS_S) :] if moved else log


@pytest.fixture(scope="module")
def rows():
    """Return the sample stations, one row per position."""
    return pd.read_csv(ROOT / "datasets" / "inclinometer" / "stations.csv")


def written(folder, frame):
    """Write a log into its folder; returns the folder."""
    folder.mkdir()
    frame.to_csv(folder / "stations.csv", index=False, float_format="%.10g")
    return folder


def scale(calibkit, data, out, *extra):
    """Fit a folder and return the record of s(T)."""
    outcome = calibkit(
        "fit", "inclinometer", *extra, data=data, serial="I", out=out, date="2026-11-21"
    )
    assert outcome.code == 0, outcome.err
    return store.load(out / "I" / "r001").records["inclinometer_scale.json"]


@pytest.mark.parametrize("numbered", [True, False])
def test_a_continuous_log_gives_the_s_of_its_rows(numbered, rows, tmp_path, calibkit):
    """Every position a minute long, without noise, gives s(T) of the log with one row per position
    to 1e-9, named or not.
    """
    log = continuous(rows, 1)
    log = log if numbered else log.drop(columns="station")
    # the clock of the stations is another: their drift in time is not what is compared
    still = ("--set", "history.rate_uncertainty=0", "--set", "history.rate_walk=1e-9")
    dwelt = scale(calibkit, written(tmp_path / "long", log), tmp_path / "a", *still)
    plain = scale(calibkit, written(tmp_path / "rows", rows), tmp_path / "b", *still)
    for one, other in zip(dwelt.models, plain.models, strict=True):
        for a, b in zip(one.coefficients, other.coefficients, strict=True):
            assert a.value == pytest.approx(b.value, rel=1e-9, abs=1e-12), a.name


def test_stations_and_dwells_are_told_by_check(rows, tmp_path, calibkit):
    """`check` names each station and each dwell with its position, rows of settling and of turning
    left out.
    """
    data = written(tmp_path / "d", continuous(rows.iloc[:8], 1).drop(columns="station"))
    held = calibkit("check", "inclinometer", "--data", data, "--json").json["logs"][0]["held"]
    stations = [part for part in held if part["kind"] == "station"]
    dwells = [part for part in held if part["kind"] == "dwell"]
    assert len(stations) == 2
    assert [round(part["level"]) % 360 for part in dwells] == [0, 90, 180, 270] * 2
    assert all(part["rows"] == STANDS_S - 4 for part in dwells)


def test_apply_turns_no_angle_into_a_turning_tool(rows, tmp_path, calibkit):
    """Rates of all rows are corrected; azimuths stand beside the rows of dwells alone, the same
    over a station.
    """
    log = continuous(rows.iloc[:40], 2, gyro_noise=0.02).drop(columns="station")
    data = written(tmp_path / "d", log)
    scale(calibkit, data, tmp_path / "runs")
    out = tmp_path / "out.csv"
    outcome = calibkit(
        "apply", tmp_path / "runs" / "I" / "r001", data=data / "stations.csv", out=out
    )
    assert outcome.code == 0, outcome.err
    found = pd.read_csv(out)
    assert len(found) == len(log)
    standing = found["azimuth_deg"].notna().to_numpy()
    assert standing.sum() == 40 * (STANDS_S - 4)
    assert not np.any(standing & (log["gyro_x_dph"].to_numpy() > 300.0))
    first = found["azimuth_deg"].to_numpy()[: 4 * (STANDS_S + TURNS_S)]
    assert np.unique(first[np.isfinite(first)]).size == 1
    assert (found["gyro_x_dph"] / log["gyro_x_dph"].to_numpy() - 1.0).abs().max() < 0.1


def test_dwells_of_two_attitudes_are_no_station(rows, tmp_path, calibkit):
    """A log that begins in the middle of a station would make every four of two attitudes: it is
    refused, and says why.
    """
    data = written(
        tmp_path / "d", continuous(rows.iloc[:24], 3, moved=True).drop(columns="station")
    )
    outcome = calibkit("fit", "inclinometer", data=data, serial="I", out=tmp_path / "runs")
    assert outcome.code == 3
    assert "moved between these dwells" in outcome.err
    assert not (tmp_path / "runs").exists()


def test_a_tool_that_never_stands_is_refused(rows, tmp_path, calibkit):
    """Dwells shorter than the recipe's are none."""
    data = written(tmp_path / "d", continuous(rows.iloc[:8], 1))
    settings = ("--set", "stations.dwell_s=100")
    outcome = calibkit("check", "inclinometer", "--data", data, *settings)
    assert outcome.code == 3
    assert "stands in no position for 100 s" in outcome.out + outcome.err


def test_a_sequence_of_any_positions_needs_station_numbers(rows, tmp_path, calibkit):
    """With least squares nothing but a column tells where a station ends."""
    data = written(tmp_path / "d", continuous(rows.iloc[:24], 1).drop(columns="station"))
    settings = ("--set", "stations.method=least_squares")
    outcome = calibkit("fit", "inclinometer", *settings, data=data, serial="I", out=tmp_path / "r")
    assert outcome.code == 3
    assert "column 'station' is missing" in outcome.err
