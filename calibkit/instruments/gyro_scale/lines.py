"""Straight lines of gyros in all runs about the axes of a table, each run with a K and F0 of its
own, and the errors of their scale factors.

    F = K_r Ω + c |Ω| + F0_r + Σ_g Z_g b_g + e                     (`equation`, (1), of each run)

b are the errors within runs: what the runs have in common at a rate, and what changes with time or
temperature during a run, which is taken out. How scale factors and zeros repeat from run to run,
and how mountings tilt, such lines do not show: that is added by its size.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, ordering
from calibkit.instruments.gyro_scale.published import Line
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.dispersion import rms

DRIFTS = {
    "scale over temperature": "its scale factor by {:+.2g} ppm/°C",
    "scale drift": "its scale factor by {:+.2g} ppm/h",
    "zero drift": "its zero by {:+.2g} (°/h)/h",
}
"""Errors that change during a run and are taken out where they are seen, and what a flag says."""
FOLLOWS, POOR = 0.2, 1e-3
"""Relative standard uncertainty of a scale factor from which a gyro does not follow the table, and
from which it is known poorly.
"""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of g gyros in runs about a axes; gyro, table axis and set of runs at one temperature of
    each line [lines] are numbers.

    Attributes
    ----------
    fitted : equation (1) of all held rates; each gyro in each run is a line.
    fit : K [lines], then F0 [lines], of the best straight lines over all rates, then the
        indications at rest [lines].
    runs : in the order of the lines, each with all gyros.
    number : file and gyro → line.
    all_published : [lines], held rates without what changed during the runs, and the published
        lines.
    in_time : gyro, its lines [lines] about its own axis at one temperature, and whether their
        scale factor changes with time since the runs began.

    """

    fitted: equation.ResponseFit
    fit: Fit
    gyro_of: Integers
    axis_of: Integers
    set_of: Integers
    runs: tuple[TableRun, ...]
    number: Mapping[tuple[str, str], int]
    all_published: tuple[Line, ...]
    in_time: tuple[tuple[int, Mask, ordering.Ordering], ...] = ()

    @classmethod
    def of(
        cls,
        sets: Sequence[Sequence[tuple[int, TableRun]]],
        fits: equation.Fits | None = None,
        earlier: "Lines | None" = None,
    ) -> "Lines":
        """Lines of sets of runs, each with the number of its axis; what changes with time is that
        of `earlier` lines of nearly the same runs.
        """
        held: list[Array] = []
        lines: list[tuple[int, int, int]] = []
        number: dict[tuple[str, str], int] = {}
        all_runs = [(s, axis, run) for s, runs in enumerate(sets) for axis, run in runs]
        for s, axis, run in all_runs:
            means, rate = run.plateaus, run.rate_dps
            for g, gyro in enumerate(run.gyros):
                F, noise, line = means.indication, means.standard_uncertainty, len(lines)
                columns = rate, F[:, g], means.temp_degc, means.hours, noise[:, g]
                held.append(np.column_stack((*columns, np.full(rate.size, line))))
                number[run.log.file, gyro] = line
                lines.append((g, axis, s))
        gyro_of, axis_of, set_of = np.array(lines).T
        axes = int(axis_of.max()) + 1
        rate, F, degc, hours, noise, line_of = np.concatenate(held).T
        line_of = line_of.astype(np.int64)
        channel = (gyro_of * axes + axis_of)[line_of]
        rows = equation.RateRows(rate, F, line_of, degc, hours, line_of, channel)
        shapes = (equation.ASYMMETRY,) * rows.shows_asymmetry
        terms = equation.ResponseTerms(lines=len(lines), shapes=shapes)
        errors = [*_errors(rows, terms, axes)]
        fitted = (fits or equation.Fits()).fit("runs", rows, terms, errors)
        terms, best_line = fitted.terms, equation.best_line(fitted.terms, rate)

        def K_F0_and_rest(p: Numbers) -> Numbers:  # noqa: N802 (the letters of the form)
            return np.concatenate((*best_line(p), terms.split(p)[equation.ZERO])).ravel()

        fit = fitted.fit.restated(K_F0_and_rest)
        fit = replace(fit, bounds=np.hstack((fit.bounds, _bounds(fitted, errors))))
        steady = F - sum(_drifts(fitted.fit).values(), np.zeros(F.size))
        masks = [line_of == k for k in range(len(lines))]
        published = tuple(Line(rate[mask], steady[mask], noise[mask]) for mask in masks)
        runs = tuple(run for *_, run in all_runs)
        run_lines = cls(fitted, fit, gyro_of, axis_of, set_of, runs, number, published)
        if axes == 1:
            # gyros along the one axis: the fit over all runs decides of their order in time
            return run_lines
        if earlier:
            return replace(run_lines, in_time=earlier.in_time)
        own_axis, in_time = run_lines.own_axis_mask(), []
        for g, s in np.unique(np.column_stack((gyro_of, set_of)), axis=0).tolist():
            own_lines = own_axis & (gyro_of == g) & (set_of == s)
            own_rows = rows.of_lines(own_lines)
            decided = ordering.decide(own_rows, own_rows.indication)
            if decided:
                in_time.append((g, own_lines, decided))
        return replace(run_lines, in_time=tuple(in_time))

    def require_followed(self) -> None:
        """Raise FitError for a gyro that does not follow the table about its own axis."""
        own_axis = self.own_axis_mask()
        for (file, gyro), number in self.number.items():
            K, u = self.K[number], self.u_K[number]
            if own_axis[number] and not u < FOLLOWS * abs(K):
                raise FitError(
                    f"{file}: gyro {gyro} does not follow the table: its scale factor is"
                    f" {K:.3g} ± {2.0 * u:.3g} 1/deg, expected one that is known to"
                    f" {100.0 * FOLLOWS:.0f} %",
                    hint="see that [columns] names the column of this gyro, and its cable",
                )

    def flag_uncertain(self, bent: Collection[str]) -> Iterator[str]:
        """Flags on scale factors about the own axis that a run tells poorly: it was too slow, too
        short or too noisy. The bend of a response is no noise of the line.
        """
        own_axis = self.own_axis_mask()
        for (file, gyro), number in self.number.items():
            share = self.u_K[number] / abs(self.K[number])
            if own_axis[number] and gyro not in bent and not share < POOR:
                yield (
                    f"{file}: K of gyro {gyro} is known to {100.0 * share:.2g} % only: hold faster"
                    " rates, or hold them longer"
                )

    @property
    def rows(self) -> equation.RateRows:
        """Held rates."""
        return self.fitted.rows

    def rows_of(self, runs: Sequence[TableRun], gyro: str) -> equation.RateRows:
        """Held rates of a gyro in some runs, as one line."""
        line_mask = np.zeros(self.gyro_of.size, dtype=np.bool_)
        line_mask[[self.number[run.log.file, gyro] for run in runs]] = True
        return self.rows.of_lines(line_mask)

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

    def over_temperature(self, runs: Sequence[TableRun], gyro: str) -> tuple[Array, Array, Array]:
        """Temperatures, K and F0 [r] of a gyro in r runs."""
        places = [self.number[run.log.file, gyro] for run in runs]
        K, F0, _ = self.fit.parameters.reshape(3, -1)[:, places]
        return np.array([run.temp_degc for run in runs]), K, F0

    def of_runs(self, runs: Sequence[TableRun], gyro: str) -> Value:
        """Scale factors of a gyro in r runs [r]."""
        return self.fit.part([self.number[run.log.file, gyro] for run in runs]).of(lambda p: p)

    def published(self, run: TableRun, gyro: str) -> Line:
        """Held rates of a gyro in a run without what changed during it, and the published line."""
        return self.all_published[self.number[run.log.file, gyro]]

    def straightened(self, responses: Mapping[str, equation.ResponseFit | None]) -> Iterator[Line]:
        """The published line of every gyro in every run, about its own axis without the bend of its
        response.
        """
        own_axis = self.own_axis_mask()
        for (_, gyro), number in self.number.items():
            line, response = self.all_published[number], responses.get(gyro)
            if response is not None and own_axis[number]:
                rows = self.rows.of_lines(np.arange(own_axis.size) == number)
                bend = equation.bend(response.fit.parameters, rows, response.terms)
                line = replace(line, indication=line.indication - bend)
            yield line

    def flag_drifts(self) -> Iterator[str]:
        """Flags on what drifted during a run by more than its noise, and was taken out."""
        drifts = _drifts(self.fitted.fit)
        sizes = {size.error.effect: size.errors for size in self.fitted.fit.shared}
        for (file, gyro), line in self.number.items():
            rows = self.rows.line == line
            # changes of twice the noise of a held rate (both rms) are flagged
            least_drift = 2.0 * rms(self.all_published[line].noise)
            changed = [
                DRIFTS[effect].format(sizes[effect][line, 0])
                for effect, drift in drifts.items()
                if rms(drift[rows]) > least_drift
            ]
            if changed:
                yield (
                    f"{file}: gyro {gyro} changed during the run, {' and '.join(changed)}: taken"
                    " out, K and F0 hold at the middle of the run and at its mean temperature"
                )

    def _weights(self, line_mask: Mask | None = None) -> Array:
        """Weights [g a, lines] of the means over the lines of a mask of each gyro and axis."""
        gyros, axes = self.gyro_of.max() + 1, self.axis_of.max() + 1
        weights = np.zeros((gyros * axes, self.gyro_of.size))
        lines = np.arange(self.gyro_of.size)
        weights[self.gyro_of * axes + self.axis_of, lines] = 1.0 if line_mask is None else line_mask
        return np.asarray(weights / np.sum(weights, axis=1, keepdims=True))

    def sensitivity(self, line_mask: Mask | None = None) -> Array:
        """Mean scale factors [g, a] over the lines of a mask, without one over all."""
        return np.asarray((self._weights(line_mask) @ self.K).reshape(self.gyro_of.max() + 1, -1))

    def own_axis_mask(self) -> Mask:
        """Which lines [lines] are of gyros about the axis that they sense most."""
        main_axis = np.argmax(np.abs(self.sensitivity()), axis=1)
        return np.asarray(main_axis[self.gyro_of] == self.axis_of, dtype=np.bool_)

    def mean_lines(self, line_mask: Mask | None = None) -> Fit:
        """K [g a], then F0 [g a], of each gyro about each axis: means over the lines of a mask, or
        all; K of what changes with time at the end of the runs.
        """
        weights = self._weights(line_mask)
        unused = np.zeros_like(weights)
        of_K_and_F0 = np.block([[weights, unused, unused], [unused, weights, unused]])
        fit = self.fit.combined(of_K_and_F0)
        shift, bounds = np.zeros(len(fit.parameters)), [fit.bounds]
        for _, lines, decided in self.in_time:
            of_lines = np.concatenate((weights @ lines, unused @ lines))
            shift += of_lines * decided.shift
            # a half-width that is known, as a rectangular distribution
            bounds.append(of_lines[:, None] * decided.half_width / np.sqrt(3.0))
        return replace(fit, parameters=fit.parameters + shift, bounds=np.hstack(bounds))

    def run_scale(self, size_and_dof: tuple[float, float] | None) -> Shared | None:
        """How scale factors differ from run to run: as stated [ppm] with degrees of freedom, or as
        repeated runs show; None where neither tells.

        s² = max(MS, u²), MS the mean square about the means of repeated runs, u that of noise: a
        repeatability that chance makes small keeps the degrees of freedom of the repeats.
        """
        if size_and_dof is None:
            own_axis = self.own_axis_mask()
            of_gyro_and_set = np.column_stack((self.gyro_of, self.set_of))[own_axis]
            repeats = np.unique(of_gyro_and_set, axis=0, return_inverse=True)[1].reshape(-1)
            # about the axis that the gyro senses: across it, r K cos α drowns in the mounting
            mean = (np.bincount(repeats, self.K[own_axis]) / np.bincount(repeats))[repeats]
            dof = float(repeats.size - repeats.max() - 1)
            if not dof:
                return None
            square = float(np.sum((self.K[own_axis] / mean - 1.0) ** 2)) / dof
            noise = float(np.mean((self.u_K[own_axis] / mean) ** 2))
            size_and_dof = float(np.sqrt(max(square, noise))) / equation.ONE_PPM, dof
        return Shared(
            group="run",
            effect="scale",
            level=self.rows.line,
            loading=(self.K[self.rows.line] * self.rows.rate_dps * equation.ONE_PPM)[:, None],
            unit="ppm",
            size=size_and_dof[0],
            size_dof=size_and_dof[1],
        )

    def mounting(self, tilt_response: Array, size_and_dof: tuple[float, float]) -> Shared:
        """Tilts of the mounting about each axis, of a size [°] with degrees of freedom.

        `tilt_response` [g, a, k] is what a gyro indicates by each of k tilts of an axis [1/deg per
        rad].
        """
        gyro, axis = self.gyro_of[self.rows.line], self.axis_of[self.rows.line]
        return Shared(
            group="mounting",
            effect="angle",
            level=axis,
            loading=np.radians(tilt_response[gyro, axis]) * self.rows.rate_dps[:, None],
            unit="deg",
            size=size_and_dof[0],
            size_dof=size_and_dof[1],
        )

    def run_zeros(self, line_mask: Mask, vertical_dps: float) -> Iterator[Shared]:
        """How the biases F0 − K ω of each gyro differ from run to run among the lines of a mask, by
        s² as that of scale factors; ω is the earth's rate about the table's axis [°/s].
        """
        count = self.gyro_of.size
        # bias F0 - K ω sin φ of each line, the earth's rate about the vertical taken out
        G = np.hstack((-vertical_dps * np.eye(count), np.eye(count), np.zeros((count, count))))
        bias = G @ self.fit.parameters
        variance = np.einsum("ip,pq,iq->i", G, self.fit.total_covariance, G)
        for gyro in range(self.gyro_of.max() + 1):
            gyro_mask = line_mask & (self.gyro_of == gyro)
            square = max(
                float(np.var(bias[gyro_mask], ddof=1)), float(np.mean(variance[gyro_mask]))
            )
            yield Shared(
                group="run",
                effect="zero",
                level=np.where(gyro_mask[self.rows.line], self.rows.line, -1),
                loading=np.ones((self.rows.line.size, 1)),
                unit="1/s",
                size=float(np.sqrt(square)),
                size_dof=float(np.sum(gyro_mask) - 1),
            )


def _drifts(fit: Fit) -> dict[str, Array]:
    """What each error that changes during a run added to the indications [n]."""
    return {
        size.error.effect: size.error.along(size.errors.ravel())
        for size in fit.shared
        if size.error.effect in DRIFTS
    }


def _errors(rows: equation.RateRows, terms: equation.ResponseTerms, axes: int) -> Iterator[Shared]:
    """Errors of lines of gyros about so many axes, relative to K; what changes during a run is one
    where the likelihood asks for it.
    """
    line_channel = np.zeros(terms.lines, dtype=np.int64)
    line_channel[rows.line] = rows.channel
    K = np.bincount(line_channel, rows.slopes) / np.bincount(line_channel)
    of_gyros = K.reshape(-1, axes)
    main_axis = np.argmax(np.abs(of_gyros), axis=1)
    # the own scale factor has the sign of the largest, as counts may fall with the rate
    sign = np.sign(of_gyros[np.arange(len(of_gyros)), main_axis])
    own_K = np.repeat(sign * np.linalg.norm(of_gyros, axis=1), axes)
    repeated = False
    for error in equation.shared_errors(rows, terms, K, own_K):
        repeated |= error.group == "rate"
        # how runs differ, a line of each run does not show
        if error.group != "run" or error.effect not in ("scale", "zero"):
            yield replace(error, optional=error.optional or error.effect in DRIFTS)
    if not repeated:
        # rates that no run repeats do not show what the response is at each: a bend is smooth, and
        # must not pass for a drift
        w = rows.rate_dps / np.max(np.abs(rows.rate_dps))
        line = np.linalg.qr(np.column_stack((w, np.ones_like(w))))[0]
        bend = w[:, None] ** [2, 3, 5, 7]
        yield Shared(
            group="rate",
            effect="response",
            level=rows.channel,
            loading=np.abs(K)[rows.channel, None] * (bend - line @ (line.T @ bend)),
            unit="deg/s",
            optional=True,
        )


def _bounds(fitted: equation.ResponseFit, errors: Sequence[Shared]) -> Array:
    """What the runs leave open of K, F0 and indication at rest of each line [3 lines, 2 lines]:
    what is too small to be seen is still there.
    """
    fit, rows, terms = fitted
    seen_names = {size.error.name for size in fit.shared}
    unseen = [e for e in errors if e.effect in DRIFTS and e.name not in seen_names]
    bounds = np.zeros((2, 3, terms.lines, terms.lines))
    for k in range(terms.lines):
        of_line = rows.line == k
        rate, F = rows.rate_dps[of_line], rows.indication[of_line]
        line = np.column_stack((rate, np.ones_like(rate)))
        solver = np.linalg.pinv(line)

        def shift_by(
            column: Array, F: Array = F, line: Array = line, solver: Array = solver
        ) -> Array:
            """Change [2] of K and F0 by a column beside the line, where the rates tell it."""
            residual = column - line @ (solver @ column)
            # the rates do not tell a column of which a line leaves no 2 %
            if np.linalg.norm(residual) <= 0.02 * np.linalg.norm(column):
                return np.zeros(2)
            return (solver @ column) * (residual @ F) / (residual @ residual)

        if rate.size >= equation.LEAST_RATES:
            # of several drifts the one that changes K most
            shifts = [np.zeros(2), *(shift_by(error.loading[of_line, 0]) for error in unseen)]
            largest = max(shifts, key=lambda shift: abs(float(shift[0])))
            bounds[0, :, k, k] = largest[[0, 1, 1]]
        if not equation.turns_both_ways(rate):
            # rates of one direction do not tell a bend of the response from F0
            bounds[1, 1:, k, k] = shift_by(rate**2)[1]
    return np.hstack([*bounds.reshape(2, -1, terms.lines)])
