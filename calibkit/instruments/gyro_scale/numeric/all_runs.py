"""One model over all runs of a gyro on a rate table.

    F = K(T) Ω + F0(T) + Σ b_l p_l(Ω) + b_zero,run + Ω b_scale,run + t b_drift,run + ε

K and F0 polynomials of temperature at each held rate, p_l what the runs have in common at each rate
that they repeat, or terms of the response where not every run turns both ways, b random effects, t
the time from the middle of the run (Patterson & Thompson 1971). K and F0 are those of the best
straight line over the rates, so p_l is perpendicular to Ω and 1.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.numeric import gum
from calibkit.numeric.least_squares import components, polynomial, shared_fit
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

SCALE, ZERO = 0, 1
"""Number of the polynomial of K, and of that of F0."""
SAME_RATE = 0.01
"""Relative difference below which two held rates are one."""
TINY = 1e-6
"""Difference below which two held rates are one, relative to the largest rate."""
GRID = 9
"""Temperatures at which a polynomial's degrees of freedom are compared; the fewest are stated."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Plateaus of all runs."""

    rate_dps: Array
    """[n]."""
    indication: Array
    """[n], as logged."""
    corrected: Array
    """[n], without what time and temperature added within the runs, as single runs tell."""
    run: Integers
    """[n], number of the run of each row."""
    row_degc: Array
    """[n], NaN where it is not known."""
    hours: Array
    """[n], from the middle of the run; 0 where times are not known."""

    @property
    def temp_degc(self) -> Array:
        """Mean temperature [r] of each run."""
        return np.array(
            [float(np.mean(self.row_degc[self.run == k])) for k in range(self.run.max() + 1)]
        )

    @property
    def both_ways(self) -> bool:
        """Whether every run turned both ways."""
        return all(
            line_terms.turns_both_ways(self.rate_dps[self.run == k])
            for k in range(self.run.max() + 1)
        )

    def pattern(self) -> Array:
        """Columns [n, k] of what the runs have in common at each rate that two of them held, beside
        a straight line over the rates of all.
        """
        order = np.argsort(self.rate_dps, kind="stable")
        rate = self.rate_dps[order]
        far = np.diff(rate) > SAME_RATE * np.abs(rate[1:]) + TINY * np.max(np.abs(rate))
        level = np.empty(rate.size, dtype=np.int64)
        level[order] = np.concatenate(([0], np.cumsum(far)))
        own = (level[:, None] == np.arange(level.max() + 1)).astype(np.float64)
        shared = [k for k in range(own.shape[1]) if np.unique(self.run[level == k]).size > 1]
        line, _ = np.linalg.qr(np.column_stack((self.rate_dps, np.ones(rate.size))))
        own = own[:, shared] - line @ (line.T @ own[:, shared])
        left, spread, _ = np.linalg.svd(own, full_matrices=False)
        return np.asarray((left * spread)[:, spread > SAME_RATE], dtype=np.float64)

    def own_lines(self) -> Array:
        """Design [n, 2 r] of a line for each run: slopes, then intercepts."""
        own = (self.run[:, None] == np.arange(self.run.max() + 1)).astype(np.float64)
        return np.column_stack((own * self.rate_dps[:, None], own))


class Estimate(NamedTuple):
    """A result with its standard uncertainty and effective degrees of freedom."""

    value: float
    standard_uncertainty: float
    dof: float


@dataclass(frozen=True, slots=True)
class AllRuns:
    """The fitted model; its line is the best straight line over the rates of all runs."""

    mixed: components.MixedFit
    lines: tuple[Array, Array]
    """Matrices [order + 1, p] from the coefficients to those of K and of F0 in mapped powers of
    temperature.
    """
    middle_half: tuple[float, float]
    """Middle and half-width [°C] of the runs' temperatures."""
    hidden: float
    """Variance of F0 that the rows do not show: runs of one direction alone do not tell a bend of
    the response from F0.
    """
    shapes: tuple[str, ...]
    """Terms of the response over the rate that the residuals asked for."""

    def at(self, which: int, temp_degc: float) -> Estimate:
        """K or F0 at a temperature [°C]; any where the runs' temperatures are not known."""
        middle, half = self.middle_half
        order = len(self.lines[which]) - 1
        at = np.array([temp_degc if order else middle])
        row = polynomial.powers(at, order, middle=middle, half=half) @ self.lines[which]
        # of exact data, rounding may be below zero
        variance = max(float(gum.variance_along(row, self.mixed.covariance)[0]), 0.0)
        variance += self.hidden if which == ZERO else 0.0
        dof = float(self.mixed.effective_dof_of(row)[0])
        return Estimate(float((row @ self.mixed.coefficients)[0]), float(np.sqrt(variance)), dof)

    @property
    def orders(self) -> tuple[int, int]:
        """Orders of K and F0 over temperature."""
        return len(self.lines[SCALE]) - 1, len(self.lines[ZERO]) - 1

    @property
    def correlation(self) -> float:
        """Correlation of K and F0 at the middle temperature."""
        rows = np.array([lines[0] for lines in self.lines])
        covariance = rows @ self.mixed.covariance @ rows.T
        product = covariance[0, 0] * covariance[1, 1]
        return float(covariance[0, 1] / np.sqrt(product)) if product > 0.0 else 0.0

    def curve(self, which: int, temp_degc: Array) -> TemperaturePolynomial:
        """K or F0 over the temperatures [r] [°C] of the runs."""
        middle, half = self.middle_half
        lines = self.lines[which]
        order = len(lines) - 1
        to_raw = polynomial.to_raw_powers(middle, half, order)
        raw, covariance = polynomial.in_raw_powers(
            lines @ self.mixed.coefficients, lines @ self.mixed.covariance @ lines.T, to_raw
        )
        low, high = float(temp_degc.min()), float(temp_degc.max())
        rows = polynomial.powers(np.linspace(low, high, GRID), order, middle=middle, half=half)
        dof = self.mixed.effective_dof_of(rows @ lines)
        covariance[0, 0] += self.hidden if which == ZERO else 0.0
        return TemperaturePolynomial(
            raw, covariance, max(int(np.min(dof)), 1), self.mixed.residual_rms, (low, high)
        )


def fit(
    rows: Rows,
    orders: tuple[int, int],
    shapes: Mapping[str, Array],
    known: Mapping[str, components.Known],
    near: AllRuns | None = None,
) -> AllRuns:
    """Fit all runs.

    Parameters
    ----------
    rows : of two runs or more.
    orders : of the polynomials of K and F0 over temperature.
    shapes : terms of the response, name → [n, 1], from `own_lines`.
    known : run-to-run standard deviations that are known: "scale" [1/s/(°/s)], "zero" [1/s].
    near : fit of nearly the same rows, of the same orders, whose errors of runs are kept.

    Raises
    ------
    FitError
        Temperatures or rates that do not determine the terms.

    """
    middle, half = polynomial.middle_and_half(rows.temp_degc) if max(orders) else (0.0, 1.0)
    mapped = [
        polynomial.powers(rows.row_degc, order, middle=middle, half=half)
        if order
        else np.ones((rows.run.size, 1))
        for order in orders
    ]
    base = np.column_stack((mapped[SCALE] * rows.rate_dps[:, None], mapped[ZERO]))
    size = np.abs(rows.rate_dps)
    if rows.both_ways and np.ptp(size) > SAME_RATE * size.max():
        # what every run has of it is part of the best straight line, what differs is an error
        shapes = {line_terms.ASYMMETRY: size[:, None], **shapes}
    count = rows.run.size
    mixed = shared_fit.fit(
        np.column_stack((base, *shapes.values())),
        rows.indication,
        list(list_effects(rows, orders, known)),
        list(_candidates(rows)),
        weights=np.ones(count),
        channel=np.zeros(count, dtype=np.int64),
        used=np.ones(count, dtype=np.bool_),
        leave_out=False,
        names=_names(orders, list(shapes)),
        near=None if near is None else near.mixed,
    ).found
    lines = _lines(rows.rate_dps, orders, shapes, mixed.coefficients)
    hidden = 0.0
    if not line_terms.turns_both_ways(rows.rate_dps):
        bend = lines[ZERO][0] @ mixed.coefficients - mixed.coefficients[orders[SCALE] + 1]
        hidden = float(bend) ** 2
    return AllRuns(mixed, lines, (middle, half), hidden, tuple(shapes))


def list_effects(
    rows: Rows, orders: tuple[int, int], known: Mapping[str, components.Known]
) -> Iterator[components.Effect]:
    """What differs from run to run: scale factor, zero, and what changes during a run; and what the
    response at a rate is off the line in every run.
    """
    yield components.Effect("run", "scale", rows.run, rows.rate_dps, known.get("scale"))
    yield components.Effect("run", "zero", rows.run, np.ones(rows.run.size), known.get("zero"))
    if rows.hours.any():
        drift = known.get("zero drift")
        yield components.Effect("run", "zero drift", rows.run, rows.hours, drift)
    warmer = rows.row_degc - rows.temp_degc[rows.run]
    if not orders[SCALE] and np.isfinite(warmer).all() and warmer.any():
        yield components.Effect("run", "scale over temperature", rows.run, rows.rate_dps * warmer)
    elif rows.hours.any() and not np.isfinite(warmer).all():
        yield components.Effect("run", "scale drift", rows.run, rows.rate_dps * rows.hours)
    pattern = rows.pattern() if rows.both_ways else np.empty((rows.run.size, 0))
    if pattern.size:
        every = np.zeros_like(rows.run)
        yield components.Effect("rate", "response", every, pattern, known.get("response"))


def _candidates(rows: Rows) -> Iterator[components.Effect]:
    """Errors that are kept where the likelihood asks for them: of each side of each run."""
    if rows.both_ways:
        side = 2 * rows.run + (rows.rate_dps < 0.0)
        yield components.Effect("side", "zero", side, np.ones(rows.run.size))
        yield components.Effect("side", "scale", rows.run, np.abs(rows.rate_dps))


def _names(orders: tuple[int, int], shapes: Sequence[str]) -> list[str]:
    """Names of the coefficients."""
    letters = zip(("K", "F0"), orders, strict=True)
    return [*(f"{letter} T^{k}" for letter, order in letters for k in range(order + 1)), *shapes]


def own_lines(rows: Rows) -> tuple[dict[str, Array], Array]:
    """Terms of the response that the runs ask for, each run with its own line; K and F0 [2, r] of
    these lines.
    """
    lines, runs, shapes = rows.own_lines(), int(rows.run.max()) + 1, dict[str, Array]()
    if not rows.both_ways:
        slopes = (np.linalg.pinv(lines) @ rows.corrected)[:runs]
        size = (slopes / slopes.mean())[rows.run, None]
        bends = line_terms.shapes(rows.rate_dps)
        tried = {name: size * bend for name, bend in bends.items()}
        shapes, _ = line_terms.ask(lines, rows.corrected, tried)
    design = np.column_stack((lines, *shapes.values()))
    found = (np.linalg.pinv(design) @ rows.corrected)[: 2 * runs]
    sides = np.array([np.sign(rows.rate_dps[rows.run == k]).sum() for k in range(runs)])
    if not rows.both_ways and line_terms.turns_both_ways(sides):
        # runs of one direction each tell asymmetry from each other only
        shapes[line_terms.ASYMMETRY] = tried[line_terms.ASYMMETRY]
    return shapes, found.reshape(2, runs)


def without_sides(rows: Rows, values: Array, order: int) -> Array:
    """K or F0 of the runs' own lines [r] less what differs between runs of one direction and of the
    other, beside a polynomial of temperature.
    """
    side = np.array(
        [np.mean(np.sign(rows.rate_dps[rows.run == k])) for k in range(rows.temp_degc.size)]
    )
    if np.ptp(side) == 0.0:
        return values
    middle, half = polynomial.middle_and_half(rows.temp_degc)
    powers = polynomial.powers(rows.temp_degc, order, middle=middle, half=half or 1.0)
    found = np.linalg.lstsq(np.column_stack((powers, side)), values)[0]
    return np.asarray(values - found[-1] * side, dtype=np.float64)


def _lines(
    rate_dps: Array, orders: tuple[int, int], shapes: Mapping[str, Array], found: Array
) -> tuple[Array, Array]:
    """Matrices [order + 1, p] from the coefficients [p] to K and F0 of the best straight line; the
    slope of a bend follows temperature as K does.
    """
    count = sum(orders) + 2
    line = np.column_stack((rate_dps, np.ones_like(rate_dps)))
    bent = np.linalg.pinv(line) @ np.column_stack([np.empty((rate_dps.size, 0)), *shapes.values()])
    K, F0 = np.split(np.eye(count, count + len(shapes)), [orders[SCALE] + 1])
    K[:, count:] = np.outer(found[: len(K)] / found[0], bent[SCALE])
    F0[0, count:] = bent[ZERO]
    return K, F0
