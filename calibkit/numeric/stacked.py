"""The same small linear fit of many units at once: their moments and their solutions in stacks,
instead of a loop.

A loop over a thousand units of some hundred rows spends its time on calls, not on numbers. Here
units go in groups that stay in the cache through one product each for their moments, about a first
solution, and through stacked solutions. A unit whose rows normal equations would not serve is
fitted alone, as `fit.linear` does, and one that cannot be fitted is named with the reason while the
others are.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit as least_squares
from calibkit.numeric.least_squares import gram

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from calibkit.arrays import Array, Integers, Mask


GROUP_VALUES = 1 << 17
"""Numbers in the designs of the units that are worked on at once: a mebibyte, which stays in a
second-level cache.
"""


@dataclass(frozen=True, slots=True)
class Stack:
    """Fits of u units; what belongs to a unit that could not be fitted is NaN."""

    coefficients: Array
    """[u, p]."""
    covariance: Array
    """[u, p, p], type A; zeros where there are no degrees of freedom."""
    dof: Integers
    """[u]."""
    residual_rms: Array
    """[u], root of the weighted mean square [unit of the indication], as in `fit.LinearFit`."""
    condition: Array
    """[u], of the columns scaled to unit length."""
    faults: tuple[tuple[int, str], ...]
    """Units that could not be fitted, by index, each with the reason."""


def linear(
    design: Array, indication: Array, *, weights: Array | None = None, names: Sequence[str] = ()
) -> Stack:
    """Fit indication = design · coefficients of every unit.

    Parameters
    ----------
    design
        [u, n, p], one column a coefficient.
    indication
        [u, n].
    weights
        [u, n], proportional to 1/variance of each row; 0 for a row that a unit does not have; equal
        when absent.
    names
        [p], what a reason calls the coefficients that a unit's rows cannot determine.

    Raises
    ------
    FitError
        For arrays whose shapes do not belong together. A unit that cannot be fitted is in `faults`
        instead.

    """
    if (
        design.ndim != 3
        or design.shape[:2] != indication.shape
        or (weights is not None and weights.shape != indication.shape)
    ):
        raise FitError(
            f"designs of shape {design.shape} do not belong to indications of shape"
            f" {indication.shape}"
        )
    return _fitted(
        lambda units: design[units].transpose(0, 2, 1), design.shape[2], indication, weights, names
    )


def polynomial(
    abscissa: Array, indication: Array, order: int, *, weights: Array | None = None
) -> tuple[Stack, Array, Array]:
    """Fit a polynomial to every unit, each on its own abscissa mapped to [−1, 1], and report it in
    raw powers too.

    Parameters
    ----------
    abscissa
        [u, n], or [n] where all units share it.
    indication
        [u, n].
    order
        Highest power.
    weights
        [u, n], as for `linear`.

    Returns
    -------
    The fits in mapped powers, the raw coefficients [u, order + 1] (ascending powers of the abscissa
    in its own unit) and their covariance [u, order + 1, order + 1].

    Raises
    ------
    FitError
        As `linear`.

    """
    if abscissa.shape not in (indication.shape, indication.shape[1:]):
        raise FitError(
            f"abscissas of shape {abscissa.shape} do not belong to indications of shape"
            f" {indication.shape}"
        )
    abscissa = np.broadcast_to(abscissa, indication.shape)
    low, high = abscissa.min(axis=1), abscissa.max(axis=1)
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    half = np.where(half > 0.0, half, 1.0)

    def rows(units: slice) -> Array:
        basis = np.empty((len(abscissa[units]), order + 1, abscissa.shape[1]))
        basis[:, 0] = 1.0
        if order > 0:
            basis[:, 1] = (abscissa[units] - middle[units, None]) / half[units, None]
        for k in range(2, order + 1):
            np.multiply(basis[:, k - 1], basis[:, 1], out=basis[:, k])
        return basis

    found = _fitted(rows, order + 1, indication, weights, [f"p{k}" for k in range(order + 1)])
    to_raw = _raw_powers(middle, half, order)
    raw = np.einsum("ujk,uk->uj", to_raw, found.coefficients.astype(np.longdouble))
    matrix = np.asarray(to_raw, dtype=np.float64)
    return (
        found,
        np.asarray(raw, dtype=np.float64),
        matrix @ found.covariance @ matrix.transpose(0, 2, 1),
    )


def _raw_powers(middle: Array, half: Array, order: int) -> NDArray[np.longdouble]:
    """Matrices [u, p, p] of `fit.raw_powers`, by the binomial theorem."""
    one = 1.0 / half.astype(np.longdouble)
    shift = -middle.astype(np.longdouble) * one
    matrix = np.zeros((middle.size, order + 1, order + 1), dtype=np.longdouble)
    for k in range(order + 1):
        for i in range(k + 1):
            matrix[:, i, k] = comb(k, i) * shift ** (k - i) * one**i
    return matrix


def _fitted(
    rows: Callable[[slice], Array],
    count: int,
    indication: Array,
    weights: Array | None,
    names: Sequence[str],
) -> Stack:
    """Fit groups of units that stay in the cache; `rows` gives the columns of a group's units as
    rows [m, p, n].
    """
    units, n = indication.shape
    stack = Stack(
        np.full((units, count), np.nan),
        np.full((units, count, count), np.nan),
        (
            np.full(units, n - count)
            if weights is None
            else np.count_nonzero(weights > 0.0, axis=1) - count
        ),
        np.full(units, np.nan),
        np.full(units, np.nan),
        (),
    )
    faults: list[tuple[int, str]] = []
    for part in gram.blocks(units, max(GROUP_VALUES // max(count * n, 1), 1)):
        basis = rows(part)
        weight = None if weights is None else weights[part]
        sound = (
            _solve(basis, indication[part], weight, stack, part)
            if n > count
            else np.zeros(len(basis), np.bool_)
        )
        for k in np.flatnonzero(~sound):
            reason = _alone(
                basis[k].T,
                indication[part][k],
                None if weight is None else weight[k],
                names,
                stack,
                part.start + int(k),
            )
            if reason:
                faults.append((part.start + int(k), reason))
    return Stack(
        stack.coefficients,
        stack.covariance,
        stack.dof,
        stack.residual_rms,
        stack.condition,
        tuple(faults),
    )


def _solve(basis: Array, target: Array, weight: Array | None, stack: Stack, part: slice) -> Mask:
    """Put the fits of a group into the stack; which of its units [m] normal equations serve, as in
    `gram.solve`.
    """
    weighted = basis if weight is None else basis * weight[:, None, :]
    # one column less, which the symmetry gives, see gram
    moments = np.empty((len(basis), basis.shape[1], basis.shape[1]))
    moments[:, :, :-1] = weighted @ basis[:, :-1].transpose(0, 2, 1)
    moments[:, :-1, -1] = moments[:, -1, :-1]
    moments[:, -1, -1] = np.einsum("mn,mn->m", weighted[:, -1], basis[:, -1])
    scale = np.sqrt(np.diagonal(moments, axis1=1, axis2=2))
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = moments / scale[:, :, None] / scale[:, None, :]
    sound = (
        np.isfinite(scaled).all(axis=(1, 2))
        & np.isfinite(target).all(axis=1)
        & (stack.dof[part] > 0)
    )
    scaled[~sound] = np.eye(basis.shape[1])
    values, vectors = np.linalg.eigh(scaled)
    sound &= values[:, 0] * gram.WORST_CONDITION**2 > values[:, -1]
    values = np.where(sound[:, None], values, 1.0)
    length = np.where(sound[:, None], scale, 1.0)
    inverse = (
        (vectors / values[:, None, :])
        @ vectors.transpose(0, 2, 1)
        / length[:, :, None]
        / length[:, None, :]
    )
    found, residual = np.zeros(scale.shape), target
    for _ in range(2):
        gradient = (weighted @ residual[:, :, None])[:, :, 0]
        step = (inverse @ gradient[:, :, None])[:, :, 0]
        found = found + step
        residual = target - (found[:, None, :] @ basis)[:, 0]
    square = np.einsum("mn,mn->m", residual, residual if weight is None else residual * weight)
    total = np.full(len(basis), float(basis.shape[2])) if weight is None else weight.sum(axis=1)
    variance = square / np.maximum(stack.dof[part], 1)
    at = np.arange(len(stack.dof))[part][sound]
    stack.coefficients[at], stack.covariance[at] = (
        found[sound],
        (inverse * variance[:, None, None])[sound],
    )
    stack.residual_rms[at] = np.sqrt(square / total)[sound]
    stack.condition[at] = np.sqrt(values[:, -1] / values[:, 0])[sound]
    return np.asarray(sound, dtype=np.bool_)


def _alone(
    design: Array, target: Array, weight: Array | None, names: Sequence[str], stack: Stack, at: int
) -> str:
    """Fit one unit by itself and put it into the stack, or give the reason why it cannot be."""
    own = slice(None) if weight is None else weight > 0.0
    try:
        found = least_squares.linear(
            design[own], target[own], weights=None if weight is None else weight[own], names=names
        )
    except FitError as error:
        return str(error)
    stack.coefficients[at], stack.covariance[at] = found.coefficients, found.covariance
    stack.residual_rms[at], stack.condition[at] = found.residual_rms, found.condition
    return ""
