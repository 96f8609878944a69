"""Campaigns of two gyros, a run about the axis of each: which rates, how long, and what N and the
angle between them will be known to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import assumptions, planned_runs
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.numeric.planned import Holds, Model
from calibkit.instruments.gyro_scale.planned_runs import NO_RUNS, Bench, Design
from calibkit.planning import recipe_text
from calibkit.planning.linear import assume_errors, known_sizes, refuse_range
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
    find_front,
)
from calibkit.planning.schedule import Clock

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
    from calibkit.planning.schedule import Schedule

AXES = ("a", "b")
RESULTS = {"N": "ppm", planned.ANGLE: "deg"}
TEMPERATURE = ("run", "temperature")
UNITS = planned.UNITS | {TEMPERATURE: "degC"}
ONE_LOG = "a fit reads one log of each axis: what is measured is not measured again"


@dataclass(frozen=True, slots=True)
class _PairBench:
    """What the search needs to know."""

    runs: Bench
    coefficient: float
    """Standard deviation of what temperature changes N by, of a difference of 1 °C between the
    runs [1/°C].
    """
    missing: tuple[str, ...]
    """Axes about which nothing is measured."""

    def variances(self, name: str, campaign: Mapping[str, Holds]) -> dict[str, Array]:
        """Variance [1] of a result that noise and each source leave."""
        bench = self.runs
        size = {key: one.value for key, one in bench.model.sizes.items()}
        at = np.array([bench.reference_degc])
        if name == "N":
            each = [bench.variances_of("scale factor", campaign[axis], at) for axis in AXES]
            found = {source: each[0][source] + each[1][source] for source in each[0]}
            apart = np.sqrt(2.0) * size.get(TEMPERATURE, 0.0) * self.coefficient * PPM
            return found | {"temperature of the run": np.array([apart**2])}
        # of B about A's axis, where it turns little: no scale factor and no response matters
        still = bench.model.without(("run", "scale")).without(("rate", "response"))
        across = replace(bench, model=still).variances_of("scale factor", campaign["a"], at)
        in_deg = float(np.degrees(1.0 / PPM)) ** 2
        mounted = np.array([size.get(planned.MOUNTING, 0.0) ** 2])
        return {key: part * in_deg for key, part in across.items()} | {
            "angle of the mounting": mounted
        }

    def predict(self, campaign: Mapping[str, Holds]) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result."""
        return tuple(
            Predicted.of(name, unit, self.variances(name, campaign))
            for name, unit in RESULTS.items()
        )

    def campaign(self, design: Design) -> dict[str, Holds]:
        """Table axis → what is measured, and holds of a design about the other axes."""
        if not design.rates:
            return dict(self.runs.have)
        own = self.runs.runs(design, "").holds()
        return dict.fromkeys(AXES, own) | dict(self.runs.have)

    def candidate(self, design: Design) -> Candidate:
        """A campaign with its hours and uncertainties."""
        largest = {one.name: one.largest_u for one in self.predict(self.campaign(design))}
        return Candidate(self.label(design), self.schedule(design).hours, largest, design)

    def label(self, design: Design) -> str:
        """A design in a few words."""
        if not design.rates:
            return NOTHING
        return (
            f"{len(design.rates)} rates both ways about {len(self.missing)} of 2 axes, holds of"
            f" {design.shortest_s:g} s"
        )

    def schedule(self, design: Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with one run about the first axis
        that is.
        """
        task, clock = self.runs.task, Clock(self.runs.task.equipment)
        for axis in self.missing if design.rates else ():
            if axis != self.missing[0]:
                clock.remount(task.equipment.fastest(self.runs.device))
            name = _log_about(task, axis)
            self.runs.run_at(clock, design, round(self.runs.reference_degc), name)
            if axis == self.missing[0] and not task.withheld:
                name = f"{WITHHELD}{name}"
                self.runs.run_at(clock, design, round(self.runs.reference_degc), name)
        return clock.schedule()


def _log_about(task: Task, axis: str) -> str:
    """Log of the run about an axis."""
    return task.name_log(f"table_axis_{axis}.csv")


def propose(spec: GyroPairRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    name = wishes[0].name if wishes else "N"
    found = [bench.candidate(design) for design in _list_designs(bench)]
    best = choose(found, wishes, task.within_h, name)
    design: Design = best.design
    predicted = bench.predict(bench.campaign(design))
    stated = [one for one in bench.runs.components if (one.group, one.effect) == planned.MOUNTING]
    logs = {f"axis_{axis}": _log_about(task, axis) for axis in bench.missing}
    sizes = {one.name: one.largest_u for one in predicted}
    return Proposal(
        best.label,
        bench.schedule(design),
        predicted,
        (
            Coefficient("pair", "N", "1", sizes["N"] / PPM),
            Coefficient("pair", "alpha_deg", "deg", sizes[planned.ANGLE]),
        ),
        bench.runs.model.range_degc,
        recipe_text.write_recipe(
            spec, list(logs.values()), stated, {"pair": logs}, added=bool(task.have)
        ),
        bench.runs.device.noise,
        "deg/s",
        bench.runs.components,
        tuple(find_front(found, name)),
        () if task.have else (_usual(bench),),
        (ONE_LOG,) if task.have else (),
        {"hold_s": design.shortest_s, "coefficient_per_degc": bench.coefficient},
    ), wishes


def judge(spec: GyroPairRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the runs that are measured tell; empty where one is missing."""
    bench = _prepare(spec, task)
    return () if bench.missing else bench.predict(bench.campaign(NO_RUNS))


def _fastest(bench: _PairBench) -> int:
    """Fastest rate [°/s]."""
    return int(bench.runs.table.fastest_dps)


def _usual(bench: _PairBench) -> Candidate:
    """The usual campaign: eleven rates, one side after the other."""
    rates = tuple(planned.spread_rates(_fastest(bench), 11, even=False))
    at = (round(bench.runs.reference_degc),)
    found = bench.candidate(Design(rates, alternating=False, shortest_s=30.0, degc=at))
    return replace(found, label="usual: 11 rates")


def _list_designs(bench: _PairBench) -> Iterator[Design]:
    """Runs of all numbers of rates and lengths of holds; an empty one where nothing is missing."""
    if not bench.missing:
        yield NO_RUNS
        return
    at = (round(bench.runs.reference_degc),)
    labels = [f"{count} rates" for count in bench.runs.table.rates]
    listed = zip(bench.runs.table.rates, bench.runs.task.progress(labels, "searching"), strict=True)
    for number, _ in listed:
        ladders = {
            tuple(planned.spread_rates(_fastest(bench), number, even=even))
            for even in (True, False)
        }
        for rates, shortest, alternating in product(
            sorted(ladders), bench.runs.device.dwell_s, (True, False)
        ):
            yield Design(rates, alternating, shortest, at)


def _prepare(spec: GyroPairRecipe, task: Task) -> _PairBench:
    """What the search needs; UsageError for what cannot be planned."""
    device, table = planned_runs.require_table(task, spec.procedure)
    refuse_range(task, spec.procedure)
    earlier = {} if task.earlier is None else assumptions.read_run(task.earlier)
    stated = assume_errors(spec, device, earlier.values(), UNITS)
    have = assumptions.measure_runs(spec, task.have, device)
    twice = len(task.have) > len(have)
    if twice:
        raise FitError(
            f"{len(task.have)} logs of {len(have)} table axes, expected one of each",
            hint="name the log of each axis under [pair]",
        )
    degc = [float(one.rows.row_degc.mean()) for one in have.values()]
    reference = float(np.mean(degc or [spec.reference_temp_degc]))
    around = reference - 1.0, reference + 1.0
    task.equipment.require_reached(*around)
    model = Model(0, around, known_sizes(stated.values(), UNITS))
    components: Any = tuple(stated.values())
    bench = Bench(
        *(task, device, table, model, reference, spec.gyros, components),
        *(RESULTS, AXES, have, ()),
    )
    missing = tuple(axis for axis in AXES if axis not in have)
    return _PairBench(bench, _coefficient(spec), missing)


def _coefficient(spec: GyroPairRecipe) -> float:
    """Standard deviation of what temperature changes N by [1/°C], as the fit takes it."""
    if spec.pair.temperature_coefficients_ppm_degc is None:
        return spec.pair.largest_temperature_coefficient_ppm_degc / PPM / float(np.sqrt(3.0))
    # each gyro is brought to the middle of both temperatures by its own coefficient
    return spec.pair.temperature_coefficient_uncertainty_ppm_degc / PPM / float(np.sqrt(2.0))
