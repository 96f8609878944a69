"""Straight lines of gyros in all runs about the axes of a table, each run with a K and F0 of its
own, and the errors of their scale factors.

They are equation (1) with the errors within runs: noise, what the runs have in common at a rate,
what changes with time or temperature during a run, and is taken out. How scale factors and zeros
repeat from run to run, and how mountings tilt, such lines do not show: that is added by its size.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, ordering
from calibkit.instruments.gyro_scale.published import Line
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric.dispersion import rms

BETWEEN_RUNS = ("run scale", "run zero")
"""Errors that a line of each run does not show."""
DRIFTS = {
    "scale over temperature": "its scale factor by {:+.2g} ppm/°C",
    "scale drift": "its scale factor by {:+.2g} ppm/h",
    "zero drift": "its zero by {:+.2g} (°/h)/h",
}
"""Errors that change during a run and are taken out where they are seen, and what a flag says."""
BENDS = np.array([2, 3, 5, 7])
"""Powers of the rate of which the bend of a response is made that no run repeats."""
ALIKE = 0.02
"""Share of a column that a line must leave over, for the rates to tell it."""
DRIFTED = 2.0
"""Change during a run, in standard uncertainties of a held rate (both rms), from which it is
flagged.
"""


FOLLOWS = 0.2
"""Relative standard uncertainty of a scale factor from which a gyro does not follow the table."""


@dataclass(frozen=True, slots=True)
class InTime:
    """What the rates of a gyro in their order tell of time."""

    gyro: int
    lines: Mask
    """[lines], those of the gyro about its own axis at one temperature."""
    decided: ordering.Ordering


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of g gyros in runs about a axes."""

    fitted: equation.Fitted
    """Equation (1) of all held rates; each gyro in each run is a line."""
    fit: Fit
    """K [lines], then F0 [lines], of the best straight lines over all rates, then the indications
    at rest [lines].
    """
    gyro_of: Integers
    """[lines]."""
    axis_of: Integers
    """[lines]."""
    set_of: Integers
    """[lines], number of the set of runs at one temperature."""
    number: Mapping[tuple[str, str], int]
    """File and gyro → line."""
    all_published: tuple[Line, ...]
    """[lines], held rates without what changed during the runs, and the published lines."""
    in_time: tuple[InTime, ...] = ()
    """Lines whose scale factor changes with time since the runs began."""

    @classmethod
    def of(
        cls, sets: Sequence[Sequence[tuple[int, TableRun]]], near: "Lines | None" = None
    ) -> "Lines":
        """Lines of sets of runs, each with the number of its axis; `near` are those of nearly the
        same runs, of which sizes of errors and what changes with time are kept.
        """
        parts: list[Array] = []
        lines: list[tuple[int, int, int]] = []
        number: dict[tuple[str, str], int] = {}
        axes = 1 + max(axis for runs in sets for axis, _ in runs)
        for s, runs in enumerate(sets):
            for axis, run in runs:
                held = run.plateaus
                for g, gyro in enumerate(run.gyros):
                    line, ones = run.scales[g], np.ones(run.rate_dps.size)
                    of_line = line.rate_dps, line.indication, held.temp_degc, held.hours, line.noise
                    numbers = len(lines) * ones, (g * axes + axis) * ones
                    parts.append(np.column_stack((*of_line, *numbers)))
                    number[run.log.file, gyro] = len(lines)
                    lines.append((g, axis, s))
        rate, F, degc, hours, noise, *counts = np.concatenate(parts).T
        line_of, channel = (count.astype(np.int64) for count in counts)
        rows = equation.Rows(rate, F, line_of, degc, hours, line_of, channel)
        gyro_of, axis_of, set_of = np.array(lines).T
        if near:
            fitted = near.fitted.refit(rows)
            fit = replace(near.fit, parameters=_best_lines_of(fitted)(fitted.fit.parameters))
        else:
            shapes = (equation.ASYMMETRY,) * rows.shows_asymmetry
            terms = equation.Terms(lines=len(lines), shapes=shapes)
            errors = tuple(_errors(rows, terms, axes))
            fitted = equation.Fitted(equation.fit(rows, terms, errors), rows, terms)
            fit = _best_lines(fitted, errors)
        steady = F - sum(_drifts(fitted.fit).values(), np.zeros(F.size))
        each = [line_of == k for k in range(len(lines))]
        published = tuple(Line(rate[rows], steady[rows], noise[rows]) for rows in each)
        run_lines = cls(fitted, fit, gyro_of, axis_of, set_of, number, published)
        if axes == 1:
            # gyros along the one axis: the fit over all runs decides of their order in time
            return run_lines
        return replace(
            run_lines, in_time=near.in_time if near else tuple(run_lines._find_in_time())
        )

    def require_followed(self) -> None:
        """Raise FitError for a gyro that does not follow the table about its own axis."""
        own = self.own()
        for (file, gyro), number in self.number.items():
            K, u = self.K[number], self.u_K[number]
            if own[number] and not u < FOLLOWS * abs(K):
                raise FitError(
                    f"{file}: gyro {gyro} does not follow the table: its scale factor is"
                    f" {K:.3g} ± {2.0 * u:.3g} 1/deg, expected one that is known to"
                    f" {100.0 * FOLLOWS:.0f} %",
                    hint="see that [columns] names the column of this gyro, and its cable",
                )

    def _find_in_time(self) -> Iterator[InTime]:
        """Decisions of `ordering` on the runs of each gyro about its own axis at each
        temperature.
        """
        own = self.own()
        for gyro, number in np.unique(np.column_stack((self.gyro_of, self.set_of)), axis=0):
            of_set = own & (self.gyro_of == gyro) & (self.set_of == number)
            rows = self.rows.of_lines(of_set)
            decided = ordering.decide(rows, rows.indication)
            if decided:
                yield InTime(int(gyro), of_set, decided)

    @property
    def rows(self) -> equation.Rows:
        """Held rates."""
        return self.fitted.rows

    def rows_of(self, runs: Sequence[TableRun], gyro: str) -> equation.Rows:
        """Held rates of a gyro in some runs, as one line."""
        chosen = np.isin(np.arange(self.gyro_of.size), self._numbers(runs, gyro))
        rows = self.rows.of_lines(chosen)
        one_line = np.zeros_like(rows.line)
        return replace(rows, line=one_line, channel=one_line)

    def _numbers(self, runs: Sequence[TableRun], gyro: str) -> list[int]:
        """Numbers of the lines of a gyro in some runs."""
        return [self.number[run.log.file, gyro] for run in runs]

    @property
    def K(self) -> Array:  # noqa: N802 - the letter of the standards
        """Scale factors [lines]."""
        return self.fit.parameters[: self.gyro_of.size]

    @property
    def u_K(self) -> Array:  # noqa: N802 - the letter of the standards
        """Standard uncertainties [lines] of the scale factors within their runs."""
        return np.sqrt(np.diag(self.fit.total_covariance))[: self.gyro_of.size]

    def line(self, run: TableRun, gyro: str) -> Fit:
        """K, F0 and the indication at rest of a gyro in a run."""
        return self.fit.part(slice(self.number[run.log.file, gyro], None, self.gyro_of.size))

    def of_runs(self, runs: Sequence[TableRun], gyro: str) -> Value:
        """Scale factors of a gyro in r runs [r]."""
        return self.fit.part(self._numbers(runs, gyro)).of(lambda p: p)

    def published(self, run: TableRun, gyro: str) -> Line:
        """Held rates of a gyro in a run without what changed during it, and the published line."""
        return self.all_published[self.number[run.log.file, gyro]]

    def straightened(self, responses: Mapping[str, equation.Fitted | None]) -> Iterator[Line]:
        """The published line of every gyro in every run, about its own axis without the bend of its
        response.
        """
        own = self.own()
        for (_, gyro), number in self.number.items():
            line, response = self.all_published[number], responses.get(gyro)
            if response is not None and own[number]:
                rows = self.rows.of_lines(np.arange(own.size) == number)
                bend = equation.bend(response.fit.parameters, rows, response.terms)
                line = replace(line, indication=line.indication - bend)
            yield line

    def flag_drifts(self) -> Iterator[str]:
        """Flags on what drifted during a run by more than its noise, and was taken out."""
        drifts = _drifts(self.fitted.fit)
        sizes = {size.error.effect: size.errors for size in self.fitted.fit.shared}
        for (file, gyro), line in self.number.items():
            chosen = self.rows.line == line
            least = DRIFTED * rms(self.all_published[line].noise)
            changed = [
                DRIFTS[effect].format(sizes[effect][line, 0])
                for effect, added in drifts.items()
                if rms(added[chosen]) > least
            ]
            if changed:
                yield (
                    f"{file}: gyro {gyro} changed during the run, {' and '.join(changed)}: taken"
                    " out, K and F0 hold at the middle of the run and at its mean temperature"
                )

    def means(self, chosen: Mask) -> Array:
        """Weights [g, a, lines] of the means over the chosen lines of each gyro and axis."""
        shape = self.gyro_of.max() + 1, self.axis_of.max() + 1, self.gyro_of.size
        weights = np.zeros(shape)
        weights[self.gyro_of, self.axis_of, np.arange(self.gyro_of.size)] = chosen
        return np.asarray(weights / np.sum(weights, axis=2, keepdims=True))

    def sensitivity(self) -> Array:
        """Mean scale factors [g, a] over all runs."""
        return np.asarray(self.means(np.ones(self.gyro_of.size, dtype=np.bool_)) @ self.K)

    def own(self) -> Mask:
        """Which lines [lines] are of gyros about the axis that they sense most."""
        most = np.argmax(np.abs(self.sensitivity()), axis=1)
        return np.asarray(most[self.gyro_of] == self.axis_of, dtype=np.bool_)

    def combined(self, of_K: Array, of_F0: Array) -> Fit:
        """Sums of K and F0 of the lines with weights [m, lines] each."""
        weights = np.hstack((of_K, of_F0, np.zeros_like(of_K)))
        fit = self.fit.restated(lambda p: weights @ p)
        shift, bounds = np.zeros(len(weights)), [fit.bounds]
        for change in self.in_time:
            # a half-width that is known, as a rectangular distribution
            of_lines = of_K @ change.lines
            shift += of_lines * change.decided.shift
            bounds.append(of_lines[:, None] * change.decided.half_width / np.sqrt(3.0))
        return replace(fit, parameters=fit.parameters + shift, bounds=np.hstack(bounds))

    def run_scale(self, known: tuple[float, float] | None) -> Shared | None:
        """How scale factors differ from run to run: as stated [ppm] with degrees of freedom, or as
        repeated runs show; None where neither tells.

        s² = max(MS, u²), MS the mean square about the means of repeated runs, u that of noise: a
        repeatability that chance makes small keeps the degrees of freedom of the repeats.
        """
        if known is None:
            own = self.own()
            number = np.column_stack((self.gyro_of, self.set_of))[own]
            repeats = np.unique(number, axis=0, return_inverse=True)[1].reshape(-1)
            mean = (np.bincount(repeats, self.K[own]) / np.bincount(repeats))[repeats]
            dof = float(repeats.size - repeats.max() - 1)
            if not dof:
                return None
            square = float(np.sum((self.K[own] / mean - 1.0) ** 2)) / dof
            noise = float(np.mean((self.u_K[own] / mean) ** 2))
            known = float(np.sqrt(max(square, noise))) / equation.PPM, dof
        loading = (self.K[self.rows.line] * self.rows.rate_dps * equation.PPM)[:, None]
        return Shared(
            group="run",
            effect="scale",
            level=self.rows.line,
            loading=loading,
            unit="ppm",
            size=known[0],
            size_dof=known[1],
        )

    def mounting(self, across: Array, known: tuple[float, float]) -> Shared:
        """Tilts of the mounting about each axis, of a size [°] with degrees of freedom; `across`
        [g, a, k] is what a gyro indicates by each of k tilts of an axis [1/deg per rad].
        """
        gyro, axis = self.gyro_of[self.rows.line], self.axis_of[self.rows.line]
        return Shared(
            group="mounting",
            effect="angle",
            level=axis,
            loading=np.radians(across[gyro, axis]) * self.rows.rate_dps[:, None],
            unit="deg",
            size=known[0],
            size_dof=known[1],
        )

    def run_zero(self, gyro: int, chosen: Mask, bias: Value) -> Shared:
        """How the biases [lines] of a gyro differ from run to run among chosen lines, by s² as that
        of scale factors.
        """
        same = chosen & (self.gyro_of == gyro)
        square = max(float(np.var(bias.value[same], ddof=1)), float(np.mean(bias.u[same] ** 2)))
        return Shared(
            group="run",
            effect="zero",
            level=np.where(same[self.rows.line], self.rows.line, -1),
            loading=np.ones((self.rows.line.size, 1)),
            unit="1/s",
            size=float(np.sqrt(square)),
            size_dof=float(np.sum(same) - 1),
        )


def _drifts(fit: Fit) -> dict[str, Array]:
    """What each error that changes during a run added to the indications [n]."""
    return {
        size.error.effect: size.error.along(size.errors.ravel())
        for size in fit.shared
        if size.error.effect in DRIFTS
    }


def _errors(rows: equation.Rows, terms: equation.Terms, axes: int) -> Iterator[Shared]:
    """Errors of lines of gyros about so many axes, relative to K; what changes during a run is one
    where the likelihood asks for it.
    """
    line_channel = np.zeros(terms.lines, dtype=np.int64)
    line_channel[rows.line] = rows.channel
    K = np.bincount(line_channel, rows.slopes) / np.bincount(line_channel)
    own_K = np.repeat(np.linalg.norm(K.reshape(-1, axes), axis=1), axes)
    shared = [
        e for e in equation.shared_errors(rows, terms, K, own_K) if e.name not in BETWEEN_RUNS
    ]
    for error in shared:
        yield replace(error, optional=error.optional or error.effect in DRIFTS)
    if not any(error.group == "rate" for error in shared):
        # rates that no run repeats do not show what the response is at each: a bend is smooth, and
        # must not pass for a drift
        w = rows.rate_dps / np.max(np.abs(rows.rate_dps))
        line = np.linalg.qr(np.column_stack((w, np.ones_like(w))))[0]
        bend = w[:, None] ** BENDS
        yield Shared(
            group="rate",
            effect="response",
            level=rows.channel,
            loading=np.abs(K)[rows.channel, None] * (bend - line @ (line.T @ bend)),
            unit="deg/s",
            optional=True,
        )


def _best_lines_of(fitted: equation.Fitted) -> Callable[[Numbers], Numbers]:
    """Function from the parameters to K, F0 and indication at rest of each line."""
    _, rows, terms = fitted
    line = equation.best_line(terms, rows.rate_dps)
    return lambda p: np.concatenate((*line(p), terms.split(p).F0)).ravel()


def _best_lines(fitted: equation.Fitted, errors: Iterable[Shared]) -> Fit:
    """K, F0 and indication at rest of each line, with what the runs leave open."""
    fit, rows, terms = fitted
    seen_errors = {size.error.name for size in fit.shared}
    fit = fit.restated(_best_lines_of(fitted))
    unseen = [e for e in errors if e.effect in DRIFTS and e.name not in seen_errors]
    bounds = np.zeros((2, 3, terms.lines, terms.lines))
    for k in range(terms.lines):
        of_line = rows.line == k
        rate, F = rows.rate_dps[of_line], rows.indication[of_line]
        determined = rate.size >= equation.LEAST_RATES
        drifts = [error.loading[of_line, 0] for error in unseen if determined]
        bounds[0, :, k, k] = _largest_shift(rate, F, drifts)[[0, 1, 1]]
        if not equation.turns_both_ways(rate):
            # rates of one direction do not tell a bend of the response from F0
            bounds[1, 1:, k, k] = _largest_shift(rate, F, [rate**2])[1]
    return replace(fit, bounds=np.hstack((fit.bounds, *bounds.reshape(2, -1, terms.lines))))


def _largest_shift(rate_dps: Array, indication: Array, columns: Sequence[Array]) -> Array:
    """Change [2] of K and F0 of a line by one of some columns [p] beside it, the one that changes K
    most: what is too small to be seen is still there.
    """
    line = np.column_stack((rate_dps, np.ones_like(rate_dps)))
    solver = np.linalg.pinv(line)
    shift = np.zeros(2)
    for column in columns:
        across = column - line @ (solver @ column)
        if np.linalg.norm(across) > ALIKE * np.linalg.norm(column):
            by_column = (solver @ column) * (across @ indication) / (across @ across)
            shift = max(shift, by_column, key=lambda change: abs(float(change[0])))
    return shift
