"""The response of a gyro over its rate where it is no straight line: powers that left-out runs ask
for, and rates that come back over temperature.
"""

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit.instruments.gyro_scale import equation

RATES = np.array([1.0, 3.0, 10.0, 30.0, 50.0, 70.0, 90.0, 110.0, 130.0, 150.0])
RATES = np.concatenate((-RATES[::-1], RATES))
NOISE = 1.0
DRIFT_DEGC = 3.0


def rows_of(shape, seed=0, *, runs=1):
    """Held rates of a gyro of some shape in runs whose K differs by 20 ppm."""
    rng = np.random.default_rng(seed)
    run, rate = np.repeat(np.arange(runs), RATES.size), np.tile(RATES, runs)
    shown = shape(rate) * (1.0 + 2e-5 * rng.standard_normal(runs)[run])
    shown = shown + NOISE * rng.standard_normal(rate.size)
    zero = np.zeros(rate.size, dtype=int)
    return equation.RateRows(rate, shown, run, np.full(rate.size, 25.0), 0.0 * rate, zero, zero)


def powers_of(shape, seed=0, *, runs=1):
    """Powers that are chosen."""
    rows = rows_of(shape, seed, runs=runs)
    return equation.find_terms(rows, varies=False, bent=True).powers


@pytest.mark.parametrize("runs", [1, 3])
def test_a_straight_line_stays_a_straight_line(runs):
    """In at least 36 of 40 noisy straight lines no power is taken, whose runs repeat to 20 ppm."""
    chosen = [powers_of(lambda w: 1e4 * w + 20.0, seed, runs=runs) for seed in range(40)]
    assert chosen.count(()) >= 36


@pytest.mark.parametrize("runs", [1, 3])
def test_a_cubic_and_a_sine_are_told_apart(runs):
    """A cubic of 220 ppm at full scale is one; a sine asks for the fifth power or more."""
    assert powers_of(lambda w: 1e4 * w + 1e-4 * w**3, runs=runs) == (3,)
    sine = powers_of(lambda w: 1e4 * 200.0 * np.sin(w / 200.0), runs=runs)
    assert max(sine) >= 5


def test_two_rates_show_no_shape():
    """Nothing but the line is determined."""
    zero = np.zeros(4, dtype=int)
    rate = np.array([-1.0, 1.0, -1.0, 1.0])
    rows = equation.RateRows(rate, 1e4 * rate, zero, np.full(4, 25.0), 0.0 * rate, zero, zero)
    assert equation.find_terms(rows, varies=False, bent=True).powers == ()


def open_loop(rate, degc):
    """F = A sin(Ω/Ω0) with A and Ω0 over temperature, bent by 3 % at 150 °/s."""
    warm = degc - 25.0
    top = 353.0 * (1.0 + 2e-4 * warm)
    return 1e4 * (1.0 - 4e-4 * warm) * top * np.sin((rate + 0.01) / top)


def open_loop_log(rng, start_degc):
    """A run whose temperature drifts by 3 °C."""
    degc = start_degc + DRIFT_DEGC * (1.0 - np.exp(-np.arange(RATES.size) / 6.0))
    shown = open_loop(RATES, degc) + rng.standard_normal(RATES.size)
    time = 40.0 * np.arange(RATES.size) + 20.0
    columns = {"time_s": time, "table_rate_dps": RATES, "temp_case_degc": degc}
    return pd.DataFrame(columns | {"gyro_x_lsb": shown})


def test_an_open_loop_gyro_over_temperature_is_one_model_in_figure_table_and_apply():
    """Six runs from −40 to 60 °C to ± 150 °/s: K(T) is the best line of the sine at each
    temperature within 1 ppm, the slope that the figure states is that of the curve, and `apply` is
    within 0.03 °/s in a run at another temperature.
    """
    rng = np.random.default_rng(19)
    logs = {
        f"run_{k}.csv": open_loop_log(rng, degc)
        for k, degc in enumerate(np.linspace(-40.0, 60.0, 6))
    }
    recipe = {
        "procedure": "rate_table",
        "logs": {"files": ["*.csv"]},
        "plateaus": {"one_row": True},
        "response": "auto",
    }
    run = calibkit.fit(recipe, logs=logs, runs=None, date="2026-11-26")
    record = run.records["gyro_scale.json"]
    assert record.model("gyro_x.response").form == "gyro-response/2"
    curve = record.model("gyro_x.K_over_temperature")
    K = np.polynomial.Polynomial([c.value for c in curve.coefficients])
    for degc in (-20.0, 20.0, 60.0):
        best = np.polyfit(RATES, open_loop(RATES, np.full(RATES.size, degc)), 1)[0]
        assert K(degc) == pytest.approx(best, rel=1e-6)
    assert not any("is known to" in flag for flag in run.flags)
    figures = {figure.name: figure.value for figure in record.figures}
    slope = figures["temperature_sensitivity.IEEE Std 952.gyro_x"]
    assert slope == pytest.approx(
        1e6 * K.deriv()(10.0) / record.model("gyro_x").value("K"), rel=0.02
    )
    applied = run.apply(open_loop_log(rng, 10.0))
    assert np.max(np.abs(applied["gyro_x_dps"] - RATES)) < 0.03
