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
    assume_on_table,
    measure_runs,
)
from calibkit.planning.assumptions import read_sizes
from calibkit.planning.proposal import WITHHELD, Candidate, Coefficient, Design
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
    from calibkit.planning.levels import Tour
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Sources
    from calibkit.recipe.tables import ErrorComponent

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

    def variances(self, design: Design) -> dict[str, Sources]:
        """Variances of each result; the angle is what B shows about A's axis, where it turns little
        and neither scale factor nor response matters.
        """
        campaign, at = self.campaign(design), np.array([self.reference_degc])
        a, b = (self.lines(campaign[axis], at)[SCALE] for axis in AXES)
        apart = np.sqrt(2.0) * self.assumed.size(*TEMPERATURE) * _coefficient(self.spec) * PPM
        ratio = {source: a[source] + b[source] for source in a}
        across = self.lines(campaign["a"], at, [RUN_SCALE, RESPONSE])[SCALE]
        angle = {source: part * DEG_PER_PPM**2 for source, part in across.items()}
        mounted = np.array([self.assumed.size(*MOUNTING) ** 2])
        return {
            "N": ratio | {"temperature of the run": np.array([apart**2])},
            ANGLE: angle | {"angle of the mounting": mounted},
        }

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """N and the angle between the axes."""
        results = self.predict(design).results
        yield Coefficient("pair", "N", "1", results["N"].u / PPM)
        yield Coefficient("pair", "alpha_deg", "deg", results[ANGLE].u)

    def passed_on(self, design: Design) -> list[ErrorComponent]:
        """A fit of a pair sees the scale of its runs in their scatter, and the mounting not."""
        return [one for one in super().passed_on(design) if (one.group, one.effect) == MOUNTING]

    def tours(self, degc: Tour) -> dict[str, Tour]:
        """A run about each axis that is missing."""
        return dict.fromkeys(self.missing, degc)

    def runs_about(self, axis: str, tour: Tour) -> list[tuple[int, str]]:
        """One run; where nothing is withheld yet, with another one about the first axis that is."""
        runs = [(tour[0], self.name_logs(axis))]
        if axis == self.missing[0] and not self.task.withheld:
            runs.append((tour[0], f"{WITHHELD}{self.name_logs(axis)}"))
        return runs

    def name_logs(self, axis: str) -> str:
        """Log of the run about an axis."""
        return self.task.name_log(f"table_axis_{axis}.csv")

    def changes(self, files: Mapping[str, str]) -> dict[str, Any]:
        """Keys of the recipe that name the logs."""
        return {"pair": {f"axis_{axis}": file for axis, file in files.items()}}

    def design(self, run: Run, degc: Tour, label: str = "") -> Design:
        """A run about each missing axis."""
        design = super().design(run, degc, label)
        coefficient = {"coefficient_per_degc": _coefficient(self.spec)}
        return replace(design, settings={**design.settings, **coefficient})

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Runs of all numbers of rates and lengths of holds, where an axis is missing."""
        numbers = self.table.rates if self.missing else ()
        at = (round(self.reference_degc),)
        return {
            f"{number} rates": (self.design(run, at) for run in self.runs(number))
            for number in numbers
        }

    def usual(self) -> Iterator[Design]:
        """Eleven rates, one side after the other."""
        at = (round(self.reference_degc),)
        yield self.design(self.usual_run(), at, label=f"usual: {USUAL_RATES} rates")

    def notes(self, campaign: Candidate) -> tuple[str, ...]:  # noqa: ARG002 (as every bench's)
        """What is done with logs that are there."""
        return (ONE_LOG,) if self.task.have else ()


def prepare(spec: GyroPairRecipe, task: Task) -> PairBench:
    """What the search needs; UsageError for what cannot be planned."""
    assumed, table = assume_on_table(spec, task, UNITS, None)
    have = measure_runs(spec, task, assumed)
    if len(task.have) > len(have):
        raise FitError(
            f"{len(task.have)} logs of {len(have)} table axes, expected one of each",
            hint="name the log of each axis under [pair]",
        )
    degc = [float(holds.degc.mean()) for holds in have.values()]
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
    return Campaign(logs, simulated.DECIMALS, truth)


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
