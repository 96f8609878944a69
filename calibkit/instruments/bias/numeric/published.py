"""The published drift scheme of a FOG, step by step (CN102095419A, Shen & Chen 2010; docs/methods).

1. ω is denoised by a lifting wavelet (`numeric.wavelet.denoise`) and averaged over the model
   interval Δt (`ramps.prepare`): `DriftBlocks`.
2. Over each ramp, with the gradient G = T_case − T_env: `DriftBlocks.fit_line`, as it stands
   (estimate = "increments") or, by default, summed over k.

       ω_k − ω_{k−1} = a0 + a1 G_{k−1} + a2 G²_{k−1}

3. Over all ramps, with the temperature rate r of the chamber air: `fit_over_rates`.

       a_j(r) = Σ_m c_jm r^m

4. Compensation, with r and G of the interval before: `increments`.

       Δ̂_k = a0(r) + a1(r) G_{k−1} + a2(r) G²_{k−1}
       output ω_k − D̂_k,  D̂_k = D̂_{k−1} + Δ̂_k       `recursive`, ours
       output ω_k − (ω_{k−1} + Δ̂_k)                 `one_step`, as published: no true rate is left

The order M of step 3 is the recipe's, or chosen on left-out rates (`drift_choice`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.dispersion import rms
from calibkit.numeric.intervals import Intervals
from calibkit.numeric.least_squares import fit
from calibkit.numeric.thermal import pooled_fit

TERMS = ("a0", "a1", "a2")
FEWEST_INTERVALS = 7
"""Intervals of a ramp below which three coefficients and a start leave too little to judge by."""


# Step 1: block means of the denoised indication


class DriftBlocks(NamedTuple):
    """Block means [n] at the model interval: time [s], case temperature [°C], gradient T_case −
    T_env [K], indication [°/h], rate of the chamber air [°C/min].
    """

    time: Array
    case: Array
    gradient: Array
    indication: Array
    rate: Array

    def between(self, start: int, stop: int) -> "DriftBlocks":
        """Intervals start … stop − 1."""
        return DriftBlocks(*(values[start:stop] for values in self))

    @classmethod
    def fill(cls, model_intervals: Intervals, means: Iterable[Array], slope: Array) -> Self:
        """Block means of a log from the interval means [m] of time, case, chamber and indication;
        the rate of a block is the causal slope [n, °C/min] at its last sample.

        Intervals with less than half of their samples, whose means are noisier, are interpolated
        linearly between their neighbours.
        """
        time, *other_means = means
        case, env, indication, rate = map(
            model_intervals.filled, (*other_means, model_intervals.last(slope))
        )
        return cls(model_intervals.centres(time), case, case - env, indication, rate)

    # Step 2: a0, a1, a2 of a ramp

    def fit_line(self, *, estimate: str = "levels") -> tuple[fit.LinearFit, Array]:
        """Least squares for a0, a1, a2 of one ramp, the last three coefficients, and its design.

        estimate = "increments" regresses ω_k − ω_{k−1} on G_{k−1} as published. "levels" regresses
        the same equation summed from the ramp's start, ω_k = ω_0 + Σ (a0 + a1 G + a2 G²): white
        noise on ω correlates neighbouring increments at −1/2 but leaves levels uncorrelated, so
        that levels give the same coefficients with a fraction of the uncertainty. Raises FitError
        when the ramp is too short or its gradient does not vary.
        """
        if self.time.size < FEWEST_INTERVALS:
            raise FitError(
                f"the ramp has {self.time.size} intervals, expected at least {FEWEST_INTERVALS}",
                hint="shorten drift.interval_s",
            )
        if estimate == "levels":
            design, target, names = self._levels(), self.indication, ["start", *TERMS]
        else:
            design = np.vander(self.gradient[:-1], 3, increasing=True)
            target, names = np.diff(self.indication), [*TERMS]
        return fit.linear(design, target, names=names), design

    def _levels(self) -> Array:
        """Design [n, 4] of the start of a ramp and its increments, summed."""
        # ω_k = ω_0 + Σ (a0 + a1 G + a2 G²): the published equation, summed
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
        line, design = self.fit_line(estimate=estimate)
        P = np.asarray(np.linalg.pinv(design)[-3:], dtype=np.float64)
        if estimate == "increments":
            # of increments to of levels: each level is in two differences
            P = -np.diff(P, axis=1, prepend=0.0, append=0.0)
        gradient = self.gradient[:-1]
        return RampFit(
            line.coefficients[-3:],
            pooled_fit.covariance_of(P, self._levels(), self.indication if raw is None else raw),
            np.asarray(np.linalg.qr(design)[1][-3:, -3:] / np.sqrt(design.shape[0])),
            line.dof,
            line.residual_rms,
            rate,
            (float(gradient.min()), float(gradient.max())),
            (float(self.case.min()), float(self.case.max())),
        )


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


# Step 3: a_j over the temperature rate


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
        powers = np.vander(np.clip(rate, *self.rates), self.order + 1, increasing=True)
        return np.asarray(powers @ self.c.T, dtype=np.float64)


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
    # P_i [3 (M + 1), 3] of each ramp: c = Σ_i P_i a_i, for rates in units of the largest
    # in units of the largest rate: a fifth power of 10 °C/min against 1 loses digits
    scale = float(np.max(np.abs(rates)))
    basis = np.vander(rates / scale, order + 1, increasing=True)
    if len(ramps) == order + 1:  # interpolation: weights cancel, and would only lose precision
        inverse = np.linalg.inv(basis)
        P = np.hsplit(np.concatenate([np.kron(inverse, row) for row in np.eye(3)]), len(ramps))
    else:
        weighted = [
            ramp.information @ np.kron(np.eye(3), row)
            for ramp, row in zip(ramps, basis, strict=True)
        ]
        parts = np.hsplit(np.linalg.pinv(np.concatenate(weighted), rcond=1e-12), len(ramps))
        P = [part @ ramp.information for part, ramp in zip(parts, ramps, strict=True)]
    a = np.stack([ramp.coefficients for ramp in ramps])
    powers = np.tile(scale ** np.arange(order + 1), 3)
    c = (np.hstack(P) @ a.ravel() / powers).reshape(3, order + 1)
    covariance = sum(
        part @ ramp.covariance @ part.T for part, ramp in zip(P, ramps, strict=True)
    ) / np.outer(powers, powers)
    deviations = a - np.vander(rates, order + 1, increasing=True) @ c.T
    dof = deviations.size - c.size
    if dof > 0:
        try:
            # ramps that scatter more than they are uncertain by show an error that no ramp shows
            # alone
            chi_square = sum(
                deviation @ np.linalg.solve(ramp.covariance, deviation)
                for deviation, ramp in zip(deviations, ramps, strict=True)
            )
            covariance = covariance * max(1.0, float(chi_square) / dof)
        except np.linalg.LinAlgError:  # noise-free data have a singular covariance
            pass
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


# Step 4: compensation


class Increments(NamedTuple):
    """Drift increments Δ̂_k [n, °/h] from interval k − 1 to k, and masks [n] of held and clamped
    intervals.
    """

    delta: Array
    drift_held: Mask
    rate_clamped: Mask
    gradient_clamped: Mask


def increments(polynomials: Sequence[RatePolynomial], gradient: Array, rate: Array) -> Increments:
    """Δ̂_k = a0(r) + a1(r) G + a2(r) G² with r [°C/min] and G [K] taken at k − 1; Δ̂_0 = 0.

    The polynomial of a side (heating or cooling) holds for the rates of that side. The drift is
    held (Δ̂ = 0) on a side that was not fitted, and below half of the smallest fitted rate, where
    a0 would be integrated without bound. Rates and gradients outside the fitted ranges are clamped
    and marked.
    """
    n = gradient.size
    delta, drift_held = np.zeros(n), np.ones(n, dtype=bool)
    rate_clamped, gradient_clamped = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    r, G = rate[:-1], gradient[:-1]
    for polynomial in polynomials:
        low, high = polynomial.rates
        # a0 of a chamber at rest would be summed without bound
        served = np.abs(r) >= polynomial.slowest / 2.0
        if low > 0.0 or high < 0.0:
            served &= (r > 0.0) == (low > 0.0)
        before = np.flatnonzero(served)
        clamped = np.clip(G[before], *polynomial.gradient)
        a = polynomial.evaluate(r[before])
        delta[before + 1] = a[:, 0] + a[:, 1] * clamped + a[:, 2] * clamped**2
        drift_held[before + 1] = False
        # the measured rate varies by some percent along a ramp
        slack = 0.1 * max(abs(low), abs(high))
        rate_clamped[before + 1] = (r[before] < low - slack) | (r[before] > high + slack)
        gradient_clamped[before + 1] = clamped != G[before]
    return Increments(delta, drift_held, rate_clamped, gradient_clamped)


def recursive(delta: Array) -> Array:
    """Drift D̂_k = D̂_{k−1} + Δ̂_k [n, °/h] from D̂_0 = 0; the output ω_k − D̂_k keeps the true
    rate.
    """
    return np.cumsum(delta)


def one_step(indication: Array, delta: Array) -> Array:
    """Output ω_k − (ω_{k−1} + Δ̂_k) [n, °/h] as published: a first difference, which loses the
    true rate.

    The first output, which has no interval before it, is 0.
    """
    output = np.zeros_like(indication)
    output[1:] = indication[1:] - (indication[:-1] + delta[1:])
    return output


def referenced(
    level: Array, temperature: Array, reference: float, valid: tuple[float, float]
) -> Array:
    """Drift [n, °/h] shifted to zero at the instant whose temperature [n, °C] is closest to the
    reference [°C], which is clamped to `valid`.
    """
    target = min(max(reference, valid[0]), valid[1])
    return np.asarray(level - level[int(np.argmin(np.abs(temperature - target)))], dtype=np.float64)
