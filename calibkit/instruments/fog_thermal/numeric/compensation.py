"""Compensation of thermal drift in a gyro's indication, and its gain for a true rate."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.fog_thermal.numeric import gradient as drift
from calibkit.numeric import chunks
from calibkit.numeric.dispersion import rms

INJECTED_RATE_DPH = 7.5
"""Constant rate that the rate-gain check adds to the indication [°/h]."""
WORSE = 1.01
"""Ratio of compensated to raw drift rms above which a ramp became worse: the drift rms of a log
repeats to about a percent.
"""


@dataclass(frozen=True, slots=True)
class LeftOutRamps:
    """Drift rms [ramps, °/h] of ramps that were left out of the fit, raw and compensated."""

    raw: Array
    compensated: Array
    errors: tuple[Array, ...]
    """Compensated means of each ramp [°/h]."""

    @property
    def split(self) -> "NoiseSplit":
        """Noise and drift in the pooled figure after compensation."""
        return split_noise(self.errors)

    @property
    def pooled_raw(self) -> float:
        """Root mean square of the raw figures [°/h]."""
        return rms(self.raw)

    @property
    def pooled(self) -> float:
        """Root mean square of the compensated figures [°/h]."""
        return rms(self.compensated)


@dataclass(frozen=True, slots=True)
class _Increments:
    """Drift increments Δ̂_k [n, °/h] from interval k − 1 to k, and masks [n] of held and clamped
    intervals.
    """

    delta: Array
    held: Mask
    rate_clamped: Mask
    gradient_clamped: Mask


def increments(
    polynomials: Sequence[drift.RatePolynomial], gradient: Array, rate: Array
) -> _Increments:
    """Δ̂_k = a0(r) + a1(r) G + a2(r) G² with r [°C/min] and G [K] taken at k − 1 (CN102095419A step
    4); Δ̂_0 = 0.

    The polynomial of a side (heating or cooling) holds for the rates of that side. The drift is
    held (Δ̂ = 0) on a side that was not fitted, and below half of the smallest fitted rate, where
    a0 would be integrated without bound. Rates and gradients outside the fitted ranges are clamped
    and marked.
    """
    n = gradient.size
    delta, held = np.zeros(n), np.ones(n, dtype=bool)
    rate_clamped, gradient_clamped = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    r, G = rate[:-1], gradient[:-1]
    for polynomial in polynomials:
        served = np.flatnonzero(_served(polynomial, r))
        clamped = np.clip(G[served], *polynomial.gradient)
        a = polynomial.evaluate(r[served])
        delta[served + 1] = a[:, 0] + a[:, 1] * clamped + a[:, 2] * clamped**2
        held[served + 1] = False
        low, high = polynomial.rates
        # the measured rate varies by some percent along a ramp
        slack = 0.1 * max(abs(low), abs(high))
        rate_clamped[served + 1] = (r[served] < low - slack) | (r[served] > high + slack)
        gradient_clamped[served + 1] = clamped != G[served]
    return _Increments(delta, held, rate_clamped, gradient_clamped)


def _served(polynomial: drift.RatePolynomial, rate: Array) -> Mask:
    """Mask [n] of rates [n, °C/min] that are on the polynomial's side and not so slow that the
    chamber is at rest.
    """
    low, high = polynomial.rates
    moving = np.abs(rate) >= polynomial.slowest / 2.0
    return np.asarray(moving & (rate > 0.0 if low > 0.0 else rate < 0.0 if high < 0.0 else True))


def recursive(delta: Array) -> Array:
    """Drift D̂_k = D̂_{k−1} + Δ̂_k [n, °/h] from D̂_0 = 0; the output ω_k − D̂_k keeps the true
    rate.
    """
    return np.cumsum(delta)


def one_step(indication: Array, delta: Array) -> Array:
    """Output ω_k − (ω_{k−1} + Δ̂_k) [n, °/h] as published (CN102095419A step 4): a first
    difference, which loses the true rate.

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


def rate_gain(compensate: Callable[[Array], Array], indication: Array) -> float:
    """Ratio of the change of the compensated output to a constant rate that is added to the
    indication [n, °/h].
    """
    moved = compensate(indication + INJECTED_RATE_DPH) - compensate(indication)
    return float(np.mean(moved[1:]) / INJECTED_RATE_DPH)


@dataclass(frozen=True, slots=True)
class NoiseSplit:
    """Drift figure [°/h] of noise alone, of the drift that is left without it, and the standard
    uncertainty of the latter, the larger of both sides.
    """

    noise: float
    left: float
    left_uncertainty: float

    def at_most(self, noise: float) -> "NoiseSplit":
        """The same figure with no more noise than another model leaves of the same logs: products
        of neighbouring means miss what is fast in a large drift.
        """
        less = min(noise, self.noise)
        return replace(
            self, noise=less, left=float(np.hypot(self.left, np.sqrt(self.noise**2 - less**2)))
        )


def split_noise(parts: Sequence[Array]) -> NoiseSplit:
    """Noise and drift in the drift figure of logs or ramps, each given by its means [n, °/h] and
    taken about their mean; the squares of both add up to that of the figure.

    White noise cancels in products of neighbouring means; a drift does not (their lags are 1 to 3).
    Flicker noise counts as drift: a log cannot tell the two apart.
    """
    found = np.array([_moments(part - part.mean()) for part in parts])
    square, total = found[:, 0].mean(), found[:, 1].mean()
    left = min(max(square, 0.0), total)
    # by products of noise with noise, and of noise with drift
    with_noise = found[:, 1] ** 2 / found[:, 2]
    with_drift = 4.0 * left * (total - left) / found[:, 3]
    spread = np.sqrt(np.sum(with_noise + with_drift)) / len(found)
    low, middle, high = np.sqrt([max(left - spread, 0.0), left, left + spread]).tolist()
    return NoiseSplit(float(np.sqrt(total - left)), middle, max(high - middle, middle - low))


def _moments(away: Array) -> tuple[float, float, float, float]:
    """Mean product of neighbouring deviations from a mean [n], mean square, and how many there are
    of both.
    """
    count, total = away.size, float(np.mean(away**2))
    lags = range(1, min(3, count - 1) + 1)
    products = sum(float(away[lag:] @ away[:-lag]) for lag in lags)
    pairs = sum(count - lag for lag in lags)
    # the mean of the log is removed from both, and with it a share of the noise
    square = products / pairs + total / count if pairs else 0.0
    return square, total, float(max(pairs, 1)), float(count)


def figure_means(output: Array, group: int) -> Array:
    """Means of an output [n, °/h] over whole groups of intervals; with fewer than two groups the
    output itself.
    """
    return chunks.block_means(output, group) if output.size >= 2 * group else output


def drift_rms(output: Array, group: int = 1) -> float:
    """Standard deviation [°/h] of the means of an output [n, °/h] over groups of intervals.

    With groups of 100 s this is the bias stability of GJB 2426A over the log; averaging suppresses
    the angle random walk. An incomplete last group is left out; with fewer than two groups nothing
    is averaged.
    """
    return float(np.std(figure_means(output, group)))
