"""Models of a bias compared with each other on ramps that were left out of the fit, and the
figures that say how well one does.

    drift rms       standard deviation of the means of an output over groups of intervals
    noise and left  rms² = noise² + left², left² the mean product of neighbouring means
    rate gain       change of the compensated output over a constant rate added to the indication

Flicker noise counts as drift: a log cannot tell the two apart. The error of a model is that of the
drift figure: with e the means over 100 s of what it leaves of a ramp, s_j = mean e² of ramp j,
pooled √(mean s_j) (`LeftOutErrors`). Of the models that help, the simplest is taken whose s_j are
on average within one standard error of the best (`simplest`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.thermal.fits import Basis, TermSolution, lagged_basis
from calibkit.numeric.thermal.pooled_fit import Stack, WhitenedRows

FIGURE_S = 100.0
"""Averaging time of the drift figure [s]: the longer of the two that GJB 2426A names."""
FIGURE_BLOCKS = 10
"""Blocks that one mean of the drift figure averages at a model interval of 10 s."""
MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] from which on a temperature changes; below it it is at rest."""
LEAST_SHARE = 0.5
"""Smallest share of sound rows with which a group of rows counts."""


CLEARLY = 0.95
"""Largest ratio of the error on left-out ramps to that without a model with which one may be
exported.
"""
STATIC = ("b0", "b1", "b2", "b3")


@dataclass(frozen=True, slots=True)
class Candidate:
    """Candidate model: its name, form and terms."""

    name: str
    form: Literal["level", "lagged", "bank"]
    terms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LeftOutErrors:
    """Model with its errors on parts of the logs (ramps, rates, stretches) that were left out of
    its fit.
    """

    name: str
    errors: tuple[Array, ...]
    """Figure means [m] of what the model leaves of each part."""
    raw: tuple[Array, ...]
    """The same without a model."""
    parameters: int = 0
    """Number of what the logs determine freely."""
    endless: bool = False
    """Whether a lag lies at its upper bound, so that it does not describe a real lag."""

    @property
    def squares(self) -> Array:
        """Mean squares [parts] of the errors."""
        return np.array([np.mean(error**2) for error in self.errors])

    @property
    def raw_squares(self) -> Array:
        """The same without a model."""
        return np.array([np.mean(error**2) for error in self.raw])

    @property
    def pooled(self) -> float:
        """Root of the mean over the parts of the mean squares."""
        return float(np.sqrt(np.mean(self.squares)))

    @property
    def pooled_raw(self) -> float:
        """The same without a model."""
        return float(np.sqrt(np.mean(self.raw_squares)))


def simplest(tested: Sequence[LeftOutErrors], eligible: Iterable[int]) -> int:
    """Number of the simplest of some models that is as good as the best within one standard error;
    one with a lag at its upper bound counts as less simple than any other.
    """
    ordered = sorted(
        eligible, key=lambda k: (tested[k].endless, tested[k].parameters, tested[k].pooled)
    )
    return choose_simplest({k: tested[k].squares for k in ordered})


def choose_simplest(squares: Mapping[int, Array]) -> int:
    """Number of the first of some models that is within one standard error of the best.

    Parameters
    ----------
    squares : mean square error [groups] of each model on each group of rows that was left out of
        its fit, in one unit; the simplest model stands first.

    Notes
    -----
    The standard error is that of the difference group by group, in which the noise of a group
    cancels (Breiman et al. 1984, 1-SE rule). The difference of the logarithms must be within its
    standard error too: there one bad group does not decide alone.
    """
    best = min(squares, key=lambda number: float(np.mean(squares[number])))
    floor = np.maximum(squares[best], np.finfo(np.float64).tiny)
    for number, square in squares.items():
        # in the logarithm a group in which all models fail does not decide
        ratio = np.maximum(square, np.finfo(np.float64).tiny) / floor
        if _is_chance(square - squares[best]) and _is_chance(np.log(ratio)):
            return number
    return best


def _is_chance(excess: Array) -> bool:
    """Whether the mean of what groups are worse by is within its standard error."""
    return bool(excess.mean() <= np.std(excess, ddof=1) / np.sqrt(excess.size))


def solve(
    candidates: Sequence[Candidate], basis: Basis
) -> tuple[list[tuple[Candidate, TermSolution]], list[str]]:
    """Fits of the candidates of level and lagged form to all ramps, and why others have none."""
    solved: list[tuple[Candidate, TermSolution]] = []
    refused: list[str] = []
    lagged = lagged_basis(basis.rows)
    for candidate in candidates:
        try:
            if candidate.form == "lagged":
                solved.append((candidate, lagged.solve(candidate.terms)))
            elif candidate.form == "level":
                solved.append((candidate, basis.solve(candidate.terms)))
        except FitError as error:
            refused.append(f"{candidate.name}: {error.message}")
    return solved, refused


def blocks_per_figure(interval_s: float) -> int:
    """Number of model intervals of `interval_s` in one mean of the drift figure."""
    return max(1, round(FIGURE_S / interval_s))


def left_out_errors(
    predicted: Iterable[Array], stacked: Stack, sound: Mask, figure_blocks: int
) -> tuple[Array, ...]:
    """Indication less a prediction of each ramp [m, °/h], as figure means about their mean."""
    ramp_errors = []
    for rows, values in zip(stacked.ramps, predicted, strict=True):
        left = stacked.indication[rows] - values
        error = figure_means(left, sound[rows], figure_blocks)
        ramp_errors.append(error - error.mean())
    return tuple(ramp_errors)


def figure_means(values: Array, sound: Mask, group: int) -> Array:
    """Means [m] of the sound ones of values [n] over groups of rows; groups of few and an
    incomplete last group are left out.
    """
    size = min(group, values.size)
    grouped_rows = max(values.size // group, 1) * size
    weight = sound[:grouped_rows].reshape(-1, size)
    # a mean of few blocks has more noise than the others
    usable = weight.mean(axis=1) >= LEAST_SHARE
    grouped = values[:grouped_rows].reshape(weight.shape)[usable]
    return np.asarray(np.average(grouped, axis=1, weights=weight[usable]), dtype=np.float64)


def leave_out(stacked: Stack, rows: WhitenedRows) -> tuple[WhitenedRows, ...]:
    """Rows of the logs, cut into ramps as stacked, without each ramp in turn."""
    without_ramp = (WhitenedRows.of_stack(stacked, rows.sound, ramp) for ramp in stacked.ramps)
    return tuple(replace(remaining, noise=rows.noise) for remaining in without_ramp)


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
        # 100 to 300 s apart white noise is independent, a drift hardly another one
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
    # variance of a mean product of noise with noise, and of noise with drift
    with_noise, with_drift = totals**2 / pair_counts, 4.0 * left * (total - left) / counts
    spread = np.sqrt(np.sum(with_noise + with_drift)) / len(rows)
    low, middle, high = np.sqrt([max(left - spread, 0.0), left, left + spread]).tolist()
    return NoiseSplit(float(np.sqrt(total - left)), middle, max(high - middle, middle - low))


def means_of_groups(output: Array, group: int) -> Array:
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
    return float(np.std(means_of_groups(output, group)))
