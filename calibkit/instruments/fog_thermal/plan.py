"""Campaigns of a gyro in a chamber: which ramps with which soaks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.frame import refuse
from calibkit.instruments.fog_thermal import forms, ramps, simulate as simulated
from calibkit.instruments.fog_thermal.numeric import planned
from calibkit.instruments.fog_thermal.numeric.planned import CaseLog, Model, Ramp
from calibkit.instruments.fog_thermal.simulate_gyro import FogGyro
from calibkit.instruments.fog_thermal.uncertainty import TURN_ON
from calibkit.planning.assumptions import assume
from calibkit.planning.proposal import WITHHELD, Coefficient, Design, cover_range
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench
from calibkit.planning.simulation import as_planned
from calibkit.recipe.tables import ErrorComponent
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.coefficients import Record, StageResult
    from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Sources
    from calibkit.simulate.campaign import Campaign

RANGE_DEGC = (-40.0, 60.0)
RATES = (1, 2, 3, 5, 8, 10)
"""Unsigned rates [°C/min] that the search takes."""
FEWEST_RATES = 2
"""Rates of each direction that a fit needs, so that one can be left out."""
MOST = 4
"""Ramps of each direction that the search takes at most."""
SAMPLE = (1, 5, 8, 10)
"""Rates of the usual campaign, which the sample logs have."""
DIFFERENT = 1.1
"""Ratio of two rates from which on they differ."""
BEFORE, NOISE = "drift_rms_before.", "noise_rms."
"""Figures of the drift rms of a log and of the noise in it begin with these."""


@dataclass(frozen=True)
class RampBench(Bench):
    """Campaigns of a gyro on ramps."""

    model: Model
    measured_rates: tuple[float, ...]
    """Signed rates [°C/min] of their ramps."""

    @property
    def fastest(self) -> float:
        """Fastest ramp [°C/min]."""
        return self.task.equipment.fastest(self.assumed.device)

    @cached_property
    def base(self) -> Array:
        """Information of what is measured already."""
        none = np.zeros((3, len(self.model.prior), len(self.model.prior)))
        return np.asarray(np.sum([none, *map(self.model.part, self.have)], axis=0))

    @cached_property
    def parts(self) -> dict[Ramp, Array]:
        """Information of each ramp that was asked for."""
        return {}

    def information(self, design: Design) -> Array:
        """Information of what is measured already and of a design."""
        total = self.base
        for ramp in design.rows or ():
            if ramp not in self.parts:
                self.parts[ramp] = self.model.part(self.model.log(ramp))
            total = total + self.parts[ramp]
        return total

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives where it is used."""
        return {name: self.model.result_slopes(name) for name in planned.RESULTS}

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result."""
        return self.model.variances(self.information(design), self.slopes)

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """Of the bank, without its constant."""
        u = self.model.uncertainty(self.information(design)).tolist()
        for (name, unit), size in list(zip(planned.BANK.terms, u, strict=False))[1:]:
            yield Coefficient("bank", name, unit, size)

    def suffices(self, rates: Iterable[float]) -> bool:
        """Whether a fit can leave out ramps of each direction, signed rates and those that are
        measured: two of other rates.
        """
        every = [*self.measured_rates, *rates]
        heating = _count_rates(one for one in every if one > 0.0)
        return min(heating, _count_rates(-one for one in every if one < 0.0)) >= FEWEST_RATES

    def design(self, heating: Sequence[int], cooling: Sequence[int], after_s: float) -> Design:
        """Heating and cooling ramps by turns, of unsigned rates [°C/min], with a soak after each;
        where nothing is withheld yet, with one heating ramp at the end that is.
        """
        device, (low, high) = self.assumed.device, self.model.range_degc
        clock, change = Clock(self.task.equipment), low - self.task.equipment.chamber.room_degc
        clock.ramp(low, self.fastest)
        clock.soak(self.task.equipment.soak_s(device, change, self.fastest))
        by_turns = [
            Ramp(float(sign * rate), after_s)
            for pair in zip_longest(heating, cooling)
            for sign, rate in zip((1, -1), pair, strict=True)
            if rate is not None
        ]
        recorded = [(ramp, "") for ramp in by_turns]
        if not self.task.withheld:
            recorded.append((Ramp(float(self.withheld_rate(heating)), after_s), WITHHELD))
        for ramp, folder in recorded:
            sense = "heating" if ramp.rate > 0.0 else "cooling"
            log = folder + self.task.name_log(f"ramp_{sense}_{abs(ramp.rate):02g}.csv")
            clock.soak(planned.BEFORE_S, log)
            clock.ramp(high if ramp.rate > 0.0 else low, abs(ramp.rate), log)
            clock.soak(ramp.after_s, log)
        rates = [f"±{rate}" for rate in heating]
        if tuple(heating) != tuple(cooling):
            rates = [*(f"+{rate}" for rate in heating), *(f"−{rate}" for rate in cooling)]
        label = f"ramps of {', '.join(rates)} °C/min, soaks of {after_s / 60.0:g} min"
        logs = (self.task.name_log("ramp_*.csv"),)
        settings = {
            "range_degc": [low, high],
            "case_lag_s": self.model.case_lag_s,
            "white_dph": self.model.white_dph,
        }
        return Design(label, clock.schedule(), logs, tuple(by_turns), None, settings)

    def withheld_rate(self, heating: Sequence[int]) -> int:
        """Rate of the ramp that is withheld: between those of the design, and none of them."""
        spare = [one for one in RATES if one not in heating and one <= self.fastest]
        middle = float(np.sqrt(heating[0] * heating[-1]))
        return min(spare or [heating[0]], key=lambda one: abs(np.log(one / middle)))

    def designs(self) -> Iterator[Design]:
        """Every campaign of two to four rates of each direction; where something is measured
        already and withheld, also those of one heating ramp more, and none.
        """
        rates = [rate for rate in RATES if rate <= self.fastest]
        sets = [chosen for size in range(1, MOST + 1) for chosen in combinations(rates, size)]
        more = (0, 1) if self.have and self.task.withheld else (0,)
        ends = [one for log in self.have for one in (log.case.min(), log.case.max())]
        if self.suffices(()) and cover_range(ends, 2, self.model.range_degc):
            yield Design.nothing()
        lengths = self.assumed.device.dwell_s
        labels = [f"soaks of {after / 60.0:g} min" for after in lengths]
        for after_s, _ in zip(lengths, self.task.progress(labels, "searching"), strict=True):
            for heating, cooling in product(sets, [(), *sets]):
                signed = [*heating, *(-rate for rate in cooling)]
                if len(heating) - len(cooling) in more and self.suffices(signed):
                    yield self.design(heating, cooling, after_s)

    def usual(self) -> Iterator[Design]:
        """Eight ramps with long soaks."""
        rates = tuple(rate for rate in SAMPLE if rate <= self.fastest)
        if self.suffices([*rates, *(-rate for rate in rates)]):
            yield self.design(rates, rates, max(self.assumed.device.dwell_s))


def _count_rates(rates: Iterable[float]) -> int:
    """Number of unsigned rates [°C/min] that differ."""
    ordered = sorted(rates)
    return sum(k == 0 or one > DIFFERENT * ordered[k - 1] for k, one in enumerate(ordered))


def prepare_plan(spec: FogThermalRecipe, task: Task) -> RampBench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure, "deg/h")
    earlier, notes = list[ErrorComponent](), tuple[str, ...]()
    noise = device.noise
    if task.earlier is not None:
        noise, earlier = read_run(task.earlier, device.noise_s)
        sizes = (f"{one.effect} {one.value:.2g}" for one in earlier)
        notes = (f"of that run: noise {noise:.2g}, {', '.join(sizes)} deg/h",)
    assumed = assume(
        *(spec, task, device, planned.UNITS),
        default_degc=RANGE_DEGC,
        passed_on=(),
        earlier=earlier,
        noise=noise,
        notes=notes,
    )
    sizes_dph = {name: assumed.size(*name) for name in planned.UNITS}
    if not (sizes_dph["coil", "drift"] and sizes_dph["log", "turn-on"]):
        raise UsageError(
            f"components of [device.{spec.procedure}]:"
            f" {', '.join(f'{one.effect} of {one.group}' for one in assumed.components)}",
            hint="expected drift of coil and turn-on of log, with initial state and flicker of log",
        )
    white = assumed.noise_of(planned.STEP_S)
    model = Model(assumed.range_degc, min(device.lags_s), white, sizes_dph)
    have, rates = [], list[float]()
    for log in task.have:
        examined = ramps.examine(spec, log)
        refuse(examined.findings)
        rates += [one.level for one in examined.held if one.kind == "ramp"]
        blocks = ramps.block_means(log, spec, rated=False)[1]
        have.append(CaseLog.of_blocks(blocks.time, blocks.case))
    bench = RampBench(spec, task, assumed, planned.RESULTS, have, model, tuple(rates))
    able = [rate for rate in RATES if rate <= bench.fastest]
    if not bench.suffices([*able, *(-rate for rate in able)]):
        raise UsageError(
            f"fastest_degc_per_min leaves one of the rates {', '.join(map(str, RATES))} °C/min,"
            f" expected {FEWEST_RATES}: a fit leaves out a ramp of each direction",
            hint="state the fastest ramp of chamber and device in the equipment file",
        )
    return bench


def read_run(
    records: Mapping[str, Record | StageResult], noise_s: float
) -> tuple[float, list[ErrorComponent]]:
    """White noise [°/h] of the mean over a time [s], and sizes of drift, turn-on bias and flicker
    noise of a run; UsageError for one that does not state them.
    """
    levels = {form.name for form in forms.ON_LEVELS.values()}
    record = records.get(forms.FILE)
    model = next((one for one in record.models if one.form in levels), None) if record else None
    if record is None or model is None:
        raise UsageError(
            "that run has no level, lagged or bank model of a gyro's drift, which states noise and"
            " turn-on biases",
            hint="name another run, or state the sizes in [device] of the equipment file",
        )
    stated = {one.name: one.value for one in model.parameters}
    figures = {one.name: one.value for one in record.figures}
    names = [one.removeprefix(BEFORE) for one in figures if one.startswith(BEFORE)]
    squares = [figures[BEFORE + one] ** 2 - figures[NOISE + one] ** 2 for one in names]
    turn_on = [value for name, value in figures.items() if name.startswith(TURN_ON)]
    spread = float(np.std(turn_on, ddof=1)) if len(turn_on) > 1 else 0.0
    sizes = {
        ("coil", "drift"): max(float(np.mean(squares)), 0.0) ** 0.5 if squares else 0.0,
        ("log", "turn-on"): stated.get("turn_on", spread),
        ("log", "flicker"): stated["flicker"],
    }
    white = float(np.sqrt(stated["white_variance"] * stated["interval"] / noise_s))
    dof = float(max(len(names) - 1, 1))
    return white, [
        ErrorComponent(group=group, effect=effect, value=value, unit="deg/h", dof=dof)
        for (group, effect), value in sizes.items()
        # what was not seen is as the equipment file states it
        if value > 0.0
    ]


def simulate_plan(
    spec: FogThermalRecipe,  # noqa: ARG001 (as every planner's)
    schedule: Schedule,
    document: Mapping[str, Any],
    seed: int,
) -> Campaign:
    """Logs of a simulated gyro on the ramps of a schedule, and its truth."""
    device, chamber = FogGyro.draw(seed), Chamber()
    runs = {}
    for name, (before, ramp, after) in schedule.by_log().items():
        runs[name] = Programme.ramp(
            before.set_degc,
            ramp.set_degc,
            abs(ramp.ramp_degc_per_min),
            soak_before_s=before.duration_s,
            soak_after_s=after.duration_s,
        )
    logs = simulated.logs(device, runs, seed, chamber)
    truth = simulated.describe(device, chamber, runs, logs)
    columns = {name: one.columns for name, one in logs.items()}
    return as_planned(document, seed, columns, simulated.DECIMALS, truth)
