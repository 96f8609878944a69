"""What planned runs of a rate table will tell of scale factor and zero over temperature."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import DPH_PER_DPS, REVOLUTION_DEG
from calibkit.instruments.gyro_scale.numeric import all_runs
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
STATED = (MOUNTING, ("run", "scale"), ("run", "zero"))
"""Errors that recipes can state."""


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

    def rows(self) -> all_runs.Rows:
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

    rows: all_runs.Rows
    noise_dps: Array
    """[n], noise of the mean over each hold."""

    @classmethod
    def of(
        cls, rate_dps: Array, run: Integers, degc: Array, hours: Array, noise_dps: Array
    ) -> "Holds":
        """Holds [n] of a gyro that is exact."""
        return cls(all_runs.Rows(rate_dps, rate_dps, rate_dps, run, degc, hours), noise_dps)

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

    def powers(self, degc: Array) -> Array:
        """Powers [n, order + 1] of temperatures mapped to [−1, 1]."""
        low, high = self.range_degc
        return polynomial.powers(
            degc, self.order, middle=(low + high) / 2.0, half=(high - low) / 2.0
        )

    def information(self, holds: Holds) -> Information:
        """Information on the polynomials of relative K, then those of F0 [°/s], and on the
        asymmetry of the response, with the effects of the fit.
        """
        rows = holds.rows
        powers = self.powers(rows.row_degc)
        size = np.abs(rows.rate_dps)[:, None]
        asymmetry = size if np.ptp(size) > 0.0 else np.zeros((size.size, 0))
        design = np.column_stack([powers * rows.rate_dps[:, None], powers, asymmetry])
        unit = {"scale": 1.0 / PPM}
        known = {
            effect: Known(one.value * unit.get(effect, 1.0 / DPH_PER_DPS), one.dof)
            for (group, effect), one in self.sizes.items()
            if group != MOUNTING[0]
        }
        effects = all_runs.list_effects(rows, (self.order, self.order), known)
        noise = holds.noise_dps
        weighted = [one.divided_by(noise) for one in effects]
        return find_information(design / noise[:, None], 1.0, weighted)

    def without(self, name: tuple[str, str]) -> "Model":
        """The model without an error."""
        return replace(self, sizes={key: one for key, one in self.sizes.items() if key != name})

    def constant(self) -> "Model":
        """The model of runs at one temperature, each with its own zero."""
        return replace(self.without(("run", "zero")), order=0)

    def result_slopes(self, result: str, rate_dps: Array, degc: Array | None = None) -> Array:
        """Derivatives [m, p] of a result by the coefficients, over the range of use or at
        temperatures [m] [°C], for holds at rates [n] [°/s]; the zero is that of the best straight
        line, which an asymmetry moves.
        """
        degc = np.linspace(*self.range_degc, LEVELS) if degc is None else degc
        powers = self.powers(degc)
        none = np.zeros_like(powers)
        if result == "scale factor":
            found = PPM * np.column_stack([powers, none])
        else:
            found = DPH_PER_DPS * np.column_stack([none, powers])
        size = np.abs(rate_dps)
        if np.ptp(size) > 0.0:
            line = np.column_stack([rate_dps, np.ones(size.size)])
            bent = float(np.linalg.pinv(line)[1] @ size)
            own = 0.0 if result == "scale factor" else DPH_PER_DPS * bent
            found = np.column_stack([found, np.full(len(found), own)])
        return np.asarray(found, dtype=np.float64)


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
