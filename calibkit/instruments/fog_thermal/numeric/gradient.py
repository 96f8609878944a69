"""Thermal drift of a FOG on the temperature gradient, its coefficients as polynomials of
temperature rate.

Source: CN102095419A (Shen & Chen, 2010). Per ramp, with G = T_case − T_env at the model interval
Δt,

    ω_k − ω_{k−1} = a0 + a1 G_{k−1} + a2 G²_{k−1},        a_j(r) = Σ_m c_jm r^m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import intervals
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import fit, hac

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.numeric.intervals import Intervals


TERMS = ("a0", "a1", "a2")


@dataclass(frozen=True, slots=True)
class Blocks:
    """Block means at the model interval: time [s], case and chamber temperature [°C], indication
    [°/h], rate [°C/min].
    """

    time: Array
    case: Array
    gradient: Array
    indication: Array
    rate: Array

    def between(self, start: int, stop: int) -> Blocks:
        """Intervals start … stop − 1."""
        part = slice(start, stop)
        return Blocks(
            self.time[part],
            self.case[part],
            self.gradient[part],
            self.indication[part],
            self.rate[part],
        )


@dataclass(frozen=True, slots=True)
class RampFit:
    """a0 [°/h], a1 [°/h/K], a2 [°/h/K²] per interval of one ramp, with a covariance that survives
    autocorrelation.

    `information` [3, 3] is the triangular factor of the ramp's regression, per interval and with
    the start eliminated: it knows which combinations of the a_j the ramp determines.
    """

    coefficients: Array
    covariance: Array
    information: Array
    dof: int
    residual_rms: float
    rate: float
    gradient: tuple[float, float]
    case: tuple[float, float]


@dataclass(frozen=True, slots=True)
class RatePolynomial:
    """a_j(r) of one side: c [3, M + 1] for powers of r [°C/min], valid for rates and gradients in
    the given ranges.

    `slowest` is the smallest fitted |r|: below half of it the chamber counts as at rest.
    """

    side: str
    c: Array
    covariance: Array
    dof: int
    residual_rms: float
    rates: tuple[float, float]
    slowest: float
    gradient: tuple[float, float]
    case: tuple[float, float]

    @property
    def order(self) -> int:
        """Order M of the polynomials."""
        return int(self.c.shape[1]) - 1


def block_index(time: Array, interval_s: float) -> Integers:
    """Number of the model interval that each sample [n] falls in; raises FitError as
    `intervals.of`.
    """
    held = intervals.of(time, interval_s)
    return np.repeat(held.number, held.count)


def blocks(
    time: Array, case: Array, env: Array, indication: Array, slope: Array, interval_s: float
) -> Blocks:
    """Block means of a log [n] at the model interval, as `blocks_of`; raises FitError as
    `intervals.of`.
    """
    held = intervals.of(time, interval_s)
    middle, t_case, t_env, mean = (held.means(values) for values in (time, case, env, indication))
    return blocks_of(held, middle, t_case, t_env, mean, slope)


def blocks_of(
    held: Intervals, time: Array, case: Array, env: Array, indication: Array, slope: Array
) -> Blocks:
    """Block means of a log from those [m] of its model intervals; the rate is the causal slope [n]
    at each block's last sample.

    Intervals with less than half of their samples, whose means would be noisier than the others,
    are filled by straight lines between their neighbours.
    """
    t_case, t_env, rate = (held.filled(values) for values in (case, env, held.last(slope)))
    return Blocks(held.centres(time), t_case, t_case - t_env, held.filled(indication), rate)


def ramp(ramp_blocks: Blocks, rate: float, *, estimate: str = "levels") -> RampFit:
    """Fit a0, a1, a2 of one ramp.

    estimate = "increments" regresses ω_k − ω_{k−1} on G_{k−1} as published. "levels" regresses the
    same equation summed from the ramp's start, ω_k = ω_0 + Σ (a0 + a1 G + a2 G²): white noise on ω
    makes the increments' errors correlated at −1/2, and on levels it is white again, so the same
    coefficients come out with a fraction of the uncertainty. Raises FitError when the ramp is too
    short or its gradient does not vary.
    """
    G = ramp_blocks.gradient[:-1]
    if G.size < 6:
        raise FitError(
            f"the ramp has {G.size + 1} intervals, expected at least 7",
            hint="shorten drift.interval_s",
        )
    terms = np.vander(G, 3, increasing=True)
    if estimate == "levels":
        design = np.column_stack(
            [np.ones(G.size + 1), np.vstack([np.zeros(3), np.cumsum(terms, axis=0)])]
        )
        found = fit.linear(design, ramp_blocks.indication, names=("start", *TERMS))
        keep = slice(1, 4)
    else:
        design = terms
        found = fit.linear(design, np.diff(ramp_blocks.indication), names=TERMS)
        keep = slice(0, 3)
    covariance = hac.covariance(lambda part: design[part], found.residuals)
    return RampFit(
        found.coefficients[keep],
        covariance[keep, keep],
        _information(design),
        found.dof,
        found.residual_rms,
        rate,
        (float(G.min()), float(G.max())),
        (float(ramp_blocks.case.min()), float(ramp_blocks.case.max())),
    )


def _information(design: Array) -> Array:
    """Triangular factor [3, 3] of the last three columns of a design [n, p], the others eliminated,
    for one row.
    """
    factor = np.linalg.qr(design)[1]
    return np.asarray(factor[-3:, -3:] / np.sqrt(design.shape[0]), dtype=np.float64)


def over_rates(ramps: Sequence[RampFit], order: int, side: str) -> RatePolynomial:
    """Fit a_j(r) = Σ_m c_jm r^m to the ramps' a_j; raises FitError for fewer distinct rates than
    coefficients.

    Within one ramp a0, a1 and a2 are known far better together than one by one, so the three
    polynomials are fitted together and each ramp's deviations are weighted by its own regression;
    each ramp counts once however long it took. Where the order uses up the rates this is the
    published interpolation, and dof is zero. The covariance is propagated from the ramps' own and
    scaled up, never down, where the deviations exceed it; residual_rms is that of a0 [°/h].
    """
    rates = np.array([ramp.rate for ramp in ramps])
    if order > 0 and np.unique(rates).size <= order:
        raise FitError(
            f"{side}: order {order} needs {order + 1} temperature rates, found"
            f" {np.unique(rates).size}",
            hint="lower drift.order or measure more rates",
        )
    scale = float(np.max(np.abs(rates)))
    basis = np.vander(rates / scale, order + 1, increasing=True)
    powers = np.tile(scale ** np.arange(order + 1), 3)
    solver = _solver(basis, ramps)
    a = np.stack([ramp.coefficients for ramp in ramps])
    c = (solver @ a.ravel() / powers).reshape(3, order + 1)
    deviations = a - np.vander(rates, order + 1, increasing=True) @ c.T
    covariance = (
        _propagated(solver, ramps)
        * _inflation(deviations, ramps, 3 * (order + 1))
        / np.outer(powers, powers)
    )
    return RatePolynomial(
        side,
        c,
        covariance,
        len(ramps) - order - 1,
        rms(deviations[:, 0]),
        (float(rates.min()), float(rates.max())),
        float(np.min(np.abs(rates))),
        (min(ramp.gradient[0] for ramp in ramps), max(ramp.gradient[1] for ramp in ramps)),
        (min(ramp.case[0] for ramp in ramps), max(ramp.case[1] for ramp in ramps)),
    )


def _solver(basis: Array, ramps: Sequence[RampFit]) -> Array:
    """Matrix [3(M+1), 3·ramps] that takes the ramps' a_j, ramp by ramp, to the scaled c00 … c2M."""
    if (
        basis.shape[0] == basis.shape[1]
    ):  # interpolation: weights drop out, and would only cost digits
        inverse = np.linalg.inv(basis)
        return np.concatenate([np.kron(inverse, np.eye(3)[j]) for j in range(3)])
    weighted = np.concatenate(
        [ramp.information @ np.kron(np.eye(3), row) for ramp, row in zip(ramps, basis, strict=True)]
    )
    left = np.linalg.pinv(weighted, rcond=1e-12)
    return np.concatenate(
        [left[:, 3 * i : 3 * i + 3] @ ramp.information for i, ramp in enumerate(ramps)], axis=1
    )


def _propagated(solver: Array, ramps: Sequence[RampFit]) -> Array:
    """Covariance of the scaled c00 … c2M from the covariances of the a_j of independent ramps."""
    parts = [solver[:, 3 * i : 3 * i + 3] for i in range(len(ramps))]
    return np.asarray(
        sum(part @ ramp.covariance @ part.T for part, ramp in zip(parts, ramps, strict=True))
    )


def _inflation(deviations: Array, ramps: Sequence[RampFit], fitted: int) -> float:
    """Variance factor of at least 1 by which the a_j [ramps, 3] deviate more than their covariances
    explain.
    """
    dof = deviations.size - fitted
    if dof <= 0:
        return 1.0
    try:
        chi_square = sum(
            d @ np.linalg.solve(ramp.covariance, d)
            for d, ramp in zip(deviations, ramps, strict=True)
        )
    except np.linalg.LinAlgError:  # noise-free data have no covariance to compare with
        return 1.0
    return max(1.0, float(chi_square) / dof)


def evaluate(polynomial: RatePolynomial, rate: Array) -> Array:
    """a_j(r) [n, 3] at temperature rates [n, °C/min], which are clamped to the fitted range."""
    r = np.clip(rate, *polynomial.rates)
    return np.asarray(
        np.vander(r, polynomial.order + 1, increasing=True) @ polynomial.c.T, dtype=np.float64
    )
