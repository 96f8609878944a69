"""Biases over temperature from several logs: a gyro's turn-on bias is new after every turn-on."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from scipy.stats import t

from calibkit.errors import FitError
from calibkit.instruments.bias import bias_temperature
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe
from calibkit.records.frame import Log
from calibkit.simulate import noise
from conftest import slow_after

LEAST = 0.88
"""Share of campaigns that the stated interval must cover."""
HELD = tuple((degc, degc + 0.5) for degc in (12.0, 18.0, 25.0, 31.0, 38.0, 45.0, 51.5))
"""Temperatures [°C] of logs that are each held at one."""


def recipe(order=3, **tables):
    """Recipe of one gyro with the tables stated."""
    bias = {"abscissa": "temp_case_degc", "bias": [{"indication": "gyro_dph", "order": order}]}
    start = {"procedure": "bias_temperature", "logs": {"files": ["*.csv"]}, "polynomials": bias}
    return BiasTemperatureRecipe.model_validate(start | tables, strict=False)


def warm_ups(seed, ranges, *, turn_on, memory=0.0, rows=1000, slope=0.0):
    """Logs of a gyro that warms from one temperature to another [°C] in each, with turn-on biases
    [°/h] and noise of 1 °/h that remembers the row before.
    """
    rng = np.random.default_rng([seed, 23])
    logs = []
    for number, (cold, warm) in enumerate(ranges):
        degc = warm - (warm - cold) * np.exp(-np.arange(rows) / (0.3 * rows))
        noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.normal(size=rows + 300))
        gyro = turn_on * rng.normal() + slope * degc + noise[300:]
        columns = {"time_s": np.arange(float(rows)), "temp_case_degc": degc, "gyro_dph": gyro}
        logs.append(Log(f"w{number}", f"w{number}.csv", "", rows, pd.DataFrame(columns)))
    return logs


def fit(logs, spec=None):
    """The channel's fit."""
    spec = spec or recipe()
    (channel,) = bias_temperature.fit_channels(logs, spec.polynomials, spec.errors)
    coefficients = channel.model.coefficients
    return SimpleNamespace(
        coefficients=np.array([c.value for c in coefficients]),
        covariance=np.array(channel.model.covariance),
        effective_dof=np.array([c.effective_dof for c in coefficients]),
        components=channel.model.components,
        residual_rms=channel.model.residual_rms,
        flags=channel.flags,
    )


def drift(found, low, high):
    """Drift between two temperatures [°C], and its half-width by Student's t."""
    powers = np.diff(np.vander([low, high], len(found.coefficients), increasing=True), axis=0)[0]
    u = np.sqrt(powers @ found.covariance @ powers)
    return float(powers @ found.coefficients), float(t.ppf(0.975, found.effective_dof[1]) * u)


@pytest.mark.parametrize(
    ("ranges", "turn_on", "memory"),
    slow_after(
        1,
        [
            (((12.0, 40.0), (20.0, 52.0)), 300.0, 0.0),
            (((12.0, 40.0), (20.0, 52.0)), 300.0, 0.9),
            (((12.0, 25.0), (30.0, 52.0)), 300.0, 0.0),
            (((12.0, 50.0), (14.0, 52.0)), 0.0, 0.0),
            (((12.0, 50.0), (14.0, 52.0), (12.0, 45.0), (15.0, 52.0)), 1.0, 0.9),
            (HELD, 1.0, 0.0),
        ],
    ),
    ids=["two", "two, memory", "apart", "no turn-on", "four", "seven held"],
)
def test_turn_on_biases_are_no_drift(ranges, turn_on, memory):
    """No temperature dependence: the drift from 12 to 52 °C is covered in 88 % of 50
    campaigns or more, and of warm-ups known to 2.2 °/h: flicker noise cannot be excluded.
    """
    found = [
        drift(fit(warm_ups(seed, ranges, turn_on=turn_on, memory=memory)), 12.0, 52.0)
        for seed in range(50)
    ]
    value, half = np.array(found).T
    assert np.mean(np.abs(value) <= half) >= LEAST
    assert np.median(half) < 2.2 or len(ranges) == 7


def test_the_turn_on_bias_is_a_result_and_can_be_stated():
    """Two warm-ups warn; turn-on bias of 300 °/h with 1,000 degrees of freedom narrows p0."""
    logs = warm_ups(1, ((12.0, 40.0), (20.0, 52.0)), turn_on=300.0)
    found = fit(logs)
    (one,) = found.components
    assert (one.name, one.unit, one.groups) == ("log-to-log turn-on bias", "deg/h", 2)
    assert found.effective_dof[0] < 2.0
    assert "2 of them leave 1 degrees of freedom" in found.flags[0]
    stated = {"group": "log", "effect": "turn-on bias", "value": 300.0, "unit": "deg/h"}
    given = fit(logs, recipe(errors={"component": [stated | {"dof": 1000.0}]}))
    assert given.effective_dof[0] > 40.0
    assert not given.flags


def test_one_log_says_what_it_cannot_show_and_takes_what_is_stated():
    """p0 of a single warm-up is as uncertain as the turn-on bias that the recipe states."""
    logs = warm_ups(2, ((12.0, 50.0),), turn_on=0.0)
    alone = fit(logs)
    assert "with only one log, how it repeats is unknown" in alone.flags[0]
    stated = {"group": "log", "effect": "turn-on bias", "value": 300.0, "unit": "deg/h"}
    given = fit(logs, recipe(errors={"component": [stated | {"dof": 20.0}]}))
    assert given.covariance[0, 0] == pytest.approx(alone.covariance[0, 0] + 300.0**2)
    assert np.array_equal(given.coefficients, alone.coefficients)
    assert given.effective_dof[0] == pytest.approx(20.0, rel=0.01)


def test_logs_that_coincide_with_temperature_are_refused():
    """Two logs, each held at one temperature, and a straight line: either may be the cause."""
    logs = warm_ups(3, ((20.0, 20.5), (60.0, 60.5)), turn_on=1.0)
    with pytest.raises(FitError, match="turn-on bias of each log cannot be separated from p0, p1"):
        fit(logs, recipe(order=1))
    assert fit(logs, recipe(order=1, errors={"groups": []})).effective_dof[1] > 3.0


def test_flicker_noise_of_one_log_is_in_the_uncertainty_of_level_and_drift():
    """One warm-up with white noise of 1 °/h and flicker noise of 1 °/h: level and drift are covered
    in 88 % of 80 campaigns or more; by the correlation of neighbours alone it would be 80 %.
    """
    inside = []
    at = np.vander([30.0], 4, increasing=True)[0]
    for seed in range(80):
        (log,) = warm_ups(seed, [(15.0, 50.0)], turn_on=0.0)
        log.frame["gyro_dph"] += noise.flicker(1.0, 1000, np.random.default_rng([seed, 31]))
        found = fit([log])
        value, half = drift(found, 15.0, 50.0)
        u = np.sqrt(at @ found.covariance @ at)
        level = abs(at @ found.coefficients) <= t.ppf(0.975, found.effective_dof[0]) * u
        inside.append((abs(value) <= half, level))
    assert np.mean(inside, axis=0).min() >= LEAST
