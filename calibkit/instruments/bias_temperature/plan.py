"""Campaigns of a static instrument: soaks at which temperatures, how long and how often it is
switched on, and what they will give.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FitError, UsageError
from calibkit.forms import power_unit
from calibkit.frame import values
from calibkit.instruments.bias_temperature.polynomials import EFFECTS, GROUP
from calibkit.numeric.information import find_information
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Effect, Known
from calibkit.planning import recipe_text
from calibkit.planning.linear import (
    LEVELS,
    Results,
    assume_errors,
    choose_some,
    known_sizes,
    list_levels,
    list_usual_levels,
    order_there_and_back,
    raw_uncertainties,
    read_components,
)
from calibkit.planning.proposal import (
    NOTHING,
    ONE_LEVEL_DEGC,
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
from calibkit.planning.schedule import Clock

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.frame import Log
    from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe
    from calibkit.numeric.information import Information
    from calibkit.planning.equipment import Device
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

RANGE_DEGC = (-40.0, 60.0)
FILE = "bias.json"
TURN_ON = (GROUP, EFFECTS[0])
MORE_LEVELS = 4
"""Temperatures that the search takes at most beyond one more than the order needs."""
TIMES = (1, 2, 3)
"""How often the temperatures are gone through, or how often it is switched on at each."""
BLOCKS = 64
"""Parts of a measured log whose mean temperatures are taken."""
RESTART = "the instrument is switched off and on before each log that a fit sees"


@dataclass(frozen=True, slots=True)
class _Rows:
    """Means over spans of logs."""

    degc: Array
    log: Integers
    noise: Array

    @classmethod
    def none(cls) -> _Rows:
        """No rows."""
        return cls(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0))

    def join(self, degc: Array, noise: Array, log: Integers) -> _Rows:
        """These rows and those of other logs, numbered from 0."""
        return _Rows(
            np.concatenate([self.degc, degc]),
            np.concatenate([self.log, log + int(self.log.max(initial=-1)) + 1]),
            np.concatenate([self.noise, noise]),
        )


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: temperatures of its logs in their order, length of each."""

    degc: tuple[int, ...]
    dwell_s: float

    @property
    def label(self) -> str:
        """The campaign in a few words."""
        if not self.degc:
            return NOTHING
        held = count(len(self.degc), "log")
        places = count(len({*self.degc}), "temperature")
        return f"{held} at {places}, {self.dwell_s / 60.0:g} min each"


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    order: int
    range_degc: tuple[float, float]
    components: tuple[ErrorComponent, ...]
    turn_on: Known
    results: Results
    have: _Rows

    @property
    def scale(self) -> tuple[float, float]:
        """Middle and half-width of the range of use."""
        return polynomial.middle_and_half(np.array(self.range_degc))

    def rows(self, design: _Design) -> _Rows:
        """What is measured already, and a mean of each log of a design."""
        degc = np.array(design.degc, dtype=np.float64)
        noise = self.device.noise * np.sqrt(self.device.noise_s / max(design.dwell_s, 1.0))
        return self.have.join(degc, np.full(degc.size, noise), np.arange(degc.size))

    def information(self, rows: _Rows) -> Information:
        """Information on the powers of temperature."""
        middle, half = self.scale
        powers = polynomial.powers(rows.degc, self.order, middle=middle, half=half)
        effect = Effect(*TURN_ON, rows.log, np.ones(rows.log.size), self.turn_on)
        return find_information(powers / rows.noise[:, None], 1.0, [effect.divided_by(rows.noise)])

    def schedule(self, design: _Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with the longest way between two
        temperatures in a log that is.
        """
        equipment, clock = self.task.equipment, Clock(self.task.equipment)
        rate = equipment.fastest(self.device)
        steps = [abs(b - a) for a, b in pairwise(design.degc)]
        longest = int(np.argmax(steps)) + 1 if steps and not self.task.withheld else -1
        stem = self.task.name_log("soak")
        for number, degc in enumerate(design.degc):
            settle_s = equipment.soak_s(self.device, degc - clock.degc, rate)
            own = f"{WITHHELD}{stem}_way_to_{degc}.csv" if number == longest else ""
            clock.ramp(float(degc), rate, own)
            clock.soak(settle_s, own)
            # while it settles the instrument warms up, but where it is on from before
            warm_s = self.device.warm_up_s - (0.0 if own else settle_s)
            clock.soak(max(warm_s, 0.0))
            clock.soak(design.dwell_s, f"{stem}_{number + 1:02d}_{degc}.csv")
        return clock.schedule()

    def candidate(self, design: _Design) -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all, or has
        no temperature more than the order needs or none at an end of the range.
        """
        rows = self.rows(design)
        if not cover_range(rows.degc, self.order + 2, self.range_degc):
            return None
        hours = self.schedule(design).hours
        return self.results.candidate(design.label, hours, self.information(rows), design)


def propose(spec: BiasTemperatureRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    bench = _prepare(spec, task)
    wishes = tuple(Wish.parse(text, bench.results.units) for text in task.wishes)
    name = wishes[0].name if wishes else "drift"
    found = [one for one in map(bench.candidate, _list_designs(bench)) if one is not None]
    if not found:
        raise FitError(
            "no campaign determines the polynomial over the range",
            hint="plan without --have, or for a narrower --range",
        )
    best = choose(found, wishes, task.within_h, name)
    design: _Design = best.design
    information = bench.information(bench.rows(design))
    lag_s, white = max(bench.device.lags_s), bench.device.noise * bench.device.noise_s**0.5
    return Proposal(
        best.label,
        bench.schedule(design),
        bench.results.predict(information),
        tuple(_list_coefficients(spec, bench, information)),
        bench.range_degc,
        recipe_text.write_recipe(
            spec,
            [task.name_log("soak_*.csv")] if design.degc else [],
            bench.components,
            {},
            added=bool(task.have),
        ),
        bench.device.noise,
        bench.device.noise_unit,
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else _list_usual(bench),
        (*((RESTART,) if design.degc else ()), *task.describe_range(RANGE_DEGC)),
        {"lag_s": lag_s, "noise_1s": white},
    ), wishes


def judge(spec: BiasTemperatureRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    bench = _prepare(spec, task)
    found = bench.information(bench.have)
    return bench.results.predict(found) if found.determined else ()


def _prepare(spec: BiasTemperatureRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device, own = task.equipment.known_device(spec.procedure), spec.polynomials
    other = [one for one in spec.still_columns() if units.column_unit(one) != device.noise_unit]
    order = max(one.order for one in own.bias)
    if other or units.column_unit(own.abscissa) != "degC" or order < 1:
        raise UsageError(
            f"a plan is for channels in {device.noise_unit} as polynomials of a temperature in"
            f" °C; the recipe has {', '.join(other) or own.abscissa} of order {order}",
            hint=f"plan channels of one unit, that of noise_unit in [device.{spec.procedure}]",
        )
    low, high = range_degc = task.range_degc or RANGE_DEGC
    task.equipment.require_reached(low, high)
    unit = device.noise_unit
    seen = () if task.earlier is None else read_components(task.earlier, FILE, spec.procedure)
    earlier = [one for one in seen if (one.group, one.effect) == TURN_ON]
    stated = assume_errors(spec, device, earlier, {TURN_ON: unit})
    size = known_sizes(stated.values(), {TURN_ON: unit}).get(TURN_ON, Known(0.0))
    middle, half = polynomial.middle_and_half(np.array(range_degc))
    used = np.append(np.linspace(low, high, LEVELS), np.clip(spec.reference_temp_degc, low, high))
    powers = polynomial.powers(used, order, middle=middle, half=half)
    results = Results(
        {"drift": unit, "bias": unit}, {"drift": powers[:-1] - powers[-1], "bias": powers[:-1]}
    )
    have = _measure(task.have, own.abscissa, device)
    return _Bench(task, device, order, range_degc, tuple(stated.values()), size, results, have)


def _measure(logs: Sequence[Log], abscissa: str, device: Device) -> _Rows:
    """Mean temperatures of parts of measured logs; FitError for a log without times."""
    rows = _Rows.none()
    for log in logs:
        if "time_s" not in log.frame.columns:
            raise FitError(
                f"{log.file}: no times, expected time_s to know how long it is",
                hint="map it under [columns.time_s], or plan without --have",
            )
        degc, time = values(log.frame, abscissa), values(log.frame, "time_s")
        parts = 1 if np.ptp(degc) < ONE_LEVEL_DEGC else min(BLOCKS, degc.size)
        means = np.array([part.mean() for part in np.array_split(degc, parts)])
        noise = device.noise * np.sqrt(device.noise_s * parts / (time[-1] - time[0]))
        rows = rows.join(means, np.full(parts, noise), np.zeros(parts, dtype=np.int64))
    return rows


def _list_designs(bench: _Bench) -> Iterator[_Design]:
    """Campaigns of all sizes; beside what is measured, those of the temperatures that it lacks, and
    an empty one.
    """
    seen: set[tuple[int, ...]] = {()}
    if bench.have.degc.size:
        yield _Design((), 0.0)
    for levels in list_levels(bench.task, bench.order, MORE_LEVELS, bench.range_degc):
        tour = order_there_and_back(levels)
        tours = (tour[:-1] * number + tour[:1] for number in TIMES)
        listed = [*tours, *(tuple(np.repeat(tour, number).tolist()) for number in TIMES)]
        listed += choose_some(tour[:-1]) if bench.have.degc.size else ()
        for degc in listed:
            if degc not in seen:
                seen.add(degc)
                yield from (_Design(degc, dwell_s) for dwell_s in bench.device.dwell_s)


def _list_coefficients(
    spec: BiasTemperatureRecipe, bench: _Bench, information: Information
) -> Iterator[Coefficient]:
    """Predicted standard uncertainties in powers of °C; of a channel of a lower order as of the
    highest.
    """
    every = raw_uncertainties(information, bench.order, bench.range_degc)
    for channel in spec.polynomials.bias:
        for k, u in enumerate(every[: channel.order + 1]):
            unit = power_unit(bench.device.noise_unit, "degC", k)
            yield Coefficient(channel.indication, f"p{k}", unit, u)


def _list_usual(bench: _Bench) -> tuple[Candidate, ...]:
    """The usual campaign: an hour at each of nine temperatures, from low to high."""
    found = bench.candidate(_Design(list_usual_levels(bench.range_degc), 3600.0))
    return () if found is None else (found,)
