"""Two gyros turned about two table axes, one run each: N, γ and α.

The gyros are input axes in space with the physics of `simulate`; their mounting error
turns each table axis off the gyro that it is named after, in any direction. The truth is that of
the gyros' own axes. The size of a mounting error is that of each of its two angles.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from calibkit.errors import CalibkitError
from calibkit.frame import Log
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    fit,
    simulate as simulated,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
from calibkit.numeric import gum
from intervals import exact
from intervals.rate_table import INTERVAL_S, RATES_DPS, held_rates, noise_dps
from intervals.rows import NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RUNS = 2
MOUNTING = "mounting"
ALPHA_DEG = 60.0
FEW = "the two runs show a mounting error of"


def list_cases() -> list[Case]:
    """Mounting errors of every size, estimated from the two γ and given."""
    none = Case("gyro_pair", "pair", NONE, 0.0, RUNS, between=1)
    made = [Case("gyro_pair", "pair", MOUNTING, r, RUNS, between=1) for r in RATIOS]
    given = [Case("gyro_pair", "pair", MOUNTING, r, RUNS, given=True) for r in (0.0, *RATIOS)]
    return [none, *made, *given]


def mounting_rad(case: Case) -> float:
    """Standard deviation of each mounting angle: the noise of a held rate over the largest rate."""
    return case.ratio * noise_dps() / max(RATES_DPS)


def state_mounting(case: Case) -> dict[str, object]:
    """Tables of a recipe that state the logs, the site and, where it is given, the mounting."""
    tables: dict[str, object] = {"logs": {"files": ["*.csv"]}}
    tables["site"] = {"latitude_deg": simulated.TurnedTable().latitude_deg}
    if case.given:
        value = float(np.degrees(mounting_rad(case)))
        stated = {"group": MOUNTING, "effect": "angle", "value": value, "unit": "deg"}
        tables["errors"] = {"component": [{**stated, "dof": 1000.0}]}
    return tables


def log_run(
    name: str,
    turned: Array,
    gyros: dict[str, simulated.RateGyro],
    axes: dict[str, Array],
    rng: np.random.Generator,
) -> Log:
    """Log of a table that turns both gyros about an axis in space."""
    first = np.cross(turned, rng.normal(size=3))
    first /= np.linalg.norm(first)
    second = np.cross(turned, first)
    seen = {
        f"gyro_{g}_lsb": replace(
            gyro, axis=tuple(float(axes[g] @ one) for one in (first, second, turned))
        )
        for g, gyro in gyros.items()
    }
    table = simulated.TurnedTable(interval_s=INTERVAL_S, start_angle_deg=rng.uniform(0.0, 360.0))
    columns = simulated.run(seen, table, RATES_DPS, simulated.REFERENCE_DEGC, rng)
    return Log(name, f"{name}.csv", name, len(columns["time_s"]), pd.DataFrame(columns))


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one pair, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    alpha = np.radians(ALPHA_DEG + rng.normal())
    spec = GyroPairRecipe.model_validate(
        state_mounting(case) | {"procedure": "gyro_pair"}, strict=False
    )
    axes = {"a": np.array([0.0, 0.0, 1.0]), "b": np.array([np.sin(alpha), 0.0, np.cos(alpha)])}
    gyros = {
        g: replace(simulated.RateGyro.draw(rng), ripple_dps=0.0, asymmetry=0.0, K_per_degc=0.0)
        for g in axes
    }
    runs = []
    for g, axis in axes.items():
        turned = axis + np.cross(mounting_rad(case) * rng.normal(size=3), axis)
        log = log_run(g, turned / np.linalg.norm(turned), gyros, axes, rng)
        runs.append(log)
    try:
        about_a, about_b = (table_runs.fit_run(spec, log) for log in runs)
        fitted = fit.fit_campaign(spec, {"a": (about_a,), "b": (about_b,)})
        model = coefficient_files.list_results(fitted, spec)[1].models[0]
    except CalibkitError as error:
        return Outcome({}, {}, refused=str(error))
    truth = {
        "N": gyros["b"].K / gyros["a"].K,
        "gamma": float(np.cos(alpha)),
        "alpha_deg": float(np.degrees(alpha)),
    }
    inside, width, wide = {}, {}, _exact(case)
    for c in model.coefficients:
        if c.name in truth:
            factor = gum.coverage_factor(model.dof_of(c), probability=0.95)
            half = factor * c.standard_uncertainty
            inside[c.name] = np.array([float(abs(c.value - truth[c.name]) <= half)])
            width[c.name] = np.array([half / wide[c.name]])
    return Outcome(inside, width, warned=any(FEW in flag for flag in fitted.flags))


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, float]:
    """Exact half-widths of a pair of nominal scale factors at the nominal angle."""
    scale, alpha = scale_half_width(), np.radians(ALPHA_DEG)
    angle = exact.NORMAL_95 * mounting_rad(case)
    gamma = np.hypot(scale * np.hypot(1.0, np.cos(alpha)), angle * np.sin(alpha))
    return {
        "N": float(scale * np.sqrt(2.0)),
        "gamma": float(gamma),
        "alpha_deg": float(np.degrees(gamma / np.sin(alpha))),
    }


def scale_half_width() -> float:
    """Relative half-width of the scale factor of one run."""
    held = held_rates()
    design = np.column_stack((held.rate, np.ones(held.rate.size)))
    none = np.zeros((held.rate.size, 1))
    return float(exact.half_widths(design, none, held.noise, np.eye(2)[:1])[0])
