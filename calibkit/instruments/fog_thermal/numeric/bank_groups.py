"""Block means of ramps averaged to about a minute and turned to where white and flicker noise are
independent, for a fit with Gaussian priors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric.evidence import Gram
from calibkit.numeric import flicker
from calibkit.numeric.dispersion import mad_sigma
from calibkit.numeric.thermal.pooled_fit import Stack

GROUP_S = 60.0
"""Averaging time [s]: shorter than the lags that matter, so that nothing is lost."""
MOST_GROUPS = 300
"""Largest number of groups of a ramp: the size of the matrices that are factored."""
LEAST_GROUPS = 5
"""Fewest groups from which second differences tell white noise."""
LEAST_DRIFT = 0.2
"""Smallest size of the drift that the priors assume, in standard deviations of a group."""


@dataclass(frozen=True, slots=True)
class _Ramp:
    """One ramp: its rows, first rows of its groups, sums of weights [m], averaged indication [m],
    and the flicker variances [m] and directions [m, m] of the turned groups.
    """

    rows: slice
    starts: Integers
    weight: Array
    indication: Array
    flicker: Array
    turn: Array


@dataclass(frozen=True, slots=True)
class Groups:
    """Ramps of a fit, the white noise of a group [°/h] and the size of the drift [°/h]."""

    ramps: tuple[_Ramp, ...]
    weights: Array
    """[n], weights of the rows."""
    white: float
    drift: float
    level: float
    """Mean indication [°/h], which is subtracted."""

    @classmethod
    def of_stack(cls, stacked: Stack, weights: Array) -> Self:
        """Groups of all ramps; raises FitError where the rows are too few to tell their noise."""
        step = float(np.median(np.concatenate([np.diff(log.time) for log in stacked.logs])))
        found = []
        for rows in stacked.ramps:
            count = rows.stop - rows.start
            size = max(round(GROUP_S / step), -(-count // MOST_GROUPS), 1)
            starts = np.arange(max(count // size, 1)) * size
            weight = np.add.reduceat(weights[rows], starts)
            held = np.add.reduceat(stacked.indication[rows] * weights[rows], starts)
            square = np.add.reduceat(weights[rows] ** 2, starts)
            full = np.maximum(weight, 1e-12)
            found.append((rows, starts, weight, held / full, full**2 / np.maximum(square, 1e-24)))
        level = float(np.mean(np.concatenate([held for *_, held, _ in found])))
        bends = [np.diff(held, 2) for *_, held, _ in found if held.size >= LEAST_GROUPS]
        if not bends:
            raise FitError(
                f"no ramp of {LEAST_GROUPS} min for a bank of lags", hint="use longer ramps"
            )
        typical = float(np.median(np.concatenate([counts for *_, counts in found])))
        white = max(mad_sigma(np.concatenate(bends)) / np.sqrt(6.0), 1e-9 * (1.0 + abs(level)))
        away = np.concatenate([held - held.mean() for *_, held, _ in found])
        drift = max(float(np.mean(away**2)) - white**2, (LEAST_DRIFT * white) ** 2) ** 0.5
        kernel = flicker.kernel(max(counts.size for *_, counts in found))
        ramps = []
        for rows, starts, weight, held, counts in found:
            # a group without weight keeps a trace of it, so that no row has to be taken out
            root = np.sqrt(np.maximum(counts * (weight > 0.0), 1e-6) / typical)
            m = root.size
            values, vectors = np.linalg.eigh(kernel[:m, :m] * np.outer(root, root))
            ramps.append(
                _Ramp(rows, starts, weight, held - level, np.maximum(values, 0.0), vectors.T * root)
            )
        return cls(tuple(ramps), weights, white, drift, level)

    def turn(self, columns: Array, subtracted: Array) -> list[tuple[Array, Array]]:
        """Turned groups of columns [m, p] and of the indication less `subtracted` [m], per ramp."""
        whole = np.column_stack([columns, subtracted])
        found = []
        for ramp in self.ramps:
            weighted = whole[ramp.rows] * self.weights[ramp.rows, None]
            means = np.add.reduceat(weighted, ramp.starts) / np.maximum(ramp.weight, 1e-12)[:, None]
            found.append((ramp.turn @ means[:, :-1], ramp.turn @ (ramp.indication - means[:, -1])))
        return found

    def grams(self, turned: Sequence[tuple[Array, Array]], level: float) -> list[Gram]:
        """Moments of each ramp for flicker noise of a level [white noise of a group]."""
        found = []
        for ramp, (columns, values) in zip(self.ramps, turned, strict=True):
            variance = self.white**2 * (1.0 + level**2 * ramp.flicker)
            weighted = columns / variance[:, None]
            found.append(
                Gram(
                    weighted.T @ columns,
                    weighted.T @ values,
                    float(values @ (values / variance)),
                    float(np.sum(np.log(variance))),
                    int(np.count_nonzero(ramp.weight)),
                )
            )
        return found
