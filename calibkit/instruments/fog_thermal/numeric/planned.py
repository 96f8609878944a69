"""What planned ramps will tell of the drift of a gyro, by the `bank` model with its priors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.instruments.fog_thermal.numeric import bank as forward, bank_fit
from calibkit.instruments.fog_thermal.numeric.bank import Bank
from calibkit.numeric.information import Information, invert
from calibkit.numeric.thermal import coil, noise as thermal_noise

STEP_S = 60.0
"""Averaging time of the rows."""
BEFORE_S = 600.0
"""Soak before a ramp that belongs to its log."""
USED = (2.0, 4.0, 7.0)
"""Unsigned rates [°C/min] of the ramps on which the drift is used."""
USED_SOAK_S = 1800.0
EVERY = 5
"""Rows between two at which an uncertainty is predicted."""
LEVELS = 9
RESULTS = {"drift": "deg/h", "drift at rest": "deg/h"}
"""Results that a plan predicts, with their units."""
UNITS = {
    ("coil", "drift"): "deg/h",
    ("log", "turn-on"): "deg/h",
    ("log", "initial state"): "deg/h",
    ("log", "flicker"): "deg/h",
}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""
TERMS, LAG, TURN_ON, START = "size of the drift", "static lag", "turn-on bias", "start of the log"
SOURCES = (TERMS, LAG, TURN_ON, START)
BANK = Bank(bank_fit.LAGS_S)


@dataclass(frozen=True, slots=True)
class Ramp:
    """One ramp between two soaks: one log."""

    rate: float
    """Signed [°C/min]."""
    after_s: float
    """Soak after it."""


@dataclass(frozen=True, slots=True)
class Model:
    """Range of use, noise, and what is assumed of the gyro."""

    range_degc: tuple[float, float]
    case_lag_s: float
    """Lag of the case behind the chamber."""
    white_dph: float
    """White noise of the mean over a row."""
    sizes: Mapping[tuple[str, str], float]
    """(group, effect) → standard deviation [°/h]."""

    def _size(self, group: str, effect: str) -> float:
        return self.sizes.get((group, effect), 0.0)

    def case(self, ramp: Ramp) -> tuple[Array, Array]:
        """Time [m, s] and case temperature [m, °C] of the rows of a log: the set point, lagged."""
        low, high = self.range_degc
        start, end = (low, high) if ramp.rate > 0.0 else (high, low)
        length = abs(end - start) / abs(ramp.rate) * SECONDS_PER_MINUTE
        corners = np.array([0.0, BEFORE_S, BEFORE_S + length, BEFORE_S + length + ramp.after_s])
        time = np.arange(0.0, corners[-1], STEP_S)
        chamber = np.interp(time, corners, [start, start, end, end])
        along = coil.path([(time, np.asarray(chamber, dtype=np.float64))])
        return time, along.drivers(self.case_lag_s, None).temperature

    def columns(self, ramp: Ramp) -> Array:
        """Derivatives [m, p + 3] by the linear coefficients and by the static lag, for a static
        drift of the assumed size.
        """
        time, case = self.case(ramp)
        along = coil.path([(time, case)])
        lag = bank_fit.STATIC_MEAN
        temperature = forward.static_temperature(along, lag)
        followed = forward.follow_lags(BANK, along)
        drivers = forward.log_drivers(BANK, [(time, case)], temperature, followed)
        moved = forward.static_derivatives(along, lag, temperature)
        slope = self._size("coil", "drift") / forward.SCALE_DEGC
        return np.column_stack([BANK.columns(drivers), moved * slope])

    @property
    def prior(self) -> Array:
        """Precision [p + 3] of the coefficients, as the fit assumes it where the logs tell nothing,
        and of the static lag.
        """
        median = {name: size for name, size, _ in bank_fit.SIZES}
        drift = self._size("coil", "drift")
        a = median["a"] * drift
        sizes = {"a": a, "b": median["b"] * a, "c": median["c"] * a, "s": median["s"] * drift}
        found = np.zeros(len(BANK.terms) + 3)
        for letter, size in sizes.items():
            found[BANK.part(letter)] = size**-2.0
        found[BANK.part("s")] /= bank_fit.SHAPE ** np.arange(forward.POWERS)
        found[-3:] = bank_fit.STATIC_SPREAD**-2.0
        return found

    def own(self, rows: int) -> tuple[Array, Array]:
        """Columns [m, k] of the errors of one log, turn-on bias and initial state, and their
        precisions [k].
        """
        time = np.arange(rows) * STEP_S
        states = np.exp(-time[:, None] / np.array(bank_fit.WARM_UP_S))
        sizes = [self._size("log", "turn-on"), *[self._size("log", "initial state")] * 3]
        present = np.array(sizes) > 0.0
        columns = np.column_stack([np.ones(rows), states])[:, present]
        return columns, np.array(sizes)[present] ** -2.0

    def whitened(self, ramp: Ramp) -> tuple[Array, Array]:
        """Columns [m, p + 3] and those of the log's own errors [m, k] in units of independent
        noise.
        """
        columns = self.columns(ramp)
        rows = len(columns)
        variance = self.white_dph**2 * np.eye(rows)
        variance += self._size("log", "flicker") ** 2 * _kernel(rows)
        factor = np.linalg.cholesky(variance)
        return np.linalg.solve(factor, columns), np.linalg.solve(factor, self.own(rows)[0])

    def part(self, ramp: Ramp) -> Array:
        """Information [p + 3, p + 3] of one log, its own errors averaged over."""
        columns, own = self.whitened(ramp)
        inner = own.T @ own + np.diag(self.own(len(columns))[1])
        across = columns.T @ own
        return np.asarray(columns.T @ columns - across @ np.linalg.solve(inner, across.T))

    def information(self, ramps: Sequence[Ramp]) -> Information:
        """Information of a campaign with the errors of each log written out."""
        p, k = len(BANK.terms) + 3, self.own(1)[1].size
        data = np.zeros((p + k * len(ramps),) * 2)
        prior = [self.prior]
        source = [[0] * (p - 3), [1] * 3]
        kinds = [2] * (self._size("log", "turn-on") > 0.0)
        for number, ramp in enumerate(ramps):
            columns, own = self.whitened(ramp)
            at = [*range(p), *range(p + k * number, p + k * (number + 1))]
            whole = np.column_stack([columns, own])
            data[np.ix_(at, at)] += whole.T @ whole
            prior.append(self.own(1)[1])
            source.append([*kinds, *[3] * (k - len(kinds))])
        numbers = np.array([one for part in source for one in part], dtype=np.int64)
        return Information(data, np.concatenate(prior), numbers, SOURCES)

    def result_slopes(self, result: str) -> Array:
        """Derivatives [m, p + 3] of a result where it is used by the coefficients: of the drift
        about its mean along ramps, or at rest relative to 25 °C.
        """
        if result == "drift at rest":
            z = (np.linspace(*self.range_degc, LEVELS) - forward.ORIGIN_DEGC) / forward.SCALE_DEGC
            found = np.zeros((LEVELS, len(BANK.terms) + 3))
            found[:, BANK.part("s")] = z[:, None] ** np.arange(1, forward.POWERS + 1)
            return found
        used = [Ramp(sign * rate, USED_SOAK_S) for rate in USED for sign in (1.0, -1.0)]
        logs = [self.columns(ramp) for ramp in used]
        return np.concatenate([(log - log.mean(axis=0))[::EVERY] for log in logs])


@lru_cache
def _kernel(rows: int) -> Array:
    """Covariance of flicker noise of level 1."""
    return thermal_noise.flicker_kernel(rows)


def covariance_of(parts: Sequence[Array], prior: Array) -> Array:
    """Covariance [p, p] of the coefficients from the information of each log."""
    return invert(np.sum(parts, axis=0) + np.diag(prior + 1e-12))
