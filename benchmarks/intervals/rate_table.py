"""One gyro on a rate table, one run at each of several temperatures: K and F0 near 25 °C, K(T) and
F0(T).

The gyro, the table and their log are those of `simulate`: a table that accelerates and
turns unevenly, the earth's rate, whole counts, a filter that lags. Errors act on the gyro: its
scale factor or zero differs from run to run, the zero also from one direction to the other, the
zero drifts during each run, the response is bent.
The truth is the gyro's best straight line over the rates, without the errors of single runs.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from calibkit.constants import DPH_PER_DPS
from calibkit.errors import CalibkitError
from calibkit.frame import Log
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    fit,
    simulate as simulated,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
from calibkit.numeric import gum
from intervals import exact
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.coefficients import Model

    Array = NDArray[np.float64]

RATES_DPS = simulated.both_ways((5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0))
TOP_DPS = 100.0
LOW_DEGC, HIGH_DEGC = -35.0, 85.0
AT_DEGC = (-20.0, 20.0, 60.0)
"""Temperatures at which K(T) and F0(T) are judged."""
GYRO, INTERVAL_S = "gyro_x_lsb", 1.0
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


def _recipe(case: Case) -> RateTableRecipe:
    """Recipe of a case."""
    tables: dict[str, object] = {
        "procedure": "rate_table",
        "logs": {"files": ["*.csv"]},
        "site": {"latitude_deg": simulated.TurnedTable().latitude_deg},
    }
    if case.given:
        tables["errors"] = {"component": [_state(case, error) for error in COMPONENT]}
    return RateTableRecipe.model_validate(tables, strict=False)


def _state(case: Case, error: str) -> dict[str, object]:
    """What the recipe states of a component; the one that the case has not is stated as zero."""
    effect, unit = COMPONENT[error]
    size = 1e6 / TOP_DPS if error == SCALE else DPH_PER_DPS
    value = case.ratio * noise_dps() * size if error == case.error else 0.0
    return {"group": "run", "effect": effect, "value": value, "unit": unit, "dof": 1000.0}


def _draw(rng: np.random.Generator, case: Case) -> simulated.RateGyro:
    """A linear gyro, unless the error is of its response."""
    gyro = replace(simulated.RateGyro.draw(rng), ripple_dps=0.0, asymmetry=0.0)
    size = case.ratio * noise_dps() * float(rng.normal())
    if case.error == ASYMMETRY:
        return replace(gyro, asymmetry=2.0 * size / TOP_DPS)
    if case.error == RIPPLE:
        return replace(gyro, ripple_dps=np.sqrt(2.0) * size, ripple_period_dps=PERIOD_DPS)
    return gyro


def _degc(case: Case) -> Array:
    """Temperatures [r] of the runs [°C], one of them 25 °C."""
    return np.linspace(LOW_DEGC, HIGH_DEGC, case.groups)


def _log(
    gyro: simulated.RateGyro, case: Case, degc: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Columns of one run, with the errors of its own."""
    table = simulated.TurnedTable(interval_s=INTERVAL_S, start_angle_deg=rng.uniform(0.0, 360.0))
    size = case.ratio * noise_dps() * rng.normal() if case.error in OF_RUNS else 0.0
    if case.error == SCALE:
        gyro = replace(gyro, K=gyro.K * (1.0 + size / TOP_DPS))
    if case.error == ZERO:
        gyro = replace(gyro, bias_dps=gyro.bias_dps + size)
    log = simulated.run({GYRO: gyro}, table, RATES_DPS, degc, rng)
    if case.error == SIDE:
        sides = case.ratio * noise_dps() * rng.normal(size=2)
        rate = log["table_rate_dps"]
        log[GYRO] = log[GYRO] + gyro.K * np.where(rate > 0.0, sides[0], np.where(rate, sides[1], 0))
    if case.error == DRIFT:
        share = log["time_s"] - log["time_s"].mean()
        log[GYRO] = log[GYRO] + gyro.K * size * share / share.std()
    return log


def _fit_run(log: dict[str, Array], name: str, spec: RateTableRecipe) -> table_runs.TableRun:
    """Held rates and line of one run."""
    frame = pd.DataFrame(log)
    return table_runs.fit_run(spec, Log(name, f"{name}.csv", name, len(frame), frame))


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    gyro, spec = _draw(rng, case), _recipe(case)
    logs = [_log(gyro, case, degc, rng) for degc in _degc(case).tolist()]
    try:
        runs = [_fit_run(log, f"run_{k}", spec) for k, log in enumerate(logs)]
        (made,) = coefficient_files.list_results(fit.fit_campaign(spec, {"": runs}), spec)
    except CalibkitError as error:
        return Outcome({}, {}, refused=str(error))
    models = {model.name: model for model in made.models}
    line = models["gyro_x"]
    at = np.array([line.value("temp_case"), *AT_DEGC])
    truth = np.array(
        [gyro.best_line(simulated.TurnedTable(), RATES_DPS, degc) for degc in at.tolist()]
    )
    room = np.array(
        [_of_line(c.value, c.standard_uncertainty, line.dof_of(c)) for c in line.coefficients]
    )
    inside, width, wide = {}, {}, _exact(case)
    for k, letter in enumerate(("K", "F0")):
        curve = _along(models[f"gyro_x.{letter}_over_temperature"])
        parts = {f"{letter} at 25 °C": (room[k : k + 1], truth[:1, k])}
        parts[f"{letter}(T)"] = (curve, truth[1:, k])
        for name, (found, true) in parts.items():
            inside[name] = (np.abs(found[:, 0] - true) <= found[:, 1]).astype(np.float64)
            width[name] = found[:, 1] / wide[name]
    return Outcome(inside, width, any(text in flag for flag in made.flags for text in FEW))


def _of_line(value: float, u: float, dof: float) -> tuple[float, float]:
    """Value and 95 % half-width."""
    return value, gum.coverage_factor(dof, probability=0.95) * u


def _along(curve: Model) -> Array:
    """Values and 95 % half-widths [m, 2] of a polynomial at the temperatures that are judged."""
    covariance = np.array(curve.covariance)
    dof = np.array([curve.dof_of(c) for c in curve.coefficients], dtype=np.float64)
    rows = np.vander(AT_DEGC, len(dof), increasing=True)
    values = rows @ [c.value for c in curve.coefficients]
    u = np.sqrt(np.einsum("mp,pq,mq->m", rows, covariance, rows))
    own = [gum.degrees_of_freedom(row, covariance, dof) for row in rows]
    return np.array([_of_line(*one) for one in zip(values.tolist(), u.tolist(), own, strict=True)])


class _Held(NamedTuple):
    """Held rates of a run."""

    rate: Array
    """[p] [°/s]."""
    time: Array
    """Middle [p] [s]."""
    noise: Array
    """Standard deviation [p] of the means [°/s]."""


@lru_cache(maxsize=1)
def held_rates() -> _Held:
    """Held rates of any run."""
    rng = np.random.default_rng(1)
    gyro = simulated.RateGyro.draw(rng)
    table = simulated.TurnedTable(interval_s=INTERVAL_S)
    log = simulated.run({GYRO: gyro}, table, RATES_DPS, 25.0, rng)
    spec = RateTableRecipe.model_validate(
        {"procedure": "rate_table", "logs": {"files": ["*.csv"]}}, strict=False
    )
    held = _fit_run(log, "run", spec).plateaus
    middle = np.mean(log["time_s"][held.span[:, 0]] + log["time_s"][held.span[:, 1] - 1]) / 2.0
    time = 0.5 * (log["time_s"][held.span[:, 0]] + log["time_s"][held.span[:, 1] - 1]) - middle
    return _Held(held.rate_dps, time, gyro.noise_lsb / gyro.K / np.sqrt(np.diff(held.span)[:, 0]))


def noise_dps() -> float:
    """Noise of the mean over a held rate [°/s], rms over the rates."""
    return float(np.sqrt(np.mean(held_rates().noise ** 2)))


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of each quantity, of a gyro of nominal scale factor."""
    held, degc, K = held_rates(), _degc(case), 10_000.0
    count, size = held.rate.size, case.ratio * noise_dps()
    run = np.repeat(np.arange(degc.size), count)
    rate, time = np.tile(held.rate, degc.size), np.tile(held.time, degc.size)
    warm = degc[run] / 100.0
    design = np.column_stack((rate, rate * warm, np.ones(rate.size), warm))
    own = (run[:, None] == np.arange(degc.size)).astype(np.float64)
    line = np.column_stack((rate, np.ones(rate.size)))
    bends = {ASYMMETRY: np.abs(rate) / TOP_DPS, RIPPLE: np.sin(2.0 * np.pi * rate / PERIOD_DPS)}
    shared = {
        SCALE: own * rate[:, None] / TOP_DPS,
        ZERO: own,
        SIDE: np.hstack((own * (rate > 0.0)[:, None], own * (rate < 0.0)[:, None])),
        DRIFT: own * (time / time.std())[:, None],
    } | {
        name: (bend - line @ np.linalg.lstsq(line, bend)[0])[:, None]
        for name, bend in bends.items()
    }
    effect = size * shared.get(case.error, np.zeros((rate.size, 1)))
    noise = np.tile(held.noise, degc.size)

    def widths(term: int, at_degc: Sequence[float]) -> Array:
        rows = np.zeros((len(at_degc), 4))
        rows[:, 2 * term], rows[:, 2 * term + 1] = 1.0, np.array(at_degc) / 100.0
        return K * exact.half_widths(design, effect, noise, rows)

    found = {}
    for term, letter in enumerate(("K", "F0")):
        found[f"{letter} at 25 °C"] = widths(term, (25.0,))
        found[f"{letter}(T)"] = widths(term, AT_DEGC)
    return found
