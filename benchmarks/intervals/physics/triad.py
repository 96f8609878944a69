"""Three servo accelerometers whose magnets lose flux by an exponential law and whose bias saturates
as a spring's does; gravity on a two-axis table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

ROOM_DEGC = 25.0
SPOTS_DEG = np.array(
    [(0, 0), *((i, j) for i in (45, 90, 135) for j in range(0, 360, 45)), (180, 0)],
    dtype=np.float64,
)
"""Inclination and toolface of 26 attitudes on a table."""


@dataclass(frozen=True)
class Triad:
    """Constants of three servo accelerometers, each [3] over the axes."""

    scale: Array
    flux_loss: Array
    flux_bend: Array
    bias: Array
    slope: Array
    bend: Array
    width: Array
    axes: Array
    """Unit vectors [3, 3] in rows."""

    def indication(
        self, down: Array, degc: Array, zero: Array, flux: Array, second: Array
    ) -> Array:
        """Indications [n, 3] [g] in gravity [n, 3] [g] at temperatures [n], with errors of zero
        [n, 3] [g] and flux [n, 3], and of second order [3] [g/g²].
        """
        warm = (degc - ROOM_DEGC)[:, None]
        along = down @ self.axes.T
        bias = self.bias + self.slope * warm + self.bend * np.tanh(warm / self.width) + zero
        magnet = self.scale * np.exp(-self.flux_loss * warm - self.flux_bend * warm**2)
        return np.asarray(magnet * (1.0 + flux) * (along + second * along**2 + bias))


def draw(rng: np.random.Generator, axes: Array) -> Triad:
    """A triad with axes [3, 3] of any length."""
    return Triad(
        1.0 + rng.normal(0.0, 3e-3, 3),
        rng.normal(1.2e-4, 2e-5, 3),
        rng.normal(1e-7, 3e-8, 3),
        rng.normal(0.0, 3e-3, 3),
        rng.normal(0.0, 3e-5, 3),
        rng.normal(0.0, 5e-4, 3),
        rng.uniform(150.0, 250.0, 3),
        axes / np.linalg.norm(axes, axis=1)[:, None],
    )


def gravity(angle_deg: Array, base: Array) -> Array:
    """Gravity [n, 3] in a tool at inclination and toolface [n, 2] on a base in which it is [3]."""
    (theta, phi), zero = np.radians(angle_deg).T, np.zeros(len(angle_deg))
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    rows = ((ct * cp, sp, -st * cp), (-ct * sp, cp, st * sp), (st, zero, ct))
    return np.column_stack([np.column_stack(row) @ base for row in rows])
