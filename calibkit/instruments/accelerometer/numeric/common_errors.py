"""Errors that the dwells of one attitude or of one temperature have in common: a face that is set
up wrong the same way every time, a zero that moved before a soak.

A robust fit must not take them for outliers and drop the face or the soak.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.instruments.accelerometer.numeric import determination
from calibkit.numeric.least_squares.structure import Structure

COMMON = ("attitude", "temperature")
"""What dwells have in common, in the order of the labels."""
SAME_ATTITUDE_G = 0.02
"""Steps [g] of the components of gravity in which dwells count as at one attitude."""


@dataclass(frozen=True, slots=True)
class CommonError:
    """Dwells that stand apart together, and are kept in the fit."""

    common: str
    """attitude or temperature."""
    dwells: tuple[int, ...]
    component: int
    """Axis whose residuals stand apart, from 0; 0 also for the magnitude."""
    size: float
    """Median residual [unit of the reference]."""


def label(
    temperature: Array, reference: Array | None = None, components: int = 1
) -> tuple[Integers, Integers]:
    """Labels [n · components] of the attitude and of the temperature of residuals [n, components]
    in rows, each component on its own; −1 for the attitude where no reference [n, 3] is known.
    """
    levels = np.unique(determination.distinct_temperatures(temperature)[1], return_inverse=True)[1]
    attitudes = np.full(temperature.size, -1)
    if reference is not None:
        steps = np.round(reference / SAME_ATTITUDE_G)
        attitudes = np.unique(steps, axis=0, return_inverse=True)[1].ravel()
    attitudes, levels = (
        np.where(one[:, None] < 0, -1, components * one[:, None] + np.arange(components)).ravel()
        for one in (attitudes, levels)
    )
    return attitudes, levels


def read(structured: Sequence[Structure], residuals: Array) -> tuple[CommonError, ...]:
    """Common errors from the structure that a robust fit found under these labels and its residuals
    [n] or [n, components].
    """
    components = residuals.size // len(residuals)
    return tuple(
        CommonError(
            COMMON[one.group],
            tuple((one.rows // components).tolist()),
            one.level % components,
            float(np.median(residuals.ravel()[one.rows])),
        )
        for one in structured
    )
