"""What planned runs of a rate table will tell of scale factor and zero over temperature."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import DPH_PER_DPS, REVOLUTION_DEG
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import known_effects
from calibkit.instruments.gyro_scale import equation
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.numeric.information import Information, find_information
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Known

SETTLE_S = 6.0
"""Time of a hold [s] in which the table settles; more than a whole revolution stays."""
SPARE = 1.02
"""Share of a revolution that a slow rate is held for."""
LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
RESULTS = {"scale factor": "ppm", "zero": "deg/h"}
"""Results that a plan predicts, with their units."""
ANGLE = "angle"
ANGLES = {"scale factor": "ppm", ANGLE: "deg"}
"""Results over three table axes; an angle is that between two input axes."""
MOUNTING = ("mounting", "angle")
UNITS = {
    MOUNTING: "deg",
    ("run", "scale"): "ppm",
    ("run", "zero"): "deg/h",
    ("run", "zero drift"): "deg/h/h",
    ("rate", "response"): "deg/h",
}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""


def hold_s(rate_dps: float, shortest_s: float) -> float:
    """How long [s] a rate is held: a whole revolution at least."""
    return max(shortest_s, SETTLE_S + SPARE * REVOLUTION_DEG / abs(rate_dps))


@dataclass(frozen=True, slots=True)
class Runs:
    """Planned runs, all with the same rates."""

    rates_dps: tuple[float, ...]
    """Signed rates in the order of a run."""
    hours: Array
    """[k], middle of each hold from the middle of the run."""
    noise_dps: Array
    """[k], noise of the mean over each hold."""
    degc: tuple[int, ...]
    """Temperatures of the runs in their order."""

    def rows(self) -> equation.Rows:
        """Holds of all runs, of a gyro that is exact."""
        return self.holds().rows

    def holds(self) -> "Holds":
        """Holds of all runs with their noise."""
        runs, count = len(self.degc), len(self.rates_dps)
        run = np.repeat(np.arange(runs), count)
        return Holds.of(
            np.tile(np.array(self.rates_dps), runs),
            run,
            np.array(self.degc, dtype=np.float64)[run],
            np.tile(self.hours, runs),
            np.tile(self.noise_dps, runs),
        )


@dataclass(frozen=True, slots=True)
class Holds:
    """Planned or measured holds of several runs."""

    rows: equation.Rows
    noise_dps: Array
    """[n], noise of the mean over each hold."""

    @classmethod
    def of(
        cls, rate_dps: Array, run: Integers, degc: Array, hours: Array, noise_dps: Array
    ) -> "Holds":
        """Holds [n] of a gyro that is exact."""
        line = np.zeros_like(run)
        return cls(equation.Rows(rate_dps, rate_dps, run, degc, hours, line, line), noise_dps)

    def join(self, other: "Holds") -> "Holds":
        """These holds and those of other runs."""
        a, b = self.rows, other.rows
        return Holds.of(
            np.concatenate([a.rate_dps, b.rate_dps]),
            np.concatenate([a.run, b.run + int(a.run.max(initial=-1)) + 1]),
            np.concatenate([a.row_degc, b.row_degc]),
            np.concatenate([a.hours, b.hours]),
            np.concatenate([self.noise_dps, other.noise_dps]),
        )

    def nearest(self, degc: float, width: float) -> "Holds":
        """Holds at the temperature that is nearest to another [°C]; temperatures that differ by
        less than a width are one.
        """
        own = self.rows.row_degc
        at = own[np.argmin(np.abs(own - degc))]
        kept = np.abs(own - at) <= width
        run = np.unique(self.rows.run[kept], return_inverse=True)[1]
        return Holds.of(
            self.rows.rate_dps[kept],
            np.asarray(run),
            np.full(int(kept.sum()), at),
            self.rows.hours[kept],
            self.noise_dps[kept],
        )


@dataclass(frozen=True, slots=True)
class Model:
    """Polynomials of scale factor and zero of an order, over a range of use."""

    order: int
    range_degc: tuple[float, float]
    sizes: Mapping[tuple[str, str], Known]
    """(group, effect) → standard deviation in the units of `UNITS`."""

    def terms(self, rows: equation.Rows) -> equation.Terms:
        """Terms of the equation that is fitted to holds."""
        low, high = self.range_degc
        shapes = (line_terms.ASYMMETRY,) if np.ptp(np.abs(rows.rate_dps)) > 0.0 else ()
        orders = self.order, self.order
        return equation.Terms(1, orders, ((low + high) / 2.0, (high - low) / 2.0), shapes)

    def information(self, holds: Holds) -> Information:
        """Information on the parameters of the equation of a gyro whose scale factor is 1."""
        rows, terms = holds.rows, self.terms(holds.rows)
        design = derivative(lambda p: equation.residual(p, rows, terms), terms.start)
        noise = holds.noise_dps
        shared = equation.shared_errors(rows, terms, np.ones(1), np.ones(1))
        effects = [one.divided_by(noise) for one in known_effects(shared, self.sizes)]
        return find_information(design / noise[:, None], 1.0, effects)

    def without(self, name: tuple[str, str]) -> "Model":
        """The model without an error."""
        return replace(self, sizes={key: one for key, one in self.sizes.items() if key != name})

    def constant(self) -> "Model":
        """The model of runs at one temperature, each with its own zero."""
        return replace(self.without(("run", "zero")), order=0)

    def result_slopes(self, result: str, rows: equation.Rows, degc: Array | None = None) -> Array:
        """Derivatives [m, p] of a result by the parameters, over the range of use or at
        temperatures [m] [°C]: of the best straight line over the holds.
        """
        terms = self.terms(rows)
        degc = np.linspace(*self.range_degc, LEVELS) if degc is None else degc
        powers = polynomial.powers(terms.mapped(degc), self.order)
        line = equation.best_line(terms, rows.rate_dps)
        which, size = (
            (equation.SCALE, PPM) if result == "scale factor" else (equation.ZERO, DPH_PER_DPS)
        )
        slopes = derivative(lambda p: powers @ line(p)[which][0], terms.start)
        return np.asarray(size * slopes, dtype=np.float64)


def order_rates(rates_dps: Sequence[int], *, alternating: bool) -> tuple[float, ...]:
    """Signed rates of a run: each one both ways at once, or one side after the other."""
    if alternating:
        return tuple(float(sign * rate) for rate in rates_dps for sign in (1, -1))
    return tuple(float(sign * rate) for sign in (1, -1) for rate in rates_dps)


def spread_rates(fastest: int, count: int, *, even: bool) -> list[int]:
    """Whole rates [°/s] up to the fastest: in even steps, or from a twentieth of it in steps of one
    ratio. They span the range, so that a bend of the response shows.
    """
    slowest = fastest / count if even else max(fastest / 20.0, 1.0)
    spread = np.linspace if even else np.geomspace
    found = np.rint(spread(slowest, fastest, count)).astype(int).tolist()
    for k in range(1, count):
        found[k] = max(found[k], found[k - 1] + 1)
    return list(found)
