"""Campaigns of a gyro on a rate table: which rates at which temperatures, and what they will
give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.instruments.gyro_scale import simulate_rate_table
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.planned import Model, Runs
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
    from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
    from calibkit.numeric.information import Information
    from calibkit.planning.equipment import Device, RateTable
    from calibkit.planning.schedule import Schedule

RANGE_DEGC = (-40.0, 60.0)
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
        equipment = self.task.equipment
        rate = equipment.fastest(self.device)
        levels = sorted(set(design.degc))
        between = round((levels[0] + levels[1]) / 2.0) if len(levels) > 1 else levels[0]
        order: list[tuple[int, str]] = [
            (degc, f"run_{k + 1:02d}_{degc}.csv") for k, degc in enumerate(design.degc)
        ]
        order.insert(1, (between, f"withheld/run_{between}.csv"))
        clock = Clock(equipment)
        for degc, log in order:
            change = degc - clock.degc
            clock.ramp(float(degc), rate)
            clock.soak(equipment.soak_s(self.device, change, rate))
            begin = clock.now_s
            for signed, start, length in self.holds(design):
                clock.move(begin + start - clock.now_s)
                clock.rate(signed, length, log)
        return clock.schedule()

    def candidate(self, design: _Design) -> Candidate:
        """A campaign with its hours and uncertainties."""
        runs = self.runs(design)
        covariance = self.model.information(runs).covariance
        largest = {}
        for name in planned.RESULTS:
            slopes = self.model.result_slopes(name, runs)
            variance = np.einsum("mp,pq,mq->m", slopes, covariance, slopes)
            largest[name] = float(np.sqrt(variance.max()))
        label = (
            f"{len(design.rates)} rates both ways, {len(design.degc)} runs at"
            f" {len(set(design.degc))} temperatures, holds of {design.shortest_s:g} s"
        )
        return Candidate(label, self.schedule(design).hours, largest, design)


def propose(spec: RateTableRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, planned.RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    name = wishes[0].name if wishes else "scale factor"
    found = list(_search(bench))
    best = choose(found, wishes, task.within_h, name)
    runs = bench.runs(best.design)
    information = bench.model.information(runs)
    own = [one for one in bench.components if one.group == "run" and one.effect != "zero drift"]
    return Proposal(
        best.label,
        bench.schedule(best.design),
        tuple(_predict(bench.model, information, runs, name) for name in planned.RESULTS),
        tuple(_coefficients(bench, information, runs)),
        recipe_text.write_recipe(spec, ["run_*.csv"], own, {}),
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


def _prepare(spec: RateTableRecipe, task: Task) -> _Bench:
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
    return _Bench(task, device, table, model, reference, spec.gyros, tuple(stated.values()))


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


def _predict(model: Model, information: Information, runs: Runs, name: str) -> Predicted:
    """Predicted uncertainty of a result, and what limits it."""
    return Predicted.of(
        name, planned.RESULTS[name], information.variances(model.result_slopes(name, runs))
    )


def _coefficients(bench: _Bench, information: Information, runs: Runs) -> Iterator[Coefficient]:
    """Predicted standard uncertainties of K and F0 at the reference temperature."""
    for gyro in bench.gyros:
        for letter, name in (("K", "scale factor"), ("F0", "zero")):
            slopes = bench.model.at(name, runs, bench.reference_degc)
            variance = float((slopes @ information.covariance @ slopes.T)[0, 0])
            yield Coefficient(
                f"gyro_{gyro}", letter, planned.RESULTS[name], float(np.sqrt(variance))
            )


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
    spec: RateTableRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of gyros on a table that was run by a schedule, with the errors of runs that the plan
    assumes, and their truth.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    gyros = {f"gyro_{name}_lsb": simulate_rate_table.RateGyro.draw(rng) for name in spec.gyros}
    table = simulate_rate_table.Table(
        interval_s=1.0, shortest_hold_s=float(document["settings"]["hold_s"])
    )
    sizes = {one["effect"]: ErrorComponent.model_validate(one) for one in document["components"]}
    scale = sizes["scale"].value_in("ppm") / 1e6 if "scale" in sizes else 0.0
    zero = sizes["zero"].value_in("deg/h") / 3600.0 if "zero" in sizes else 0.0
    logs: dict[str, dict[str, Array]] = {}
    lines: dict[str, Any] = {}
    held = schedule.recorded("rate")
    for log in dict.fromkeys(one.log for one in held):
        own = [one for one in held if one.log == log]
        rates = [one.table_rate_dps for one in own]
        moved = {
            name: replace(
                gyro,
                K=gyro.K * (1.0 + rng.normal(0.0, scale)),
                bias_dps=gyro.bias_dps + rng.normal(0.0, zero),
            )
            for name, gyro in gyros.items()
        }
        degc = own[0].set_degc - table.warming_degc / 2.0
        logs[log] = simulate_rate_table.run(moved, table, rates, degc, rng)
        lines[log] = {
            name: gyro.best_line(table, rates, own[0].set_degc) for name, gyro in gyros.items()
        }
    decimals = simulate_rate_table.DECIMALS | dict.fromkeys(gyros, 1)
    truth = {"seed": seed, "plan": document["sha256"], "lines": lines}
    return Campaign(logs, decimals, truth)
