"""Residual drift on cooling less that on heating ramps, at equal case temperature.

    h(T) = mean of the blocks that cool through T − mean of those that heat through it

in bins of 5 °C, each log about its mean, which holds its turn-on bias.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric import evaluate
from calibkit.instruments.fog_thermal.numeric.bank import OnLevels
from calibkit.numeric.thermal.pooled_fit import ThermalLog

MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] above which a block is heating, and below its negative cooling."""
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
            left = left - evaluate.evaluate(model, log.time, log.case, log.env).drift
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
