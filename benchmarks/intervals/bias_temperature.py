"""Warm-ups of one gyro: its bias as a cubic of temperature, and the drift over the range.

The bias follows a magnetic and an elastic part, neither a polynomial; each warm-up starts at
another temperature and approaches the end exponentially. Errors: after each turn-on the bias is
another, or wanders slowly while the gyro warms. The truth of coefficients is that of a fit to the
same rows without errors and noise, of the drift the gyro's own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from intervals import exact
from intervals.physics.campaigns import Campaign, Difference, Truth, compare, fit
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

ROWS, NOISE_DPH = 300, 1.0
"""Rows of a warm-up, and their noise [°/h]: white."""
LOW_DEGC, HIGH_DEGC = 15.0, 50.0
ORDER = 3
TURN_ON, WANDER = "turn-on bias of a log", "wander of the bias in a log"
COEFFICIENTS = f"p0…p{ORDER}"
FEW = ("degrees of freedom, so intervals are wide", "so it is in no uncertainty")


def list_cases() -> list[Case]:
    """Every error at every size and number of logs; with the component given, at seven."""
    found = []
    for logs in GROUPS:
        found.append(_case(NONE, 0.0, logs))
        found += [_case(error, ratio, logs) for error in (TURN_ON, WANDER) for ratio in RATIOS]
    return found + [_case(TURN_ON, ratio, GROUPS[1], given=True) for ratio in (0.0, *RATIOS)]


def _case(error: str, ratio: float, logs: int, *, given: bool = False) -> Case:
    """Case with the degrees of freedom between its logs; warm-ups overlap: the cubic takes one."""
    between = logs - 1 if error == TURN_ON else None
    return Case(
        "bias_temperature", "bias_temperature", error, ratio, logs, given=given, between=between
    )


def _temperatures(case: Case, rng: np.random.Generator) -> Array:
    """Temperatures [logs, rows] [°C]; every warm-up ends near the highest."""
    start = LOW_DEGC + rng.uniform(0.0, 8.0, (case.groups, 1))
    start[0], share = LOW_DEGC, np.exp(-np.arange(ROWS) / (0.3 * ROWS))
    return np.asarray(HIGH_DEGC + 1.0 - (HIGH_DEGC + 1.0 - start) * share)


def _bias(constants: Array, degc: Array) -> Array:
    """Bias [°/h] at temperatures."""
    slope, magnetic, elastic, width = constants
    warm = degc - 25.0
    return np.asarray(
        slope * warm + magnetic * np.expm1(-warm / 120.0) + elastic * np.tanh(warm / width)
    )


def _draw(rng: np.random.Generator) -> Array:
    """Constants of a gyro."""
    return np.array([rng.normal(0.0, 0.2), *rng.normal(0.0, 10.0, 2), rng.uniform(100.0, 200.0)])


def _wander() -> Array:
    """Slow wander [rows] of standard deviation 1 over a log: half a period of a cosine."""
    shape = np.cos(np.pi * np.arange(ROWS) / ROWS)
    return np.asarray(shape / shape.std())


def _logs(degc: Array, gyro: Array) -> dict[str, pd.DataFrame]:
    """Logs of the warm-ups."""
    time = np.arange(float(ROWS))
    return {
        f"w{number}.csv": pd.DataFrame({"time_s": time, "temp_case_degc": t, "gyro_dph": y})
        for number, (t, y) in enumerate(zip(degc, gyro, strict=True))
    }


def _recipe(case: Case) -> dict[str, object]:
    """Recipe of a case."""
    bias = {"abscissa": "temp_case_degc", "bias": [{"indication": "gyro_dph", "order": ORDER}]}
    tables: dict[str, object] = {
        "procedure": "bias_temperature",
        "logs": {"files": ["*.csv"]},
        "polynomials": bias,
    }
    if case.given:
        stated = {"group": "log", "effect": "turn-on bias", "value": case.ratio * NOISE_DPH}
        tables["errors"] = {"component": [{**stated, "unit": "deg/h", "dof": 1000.0}]}
    return tables


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    constants, degc = _draw(rng), _temperatures(case, rng)
    clean, size = _bias(constants, degc), case.ratio * NOISE_DPH
    gyro = clean + NOISE_DPH * rng.normal(size=degc.shape)
    if case.error == TURN_ON:
        gyro = gyro + size * rng.normal(size=(case.groups, 1))
    if case.error == WANDER:
        gyro = gyro + size * rng.normal(size=(case.groups, 1)) * _wander()
    coefficients = np.polynomial.Polynomial.fit(degc.ravel(), clean.ravel(), ORDER).convert().coef
    truth = [
        Truth(COEFFICIENTS, f"gyro_dph.p{k}", float(value)) for k, value in enumerate(coefficients)
    ]
    ends = (LOW_DEGC, HIGH_DEGC)
    true_drift = float(np.diff(_bias(constants, np.array(ends)))[0])
    drift = Difference("drift", "gyro_dph", "temp_case_degc", ends, true_drift)
    campaign = Campaign(_recipe(case), _logs(degc, gyro), truth, differences=(drift,))
    return compare(fit(campaign), _exact(case), FEW)


def _drift() -> Array:
    """Combination [1, p] that is the drift over the range."""
    ends = np.vander([LOW_DEGC, HIGH_DEGC], ORDER + 1, increasing=True)
    return np.diff(ends, axis=0)


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of each quantity, for temperatures like the others'."""
    degc = _temperatures(case, np.random.default_rng(1)).ravel()
    own = np.kron(np.eye(case.groups), np.ones((ROWS, 1)))
    shapes = {TURN_ON: own, WANDER: own * np.tile(_wander(), case.groups)[:, None]}
    shared = case.ratio * NOISE_DPH * shapes.get(case.error, np.zeros((degc.size, 1)))
    design = np.vander(degc, ORDER + 1, increasing=True)
    rows = {COEFFICIENTS: np.eye(ORDER + 1), "drift": _drift()}
    return {name: exact.half_widths(design, shared, NOISE_DPH, part) for name, part in rows.items()}
