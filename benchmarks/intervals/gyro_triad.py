"""Three gyros turned about the three axes of their base, one run each: scale factors and angles.

Gyros and mounting errors are those of `gyro_pair`: each run's table axis is off the axis of the
base that it is named after. One set of runs cannot show how mountings repeat: u holds what is
given.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import CalibkitError
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    fit,
    simulate as simulated,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.numeric import gum
from intervals import exact
from intervals.gyro_pair import MOUNTING, log_run, mounting_rad, scale_half_width, state_mounting
from intervals.rows import NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

GYROS = "xyz"
MISALIGNED = 3e-3
"""Standard deviation of the components of an input axis across its base axis."""
FEW = "the errors of mounting are not in u"


def list_cases() -> list[Case]:
    """Mounting errors of every size, unknown and given."""
    none = Case("gyro_triad", "triad", NONE, 0.0, len(GYROS))
    made = [Case("gyro_triad", "triad", MOUNTING, r, len(GYROS), between=0) for r in RATIOS]
    given = [
        Case("gyro_triad", "triad", MOUNTING, r, len(GYROS), given=True) for r in (0.0, *RATIOS)
    ]
    return [none, *made, *given]


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one triad, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    rows = np.eye(3) + rng.normal(0.0, MISALIGNED, (3, 3))
    axes = dict(zip(GYROS, rows / np.linalg.norm(rows, axis=1)[:, None], strict=True))
    gyros = {
        g: replace(simulated.RateGyro.draw(rng), ripple_dps=0.0, asymmetry=0.0, K_per_degc=0.0)
        for g in GYROS
    }
    logs = {}
    for g, axis in zip(GYROS, np.eye(3), strict=True):
        turned = axis + np.cross(mounting_rad(case) * rng.normal(size=3), axis)
        logs[g] = log_run(g, turned / np.linalg.norm(turned), gyros, axes, rng)
    spec = GyroTriadRecipe.model_validate(
        state_mounting(case) | {"procedure": "gyro_triad"}, strict=False
    )
    try:
        runs = {g: (table_runs.fit_run(spec, log),) for g, log in logs.items()}
        fitted = fit.fit_campaign(spec, runs)
        made = coefficient_files.list_results(fitted, spec)[1]
    except CalibkitError as error:
        return Outcome({}, {}, refused=str(error))
    figures = {figure.name: figure for figure in made.figures}
    scale, angle = _exact(case)
    names = {"scale factor": [f"scale_factor.{g}" for g in GYROS]}
    truth = {f"scale_factor.{g}": gyros[g].K for g in GYROS}
    for g, h in combinations(GYROS, 2):
        truth[f"angle_deg.{g}_{h}"] = float(np.degrees(np.arccos(axes[g] @ axes[h])))
    names["angle"] = [name for name in truth if name.startswith("angle")]
    inside, width = {}, {}
    for quantity, members in names.items():
        found = [figures[name] for name in members]
        half = np.array(
            [
                one.standard_uncertainty
                * gum.coverage_factor(one.effective_dof or np.inf, probability=0.95)
                for one in found
            ]
        )
        off = np.array([one.value - truth[one.name] for one in found])
        inside[quantity] = (np.abs(off) <= half).astype(np.float64)
        wide = np.array([truth[name] for name in members]) * scale
        width[quantity] = half / (angle if quantity == "angle" else wide)
    return Outcome(inside, width, warned=any(FEW in flag for flag in fitted.flags))


@lru_cache(maxsize=4)
def _exact(case: Case) -> tuple[float, float]:
    """Exact half-widths of a scale factor, relative, and of an angle [°] near 90°: two mountings
    and two runs take part in it.
    """
    scale = scale_half_width()
    angle = np.sqrt(2.0) * np.hypot(scale, exact.NORMAL_95 * mounting_rad(case))
    return scale, float(np.degrees(angle))
