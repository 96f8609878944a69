"""Campaigns of a gyro on a rate table: which rates at which temperatures, and what they will
give.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import assumptions, forms, planned_runs
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.planned import Holds, Model
from calibkit.instruments.gyro_scale.planned_runs import NO_RUNS, Bench, Design
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe, RateTableRecipe
from calibkit.planning import recipe_text
from calibkit.planning.linear import (
    assume_errors,
    choose_some,
    known_sizes,
    list_levels,
    order_there_and_back,
)
from calibkit.planning.proposal import (
    ONE_LEVEL_DEGC,
    Candidate,
    Coefficient,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    find_front,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


GyroRecipe = RateTableRecipe | GyroTriadRecipe
RANGE_DEGC = (-40.0, 60.0)
MORE_LEVELS = 3
"""Temperatures that the search takes at most beyond one more than the order needs."""
REPEATS = (1, 2, 3)
"""Runs at the reference temperature."""


def propose(spec: GyroRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    bench = _prepare(spec, task)
    wishes = tuple(Wish.parse(text, bench.results) for text in task.wishes)
    name = wishes[0].name if wishes else "scale factor"
    found = [one for one in map(bench.candidate, _list_designs(bench)) if one is not None]
    if not found:
        raise FitError(
            "no campaign determines scale factor and zero over the range",
            hint="plan without --have, or for a narrower --range",
        )
    best = choose(found, wishes, task.within_h, name)
    design: Design = best.design
    campaign = bench.campaign(design)
    runs = bench.runs(design, bench.axes[0]) if design.rates else None
    return Proposal(
        best.label,
        bench.schedule(design),
        bench.predict(campaign),
        tuple(_coefficients(bench, campaign)),
        bench.model.range_degc,
        _write_recipe(spec, bench, design),
        bench.device.noise,
        "deg/s",
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else tuple(_usual(bench)),
        (*bench.notes, *task.describe_range(RANGE_DEGC)),
        {"hold_s": design.shortest_s, "order": bench.device.order}
        | (
            {
                "rates_dps": list(runs.rates_dps),
                "middle_h": runs.hours.tolist(),
                "noise_dps": runs.noise_dps.tolist(),
                "temperatures_degc": list(runs.degc),
            }
            if runs
            else {}
        ),
    ), wishes


def _write_recipe(spec: GyroRecipe, bench: Bench, design: Design) -> str:
    """Recipe of the planned campaign."""
    task = bench.task
    # what the recipes of these procedures can state
    own = [one for one in bench.components if (one.group, one.effect) in spec.component_units]
    stems = {axis: task.name_log(f"about_{axis}" if axis else "run") for axis in bench.axes}
    mounted = [axis for axis in bench.axes if design.rates and bench.temperatures(design, axis)]
    files = [f"{stems[axis]}_*.csv" for axis in mounted]
    changes: dict[str, Any] = {}
    if isinstance(spec, GyroTriadRecipe):
        before = dict(spec.axes) if task.have else {}
        changes["axes"] = {
            axis: [*before.get(axis, ()), f"{stem}_*.csv"] for axis, stem in stems.items()
        }
    return recipe_text.write_recipe(spec, files, own, changes, added=bool(task.have))


def judge(spec: GyroRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the runs that are measured tell; empty where they do not determine all."""
    bench = _prepare(spec, task)
    if bench.candidate(NO_RUNS) is None:
        return ()
    return bench.predict(bench.have)


def _prepare(spec: GyroRecipe, task: Task) -> Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device, table = planned_runs.require_table(task, spec.procedure)
    low, high = task.range_degc or RANGE_DEGC
    task.equipment.require_reached(low, high)
    earlier = {} if task.earlier is None else assumptions.read_run(task.earlier)
    stated = assume_errors(spec, device, earlier.values(), planned.UNITS)
    sizes = known_sizes(stated.values(), planned.UNITS)
    model = Model(device.order, (low, high), sizes)
    reference = float(np.clip(spec.reference_temp_degc, low, high))
    over_axes = isinstance(spec, GyroTriadRecipe)
    sizes_text = ", ".join(
        f"{one.effect} of the {one.group} {one.value:.2g} {one.unit}" for one in earlier.values()
    )
    return Bench(
        *(task, device, table, model, reference, spec.gyros, tuple(stated.values())),
        planned.ANGLES if over_axes else planned.RESULTS,
        forms.AXES if over_axes else ("",),
        assumptions.measure_runs(spec, task.have, device),
        (f"of that run: {sizes_text}; noise as the equipment file states it",) if earlier else (),
    )


def _list_designs(bench: Bench) -> Iterator[Design]:
    """Campaigns of all sizes; beside what is measured, those of the temperatures that it lacks, and
    an empty one.
    """
    fastest = int(bench.table.fastest_dps)
    if bench.have:
        yield NO_RUNS
    seen: set[tuple[int, ...]] = set()
    model = bench.model
    for levels in list_levels(bench.task, model.order, MORE_LEVELS, model.range_degc):
        for repeats in REPEATS:
            whole = _order_temperatures(bench, levels, repeats)
            listed = set(_list_additions(bench, whole)) if bench.have else {whole}
            for degc, count in product(sorted(listed - seen), bench.table.rates):
                ladders = {
                    tuple(planned.spread_rates(fastest, count, even=even)) for even in (True, False)
                }
                for rates, shortest, alternating in product(
                    sorted(ladders), bench.device.dwell_s, (True, False)
                ):
                    yield Design(rates, alternating, shortest, degc)
            seen |= listed


def _list_additions(bench: Bench, whole: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Temperatures that runs may be added at: none beside what an axis lacks, up to three that are
    not measured, all of a whole campaign, or the reference again.
    """
    there = bench.measured(bench.axes)
    absent = list(
        dict.fromkeys(
            one for one in whole if all(abs(one - other) > ONE_LEVEL_DEGC for other in there)
        )
    )
    if any(map(bench.lacking, bench.axes)):
        yield ()
    yield tuple(whole)
    yield (round(bench.reference_degc),)
    yield from choose_some(absent)
    if absent:
        yield tuple(absent)


def _order_temperatures(bench: Bench, spaced: Sequence[int], repeats: int) -> tuple[int, ...]:
    """Temperatures in their order: every second one on the way back to the first, and further runs
    where the reference temperature is passed.
    """
    levels, size = list(spaced), len(spaced)
    reference = round(bench.reference_degc)
    # the level nearest to the reference is the reference; the ends of the range stay
    inner = range(1, size - 1)
    nearest = min(inner, key=lambda k: abs(levels[k] - reference))
    if levels[0] < reference < levels[-1]:
        levels[nearest] = reference
    order = order_there_and_back(levels)
    at = order.index(levels[nearest])
    return (*order[:at], *([levels[nearest]] * repeats), *order[at + 1 :])


def _coefficients(bench: Bench, campaign: Mapping[str, Holds]) -> Iterator[Coefficient]:
    """Predicted standard uncertainties at the reference temperature: K and F0 of each gyro; over
    three axes the angles between them, which are those of the runs at that temperature alone.
    """
    at = np.array([bench.reference_degc])
    if planned.ANGLE in bench.results:
        near = {
            id(one): one.nearest(bench.reference_degc, ONE_LEVEL_DEGC) for one in campaign.values()
        }
        alone = replace(bench, model=bench.model.constant())
        parts = alone.variances(planned.ANGLE, {str(key): one for key, one in near.items()}, at)
        u = float(np.sqrt(np.sum([*parts.values()])))
        for a, b in combinations(bench.gyros, 2):
            yield Coefficient("triad", f"orthogonality_error_deg.{a}_{b}", "deg", u)
        return
    for gyro in bench.gyros:
        for letter, name in (("K", "scale factor"), ("F0", "zero")):
            u = float(np.sqrt(np.sum([*bench.variances(name, campaign, at).values()])))
            yield Coefficient(f"gyro_{gyro}", letter, bench.results[name], u)


def _usual(bench: Bench) -> Iterator[Candidate]:
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
        design = Design(rates, alternating=False, shortest_s=30.0, degc=tuple(order))
        if (found := bench.candidate(design)) is not None:
            yield replace(found, label="usual: 11 rates, 3 + 3 runs")
