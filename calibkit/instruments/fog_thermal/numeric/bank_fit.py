"""Fit of the `bank` model with random turn-on biases: Gaussian priors, their variances by evidence.

y_log(t) = ω + t_log + Σ_m i_log,m exp(−t/θ_m) + flicker + white;  the turn-on bias t_log is random
with mean 0, and i_log is a start of the coil away from equilibrium. The static lag is found by
Gauss–Newton steps; its derivatives stay among the columns, so that its uncertainty is propagated.
Results are averaged over the variances that the logs do not determine.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank as forward, evidence
from calibkit.instruments.fog_thermal.numeric.bank import Bank, BankModel
from calibkit.instruments.fog_thermal.numeric.evidence import FLAT, Gram, Posterior, Prior
from calibkit.numeric.dispersion import rms
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.noise import Noise
from calibkit.numeric.thermal.pooled_fit import Rows, Stack
from calibkit.numeric.thermal.terms import Span, Valid

NOWHERE: Span = (0.0, 0.0)
"""Range of a driver that a bank does not use."""
LAGS_S = tuple(np.geomspace(30.0, 3000.0, 10).tolist())
WIDTHS_DEGC = (4.0, 8.0, 16.0)
WARM_UP_S = (300.0, 1000.0, 3000.0)
KNOT_DEGC = 4.0
SMOOTH_DEGC = 8.0
"""Correlation length of the table over temperature [°C]."""
STATIC_MEAN = np.array([np.log(250.0), np.log(1500.0), 0.4])
"""Prior of the static lag: logarithms of both lags [s], share of the slower."""
STATIC_SPREAD = np.array([0.5, 0.4, 0.2])
LARGEST_STEP = np.array([0.7, 0.7, 0.3])
SHAPE = 0.16
"""Prior variance of a static power relative to that of the power before."""
USUAL_LEVEL, MINUTE_S = 0.06, 60.0
"""Flicker noise of the fit, in white noise of a minute; what is beyond it is in the model error."""
LEAST_DRIFT = 0.2
"""Smallest size of the drift that the priors assume, in standard deviations of a group."""
SIZES = (
    ("a", 0.05, 2.0),
    ("b", 0.1, 0.7),
    ("c", 0.02, 0.8),
    ("s", 1.0, 1.0),
    ("g", 0.1, 3.0),
    ("h", 0.1, 1.0),
    ("w", 0.1, 2.0),
    ("turn-on", 0.15, 1.5),
    ("initial", 0.02, 1.5),
)
"""Prior of the standard deviation of each part: its median relative to the drift (of b and c: to
that of a), and the standard deviation of its logarithm.
"""
TURN_ON, INITIAL = ([name for name, *_ in SIZES].index(name) for name in ("turn-on", "initial"))
NEGLIGIBLE = 1e-3
"""Share of a standard deviation at which a part is as good as absent."""
GAINED = 3.0
"""Increase of the logarithm of the evidence from which initial states count as seen: odds of 20 to
1.
"""
STEPS = 10
POINTS = np.random.default_rng(952).standard_normal((64, len(SIZES) + 1))
"""Standard normal points of the average over the variances."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Logs of a bank fit with the terms that are fitted."""

    rows: Rows
    """At the noise of the logs."""
    level: float
    """Mean indication [°/h], which is subtracted."""
    drift: float
    """Size of the drift [°/h], which the priors assume."""
    bank: Bank
    along: coil.Path
    followed: tuple[Array, Array]
    prior: Prior
    root: Array
    """[p, p], from whitened to raw coefficients: Cholesky factor of the table's correlation."""

    @property
    def stacked(self) -> Stack:
        """The logs."""
        return self.rows.stacked

    @property
    def logs(self) -> list[tuple[Array, Array]]:
        """Time [n, s] and case temperature [n, °C] of each log."""
        return [(log.time, log.case) for log in self.stacked.logs]

    def drivers(self, lag: Array) -> forward.BankDrivers:
        """Drivers of all logs in sequence for a static lag [3]."""
        temperature = forward.static_temperature(self.along, lag)
        return forward.log_drivers(self.bank, self.logs, temperature, self.followed)

    def columns(self, lag: Array, slope_of: Array | None) -> Array:
        """Columns [n, P]: whitened terms, derivatives by the static lag (0 without coefficients
        [p]), turn-on biases and initial states.
        """
        drivers = self.drivers(lag)
        terms = self.bank.columns(drivers) @ self.root
        by_lag = np.zeros((terms.shape[0], 3))
        if slope_of is not None:
            moved = forward.static_derivatives(self.along, lag, drivers.temperature)
            by_lag = moved * self.bank.slope(slope_of, drivers)[:, None]
        return np.column_stack([terms, by_lag, _own_columns(self.stacked)])

    def at_white(self, variance: float) -> "Problem":
        """The problem at a white noise of the blocks [(°/h)²], and the usual flicker noise."""
        step = float(np.median(np.diff(self.stacked.logs[0].time)))
        flicker = USUAL_LEVEL * float(np.sqrt(variance * step / MINUTE_S))
        return replace(self, rows=replace(self.rows, noise=Noise(variance, flicker)))

    def left(self, lag: Array, columns: Array, coefficients: Array) -> Array:
        """What coefficients [P] leave of the indication [n]; derivatives by the lag are about its
        prior mean.
        """
        p = self.root.shape[0]
        change = coefficients.copy()
        change[p : p + 3] += STATIC_MEAN - lag
        return self.stacked.indication - self.level - columns @ change

    def gram(self, rows: Rows, lag: Array, columns: Array) -> Gram:
        """Moments of columns [n, P] on rows."""
        left = self.left(lag, columns, np.zeros(columns.shape[1]))
        whole = rows.of(np.column_stack([columns, left]))
        return Gram.of(whole[:, :-1], whole[:, -1])

    def maximise(self, lag: Array, slope_of: Array | None, start: Array | None) -> Posterior:
        """Posterior at a static lag."""
        gram = self.gram(self.rows, lag, self.columns(lag, slope_of))
        return evidence.maximise(gram, self.prior, start)


def _own_columns(stacked: Stack) -> Array:
    """Columns [n, logs (1 + 3)] of the turn-on bias and the initial state of each log."""
    count = len(stacked.logs)
    found, states = (
        np.zeros((stacked.indication.size, count * (1 + len(WARM_UP_S)))),
        (_initial_states(stacked)),
    )
    for k, rows in enumerate(stacked.log_rows):
        found[rows, k] = 1.0
        first = count + k * len(WARM_UP_S)
        found[rows, first : first + len(WARM_UP_S)] = states[rows]
    return found


def _initial_states(stacked: Stack) -> Array:
    """Decays [n, 3] of an initial state since the start of each log."""
    since = np.concatenate([log.time - log.time[0] for log in stacked.logs])
    return np.asarray(np.exp(-since[:, None] / np.array(WARM_UP_S)), dtype=np.float64)


def _table(stacked: Stack) -> tuple[tuple[float, ...], Array]:
    """Knots [°C] over the fitted temperatures, and the Cholesky factor of their correlation."""
    low, high = (pick([pick(log.case) for log in stacked.logs]) for pick in (np.min, np.max))
    first = np.floor(low / KNOT_DEGC)
    knots = KNOT_DEGC * np.arange(first, np.ceil(high / KNOT_DEGC) + 1.0)
    apart = (knots[:, None] - knots) / SMOOTH_DEGC
    factor = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-6 * np.eye(knots.size))
    return tuple(knots.tolist()), np.asarray(factor, dtype=np.float64)


def state_problem(rows: Rows, extra: str = "", *, drift: float | None = None) -> Problem:
    """Problem with the terms g (table), h (hysteresis) and w (warm-up) of `extra` beside the
    others, for a drift of a size [°/h], by default that of the logs.
    """
    stacked = rows.stacked
    away = stacked.indication - stacked.level_columns @ stacked.levels
    drift = drift or _size_of_drift(rows, away)
    knots, factor = _table(stacked) if "g" in extra else ((), np.zeros((0, 0)))
    bank = Bank(
        LAGS_S,
        knots,
        WIDTHS_DEGC if "h" in extra else (),
        WARM_UP_S if "w" in extra else (),
    )
    along = coil.path([(log.time, log.case) for log in stacked.logs])
    letters = [name[0] for name, _ in bank.terms]
    letters[0] = ""
    names = [name for name, *_ in SIZES]
    count = len(stacked.logs)
    group = [names.index(letter) if letter else FLAT for letter in letters]
    group += [len(SIZES)] * 3 + [TURN_ON] * count
    group += [INITIAL] * count * len(WARM_UP_S)
    shape = np.ones(len(group))
    shape[bank.part("s")] = SHAPE ** np.arange(forward.POWERS)
    shape[len(letters) : len(letters) + 3] = STATIC_SPREAD**2
    mixing = np.eye(len(SIZES) + 1)
    mixing[1:3, 0] = 1.0
    size = 2.0 * np.log(drift)
    mean = [2.0 * np.log(median) + size * (name not in "bc") for name, median, _ in SIZES]
    spread = [2.0 * sd for *_, sd in SIZES]
    prior = Prior(np.array(group), shape, mixing, np.array([*mean, 0.0]), np.array([*spread, 1e-3]))
    root = np.eye(len(letters))
    root[bank.part("g"), bank.part("g")] = factor
    followed = forward.follow_lags(bank, along)
    level = float(np.mean(stacked.levels))
    return Problem(rows, level, drift, bank, along, followed, prior, root)


def _size_of_drift(rows: Rows, away: Array) -> float:
    """Standard deviation [°/h] of an indication [n] about its levels, without the noise."""
    means = rows.means(away[:, None])
    white = rows.noise.white_variance / rows.turned.typical
    return float(np.sqrt(max(float(np.mean(means**2)) - white, LEAST_DRIFT**2 * white)))


@dataclass(frozen=True, slots=True)
class Solution:
    """Most likely static lag with the posterior there, and the columns [n, P] about it."""

    problem: Problem
    lag: Array
    posterior: Posterior
    columns: Array

    @property
    def endless(self) -> bool:
        """Whether a lag does not describe a real lag: those of a bank are given."""
        return False

    @property
    def rows(self) -> Rows:
        """Rows of the fit."""
        return self.problem.rows

    @property
    def parameters(self) -> int:
        """Number of parameters that no prior holds: the mean, the variances of the parts that the
        model has, and the static lag.
        """
        own = self.problem.bank
        absent = sum(not part for part in (own.knots, own.widths, own.warm_up))
        return 1 + len(SIZES) - absent + STATIC_MEAN.size

    @property
    def _determined(self) -> float:
        """Effective number of coefficients: what the logs determine of each, from 0 to 1."""
        known = evidence.log_variances(self.problem.prior, self.posterior.theta)
        return float(np.sum(1.0 - np.diag(self.posterior.covariance) / np.exp(known)))

    def drift(self) -> tuple[Array, Array]:
        """Drift [n, °/h] along the logs against rest at 25 °C, and its variance [n, (°/h)²]."""
        p = self.problem.root.shape[0] + 3
        drift, columns = self._drift_of(self.posterior.coefficients), self.columns[:, 1:p]
        variance = np.sum(columns @ self.posterior.covariance[1:p, 1:p] * columns, axis=1)
        return drift, variance

    def _drift_of(self, coefficients: Array) -> Array:
        """Drift [n, °/h] by coefficients [P], without the constant."""
        p = self.problem.root.shape[0]
        change = coefficients[1 : p + 3].copy()
        # the derivatives stand for a change of the lag from its prior mean
        change[p - 1 :] += STATIC_MEAN - self.lag
        return self.columns[:, 1 : p + 3] @ change

    def change_from(self, other: "Solution") -> float:
        """Rms [°/h] over the logs of what the drift is more uncertain by than another solution
        states if this one is right.
        """
        (drift, variance), (before, known) = self.drift(), other.drift()
        return float(np.sqrt(max(float(np.mean((drift - before) ** 2 + variance - known)), 0.0)))

    @property
    def unsettled(self) -> bool:
        """Whether logs start away from equilibrium: initial states make the logs likelier by more
        than chance.
        """
        prior, still = self.problem.prior, self.posterior.theta.copy()
        still[INITIAL] += 2.0 * np.log(NEGLIGIBLE)
        gram = self.problem.gram(self.rows, self.lag, self.columns)
        values = [
            evidence.condition(gram, prior, theta)[2]
            + 0.5 * float(np.sum(((theta - prior.mean) / prior.spread) ** 2))
            for theta in (self.posterior.theta, still)
        ]
        return values[0] - values[1] > GAINED

    def with_own_start(self, predicted: Iterable[Array]) -> Iterator[Array]:
        """Predictions [rows, °/h, up to a constant] of each ramp; where logs start unsettled, with
        the initial state that its own indication shows, which no fit to other ramps knows.
        """
        own = self.problem
        if not self.unsettled:
            yield from predicted
            return
        stacked, states = own.stacked, _initial_states(own.stacked)
        white, sound = self.rows.noise.white_variance, self.rows.sound
        variance = np.exp(self.posterior.theta[INITIAL])
        precision = np.diag([0.0, *[white / variance] * len(WARM_UP_S)])
        for rows, drift in zip(stacked.ramps, predicted, strict=True):
            columns = np.column_stack([np.ones(rows.stop - rows.start), states[rows]])
            weighted = columns * sound[rows, None]
            left = stacked.indication[rows] - drift
            found = np.linalg.solve(weighted.T @ columns + precision, weighted.T @ left)
            yield drift + columns @ found

    def leave_out(self, without: Iterable[Rows]) -> Iterator[Array]:
        """Drift [n, °/h, up to a constant] of all blocks by the fit without each ramp in turn, at
        the same variances and noise.
        """
        own = self.problem
        for rows in without:
            gram = own.gram(replace(rows, noise=own.rows.noise), self.lag, self.columns)
            found = evidence.condition(gram, own.prior, self.posterior.theta)[0]
            yield self._drift_of(found)

    def finish(self) -> BankModel:
        """Model in raw units, averaged over the variances of the priors."""
        own, p = self.problem, self.problem.root.shape[0]
        gram = own.gram(own.rows, self.lag, self.columns)
        mean, covariance = evidence.average(gram, own.prior, self.posterior, POINTS)
        to_raw = np.eye(p + 3)
        to_raw[:p, :p] = own.root
        to_raw[p : p + 2, p : p + 2] = np.diag(np.exp(self.lag[:2]))
        coefficients = own.root @ mean[:p]
        coefficients[0] += own.level
        drivers = own.drivers(self.lag)
        case = np.concatenate([case for _, case in own.logs])
        residual = own.left(self.lag, self.columns, mean)[own.rows.blocks]
        return BankModel(
            bank=own.bank,
            coefficients=coefficients,
            static_lag=(*np.exp(self.lag[:2]).tolist(), float(self.lag[2])),
            covariance=to_raw @ covariance[: p + 3, : p + 3] @ to_raw.T,
            valid=Valid(_span(case), _span(drivers.rates[:, 0]), NOWHERE, NOWHERE),
            turn_on=mean[p + 3 : p + 3 + len(own.stacked.logs)],
            turn_on_sd=float(np.exp(0.5 * self.posterior.theta[TURN_ON])),
            dof=max(int(own.rows.starts.size - self._determined), 1),
            residual_rms=rms(residual),
            noise=own.rows.noise,
        )


def _span(values: Array) -> Span:
    """Smallest and largest value."""
    return float(values.min()), float(values.max())


def solve(own: Problem) -> Solution:
    """Static lag of the largest evidence by Gauss–Newton steps, each halved until it is larger, and
    the posterior there; white noise is what the fit leaves.
    """
    lag, found = _search(own.at_white(own.rows.noise.white_variance), STATIC_MEAN, None)
    left = own.left(lag, own.columns(lag, None), found.coefficients)
    own = own.at_white(own.rows.at_noise_of(left).noise.white_variance)
    lag, found = _search(own, lag, found.theta)
    return solve_at(own, lag, found.theta)


def solve_at(own: Problem, lag: Array, start: Array) -> Solution:
    """Posterior at a given static lag [3], its variances sought from `start`."""
    found = own.maximise(lag, None, start)
    columns = own.columns(lag, own.root @ found.coefficients[: own.root.shape[0]])
    gram = own.gram(own.rows, lag, columns)
    return Solution(own, lag, evidence.maximise(gram, own.prior, found.theta), columns)


def _search(own: Problem, lag: Array, start: Array | None) -> tuple[Array, Posterior]:
    """Static lag [3], sought from one, and the posterior without its derivatives."""
    step = np.zeros(3)
    best: tuple[float, Array, Posterior] | None = None
    p = own.root.shape[0]
    for _ in range(STEPS):
        found = own.maximise(lag, None, start)
        value = found.log_evidence - 0.5 * float(np.sum(((lag - STATIC_MEAN) / STATIC_SPREAD) ** 2))
        if best is not None and value < best[0]:
            step = step / 2.0
            if float(np.max(np.abs(step))) < CLOSE:
                break
            lag = best[1] + step
            continue
        settled = best is not None and value - best[0] < CLOSE
        best, start = (value, lag, found), found.theta
        if settled:
            break
        with_lag = own.maximise(lag, own.root @ found.coefficients[:p], start)
        step = np.clip(
            STATIC_MEAN + with_lag.coefficients[p : p + 3] - lag, -LARGEST_STEP, LARGEST_STEP
        )
        lag = lag + step
    assert best is not None  # noqa: S101 (the first evaluation sets it)
    return best[1], best[2]


CLOSE = 0.02
"""Increase of the logarithm of the evidence, or step of the lag, below which the search ends."""
