"""Campaigns of gyros on a rate table: which rates at which temperatures, about which axes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import combinations, product, starmap
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS, REVOLUTION_DEG
from calibkit.errors import FitError, UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.solve import predict
from calibkit.instruments.gyro_scale import equation, forms, simulate_rate_table, table_runs
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.assumptions import (
    EARLIER_DOF,
    Assumed,
    assume,
    read_earlier,
    read_sizes,
    seen_errors,
)
from calibkit.planning.levels import (
    LEVELS,
    ONE_LEVEL_DEGC,
    Tour,
    choose_some,
    cover_range,
    list_tours,
    order_there_and_back,
)
from calibkit.planning.proposal import WITHHELD, Coefficient, Design, count
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, join, split_variance, whole
from calibkit.recipe.tables import ErrorComponent
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe, RateTableRecipe
    from calibkit.planning.assumptions import Units
    from calibkit.planning.equipment import RateTable
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule

RANGE_DEGC = (-40.0, 60.0)
MORE_LEVELS = 3
"""Temperatures that the search takes at most beyond one more than the order needs."""
REPEATS = (1, 2, 3)
"""Runs at the reference temperature."""
USUAL_RATES, USUAL_HOLD_S = 11, 30.0
"""Rates of the usual campaign and how long each is held."""
SETTLE_S = 6.0
"""Time of a hold [s] in which the table settles; more than a whole revolution stays."""
SPARE = 1.02
"""Share of a revolution that a slow rate is held for."""
START_S = 3.0
"""Time of a log before the table turns."""
SCALE, ZERO, ANGLE = "scale factor", "zero", "angle"
RESULTS = {SCALE: "ppm", ZERO: "deg/h"}
ANGLES = {SCALE: "ppm", ANGLE: "deg"}
"""Results over three table axes; an angle is that between two input axes."""
MOUNTING = "mounting", "angle"
RUN_SCALE, RUN_ZERO, RESPONSE = ("run", "scale"), ("run", "zero"), ("rate", "response")
UNITS = {
    MOUNTING: "deg",
    RUN_SCALE: "ppm",
    RUN_ZERO: "deg/h",
    ("run", "zero drift"): "deg/h/h",
    RESPONSE: "deg/h",
}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""
OFF_LINE = "linearity_error_rms."
"""Figures of what held rates are off the line of their run begin with this [°/s]."""
ACROSS = 0.1
"""Scale factor, relative to the largest, below which a gyro was turned across its axis alone."""
MOUNTED_RAD = 3e-3
"""Standard deviation of the angles of simulated input axes to those of their base."""
DEG_PER_PPM = float(np.degrees(1.0 / PPM))


@dataclass(frozen=True, slots=True)
class Holds:
    """Planned or measured holds [n] of several runs."""

    rate_dps: Array
    run: Integers
    degc: Array
    hours: Array
    """From the middle of the run."""
    noise: Array
    """Of the mean over each hold [°/s]."""

    @classmethod
    def of_runs(
        cls, rates_dps: Sequence[float], hours: Array, noise: Array, degc: Sequence[float]
    ) -> Holds:
        """Runs at temperatures [°C] in their order, all with the same signed rates."""
        runs = len(degc)
        run = np.repeat(np.arange(runs), len(rates_dps))
        level = np.array(degc, dtype=np.float64)[run]
        return cls(np.tile(rates_dps, runs), run, level, np.tile(hours, runs), np.tile(noise, runs))

    @property
    def rows(self) -> equation.Rows:
        """Rows of the fit, of a gyro whose scale factor is 1."""
        line = np.zeros_like(self.run)
        return equation.Rows(
            self.rate_dps, self.rate_dps, self.run, self.degc, self.hours, line, line
        )

    def nearest(self, degc: float) -> Holds:
        """Holds at the temperature that is nearest to another [°C]."""
        at = self.degc[np.argmin(np.abs(self.degc - degc))]
        kept = np.abs(self.degc - at) <= ONE_LEVEL_DEGC
        run = np.asarray(np.unique(self.run[kept], return_inverse=True)[1])
        level = np.full(run.size, at)
        return Holds(self.rate_dps[kept], run, level, self.hours[kept], self.noise[kept])


@dataclass(frozen=True, slots=True)
class Run:
    """What all runs of a design have in common."""

    rates_dps: tuple[int, ...]
    """Unsigned."""
    shortest_s: float
    """Shortest hold."""
    alternating: bool
    """Whether each rate is held both ways at once, or one side after the other."""

    def holds(self, acceleration_dps2: float) -> list[tuple[float, float, float]]:
        """Signed rate [°/s], start and length [s] of each hold: a whole revolution at least."""
        if self.alternating:
            signed = [float(sign * rate) for rate in self.rates_dps for sign in (1, -1)]
        else:
            signed = [float(sign * rate) for sign in (1, -1) for rate in self.rates_dps]
        now, before, holds = START_S, 0.0, []
        for rate in signed:
            now += abs(rate - before) / acceleration_dps2
            length = max(self.shortest_s, SETTLE_S + SPARE * REVOLUTION_DEG / abs(rate))
            holds.append((rate, now, length))
            now, before = now + length, rate
        return holds


NO_RUN = Run((), 0.0, alternating=True)


@dataclass(frozen=True)
class GyroBench(Bench):
    """Campaigns of gyros that are turned about one table axis, or about three."""

    table: RateTable
    reference_degc: float
    order: int
    """Of the polynomials of scale factor and zero."""
    axes: tuple[str, ...]
    """Table axes about which the base is turned, one mounting each; what is measured already is by
    axis.
    """

    def lines(
        self,
        holds: Holds,
        degc: Array | None = None,
        without: Sequence[tuple[str, str]] = (),
    ) -> dict[str, Sources]:
        """Variance of scale factor [ppm²] and zero [(°/h)²] about one axis, at temperatures [m]
        [°C] or over the range of use, beside some of the errors: of the best straight line over
        the holds.
        """
        rows, (low, high) = holds.rows, self.assumed.range_degc
        degc = np.linspace(low, high, LEVELS) if degc is None else degc
        shapes = (line_terms.ASYMMETRY,) if np.ptp(np.abs(rows.rate_dps)) > 0.0 else ()
        middle_half = (low + high) / 2.0, max(high - low, 1.0) / 2.0
        terms = equation.Terms(1, (self.order,) * 2, middle_half, shapes)
        # of temperatures that change within runs a plan knows nothing
        known = UNITS.keys() - set(without)
        listed = equation.shared_errors(rows, terms, np.ones(1), np.ones(1))
        fit = predict(
            partial(equation.residual, rows=rows, terms=terms),
            terms.start,
            self.assumed.state(one for one in listed if (one.group, one.effect) in known),
            noise=holds.noise,
            names=terms.names,
        )
        powers = polynomial.powers(terms.mapped(degc), self.order)
        line = equation.best_line(terms, rows.rate_dps)
        scale, zero = derivative(
            lambda p: np.stack([powers @ part[0] for part in line(p)]), terms.start
        )
        return {
            SCALE: split_variance(fit, PPM * scale),
            ZERO: split_variance(fit, DPH_PER_DPS * zero),
        }

    def results_of(
        self, campaign: Iterable[Holds], degc: Array | None = None
    ) -> dict[str, Sources]:
        """Variances of each result, of the axis that is known worst. An angle between two gyros is
        what each shows about the axis of the other, where no scale factor matters.
        """
        # axes that are held alike once
        single = {id(holds): holds for holds in campaign}.values()
        lines = [self.lines(holds, degc) for holds in single]
        worst = {name: max((line[name] for line in lines), key=_mean) for name in RESULTS}
        if ANGLE not in self.results:
            return worst
        across = [self.lines(holds, degc, [RUN_SCALE])[SCALE] for holds in single]
        a, b = (sorted(across, key=_mean) * 2)[-2:]
        none = np.zeros_like(whole(a))
        in_deg = {
            source: DEG_PER_PPM**2 * (a.get(source, none) + b.get(source, none)) for source in a | b
        }
        mounted = np.full_like(none, 2.0 * self.assumed.size(*MOUNTING) ** 2)
        return {SCALE: worst[SCALE], ANGLE: in_deg | {"angle of the mounting": mounted}}

    def variances(self, design: Design) -> dict[str, Sources]:
        """Variances of each result."""
        return self.results_of(self.campaign(design).values())

    def covers(self, design: Design) -> bool:
        """Whether the runs about every axis reach both ends of the range, with a temperature more
        than the order needs.
        """
        return all(
            cover_range(holds.rows.temp_degc, self.order + 2, self.assumed.range_degc)
            for holds in self.campaign(design).values()
        )

    def campaign(self, design: Design) -> dict[str, Holds]:
        """Table axis → what is measured about it already, and holds of a design; FitError for an
        axis without any.
        """
        campaign, planned = dict(self.have), dict[Tour, Holds]()
        run, tours = design.rows or (NO_RUN, {})
        for axis, degc in tours.items():
            if degc not in planned:
                planned[degc] = self.planned_holds(run, degc)
            parts = [campaign[axis]] if axis in campaign else []
            campaign[axis] = join(*parts, planned[degc])
        missing = [axis for axis in self.axes if axis not in campaign]
        if missing:
            raise FitError(f"no run about {', '.join(missing)}", hint="plan without --have")
        return campaign

    def planned_holds(self, run: Run, degc: Sequence[int]) -> Holds:
        """Holds of runs as the fit will see them: means over whole revolutions."""
        rates, start, length = np.array(run.holds(self.table.acceleration_dps2)).T
        turn_s = REVOLUTION_DEG / np.abs(rates)
        used_s = np.floor((length - 1.0) / turn_s) * turn_s
        hours = (start + length / 2.0 - (start[-1] + length[-1]) / 2.0) / 3600.0
        noise = self.assumed.noise * np.sqrt(self.assumed.device.noise_s / used_s)
        return Holds.of_runs(rates.tolist(), hours, noise, degc)

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """At the reference temperature: K and F0 of each gyro; over three axes the angles between
        them, which are those of the runs at that temperature alone.
        """
        campaign, at = self.campaign(design).values(), np.array([self.reference_degc])
        if ANGLE in self.results:
            near = [holds.nearest(self.reference_degc) for holds in campaign]
            parts = replace(self, order=0).results_of(near, at)[ANGLE]
            for a, b in combinations(self.spec.gyros, 2):
                name = f"orthogonality_error_deg.{a}_{b}"
                yield Coefficient("triad", name, "deg", float(np.sqrt(whole(parts))[0]))
            return
        u = {name: float(np.sqrt(whole(p)[0])) for name, p in self.results_of(campaign, at).items()}
        for gyro, (letter, name) in product(self.spec.gyros, (("K", SCALE), ("F0", ZERO))):
            yield Coefficient(f"gyro_{gyro}", letter, RESULTS[name], u[name])

    def passed_on(self, design: Design) -> list[ErrorComponent]:  # noqa: ARG002 (as every bench's)
        """Errors that a recipe of these gyros can state."""
        known = self.spec.component_units
        return [one for one in self.assumed.components if (one.group, one.effect) in known]

    def design(self, run: Run, degc: Tour, label: str = "") -> Design:
        """Runs at temperatures in their order, about each axis."""
        tours = self.tours(degc)
        clock = Clock(self.task.equipment)
        for number, (axis, tour) in enumerate(tours.items()):
            if number:
                clock.remount(self.task.equipment.fastest(self.assumed.device))
            for level, log in self.runs_about(axis, tour):
                clock.settle(self.assumed.device, level)
                begin = clock.now_s
                for signed, start, length in run.holds(self.table.acceleration_dps2):
                    clock.move(begin + start - clock.now_s)
                    clock.rate(signed, length, log)
        files = {axis: self.name_logs(axis) for axis in tours}
        single = self.planned_holds(run, (0,))
        settings = {
            "hold_s": run.shortest_s,
            "order": self.order,
            "rates_dps": single.rate_dps.tolist(),
            "middle_h": single.hours.tolist(),
            "noise_dps": single.noise.tolist(),
            "temperatures_degc": list(tours.get(self.axes[0], ())),
        }
        # about all axes alike, or what each lacks
        alike = len({*tours.values()}) == 1 and len(tours) == len(self.axes)
        number = len(degc) if alike else sum(map(len, tours.values()))
        levels = len({level for tour in tours.values() for level in tour})
        axes = f", about {len(tours)} {'axis' if len(tours) == 1 else 'axes'}"
        label = label or (
            f"{len(run.rates_dps)} rates both ways, {count(number, 'run')} at"
            f" {count(levels, 'temperature')}, holds of {run.shortest_s:g} s"
            f"{axes if len(self.axes) > 1 else ''}"
        )
        return Design(
            *(label, clock.schedule(), tuple(files.values()), (run, tours)),
            *(settings, self.changes(files)),
        )

    def tours(self, degc: Tour) -> dict[str, Tour]:
        """Table axis → temperatures of its runs: those that were measured about other axes but not
        about this one, and those of a design.
        """
        tours = {}
        for axis in self.axes:
            lacking = [level for level in self.lacking(axis) if level not in degc]
            if lacking or degc:
                tours[axis] = (*lacking, *degc)
        return tours

    def runs_about(self, axis: str, tour: Tour) -> list[tuple[int, str]]:
        """Temperature and log of each run about an axis; where nothing is withheld yet, with one
        between the two first temperatures that is.
        """
        stem = self.stem(axis)
        runs = [(level, f"{stem}_{k + 1:02d}_{level}.csv") for k, level in enumerate(tour)]
        if not self.task.withheld:
            known = sorted({*tour, *map(round, self.measured(axis))})
            between = round((known[0] + known[1]) / 2.0) if len(known) > 1 else known[0]
            runs.insert(1, (between, f"{WITHHELD}{stem}_{between}.csv"))
        return runs

    def stem(self, axis: str) -> str:
        """What the names of the logs about an axis begin with."""
        return self.task.name_log(f"about_{axis}" if axis else "run")

    def name_logs(self, axis: str) -> str:
        """Logs about an axis, as a recipe lists them."""
        return f"{self.stem(axis)}_*.csv"

    def changes(self, files: Mapping[str, str]) -> dict[str, Any]:
        """Keys of the recipe that name the logs about each axis."""
        if not isinstance(self.spec, GyroTriadRecipe):
            return {}
        axes = {axis: [file] for axis, file in files.items()}
        for axis, before in self.spec.axes if self.task.have else ():
            axes[axis] = [*before, *axes.get(axis, ())]
        return {"axes": axes}

    def measured(self, *axes: str) -> list[float]:
        """Temperatures [°C] of the runs about some axes."""
        return [t for axis in axes if axis in self.have for t in self.have[axis].rows.temp_degc]

    def lacking(self, axis: str) -> Tour:
        """Temperatures [°C] that were measured about other axes, but not about this one."""
        there, lacking = self.measured(axis), list[int]()
        for degc in sorted(self.measured(*self.axes)):
            if all(abs(degc - other) > ONE_LEVEL_DEGC for other in (*there, *lacking)):
                lacking.append(round(degc))
        return tuple(lacking)

    def runs(self, rates: int) -> Iterator[Run]:
        """Runs of a number of rates."""
        fastest = int(self.table.fastest_dps)
        ladders = {spread_rates(fastest, rates, even=even) for even in (True, False)}
        return starmap(Run, product(sorted(ladders), self.assumed.device.dwell_s, (True, False)))

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Campaigns of all numbers of temperatures; beside what is measured, those of the
        temperatures that it lacks.
        """

        def tours_of(levels: list[int]) -> Iterator[Tour]:
            for repeats in REPEATS:
                tour = self.order_temperatures(levels, repeats)
                yield from sorted(self.additions(tour)) if self.have else (tour,)

        sized = list_tours(self.order, MORE_LEVELS, self.assumed.range_degc, tours_of)
        runs = [run for rates in self.table.rates for run in self.runs(rates)]
        return {
            size: (self.design(run, degc) for degc, run in product(tours, runs))
            for size, tours in sized.items()
        }

    def additions(self, tour: Tour) -> Iterator[Tour]:
        """Temperatures that runs may be added at: none beside what an axis lacks, up to three that
        are not measured, all of a whole campaign, or the reference again.
        """
        there = self.measured(*self.axes)
        absent = tuple(
            level
            for level in dict.fromkeys(tour)
            if all(abs(level - other) > ONE_LEVEL_DEGC for other in there)
        )
        if any(map(self.lacking, self.axes)):
            yield ()
        yield tour
        yield (round(self.reference_degc),)
        yield from choose_some(absent)
        if absent:
            yield absent

    def order_temperatures(self, spaced: Sequence[int], repeats: int) -> Tour:
        """Temperatures in their order: every second one on the way back to the first, and further
        runs where the reference temperature is passed.
        """
        levels, reference = list(spaced), round(self.reference_degc)
        # the level nearest to the reference is the reference; the ends of the range stay
        nearest = min(range(1, len(levels) - 1), key=lambda k: abs(levels[k] - reference))
        if levels[0] < reference < levels[-1]:
            levels[nearest] = reference
        order = order_there_and_back(levels)
        at = order.index(levels[nearest])
        return (*order[:at], *([levels[nearest]] * repeats), *order[at + 1 :])

    def usual(self) -> Iterator[Design]:
        """Three runs at the reference temperature, one at each of others, from low to high."""
        low, high = self.assumed.range_degc
        reference = round(self.reference_degc)
        levels = sorted({round(low), round((low + reference) / 2.0), round(high)})
        degc = (reference, reference, reference, *levels)
        if self.order + 1 <= len(set(degc)):
            yield self.design(self.usual_run(), degc, label="usual: 11 rates, 3 + 3 runs")

    def usual_run(self) -> Run:
        """Eleven rates, one side after the other."""
        rates = spread_rates(int(self.table.fastest_dps), USUAL_RATES, even=False)
        return Run(rates, USUAL_HOLD_S, alternating=False)


def _mean(sources: Sources) -> float:
    """Mean variance."""
    return float(np.mean(whole(sources)))


def spread_rates(fastest: int, number: int, *, even: bool) -> tuple[int, ...]:
    """Whole rates [°/s] up to the fastest: in even steps, or from a twentieth of it in steps of one
    ratio. They span the range, so that a bend of the response shows.
    """
    slowest = fastest / number if even else max(fastest / 20.0, 1.0)
    spread = np.linspace if even else np.geomspace
    rates = np.rint(spread(slowest, fastest, number)).astype(int).tolist()
    for k in range(1, number):
        rates[k] = max(rates[k], rates[k - 1] + 1)
    return tuple(rates)


def prepare_plan(spec: RateTableRecipe | GyroTriadRecipe, task: Task) -> GyroBench:
    """What the search needs; UsageError for what cannot be planned."""
    assumed, table = assume_on_table(spec, task, UNITS, RANGE_DEGC)
    reference = float(np.clip(spec.reference_temp_degc, *assumed.range_degc))
    axes = forms.AXES if isinstance(spec, GyroTriadRecipe) else ("",)
    have = measure_runs(spec, task, assumed)
    results = RESULTS if len(axes) == 1 else ANGLES
    order = assumed.device.order
    return GyroBench(spec, task, assumed, results, have, table, reference, order, axes)


def assume_on_table(
    spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe,
    task: Task,
    units: Units,
    default_degc: tuple[float, float] | None,
) -> tuple[Assumed, RateTable]:
    """Assumptions of a plan with a rate table: of an earlier run the shared errors that were seen,
    and the response at a rate, with the noise of the holds in it.

    Raises UsageError for equipment without a rate table, and for a run of no gyro on one.
    """
    device, table = task.equipment.known_device(spec.procedure, "deg/s"), task.equipment.rate_table
    if table is None:
        raise UsageError(
            "a plan of gyros needs [rate_table] in the equipment file",
            hint="see calibkit plan --print-equipment",
        )
    group, effect = RESPONSE
    records = read_earlier(task, "rate_table, gyro_triad or gyro_pair", forms.SCALE_FILE)
    earlier = [one for one in seen_errors(records) if (one.group, one.effect) != RESPONSE]
    for record in records:
        off = [one.value for one in record.figures if one.name.startswith(OFF_LINE)]
        value = rms(off) * DPH_PER_DPS
        earlier.append(
            ErrorComponent(group=group, effect=effect, value=value, unit="deg/h", dof=EARLIER_DOF)
        )
    return assume(spec, task, device, units, default_degc=default_degc, earlier=earlier), table


def measure_runs(
    spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe, task: Task, assumed: Assumed
) -> dict[str, Holds]:
    """Table axis → holds of its measured runs, with their noise; FitError for a log that a fit
    refuses, or runs about an axis in one direction.
    """
    runs = [(spec.find_axis(log.file), table_runs.fit_run(spec, log)) for log in task.have]
    K = np.max([[abs(line.K) for line in run.scales] for _, run in runs] or [[1.0]], axis=0)
    # a gyro that was never turned about its own axis is taken to be like the others
    K = np.where(ACROSS * K.max() < K, K, K.max())
    unknown = assumed.noise_of(min(assumed.device.dwell_s))
    have: dict[str, Holds] = {}
    for axis, run in runs:
        plateaus = run.plateaus
        if not np.isfinite(plateaus.temp_degc).all():
            raise FitError(
                f"{run.log.file}: no case temperature, expected one to plan what is missing",
                hint="map it under [columns.temp_case_degc], or plan without --have",
            )
        noise = np.sqrt(np.mean((plateaus.standard_uncertainty / K) ** 2, axis=1))
        # of a log of one row per hold no noise is known
        noise = np.where(np.isfinite(noise) & (noise > 0.0), noise, unknown)
        one_run = np.zeros(noise.size, dtype=np.int64)
        holds = Holds(plateaus.rate_dps, one_run, plateaus.temp_degc, plateaus.hours, noise)
        have[axis] = join(*([have[axis]] if axis in have else []), holds)
    for holds in have.values():
        rates = holds.rate_dps
        if not line_terms.turns_both_ways(rates):
            raise FitError(
                f"held rates from {rates.min():.4g} to {rates.max():.4g} °/s do not determine the"
                " scale factor and its errors, expected rates of both signs",
                hint="measure this run again",
            )
    return have


def simulate_plan(
    spec: RateTableRecipe | GyroTriadRecipe,
    schedule: Schedule,
    document: Mapping[str, Any],
    seed: int,
) -> Campaign:
    """Logs of gyros on a table that was run by a schedule, with the errors of runs that the plan
    assumes, and their truth.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    gyros = {f"gyro_{name}_lsb": simulate_rate_table.RateGyro.draw(rng) for name in spec.gyros}
    directions = np.eye(3)[: len(gyros)] + rng.normal(0.0, MOUNTED_RAD, (len(gyros), 3))
    table = simulate_rate_table.Table(
        interval_s=1.0, shortest_hold_s=float(document["settings"]["hold_s"])
    )
    size = read_sizes(document, UNITS)
    scale, zero = size[RUN_SCALE] / PPM, size[RUN_ZERO] / DPH_PER_DPS
    tilts = np.radians(rng.normal(0.0, size[MOUNTING], (3, 3)))
    logs: dict[str, dict[str, Array]] = {}
    for log, actions in schedule.by_log().items():
        axis = spec.find_axis(log.removeprefix(WITHHELD))
        seen = _mount(directions, axis, tilts) if axis else np.eye(3)[[2] * len(gyros)]
        moved = {
            name: replace(
                gyro,
                axis=tuple((direction / np.linalg.norm(direction)).tolist()),
                K=gyro.K * (1.0 + rng.normal(0.0, scale)),
                bias_dps=gyro.bias_dps + rng.normal(0.0, zero),
            )
            for (name, gyro), direction in zip(gyros.items(), seen, strict=True)
        }
        degc = actions[0].set_degc - table.warming_degc / 2.0
        rates = [one.table_rate_dps for one in actions]
        logs[log] = simulate_rate_table.run(moved, table, rates, degc, rng)
    truth = {
        "gyros": {name: asdict(gyro) for name, gyro in gyros.items()},
        "directions": directions.tolist(),
        "tilts_rad": tilts.tolist(),
    }
    decimals = simulate_rate_table.DECIMALS | dict.fromkeys(gyros, 1)
    return Campaign(logs, decimals, truth)


def _mount(directions: Array, axis: str, tilts: Array) -> Array:
    """Input axes [g, 3] in axes of a table that turns the base about one of its own, which is
    mounted with a tilt of its own [3, 3] [rad]: two components that turn, and one along the table.
    """
    at = forms.AXES.index(axis)
    turned = directions + np.cross(directions, tilts[at])
    return np.asarray(np.roll(turned, 2 - at, axis=1), dtype=np.float64)
