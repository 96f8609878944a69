"""Figures that say how well a drift model does.

    drift rms       standard deviation of the means of an output over groups of intervals
    noise and left  rms² = noise² + left², left² the mean product of neighbouring means
    rate gain       change of the compensated output over a constant rate added to the indication

Flicker noise counts as drift: a log cannot tell the two apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks

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
