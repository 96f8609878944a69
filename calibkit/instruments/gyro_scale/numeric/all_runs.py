"""One model over all runs of a gyro on a rate table.

    F = K(T) (Ω + Σ a_k s_k(Ω)) + F0(T) + Ω b_scale,run + b_zero,run + ε

K and F0 polynomials of temperature, s_k terms of the response over the rate where the residuals ask
for them and not every run turns both ways, b random effects (Patterson & Thompson 1971).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.numeric import gum
from calibkit.numeric.least_squares import components, polynomial
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

SCALE, ZERO = 0, 1
"""Number of the polynomial of K, and of that of F0."""
BOTH_WAYS = 2.0
"""Range of the signs of rates of both directions."""
GRID = 9
"""Temperatures at which a polynomial's degrees of freedom are compared; the fewest are stated."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Plateaus of all runs."""

    rate_dps: Array
    """[n]."""
    indication: Array
    """[n], without what time and temperature added within the runs."""
    run: Integers
    """[n], number of the run of each row."""
    temp_degc: Array
    """[r], of each run, NaN where it is not known."""

    @property
    def both_ways(self) -> bool:
        """Whether every run turned both ways."""
        return all(
            np.ptp(np.sign(self.rate_dps[self.run == k])) == BOTH_WAYS
            for k in range(self.temp_degc.size)
        )

    def own_lines(self) -> Array:
        """Design [n, 2 r] of a line for each run: slopes, then intercepts."""
        own = (self.run[:, None] == np.arange(self.temp_degc.size)).astype(np.float64)
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
    shared: tuple[float, float]
    """Variances of K and F0 that every run repeats, which do not average out."""
    shared_dof: float
    shapes: tuple[str, ...]
    """Terms of the response over the rate that the residuals asked for."""

    def _raised(self, which: int, variance: Array, dof: Array) -> tuple[Array, Array]:
        """Variances [m] raised to what every run repeats, and their degrees of freedom."""
        variance = np.maximum(variance, 0.0)  # of exact data, rounding may be below zero
        more = np.maximum(self.shared[which] - variance, 0.0)
        total = variance + more
        spread = variance**2 / dof + more**2 / self.shared_dof
        with np.errstate(divide="ignore", invalid="ignore"):
            return total, np.where(spread > 0.0, total**2 / spread, dof)

    def at(self, which: int, temp_degc: float) -> Estimate:
        """K or F0 at a temperature [°C]; any where the runs' temperatures are not known."""
        middle, half = self.middle_half
        order = len(self.lines[which]) - 1
        at = np.array([temp_degc if order else middle])
        row = polynomial.powers(at, order, middle=middle, half=half) @ self.lines[which]
        variance, dof = self._raised(
            which,
            gum.variance_along(row, self.mixed.covariance),
            self.mixed.effective_dof_of(row),
        )
        return Estimate(
            float((row @ self.mixed.coefficients)[0]), float(np.sqrt(variance[0])), float(dof[0])
        )

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
        variance = gum.variance_along(rows @ lines, self.mixed.covariance)
        least = int(np.argmin(variance))
        total, dof = self._raised(which, variance, self.mixed.effective_dof_of(rows @ lines))
        # the curve is nowhere better known than what every run repeats
        covariance[0, 0] += total[least] - variance[least]
        return TemperaturePolynomial(
            raw, covariance, max(int(np.min(dof)), 1), self.mixed.residual_rms, (low, high)
        )


def fit(
    rows: Rows,
    orders: tuple[int, int],
    shapes: Mapping[str, Array],
    shared: tuple[float, float],
    *,
    shared_dof: float,
    known: Mapping[str, components.Known],
) -> AllRuns:
    """Fit all runs.

    Parameters
    ----------
    rows : of two runs or more.
    orders : of the polynomials of K and F0 over temperature.
    shapes : terms of the response, name → [n, 1], from `own_lines`.
    shared : variances of K and F0 that every run repeats, with `shared_dof` degrees of freedom.
    known : run-to-run standard deviations that are known: "scale" [1/s/(°/s)], "zero" [1/s].

    Raises
    ------
    FitError
        Temperatures or rates that do not determine the terms.

    """
    middle, half = polynomial.middle_and_half(rows.temp_degc) if max(orders) else (0.0, 1.0)
    mapped = [
        polynomial.powers(rows.temp_degc, order, middle=middle, half=half)[rows.run]
        if order
        else np.ones((rows.run.size, 1))
        for order in orders
    ]
    base = np.column_stack((mapped[SCALE] * rows.rate_dps[:, None], mapped[ZERO]))
    design = np.column_stack((base, *shapes.values()))
    effects = [
        components.Effect("run", "scale", rows.run, rows.rate_dps, known.get("scale")),
        components.Effect("run", "zero", rows.run, np.ones(rows.run.size), known.get("zero")),
    ]
    mixed = components.fit(design, rows.indication, effects, names=_names(orders, list(shapes)))
    lines = _lines(rows.rate_dps, orders, shapes, mixed.coefficients)
    if np.ptp(np.sign(rows.rate_dps)) < BOTH_WAYS:
        # one direction alone: nothing tells the line of the other one from a bend of the response
        bend = lines[ZERO][0] @ mixed.coefficients - mixed.coefficients[orders[SCALE] + 1]
        shared = shared[SCALE], shared[ZERO] + float(bend) ** 2
    return AllRuns(
        mixed,
        lines,
        (middle, half),
        shared,
        shared_dof,
        tuple(shapes),
    )


def _names(orders: tuple[int, int], shapes: Sequence[str]) -> list[str]:
    """Names of the coefficients."""
    letters = zip(("K", "F0"), orders, strict=True)
    return [*(f"{letter} T^{k}" for letter, order in letters for k in range(order + 1)), *shapes]


def own_lines(rows: Rows) -> tuple[dict[str, Array], Array, Array]:
    """Terms of the response that the runs ask for, each run with its own line; K and F0 [2, r] of
    these lines and their variances [2, r].
    """
    lines, runs, shapes = rows.own_lines(), rows.temp_degc.size, dict[str, Array]()
    if not rows.both_ways:
        slopes = (np.linalg.pinv(lines) @ rows.indication)[:runs]
        size = (slopes / slopes.mean())[rows.run, None]
        bends = line_terms.shapes(rows.rate_dps)
        tried = {name: size * bend for name, bend in bends.items()}
        shapes, _ = line_terms.ask(lines, rows.indication, tried)
    design = np.column_stack((lines, *shapes.values()))
    solver = np.linalg.pinv(design)
    residuals = rows.indication - design @ (solver @ rows.indication)
    variance = float(residuals @ residuals) / max(rows.run.size - design.shape[1], 1)
    found, own = (solver @ rows.indication)[: 2 * runs], np.sum(solver[: 2 * runs] ** 2, axis=1)
    sides = np.array([np.sign(rows.rate_dps[rows.run == k]).sum() for k in range(runs)])
    if not rows.both_ways and np.ptp(np.sign(sides)) == BOTH_WAYS:
        # runs of one direction each tell asymmetry from each other only
        shapes[line_terms.ASYMMETRY] = tried[line_terms.ASYMMETRY]
    return shapes, found.reshape(2, runs), variance * own.reshape(2, runs)


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
