"""Errors that rows share, and what is known of parameters before a fit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibkit.fit.complex_step import Numbers
from calibkit.numeric.arrays import Array, Integers


@dataclass(frozen=True, slots=True, kw_only=True)
class Shared:
    """An error that all residuals of a level share: r = … + loading · b, b ~ N(0, size² I)."""

    group: str
    """What the residuals of a level have in common: "soak", "run", "attitude"."""
    effect: str
    """What differs from level to level: "zero", "scale", "index"."""
    level: Integers
    """[n], number of the level of each residual, -1 for none; [n, j] where one feels j levels, as a
    turn between two attitudes does.
    """
    loading: Array
    """[n, k] or [n, j, k], derivative of the residual by the k errors of its level."""
    unit: str
    size: float | None = None
    """Standard deviation where it is stated."""
    size_dof: float = np.inf
    """Degrees of freedom of the stated size; with fewer the data add to it, ∞ holds it."""
    largest: float = np.inf
    """Size beyond which none is sought: gross errors in a few rows can make the likelihood of a
    large error of all rows rise without bound.
    """
    optional: bool = False
    """Kept where the likelihood asks for it."""
    bound: bool = False
    """Whether the stated size is the largest that the error can have: U holds it, and it is no
    result.
    """

    @property
    def name(self) -> str:
        """Name of the error: "soak zero"."""
        return f"{self.group} {self.effect}"

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(self.level.max(initial=-1)) + 1

    @property
    def width(self) -> int:
        """Errors of one level."""
        return int(self.loading.shape[-1])

    @property
    def is_noise(self) -> bool:
        """Whether no level has two residuals: the error is a part of their noise."""
        if self.level.ndim > 1:
            return False
        levels_of_rows = self.level[self.level >= 0]
        return levels_of_rows.size > 0 and int(np.bincount(levels_of_rows).max()) == 1

    def design(self, rows: Integers) -> Array:
        """Z [m, levels · k] of m residuals, the k errors of a level side by side."""
        level = self.level[rows].reshape(len(rows), -1)
        loading = self.loading[rows].reshape(*level.shape, self.width)
        z = np.zeros((len(rows), self.levels, self.width))
        row, place = np.nonzero(level >= 0)
        np.add.at(z, (row, level[row, place]), loading[row, place])
        return z.reshape(len(rows), -1)

    def along(self, b: Array) -> Array:
        """Z b [n] for errors b [levels · k]."""
        level = self.level.reshape(len(self.level), -1)
        loading = self.loading.reshape(*level.shape, self.width)
        error = np.vstack([b.reshape(self.levels, self.width), np.zeros(self.width)])[level]
        return np.asarray(np.sum(loading * error, axis=(1, 2)), dtype=np.float64)

    def gathered(self, values: Array) -> Array:
        """Zᵀ V [levels · k, m] for values V [n, m] of the residuals; 0 for V of no rows, as a fit
        without errors has.
        """
        level = self.level.reshape(len(self.level), -1)
        loading = self.loading.reshape(*level.shape, self.width)
        row, place = np.nonzero(level >= 0)
        # the k errors of a level stand side by side
        column = (level[row, place][:, None] * self.width + np.arange(self.width)).ravel()
        loading, count = loading[row, place], self.levels * self.width
        total = np.zeros((count, values.shape[1]))
        for k, value in enumerate(values.T if len(values) else ()):
            total[:, k] = np.bincount(column, (loading * value[row, None]).ravel(), count)
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Parameters known beforehand, p[block] ~ N(mean, (size · shape)²).

    Each is a further row 0 = (p - mean)/shape + e, e ~ N(0, size²): the size of a block is
    estimated as any noise is.
    """

    name: str
    block: slice
    size: float
    size_dof: float = np.inf
    mean: Array | float = 0.0
    shape: Array | float = 1.0

    def rows(self, p: Numbers) -> Numbers:
        """Residuals [k] of the block in parameters [p]."""
        return (p[self.block] - self.mean) / self.shape


Residual = Callable[[Numbers], Numbers]
"""Parameters [p] → what the equation leaves of the rows [n] or [n, m]."""
