"""What the compensated rate is uncertain by: coefficients, model error on ramps not seen, clamping; and the hysteresis left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import thermal_drift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.numeric.thermal_drift import Evaluation
    from calibkit.numeric.thermal_fit import ThermalLog
    from calibkit.numeric.thermal_terms import ThermalModel

    Array = NDArray[np.float64]

NEIGHBOURING = (1, 2, 3)
"""How many means apart left-out errors are compared: 100 to 300 s."""
MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] above which a block counts as heating, below minus which as cooling."""
HYSTERESIS_BIN_DEGC = 5.0
LEAST_BLOCKS = 5
"""Blocks on each side that a bin of the hysteresis needs."""


def model_error(errors: Sequence[Array]) -> float:
    """Model error [°/h]: root of the mean product of neighbouring errors of left-out ramps, [m, °/h] each.

    White noise drops out of the products; what a model misses on a ramp that it has not seen lasts, and stays. So do flicker
    noise and the uncertainty of the coefficients: the figure is on the safe side by them. 0 where the mean is negative.
    """
    pairs = [(e[k:], e[: e.size - k]) for e in errors for k in NEIGHBOURING if k < e.size]
    count = sum(late.size for late, _ in pairs)
    return float(np.sqrt(max(sum(float(late @ early) for late, early in pairs), 0.0) / count)) if count else 0.0


def drift_uncertainty(model: ThermalModel, evaluation: Evaluation) -> Array:
    """Standard uncertainty [n, °/h] of the drift along a log, and so of the compensated rate.

    Type A of coefficients and lags, propagated (JCGM 100, 5.2.2); the model error on left-out ramps; where a driver was
    clamped, a rectangular distribution as wide to either side as what the model would have said without clamping. Noise of
    the indication and the turn-on bias of the log are not drift and not in it.
    """
    s = evaluation.sensitivities
    coefficients = np.clip(np.einsum("ij,jk,ik->i", s, model.covariance, s), 0.0, None)
    return np.asarray(np.sqrt(coefficients + model.model_error**2 + evaluation.beyond**2 / 3.0), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Cooling less heating [m, °/h] of what a model leaves, over case temperature [m, °C], with standard uncertainties [m]."""

    temperature: Array
    difference: Array
    standard_uncertainty: Array

    @property
    def rms(self) -> float:
        """Root mean square [°/h] of the differences beyond their uncertainties; 0 where these explain them."""
        excess = float(np.mean(self.difference**2 - self.standard_uncertainty**2))
        return float(np.sqrt(max(excess, 0.0)))


def hysteresis(model: ThermalModel, logs: Sequence[ThermalLog]) -> Hysteresis:
    """Compare what a model leaves on heating and on cooling ramps at the same case temperature.

    Each log's mean is taken off first, as its turn-on bias cannot be told from it: of the hysteresis its shape is shown, not
    a constant part. Raises FitError where no temperature was passed in both directions.
    """
    heating: dict[int, list[float]] = {}
    cooling: dict[int, list[float]] = {}
    for log in logs:
        left = log.indication - thermal_drift.evaluate(model, log.time, log.case, log.env).drift
        rate = _smoothed(np.gradient(log.case, log.time)) * 60.0
        bins = np.floor(log.case / HYSTERESIS_BIN_DEGC).astype(np.int64)
        for cells, moving in ((heating, rate >= MOVING_DEGC_MIN), (cooling, rate <= -MOVING_DEGC_MIN)):
            for number in np.unique(bins[moving]).tolist():
                cells.setdefault(number, []).extend((left - left.mean())[moving & (bins == number)].tolist())
    sides = [(number, cooling.get(number, []), heating.get(number, [])) for number in sorted(heating)]
    both = [(number, down, up) for number, down, up in sides if min(len(down), len(up)) >= LEAST_BLOCKS]
    if not both:
        raise FitError("no temperature was passed heating and cooling", hint="hysteresis needs ramps both ways")
    middle = (np.array([number for number, _, _ in both]) + 0.5) * HYSTERESIS_BIN_DEGC
    difference = np.array([np.mean(down) - np.mean(up) for _, down, up in both])
    variance = [np.var(down, ddof=1) / len(down) + np.var(up, ddof=1) / len(up) for _, down, up in both]
    return Hysteresis(middle, difference, np.sqrt(np.array(variance)))


def _smoothed(values: Array) -> Array:
    """Running mean [n] over nine blocks: the steps of a quantised thermometer are no motion."""
    return np.convolve(np.pad(values, 4, mode="edge"), np.full(9, 1.0 / 9.0), mode="valid")
