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
from calibkit.planning.linear import list_usual_levels
from calibkit.planning.proposal import (
    NOTHING,
    WITHHELD,
    Candidate,
    Coefficient,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    count,
    cover_range,
    find_front,
)
from calibkit.planning.schedule import Clock, Schedule

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.accelerometer.assumptions import Assumed
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.numeric.information import Information

LOG = "positions.csv"
MOST_SOAKS = 5
"""Temperatures that the search takes at most beyond what the order needs."""
COUNTS = (6, 8, 10, 12, 16, 20, 24, 30, 36, 42, 50)
"""Numbers of attitudes that the search takes."""
LEFT_OUT = 2
"""Attitudes that are withheld."""
STEPS_DEGC = (-20, -5, -1, 1, 5, 20)
"""Exchanges of a temperature."""
APART = 0.5
"""Least distance of two temperatures, of that of as many in even steps: so that the one beyond the
order shows a lack of fit.
"""


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: soaks in their order, attitudes by number among those of the fixture."""

    degc: tuple[int, ...]
    chosen: tuple[int, ...]
    withheld: tuple[int, ...]
    dwell_s: float

    @property
    def label(self) -> str:
        """The campaign in a few words."""
        if not self.chosen:
            return NOTHING
        levels = count(len(set(self.degc)), "temperature")
        return f"{len(self.chosen)} attitudes, {levels}, dwells of {self.dwell_s:g} s"


NO_DWELLS = _Design((), (), (), 0.0)
"""An empty campaign."""


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
        log = self.task.name_log(LOG)
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
                    clock.dwell(
                        self.spots[k].tolist(),
                        design.dwell_s,
                        log if k in own else f"{WITHHELD}{log}",
                    )
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

    def explain(self, design: _Design) -> Information | None:
        """Information of a design and of what is measured already, with all sources; None where
        there is neither.
        """
        if not design.chosen:
            return self.base
        found = self.model.information(self.run(design)[1])
        return found if self.base is None else found.join(self.base)

    def predict(self, found: Information) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result, and what limits it."""
        return tuple(
            Predicted.of(name, unit, found.variances(self.model.result_slopes(name)))
            for name, unit in planned.RESULTS.items()
        )

    def candidate(self, design: _Design, label: str = "") -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all, or has
        no temperature more than the order needs or none at an end of the range.
        """
        have = self.assumed.have
        measured = [] if have is None else have.temperature.tolist()
        fewest = self.assumed.order + 2
        if not cover_range([*measured, *design.degc], fewest, self.model.range_degc):
            return None
        hours, found = 0.0, self.base
        if design.chosen:
            schedule, dwells = self.run(design)
            hours, found = schedule.hours, self.information(dwells)
        if found is None or not found.determined:
            return None
        covariance = found.covariance
        largest = {}
        for name in planned.RESULTS:
            slopes = self.model.result_slopes(name)
            variance = np.einsum("mp,pq,mq->m", slopes, covariance, slopes)
            largest[name] = float(np.sqrt(variance.max()))
        return Candidate(label or design.label, hours, largest, design)

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
    design: _Design = best.design
    information = bench.explain(design)
    assert information is not None  # noqa: S101 (a campaign without dwells has what is measured)
    log = task.name_log(LOG) if design.chosen else None
    noise = {"noise_g": bench.assumed.noise_of(design.dwell_s)} if design.chosen else {}
    proposal = Proposal(
        best.label,
        bench.run(design)[0] if design.chosen else Schedule(()),
        bench.predict(information),
        _coefficients(bench.model, information),
        bench.model.range_degc,
        assumptions.write_recipe(spec, task, bench.assumed, log),
        bench.assumed.noise_g,
        "g",
        bench.assumed.components,
        tuple(front),
        () if task.have else tuple(_usual(bench)),
        (*bench.assumed.notes, *task.describe_range(assumptions.RANGE_DEGC)),
        noise,
    )
    return proposal, wishes


def judge(spec: AccelerometerRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the dwells that are measured tell; empty where they do not determine all."""
    bench = _prepare(spec, task)
    if bench.base is None or bench.candidate(NO_DWELLS) is None:
        return ()
    return bench.predict(bench.base)


def _prepare(spec: AccelerometerRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    assumed = assumptions.assume(spec, task)
    low, high = assumed.range_degc
    task.equipment.require_reached(low, high)
    model = assumptions.planned_model(spec, assumed)
    spots, mounting = assumptions.list_spots(task, assumed.fixture)
    base = None if assumed.have is None else model.information(assumed.have)
    return _Bench(task, assumed, model, spots, mounting, base)


def _search(bench: _Bench) -> Iterator[Candidate | None]:
    """Campaigns of all sizes, each the best of its size."""
    task = bench.task
    order = bench.assumed.order
    if bench.base is not None:
        yield bench.candidate(NO_DWELLS)
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
    for size in counts or [len(spots)]:
        chosen, _ = pool.search(size, rng, bench.task.restarts)
        left_out = 0 if bench.task.withheld else LEFT_OUT
        withheld = planned.spread_apart(spots, chosen, left_out)
        for dwell_s in device.dwell_s:
            design = _Design(
                degc,
                tuple(int(allowed[k]) for k in chosen),
                tuple(int(allowed[k]) for k in withheld),
                dwell_s,
            )
            yield bench.candidate(design)


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
    apart = APART * (ends[1] - ends[0]) / len(others)
    tried = [found[place] + step for step in STEPS_DEGC]
    return [
        one
        for one in tried
        if ends[0] < one < ends[1] and min(abs(one - k) for k in others) >= apart
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
        apart = planned.spread_apart(bench.spots, smaller.chosen, len(design.withheld))
        smaller = replace(smaller, withheld=tuple(apart))
        tried = bench.candidate(smaller)
        if tried is None or not tried.meets(wishes):
            break
        best, design = tried, smaller
    return best


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
    degc = list_usual_levels(bench.model.range_degc)
    for name, spots in assumptions.USUAL.items():
        table = replace(
            bench,
            spots=np.array(spots, dtype=np.float64),
            mounting=np.zeros(len(spots), dtype=np.int64),
        )
        design = _Design(degc, tuple(range(len(spots))), (), min(bench.assumed.device.dwell_s))
        found = table.candidate(design, name)
        if found is not None:
            yield found
