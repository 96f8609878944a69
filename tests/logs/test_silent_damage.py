"""Damages that leave a log readable: found, refused, or without effect within the uncertainty."""

import pytest

from attacks import campaigns, silent
from conftest import ROOT, slow_after


@pytest.fixture(scope="module")
def inclinometer(tmp_path_factory):
    """Return the sample campaign of an inclinometer, whose logs can be damaged."""
    return campaigns.make("inclinometer", tmp_path_factory.mktemp("attacks"))


@pytest.mark.parametrize("kind", slow_after(1, silent.KINDS))
def test_no_damage_of_a_station_log_changes_a_coefficient_in_silence(inclinometer, kind):
    """Eight damages of each kind."""
    outcomes = [silent.attack(inclinometer, kind, [11, seed]) for seed in range(8)]
    assert [found for found in outcomes if found[0] == "silent"] == []


def outcome(campaign, name, column, change):
    """Return what a fit says with one column of one log changed."""
    log = campaign.logs[name]
    values = log.column(column)
    change(values)
    return campaign.outcome(name, log.put(column, values).format().encode())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.__setitem__(slice(60, None), 1.8 * t[60:] + 32.0), "one station to the next"),
        (lambda t: t.__setitem__(slice(58, 60), t[58:60] + 12.0), "within a station"),
        (lambda t: t.__setitem__(slice(60, 100), t[60]), "stations in a row"),
    ],
)
def test_a_thermometer_that_stations_contradict_is_named(inclinometer, change, words):
    """°F from a station on, a jump between positions, a reading that stays: s changed by up to 13
    of its expanded uncertainties without a word.
    """
    found, _, said = outcome(inclinometer, "stations.csv", "temp_case_degc", change)
    assert found == "found"
    assert words in said


@pytest.mark.parametrize(
    ("procedure", "name", "column", "rows"),
    [
        ("rate_table", "room_1.csv", "temp_case_degc", 443),
        ("fog_thermal", "ramp_heating_01.csv", "temp_env_degc", 3000),
    ],
)
def test_thermometers_of_tables_and_ramps_that_step_are_named(
    calibkit, tmp_path, procedure, name, column, rows
):
    """From this row on in °F: the temperature coefficient of K and the lags moved by up to 16 of
    their expanded uncertainties without a word.
    """
    log = silent.Text.parse((ROOT / "datasets" / procedure / name).read_text(encoding="utf-8"))
    values = log.column(column)
    values[rows:] = 1.8 * values[rows:] + 32.0
    (tmp_path / name).write_text(log.put(column, values).format(), encoding="utf-8")
    done = calibkit("check", procedure, "--data", tmp_path, "--details")
    assert "from one row to the next" in done.out + done.err
