"""What planned ramps will tell of the drift of a gyro, by the `bank` model with its priors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.instruments.fog_thermal.numeric import bank as forward, bank_fit
from calibkit.instruments.fog_thermal.numeric.bank import Bank
from calibkit.numeric.exchange import invert
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
SOURCES = ("noise", "turn-on bias", "start of the log", "size of the drift", "static lag")
"""What limits a result: of each log, and of the coefficients before any is measured."""
HARDLY = 1e-12
"""Information on a constant that nothing is known of before."""
BANK = Bank(bank_fit.LAGS_S)
Sources = dict[str, Array]


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

    def own(self, time: Array) -> tuple[Array, Integers]:
        """Columns [m, k] of the errors of one log at times [m, s], turn-on bias and initial state,
        in units of their sizes, and the number of the source of each.
        """
        states = np.exp(-(time - time[0])[:, None] / np.array(bank_fit.WARM_UP_S))
        columns = [np.full((time.size, 1), self._size("log", "turn-on"))]
        columns.append(self._size("log", "initial state") * states)
        return np.hstack(columns), np.array([0, *[1] * states.shape[1]])

    def part(self, log: "CaseLog") -> Array:
        """Information [3, p + 3, p + 3] of one log: Cᵀ V⁻¹ V_s V⁻¹ C for what noise, turn-on bias
        and initial state add to V, which is their sum; the sum of all three is Cᵀ V⁻¹ C.
        """
        columns = self.columns(log)
        rows = len(columns)
        variance = self.white_dph**2 * STEP_S / log.step_s * np.eye(rows)
        variance += self._size("log", "flicker") ** 2 * _kernel(rows)
        errors, source = self.own(log.time)
        whole = np.column_stack([columns, errors])
        white = np.linalg.solve(np.linalg.cholesky(variance), whole)
        C, Z = white[:, : columns.shape[1]], white[:, columns.shape[1] :]
        VC = C - Z @ np.linalg.solve(np.eye(Z.shape[1]) + Z.T @ Z, Z.T @ C)
        ZVC = Z.T @ VC
        each = [ZVC[source == number].T @ ZVC[source == number] for number in (0, 1)]
        return np.stack([VC.T @ VC, *each])

    def variances(self, information: Array, slopes: Mapping[str, Array]) -> dict[str, Sources]:
        """Result → source → variance [m] that it leaves in combinations [m, p + 3], where the logs
        have an information [3, p + 3, p + 3].
        """
        inverse = invert(information.sum(axis=0) + np.diag(self.prior + HARDLY))
        found = {}
        for name, combinations in slopes.items():
            pull = inverse @ combinations.T
            by_log = np.sum(pull * (information @ pull), axis=1)
            by_prior = self.prior[:, None] * pull**2
            parts = (*by_log, by_prior[:-3].sum(axis=0), by_prior[-3:].sum(axis=0))
            found[name] = dict(zip(SOURCES, parts, strict=True))
        return found

    def uncertainty(self, information: Array) -> Array:
        """Standard uncertainties [p + 3] of the coefficients."""
        inverse = invert(information.sum(axis=0) + np.diag(self.prior + HARDLY))
        return np.asarray(np.sqrt(np.diag(inverse)))

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
