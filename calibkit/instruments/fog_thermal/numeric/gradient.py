"""Thermal drift of a FOG as a function of the temperature gradient, with coefficients that are
polynomials of the temperature rate.

Source: CN102095419A (Shen & Chen, 2010). Per ramp, with G = T_case − T_env at the model interval
Δt,

    ω_k − ω_{k−1} = a0 + a1 G_{k−1} + a2 G²_{k−1},        a_j(r) = Σ_m c_jm r^m.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.dispersion import rms
from calibkit.numeric.intervals import Intervals
from calibkit.numeric.least_squares import fit
from calibkit.numeric.thermal import noise

TERMS = ("a0", "a1", "a2")


class Blocks(NamedTuple):
    """Block means [n] at the model interval: time [s], case temperature [°C], gradient T_case −
    T_env [K], indication [°/h], rate of the chamber air [°C/min].
    """

    time: Array
    case: Array
    gradient: Array
    indication: Array
    rate: Array

    def between(self, start: int, stop: int) -> "Blocks":
        """Intervals start … stop − 1."""
        return Blocks(*(values[start:stop] for values in self))

    def fit_line(self, *, estimate: str = "levels") -> tuple[fit.LinearFit, Array]:
        """Least squares for a0, a1, a2 of one ramp, the last three coefficients, and its design.

        estimate = "increments" regresses ω_k − ω_{k−1} on G_{k−1} as published. "levels" regresses
        the same equation summed from the ramp's start, ω_k = ω_0 + Σ (a0 + a1 G + a2 G²): white
        noise on ω correlates neighbouring increments at −1/2 but leaves levels uncorrelated, so
        that levels give the same coefficients with a fraction of the uncertainty. Raises FitError
        when the ramp is too short or its gradient does not vary.
        """
        G = self.gradient[:-1]
        if G.size < 6:
            raise FitError(
                f"the ramp has {G.size + 1} intervals, expected at least 7",
                hint="shorten drift.interval_s",
            )
        design, target, names = np.vander(G, 3, increasing=True), np.diff(self.indication), [*TERMS]
        if estimate == "levels":
            design, target, names = self._levels(), self.indication, ["start", *TERMS]
        return fit.linear(design, target, names=names), design

    def _levels(self) -> Array:
        """Design [n, 4] of the start of a ramp and its increments, summed."""
        summed = np.cumsum(np.vander(self.gradient[:-1], 3, increasing=True), axis=0)
        return np.column_stack([np.ones(self.time.size), np.vstack([np.zeros(3), summed])])

    def fit_ramp(
        self, rate: float, *, estimate: str = "levels", raw: Array | None = None
    ) -> "RampFit":
        """Fit of one ramp at a rate [°C/min]; FitError as `fit_line`.

        Its covariance is that of white and flicker noise of the indication: with the matrix P by
        which the fit makes coefficients of it, σ² P Pᵀ + B² P K Pᵀ. The noise is measured in the
        `raw` indication [n] where this one is denoised: what denoising leaves of noise is smoother
        than either.
        """
        found, design = self.fit_line(estimate=estimate)
        G = self.gradient[:-1]
        P = np.asarray(np.linalg.pinv(design)[-3:], dtype=np.float64)
        if estimate == "increments":
            P = -np.diff(P, axis=1, prepend=0.0, append=0.0)
        return RampFit(
            found.coefficients[-3:],
            noise.covariance_of(P, self._levels(), self.indication if raw is None else raw),
            np.asarray(np.linalg.qr(design)[1][-3:, -3:] / np.sqrt(design.shape[0])),
            found.dof,
            found.residual_rms,
            rate,
            (float(G.min()), float(G.max())),
            (float(self.case.min()), float(self.case.max())),
        )

    @classmethod
    def fill(cls, held: Intervals, means: Iterable[Array], slope: Array) -> Self:
        """Block means of a log from the interval means [m] of time, case, chamber and indication;
        the rate of a block is the causal slope [n, °C/min] at its last sample.

        Intervals with less than half of their samples, whose means are noisier, are interpolated
        linearly between their neighbours.
        """
        time, *others = means
        case, env, indication, rate = map(held.filled, (*others, held.last(slope)))
        return cls(held.centres(time), case, case - env, indication, rate)


@dataclass(frozen=True, slots=True)
class RampFit:
    """a0 [°/h], a1 [°/h/K], a2 [°/h/K²] of one ramp, per interval, with a covariance that allows
    for autocorrelated residuals.

    `information` [3, 3] is the triangular factor R of the ramp's design (QR), per interval and with
    the start eliminated: it weights the combinations of the a_j that the ramp determines.
    """

    coefficients: Array
    covariance: Array
    information: Array
    dof: int
    residual_rms: float
    rate: float
    gradient: tuple[float, float]
    case: tuple[float, float]

    @property
    def standard_uncertainty(self) -> Array:
        """Type A standard uncertainties [3] of the coefficients."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True)
class RatePolynomial:
    """Polynomials a_j(r) = Σ_m c_jm r^m of one side: c [3, M + 1], r in °C/min, with the fitted
    ranges of rate and gradient.

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

    def evaluate(self, rate: Array) -> Array:
        """a_j(r) [n, 3] at temperature rates [n, °C/min], which are clamped to the fitted range."""
        return np.asarray(
            np.vander(np.clip(rate, *self.rates), self.order + 1, increasing=True) @ self.c.T,
            dtype=np.float64,
        )


def fit_over_rates(ramps: Sequence[RampFit], order: int, side: str) -> RatePolynomial:
    """Fit a_j(r) = Σ_m c_jm r^m to the a_j of all ramps; raises FitError if there are fewer
    distinct rates than coefficients.

    The estimates a0, a1 and a2 of a ramp are strongly correlated; therefore the three polynomials
    are fitted together, with the deviations of each ramp weighted by its information matrix, and
    each ramp counts once whatever its duration. With as many coefficients as rates this is the
    published interpolation, and dof is 0. The covariance is propagated from those of the ramps and
    scaled up, never down, if the deviations exceed it; residual_rms is that of a0 [°/h].
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
    propagated = sum(
        part @ ramp.covariance @ part.T
        for part, ramp in zip(np.hsplit(solver, len(ramps)), ramps, strict=True)
    )
    return RatePolynomial(
        side,
        c,
        propagated * _inflation(deviations, ramps, 3 * (order + 1)) / np.outer(powers, powers),
        len(ramps) - order - 1,
        rms(deviations[:, 0]),
        (float(rates.min()), float(rates.max())),
        float(np.min(np.abs(rates))),
        (min(ramp.gradient[0] for ramp in ramps), max(ramp.gradient[1] for ramp in ramps)),
        (min(ramp.case[0] for ramp in ramps), max(ramp.case[1] for ramp in ramps)),
    )


def _solver(basis: Array, ramps: Sequence[RampFit]) -> Array:
    """Matrix [3(M+1), 3·ramps] from the a_j of all ramps (ramp by ramp) to the scaled coefficients
    c00 … c2M.
    """
    if basis.shape[0] == basis.shape[1]:
        # interpolation: weights cancel, and would only lose precision
        inverse = np.linalg.inv(basis)
        return np.concatenate([np.kron(inverse, np.eye(3)[j]) for j in range(3)])
    weighted = np.concatenate(
        [ramp.information @ np.kron(np.eye(3), row) for ramp, row in zip(ramps, basis, strict=True)]
    )
    parts = np.hsplit(np.linalg.pinv(weighted, rcond=1e-12), len(ramps))
    return np.hstack([part @ ramp.information for part, ramp in zip(parts, ramps, strict=True)])


def _inflation(deviations: Array, ramps: Sequence[RampFit], fitted: int) -> float:
    """Variance factor, at least 1: reduced chi-square of the deviations [ramps, 3] of the a_j by
    their covariances.
    """
    dof = deviations.size - fitted
    if dof <= 0:
        return 1.0
    try:
        chi_square = sum(
            d @ np.linalg.solve(ramp.covariance, d)
            for d, ramp in zip(deviations, ramps, strict=True)
        )
    except np.linalg.LinAlgError:  # noise-free data have a singular covariance
        return 1.0
    return max(1.0, float(chi_square) / dof)
