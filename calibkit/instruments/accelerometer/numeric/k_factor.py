"""Scale factor, zero offset and cross-axis terms of a triaxial accelerometer over temperature:
K-factor.

Per axis, linear in ten coefficients (Zhou, Hu & Fu 2010), x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) − (K4 + K5 t + K6 t² + K7 t³) − K8 G_y − K9 G_z

K8 and K9 are for x of y and z, for y of z and x, for z of x and y. The reference is regressed on
the indications, so noise of the indications is noise of the regressors too; at 20 µg it shifts no
coefficient by a hundredth of its standard uncertainty (Fuller 1987, section 2.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import determination
from calibkit.numeric.least_squares import (
    polynomial,
)

AXES = ("x", "y", "z")
NAMES = ("K0", "K1", "K2", "K3", "K4", "K5", "K6", "K7", "K8", "K9")
CROSS = ((1, 2), (2, 0), (0, 1))
"""Indices of the two axes that K8 and K9 multiply, axis by axis: y and z, z and x, x and y."""
IMPORTANCE = (0, 4, 8, 9, 1, 5, 2, 6, 3, 7)
"""Indices of the coefficients by importance: of two that the data cannot separate, the later one is
reported as undetermined.
"""


@dataclass(frozen=True, slots=True)
class KTerms:
    """Selection of the ten coefficients of an axis that are fitted; the others are zero."""

    scale_order: int = 3
    """Highest power of temperature in the scale factor, 0..3: K0..K3."""
    zero_order: int = 3
    """Highest power of temperature in the zero offset, 0..3: K4..K7."""
    cross: bool = True
    """Whether K8 and K9 are fitted."""

    def __post_init__(self) -> None:
        if not (self.scale_order in range(4) and self.zero_order in range(4)):
            raise FitError(
                f"scale order {self.scale_order} and zero order {self.zero_order}",
                hint="orders of K run from 0 to 3",
            )

    @property
    def fitted(self) -> tuple[int, ...]:
        """Indices of the fitted coefficients, ascending."""
        cross = (8, 9) if self.cross else ()
        return (*range(self.scale_order + 1), *range(4, 5 + self.zero_order), *cross)


def columns(
    indication: Array, temperature: Array, axis: int, numbers: Sequence[int] = range(10)
) -> Array:
    """Design matrix [n, p] of one axis for the coefficients K with the given indices, in their
    order.

    `temperature` [n] is in the unit that the coefficients are meant for: °C, or mapped to [−1, 1].
    """
    powers = polynomial.powers(temperature, 3).T
    own = np.ascontiguousarray(indication[:, axis])
    whole = np.empty((len(numbers), temperature.size))
    for row, k in zip(whole, numbers, strict=True):
        if k < 4:
            np.multiply(own, powers[k], out=row)
        else:
            np.negative(powers[k - 4] if k < 8 else indication[:, CROSS[axis][k - 8]], out=row)
    # each column contiguous
    return whole.T


def require_determined(reference: Array, temperature: Array, terms: Sequence[KTerms]) -> None:
    """Raise FitError where references [n, 3] and temperatures [n] [°C] leave a K undetermined, see
    `determination.require_determined`.
    """
    ranked = [[k for k in IMPORTANCE if k in part.fitted] for part in terms]
    parts = [
        determination.Part(
            f"accel_{axis}",
            tuple(NAMES[k] for k in numbers),
            partial(columns, axis=i, numbers=numbers),
        )
        for i, (axis, numbers) in enumerate(zip(AXES, ranked, strict=True))
    ]
    determination.require_determined(
        parts,
        reference,
        temperature,
        order=max(max(part.scale_order, part.zero_order) for part in terms),
        lower="lower scale_order and zero_order, or set cross to false",
    )


def indications(coefficients: Array, reference: Array, temperature: Array) -> Array:
    """Inverse model: indications [n, 3] that the coefficients K [3, 10] correct to the reference
    [n, 3].
    """
    powers = np.vander(temperature, 4, increasing=True)
    matrix = np.zeros((len(temperature), 3, 3))
    target = np.empty((len(temperature), 3, 1))
    for i, (first, second) in enumerate(CROSS):
        matrix[:, i, i] = powers @ coefficients[i, :4]
        matrix[:, i, first], matrix[:, i, second] = -coefficients[i, 8], -coefficients[i, 9]
        target[:, i, 0] = reference[:, i] + powers @ coefficients[i, 4:8]
    return np.asarray(np.linalg.solve(matrix, target)[:, :, 0], dtype=np.float64)
