"""The `bank` model: drift as a function of the case temperature through a bank of first-order
lags.

    τ_j x_j' = u − x_j,   ρ_j = (u − x_j)/τ_j,   z_j = (x_j − 25 °C)/50 °C
    T = (1 − f) L(τ_fast) u + f L(τ_static) u,   z = (T − 25 °C)/50 °C
    ω = b0 + Σ_j (a_j + b_j z_j + c_j z) ρ_j + Σ_k s_k z^k + g(T)
        + Σ_m h_m d_m/δ_m + Σ_m w_m exp(−t/θ_m)
    drift D = ω(t) − ω(T_ref, at rest)                           `evaluate`, of all models

u is the case temperature, L(τ) a first-order lag. Any linear response of the coil is close to a sum
of lags; weights grow with the temperature of their own layer (b) or of the whole coil (c). T
follows the case as the mean of a wound coil does, which is heated from its outside and from its
hub. g is a table over temperature, d_m a play operator of half width δ_m (Krasnosel'skii &
Pokrovskii 1989) and the last sum a warm-up after switch-on; a model has these only where left-out
ramps ask for them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.evaluate import (
    Evaluation,
    design_at_rest,
    evaluate_terms,
    in_unmeasured_direction,
)
from calibkit.numeric.thermal.terms import BiasModel, ThermalModel

ORIGIN_DEGC = 25.0
"""Temperature at which z, g and the play operators are 0."""
SCALE_DEGC = 50.0
POWERS = 4
STATIC_LAGS = ("tau_fast", "tau_static", "share_static")
"""Coefficients of the lag of T: two lags [s], and the share of the slower one [1]."""
STEP = 1e-3
"""Change of the logarithm of a lag, or of the share, for numerical derivatives."""


@dataclass(frozen=True, slots=True)
class Bank:
    """Which terms a model has: lags [s], temperatures of the table [°C], half widths of the play
    operators [°C] and time constants of the warm-up [s]; a part without entries is absent.
    """

    lags: tuple[float, ...]
    knots: tuple[float, ...] = ()
    widths: tuple[float, ...] = ()
    warm_up: tuple[float, ...] = ()

    @property
    def terms(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each linear coefficient."""
        rate, lags = "deg/h/(degC/min)", range(1, len(self.lags) + 1)
        return (
            ("b0", "deg/h"),
            *((f"a{j}", rate) for j in lags),
            *((f"b{j}", rate) for j in lags),
            *((f"c{j}", rate) for j in lags),
            *((f"s{k}", "deg/h") for k in range(1, POWERS + 1)),
            *((f"g{k}", "deg/h") for k in range(1, len(self.knots) + 1)),
            *((f"h{k}", "deg/h") for k in range(1, len(self.widths) + 1)),
            *((f"w{k}", "deg/h") for k in range(1, len(self.warm_up) + 1)),
        )

    def part(self, letter: str) -> slice:
        """Linear coefficients whose names begin with a letter; b without b0."""
        first = 1
        lags = len(self.lags)
        sizes = (lags, lags, lags, POWERS, *map(len, (self.knots, self.widths, self.warm_up)))
        for other, count in zip("abcsghw", sizes, strict=True):
            if other == letter:
                break
            first += count
        return slice(first, first + count)

    def columns(self, drivers: "BankDrivers") -> Array:
        """Derivatives [n, p] of the indicated rate by the linear coefficients."""
        z = (drivers.temperature - ORIGIN_DEGC) / SCALE_DEGC
        table = np.zeros((z.size, len(self.knots)))
        for k, hat in enumerate(np.eye(len(self.knots))):
            # linear interpolation between the knots, 0 at the origin
            table[:, k] = np.interp(drivers.temperature, self.knots, hat)
            # b0 is the rate at rest at 25 °C: the table is 0 there
            table[:, k] -= np.interp(ORIGIN_DEGC, self.knots, hat)
        return np.column_stack(
            [
                np.ones(z.size),
                drivers.rates,
                drivers.rates * (drivers.lagged - ORIGIN_DEGC) / SCALE_DEGC,
                drivers.rates * z[:, None],
                z[:, None] ** np.arange(1, POWERS + 1),
                table,
                drivers.play,
                drivers.faded,
            ]
        )

    def slope(self, coefficients: Array, drivers: "BankDrivers") -> Array:
        """Derivative [n, °/h/°C] of the indicated rate by T; a play operator that is not pushed
        stays where it is.
        """
        z = (drivers.temperature - ORIGIN_DEGC) / SCALE_DEGC
        powers = np.arange(1, POWERS + 1)
        slope = (powers * z[:, None] ** (powers - 1)) @ coefficients[self.part("s")]
        slope = (slope + drivers.rates @ coefficients[self.part("c")]) / SCALE_DEGC
        if self.widths:
            # a play operator that is not pushed stands still, so that its term changes against T
            free = np.abs(drivers.play) < 1.0
            slope = slope - free @ (coefficients[self.part("h")] / np.array(self.widths))
        if self.knots:
            steps = np.diff(coefficients[self.part("g")]) / np.diff(self.knots)
            place = np.searchsorted(self.knots, drivers.temperature, side="right") - 1
            inside = (place >= 0) & (place < steps.size)
            slope = slope + np.where(inside, steps[np.clip(place, 0, steps.size - 1)], 0.0)
        return np.asarray(slope, dtype=np.float64)

    def play(self, temperature: Array) -> Array:
        """Play operators [n, widths] of a temperature [n, °C] along one log, from −1 to 1; the gyro
        came from the origin to the first temperature.
        """
        play = np.empty((temperature.size, len(self.widths)))
        for k, width in enumerate(self.widths):
            play[:, k] = _play(temperature, width, 0.0, ORIGIN_DEGC) / width
        return play

    def hysteresis(self, coefficients: Array) -> float:
        """Half the spread [°/h] of the rate at rest at one temperature by where the gyro came
        from.
        """
        return float(abs(coefficients[self.part("h")].sum()))

    def unknown_start(self, temperature: Array, coefficients: Array) -> Array:
        """Half the spread [n, °/h] of the hysteresis along one log by where its play operators
        began: anything until the temperature [n, °C] has moved by their full width.
        """
        spread, first = np.zeros(temperature.size), float(temperature[0])
        for width, size in zip(self.widths, coefficients[self.part("h")], strict=True):
            low, high = (_play(temperature, width, start, first) for start in (-width, width))
            spread += size * (high - low) / (2.0 * width)
        return np.abs(spread)


def _play(temperature: Array, width: float, start: float, last: float) -> Array:
    """Distance [n, °C] by which a play operator of a half width [°C] is behind a temperature
    [n, °C] that comes from `last`, where the distance was `start`: it follows only if pushed.
    """
    distances = np.empty(temperature.size)
    distance = start
    for row, value in enumerate(temperature.tolist()):
        # it follows the temperature only where it would be more than its half width behind
        distance = min(max(distance - (value - last), -width), width)
        last = value
        distances[row] = distance
    return distances


@dataclass(frozen=True, slots=True)
class BankDrivers:
    """Inputs of the columns: T [n, °C], lagged temperatures x_j [n, lags, °C] and rates ρ_j
    [n, lags, °C/min], play operators [n, widths] and decayed shares of the warm-up [n, warm_up].
    """

    temperature: Array
    lagged: Array
    rates: Array
    play: Array
    faded: Array


def follow_lags(bank: Bank, case_path: coil.Path) -> tuple[Array, Array]:
    """Lagged temperatures x_j [n, lags, °C] and rates ρ_j [n, lags, °C/min] of logs in sequence."""
    layers = [case_path.drivers(lag, None) for lag in bank.lags]
    return (
        np.column_stack([layer.temperature for layer in layers]),
        np.column_stack([layer.rate for layer in layers]),
    )


def static_temperature(case_path: coil.Path, lag: Array) -> Array:
    """T [n, °C] of logs in sequence, for the logarithms of both lags and the share [3]."""
    fast, slow = (case_path.drivers(float(np.exp(tau)), None).temperature for tau in lag[:2])
    return fast + float(lag[2]) * (slow - fast)


def static_derivatives(case_path: coil.Path, lag: Array, temperature: Array) -> Array:
    """Derivatives [n, 3] of T by the logarithms of both lags and by the share."""
    shifted_temperatures = [static_temperature(case_path, lag + step) for step in np.eye(3) * STEP]
    return np.column_stack([(shifted - temperature) / STEP for shifted in shifted_temperatures])


def log_drivers(
    bank: Bank,
    logs: Sequence[tuple[Array, Array]],
    temperature: Array,
    followed: tuple[Array, Array],
) -> BankDrivers:
    """Drivers of logs in sequence, each given by its time [n, s] and case temperature; `followed`
    are the lagged temperatures and rates.
    """
    ends = np.cumsum([time.size for time, _ in logs])[:-1]
    play = np.concatenate([bank.play(part) for part in np.split(temperature, ends)])
    since = np.concatenate([time - time[0] for time, _ in logs])
    faded = np.exp(-since[:, None] / np.array(bank.warm_up)[None, :])
    return BankDrivers(temperature, *followed, play, faded)


@dataclass(frozen=True, slots=True, kw_only=True)
class BankModel(BiasModel):
    """Fitted drift model of form bank; its coefficients are in the order of the bank's terms, its
    covariance is averaged over the variances of the priors and over the noise. Of its ranges those
    of T and of the lagged rates are used.
    """

    bank: Bank
    static_lag: tuple[float, float, float]
    """tau_fast [s], tau_static [s] and the share of the slower lag [1]."""
    turn_on_sd: float
    """Standard deviation of the turn-on biases [°/h]."""

    def settled(self, case: Array, rate: Array) -> BankDrivers:
        """Drivers at case temperatures [n, °C] on steady ramps [n, °C/min] whose lags have settled:
        play operators are then behind by their width, a warm-up is over.
        """
        fast, slow, share = self.static_lag
        # a lag τ is behind a steady ramp r by τ r
        later = -rate / SECONDS_PER_MINUTE
        return BankDrivers(
            case + later * (fast + share * (slow - fast)),
            case[:, None] + later[:, None] * np.array(self.bank.lags),
            np.repeat(rate[:, None], len(self.bank.lags), axis=1),
            np.repeat(-np.sign(rate)[:, None], len(self.bank.widths), axis=1),
            np.zeros((case.size, len(self.bank.warm_up))),
        )

    def slope_settled(self, drivers: BankDrivers) -> Array:
        """Derivative [n, °/h/°C] of the indicated rate by T where play operators are given."""
        given_play = replace(drivers, play=np.ones_like(drivers.play))
        return self.bank.slope(self.coefficients, given_play)

    def columns_settled(self, case: Array, rate: Array) -> Array:
        """Derivatives [n, p + 3] of the indicated rate by the coefficients and the static lag on
        steady ramps, as `settled`.
        """
        drivers, (fast, slow, share) = self.settled(case, rate), self.static_lag
        by_temperature = -rate / SECONDS_PER_MINUTE * self.slope_settled(drivers)
        by_lag = by_temperature[:, None] * np.array([1.0 - share, share, slow - fast])
        return np.column_stack([self.bank.columns(drivers), by_lag])


OnLevels: TypeAlias = ThermalModel | BankModel
"""Drift model whose value is known at every instant, without integration."""


REFERENCE_DEGC = 25.0


def evaluate(
    model: OnLevels,
    time: Array,
    case: Array,
    env: Array,
    reference_degc: float = REFERENCE_DEGC,
    *,
    long_at_rest: bool = False,
) -> Evaluation:
    """Drift along a log, zero at rest (no rate, no gradient) at the reference temperature.

    Parameters
    ----------
    model : a fitted model.
    time, case, env : [n, s], [n, °C], [n, °C], strictly increasing, of any sampling; env does not
        enter a lagged model.
    reference_degc : clamped to the fitted range.
    long_at_rest : the log is at rest long after switch-on, in the middle of a hysteresis.

    Notes
    -----
    The drift is causal: only samples up to an instant enter. Outside the fitted ranges of
    temperature, rate and gradient, drivers are clamped and flagged. Lags start in equilibrium at
    the first sample: if the temperature already changes there, the drift is wrong until this
    transient has decayed. The equations of the lags are solved exactly at any sampling; the rates
    of a level model need at least four samples in their window.

    """
    if not isinstance(model, BankModel):
        return evaluate_terms(model, time, case, env, reference_degc)
    case = np.clip(case, *coil.followed_range(*model.valid.temperature))
    logs, case_path = [(time, case)], coil.path([(time, case)])
    lag = np.array([*np.log(model.static_lag[:2]), model.static_lag[2]])
    temperature = static_temperature(case_path, lag)
    lagged, rates = follow_lags(model.bank, case_path)
    free = log_drivers(model.bank, logs, temperature, (lagged, rates))
    if long_at_rest:
        # the middle of the hysteresis, and no warm-up any more
        free = replace(free, play=0.0 * free.play, faded=0.0 * free.faded)
    # rates are clamped to the largest fitted magnitude on either side
    largest = max(map(abs, model.valid.rate))
    inside = replace(
        free,
        temperature=np.clip(temperature, *model.valid.temperature),
        lagged=np.clip(lagged, *model.valid.temperature),
        rates=np.clip(rates, -largest, largest),
    )
    clamped = np.asarray(inside.temperature != temperature)
    # drift is zero at rest at the reference: only differences of columns count
    rest_row = at_rest(model, reference_degc)[1][: model.coefficients.size]
    columns = model.bank.columns(inside) - rest_row
    slope = np.where(clamped, 0.0, model.bank.slope(model.coefficients, inside))
    by_lag = static_derivatives(case_path, lag, temperature) * slope[:, None]
    # derivatives by the lags [s] from those by their logarithms
    by_lag[:, :2] /= model.static_lag[:2]
    return Evaluation(
        columns @ model.coefficients,
        np.column_stack([columns, by_lag]),
        (model.bank.columns(free) - rest_row - columns) @ model.coefficients,
        clamped,
        np.any(inside.rates != rates, axis=1),
        np.zeros(time.size, dtype=bool),
        in_unmeasured_direction(model.valid, rates[:, 0]),
        model.bank.unknown_start(temperature, model.coefficients),
    )


def at_rest(model: OnLevels, temperature: float) -> tuple[float, Array]:
    """Indicated rate at rest [°/h] (no rate, no gradient, long after switch-on) at a temperature
    [°C], clamped to the fitted range, and its derivatives [p] as in the covariance.
    """
    if isinstance(model, BankModel):
        case = np.array([model.nearest_fitted(temperature)])
        row = model.columns_settled(case, np.zeros(1))[0]
    else:
        row = np.zeros(model.covariance.shape[0])
        row[: model.coefficients.size] = design_at_rest(model, temperature)[0]
    return float(row[: model.coefficients.size] @ model.coefficients), row
