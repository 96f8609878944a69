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
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import common_errors, determination
from calibkit.instruments.accelerometer.numeric.dwell_fit import MappedFit
from calibkit.numeric.least_squares import (
    fit as least_squares,
    fold,
    gram,
    leave_out,
    polynomial,
    robust,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class KAxis(MappedFit):
    """Fit of K0 … K9 of one axis, zero where not fitted; residuals [n] are reference minus
    corrected component.
    """

    fitted: tuple[int, ...]
    """Indices of the fitted coefficients, ascending."""


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


def fit(
    indication: Array,
    temperature: Array,
    reference: Array,
    *,
    terms: Sequence[KTerms] = (KTerms(), KTerms(), KTerms()),
    weights: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
    groups: Integers | None = None,
) -> tuple[KAxis, KAxis, KAxis]:
    """Fit K0 … K9 of the three axes.

    Parameters
    ----------
    indication
        [n, 3], dwell means [g, nominally scaled, positive along gravity].
    temperature
        [n] [°C].
    reference
        [n, 3] [g], from `attitude.gravity_vector`.
    terms
        Three, one per axis.
    weights
        [n] or [n, 3], 1/variance of the dwell means.
    loss
        "robust" downweights outliers and names them.
    groups
        [n], labels of dwells that share an error (a table position, a stretch of a sweep):
        covariance by leaving out one group at a time. The ordinary covariance holds for independent
        dwells of equal noise.

    Raises
    ------
    FitError
        When the conditions do not determine a coefficient: names it, says why and which dwells to
        add.

    """
    most = max(len(part.fitted) for part in terms)
    if len(temperature) <= most:
        raise FitError(
            f"{len(temperature)} dwells for {most} coefficients an axis",
            hint="add dwells until residuals can judge the fit, or lower the orders",
        )
    _require_determined(reference, temperature, terms)
    middle, half = polynomial.middle_and_half(temperature)
    half = half or 1.0
    mapped = (temperature - middle) / half
    x, y, z = (
        _fit_axis(
            *(indication, mapped, reference, i, terms[i].fitted, weights, loss, groups),
            (middle, half),
        )
        for i in range(3)
    )
    return x, y, z


def _require_determined(reference: Array, temperature: Array, terms: Sequence[KTerms]) -> None:
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


def _fit_axis(
    indication: Array,
    mapped: Array,
    reference: Array,
    axis: int,
    numbers: tuple[int, ...],
    weights: Array | None,
    loss: Literal["least_squares", "robust"],
    groups: Integers | None,
    held: tuple[float, float],
) -> KAxis:
    """Fit the K of one axis in mapped temperature; `held` is the middle and half-width of the
    temperature range [°C].
    """
    names = [f"{NAMES[k]} of accel_{AXES[axis]}" for k in numbers]
    weight = None if weights is None else (weights if weights.ndim == 1 else weights[:, axis])
    target = reference[:, axis]
    if loss == "least_squares" and groups is None and len(mapped) >= gram.TALL:
        result = fold.linear(
            lambda part: columns(indication[part], mapped[part], axis, numbers),
            target,
            weights=weight,
            names=names,
        )
        return in_degrees(result, result.covariance, None, result.dof, numbers, held)
    tough: robust.RobustFit | None = None
    row_weights = np.ones(len(mapped)) if weight is None else weight
    design = columns(indication, mapped, axis, numbers)
    if loss == "robust":
        common = common_errors.label(mapped * held[1], reference)
        tough = robust.linear(design, target, weights=weight, names=names, groups=common)
        result = tough.fit
        row_weights = row_weights * tough.row_weights
    else:
        result = least_squares.linear(design, target, weights=weight, names=names)
    covariance, dof = result.covariance, result.dof
    if groups is not None:
        covariance = leave_out.jackknife_covariance(
            design, result.residuals, groups, weights=row_weights
        )
        # attitudes determine four coefficients: as many degrees of freedom fewer than groups
        dof = min(dof, max(len(np.unique(groups)) - 4, 1))
    return in_degrees(result, covariance, tough, dof, numbers, held)


def in_degrees(
    result: least_squares.LinearFit,
    covariance: Array,
    tough: robust.RobustFit | None,
    dof: int,
    numbers: tuple[int, ...],
    held: tuple[float, float],
) -> KAxis:
    """Convert a fit in mapped temperature to powers of °C, in extended precision because K3 and K7
    lose digits in double precision.
    """
    mapped, mapped_covariance = np.zeros(10), np.zeros((10, 10))
    mapped[list(numbers)] = result.coefficients
    mapped_covariance[np.ix_(numbers, numbers)] = covariance
    to_raw = np.eye(10, dtype=np.longdouble)
    to_raw[:4, :4] = to_raw[4:8, 4:8] = polynomial.to_raw_powers(*held, 3)
    raw, raw_covariance = polynomial.in_raw_powers(mapped, mapped_covariance, to_raw)
    suspects, left_out = common_errors.find_suspects(tough)
    return KAxis(
        fitted=numbers,
        coefficients=raw,
        covariance=raw_covariance,
        mapped_coefficients=mapped,
        mapped_covariance=mapped_covariance,
        middle=held[0],
        half=held[1],
        residuals=result.residuals,
        suspects=suspects,
        left_out=left_out,
        common_errors=common_errors.read(tough.structured if tough else (), result.residuals),
        dof=dof,
        residual_rms=result.residual_rms * float(np.sqrt(1.0 + len(numbers) / result.dof)),
        condition=result.condition,
    )
