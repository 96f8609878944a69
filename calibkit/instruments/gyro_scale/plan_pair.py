"""Campaigns of two gyros, a run about the axis of each: which rates, and how long."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import simulate_pair, simulate_rate_table
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.plan import (
    ANGLE,
    DEG_PER_PPM,
    MOUNTING,
    RESPONSE,
    RUN_SCALE,
    RUN_ZERO,
    SCALE,
    UNITS as TABLE_UNITS,
    USUAL_RATES,
    GyroBench,
    Run,
    Runs,
    assume_on_table,
    measure_runs,
)
from calibkit.planning.assumptions import read_sizes
from calibkit.planning.proposal import WITHHELD, Coefficient, Design
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Sources, whole
from calibkit.planning.simulation import as_planned

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.simulate.campaign import Campaign

AXES = ("a", "b")
RESULTS = {"N": "ppm", ANGLE: "deg"}
TEMPERATURE = "run", "temperature"
UNITS = TABLE_UNITS | {TEMPERATURE: "degC"}
AROUND_DEGC = 1.0
"""Half of the range of temperatures that a campaign at one temperature is planned for."""
ONE_LOG = "a fit reads one log of each axis: what is measured is not measured again"
ALPHA_DEG = 0.3
"""Standard deviation of the simulated angle between the axes about 90°."""


@dataclass(frozen=True)
class PairBench(GyroBench):
    """Campaigns of two gyros at one temperature."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Axes about which nothing is measured."""
        return tuple(axis for axis in AXES if axis not in self.have)

    def covers(self, design: Design) -> bool:  # noqa: ARG002 (as every bench's)
        """At one temperature there is no range."""
        return True

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result; the angle is what B shows about A's axis, where it turns little
        and neither scale factor nor response matters.
        """
        campaign, at = self.campaign(design), np.array([self.reference_degc])
        a, b = (self.line_variance(SCALE, campaign[axis], at) for axis in AXES)
        apart = np.sqrt(2.0) * self.assumed.size(*TEMPERATURE) * _coefficient(self.spec) * PPM
        ratio = {source: a[source] + b[source] for source in a}
        across = self.line_variance(SCALE, campaign["a"], at, [RUN_SCALE, RESPONSE])
        angle = {source: part * DEG_PER_PPM**2 for source, part in across.items()}
        mounted = np.array([self.assumed.size(*MOUNTING) ** 2])
        return {
            "N": ratio | {"temperature of the run": np.array([apart**2])},
            ANGLE: angle | {"angle of the mounting": mounted},
        }

    def design(self, run: Run, degc: Sequence[int], label: str = "") -> Design:
        """A run about each missing axis; where nothing is withheld yet, with one about the first
        that is.
        """
        task, clock = self.task, Clock(self.task.equipment)
        for number, axis in enumerate(self.missing):
            if number:
                clock.remount(task.equipment.fastest(self.assumed.device))
            self.turn(clock, run, degc[0], self.log(axis))
            if not number and not task.withheld:
                self.turn(clock, run, degc[0], f"{WITHHELD}{self.log(axis)}")
        label = label or (
            f"{len(run.rates_dps)} rates both ways about {len(self.missing)} of 2 axes, holds of"
            f" {run.shortest_s:g} s"
        )
        logs = {f"axis_{axis}": self.log(axis) for axis in self.missing}
        rows = Runs(run, dict.fromkeys(self.missing, tuple(degc)))
        settings = {"hold_s": run.shortest_s, "coefficient_per_degc": _coefficient(self.spec)}
        schedule, changes = clock.schedule(), {"pair": logs}
        return Design(label, schedule, tuple(logs.values()), rows, None, settings, changes)

    def log(self, axis: str) -> str:
        """Log of the run about an axis."""
        return self.task.name_log(f"table_axis_{axis}.csv")

    def designs(self) -> Iterator[Design]:
        """Runs of all numbers of rates and lengths of holds; `NOTHING` where no axis is missing."""
        if not self.missing:
            yield Design.nothing()
            return
        rates = self.table.rates
        labels = [f"{number} rates" for number in rates]
        for number, _ in zip(rates, self.task.progress(labels, "searching"), strict=True):
            for run in self.runs(number):
                yield self.design(run, [round(self.reference_degc)])

    def usual(self) -> Iterator[Design]:
        """Eleven rates, one side after the other."""
        at = [round(self.reference_degc)]
        yield self.design(self.usual_run(), at, label=f"usual: {USUAL_RATES} rates")

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """N and the angle between the axes."""
        u = {name: float(np.sqrt(whole(one)[0])) for name, one in self.variances(design).items()}
        yield Coefficient("pair", "N", "1", u["N"] / PPM)
        yield Coefficient("pair", "alpha_deg", "deg", u[ANGLE])


def prepare(spec: GyroPairRecipe, task: Task) -> PairBench:
    """What the search needs; UsageError for what cannot be planned."""
    notes = (ONE_LOG,) if task.have else ()
    assumed, table = assume_on_table(spec, task, UNITS, None, passed_on=[MOUNTING], notes=notes)
    have = measure_runs(spec, task, assumed)
    if len(task.have) > len(have):
        raise FitError(
            f"{len(task.have)} logs of {len(have)} table axes, expected one of each",
            hint="name the log of each axis under [pair]",
        )
    degc = [float(one.rows.row_degc.mean()) for one in have.values()]
    reference = float(np.mean(degc or [spec.reference_temp_degc]))
    around = reference - AROUND_DEGC, reference + AROUND_DEGC
    task.equipment.require_reached(*around)
    assumed = replace(assumed, range_degc=around)
    return PairBench(spec, task, assumed, RESULTS, have, table, reference, 0, AXES)


def _coefficient(spec: GyroPairRecipe) -> float:
    """Standard deviation of what temperature changes N by [1/°C], as the fit takes it."""
    if spec.pair.temperature_coefficients_ppm_degc is None:
        return spec.pair.largest_temperature_coefficient_ppm_degc / PPM / float(np.sqrt(3.0))
    # each gyro is brought to the middle of both temperatures by its own coefficient
    return spec.pair.temperature_coefficient_uncertainty_ppm_degc / PPM / float(np.sqrt(2.0))


def simulate(
    spec: GyroPairRecipe,
    schedule: Schedule,
    document: Mapping[str, Any],
    seed: int,
) -> Campaign:
    """Logs of two linear gyros about the axis of each, and N and the angle between them."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    size = read_sizes(document, UNITS)
    settings, simulated = document["settings"], simulate_rate_table
    table = simulated.Table(interval_s=1.0, shortest_hold_s=settings["hold_s"], warming_degc=0.0)
    gyros = {name: simulate_pair.linear(simulated.RateGyro.draw(rng)) for name in AXES}
    alpha = 90.0 + rng.normal(0.0, ALPHA_DEG)
    every = schedule.recorded("rate")
    rates = np.unique([one.table_rate_dps for one in every])
    response = rng.normal(0.0, size[RESPONSE] / DPH_PER_DPS, (2, rates.size))
    # both gyros change with temperature alike
    per_degc = float(rng.normal(0.0, settings["coefficient_per_degc"]))
    logs: dict[str, dict[str, Array]] = {}
    for log, actions in schedule.by_log().items():
        axis = spec.find_axis(log.removeprefix(WITHHELD))
        moved = _mount(gyros, axis, alpha, size, rng)
        moved = {name: replace(gyro, K_per_degc=per_degc) for name, gyro in moved.items()}
        degc = every[0].set_degc + rng.normal(0.0, size[TEMPERATURE])
        named = {f"gyro_{name}_lsb": gyro for name, gyro in moved.items()}
        table_rates = [one.table_rate_dps for one in actions]
        columns = simulated.run(named, table, table_rates, degc, rng)
        hours = (columns["time_s"] - columns["time_s"].mean()) / 3600.0
        for k, (name, gyro) in enumerate(moved.items()):
            drift = rng.normal(0.0, size["run", "zero drift"]) / DPH_PER_DPS
            added = np.interp(columns["table_rate_dps"] * gyro.axis[2], rates, response[k])
            column = f"gyro_{name}_lsb"
            columns[column] = np.round(columns[column] + gyro.K * (added + drift * hours))
        logs[log] = columns
    # the best straight line over the rates takes its part of the response
    line = {name: 1.0 + np.polyfit(rates, response[k], 1)[0] for k, name in enumerate(AXES)}
    ratio = gyros["b"].K * line["b"] / (gyros["a"].K * line["a"])
    truth = {"coefficients": {"pair": {"N": float(ratio), "alpha_deg": float(alpha)}}}
    return as_planned(document, seed, logs, simulated.DECIMALS, truth)


def _mount(
    gyros: Mapping[str, simulate_rate_table.RateGyro],
    axis: str,
    alpha_deg: float,
    size: Mapping[tuple[str, str], float],
    rng: np.random.Generator,
) -> dict[str, simulate_rate_table.RateGyro]:
    """Gyros of a run about the axis of one of them, with the errors of mounting and run."""
    tilt = rng.normal(0.0, size[MOUNTING], 2)
    turn = simulate_rate_table.tilted
    return {
        name: replace(
            gyro,
            axis=turn(
                float(np.hypot(*tilt)) if name == axis else alpha_deg + tilt[0],
                rng.uniform(0.0, 360.0),
            ),
            K=gyro.K * (1.0 + rng.normal(0.0, size[RUN_SCALE]) / PPM),
            bias_dps=gyro.bias_dps + rng.normal(0.0, size[RUN_ZERO]) / DPH_PER_DPS,
        )
        for name, gyro in gyros.items()
    }
