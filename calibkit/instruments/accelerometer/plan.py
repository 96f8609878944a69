"""Campaigns of a triad: which attitudes at which temperatures, in which order, and what they will
give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import assumptions
from calibkit.instruments.accelerometer.numeric import planned
from calibkit.instruments.accelerometer.numeric.planned import Dwells, Model, Soaks
from calibkit.numeric import exchange
from calibkit.numeric.least_squares import polynomial
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

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.accelerometer.assumptions import Assumed
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.numeric.information import Information
    from calibkit.planning.schedule import Schedule

LOG, WITHHELD = "positions.csv", "withheld/positions.csv"
MOST_SOAKS = 5
"""Temperatures that the search takes at most beyond what the order needs."""
COUNTS = (6, 8, 10, 12, 16, 20, 24, 30, 36, 42, 50)
"""Numbers of attitudes that the search takes."""
LEFT_OUT = 2
"""Attitudes that are withheld."""
STEPS_DEGC = (-20, -5, -1, 1, 5, 20)
"""Exchanges of a temperature."""
LEAST_APART_DEGC = 5
FACES = ((0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, 270))


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: soaks in their order, attitudes by number among those of the fixture."""

    degc: tuple[int, ...]
    chosen: tuple[int, ...]
    withheld: tuple[int, ...]
    dwell_s: float


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    assumed: Assumed
    model: Model
    spots: Array
    """Inclination and toolface [c, 2] [°] of the fixture's attitudes."""
    mounting: Integers
    """[c]."""
    base: Information | None
    """What is measured already."""

    @property
    def rate(self) -> float:
        """Ramp between soaks [°C/min]."""
        return self.task.equipment.fastest(self.assumed.device)

    def run(self, design: _Design) -> tuple[Schedule, Dwells]:
        """Schedule of a design, and its dwells without those that are withheld."""
        equipment, device = self.task.equipment, self.assumed.device
        fixture = equipment.fixture(self.assumed.fixture)
        clock, fitted, soak = Clock(equipment), [], -1
        mountings = np.unique(self.mounting[list(design.chosen)])
        for number, mounting in enumerate(mountings.tolist()):
            if number:
                clock.remount(self.rate)
            own = [k for k in design.chosen if self.mounting[k] == mounting]
            out = [k for k in design.withheld if self.mounting[k] == mounting]
            for degc in design.degc:
                soak += 1
                change = degc - clock.degc
                clock.ramp(float(degc), self.rate)
                clock.soak(equipment.soak_s(device, change, self.rate))
                for k in (*own, *out):
                    taken = fixture.move_s + design.dwell_s
                    if fixture.attended:
                        clock.attend(taken)
                    clock.move(fixture.move_s)
                    log = LOG if k in own else WITHHELD
                    clock.dwell(self.spots[k].tolist(), design.dwell_s, log)
                    if k in own:
                        fitted.append((k, degc, soak, clock.now_s / 3600.0))
        spots, degc_of, soaks, hours = (np.array(one) for one in zip(*fitted, strict=True))
        noise = self.assumed.noise_of(design.dwell_s)
        dwells = Dwells(
            self.spots[spots], degc_of.astype(np.float64), soaks.astype(np.int64), hours, noise
        )
        return clock.schedule(), dwells

    def information(self, dwells: Dwells) -> Information:
        """Information of dwells and of what is measured already."""
        found = self.model.information(dwells)
        if self.base is None:
            return found
        p = len(self.model.parameters)
        data = found.data.copy()
        data[:p, :p] += planned.reduce_to_coefficients(self.base)
        return replace(found, data=data)

    def candidate(self, label: str, design: _Design) -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all."""
        schedule, dwells = self.run(design)
        found = self.information(dwells)
        if not found.determined:
            return None
        covariance = found.covariance
        largest = {}
        for name in planned.RESULTS:
            slopes = self.model.result_slopes(name)
            variance = np.einsum("mp,pq,mq->m", slopes, covariance, slopes)
            largest[name] = float(np.sqrt(variance.max()))
        return Candidate(label, schedule.hours, largest, design)

    def soak_hours(self, degc: Sequence[int], count: int, dwell_s: float) -> tuple[float, ...]:
        """Middle of the dwells of each soak [h], for a number of dwells a soak."""
        equipment = self.task.equipment
        held = count * (equipment.fixture(self.assumed.fixture).move_s + dwell_s)
        now, found = 0.0, [held / 2.0]
        for a, b in pairwise(degc):
            now += held + abs(b - a) / self.rate * 60.0
            now += equipment.soak_s(self.assumed.device, b - a, self.rate)
            found.append(now + held / 2.0)
        return tuple(one / 3600.0 for one in found)


def propose(spec: AccelerometerRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, planned.RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    name = wishes[0].name if wishes else "inclination"
    found = [one for one in _search(bench) if one is not None]
    if not found:
        raise FitError(
            f"no campaign with {task.attitudes} and {task.remountings} remountings determines the"
            " coefficients",
            hint="allow more --remountings, or lower the orders of the recipe",
        )
    front = find_front(found, name)
    best = choose(found, wishes, task.within_h, name)
    best = _polish(bench, best, wishes)
    schedule, dwells = bench.run(best.design)
    information = bench.information(dwells)
    proposal = Proposal(
        best.label,
        schedule,
        tuple(_predict(bench.model, information, name) for name in planned.RESULTS),
        _coefficients(bench.model, information),
        assumptions.write_recipe(spec, bench.assumed, LOG),
        bench.assumed.device.noise,
        "g",
        bench.assumed.components,
        tuple(front),
        tuple(_usual(bench)),
        bench.assumed.notes,
        {"noise_g": bench.assumed.noise_of(best.design.dwell_s)},
    )
    return proposal, wishes


def _prepare(spec: AccelerometerRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    assumed = assumptions.assume(spec, task)
    low, high = assumed.range_degc
    task.equipment.require_reached(low, high)
    model = assumptions.planned_model(spec, assumed)
    spots, mounting = _list_spots(task, assumed.fixture)
    base = None if assumed.have is None else model.information(assumed.have)
    return _Bench(task, assumed, model, spots, mounting, base)


def _list_spots(task: Task, fixture: str) -> tuple[Array, Integers]:
    """Attitudes [c, 2] [°] of a fixture, and the mounting of each [c]."""
    step = task.equipment.fixture(fixture).step_deg
    if fixture == "file":
        return np.array(task.spots), np.zeros(len(task.spots), dtype=np.int64)
    if fixture == "faces":
        return np.array(FACES, dtype=np.float64), np.zeros(6, dtype=np.int64)
    turns = range(0, 360, step)
    if fixture == "two-axis":
        tilts = [(tilt, roll) for tilt in range(step, 180, step) for roll in turns]
        spots = np.array([(0, 0), *tilts, (180, 0)], dtype=np.float64)
        return spots, np.zeros(len(spots), dtype=np.int64)
    # along the head's axis; across it, in two planes that hold the tool's axis
    along = [(90, roll) for roll in turns]
    planes = [
        [(turn, roll) if turn <= 180 else (360 - turn, roll + 180) for turn in turns]
        for roll in (0, 90)
    ]
    spots = np.array([*along, *planes[0], *planes[1]], dtype=np.float64)
    return spots, np.repeat(np.arange(3), len(along))


def _search(bench: _Bench) -> Iterator[Candidate | None]:
    """Campaigns of all sizes, each the best of its size."""
    task = bench.task
    order = bench.assumed.order
    fewest = 1 if bench.base is not None else order + 2
    most = order + 1 + MOST_SOAKS
    groups = np.unique(bench.mounting)
    wanted = min(task.remountings + 1, len(groups))
    choices = list(combinations(groups.tolist(), wanted))
    rng = np.random.default_rng(task.seed)
    labels = [f"{levels} temperatures" for levels in range(fewest, most + 1)]
    for levels, _ in zip(range(fewest, most + 1), task.progress(labels, "searching"), strict=True):
        for mountings in choices:
            allowed = np.flatnonzero(np.isin(bench.mounting, mountings))
            yield from _search_levels(bench, levels, allowed, rng)


def _search_levels(
    bench: _Bench, levels: int, allowed: Integers, rng: np.random.Generator
) -> Iterator[Candidate | None]:
    """Campaigns with a number of temperatures, at the attitudes that are allowed."""
    device = bench.assumed.device
    shortest = min(device.dwell_s)
    degc = _order_soaks(bench, levels, allowed)
    spots, mounting = bench.spots[allowed], _number(bench.mounting[allowed])
    noise = bench.assumed.noise_of(shortest)
    hours = bench.soak_hours(degc, 16, shortest)
    soaks = Soaks(degc, hours, mounting)
    if not bench.information(soaks.hold(spots, noise)).determined:
        return
    pool = bench.model.pool(spots, soaks, noise, bench.base)
    pool = replace(pool, most=max(1, -(-24 // len(spots)))) if len(spots) < 24 else pool
    counts = [n for n in COUNTS if n <= len(spots) * pool.most]
    for count in counts or [len(spots)]:
        chosen, _ = pool.search(count, rng, bench.task.restarts)
        withheld = planned.spread_apart(spots, chosen, LEFT_OUT)
        for dwell_s in device.dwell_s:
            design = _Design(
                degc,
                tuple(int(allowed[k]) for k in chosen),
                tuple(int(allowed[k]) for k in withheld),
                dwell_s,
            )
            label = f"{count} attitudes, {len(set(degc))} temperatures, dwells of {dwell_s:g} s"
            yield bench.candidate(label, design)


def _number(mounting: Integers) -> Integers:
    """Mountings numbered from 0."""
    return np.asarray(np.unique(mounting, return_inverse=True)[1])


def _order_soaks(bench: _Bench, levels: int, allowed: Integers) -> tuple[int, ...]:
    """Temperatures of a campaign in their order, and back to the first: where the coefficients are
    best determined beside the drift of the session.
    """
    low, high = bench.model.range_degc
    ends = int(np.ceil(low)), int(np.floor(high))
    if levels == 1:
        return (round((low + high) / 2.0),)
    spots, mounting = bench.spots[allowed], _number(bench.mounting[allowed])
    taken = planned.spread_apart(spots, [0], 11)
    noise = bench.assumed.noise_of(min(bench.assumed.device.dwell_s))
    target = bench.model.mean_square("inclination")
    p = len(target)

    def criterion(order: Sequence[int]) -> float:
        degc = (*order, order[0])
        hours = bench.soak_hours(degc, len(taken), min(bench.assumed.device.dwell_s))
        soaks = Soaks(tuple(degc), hours, mounting[taken])
        found = bench.information(soaks.hold(spots[taken], noise))
        if not found.determined:
            return float("inf")
        return float(np.sum(found.covariance[:p, :p] * target))

    start = polynomial.space_levels(*ends, levels)
    # every second temperature on the way back: as long a way, and drift is told from temperature
    order = [*start[::2], *start[1::2][::-1]]
    moves = partial(_moves, ends=ends)
    found, _ = exchange.exchange_values(order, moves, criterion)
    return (*found, found[0])


def _moves(found: Sequence[int], place: int, ends: tuple[int, int]) -> list[int]:
    """Whole temperatures that a place may have beside the others; the ends of the range stay."""
    if found[place] in ends:
        return []
    others = [one for k, one in enumerate(found) if k != place]
    tried = [found[place] + step for step in STEPS_DEGC]
    return [
        one
        for one in tried
        if ends[0] < one < ends[1] and min(abs(one - k) for k in others) >= LEAST_APART_DEGC
    ]


def _polish(bench: _Bench, best: Candidate, wishes: Sequence[Wish]) -> Candidate:
    """The campaign with attitudes taken out while the wishes are met."""
    design: _Design = best.design
    if not wishes or not best.meets(wishes):
        return best
    mounting = _number(bench.mounting)
    while len(design.chosen) > COUNTS[0]:
        hours = bench.soak_hours(design.degc, len(design.chosen), design.dwell_s)
        noise = bench.assumed.noise_of(design.dwell_s)
        pool = bench.model.pool(bench.spots, Soaks(design.degc, hours, mounting), noise, bench.base)
        fewer = [[*design.chosen[:k], *design.chosen[k + 1 :]] for k in range(len(design.chosen))]
        chosen, _ = pool.exchange(min(fewer, key=pool.criterion))
        smaller = replace(design, chosen=tuple(sorted(chosen)))
        smaller = replace(
            smaller, withheld=tuple(planned.spread_apart(bench.spots, smaller.chosen, LEFT_OUT))
        )
        label = (
            f"{len(chosen)} attitudes, {len(set(design.degc))} temperatures, dwells of"
            f" {design.dwell_s:g} s"
        )
        tried = bench.candidate(label, smaller)
        if tried is None or not tried.meets(wishes):
            break
        best, design = tried, smaller
    return best


def _predict(model: Model, information: Information, name: str) -> Predicted:
    """Predicted uncertainty of a result, and what limits it."""
    parts = information.variances(model.result_slopes(name))
    return Predicted.of(name, planned.RESULTS[name], parts)


def _coefficients(model: Model, information: Information) -> tuple[Coefficient, ...]:
    """Predicted standard uncertainties of the coefficients in powers of °C."""
    u = model.in_degrees(information.covariance).tolist()
    return tuple(
        Coefficient(one.model, one.name, one.unit, size)
        for one, size in zip(model.parameters, u, strict=True)
    )


def _usual(bench: _Bench) -> Iterator[Candidate]:
    """Usual campaigns: 6, 12, 18 and 26 attitudes at nine temperatures, from low to high."""
    if bench.assumed.fixture != "two-axis":
        return
    low, high = bench.model.range_degc
    degc = tuple(np.rint(np.linspace(low, high, 9)).astype(int).tolist())
    for name, spots in assumptions.USUAL.items():
        table = replace(
            bench,
            spots=np.array(spots, dtype=np.float64),
            mounting=np.zeros(len(spots), dtype=np.int64),
        )
        design = _Design(degc, tuple(range(len(spots))), (), min(bench.assumed.device.dwell_s))
        found = table.candidate(name, design)
        if found is not None:
            yield found
