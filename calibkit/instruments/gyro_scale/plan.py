"""Campaigns of gyros on a rate table: which rates at which temperatures, about which axes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS, REVOLUTION_DEG
from calibkit.errors import FitError, UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.gyro_scale import equation, forms, simulate_rate_table, table_runs
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.assumptions import EARLIER_DOF, Assumed, assume, read_sizes, seen_errors
from calibkit.planning.levels import LEVELS, choose_some, list_levels, order_there_and_back
from calibkit.planning.proposal import (
    ONE_LEVEL_DEGC,
    WITHHELD,
    Coefficient,
    Design,
    count,
    cover_range,
)
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, split_variance, whole
from calibkit.planning.simulation import as_planned
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe, RateTableRecipe
    from calibkit.planning.equipment import RateTable
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.simulate.campaign import Campaign

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
    """Planned or measured holds [n] of several runs, of a gyro whose scale factor is 1."""

    rows: equation.Rows
    noise: Array
    """Of the mean over each hold [°/s]."""

    @classmethod
    def of(cls, rate_dps: Array, run: Integers, degc: Array, hours: Array, noise: Array) -> Holds:
        """Holds of a gyro that is exact."""
        line = np.zeros_like(run)
        return cls(equation.Rows(rate_dps, rate_dps, run, degc, hours, line, line), noise)

    @classmethod
    def of_runs(
        cls, rates_dps: Sequence[float], hours: Array, noise: Array, degc: Sequence[float]
    ) -> Holds:
        """Runs at temperatures [°C] in their order, all with the same signed rates, in the middle
        of each hold at an hour from the middle of the run.
        """
        runs = len(degc)
        run = np.repeat(np.arange(runs), len(rates_dps))
        rates = np.tile(np.array(rates_dps), runs)
        level = np.array(degc, dtype=np.float64)[run]
        return cls.of(rates, run, level, np.tile(hours, runs), np.tile(noise, runs))

    def join(self, other: Holds) -> Holds:
        """These holds and those of other runs."""
        a, b = self.rows, other.rows
        return Holds.of(
            np.concatenate([a.rate_dps, b.rate_dps]),
            np.concatenate([a.run, b.run + int(a.run.max(initial=-1)) + 1]),
            np.concatenate([a.row_degc, b.row_degc]),
            np.concatenate([a.hours, b.hours]),
            np.concatenate([self.noise, other.noise]),
        )

    def nearest(self, degc: float) -> Holds:
        """Holds at the temperature that is nearest to another [°C]."""
        rows = self.rows
        at = rows.row_degc[np.argmin(np.abs(rows.row_degc - degc))]
        kept = np.abs(rows.row_degc - at) <= ONE_LEVEL_DEGC
        run = np.asarray(np.unique(rows.run[kept], return_inverse=True)[1])
        level = np.full(run.size, at)
        return Holds.of(rows.rate_dps[kept], run, level, rows.hours[kept], self.noise[kept])


@dataclass(frozen=True, slots=True)
class Run:
    """What all runs of a design have in common."""

    rates_dps: tuple[int, ...]
    """Unsigned."""
    alternating: bool
    """Whether each rate is held both ways at once, or one side after the other."""
    shortest_s: float

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


@dataclass(frozen=True, slots=True)
class Runs:
    """Runs of a design."""

    run: Run
    degc: Mapping[str, tuple[int, ...]]
    """Table axis → temperatures of its runs in their order."""


NO_RUNS = Runs(Run((), alternating=True, shortest_s=0.0), {})


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

    def fit(
        self, holds: Holds, without: Sequence[tuple[str, str]] = ()
    ) -> tuple[Fit, equation.Terms]:
        """What a fit of holds will tell beside their errors, and its terms."""
        low, high = self.assumed.range_degc
        sizes = np.abs(holds.rows.rate_dps)
        shapes = (line_terms.ASYMMETRY,) if np.ptp(sizes) > 0.0 else ()
        middle_half = (low + high) / 2.0, max(high - low, 1.0) / 2.0
        terms = equation.Terms(1, (self.order,) * 2, middle_half, shapes)
        listed = equation.shared_errors(holds.rows, terms, np.ones(1), np.ones(1))
        # of temperatures that change within runs a plan knows nothing
        known = [name for name in UNITS if name not in without]
        shared = [one for one in listed if (one.group, one.effect) in known]
        residual = partial(equation.residual, rows=holds.rows, terms=terms)
        stated = self.assumed.state(shared)
        fit = predict(residual, terms.start, stated, noise=holds.noise, names=terms.names)
        return fit, terms

    def line_variance(
        self,
        result: str,
        holds: Holds,
        degc: Array | None = None,
        without: Sequence[tuple[str, str]] = (),
    ) -> Sources:
        """Variance of scale factor [ppm²] or zero [(°/h)²] about one axis, at temperatures [m] [°C]
        or over the range of use: of the best straight line over the holds.
        """
        fit, terms = self.fit(holds, without)
        degc = np.linspace(*self.assumed.range_degc, LEVELS) if degc is None else degc
        powers = polynomial.powers(terms.mapped(degc), self.order)
        line = equation.best_line(terms, holds.rows.rate_dps)
        which, unit = (equation.SCALE, PPM) if result == SCALE else (equation.ZERO, DPH_PER_DPS)
        slopes = unit * derivative(lambda p: powers @ line(p)[which][0], terms.start)
        return split_variance(fit, slopes)

    def angle_variance(self, campaign: Mapping[str, Holds], degc: Array | None = None) -> Sources:
        """Variance [deg²] of the angle between two gyros, each seen a little about the axis of the
        other, where no scale factor matters.
        """
        each = [self.line_variance(SCALE, one, degc, [RUN_SCALE]) for one in _single(campaign)]
        a, b = (sorted(each, key=_mean) * 2)[-2:]
        none = np.zeros_like(whole(a))
        angle = {source: a.get(source, none) + b.get(source, none) for source in a | b}
        mounted = np.full_like(none, 2.0 * self.assumed.size(*MOUNTING) ** 2)
        in_deg = {source: part * DEG_PER_PPM**2 for source, part in angle.items()}
        return in_deg | {"angle of the mounting": mounted}

    def worst(
        self, result: str, campaign: Mapping[str, Holds], degc: Array | None = None
    ) -> Sources:
        """Variance of a result about the axis that is known worst."""
        if result == ANGLE:
            return self.angle_variance(campaign, degc)
        each = (self.line_variance(result, one, degc) for one in _single(campaign))
        return max(each, key=_mean)

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result."""
        campaign = self.campaign(design)
        return {name: self.worst(name, campaign) for name in self.results}

    def covers(self, design: Design) -> bool:
        """Whether the runs about every axis reach both ends of the range, with a temperature more
        than the order needs.
        """
        campaign, range_degc = self.campaign(design), self.assumed.range_degc
        return all(
            cover_range(one.rows.temp_degc, self.order + 2, range_degc) for one in _single(campaign)
        )

    def campaign(self, design: Design) -> dict[str, Holds]:
        """Table axis → what is measured about it already, and holds of a design; FitError for an
        axis without any.
        """
        campaign = dict(self.have)
        planned: dict[tuple[int, ...], Holds] = {}
        runs: Runs = design.rows or NO_RUNS
        for axis, degc in runs.degc.items():
            if degc not in planned:
                planned[degc] = self.planned_holds(runs.run, degc)
            holds = planned[degc]
            campaign[axis] = campaign[axis].join(holds) if axis in campaign else holds
        missing = [axis for axis in self.axes if axis not in campaign]
        if missing:
            raise FitError(f"no run about {', '.join(missing)}", hint="plan without --have")
        return campaign

    def planned_holds(self, run: Run, degc: Sequence[int]) -> Holds:
        """Holds of runs as the fit will see them: means over whole revolutions."""
        holds = run.holds(self.table.acceleration_dps2)
        rates, start, length = (np.array(part) for part in zip(*holds, strict=True))
        turn_s = REVOLUTION_DEG / np.abs(rates)
        used_s = np.floor((length - 1.0) / turn_s) * turn_s
        hours = (start + length / 2.0 - (start[-1] + length[-1]) / 2.0) / 3600.0
        noise = self.assumed.noise * np.sqrt(self.assumed.device.noise_s / used_s)
        return Holds.of_runs(rates.tolist(), hours, noise, degc)

    def measured(self, axes: Sequence[str]) -> list[float]:
        """Temperatures [°C] of the runs about some axes."""
        return [t for axis in axes if axis in self.have for t in self.have[axis].rows.temp_degc]

    def lacking(self, axis: str) -> tuple[int, ...]:
        """Temperatures [°C] that were measured about other axes, but not about this one."""
        there, lacking = self.measured([axis]), list[int]()
        for degc in sorted(self.measured(self.axes)):
            if all(abs(degc - other) > ONE_LEVEL_DEGC for other in (*there, *lacking)):
                lacking.append(round(degc))
        return tuple(lacking)

    def stem(self, axis: str) -> str:
        """What the names of the logs about an axis begin with."""
        return self.task.name_log(f"about_{axis}" if axis else "run")

    def design(self, run: Run, degc: Sequence[int], label: str = "") -> Design:
        """Runs at temperatures in their order, about each axis beside what it lacks; where nothing
        is withheld yet, with one run between the two first temperatures that is.
        """
        of_axis = {
            axis: (*(one for one in self.lacking(axis) if one not in degc), *degc)
            for axis in self.axes
        }
        mounted = {axis: levels for axis, levels in of_axis.items() if levels}
        clock = Clock(self.task.equipment)
        for number, (axis, levels) in enumerate(mounted.items()):
            if number:
                clock.remount(self.task.equipment.fastest(self.assumed.device))
            stem = self.stem(axis)
            order = [(one, f"{stem}_{k + 1:02d}_{one}.csv") for k, one in enumerate(levels)]
            if not self.task.withheld:
                known = sorted({*levels, *map(round, self.measured([axis]))})
                between = round((known[0] + known[1]) / 2.0) if len(known) > 1 else known[0]
                order.insert(1, (between, f"{WITHHELD}{stem}_{between}.csv"))
            for one, log in order:
                self.turn(clock, run, one, log)
        single = self.planned_holds(run, (0,))
        settings = {
            "hold_s": run.shortest_s,
            "order": self.order,
            "rates_dps": single.rows.rate_dps.tolist(),
            "middle_h": single.rows.hours.tolist(),
            "noise_dps": single.noise.tolist(),
            "temperatures_degc": list(of_axis[self.axes[0]]),
        }
        changes = {}
        if isinstance(self.spec, GyroTriadRecipe):
            before = dict(self.spec.axes) if self.task.have else {}
            axes = {a: [*before.get(a, ()), f"{self.stem(a)}_*.csv"] for a in self.axes}
            changes = {"axes": axes}
        logs = tuple(f"{self.stem(axis)}_*.csv" for axis in mounted)
        label = label or self.label(run, of_axis)
        rows = Runs(run, mounted)
        return Design(label, clock.schedule(), logs, rows, None, settings, changes)

    def label(self, run: Run, of_axis: Mapping[str, tuple[int, ...]]) -> str:
        """Runs in a few words."""
        mounted = [levels for levels in of_axis.values() if levels]
        # about all axes alike, or what each lacks
        alike = len({*of_axis.values()}) == 1
        runs = len(mounted[0]) if alike else sum(map(len, mounted))
        levels = len({degc for one in mounted for degc in one})
        axes = f", about {len(mounted)} {'axis' if len(mounted) == 1 else 'axes'}"
        return (
            f"{len(run.rates_dps)} rates both ways, {count(runs, 'run')} at"
            f" {count(levels, 'temperature')}, holds of {run.shortest_s:g} s"
            f"{axes if len(self.axes) > 1 else ''}"
        )

    def turn(self, clock: Clock, run: Run, degc: int, log: str) -> None:
        """One run: ramp, soak, held rates."""
        equipment, device = self.task.equipment, self.assumed.device
        rate, change = equipment.fastest(device), degc - clock.degc
        clock.ramp(float(degc), rate)
        clock.soak(equipment.soak_s(device, change, rate))
        begin = clock.now_s
        for signed, start, length in run.holds(self.table.acceleration_dps2):
            clock.move(begin + start - clock.now_s)
            clock.rate(signed, length, log)

    def runs(self, rates: int) -> Iterator[Run]:
        """Runs of a number of rates."""
        fastest = int(self.table.fastest_dps)
        ladders = {spread_rates(fastest, rates, even=even) for even in (True, False)}
        for ladder, shortest, alternating in product(
            sorted(ladders), self.assumed.device.dwell_s, (True, False)
        ):
            yield Run(ladder, alternating, shortest)

    def designs(self) -> Iterator[Design]:
        """Campaigns of all sizes; beside what is measured, those of the temperatures that it lacks,
        and `NOTHING`.
        """
        if self.have:
            yield Design.nothing()
        seen: set[tuple[int, ...]] = set()
        for levels in list_levels(self.task, self.order, MORE_LEVELS, self.assumed.range_degc):
            for repeats in REPEATS:
                every = self.order_temperatures(levels, repeats)
                listed = set(self.additions(every)) if self.have else {every}
                for degc, rates in product(sorted(listed - seen), self.table.rates):
                    yield from (self.design(run, degc) for run in self.runs(rates))
                seen |= listed

    def additions(self, every: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        """Temperatures that runs may be added at: none beside what an axis lacks, up to three that
        are not measured, all of a whole campaign, or the reference again.
        """
        there = self.measured(self.axes)
        absent = tuple(
            one
            for one in dict.fromkeys(every)
            if all(abs(one - other) > ONE_LEVEL_DEGC for other in there)
        )
        if any(map(self.lacking, self.axes)):
            yield ()
        yield every
        yield (round(self.reference_degc),)
        yield from choose_some(absent)
        if absent:
            yield absent

    def order_temperatures(self, spaced: Sequence[int], repeats: int) -> tuple[int, ...]:
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

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """At the reference temperature: K and F0 of each gyro; over three axes the angles between
        them, which are those of the runs at that temperature alone.
        """
        campaign, at = self.campaign(design), np.array([self.reference_degc])
        if ANGLE in self.results:
            near = {axis: one.nearest(self.reference_degc) for axis, one in campaign.items()}
            parts = replace(self, order=0).angle_variance(near, at)
            for a, b in combinations(self.spec.gyros, 2):
                name = f"orthogonality_error_deg.{a}_{b}"
                yield Coefficient("triad", name, "deg", float(np.sqrt(whole(parts))[0]))
            return
        for gyro in self.spec.gyros:
            for letter, name in (("K", SCALE), ("F0", ZERO)):
                u = float(np.sqrt(whole(self.worst(name, campaign, at)))[0])
                yield Coefficient(f"gyro_{gyro}", letter, RESULTS[name], u)

    def usual(self) -> Iterator[Design]:
        """Three runs at the reference temperature, one at each of others, from low to high."""
        low, high = self.assumed.range_degc
        reference = round(self.reference_degc)
        levels = sorted({round(low), round((low + reference) / 2.0), round(high)})
        degc = [reference, reference, reference, *levels]
        if self.order + 1 <= len(set(degc)):
            yield self.design(self.usual_run(), degc, label="usual: 11 rates, 3 + 3 runs")

    def usual_run(self) -> Run:
        """Eleven rates, one side after the other."""
        rates = spread_rates(int(self.table.fastest_dps), USUAL_RATES, even=False)
        return Run(rates, alternating=False, shortest_s=USUAL_HOLD_S)


def _single(campaign: Mapping[str, Holds]) -> list[Holds]:
    """Holds of each axis, those of axes that are held alike once."""
    return list({id(holds): holds for holds in campaign.values()}.values())


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


def prepare_plan(spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe, task: Task) -> GyroBench:
    """What the search needs; UsageError for what cannot be planned."""
    assumed, table = assume_on_table(spec, task, UNITS, RANGE_DEGC, passed_on=spec.component_units)
    reference = float(np.clip(spec.reference_temp_degc, *assumed.range_degc))
    axes = forms.AXES if isinstance(spec, GyroTriadRecipe) else ("",)
    have = measure_runs(spec, task, assumed)
    results = RESULTS if len(axes) == 1 else ANGLES
    order = assumed.device.order
    return GyroBench(spec, task, assumed, results, have, table, reference, order, axes)


def assume_on_table(
    spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe,
    task: Task,
    units: Mapping[tuple[str, str], str],
    default_degc: tuple[float, float] | None,
    *,
    passed_on: Collection[tuple[str, str]],
    notes: tuple[str, ...] = (),
) -> tuple[Assumed, RateTable]:
    """Assumptions of a plan with a rate table: of an earlier run the shared errors that were seen,
    and the response at a rate, with the noise of the holds in it.

    Raises UsageError for equipment without a rate table, and for a run of no gyro on one.
    """
    device, table = task.equipment.known_device(spec.procedure), task.equipment.rate_table
    if table is None or device.noise_unit != "deg/s":
        raise UsageError(
            "a plan of gyros needs [rate_table] in the equipment file and a noise in deg/s",
            hint="see calibkit plan --print-equipment",
        )
    earlier = list[ErrorComponent]()
    if task.earlier is not None:
        record = task.earlier.get(forms.SCALE_FILE)
        figures = record.figures if record else ()
        off = [one.value for one in figures if one.name.startswith(OFF_LINE)]
        if record is None or not off:
            raise UsageError(
                "that run has no scale factor of a gyro on a rate table",
                hint="name a run of rate_table, gyro_triad or gyro_pair",
            )
        group, effect = RESPONSE
        response = ErrorComponent(
            group=group,
            effect=effect,
            value=rms(off) * DPH_PER_DPS,
            unit="deg/h",
            dof=EARLIER_DOF,
        )
        seen = seen_errors(record.models)
        earlier = [one for one in seen if (one.group, one.effect) != RESPONSE]
        earlier.append(response)
        sizes = ", ".join(
            f"{one.effect} of the {one.group} {one.value:.2g} {one.unit}" for one in earlier
        )
        notes = (f"of that run: {sizes}; noise as the equipment file states it",)
    assumed = assume(
        *(spec, task, device, units),
        default_degc=default_degc,
        passed_on=passed_on,
        earlier=earlier,
        notes=notes,
    )
    return assumed, table


def measure_runs(
    spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe, task: Task, assumed: Assumed
) -> dict[str, Holds]:
    """Table axis → holds of its measured runs, with their noise; FitError for a log that a fit
    refuses, or runs about an axis in one direction.
    """
    runs = [(spec.find_axis(log.file), table_runs.fit_run(spec, log)) for log in task.have]
    for _, run in runs:
        if not np.isfinite(run.plateaus.temp_degc).all():
            raise FitError(
                f"{run.log.file}: no case temperature, expected one to plan what is missing",
                hint="map it under [columns.temp_case_degc], or plan without --have",
            )
    every = [[abs(line.K) for line in run.scales] for _, run in runs]
    K = np.max(every, axis=0) if runs else np.ones(1)
    # a gyro that was never turned about its own axis is taken to be like the others
    K = np.where(ACROSS * K.max() < K, K, K.max())
    unknown = assumed.noise_of(min(assumed.device.dwell_s))
    have: dict[str, Holds] = {}
    for axis, run in runs:
        plateaus = run.plateaus
        noise = np.sqrt(np.mean((plateaus.standard_uncertainty / K) ** 2, axis=1))
        # of a log of one row per hold no noise is known
        noise = np.where(np.isfinite(noise) & (noise > 0.0), noise, unknown)
        one_run = np.zeros(noise.size, dtype=np.int64)
        holds = Holds.of(plateaus.rate_dps, one_run, plateaus.temp_degc, plateaus.hours, noise)
        have[axis] = have[axis].join(holds) if axis in have else holds
    for holds in have.values():
        rates = holds.rows.rate_dps
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
    return as_planned(document, seed, logs, decimals, truth)


def _mount(directions: Array, axis: str, tilts: Array) -> Array:
    """Input axes [g, 3] in axes of a table that turns the base about one of its own, which is
    mounted with a tilt of its own [3, 3] [rad]: two components that turn, and one along the table.
    """
    at = forms.AXES.index(axis)
    turned = directions + np.cross(directions, tilts[at])
    return np.asarray(np.roll(turned, 2 - at, axis=1), dtype=np.float64)
