"""Held rates of a real table: lost pulses, stops, fine rates through 0, one row per held rate."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

import bench_physics as bench
from calibkit.errors import FitError, FrameError
from calibkit.instruments.gyro_scale import fit, lines, published, simulate, table_runs
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
from calibkit.records.frame import Log

K = 10000.0
RATES = simulate.both_ways((5.0, 10.0, 20.0, 50.0, 100.0))
LOGS = {"files": ["*.csv"]}
SPEC = RateTableRecipe(procedure="rate_table", logs=LOGS)


def log_of(columns):
    """Log of columns in memory."""
    frame = pd.DataFrame(columns)
    return Log("run", "run.csv", "run", len(frame), frame)


def held(seed, rates=RATES):
    """Log of a table that steps from rate to rate, 40 rows each, and of a straight-line gyro."""
    rng = np.random.default_rng(seed)
    rate = np.repeat(np.array(rates), 40)
    return {
        "time_s": np.arange(rate.size) * 1.0,
        "table_rate_dps": rate,
        "gyro_x_lsb": K * rate + 20.0 + rng.normal(0.0, 3.0, rate.size),
    }


def test_lost_pulses_are_named_with_row_and_expected_value():
    """Three rows of zero while the table turns 50 °/s: refused with line, number and expectation;
    before, K was 0.7 % off; a whole log has no finding, at any of 20 seeds.
    """
    columns = held(1)
    first = int(np.flatnonzero(columns["table_rate_dps"] == 50.0)[20])
    columns["gyro_x_lsb"][first : first + 3] = 0.0
    with pytest.raises(FrameError, match=rf"run.csv:{first + 2}.*3 such rows.*about 5e\+05"):
        table_runs.fit_run(SPEC, log_of(columns))
    for seed in range(20):
        found = table_runs.faults(SPEC, log_of(held(seed))).findings
        assert not [finding for finding in found if finding.name == "dropout"]


def table_log(rates, *, hold_s=40.0, along=1.0, late_s=0.0, filter_s=0.0, phase=0.0, step_s=0.5):
    """Log of a table that comes to each rate by 20 °/s², and of a gyro that is at an angle to its
    axis, in the earth's rate at 48°; rows are means over 20 ms steps.
    """
    fine = 0.02
    at = np.repeat(np.array(rates), round(hold_s / fine))
    ramps = [
        np.linspace(a, b, max(round(abs(b - a) / 20.0 / fine), 1), endpoint=False)
        for a, b in pairwise([0.0, *rates])
    ]
    parts = zip(ramps, np.split(at, len(rates)), strict=True)
    rate = np.concatenate([np.concatenate(part) for part in parts])
    per_row = round(step_s / fine)
    rate = rate[: rate.size // per_row * per_row]
    time, turned = fine * np.arange(1, rate.size + 1), np.cumsum(rate) * fine
    across = np.sqrt(1.0 - along**2) * np.cos(np.radians(turned + phase))
    sensed = along * rate + bench.EARTH_DPH / 3600.0 * (0.743 * along + 0.669 * across)
    if filter_s:
        sensed = bench.lagged(sensed, time, filter_s)
    sensed = np.interp(time - late_s, time, sensed)
    noise = np.random.default_rng(5).normal(0.0, 1e-6 * K, rate.size // per_row)
    return log_of(
        {
            "time_s": time[per_row - 1 :: per_row],
            "table_rate_dps": rate.reshape(-1, per_row).mean(axis=1),
            "gyro_x_lsb": K * sensed.reshape(-1, per_row).mean(axis=1) + noise,
        }
    )


SLOW = simulate.both_ways((5.0, 10.0, 20.0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"late_s": 3.0}, "3 s after the table"),
        ({"late_s": -3.0}, "3 s before the table"),
        ({"filter_s": 4.0}, "s after the table"),
        ({"filter_s": 10.0, "hold_s": 60.0}, "s after the table"),
    ],
)
def test_a_gyro_stamped_late_or_filtered_lost_no_pulses(options, words):
    """The time offset is named in place of "pulses were lost"; a gyro of neither is accepted, and
    one that is filtered where what it takes to settle is left out.
    """
    (finding,) = table_runs.faults(SPEC, table_log(SLOW, **options)).findings
    assert (finding.name, finding.refused) == ("late", True)
    assert words in finding.found
    assert not table_runs.faults(SPEC, table_log(SLOW)).findings
    settled = SPEC.model_copy(
        update={"plateaus": SPEC.plateaus.model_copy(update={"settle_s": 40.0})}
    )
    filtered = table_log(SLOW, hold_s=200.0, filter_s=4.0)
    assert not table_runs.faults(settled, filtered).findings


def test_fine_rates_through_zero_give_the_dead_zone():
    """No response within ±0.008 °/s, tested at 5 and 10 thousandths: 0.015 ± 0.002 °/s; a gyro that
    responds to all rates has no such figure.
    """
    fine = np.array([0.001, 0.002, 0.005, 0.01, 0.1, 1.0, 10.0])
    rate = np.concatenate([-fine[::-1], fine])
    u = np.full(rate.size, 0.1)
    dead = K * np.where(np.abs(rate) < 0.008, 0.0, rate)
    found = {f.name: f for f in published.figures(published.Line(rate, dead, u), 0.1, "x")}
    zone = found["dead_zone.GJB 2426A.x"]
    assert zone.value == pytest.approx(0.015)
    assert zone.standard_uncertainty == pytest.approx(0.005 / np.sqrt(6.0))
    whole = published.figures(published.Line(rate, K * rate, u), 0.1, "x")
    assert zone.name not in {f.name for f in whole}


def test_one_row_a_held_rate_is_valid_data():
    """Twelve rows that are means: refused with the key that states it, then K within 4 standard
    uncertainties, u from the residuals.
    """
    rng = np.random.default_rng(4)
    rate = np.array([*RATES, 2.0, -2.0])
    columns = {
        "time_s": np.arange(rate.size) * 60.0,
        "table_rate_dps": rate,
        "gyro_x_lsb": K * rate + 20.0 + rng.normal(0.0, 1.0, rate.size),
    }
    with pytest.raises(FrameError):
        table_runs.fit_run(SPEC, log_of(columns))
    spec = RateTableRecipe(procedure="rate_table", logs=LOGS, plateaus={"one_row": True})
    run = table_runs.fit_run(spec, log_of(columns))
    found = lines.Lines.of([[(0, run)]]).of_runs([run], "x")
    assert abs(found.value[0] - K) < 4.0 * found.u[0] < 0.2
    assert any("one row per held rate" in flag for flag in run.flags)
    assert np.median(run.plateaus.standard_uncertainty[:, 0]) == pytest.approx(1.0, rel=0.5)


def runs_over_temperature(seed, degc, logged, *, bend=0.0):
    """Runs of one gyro at temperatures [°C], whose thermometers logged others; K(T) of 20 ppm/°C
    bends by `bend` [1] at 50 °C off 25 °C.
    """
    rng = np.random.default_rng(seed)
    gyro = replace(simulate.RateGyro.draw(rng), K_per_degc=20e-6)
    table = simulate.TurnedTable(shortest_hold_s=10.0)
    rates = simulate.both_ways((20.0, 50.0, 100.0))
    runs = []
    for k, (true, shown) in enumerate(zip(degc, logged, strict=True)):
        scale = 1.0 + bend * ((true - 25.0) / 50.0) ** 2 + rng.normal(0.0, 1e-6)
        seen = replace(gyro, K=gyro.K * scale)
        columns = simulate.run({"gyro_x_lsb": seen}, table, rates, true, rng)
        columns["temp_case_degc"] = columns["temp_case_degc"] - true + shown
        log = replace(log_of(columns), name=f"run{k}", file=f"run{k}.csv", sha256=f"{k}")
        runs.append(table_runs.fit_run(SPEC, log))
    return runs


DEGC = np.array([-40.0, -20.0, 0.0, 20.0, 40.0, 60.0, 60.0, 40.0, 20.0, 0.0, -20.0, -40.0])


def temperature_flags(runs):
    """Flags on what runs say of temperature against each other."""
    return [
        flag
        for flag in fit.fit_campaign(SPEC, {"": runs}).flags
        if "let expect" in flag or "bends that much" in flag
    ]


def test_runs_in_degf_are_refused_by_the_scale_factor_over_temperature():
    """The second session, or one run, in °F under names that say nothing: named and refused; K was
    1,260 ppm off before.
    """
    for session in (slice(6, None), slice(3, 4)):
        logged = DEGC.copy()
        logged[session] = 1.8 * logged[session] + 32.0
        with pytest.raises(FitError, match="only if these runs are in °F") as raised:
            temperature_flags(runs_over_temperature(3, DEGC, logged))
        named = {f"run{k}.csv" for k in range(*session.indices(DEGC.size))}
        assert {name for name in named if name in raised.value.message} == named


def test_a_run_whose_thermometer_shows_another_temperature_is_flagged():
    """25 °C where it was 60 °C: the run and its size are named; of a run that is alone at its
    temperature only this or a bend of K(T) explains it, and the flag says so.
    """
    logged = DEGC.copy()
    logged[5] = 25.0
    flags = temperature_flags(runs_over_temperature(4, DEGC, logged))
    assert len(flags) == 1
    assert re.search(r"K of run5.csv at 25.* \+[67]\d\d ppm off what the other runs", flags[0])
    few = np.array([25.0, 25.0, 25.0, -40.0, -40.0, 60.0, 0.0, 0.0])
    flags = temperature_flags(runs_over_temperature(4, few, np.where(few == 60.0, 140.0, few)))
    assert any("either K of run5.csv" in flag and "repeat a run" in flag for flag in flags)


@pytest.mark.parametrize("bend", [0.0, 3e-4])
def test_sound_runs_over_temperature_contradict_nothing(bend):
    """A straight and a bent K(T): no flag on temperatures."""
    for seed in range(3):
        assert temperature_flags(runs_over_temperature(seed, DEGC, DEGC, bend=bend)) == []
