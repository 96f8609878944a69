"""Derivatives by the complex step, and functions that numpy does not continue to complex numbers.

f′(p) = Im f(p + i h) / h has no difference in which digits cancel: h may be 1e-30, and the
derivative is exact to the last digit (Squire & Trapp 1998). numpy's abs, hypot, arctan2, sign, clip
and interp drop the imaginary part, so that their derivative would be 0 without a word: equations
and results use the functions below.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibkit.numeric.arrays import Array

STEP = 1e-30
Numbers = NDArray[Any]
"""Real values, or complex ones while a derivative is taken."""


def derivative(function: Callable[[Numbers], Numbers], parameters: Array) -> Array:
    """Jacobian [..., p] of a function [...] of the parameters [p]."""
    columns = []
    for k in range(len(parameters)):
        stepped = parameters.astype(complex)
        stepped[k] += 1j * STEP
        columns.append(np.imag(function(stepped)) / STEP)
    return np.stack(columns, axis=-1) if columns else np.zeros((*np.shape(function(parameters)), 0))


def length(vector: Numbers) -> Numbers:
    """Euclidean length [...] of vectors [..., k]."""
    return np.asarray(np.sqrt(np.sum(vector * vector, axis=-1)))


def arctan2(y: Numbers, x: Numbers) -> Numbers:
    """Angle [rad] of the point (x, y)."""
    angle = np.arctan2(np.real(y), np.real(x))
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return np.asarray(angle)
    # d atan2 = (x dy - y dx) / (x² + y²)
    square = np.real(x) ** 2 + np.real(y) ** 2
    slope = (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / square
    return np.asarray(angle + 1j * slope)
