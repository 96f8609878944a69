"""Three gyros turned about the three axes of their base, one run each: scale factors and angles.

Gyros and mounting errors are those of `gyro_pair`: each run's table axis is off the axis of the
base that it is named after. One set of runs cannot show how mountings repeat: u holds what is
given.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from intervals import exact
from intervals.gyro_pair import MOUNTING, log_mounted, mounting_rad, state_mounting
from intervals.physics.campaigns import Campaign, Truth, compare, fit
from intervals.physics.gyro import draw
from intervals.rate_table import scale_half_width
from intervals.rows import NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

GYROS = "xyz"
MISALIGNED = 3e-3
"""Standard deviation of the components of an input axis across its base axis."""
FEW = ("the errors of mounting are not in u",)


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
    axes = np.eye(3) + rng.normal(0.0, MISALIGNED, (3, 3))
    gyros = {name: draw(rng, axis) for name, axis in zip(GYROS, axes, strict=True)}
    logs = {
        f"about_{name}.csv": log_mounted(rng, gyros, axis, case)
        for name, axis in zip(GYROS, np.eye(3), strict=True)
    }
    truth = [Truth("scale factor", f"scale_factor.{name}", gyros[name].K) for name in GYROS]
    for g, h in combinations(GYROS, 2):
        angle = float(np.degrees(np.arccos(gyros[g].axis @ gyros[h].axis)))
        truth.append(Truth("angle", f"angle_deg.{g}_{h}", angle))
    recipe = state_mounting(case) | {"procedure": "gyro_triad"}
    recipe["axes"] = {name: [f"about_{name}*.csv"] for name in GYROS}
    return compare(fit(Campaign(recipe, logs, truth)), _exact(case), FEW)


@lru_cache(maxsize=4)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of nominal scale factors, and of angles [°] near 90°: two mountings and two
    runs take part in each.
    """
    scale = scale_half_width()
    angle = np.sqrt(2.0) * np.hypot(scale, exact.NORMAL_95 * mounting_rad(case))
    return {
        "scale factor": np.full(3, 10_000.0 * scale),
        "angle": np.full(3, np.degrees(angle)),
    }
