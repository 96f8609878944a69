"""Designs of runs on a rate table, and what they cost and give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError, UsageError
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.numeric.planned import Holds, Model, Runs
from calibkit.numeric.information import NOISE
from calibkit.planning.proposal import (
    NOTHING,
    ONE_LEVEL_DEGC,
    WITHHELD,
    Candidate,
    Predicted,
    Task,
    count,
    cover_range,
)
from calibkit.planning.schedule import Clock

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.planning.equipment import Device, RateTable
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent


@dataclass(frozen=True, slots=True)
class Design:
    """A campaign."""

    rates: tuple[int, ...]
    """Unsigned rates [°/s] of a run."""
    alternating: bool
    shortest_s: float
    degc: tuple[int, ...]
    """Temperatures of the fitted runs in their order, about each axis beside what it lacks."""


NO_RUNS = Design((), alternating=True, shortest_s=0.0, degc=())
"""An empty campaign."""


@dataclass(frozen=True, slots=True)
class Bench:
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
    axes: tuple[str, ...]
    """Table axes about which the base is turned, one mounting each."""
    have: Mapping[str, Holds]
    """Table axis → what is measured about it already."""
    notes: tuple[str, ...]

    def measured(self, axes: Sequence[str]) -> list[float]:
        """Temperatures [°C] of the runs about some axes."""
        return [t for axis in axes if axis in self.have for t in self.have[axis].rows.temp_degc]

    def lacking(self, axis: str) -> tuple[int, ...]:
        """Temperatures [°C] that were measured about other axes, but not about this one."""
        found = self.measured([axis])
        for one in sorted(self.measured(self.axes)):
            if all(abs(one - other) > ONE_LEVEL_DEGC for other in found):
                found.append(round(one))
        return tuple(one for one in found if isinstance(one, int))

    def temperatures(self, design: Design, axis: str) -> tuple[int, ...]:
        """Temperatures [°C] of the runs about an axis in their order."""
        lacking = [one for one in self.lacking(axis) if one not in design.degc]
        return (*lacking, *design.degc)

    def holds(self, design: Design) -> list[tuple[float, float, float]]:
        """Signed rate [°/s], start and length [s] of each hold of a run."""
        now, before, found = 3.0, 0.0, []
        for rate in planned.order_rates(design.rates, alternating=design.alternating):
            now += abs(rate - before) / self.table.acceleration_dps2
            length = planned.hold_s(rate, design.shortest_s)
            found.append((rate, now, length))
            now, before = now + length, rate
        return found

    def runs(self, design: Design, axis: str) -> Runs:
        """Runs of a design about an axis as the fit will see them."""
        rates, start, length = (np.array(part) for part in zip(*self.holds(design), strict=True))
        turn_s = 360.0 / np.abs(rates)
        used = np.floor((length - 1.0) / turn_s) * turn_s
        middle = start + length / 2.0
        hours = (middle - (start[-1] + length[-1]) / 2.0) / 3600.0
        noise = self.device.noise * np.sqrt(self.device.noise_s / used)
        return Runs(tuple(rates.tolist()), hours, noise, self.temperatures(design, axis))

    def campaign(self, design: Design) -> dict[str, Holds]:
        """Table axis → holds of a design and what is measured already; axes without any are
        absent.
        """
        if not self.have:
            return dict.fromkeys(self.axes, self.runs(design, self.axes[0]).holds())
        found = dict(self.have)
        for axis in self.axes if design.rates else ():
            planned_runs = self.runs(design, axis)
            if planned_runs.degc:
                own = planned_runs.holds()
                found[axis] = found[axis].join(own) if axis in found else own
        return found

    def schedule(self, design: Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with one run between the two first
        temperatures that is.
        """
        clock = Clock(self.task.equipment)
        mounted = [axis for axis in self.axes if self.temperatures(design, axis)]
        for axis in mounted if design.rates else ():
            if axis != mounted[0]:
                clock.remount(self.task.equipment.fastest(self.device))
            degc = self.temperatures(design, axis)
            stem = self.task.name_log(f"about_{axis}" if axis else "run")
            order = [(one, f"{stem}_{k + 1:02d}_{one}.csv") for k, one in enumerate(degc)]
            if not self.task.withheld:
                levels = sorted({*degc, *map(round, self.measured([axis]))})
                between = round((levels[0] + levels[1]) / 2.0) if len(levels) > 1 else levels[0]
                order.insert(1, (between, f"{WITHHELD}{stem}_{between}.csv"))
            for one, log in order:
                self.run_at(clock, design, one, log)
        return clock.schedule()

    def run_at(self, clock: Clock, design: Design, degc: int, log: str) -> None:
        """One run: ramp, soak, held rates."""
        equipment = self.task.equipment
        rate, change = equipment.fastest(self.device), degc - clock.degc
        clock.ramp(float(degc), rate)
        clock.soak(equipment.soak_s(self.device, change, rate))
        begin = clock.now_s
        for signed, start, length in self.holds(design):
            clock.move(begin + start - clock.now_s)
            clock.rate(signed, length, log)

    def variances_of(self, name: str, holds: Holds, degc: Array | None) -> dict[str, Array]:
        """Variances [m] of a result of one axis by source; FitError where its rates do not
        determine it.
        """
        slopes = self.model.result_slopes(name, holds.rows, degc)
        information = self.model.information(holds)
        if not information.determined:
            raise FitError(
                f"held rates from {holds.rows.rate_dps.min():.4g} to"
                f" {holds.rows.rate_dps.max():.4g} °/s do not determine the {name} and its errors,"
                " expected rates of both signs",
                hint="measure this run again",
            )
        return information.variances(slopes)

    def variances(
        self, name: str, campaign: Mapping[str, Holds], degc: Array | None = None
    ) -> dict[str, Array]:
        """Variances [m] of a result that noise and each source leave, over the range of use or at
        temperatures [m] [°C]: of the axis that is known worst.
        """
        own = {id(holds): holds for holds in campaign.values()}.values()
        if name != planned.ANGLE:
            return max((self.variances_of(name, one, degc) for one in own), key=_mean)
        # two gyros, each seen a little about the axis of the other, where no scale factor matters
        across = replace(self, model=self.model.without(("run", "scale")))
        found = (across.variances_of("scale factor", one, degc) for one in own)
        worst = sorted(found, key=_mean)
        a, b = (worst * 2)[-2:]
        none = np.zeros_like(a[NOISE])
        size = self.model.sizes.get(planned.MOUNTING)
        mounted = np.full_like(none, (0.0 if size is None else size.value) ** 2)
        parts = {source: a.get(source, none) + b.get(source, none) for source in a | b}
        in_deg = float(np.degrees(1.0 / PPM)) ** 2
        return {key: part * in_deg for key, part in parts.items()} | {
            "angle of the mounting": 2.0 * mounted
        }

    def predict(self, campaign: Mapping[str, Holds]) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result."""
        return tuple(
            Predicted.of(name, unit, self.variances(name, campaign))
            for name, unit in self.results.items()
        )

    def candidate(self, design: Design) -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all, or has
        no temperature more than the order needs or none at an end of the range.
        """
        campaign = self.campaign(design)
        own = {id(holds): holds for holds in campaign.values()}.values()
        fewest = self.model.order + 2
        if len(campaign) < len(self.axes) or any(
            not cover_range(one.rows.temp_degc, fewest, self.model.range_degc)
            or not self.model.information(one).determined
            for one in own
        ):
            return None
        largest = {
            name: float(np.sqrt(np.sum([*self.variances(name, campaign).values()], axis=0).max()))
            for name in self.results
        }
        return Candidate(self._label(design), self.schedule(design).hours, largest, design)

    def _label(self, design: Design) -> str:
        """A design in a few words."""
        if not design.rates:
            return NOTHING
        each = [self.temperatures(design, axis) for axis in self.axes]
        mounted = [one for one in each if one]
        # about all axes alike, or what each lacks
        runs = len(mounted[0]) if len({*each}) == 1 else sum(map(len, mounted))
        levels = len({degc for one in mounted for degc in one})
        axes = f", about {len(mounted)} {'axis' if len(mounted) == 1 else 'axes'}"
        return (
            f"{len(design.rates)} rates both ways, {count(runs, 'run')} at"
            f" {count(levels, 'temperature')}, holds of {design.shortest_s:g} s"
            f"{axes if len(self.axes) > 1 else ''}"
        )


def require_table(task: Task, procedure: str) -> tuple[Device, RateTable]:
    """Device and rate table of the equipment file; UsageError where it lacks one."""
    device, table = task.equipment.known_device(procedure), task.equipment.rate_table
    if table is None or device.noise_unit != "deg/s":
        raise UsageError(
            "a plan of gyros needs [rate_table] in the equipment file and a noise in deg/s",
            hint="see calibkit plan --print-equipment",
        )
    return device, table


def _mean(parts: Mapping[str, Array]) -> float:
    """Mean variance."""
    return float(np.mean(np.sum([*parts.values()], axis=0)))
