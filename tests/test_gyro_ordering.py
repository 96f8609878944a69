"""Rates that rise with time: a scale factor that warms up against a bent response."""

import numpy as np
import pytest

from calibkit.instruments.gyro_scale import equation, ordering

RATES = np.linspace(-100.0, 100.0, 17)
SEEDS = range(20)


def runs(seed, *, warming=0.0, tau_s=300.0, drift=0.0, cubic=0.0):
    """Three runs of 40 s a rate: relative change of K by a transient, by time, and cubic bend, and
    K at the end of a run.
    """
    rng, t = np.random.default_rng(seed), 40.0 * np.arange(17)
    scale = 1e4 * (1.0 - warming * np.exp(-t / tau_s) + drift * t / t[-1])
    shown = scale * RATES + 1e6 * cubic * (RATES / 100.0) ** 3
    F = np.concatenate([shown + rng.standard_normal(17) for _ in range(3)])
    run, zero = np.repeat(np.arange(3), 17), np.zeros(51, dtype=int)
    hours = np.tile(t / 3600.0, 3) - t[-1] / 7200.0
    rows = equation.Rows(np.tile(RATES, 3), F, run, np.full(51, 25.0), hours, zero, zero)
    bend = np.polyfit(RATES, 1e6 * cubic * (RATES / 100.0) ** 3, 1)[0]
    return rows, scale[-1] + bend


@pytest.mark.parametrize(
    ("decision", "fault"),
    [
        ("line", {}),
        ("time", {"warming": 200e-6}),
        ("time", {"drift": 30e-6}),
        ("response", {"cubic": 150e-6}),
    ],
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


def test_without_times_or_with_an_unknown_effect_of_temperature_nothing_is_decided():
    """No hours, or a run that warms by 1 °C at one temperature: None."""
    rows, _ = runs(0, warming=200e-6)
    zero = rows.line
    unlogged = equation.Rows(
        rows.rate_dps, rows.indication, rows.run, rows.row_degc, np.zeros(51), zero, zero
    )
    assert ordering.decide(unlogged, rows.indication) is None
    warm = equation.Rows(
        rows.rate_dps, rows.indication, rows.run, 25.0 + rows.hours * 6.0, rows.hours, zero, zero
    )
    assert ordering.decide(warm, rows.indication) is None
