"""Fit of a bank of lags (`bank`) to logs with random turn-on biases, by Gaussian priors whose
variances the logs tell (`evidence`).

    y_log(t) = ω + t_log + Σ_m i_log,m exp(−t/θ_m) + flicker + white

ω is the rate of the bank, t_log the turn-on bias of a log, random with mean 0, and i_log,m a start
of the coil away from equilibrium. The static lag (ln τ_fast, ln τ_static, f) is found by
Gauss–Newton steps; its derivatives stay among the columns, so that its uncertainty is propagated.
Results are averaged over the variances that the logs do not determine.

`state_problem` says which terms there are and what is known of them, `solve` finds lag and
variances, `BankSolution.finish` the model in raw units.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibkit.instruments.bias.numeric import bank as forward, evidence
from calibkit.instruments.bias.numeric.bank import Bank, BankModel
from calibkit.instruments.bias.numeric.evidence import FLAT, Gram, Posterior, VariancePrior
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import rms
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import BlockNoise, Stack, WhitenedRows
from calibkit.numeric.thermal.terms import Span, Valid

UNUSED: Span = (0.0, 0.0)
"""Range of a driver that a bank does not use."""
# ten lags, each 1.7 times the one before
LAGS_S = tuple(np.geomspace(30.0, 3000.0, 10).tolist())
# half widths of the play operators, time constants of a warm-up and of a start away from rest, and
# the distance of the knots of the table over temperature
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
CLOSE = 0.02
"""Increase of the logarithm of the evidence, or step of the lag, below which the search ends."""
POINTS = np.random.default_rng(952).standard_normal((64, len(SIZES) + 1))
"""Standard normal points of the average over the variances."""


@dataclass(frozen=True)
class Problem:
    """Logs of a bank fit with the terms that are fitted."""

    rows: WhitenedRows
    """At the noise of the logs."""
    level: float
    """Mean indication [°/h], which is subtracted."""
    drift: float
    """Size of the drift [°/h], which the priors assume."""
    bank: Bank
    case_path: coil.Path
    followed: tuple[Array, Array]
    """Lagged temperatures and rates of the bank along the logs."""
    prior: VariancePrior
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

    @property
    def by_lag(self) -> slice:
        """Coefficients that change the static lag; before them stand those of the bank's terms,
        behind them turn-on biases and initial states.
        """
        terms = self.root.shape[0]
        return slice(terms, terms + STATIC_MEAN.size)

    def drivers(self, lag: Array) -> forward.BankDrivers:
        """Drivers of all logs in sequence for a static lag [3]."""
        temperature = forward.static_temperature(self.case_path, lag)
        return forward.log_drivers(self.bank, self.logs, temperature, self.followed)

    @cached_property
    def initial_states(self) -> Array:
        """Decays [n, 3] of an initial state since the start of each log."""
        since = np.concatenate([log.time - log.time[0] for log in self.stacked.logs])
        return np.asarray(np.exp(-since[:, None] / np.array(WARM_UP_S)), dtype=np.float64)

    @cached_property
    def starts(self) -> Array:
        """Columns [n, 4 logs] of the turn-on bias and the initial states of each log."""
        turn_on = self.stacked.level_columns
        initial = turn_on[:, :, None] * self.initial_states[:, None, :]
        return np.column_stack([turn_on, initial.reshape(len(turn_on), -1)])

    @cached_property
    def start_rows(self) -> Array:
        """Rows [m, 4 logs] of `starts`, which no static lag changes."""
        return self.rows.of(self.starts)

    def columns(self, lag: Array, slope_of: Array | None) -> Array:
        """Columns [n, P]: whitened terms, derivatives by the static lag (0 without coefficients
        [p]), turn-on biases and initial states.
        """
        drivers = self.drivers(lag)
        terms = self.bank.columns(drivers) @ self.root
        by_lag = np.zeros((len(terms), STATIC_MEAN.size))
        if slope_of is not None:
            lag_derivatives = forward.static_derivatives(self.case_path, lag, drivers.temperature)
            by_lag = lag_derivatives * self.bank.slope(slope_of, drivers)[:, None]
        return np.column_stack([terms, by_lag, self.starts])

    def at_white(self, variance: float) -> "Problem":
        """The problem at a white noise of the blocks [(°/h)²], and the usual flicker noise."""
        step = float(np.median(np.diff(self.stacked.logs[0].time)))
        # flicker noise is stated by that of a minute's mean; what is beyond it is in the error on
        # left-out ramps
        flicker = USUAL_LEVEL * float(np.sqrt(variance * step / MINUTE_S))
        return replace(self, rows=replace(self.rows, noise=BlockNoise(variance, flicker)))

    def left(self, lag: Array, columns: Array, coefficients: Array) -> Array:
        """What coefficients [P] leave of the indication [n]; derivatives by the lag are about its
        prior mean.
        """
        change = coefficients.copy()
        change[self.by_lag] += STATIC_MEAN - lag
        return self.stacked.indication - self.level - columns @ change

    def gram(self, lag: Array, columns: Array) -> Gram:
        """Moments of columns [n, P] on the rows."""
        left = self.left(lag, columns, np.zeros(columns.shape[1]))
        whitened = self.rows.of(np.column_stack([columns[:, : self.by_lag.stop], left]))
        return Gram.of(np.column_stack([whitened[:, :-1], self.start_rows]), whitened[:, -1])

    def maximise(self, lag: Array, slope_of: Array | None, start: Array | None) -> Posterior:
        """Posterior at a static lag."""
        return evidence.maximise(self.gram(lag, self.columns(lag, slope_of)), self.prior, start)


def state_problem(
    rows: WhitenedRows,
    extra: str = "",
    *,
    drift: float | None = None,
    before: Problem | None = None,
) -> Problem:
    """Problem with the terms g (table), h (hysteresis) and w (warm-up) of `extra` beside the
    others, for a drift of a size [°/h], by default that of the logs; `before` is one of the same
    logs, whose lagged temperatures it shares.
    """
    stacked = rows.stacked
    if drift is None:
        # standard deviation about the levels of the logs, without the noise
        # how large the drift is sets the scale of all priors
        about_levels = stacked.indication - stacked.level_columns @ stacked.levels
        white = rows.noise.white_variance / rows.rotation.typical
        square = float(np.mean(rows.means(about_levels[:, None]) ** 2)) - white
        drift = float(np.sqrt(max(square, LEAST_DRIFT**2 * white)))
    knots = np.zeros(0)
    if "g" in extra:
        case = np.concatenate([log.case for log in stacked.logs])
        # knots at multiples of their distance, so that logs of one gyro share them
        first, last = np.floor(case.min() / KNOT_DEGC), np.ceil(case.max() / KNOT_DEGC)
        knots = KNOT_DEGC * np.arange(first, last + 1.0)
    bank = Bank(
        LAGS_S,
        tuple(knots.tolist()),
        WIDTHS_DEGC if "h" in extra else (),
        WARM_UP_S if "w" in extra else (),
    )
    terms, lags, logs = len(bank.terms), STATIC_MEAN.size, len(stacked.logs)
    # neighbouring knots are alike: the table is sought in columns that are independent
    distances = (knots[:, None] - knots) / SMOOTH_DEGC
    correlation = np.exp(-0.5 * distances**2) + 1e-6 * np.eye(knots.size)
    root = np.eye(terms)
    root[bank.part("g"), bank.part("g")] = np.linalg.cholesky(correlation)
    # of each column: which of SIZES its variance is, and the variance relative to that size
    group = np.full(terms + lags + logs * (1 + len(WARM_UP_S)), FLAT)
    for number, (name, *_) in enumerate(SIZES):
        if len(name) == 1:
            group[bank.part(name)] = number
    group[terms : terms + lags] = len(SIZES)
    group[terms + lags :] = np.repeat([TURN_ON, INITIAL], [logs, logs * len(WARM_UP_S)])
    shape = np.ones(group.size)
    # higher powers of a smooth static part are smaller
    shape[bank.part("s")] = SHAPE ** np.arange(forward.POWERS)
    shape[terms : terms + lags] = STATIC_SPREAD**2
    # θ are the logarithms of the variances; those of b and c are relative to that of a, and the
    # spread of the static lag is known
    mixing = np.eye(len(SIZES) + 1)
    # ln v of b and c is that of a plus their own: how weights change with temperature is a
    # share of how large they are
    mixing[1:3, 0] = 1.0
    size = 2.0 * np.log(drift)
    mean = [2.0 * np.log(median) + size * (name not in "bc") for name, median, _ in SIZES]
    spread = [2.0 * sd for *_, sd in SIZES]
    prior = VariancePrior(group, shape, mixing, np.array([*mean, 0.0]), np.array([*spread, 1e-3]))
    if before is not None:
        case_path, followed = before.case_path, before.followed
    else:
        case_path = coil.path([(log.time, log.case) for log in stacked.logs])
        followed = forward.follow_lags(bank, case_path)
    return Problem(
        rows, float(np.mean(stacked.levels)), drift, bank, case_path, followed, prior, root
    )


@dataclass(frozen=True, slots=True)
class BankSolution:
    """Most likely static lag with the posterior there, and the columns [n, P] about it with their
    moments.
    """

    problem: Problem
    lag: Array
    posterior: Posterior
    columns: Array
    gram: Gram

    @property
    def parameters(self) -> int:
        """Number of parameters that no prior holds: the mean, the variances of the parts that the
        model has, and the static lag.
        """
        bank = self.problem.bank
        absent = sum(not part for part in (bank.knots, bank.widths, bank.warm_up))
        return 1 + len(SIZES) - absent + STATIC_MEAN.size

    def drift(self, coefficients: Array) -> Array:
        """Drift [n, °/h] along the logs against rest at 25 °C by coefficients [P], without the
        constant.
        """
        by_lag = self.problem.by_lag
        change = coefficients.copy()
        # the derivatives stand for a change of the lag from its prior mean
        change[by_lag] += STATIC_MEAN - self.lag
        return self.columns[:, 1 : by_lag.stop] @ change[1 : by_lag.stop]

    def change_from(self, other: "BankSolution") -> float:
        """Rms [°/h] over the logs of what the drift is more uncertain by than another solution
        states if this one is right.
        """
        drifts, variances = [], []
        for solution in (self, other):
            drift = slice(1, solution.problem.by_lag.stop)
            columns, covariance = solution.columns[:, drift], solution.posterior.covariance
            drifts.append(solution.drift(solution.posterior.coefficients))
            variances.append(np.sum(columns @ covariance[drift, drift] * columns, axis=1))
        square = np.mean((drifts[0] - drifts[1]) ** 2 + variances[0] - variances[1])
        return float(np.sqrt(max(float(square), 0.0)))

    @property
    def unsettled(self) -> bool:
        """Whether logs start away from equilibrium: initial states make the logs likelier by more
        than chance.
        """
        prior, values = self.problem.prior, []
        for size in (1.0, NEGLIGIBLE):
            theta = self.posterior.theta.copy()
            theta[INITIAL] += 2.0 * np.log(size)
            theta_prior = 0.5 * float(np.sum(((theta - prior.mean) / prior.spread) ** 2))
            values.append(evidence.condition(self.gram, prior, theta)[2] + theta_prior)
        return values[0] - values[1] > GAINED

    def with_own_start(self, predicted: Iterable[Array]) -> Iterator[Array]:
        """Predictions [rows, °/h, up to a constant] of each ramp; where logs start unsettled, with
        the initial state that its own indication shows, which no fit to other ramps knows.
        """
        if not self.unsettled:
            yield from predicted
            return
        stacked, states = self.problem.stacked, self.problem.initial_states
        variance = np.exp(self.posterior.theta[INITIAL])
        precision = np.full(1 + len(WARM_UP_S), self.problem.rows.noise.white_variance / variance)
        # what another ramp cannot know of this one: where its coil began
        precision[0] = 0.0  # the level of a ramp is free
        for rows, drift in zip(stacked.ramps, predicted, strict=True):
            columns = np.column_stack([np.ones(rows.stop - rows.start), states[rows]])
            weighted = columns * self.problem.rows.sound[rows, None]
            left = stacked.indication[rows] - drift
            information = weighted.T @ columns + np.diag(precision)
            yield drift + columns @ np.linalg.solve(information, weighted.T @ left)

    def leave_out(self, remaining_rows: Iterable[WhitenedRows]) -> Iterator[Array]:
        """Drift [n, °/h, up to a constant] of all blocks by the fit without each ramp in turn, at
        the same variances and noise.
        """
        noise, theta = self.problem.rows.noise, self.posterior.theta
        for rows in remaining_rows:
            problem = replace(self.problem, rows=replace(rows, noise=noise))
            gram = problem.gram(self.lag, self.columns)
            yield self.drift(evidence.condition(gram, problem.prior, theta)[0])

    def finish(self) -> BankModel:
        """Model in raw units, averaged over the variances of the priors."""
        problem, posterior = self.problem, self.posterior
        by_lag, logs = problem.by_lag, len(problem.stacked.logs)
        terms = slice(by_lag.start)
        mean, covariance = evidence.average(self.gram, problem.prior, posterior, POINTS)
        coefficients = problem.root @ mean[terms]
        coefficients[0] += problem.level
        static_lag = (*np.exp(self.lag[:2]).tolist(), float(self.lag[2]))
        to_raw = np.eye(by_lag.stop)
        to_raw[terms, terms] = problem.root
        to_raw[by_lag, by_lag] = np.diag([*static_lag[:2], 1.0])
        # what the logs determine of each coefficient, from 0 to 1
        prior_variances = np.exp(evidence.log_variances(problem.prior, posterior.theta))
        # effective number of coefficients (MacKay 1992): one that the prior alone holds counts 0
        determined = float(np.sum(1.0 - np.diag(posterior.covariance) / prior_variances))
        case = np.concatenate([log.case for log in problem.stacked.logs])
        fastest = problem.drivers(self.lag).rates[:, 0]
        return BankModel(
            bank=problem.bank,
            coefficients=coefficients,
            static_lag=static_lag,
            covariance=to_raw @ covariance[: by_lag.stop, : by_lag.stop] @ to_raw.T,
            valid=Valid(
                (float(case.min()), float(case.max())),
                (float(fastest.min()), float(fastest.max())),
                UNUSED,
                UNUSED,
            ),
            turn_on=mean[by_lag.stop : by_lag.stop + logs],
            turn_on_sd=float(np.exp(0.5 * posterior.theta[TURN_ON])),
            dof=max(int(problem.rows.starts.size - determined), 1),
            residual_rms=rms(problem.left(self.lag, self.columns, mean)[problem.rows.sound]),
            noise=self.problem.rows.noise,
        )


def solve(problem: Problem) -> BankSolution:
    """Static lag of the largest evidence by Gauss–Newton steps, each halved until it is larger, and
    the posterior there; white noise is what the fit leaves.
    """
    lag, posterior = _search(problem.at_white(problem.rows.noise.white_variance), STATIC_MEAN, None)
    # white noise is what the first fit leaves, flicker follows from it
    left = problem.left(lag, problem.columns(lag, None), posterior.coefficients)
    problem = problem.at_white(problem.rows.at_noise_of(left).noise.white_variance)
    lag, posterior = _search(problem, lag, posterior.theta)
    return solve_at(problem, lag, posterior.theta)


def solve_at(problem: Problem, lag: Array, start: Array) -> BankSolution:
    """Posterior at a given static lag [3], its variances sought from `start`."""
    posterior = problem.maximise(lag, None, start)
    terms = slice(problem.by_lag.start)
    columns = problem.columns(lag, problem.root @ posterior.coefficients[terms])
    gram = problem.gram(lag, columns)
    posterior = evidence.maximise(gram, problem.prior, posterior.theta)
    return BankSolution(problem, lag, posterior, columns, gram)


def _search(problem: Problem, lag: Array, start: Array | None) -> tuple[Array, Posterior]:
    """Static lag [3], sought from one, and the posterior without its derivatives."""
    terms, step = slice(problem.by_lag.start), np.zeros(STATIC_MEAN.size)
    best: tuple[float, Array, Posterior] | None = None
    for _ in range(STEPS):
        posterior = problem.maximise(lag, None, start)
        lag_deviation = (lag - STATIC_MEAN) / STATIC_SPREAD
        value = posterior.log_evidence - 0.5 * float(np.sum(lag_deviation**2))
        if best is not None and value < best[0]:
            step = step / 2.0
            if float(np.max(np.abs(step))) < CLOSE:
                break
            lag = best[1] + step
            continue
        converged = best is not None and value - best[0] < CLOSE
        best, start = (value, lag, posterior), posterior.theta
        if converged:
            break
        with_lag = problem.maximise(lag, problem.root @ posterior.coefficients[terms], start)
        implied = STATIC_MEAN + with_lag.coefficients[problem.by_lag]
        step = np.clip(implied - lag, -LARGEST_STEP, LARGEST_STEP)
        lag = lag + step
    assert best is not None  # noqa: S101 (the first evaluation sets it)
    return best[1], best[2]
