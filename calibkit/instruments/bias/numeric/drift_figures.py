"""Figures that say how well a drift model does.

    drift rms       standard deviation of the means of an output over groups of intervals
    noise and left  rms² = noise² + left², left² the mean product of neighbouring means
    rate gain       change of the compensated output over a constant rate added to the indication
    hysteresis      h(T) = mean of the blocks that cool through T − mean of those that heat through
                    it, in bins of 5 °C, each log about its mean, which holds its turn-on bias

Flicker noise counts as drift: a log cannot tell the two apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.instruments.bias.numeric import bank
from calibkit.instruments.bias.numeric.bank import OnLevels
from calibkit.numeric import chunks
from calibkit.numeric.thermal.left_out import MOVING_DEGC_MIN
from calibkit.numeric.thermal.pooled_fit import ThermalLog

INJECTED_RATE_DPH = 7.5
"""Constant rate that the rate-gain check adds to the indication [°/h]."""
WORSE = 1.01
"""Ratio of compensated to raw drift rms above which a ramp became worse: the drift rms of a log
repeats to about a percent.
"""
LONGEST_LAG = 3
"""Means apart of which products show drift: a drift lasts longer."""


def rate_gain(compensate: Callable[[Array], Array], indication: Array) -> float:
    """Ratio of the change of the compensated output to a constant rate that is added to the
    indication [n, °/h].
    """
    output_change = compensate(indication + INJECTED_RATE_DPH) - compensate(indication)
    return float(np.mean(output_change[1:]) / INJECTED_RATE_DPH)


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
        smaller_noise = min(noise, self.noise)
        left = float(np.hypot(self.left, np.sqrt(self.noise**2 - smaller_noise**2)))
        return replace(self, noise=smaller_noise, left=left)


def split_noise(parts: Sequence[Array]) -> NoiseSplit:
    """Noise and drift in the drift figure of logs or ramps, each given by its means [n, °/h] and
    taken about their mean; the squares of both add up to that of the figure.

    White noise cancels in products of neighbouring means; a drift does not (their lags are 1 to 3).
    Flicker noise counts as drift: a log cannot tell the two apart.
    """
    rows = []
    for part in parts:
        deviations = part - part.mean()
        count, total = deviations.size, float(np.mean(deviations**2))
        lags = range(1, min(LONGEST_LAG, count - 1) + 1)
        products = sum(float(deviations[lag:] @ deviations[:-lag]) for lag in lags)
        pairs = sum(count - lag for lag in lags)
        # the mean of the log is removed from both, and with it a share of the noise
        drift = products / pairs + total / count if pairs else 0.0
        rows.append((drift, total, float(max(pairs, 1)), float(count)))
    drift_squares, totals, pair_counts, counts = np.array(rows).T
    total = totals.mean()
    left = min(max(drift_squares.mean(), 0.0), total)
    # by products of noise with noise, and of noise with drift
    with_noise, with_drift = totals**2 / pair_counts, 4.0 * left * (total - left) / counts
    spread = np.sqrt(np.sum(with_noise + with_drift)) / len(rows)
    low, middle, high = np.sqrt([max(left - spread, 0.0), left, left + spread]).tolist()
    return NoiseSplit(float(np.sqrt(total - left)), middle, max(high - middle, middle - low))


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


HYSTERESIS_BIN_DEGC = 5.0
LEAST_BLOCKS = 5
"""Fewest heating and fewest cooling blocks in a bin of the hysteresis."""


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Residual drift on cooling less that on heating ramps [m, °/h] at case temperatures [m, °C],
    with standard uncertainties [m, °/h].
    """

    temperature: Array
    difference: Array
    standard_uncertainty: Array

    @property
    def rms(self) -> float:
        """Root mean square [°/h] of the differences beyond their uncertainties; 0 if the
        uncertainties explain them.
        """
        excess = float(np.mean(self.difference**2 - self.standard_uncertainty**2))
        return float(np.sqrt(max(excess, 0.0)))


def compare_directions(model: OnLevels | None, logs: Sequence[ThermalLog]) -> Hysteresis:
    """Compare the residual drift of a model (without one, the indication) on heating and on cooling
    ramps at equal case temperature.

    The mean of each log, which contains its turn-on bias, is removed first: the result is the shape
    of the hysteresis without its constant part. Raises FitError if no temperature was passed in
    both directions.
    """
    parts = []
    for log in logs:
        left = log.indication
        if model is not None:
            left = left - bank.evaluate(model, log.time, log.case, log.env).drift
        # a running mean over nine blocks suppresses the steps of a quantised thermometer
        padded = np.pad(np.gradient(log.case, log.time), 4, mode="edge")
        rate = np.convolve(padded, np.full(9, SECONDS_PER_MINUTE / 9.0), mode="valid")
        direction = np.sign(rate) * (np.abs(rate) >= MOVING_DEGC_MIN)
        parts.append((np.floor(log.case / HYSTERESIS_BIN_DEGC), direction, left - left.mean()))
    number, direction, left = (np.concatenate(part) for part in zip(*parts, strict=True))
    bins = []
    for k in np.unique(number):
        down, up = (left[(number == k) & (direction == way)] for way in (-1.0, 1.0))
        if min(down.size, up.size) >= LEAST_BLOCKS:
            variance = np.var(down, ddof=1) / down.size + np.var(up, ddof=1) / up.size
            bins.append(
                ((k + 0.5) * HYSTERESIS_BIN_DEGC, down.mean() - up.mean(), np.sqrt(variance))
            )
    if not bins:
        raise FitError(
            "no temperature was passed heating and cooling", hint="hysteresis needs ramps both ways"
        )
    return Hysteresis(*np.array(bins).T)
