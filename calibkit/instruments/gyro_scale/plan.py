"""Campaigns of a gyro on a rate table: which rates at which temperatures, and what they will
give.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS
from calibkit.errors import UsageError
from calibkit.instruments.gyro_scale import forms, simulate_rate_table
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.numeric.planned import Model, Runs
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe, RateTableRecipe
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Known
from calibkit.planning import recipe_text
from calibkit.planning.proposal import (
    Candidate,
    Coefficient,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    find_front,
)
from calibkit.planning.schedule import Clock
from calibkit.recipe.tables import ErrorComponent
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array
    from calibkit.planning.equipment import Device, RateTable
    from calibkit.planning.schedule import Schedule

GyroRecipe = RateTableRecipe | GyroTriadRecipe
RANGE_DEGC = (-40.0, 60.0)
MOUNTED_RAD = 3e-3
"""Standard deviation of the angles of simulated input axes to those of their base."""
MORE_LEVELS = 3
"""Temperatures that the search takes at most beyond one more than the order needs."""
REPEATS = (1, 2, 3)
"""Runs at the reference temperature."""


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign."""

    rates: tuple[int, ...]
    """Unsigned rates [°/s] of a run."""
    alternating: bool
    shortest_s: float
    degc: tuple[int, ...]
    """Temperatures of the fitted runs in their order."""


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    table: RateTable
    model: Model
    reference_degc: float
    gyros: tuple[str, ...]
    components: tuple[ErrorComponent, ...]
    results: Mapping[str, str]
    """Results that a plan predicts, with their units."""
    axes: tuple[str, ...] = ("",)
    """Table axes about which the base is turned, one mounting each."""

    def holds(self, design: _Design) -> list[tuple[float, float, float]]:
        """Signed rate [°/s], start and length [s] of each hold of a run."""
        now, before, found = 3.0, 0.0, []
        for rate in planned.order_rates(design.rates, alternating=design.alternating):
            now += abs(rate - before) / self.table.acceleration_dps2
            length = planned.hold_s(rate, design.shortest_s)
            found.append((rate, now, length))
            now, before = now + length, rate
        return found

    def runs(self, design: _Design) -> Runs:
        """Runs of a design as the fit will see them."""
        rates, start, length = (np.array(part) for part in zip(*self.holds(design), strict=True))
        turn_s = 360.0 / np.abs(rates)
        used = np.floor((length - 1.0) / turn_s) * turn_s
        middle = start + length / 2.0
        hours = (middle - (start[-1] + length[-1]) / 2.0) / 3600.0
        noise = self.device.noise * np.sqrt(self.device.noise_s / used)
        return Runs(tuple(rates.tolist()), hours, noise, design.degc)

    def schedule(self, design: _Design) -> Schedule:
        """Schedule of a design, with one run that is withheld between the two first
        temperatures.
        """
        levels = sorted(set(design.degc))
        between = round((levels[0] + levels[1]) / 2.0) if len(levels) > 1 else levels[0]
        clock = Clock(self.task.equipment)
        for axis in self.axes:
            if axis != self.axes[0]:
                clock.remount(self.task.equipment.fastest(self.device))
            stem = f"about_{axis}" if axis else "run"
            order = [(degc, f"{stem}_{k + 1:02d}_{degc}.csv") for k, degc in enumerate(design.degc)]
            order.insert(1, (between, f"withheld/{stem}_{between}.csv"))
            for degc, log in order:
                self._run(clock, design, degc, log)
        return clock.schedule()

    def _run(self, clock: Clock, design: _Design, degc: int, log: str) -> None:
        """One run: ramp, soak, held rates."""
        equipment = self.task.equipment
        rate, change = equipment.fastest(self.device), degc - clock.degc
        clock.ramp(float(degc), rate)
        clock.soak(equipment.soak_s(self.device, change, rate))
        begin = clock.now_s
        for signed, start, length in self.holds(design):
            clock.move(begin + start - clock.now_s)
            clock.rate(signed, length, log)

    def variances(self, name: str, runs: Runs, degc: Array | None = None) -> dict[str, Array]:
        """Variances [m] of a result that noise and each source leave, over the range of use or at
        temperatures [m] [°C].
        """
        if name != planned.ANGLE:
            found = self.model.information(runs)
            return found.variances(self.model.result_slopes(name, runs, degc))
        # two gyros, each seen a little about the axis of the other, where no scale factor matters
        across = self.model.without(("run", "scale"))
        slopes = across.result_slopes("scale factor", runs, degc) * np.degrees(1.0 / PPM)
        parts = across.information(runs).variances(slopes)
        size = self.model.sizes.get(planned.MOUNTING)
        mounted = np.full(len(slopes), (0.0 if size is None else size.value) ** 2)
        return {source: 2.0 * part for source, part in parts.items()} | {
            "angle of the mounting": 2.0 * mounted
        }

    def candidate(self, design: _Design) -> Candidate:
        """A campaign with its hours and uncertainties."""
        runs = self.runs(design)
        largest = {
            name: float(np.sqrt(np.sum([*self.variances(name, runs).values()], axis=0).max()))
            for name in self.results
        }
        label = (
            f"{len(design.rates)} rates both ways, {len(design.degc)} runs at"
            f" {len(set(design.degc))} temperatures, holds of {design.shortest_s:g} s"
            f"{f', about {len(self.axes)} axes' if len(self.axes) > 1 else ''}"
        )
        return Candidate(label, self.schedule(design).hours, largest, design)


def propose(spec: GyroRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    bench = _prepare(spec, task)
    wishes = tuple(Wish.parse(text, bench.results) for text in task.wishes)
    name = wishes[0].name if wishes else "scale factor"
    found = list(_search(bench))
    best = choose(found, wishes, task.within_h, name)
    runs = bench.runs(best.design)
    # what the recipes of these procedures can state
    own = [
        one
        for one in bench.components
        if one.group in spec.error_groups and (one.group, one.effect) in planned.STATED
    ]
    files = sorted({f"{f'about_{axis}' if axis else 'run'}_*.csv" for axis in bench.axes})
    return Proposal(
        best.label,
        bench.schedule(best.design),
        tuple(
            Predicted.of(key, unit, bench.variances(key, runs))
            for key, unit in bench.results.items()
        ),
        tuple(_coefficients(bench, runs)),
        recipe_text.write_recipe(spec, files, own, {}),
        bench.device.noise,
        "deg/s",
        bench.components,
        tuple(find_front(found, name)),
        tuple(_usual(bench)),
        () if task.range_degc else ("no --range: planned for −40 to 60 °C",),
        {
            "hold_s": best.design.shortest_s,
            "order": bench.device.order,
            "rates_dps": list(runs.rates_dps),
            "middle_h": runs.hours.tolist(),
            "noise_dps": runs.noise_dps.tolist(),
            "temperatures_degc": list(runs.degc),
        },
    ), wishes


def _prepare(spec: GyroRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device, table = task.equipment.known_device(spec.procedure), task.equipment.rate_table
    if table is None or device.noise_unit != "deg/s":
        raise UsageError(
            "a plan of gyros needs [rate_table] in the equipment file and a noise in deg/s",
            hint="see calibkit plan --print-equipment",
        )
    if task.have or task.earlier is not None:
        raise UsageError(
            f"--have and --from are not planned for '{spec.procedure}'",
            hint="state what is known in [[errors.component]] of the recipe",
        )
    low, high = task.range_degc or RANGE_DEGC
    task.equipment.require_reached(low, high)
    stated = {(one.group, one.effect): one for one in (*device.component, *spec.errors.component)}
    unknown = [name for name in stated if name not in planned.UNITS]
    if unknown:
        raise UsageError(
            f"component '{unknown[0][1]}' of group '{unknown[0][0]}' is no error of a rate table",
            hint=f"there are {', '.join(f'{e} of {g}' for g, e in planned.UNITS)}",
        )
    sizes = {key: Known(one.value_in(planned.UNITS[key]), one.dof) for key, one in stated.items()}
    model = Model(device.order, (low, high), sizes)
    reference = float(np.clip(spec.reference_temp_degc, low, high))
    over_axes = isinstance(spec, GyroTriadRecipe)
    return _Bench(
        *(task, device, table, model, reference, spec.gyros, tuple(stated.values())),
        planned.ANGLES if over_axes else planned.RESULTS,
        forms.AXES if over_axes else ("",),
    )


def _search(bench: _Bench) -> Iterator[Candidate]:
    """Campaigns of all sizes."""
    fewest = bench.model.order + 2
    sizes = range(fewest, fewest + MORE_LEVELS + 1)
    labels = [f"{size} temperatures" for size in sizes]
    fastest = int(bench.table.fastest_dps)
    for size, _ in zip(sizes, bench.task.progress(labels, "searching"), strict=True):
        for repeats in REPEATS:
            degc = _order_temperatures(bench, size, repeats)
            for count in bench.table.rates:
                ladders = {
                    tuple(planned.spread_rates(fastest, count, even=even)) for even in (True, False)
                }
                for rates, shortest, alternating in product(
                    sorted(ladders), bench.device.dwell_s, (True, False)
                ):
                    yield bench.candidate(_Design(rates, alternating, shortest, degc))


def _order_temperatures(bench: _Bench, size: int, repeats: int) -> tuple[int, ...]:
    """Temperatures in their order: every second one on the way back to the first, and further runs
    where the reference temperature is passed.
    """
    low, high = bench.model.range_degc
    levels = polynomial.space_levels(np.ceil(low), np.floor(high), size)
    reference = round(bench.reference_degc)
    # the level nearest to the reference is the reference; the ends of the range stay
    inner = range(1, size - 1)
    nearest = min(inner, key=lambda k: abs(levels[k] - reference))
    if levels[0] < reference < levels[-1]:
        levels[nearest] = reference
    up, down = levels[::2], levels[1::2][::-1]
    order = [*up, *down, up[0]]
    at = order.index(levels[nearest])
    return (*order[:at], *([levels[nearest]] * repeats), *order[at + 1 :])


def _coefficients(bench: _Bench, runs: Runs) -> Iterator[Coefficient]:
    """Predicted standard uncertainties at the reference temperature: K and F0 of each gyro; over
    three axes the angles between them, which are those of the runs at that temperature alone.
    """
    at = np.array([bench.reference_degc])
    if planned.ANGLE in bench.results:
        one = replace(runs, degc=(round(bench.reference_degc),))
        alone = replace(bench, model=bench.model.constant())
        parts = alone.variances(planned.ANGLE, one, at)
        u = float(np.sqrt(np.sum([*parts.values()])))
        for a, b in combinations(bench.gyros, 2):
            yield Coefficient("triad", f"orthogonality_error_deg.{a}_{b}", "deg", u)
        return
    for gyro in bench.gyros:
        for letter, name in (("K", "scale factor"), ("F0", "zero")):
            u = float(np.sqrt(np.sum([*bench.variances(name, runs, at).values()])))
            yield Coefficient(f"gyro_{gyro}", letter, bench.results[name], u)


def _usual(bench: _Bench) -> Iterator[Candidate]:
    """The usual campaign: eleven rates, three runs at the reference temperature, one at each of
    others, from low to high.
    """
    low, high = bench.model.range_degc
    reference = round(bench.reference_degc)
    levels = sorted({round(low), round((low + reference) / 2.0), round(high)})
    order = [reference, reference, reference, *levels]
    if bench.model.order + 1 <= len(set(order)):
        fastest = int(bench.table.fastest_dps)
        rates = tuple(planned.spread_rates(fastest, 11, even=False))
        design = _Design(rates, alternating=False, shortest_s=30.0, degc=tuple(order))
        yield replace(bench.candidate(design), label="usual: 11 rates, 3 + 3 runs")


def simulate(
    spec: GyroRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
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
    size = {
        (one.group, one.effect): one.value_in(planned.UNITS[one.group, one.effect])
        for one in map(ErrorComponent.model_validate, document["components"])
    }
    scale, zero = size.get(("run", "scale"), 0.0) / PPM, size.get(("run", "zero"), 0.0)
    tilts = np.radians(rng.normal(0.0, size.get(planned.MOUNTING, 0.0), (3, 3)))
    logs: dict[str, dict[str, Array]] = {}
    held = schedule.recorded("rate")
    for log in dict.fromkeys(one.log for one in held):
        own = [one for one in held if one.log == log]
        axis = spec.find_axis(log.removeprefix("withheld/"))
        seen = _mount(directions, axis, tilts) if axis else np.eye(3)[[2] * len(gyros)]
        moved = {
            name: replace(
                gyro,
                axis=tuple((direction / np.linalg.norm(direction)).tolist()),
                K=gyro.K * (1.0 + rng.normal(0.0, scale)),
                bias_dps=gyro.bias_dps + rng.normal(0.0, zero) / DPH_PER_DPS,
            )
            for (name, gyro), direction in zip(gyros.items(), seen, strict=True)
        }
        degc = own[0].set_degc - table.warming_degc / 2.0
        rates = [one.table_rate_dps for one in own]
        logs[log] = simulate_rate_table.run(moved, table, rates, degc, rng)
    drawn = {name: asdict(gyro) for name, gyro in gyros.items()}
    truth = {"seed": seed, "plan": document["sha256"], "gyros": drawn}
    truth |= {"directions": directions.tolist(), "tilts_rad": tilts.tolist()}
    return Campaign(logs, simulate_rate_table.DECIMALS | dict.fromkeys(gyros, 1), truth)


def _mount(directions: Array, axis: str, tilts: Array) -> Array:
    """Input axes [g, 3] in axes of a table that turns the base about one of its own, which is
    mounted with a tilt of its own [3, 3] [rad]: two components that turn, and one along the table.
    """
    at = forms.AXES.index(axis)
    turned = directions + np.cross(directions, tilts[at])
    return np.asarray(np.roll(turned, 2 - at, axis=1), dtype=np.float64)
