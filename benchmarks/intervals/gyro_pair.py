"""Two gyros turned about two table axes, one run each: N, γ and α.

The gyros are input axes in space with the physics of `physics.gyro`; their mounting error turns
each table axis off the gyro that it is named after, in any direction. The truth is that of the
gyros' own axes. The size of a mounting error is that of each of its two angles.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from intervals import exact
from intervals.physics.campaigns import Campaign, Truth, compare, fit
from intervals.physics.gyro import LATITUDE_DEG, NOISE_DPS, draw
from intervals.rate_table import TOP_DPS, log_holds, scale_half_width
from intervals.rows import NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from intervals.physics.gyro import Gyro

    Array = NDArray[np.float64]

RUNS = 2
MOUNTING = "mounting"
ALPHA_DEG = 60.0
FEW = ("the two runs show a mounting error of",)


def list_cases() -> list[Case]:
    """Mounting errors of every size, estimated from the two γ and given."""
    none = Case("gyro_pair", "pair", NONE, 0.0, RUNS, between=1)
    made = [Case("gyro_pair", "pair", MOUNTING, r, RUNS, between=1) for r in RATIOS]
    given = [Case("gyro_pair", "pair", MOUNTING, r, RUNS, given=True) for r in (0.0, *RATIOS)]
    return [none, *made, *given]


def mounting_rad(case: Case) -> float:
    """Standard deviation of each mounting angle: the noise of a held rate over the largest rate."""
    return case.ratio * NOISE_DPS / TOP_DPS


def state_mounting(case: Case) -> dict[str, object]:
    """Tables of a recipe that state the site and, where it is given, the mounting."""
    tables: dict[str, object] = {"logs": {"files": ["*.csv"]}}
    tables["site"] = {"latitude_deg": LATITUDE_DEG}
    if case.given:
        value = float(np.degrees(mounting_rad(case)))
        stated = {"group": MOUNTING, "effect": "angle", "value": value, "unit": "deg"}
        tables["errors"] = {"component": [{**stated, "dof": 1000.0}]}
    return tables


def log_mounted(
    rng: np.random.Generator, gyros: dict[str, Gyro], axis: Array, case: Case
) -> pd.DataFrame:
    """Log of a table whose axis in space is off the one it is named after."""
    turned = axis + np.cross(mounting_rad(case) * rng.normal(size=3), axis)
    return log_holds(rng, gyros, turned / np.linalg.norm(turned))


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one pair, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    alpha = np.radians(ALPHA_DEG + rng.normal())
    axes = {"a": np.array([0.0, 0.0, 1.0]), "b": np.array([np.sin(alpha), 0.0, np.cos(alpha)])}
    gyros = {name: draw(rng, axis) for name, axis in axes.items()}
    logs = {f"{name}.csv": log_mounted(rng, gyros, axis, case) for name, axis in axes.items()}
    truth = [
        Truth("N", "pair.N", gyros["b"].K / gyros["a"].K),
        Truth("gamma", "pair.gamma", float(np.cos(alpha))),
        Truth("alpha_deg", "pair.alpha_deg", float(np.degrees(alpha))),
    ]
    recipe = state_mounting(case) | {"procedure": "gyro_pair"}
    recipe["pair"] = {"axis_a": "a.csv", "axis_b": "b.csv"}
    return compare(fit(Campaign(recipe, logs, truth)), _exact(case), FEW)


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of a pair of nominal scale factors at the nominal angle."""
    scale, alpha = scale_half_width(), np.radians(ALPHA_DEG)
    angle = exact.NORMAL_95 * mounting_rad(case)
    gamma = np.hypot(scale * np.hypot(1.0, np.cos(alpha)), angle * np.sin(alpha))
    widths = {
        "N": scale * np.sqrt(2.0),
        "gamma": gamma,
        "alpha_deg": np.degrees(gamma / np.sin(alpha)),
    }
    return {name: np.array([width]) for name, width in widths.items()}
