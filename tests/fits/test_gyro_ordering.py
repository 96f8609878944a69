"""Rates that rise with time: a scale factor that warms up against a bent response."""

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit.instruments.gyro_scale import equation, ordering
from conftest import slow_after

RATES = np.linspace(-100.0, 100.0, 17)
SEEDS = range(20)


def runs(seed, *, warming=0.0, tau_s=300.0, drift=0.0, cubic=0.0, asymmetry=0.0):
    """Three runs of 40 s a rate: relative change of K by a transient, by time, cubic bend, and
    difference between the directions, and K at the end of a run.
    """
    rng, t = np.random.default_rng(seed), 40.0 * np.arange(17)
    scale = 1e4 * (1.0 - warming * np.exp(-t / tau_s) + drift * t / t[-1])
    bend = 1e6 * (cubic * (RATES / 100.0) ** 3 + 0.5 * asymmetry * np.abs(RATES / 100.0))
    shown = scale * RATES + bend
    F = np.concatenate([shown + rng.standard_normal(17) for _ in range(3)])
    run, zero = np.repeat(np.arange(3), 17), np.zeros(51, dtype=int)
    hours = np.tile(t / 3600.0, 3) - t[-1] / 7200.0
    rows = equation.RateRows(np.tile(RATES, 3), F, run, np.full(51, 25.0), hours, zero, zero)
    return rows, scale[-1] + np.polyfit(RATES, bend, 1)[0]


@pytest.mark.parametrize(
    ("decision", "fault"),
    slow_after(
        2,
        [
            ("line", {}),
            ("time", {"warming": 200e-6}),
            ("time", {"drift": 30e-6}),
            ("response", {"cubic": 150e-6}),
            ("response", {"asymmetry": 200e-6}),
        ],
    ),
)
def test_time_and_response_are_told_apart_and_k_is_within_its_half_width(decision, fault):
    """K at the end of the run within half-width and 0.8 ppm in 20 campaigns, and the decision is
    right in each.
    """
    for seed in SEEDS:
        rows, K = runs(seed, **fault)
        found = ordering.decide(rows, rows.indication)
        assert found.decision == decision
        line = np.polyfit(rows.rate_dps, rows.indication, 1)[0]
        assert abs(line + found.shift - K) <= found.half_width + 0.8e-6 * K


def test_a_sine_with_its_powers_is_a_response():
    """A gyro without feedback, bent by 3 % at the fastest rate: the powers to the fifth that its
    equation has are the response, and K stays that of the line.
    """
    for seed in SEEDS:
        rows, _ = runs(seed)
        sine = 1e4 * 235.0 * np.sin(rows.rate_dps / 235.0)
        shown = sine + rows.indication - 1e4 * rows.rate_dps
        found = ordering.decide(rows, shown, powers=(2, 3, 4, 5))
        assert (found.decision, found.shift, found.half_width) == ("response", 0.0, 0.0)


def log_of(gyros, warming):
    """A run of 17 rates that rise with time, of gyros with these scale factors; they warm up."""
    rng, t = np.random.default_rng(17), 40.0 * np.arange(17)
    frame = {"time_s": t, "table_rate_dps": RATES, "temp_case_degc": np.full(17, 25.0)}
    for name, K in gyros.items():
        scale = K * (1.0 - warming * np.exp(-t / 300.0))
        frame[f"gyro_{name}_lsb"] = scale * RATES + 0.5 * rng.standard_normal(17)
    return pd.DataFrame(frame)


@pytest.mark.parametrize("warming", [0.0, 200e-6])
def test_a_pair_that_warms_up_says_so_and_its_ratio_holds_the_truth(warming):
    """A run about each axis from a cold start: both gyros are flagged, and U of K_A holds K at the
    end of the run; without a warm-up there is no such flag.
    """
    recipe = {
        "procedure": "gyro_pair",
        "logs": {"files": ["*.csv"]},
        "pair": {"axis_a": "a.csv", "axis_b": "b.csv"},
        "plateaus": {"one_row": True},
    }
    logs = {"a.csv": log_of({"a": 1e4, "b": 20.0}, warming)}
    logs["b.csv"] = log_of({"a": -15.0, "b": 1.01e4}, warming)
    run = calibkit.fit(recipe, logs=logs, runs=None, date="2026-11-26")
    flagged = [flag for flag in run.flags if "changes with time since the runs began" in flag]
    assert len(flagged) == (2 if warming else 0)
    K = run.records["gyro_scale.json"].model("a_about_a").coefficients[0]
    at_end = 1e4 * (1.0 - warming * np.exp(-17 * 40.0 / 300.0))
    assert abs(K.value - at_end) <= 2.0 * K.standard_uncertainty + 0.01
