"""One gyro on a rate table, one run at each of several temperatures: K and F0 near 25 °C, K(T) and
F0(T).

Gyro and log are those of `physics.gyro`, a row a second. Errors act on the gyro: its scale factor
or zero differs from run to run, the zero also from one direction to the other, the zero drifts
during each run, the response is bent.
The truth is the gyro's best straight line over the rates, without the errors of single runs.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from intervals import exact
from intervals.physics.campaigns import Campaign, Truth, compare, fit
from intervals.physics.gyro import EARTH_DPS, LATITUDE_DEG, NOISE_DPS, ROOM_DEGC, draw, log_run
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from numpy.typing import NDArray

    from intervals.physics.gyro import Gyro

    Array = NDArray[np.float64]

UPWARD_DPS = np.array([5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0])
RATES_DPS = np.concatenate((UPWARD_DPS, -UPWARD_DPS))
TOP_DPS = 100.0
HOLD_ROWS = 30
"""Rows of a held rate, a second apart."""
VERTICAL_DPS = EARTH_DPS * np.sin(np.radians(LATITUDE_DEG))
LOW_DEGC, HIGH_DEGC = -35.0, 85.0
AT_DEGC = (-20.0, 20.0, 60.0)
"""Temperatures at which K(T) and F0(T) are judged."""
SCALE, ZERO, SIDE, DRIFT, ASYMMETRY, RIPPLE = (
    "scale factor of a run",
    "zero of a run",
    "zero of a side of the table",
    "drift of the zero in a run",
    "asymmetry",
    "ripple of the response",
)
OF_RUNS = (SCALE, ZERO, DRIFT)
PERIOD_DPS = 37.0
COMPONENT = {SCALE: ("scale", "ppm"), ZERO: ("zero", "deg/h")}
LINEAR = 2
"""Coefficients of K(T), and of F0(T)."""
FEW = ("degrees of freedom between", "one run does not show")


def list_cases() -> list[Case]:
    """Every error at every size and number of runs; with the component given, at seven."""
    found = []
    for runs in GROUPS:
        found.append(Case("rate_table", "rate table", NONE, 0.0, runs))
        for error in (*OF_RUNS, SIDE, ASYMMETRY, RIPPLE):
            between = runs - LINEAR if error in COMPONENT else None
            found += [
                Case("rate_table", "rate table", error, ratio, runs, between=between)
                for ratio in RATIOS
            ]
    seven = GROUPS[1]
    found += [
        Case("rate_table", "rate table", error, ratio, seven, given=True, between=seven - LINEAR)
        for error in COMPONENT
        for ratio in (0.0, *RATIOS)
    ]
    return found


def _recipe(case: Case) -> dict[str, object]:
    """Recipe of a case."""
    tables: dict[str, object] = {
        "procedure": "rate_table",
        "logs": {"files": ["*.csv"]},
        "site": {"latitude_deg": LATITUDE_DEG},
    }
    if case.given:
        tables["errors"] = {"component": [_state(case, error) for error in COMPONENT]}
    return tables


def _state(case: Case, error: str) -> dict[str, object]:
    """What the recipe states of a component; the one that the case has not is stated as zero."""
    effect, unit = COMPONENT[error]
    size = 1e6 / TOP_DPS if error == SCALE else 3600.0
    value = case.ratio * NOISE_DPS * size if error == case.error else 0.0
    return {"group": "run", "effect": effect, "value": value, "unit": unit, "dof": 1000.0}


def _degc(case: Case) -> Array:
    """Temperatures [r] of the runs [°C], one of them 25 °C."""
    return np.linspace(LOW_DEGC, HIGH_DEGC, case.groups)


def _bend(case: Case, rate_dps: Array) -> Array:
    """Error of the response [n] in noises of a held rate, rms 1 over the rates for a ripple, 1 at
    the largest rate for an asymmetry.
    """
    if case.error == ASYMMETRY:
        return np.abs(rate_dps) / TOP_DPS
    if case.error == RIPPLE:
        return np.sqrt(2.0) * np.sin(2.0 * np.pi * rate_dps / PERIOD_DPS)
    return np.zeros(rate_dps.size)


def log_holds(
    rng: np.random.Generator,
    gyros: dict[str, Gyro],
    turned: Array,
    degc: float = ROOM_DEGC,
    *,
    scale_error: float = 0.0,
    zero_dps: Array | float = 0.0,
) -> pd.DataFrame:
    """Log of a run with many rows a held rate, and the errors of the run, which all gyros share."""
    return log_run(
        rng,
        gyros,
        turned,
        degc,
        rates_dps=np.repeat(RATES_DPS, HOLD_ROWS),
        scale_error=dict.fromkeys(gyros, scale_error),
        zero_dps=dict.fromkeys(gyros, zero_dps),
        noise_dps=NOISE_DPS * np.sqrt(HOLD_ROWS),
        interval_s=1.0,
    )


def _log(
    rng: np.random.Generator, gyro: Gyro, case: Case, degc: float, bend_dps: float
) -> pd.DataFrame:
    """Log of one run, with the errors of its own; `bend_dps` is the error of the response."""
    size = case.ratio * NOISE_DPS * rng.normal() if case.error in OF_RUNS else 0.0
    rate = np.repeat(RATES_DPS, HOLD_ROWS)
    zero = bend_dps * _bend(case, rate + VERTICAL_DPS)
    if case.error == ZERO:
        zero += size
    if case.error == SIDE:
        sides = case.ratio * NOISE_DPS * rng.normal(size=2)
        zero += np.where(rate > 0.0, *sides)
    if case.error == DRIFT:
        zero += size * _time(rate.size)
    scale_error = size / TOP_DPS if case.error == SCALE else 0.0
    return log_holds(rng, {"x": gyro}, gyro.axis, degc, scale_error=scale_error, zero_dps=zero)


def _time(count: int) -> Array:
    """Time [n] since the middle of a run, of standard deviation 1."""
    time = np.arange(count) - 0.5 * (count - 1)
    return np.asarray(time / time.std())


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    gyro = draw(rng, np.eye(3)[2])
    bend_dps = case.ratio * NOISE_DPS * float(rng.normal())
    logs = {
        f"run_{k}.csv": _log(rng, gyro, case, degc, bend_dps)
        for k, degc in enumerate(_degc(case).tolist())
    }
    truth = []
    for degc in (ROOM_DEGC, *AT_DEGC):
        rate = RATES_DPS + VERTICAL_DPS
        indication = gyro.indication(rate, np.full(rate.size, degc))
        indication += gyro.scale(degc) * bend_dps * _bend(case, rate)
        line = np.polyfit(RATES_DPS, indication, 1).tolist()
        for letter, value in zip(("K", "F0"), line, strict=True):
            if degc == ROOM_DEGC:
                truth.append(Truth(f"{letter} at 25 °C", f"gyro_x.{letter}", value))
                continue
            key = ".K_x" if letter == "K" else ".F0_over_temperature.value"
            truth.append(Truth(f"{letter}(T)", key, value, {"temp_case_degc": degc}))
    return compare(fit(Campaign(_recipe(case), logs, truth)), _exact(case), FEW)


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of each quantity, of a gyro of nominal scale factor."""
    degc, K = _degc(case), 10_000.0
    count, size = RATES_DPS.size, case.ratio * NOISE_DPS
    run, rate = np.repeat(np.arange(degc.size), count), np.tile(RATES_DPS, degc.size)
    warm = degc[run] / 100.0
    design = np.column_stack((rate, rate * warm, np.ones(rate.size), warm))
    own = (run[:, None] == np.arange(degc.size)).astype(np.float64)
    time = np.tile(_time(count), degc.size)
    line, bend = np.column_stack((rate, np.ones(rate.size))), _bend(case, rate)
    shared = {
        SCALE: own * rate[:, None] / TOP_DPS,
        ZERO: own,
        SIDE: np.hstack((own * (rate > 0.0)[:, None], own * (rate < 0.0)[:, None])),
        DRIFT: own * time[:, None],
    }
    bent = (bend - line @ np.linalg.lstsq(line, bend)[0])[:, None]
    effect = size * shared.get(case.error, bent)

    def widths(term: int, at_degc: Sequence[float]) -> Array:
        rows = np.zeros((len(at_degc), 4))
        rows[:, 2 * term], rows[:, 2 * term + 1] = 1.0, np.array(at_degc) / 100.0
        return K * exact.half_widths(design, effect, NOISE_DPS, rows)

    found = {}
    for term, letter in enumerate(("K", "F0")):
        found[f"{letter} at 25 °C"] = widths(term, (ROOM_DEGC,))
        found[f"{letter}(T)"] = widths(term, AT_DEGC)
    return found


def scale_half_width() -> float:
    """Relative half-width of the scale factor of one run."""
    design = np.column_stack((RATES_DPS, np.ones(RATES_DPS.size)))
    none = np.zeros((RATES_DPS.size, 1))
    return float(exact.half_widths(design, none, NOISE_DPS, np.eye(2)[:1])[0])
