"""One four-position inclinometer, its stations in several logs: s(T) of both gyros.

The tool and its stations are those of `simulate`, with constant scale factors. Errors act on the
gyros: after each turn-on the scale factor is another, or both gyros are turned against the
accelerometers. The truth is the tool's own scale factor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from calibkit.errors import CalibkitError
from calibkit.frame import Log
from calibkit.instruments.inclinometer import (
    simulate as simulated,
    solve,
    stations as inclinometer_stations,
)
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import gum
from intervals import exact
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

EACH, NOISE = 8, 5e-4
"""Stations of a log, and the size that errors are stated in: near the noise of a root of s."""
AT_DEGC = (30.0, 70.0, 110.0)
SCALE, TURN = "scale factor of a log", "turn of the gyros"
NAME = "s(T)"


def list_cases() -> list[Case]:
    """Every error at every size and number of logs; with the component given, at seven."""
    found = []
    for logs in GROUPS:
        found.append(_case(NONE, 0.0, logs))
        found += [_case(error, ratio, logs) for error in (SCALE, TURN) for ratio in RATIOS]
    return found + [_case(SCALE, ratio, GROUPS[1], given=True) for ratio in (0.0, *RATIOS)]


def _case(error: str, ratio: float, logs: int, *, given: bool = False) -> Case:
    """Case with the degrees of freedom between its logs, which temperatures cross."""
    between = logs - 1 if error == SCALE else None
    return Case("inclinometer", NAME, error, ratio, logs, given=given, between=between)


def _recipe(case: Case) -> InclinometerRecipe:
    """Recipe of a case."""
    tables: dict[str, object] = {
        "procedure": "inclinometer",
        "logs": {"files": ["*.csv"]},
        "site": {"latitude_deg": 34.2},
        "scale": {"order": 1},
    }
    if case.given:
        stated = {"group": "log", "effect": "scale", "unit": "1", "dof": 1000.0}
        tables["errors"] = {"component": [stated | {"value": case.ratio * NOISE}]}
    return InclinometerRecipe.model_validate(tables, strict=False)


def _logs(case: Case, columns: dict[str, Array], rng: np.random.Generator) -> list[Log]:
    """Logs of stations in random order of temperature, with their errors."""
    order, found = rng.permutation(EACH * case.groups), []
    angle = case.ratio * NOISE * rng.normal() if case.error == TURN else 0.0
    for number in range(case.groups):
        part = np.isin(columns["station"] - 1, order[number :: case.groups])
        own = {name: values[part].astype(float) for name, values in columns.items()}
        off = case.ratio * NOISE * rng.normal() if case.error == SCALE else 0.0
        for gyro in ("gyro_x_dph", "gyro_y_dph"):
            four = own[gyro].reshape(-1, 4)
            turned = np.cos(angle) * four + np.sin(angle) * np.roll(four, -1, axis=1)
            own[gyro] = (turned / (1.0 + off)).ravel()
        frame = pd.DataFrame(own)
        found.append(Log(f"l{number}", f"l{number}.csv", f"{number}", len(frame), frame))
    return found


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    seed, spec = int(rng.integers(1 << 31)), _recipe(case)
    made = simulated.campaign(seed, count=EACH * case.groups, ideal=True)
    columns = {name: np.asarray(values) for name, values in made.logs["stations.csv"].items()}
    try:
        admitted, _ = inclinometer_stations.admit_logs(_logs(case, columns, rng), spec)
        rows = inclinometer_stations.gather_rows(admitted, spec.on_site())
        stations = inclinometer_stations.solve_components(rows, spec)
        fits, seen = solve.fit_scale(stations, spec)
    except CalibkitError as error:
        return Outcome({}, {}, refused=str(error))
    powers, inside, width = np.vander(AT_DEGC, 2, increasing=True), [], []
    for axis, scale in fits.items():
        model, dof = scale.model, scale.effective_dof
        u = np.sqrt(np.einsum("mp,pq,mq->m", powers, model.covariance, powers))
        many = np.full(2, np.inf) if dof is None else dof
        own = [gum.degrees_of_freedom(row, model.covariance, many) for row in powers]
        half = u * [gum.coverage_factor(max(d, 1.0), probability=0.95) for d in own]
        error = powers @ model.coefficients - made.truth["stations"][f"s_{axis}"][0]
        inside.append(np.abs(error) <= half)
        roots, used = seen.solutions[axis], scale.used
        wide = _exact(case, stations.temperature[used], roots.s_root_uncertainty[used])
        width.append(half / wide)
    flags = [flag for scale in fits.values() for flag in scale.flags]
    warned = any("degrees of freedom" in flag for flag in flags)
    return Outcome(
        {NAME: np.concatenate(inside).astype(float)}, {NAME: np.concatenate(width)}, warned
    )


def _exact(case: Case, degc: Array, noise: Array) -> Array:
    """Exact half-widths at the temperatures that are judged; logs are dealt out evenly."""
    own = (np.arange(degc.size)[:, None] % case.groups == np.arange(case.groups)).astype(float)
    size = case.ratio * NOISE if case.error == SCALE else 0.0
    design = np.vander(degc, 2, increasing=True)
    return exact.half_widths(design, size * own, noise, np.vander(AT_DEGC, 2, increasing=True))
