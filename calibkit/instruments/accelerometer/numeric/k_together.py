"""K-factor of the three axes fitted together, with errors that dwells and axes share."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.instruments.accelerometer.numeric import k_factor
from calibkit.instruments.accelerometer.numeric.k_factor import (
    AXES,
    CROSS,
    NAMES,
    KAxis,
    KTerms,
    columns,
    in_degrees,
)
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine, Refined, Residuals
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Effect, Known
from calibkit.numeric.least_squares.fit import LinearFit

LARGEST_MISALIGNMENT = Known(0.1, bound=True)
"""Angle [rad] beyond that of any sensor to its axis: 6°."""


def fit(
    indication: Array,
    temperature: Array,
    reference: Array,
    *,
    terms: Sequence[KTerms],
    weights: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
    groups: Integers | None = None,
    refine: Refine,
) -> tuple[KAxis, ...]:
    """Fit K0 … K9 of the three axes, then again with errors that dwells share.

    Parameters
    ----------
    indication, temperature, reference, terms, weights, loss
        As for `k_factor.fit`.
    groups
        As for `k_factor.fit`, whose covariance then stands.
    refine
        `shared_errors.refine` with the circumstances of the dwells.

    Raises
    ------
    FitError
        As `k_factor.fit`.

    """
    axes = k_factor.fit(
        *(indication, temperature, reference),
        terms=terms,
        weights=weights,
        loss=loss,
        groups=groups,
    )
    if groups is not None:
        return axes
    return _share(
        axes, indication, temperature, reference, weights, refine, leave_out=loss == "robust"
    )


def _share(
    axes: Sequence[KAxis],
    indication: Array,
    temperature: Array,
    reference: Array,
    weights: Array | None,
    refine: Refine,
    *,
    leave_out: bool,
) -> tuple[KAxis, ...]:
    """Fit three axes again, now with errors that dwells share."""
    count = len(temperature)
    ends = np.cumsum([0, *(len(axis.fitted) for axis in axes)]).tolist()
    own = [slice(a, b) for a, b in pairwise(ends)]
    mapped = (temperature - axes[0].middle) / axes[0].half

    def linearised(values: Array, dwells: Integers) -> tuple[Array, Array]:
        design = np.zeros((len(dwells), 3, ends[-1]))
        for i, (axis, part) in enumerate(zip(axes, own, strict=True)):
            design[:, i, part] = columns(indication[dwells], mapped[dwells], i, axis.fitted)
        return (design @ values - reference[dwells]).ravel(), design.reshape(-1, ends[-1])

    used = np.array([~np.isin(np.arange(count), axis.suspects) for axis in axes]).T
    weight = np.broadcast_to(1.0 if weights is None else weights.T, (3, count)).T
    found = refine(
        linearised,
        np.concatenate([axis.mapped_coefficients[list(axis.fitted)] for axis in axes]),
        at=Residuals.of_components(count),
        weights=weight.ravel(),
        used=used.ravel(),
        leave_out=leave_out,
        nuisance=_misalignment(axes, reference),
        names=[f"{NAMES[k]} of accel_{AXES[i]}" for i in range(3) for k in axes[i].fitted],
    )
    every = linearised(found.parameters, np.arange(count))[0].reshape(-1, 3)
    weight = np.where(found.used.reshape(-1, 3), weight, 0.0)
    return tuple(
        _axis_of(found, axis, part, -residual, used)
        for axis, part, residual, used in zip(axes, own, every.T, weight.T, strict=True)
    )


def _misalignment(axes: Sequence[KAxis], reference: Array) -> tuple[Effect, ...]:
    """Misalignment of the axes that have no cross-axis terms: it stays in their residuals, and must
    not be taken for an error of the table.
    """
    axis = np.tile(np.arange(3), len(reference))
    crossless = [i for i, one in enumerate(axes) if 8 not in one.fitted]
    if not crossless:
        return ()
    others = reference[np.repeat(np.arange(len(reference)), 3)[:, None], np.array(CROSS)[axis]]
    labels = np.where(np.isin(axis, crossless), axis, -1)
    return (Effect("sensor", "misalignment", labels, others, LARGEST_MISALIGNMENT),)


def _axis_of(found: Refined, axis: KAxis, own: slice, residuals: Array, weight: Array) -> KAxis:
    """Fit of one axis from that of the three: its parameters, residuals [n] and weights [n], 0 for
    an outlier.
    """
    mixed, size = found.shared.found, len(axis.fitted)
    left_out = np.flatnonzero(weight == 0.0)
    worst_first = left_out[np.argsort(-np.abs(residuals[left_out]), kind="stable")]
    dof = len(residuals) - len(left_out) - size
    square = float(np.sum(residuals**2 * weight) / np.sum(weight))
    one = in_degrees(
        LinearFit(
            found.parameters[own],
            mixed.covariance[own, own],
            dof,
            float(np.sqrt(square)),
            mixed.condition,
            residuals,
        ),
        mixed.covariance[own, own],
        None,
        dof,
        axis.fitted,
        (axis.middle, axis.half),
    )
    to_raw = np.zeros((len(NAMES), len(found.parameters)))
    powers = np.eye(len(NAMES))
    powers[:4, :4] = powers[4:8, 4:8] = polynomial.to_raw_powers(axis.middle, axis.half, 3)
    to_raw[:, own] = powers[:, axis.fitted]
    return replace(
        one,
        effective_dof=mixed.effective_dof_of(to_raw),
        suspects=tuple(worst_first.tolist()),
        left_out=tuple(worst_first.tolist()),
        common_errors=axis.common_errors,
        mixed=mixed,
        lack_of_fit=found.lack_of_fit,
        flags=found.flags,
    )
