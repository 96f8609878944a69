"""Campaigns of a gyro in a chamber: which ramps with which soaks, and what they will give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, product, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import UsageError
from calibkit.instruments.fog_thermal import assumptions, simulate as simulated
from calibkit.instruments.fog_thermal.numeric import planned
from calibkit.instruments.fog_thermal.numeric.planned import Model, Ramp
from calibkit.instruments.fog_thermal.simulate_gyro import FogGyro
from calibkit.numeric.information import invert
from calibkit.planning import recipe_text
from calibkit.planning.linear import find_largest
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
    cover_range,
    find_front,
)
from calibkit.planning.schedule import Clock
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
    from calibkit.numeric.information import Information
    from calibkit.planning.equipment import Device
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

RANGE_DEGC = (-40.0, 60.0)
RATES = (1, 2, 3, 5, 8, 10)
"""Unsigned rates [°C/min] that the search takes."""
FEWEST_RATES = 2
"""Rates of each direction that a fit needs, so that one can be left out."""
MOST = 4
"""Ramps of each direction that the search takes at most."""
SAMPLE = (1, 5, 8, 10)
"""Rates of the usual campaign, which the sample logs have."""


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: unsigned rates of the heating and of the cooling ramps, soak after each."""

    heating: tuple[int, ...]
    cooling: tuple[int, ...]
    after_s: float

    @property
    def ramps(self) -> list[Ramp]:
        """Ramps in their order: heating and cooling by turns; one may be heating alone."""
        return [
            Ramp(float(sign * rate), self.after_s)
            for pair in zip_longest(self.heating, self.cooling)
            for sign, rate in zip((1, -1), pair, strict=True)
            if rate is not None
        ]

    @property
    def label(self) -> str:
        """The campaign in a few words."""
        if not self.heating:
            return NOTHING
        if self.heating == self.cooling:
            rates = ", ".join(f"±{rate}" for rate in self.heating)
        else:
            signed = [*(f"+{rate}" for rate in self.heating), *(f"−{r}" for r in self.cooling)]
            rates = ", ".join(signed)
        return f"ramps of {rates} °C/min, soaks of {self.after_s / 60.0:g} min"


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    model: Model
    components: tuple[ErrorComponent, ...]
    slopes: Mapping[str, Array]
    """Result → its derivatives where it is used."""
    have: assumptions.Measured
    notes: tuple[str, ...]

    def information(self, ramps: Sequence[Ramp]) -> Information:
        """Information of what is measured already and of ramps."""
        return self.model.information([*self.have.logs, *map(self.model.log, ramps)])

    def predict(self, ramps: Sequence[Ramp]) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result."""
        found = self.information(ramps)
        return tuple(
            Predicted.of(name, unit, found.variances(self.slopes[name]))
            for name, unit in planned.RESULTS.items()
        )

    def suffices(self, ramps: Sequence[Ramp]) -> bool:
        """Whether a fit can leave out ramps of each direction, these and those that are measured:
        two of other rates.
        """
        return min(self.have.rates_with(ramp.rate for ramp in ramps)) >= FEWEST_RATES

    def schedule(self, design: _Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with one heating ramp at its end
        that is.
        """
        low, _ = self.model.range_degc
        rate = self.task.equipment.fastest(self.device)
        clock = Clock(self.task.equipment)
        if not design.heating:
            return clock.schedule()
        change = low - clock.degc
        clock.ramp(low, rate)
        clock.soak(self.task.equipment.soak_s(self.device, change, rate))
        own = [*design.ramps, *(Ramp(float(one), design.after_s) for one in self.withheld(design))]
        for number, ramp in enumerate(own):
            log = self.task.name_log(f"ramp_{_sense(ramp)}_{abs(ramp.rate):02g}.csv")
            log = log if number < len(design.ramps) else f"{WITHHELD}{log}"
            clock.soak(planned.BEFORE_S, log)
            clock.ramp(self.model.range_degc[ramp.rate > 0.0], abs(ramp.rate), log)
            clock.soak(ramp.after_s, log)
        return clock.schedule()

    def withheld(self, design: _Design) -> tuple[int, ...]:
        """Rate of the ramp that is withheld: between those of the design, and none of them; empty
        where a log is withheld already.
        """
        if self.task.withheld:
            return ()
        fastest = self.task.equipment.fastest(self.device)
        spare = [one for one in RATES if one not in design.heating and one <= fastest]
        middle = float(np.sqrt(design.heating[0] * design.heating[-1]))
        return (min(spare or [design.heating[0]], key=lambda one: abs(np.log(one / middle))),)

    def hours(self, design: _Design) -> float:
        """Length of the ramps of a design and of the withheld one, without a schedule."""
        if not design.heating:
            return 0.0
        low, high = self.model.range_degc
        ramps = [*(abs(one.rate) for one in design.ramps), *self.withheld(design)]
        held = len(ramps) * (planned.BEFORE_S + design.after_s)
        return (held + 60.0 * sum((high - low) / rate for rate in ramps)) / SECONDS_PER_HOUR

    def candidate(self, design: _Design, parts: Mapping[Ramp, Array], base: Array) -> Candidate:
        """A campaign with the hours of its ramps, and uncertainties; `base` is the information of
        what is measured already.
        """
        own = [base, *(parts[ramp] for ramp in design.ramps)]
        covariance = planned.covariance_of(own, self.model.prior)
        largest = find_largest(self.slopes, covariance)
        return Candidate(design.label, self.hours(design), largest, design)


def _sense(ramp: Ramp) -> str:
    return "heating" if ramp.rate > 0.0 else "cooling"


def propose(spec: FogThermalRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, planned.RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    name = wishes[0].name if wishes else "drift"
    found = list(_search(bench))
    if not found:
        raise UsageError(
            f"fastest_degc_per_min leaves one of the rates {', '.join(map(str, RATES))} °C/min,"
            f" expected {FEWEST_RATES}: a fit leaves out a ramp of each direction",
            hint="state the fastest ramp of chamber and device in the equipment file",
        )
    best = choose(found, wishes, task.within_h, name)
    information = bench.information(best.design.ramps)
    u = np.sqrt(np.diag(invert(information.data + np.diag(information.prior + 1e-12))))
    terms = planned.BANK.terms
    files = [task.name_log("ramp_*.csv")] if best.design.heating else []
    return Proposal(
        best.label,
        bench.schedule(best.design),
        bench.predict(best.design.ramps),
        tuple(
            Coefficient("bank", key, unit, float(size))
            for (key, unit), size in list(zip(terms, u, strict=False))[1:]
        ),
        bench.model.range_degc,
        recipe_text.write_recipe(spec, files, (), {}, added=bool(task.have)),
        bench.device.noise,
        "deg/h",
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else tuple(one for one in found if one.label == _usual(bench).label),
        (*bench.notes, *task.describe_range(RANGE_DEGC)),
        {
            "range_degc": list(bench.model.range_degc),
            "case_lag_s": bench.model.case_lag_s,
            "white_dph": bench.model.white_dph,
        },
    ), wishes


def judge(spec: FogThermalRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the ramps that are measured tell of the drift."""
    return _prepare(spec, task).predict(())


def _prepare(spec: FogThermalRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure, "deg/h")
    low, high = task.range_degc or RANGE_DEGC
    task.equipment.require_reached(low, high)
    stated = {(one.group, one.effect): one for one in device.component}
    notes: tuple[str, ...] = ()
    if task.earlier is not None:
        noise, earlier = assumptions.read_run(task.earlier, device.noise_s)
        device = device.model_copy(update={"noise": noise})
        stated |= earlier
        sizes = (f"{effect} {one.value:.2g}" for (_, effect), one in earlier.items())
        notes = (f"of that run: noise {noise:.2g}, {', '.join(sizes)} deg/h",)
    if not {("coil", "drift"), ("log", "turn-on")} <= stated.keys() <= planned.UNITS.keys():
        raise UsageError(
            f"components of [device.{spec.procedure}]:"
            f" {', '.join(f'{effect} of {group}' for group, effect in stated)}",
            hint="expected drift of coil and turn-on of log, with initial state and flicker of log",
        )
    sizes_dph = {key: one.value_in(planned.UNITS[key]) for key, one in stated.items()}
    white = device.noise * float(np.sqrt(device.noise_s / planned.STEP_S))
    model = Model((low, high), min(device.lags_s), white, sizes_dph)
    slopes = {name: model.result_slopes(name) for name in planned.RESULTS}
    have = assumptions.measure_logs(spec, task.have)
    return _Bench(task, device, model, tuple(stated.values()), slopes, have, notes)


def _usual(bench: _Bench) -> _Design:
    """The usual campaign: eight ramps with long soaks."""
    rates = tuple(rate for rate in SAMPLE if rate <= bench.task.equipment.fastest(bench.device))
    return _Design(rates, rates, max(bench.device.dwell_s))


def _search(bench: _Bench) -> Iterator[Candidate]:
    """Every campaign of two to four rates of each direction; where something is measured already
    and withheld, also those of one heating ramp more, and none.
    """
    fastest = bench.task.equipment.fastest(bench.device)
    rates = [rate for rate in RATES if rate <= fastest]
    sets = [found for size in range(1, MOST + 1) for found in combinations(rates, size)]
    labels = [f"soaks of {after / 60.0:g} min" for after in bench.device.dwell_s]
    fixed = bench.schedule(_usual(bench)).hours - bench.hours(_usual(bench))
    base = np.sum(
        [np.zeros((len(bench.model.prior),) * 2), *map(bench.model.part, bench.have.logs)], 0
    )
    more = (0, 1) if bench.have.logs and bench.task.withheld else (0,)
    measured = [one for log in bench.have.logs for one in (log.case.min(), log.case.max())]
    if bench.suffices(()) and cover_range(measured, 2, bench.model.range_degc):
        yield bench.candidate(_Design((), (), 0.0), {}, base)
    for after, _ in zip(
        bench.device.dwell_s, bench.task.progress(labels, "searching"), strict=True
    ):
        ramps = [Ramp(float(sign * rate), after) for rate in rates for sign in (1, -1)]
        parts = {ramp: bench.model.part(bench.model.log(ramp)) for ramp in ramps}
        for heating, cooling in product(sets, [(), *sets]):
            design = _Design(heating, cooling, after)
            if len(heating) - len(cooling) in more and bench.suffices(design.ramps):
                found = bench.candidate(design, parts, base)
                # the way to the first temperature is common to all
                yield replace(found, hours=found.hours + fixed)


def simulate(
    spec: FogThermalRecipe,  # noqa: ARG001 (as every planner's)
    schedule: Schedule,
    document: Mapping[str, Any],
    seed: int,
) -> Campaign:
    """Logs of a simulated gyro on the ramps of a schedule, and its truth."""
    device, chamber = FogGyro.draw(seed), Chamber()
    runs = {}
    for name in dict.fromkeys(one.log for one in schedule.actions if one.log):
        before, ramp, after = (one for one in schedule.actions if one.log == name)
        runs[name] = Programme.ramp(
            before.set_degc,
            ramp.set_degc,
            abs(ramp.ramp_degc_per_min),
            soak_before_s=before.duration_s,
            soak_after_s=after.duration_s,
        )
    made = simulated.logs(device, runs, seed, chamber)
    truth = simulated.describe(device, chamber, runs, made)
    logs = {name: one.columns for name, one in made.items()}
    stated = {"seed": seed, "plan": document["sha256"]}
    return Campaign(logs, simulated.DECIMALS, truth | stated)
