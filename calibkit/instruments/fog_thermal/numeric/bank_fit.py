"""Fit of the `bank` model with random turn-on biases: Gaussian priors, their variances by evidence.

y_log(t) = ω + t_log + Σ_m i_log,m exp(−t/θ_m) + flicker + white;  the turn-on bias t_log is random
with mean 0, and i_log is a start of the coil away from equilibrium. The static lag is found by
Gauss–Newton steps; its derivatives stay among the columns, so that its uncertainty is propagated.
Results are averaged over the variances and over the flicker noise that the logs do not determine.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank as forward, evidence
from calibkit.instruments.fog_thermal.numeric.bank import Bank, BankModel
from calibkit.instruments.fog_thermal.numeric.bank_groups import Groups
from calibkit.instruments.fog_thermal.numeric.evidence import FLAT, Gram, Posterior, Prior
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.noise import Noise
from calibkit.numeric.thermal.pooled_fit import Stack
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
LEVELS = (0.0, 0.03, 0.06, 0.12, 0.25, 0.5)
"""Flicker levels that are averaged over, in white noise of a group."""
USUAL_LEVEL = 0.06
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
POINTS = np.random.default_rng(952).standard_normal((32, len(SIZES) + 1))
"""Standard normal points of the average over the variances."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Logs of a bank fit with the terms that are fitted."""

    stacked: Stack
    groups: Groups
    bank: Bank
    along: coil.Path
    followed: tuple[Array, Array]
    prior: Prior
    root: Array
    """[p, p], from whitened to raw coefficients: Cholesky factor of the table's correlation."""

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

    def moments(self, lag: Array, slope_of: Array | None) -> list[tuple[Array, Array]]:
        """Turned columns and indications of each ramp; derivatives are about the prior mean of the
        lag.
        """
        columns, p = self.columns(lag, slope_of), self.root.shape[0]
        return self.groups.turn(columns, columns[:, p : p + 3] @ (STATIC_MEAN - lag))

    def maximise(self, lag: Array, slope_of: Array | None, start: Array | None) -> Posterior:
        """Posterior at a static lag and the usual flicker noise."""
        grams = self.groups.grams(self.moments(lag, slope_of), USUAL_LEVEL)
        return evidence.maximise(_total(grams), self.prior, start)


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


def _total(grams: Sequence[Gram]) -> Gram:
    """Moments of all ramps."""
    return reduce(Gram.plus, grams)


def _table(stacked: Stack) -> tuple[tuple[float, ...], Array]:
    """Knots [°C] over the fitted temperatures, and the Cholesky factor of their correlation."""
    low, high = (pick([pick(log.case) for log in stacked.logs]) for pick in (np.min, np.max))
    first = np.floor(low / KNOT_DEGC)
    knots = KNOT_DEGC * np.arange(first, np.ceil(high / KNOT_DEGC) + 1.0)
    apart = (knots[:, None] - knots) / SMOOTH_DEGC
    factor = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-6 * np.eye(knots.size))
    return tuple(knots.tolist()), np.asarray(factor, dtype=np.float64)


def state_problem(stacked: Stack, groups: Groups, extra: str = "") -> Problem:
    """Problem with the terms g (table), h (hysteresis) and w (warm-up) of `extra` beside the
    others.
    """
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
    size = 2.0 * np.log(groups.drift)
    mean = [2.0 * np.log(median) + size * (name not in "bc") for name, median, _ in SIZES]
    spread = [2.0 * sd for *_, sd in SIZES]
    prior = Prior(np.array(group), shape, mixing, np.array([*mean, 0.0]), np.array([*spread, 1e-3]))
    root = np.eye(len(letters))
    root[bank.part("g"), bank.part("g")] = factor
    return Problem(stacked, groups, bank, along, forward.follow_lags(bank, along), prior, root)


@dataclass(frozen=True, slots=True)
class Solution:
    """Most likely static lag with the posterior there, and the moments of each ramp."""

    problem: Problem
    lag: Array
    posterior: Posterior
    grams: tuple[Gram, ...]
    turned: tuple[tuple[Array, Array], ...]

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
        own, p = self.problem, self.problem.root.shape[0] + 3
        columns = own.columns(self.lag, own.root @ self.posterior.coefficients[: p - 3])[:, 1:p]
        # the derivatives stand for a change of the lag from its prior mean
        offset = columns[:, p - 4 :] @ (STATIC_MEAN - self.lag)
        variance = np.sum(columns @ self.posterior.covariance[1:p, 1:p] * columns, axis=1)
        return columns @ self.posterior.coefficients[1:p] + offset, variance

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
        values = [
            evidence.condition(_total(self.grams), prior, theta)[2]
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
        white, variance = self._white, np.exp(self.posterior.theta[INITIAL])
        precision = np.diag([0.0, *[white / variance] * len(WARM_UP_S)])
        for rows, drift in zip(stacked.ramps, predicted, strict=True):
            columns = np.column_stack([np.ones(rows.stop - rows.start), states[rows]])
            weighted = columns * own.groups.weights[rows, None]
            left = stacked.indication[rows] - drift
            found = np.linalg.solve(weighted.T @ columns + precision, weighted.T @ left)
            yield drift + columns @ found

    def leave_out(self) -> Iterator[Array]:
        """Drift [rows, °/h, up to a constant] of each ramp by the fit to all others, at the same
        variances and noise.
        """
        own, p = self.problem, self.problem.root.shape[0] + 3
        whole = _total(self.grams)
        columns = own.columns(self.lag, own.root @ self.posterior.coefficients[: p - 3])[:, :p]
        # the derivatives stand for a change of the lag from its prior mean
        offset = columns[:, p - 3 :] @ (STATIC_MEAN - self.lag)
        for gram, rows in zip(self.grams, own.stacked.ramps, strict=True):
            found = evidence.condition(whole.minus(gram), own.prior, self.posterior.theta)[0]
            yield columns[rows] @ found[:p] + offset[rows]

    def finish(self) -> BankModel:
        """Model in raw units, averaged over the variances and the flicker noise."""
        own, p = self.problem, self.problem.root.shape[0]
        grams, found, whites, start = [], [], [], self.posterior.theta
        for level in LEVELS:
            gram = _total(own.groups.grams(self.turned, level))
            first = evidence.maximise(gram, own.prior, start)
            whites.append(evidence.noise_variance(gram, first))
            grams.append(gram.scaled(whites[-1]))
            found.append(evidence.maximise(grams[-1], own.prior, first.theta))
            start = found[-1].theta
        mean, covariance, share = evidence.average(grams, own.prior, found, POINTS)
        to_raw = np.eye(p + 3)
        to_raw[:p, :p] = own.root
        to_raw[p : p + 2, p : p + 2] = np.diag(np.exp(self.lag[:2]))
        coefficients = own.root @ mean[:p]
        coefficients[0] += own.groups.level
        drivers = own.drivers(self.lag)
        case = np.concatenate([case for _, case in own.logs])
        sizes = np.exp(0.5 * np.array([one.theta for one in found]))
        residual = own.stacked.indication - own.groups.level - own.columns(self.lag, None) @ mean
        return BankModel(
            bank=own.bank,
            coefficients=coefficients,
            static_lag=(*np.exp(self.lag[:2]).tolist(), float(self.lag[2])),
            covariance=to_raw @ covariance[: p + 3, : p + 3] @ to_raw.T,
            valid=Valid(_span(case), _span(drivers.rates[:, 0]), NOWHERE, NOWHERE),
            turn_on=mean[p + 3 : p + 3 + len(own.stacked.logs)],
            turn_on_sd=float(np.sqrt(share @ sizes[:, TURN_ON] ** 2)),
            dof=max(int(sum(g.weight.size for g in own.groups.ramps) - self._determined), 1),
            residual_rms=float(np.sqrt(np.average(residual**2, weights=own.groups.weights))),
            noise=self._noise(share * np.array(whites)),
        )

    def _noise(self, share: Array) -> Noise:
        """White variance of a block and flicker level, averaged with the share [levels] of each
        flicker level times the white variance that goes with it, in that of the fit.
        """
        level = float(np.sqrt(share @ np.square(LEVELS)))
        return Noise(self._white * float(share.sum()), level * self.problem.groups.white)

    @property
    def _white(self) -> float:
        """White variance of a block [(°/h)²]."""
        groups = self.problem.groups
        per_group = float(np.median(np.concatenate([ramp.weight for ramp in groups.ramps])))
        return groups.white**2 * per_group / float(np.median(groups.weights))


def _span(values: Array) -> Span:
    """Smallest and largest value."""
    return float(values.min()), float(values.max())


def solve(own: Problem) -> Solution:
    """Static lag of the largest evidence by Gauss–Newton steps, each halved until it is larger, and
    the posterior there; white noise is what the fit leaves.
    """
    lag, found = _search(own, STATIC_MEAN, None)
    gram = _total(own.groups.grams(own.moments(lag, None), USUAL_LEVEL))
    white = own.groups.white * evidence.noise_variance(gram, found) ** 0.5
    own = replace(own, groups=replace(own.groups, white=white))
    lag, found = _search(own, lag, found.theta)
    return solve_at(own, lag, found.theta)


def solve_at(own: Problem, lag: Array, start: Array) -> Solution:
    """Posterior at a given static lag [3], its variances sought from `start`."""
    found = own.maximise(lag, None, start)
    slope_of = own.root @ found.coefficients[: own.root.shape[0]]
    turned = own.moments(lag, slope_of)
    grams = tuple(own.groups.grams(turned, USUAL_LEVEL))
    posterior = evidence.maximise(_total(grams), own.prior, found.theta)
    return Solution(own, lag, posterior, grams, tuple(turned))


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
