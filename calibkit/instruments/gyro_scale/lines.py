"""Straight lines of gyros in all runs about the axes of a table, and the errors of their scale
factors.

    K = P F,   V_K = P V Pᵀ

P are the published lines by least squares, V is the covariance of the indications F by equation
(1), in which each run has lines of its own, and by errors that such lines do not show: how scale
factors and zeros repeat from run to run, how mountings tilt.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.coefficients import Record
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.instruments.gyro_scale import equation, ordering
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.table_runs import TableRun

WITHIN = (
    "the scale factors hold within these runs: their u leaves out how runs repeat, and no limit on"
    ' them is decided; repeat each run, or state [[errors.component]] group = "run", effect ='
    ' "scale"'
)


def hold_within_runs(records: Iterable[Record]) -> bool:
    """Whether nothing tells how the scale factors of a run of calibkit repeat."""
    return any(flag.endswith(WITHIN) for record in records for flag in record.flags)


@dataclass(frozen=True, slots=True)
class InTime:
    """What the rates of a gyro in their order tell of time."""

    gyro: int
    lines: Mask
    """[lines], those of the gyro about its own axis at one temperature."""
    decided: ordering.Ordering


@dataclass(frozen=True, slots=True)
class TableRows:
    """Held rates of several gyros in runs about several axes."""

    rows: equation.Rows
    """Each gyro in each run is a line."""
    gyro: Integers
    """[n]."""
    axis: Integers
    """[n]."""
    gyro_of: Integers
    """[lines]."""
    axis_of: Integers
    """[lines]."""
    set_of: Integers
    """[lines], number of the set of runs at one temperature."""
    solver: Array
    """[2, lines, n], from indications to K and F0 of the published lines."""
    raw: Array
    """[n], indications as logged; those of `rows` are without what changed during the runs."""
    left_out: Array
    """[2, lines], change of K and F0 by what is too small to be seen in a run."""
    noise: Array
    """[lines], standard uncertainty of K by noise alone."""
    in_time: tuple[InTime, ...] = ()
    """Lines whose scale factor changes with time since the runs began."""

    @classmethod
    def of(
        cls,
        sets: Sequence[Sequence[tuple[int, TableRun]]],
        in_time: tuple[InTime, ...] | None = None,
    ) -> "TableRows":
        """Rows of sets of runs, each with the number of its axis; what changes with time is decided
        anew where it is not known of nearly the same runs.
        """
        parts: list[Array] = []
        lines: list[tuple[int, int, int]] = []
        every = [(s, a, run) for s, runs in enumerate(sets) for a, run in runs]
        fitted = [line for _, _, run in every for line in run.scales]
        axes = 1 + max(a for _, a, _ in every)
        for s, axis, run in every:
            for gyro, line in enumerate(run.scales):
                size, number = line.rate_dps.size, len(lines)
                whole = np.ones(size)
                held = run.plateaus
                numbers = number * whole, gyro * whole, axis * whole
                shown = held.temp_degc, held.hours, held.indication[:, gyro]
                parts.append(np.column_stack((line.rate_dps, line.indication, *shown, *numbers)))
                lines.append((gyro, axis, s))
        rate, F, degc, hours, raw, *counts = np.concatenate(parts).T
        line_of, gyro_of_row, axis_of_row = (one.astype(np.int64) for one in counts)
        channel = gyro_of_row * axes + axis_of_row
        solver = np.zeros((2, len(lines), rate.size))
        for number, line in enumerate(fitted):
            solver[:, number, line_of == number] = line.solver
        gyro_of, axis_of, set_of = np.array(lines).T
        table = cls(
            equation.Rows(rate, F, line_of, degc, hours, line_of, channel),
            gyro_of_row,
            axis_of_row,
            gyro_of,
            axis_of,
            set_of,
            solver,
            raw,
            np.array([line.left_out for line in fitted]).T,
            np.array([line.standard_uncertainty[0] for line in fitted]),
        )
        if in_time is None:
            in_time = tuple(table._find_in_time())
        return replace(table, in_time=in_time)

    def _find_in_time(self) -> Iterator[InTime]:
        """Decisions of `ordering` on the runs of each gyro about its own axis at each
        temperature.
        """
        own = self.own()
        for gyro, number in np.unique(np.column_stack((self.gyro_of, self.set_of)), axis=0):
            of_set = own & (self.gyro_of == gyro) & (self.set_of == number)
            chosen = of_set[self.rows.line]
            run = np.unique(self.rows.run[chosen], return_inverse=True)[1].reshape(-1)
            rows = equation.Rows(
                self.rows.rate_dps[chosen],
                self.raw[chosen],
                run,
                self.rows.row_degc[chosen],
                self.rows.hours[chosen],
                run,
                run,
            )
            decided = ordering.decide(rows, rows.indication)
            if decided:
                yield InTime(int(gyro), of_set, decided)

    @property
    def K(self) -> Array:  # noqa: N802 - the letter of the standards
        """Scale factors [lines]."""
        return np.asarray(self.solver[0] @ self.raw, dtype=np.float64)

    def means(self, chosen: Mask) -> Array:
        """Weights [g, a, lines] of the means over the chosen lines of each gyro and axis."""
        shape = self.gyro_of.max() + 1, self.axis_of.max() + 1, self.gyro_of.size
        weights = np.zeros(shape)
        weights[self.gyro_of, self.axis_of, np.arange(self.gyro_of.size)] = chosen
        return np.asarray(weights / np.sum(weights, axis=2, keepdims=True))

    def sensitivity(self) -> Array:
        """Mean scale factors [g, a] over all runs."""
        return np.asarray(self.means(np.ones(self.gyro_of.size, dtype=np.bool_)) @ self.K)

    def errors(self) -> Fit:
        """Equation (1), whose noise is that of the lines."""
        S = self.sensitivity()
        own = np.repeat(np.linalg.norm(S, axis=1), S.shape[1])
        shapes = (line_terms.ASYMMETRY,) if self.rows.shows_asymmetry else ()
        terms = equation.Terms(lines=self.set_of.size, shapes=shapes)
        shared = equation.shared_errors(self.rows, terms, S.ravel(), own)
        return equation.fit(self.rows, terms, [one for one in shared if one.group != "run"])

    def linear(self, errors: Fit, weights: Array, of_F0: Array) -> Fit:
        """Sums of K and F0 of the lines with weights [m, lines] each, with their errors."""
        P = np.einsum("ml,ln->mn", weights, self.solver[0])
        P += np.einsum("ml,ln->mn", of_F0, self.solver[1])
        bounds = [weights * self.left_out[0] + of_F0 * self.left_out[1]]
        shift = np.zeros(len(weights))
        for change in self.in_time:
            # a half-width that is known, as a rectangular distribution
            of_lines = weights @ change.lines
            shift += of_lines * change.decided.shift
            bounds.append(of_lines[:, None] * change.decided.half_width / np.sqrt(3.0))
        fit = errors.linear(P, self.raw)
        return replace(fit, parameters=fit.parameters + shift, bounds=np.hstack(bounds))

    def own(self) -> Mask:
        """Which lines [lines] are of gyros about the axis that they sense most."""
        most = np.argmax(np.abs(self.sensitivity()), axis=1)
        return np.asarray(most[self.gyro_of] == self.axis_of, dtype=np.bool_)

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
            noise = float(np.mean((self.noise[own] / mean) ** 2))
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

    def mounting(self, known: tuple[float, float] | None) -> Shared | None:
        """Tilts of the mounting about each axis, toward the two other ones, of a stated size [°]
        with degrees of freedom; None where it is not known.
        """
        if known is None:
            return None
        S = self.sensitivity()
        across = np.array([np.delete(S, axis, axis=1) for axis in range(S.shape[1])])
        return Shared(
            group="mounting",
            effect="angle",
            level=self.axis,
            loading=np.radians(across[self.axis, self.gyro]) * self.rows.rate_dps[:, None],
            unit="deg",
            size=known[0],
            size_dof=known[1],
        )

    def run_zero(self, gyro: int, chosen: Mask, bias: Array, noise: Array) -> Shared:
        """How the biases [lines] of a gyro differ from run to run among chosen lines, by s² as that
        of scale factors; `noise` [lines] is their u by noise.
        """
        same = chosen & (self.gyro_of == gyro)
        square = max(float(np.var(bias[same], ddof=1)), float(np.mean(noise[same] ** 2)))
        return Shared(
            group="run",
            effect="zero",
            level=np.where(same[self.rows.line], self.rows.line, -1),
            loading=np.ones((self.gyro.size, 1)),
            unit="1/s",
            size=float(np.sqrt(square)),
            size_dof=float(np.sum(same) - 1),
        )
