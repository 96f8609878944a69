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
MOST_ROWS = 400
"""Rows of a measured log, which are longer than `STEP_S` where the log is long."""
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

    def log(self, ramp: Ramp) -> "CaseLog":
        """Rows of the log of a ramp: the set point, lagged."""
        low, high = self.range_degc
        start, end = (low, high) if ramp.rate > 0.0 else (high, low)
        length = abs(end - start) / abs(ramp.rate) * SECONDS_PER_MINUTE
        corners = np.array([0.0, BEFORE_S, BEFORE_S + length, BEFORE_S + length + ramp.after_s])
        time = np.arange(0.0, corners[-1], STEP_S)
        chamber = np.interp(time, corners, [start, start, end, end])
        along = coil.path([(time, np.asarray(chamber, dtype=np.float64))])
        return CaseLog(time, along.drivers(self.case_lag_s, None).temperature)

    def columns(self, log: "CaseLog") -> Array:
        """Derivatives [m, p + 3] by the linear coefficients and by the static lag, for a static
        drift of the assumed size.
        """
        time, case = log.time, log.case
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

    def own(self, time: Array) -> tuple[Array, Array]:
        """Columns [m, k] of the errors of one log at times [m, s], turn-on bias and initial state,
        and their precisions [k].
        """
        states = np.exp(-(time - time[0])[:, None] / np.array(bank_fit.WARM_UP_S))
        sizes = [self._size("log", "turn-on"), *[self._size("log", "initial state")] * 3]
        present = np.array(sizes) > 0.0
        columns = np.column_stack([np.ones(time.size), states])[:, present]
        return columns, np.array(sizes)[present] ** -2.0

    def whitened(self, log: "CaseLog") -> tuple[Array, Array]:
        """Columns [m, p + 3] and those of the log's own errors [m, k] in units of independent
        noise.
        """
        columns = self.columns(log)
        rows = len(columns)
        variance = self.white_dph**2 * STEP_S / log.step_s * np.eye(rows)
        variance += self._size("log", "flicker") ** 2 * _kernel(rows)
        factor = np.linalg.cholesky(variance)
        return np.linalg.solve(factor, columns), np.linalg.solve(factor, self.own(log.time)[0])

    def part(self, log: "CaseLog") -> Array:
        """Information [p + 3, p + 3] of one log, its own errors averaged over."""
        columns, own = self.whitened(log)
        inner = own.T @ own + np.diag(self.own(log.time)[1])
        across = columns.T @ own
        return np.asarray(columns.T @ columns - across @ np.linalg.solve(inner, across.T))

    def information(self, logs: Sequence["CaseLog"]) -> Information:
        """Information of a campaign with the errors of each log written out."""
        precision = self.own(np.zeros(1))[1]
        p, k = len(BANK.terms) + 3, precision.size
        data = np.zeros((p + k * len(logs),) * 2)
        kinds = [2] * (self._size("log", "turn-on") > 0.0)
        for number, log in enumerate(logs):
            at = [*range(p), *range(p + k * number, p + k * (number + 1))]
            whole = np.column_stack(self.whitened(log))
            data[np.ix_(at, at)] += whole.T @ whole
        own = [*kinds, *[3] * (k - len(kinds))]
        source = np.array([*[0] * (p - 3), *[1] * 3, *own * len(logs)], dtype=np.int64)
        prior = np.concatenate([self.prior, np.tile(precision, len(logs))])
        return Information(data, prior, source, SOURCES)

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
        logs = [self.columns(self.log(ramp)) for ramp in used]
        return np.concatenate([(log - log.mean(axis=0))[::EVERY] for log in logs])


@dataclass(frozen=True, slots=True)
class CaseLog:
    """Rows of a planned or measured log."""

    time: Array
    """[m] [s]."""
    case: Array
    """[m], case temperature [°C]."""
    step_s: float = STEP_S
    """Length of a row."""

    @classmethod
    def of_blocks(cls, time: Array, case: Array) -> "CaseLog":
        """Rows of a measured log from shorter block means [n]."""
        step = max(STEP_S, float(time[-1] - time[0]) / MOST_ROWS)
        row = np.floor((time - time[0]) / step).astype(np.int64)
        first = np.flatnonzero(np.diff(row, prepend=-1))
        count = np.diff(first, append=row.size)
        return cls(np.add.reduceat(time, first) / count, np.add.reduceat(case, first) / count, step)


@lru_cache
def _kernel(rows: int) -> Array:
    """Covariance of flicker noise of level 1."""
    return thermal_noise.flicker_kernel(rows)


def covariance_of(parts: Sequence[Array], prior: Array) -> Array:
    """Covariance [p, p] of the coefficients from the information of each log."""
    return invert(np.sum(parts, axis=0) + np.diag(prior + 1e-12))
