"""Campaigns of gyros on a rate table: which rates at which temperatures, about which axes.

What held rates will tell is predicted by equation (1) of `equation`, that of the fit, with gyros
whose scale factor is 1, the runs about each axis a line of their own. Results follow from K(T) and
F0(T) of the best straight lines: an angle between two input axes is what a gyro shows about an axis
across its own, N the ratio of two scale factors.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import chain, combinations, product
from typing import Any

import numpy as np

from calibkit.errors import FitError, UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.gyro_scale import equation, forms, simulate, table_runs
from calibkit.instruments.gyro_scale.published import PPM
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe, GyroTriadRecipe, RateTableRecipe
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import DPH_PER_DPS, REVOLUTION_DEG, SECONDS_PER_HOUR
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.bench import (
    LEVELS,
    ONE_LEVEL_DEGC,
    WITHHELD,
    Bench,
    Design,
    PredictedCoefficient,
    Sources,
    Task,
    Tour,
    Units,
    count,
    earlier_error,
    join,
    split_variance,
    total_variance,
)
from calibkit.planning.equipment import Device
from calibkit.planning.schedule import Clock, Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.coefficients import Record, StageResult
from calibkit.records.frame import Log
from calibkit.simulate.campaign import Campaign

Spec = RateTableRecipe | GyroTriadRecipe | GyroPairRecipe
SCALE, ZERO, ANGLE, RATIO = "scale factor", "zero", "angle", "N"
UNIT = {SCALE: "ppm", ZERO: "deg/h", ANGLE: "deg", RATIO: "ppm"}
"""Results, and their units; an angle is that between two input axes."""
MOUNTING, TEMPERATURE = ("mounting", "angle"), ("run", "temperature")
RUN_SCALE, RUN_ZERO, RESPONSE = ("run", "scale"), ("run", "zero"), ("rate", "response")
UNITS = {
    MOUNTING: "deg",
    RUN_SCALE: "ppm",
    RUN_ZERO: "deg/h",
    ("run", "zero drift"): "deg/h/h",
    RESPONSE: "deg/h",
}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""


@dataclass(frozen=True, slots=True)
class Holds(equation.RateRows):
    """Planned or measured holds [n] of gyros whose scale factor is 1; a line is a table axis."""

    noise: Array
    """Of the mean over each hold [°/s]."""


def planned_holds(schedule: Schedule, device: Device, find_line: Callable[[str], int]) -> Holds:
    """Holds of a schedule as the fit will see them: means over whole revolutions. The number of the
    table axis of a log is found by its name.
    """
    holds: list[tuple[float, ...]] = []
    logs = [log for log in schedule.by_log().items() if not log[0].startswith(WITHHELD)]
    for run, (log, actions) in enumerate(logs):
        middle_s, line = (actions[0].start_s + actions[-1].end_s) / 2.0, find_line(log)
        for hold in actions:
            rate_dps = hold.table_rate_dps
            turn_s = REVOLUTION_DEG / abs(rate_dps)
            used_s = np.floor((hold.duration_s - 1.0) / turn_s) * turn_s
            hours = (hold.start_s + hold.duration_s / 2.0 - middle_s) / SECONDS_PER_HOUR
            noise = device.noise_of(used_s)
            holds.append((rate_dps, rate_dps, run, hold.set_degc, hours, line, line, noise))
    return Holds(*map(np.array, zip(*holds, strict=True)))


class GyroBench(Bench):
    """Campaigns of gyros that are turned about one table axis."""

    results: Mapping[str, str] = {SCALE: UNIT[SCALE], ZERO: UNIT[ZERO]}
    units: Units = UNITS
    default_degc: tuple[float, float] | None = (-40.0, 60.0)
    files, noise_unit = (forms.SCALE_FILE,), "deg/s"
    axes: tuple[str, ...] = ("",)
    """Table axes about which the base is turned, one mounting each."""
    withheld = 3
    """Mountings, the first ones, in which a run is withheld, where nothing is yet."""

    def __init__(self, spec: Spec, task: Task) -> None:
        """UsageError also for equipment without a rate table; FitError for measured logs that a fit
        refuses, or without temperatures.
        """
        super().__init__(spec, task)
        if task.equipment.rate_table is None:
            raise UsageError(
                "a plan of gyros needs [rate_table] in the equipment file",
                hint="see calibkit plan --print-equipment",
            )
        self.table = task.equipment.rate_table
        self.order = self.device.order
        self.not_stated = self.units.keys() - spec.component_units.keys()
        self.reference_degc: float = np.clip(spec.reference_temp_degc, *self.range_degc)
        # runs that are measured, with their table axes
        self.runs = [(spec.find_axis(log.file), table_runs.fit_run(spec, log)) for log in task.have]
        for _, run in self.runs:
            if not np.isfinite(run.plateaus.temp_degc).all():
                raise FitError(
                    f"{run.log.file}: no case temperature, expected one to plan what is missing",
                    hint="map it under [columns.temp_case_degc], or plan without --have",
                )

    def errors_of_run(
        self, records: Sequence[Record | StageResult]
    ) -> tuple[list[ErrorComponent], None]:
        """Also, as the response at a rate, what held rates are off the line of their run, with the
        noise of the holds in it.
        """
        errors, _ = super().errors_of_run(records)
        for record in records:
            off_line_dps = [
                figure.value
                for figure in record.figures
                if figure.name.startswith("linearity_error_rms.")
            ]
            response_dph = rms(off_line_dps) * DPH_PER_DPS
            errors.append(earlier_error(*RESPONSE, response_dph, UNITS[RESPONSE]))
        return errors, None

    def measured_degc(self, axis: str) -> list[float]:
        """Temperatures [°C] of the runs about a table axis that are measured."""
        return [run.temp_degc for run_axis, run in self.runs if run_axis == axis]

    def rows_of_logs(self, logs: Sequence[Log]) -> Holds:  # noqa: ARG002 (they are fitted as `runs`)
        """Holds of each run, and the noise of the gyro that shows most of it; FitError for runs
        about an axis in one direction.
        """
        K = np.array([np.abs(run.slopes) for _, run in self.runs]).max(axis=0)
        # a gyro that was turned across its own axis alone is taken to be like the others
        K = np.where(0.1 * K.max() < K, K, K.max())
        usual, parts = self.device.noise_of(min(self.device.dwell_s)), []
        for axis, run in self.runs:
            plateaus, rate = run.plateaus, run.plateaus.rate_dps
            noise = np.sqrt(np.mean((plateaus.standard_uncertainty / K) ** 2, axis=1))
            # of a log of one row per hold no noise is known
            noise = np.where(noise > 0.0, noise, usual)
            first = np.zeros(noise.size, dtype=np.int64)
            line = first + self.axes.index(axis)
            columns = rate, rate, first, plateaus.temp_degc, plateaus.hours, line, line, noise
            parts.append(Holds(*columns))
        holds: Holds = join(parts)
        for line_number in set(holds.line.tolist()):
            rates = holds.rate_dps[holds.line == line_number]
            if not equation.turns_both_ways(rates):
                raise FitError(
                    f"held rates from {rates.min():.4g} to {rates.max():.4g} °/s do not determine"
                    " the scale factor and its errors, expected rates of both signs",
                    hint="measure this run again",
                )
        return holds

    def results_at(self, holds: Holds, degc: Array, order: int) -> dict[str, Sources]:
        """Variances of each result at temperatures [m] [°C], by what holds will tell of polynomials
        of an order, and by the derivatives [axes, m, p] by which scale factors [ppm] and zeros
        [°/h] follow: of the best straight line about each axis.
        """
        rate, axes = holds.rate_dps, len(self.axes)
        shapes = (equation.ASYMMETRY,) if np.ptp(np.abs(rate)) > 0.0 else ()
        terms = equation.ResponseTerms(axes, order, self.middle_half, shapes)
        # of temperatures that change within runs a plan knows nothing
        shared = [
            error
            for error in equation.shared_errors(holds, terms, np.ones(axes), np.ones(axes))
            if (error.group, error.effect) in UNITS
        ]
        fit = predict(
            partial(equation.residual, rows=holds, terms=terms),
            terms.start,
            self.device.state(shared),
            noise=holds.noise,
            names=terms.names * terms.lines,
        )
        line = equation.best_line(terms, rate)
        powers = polynomial.powers(terms.mapped(degc), order)
        scale, zero = derivative(
            lambda p: np.stack([part @ powers.T for part in line(p)]), terms.start
        )
        return self.results_of(fit, PPM * scale, DPH_PER_DPS * zero)

    def results_of(self, fit: Fit, scale: Array, zero: Array) -> dict[str, Sources]:
        """Variances of each result by what a fit tells, and by the derivatives of `results_at`."""
        return {SCALE: split_variance(fit, scale[0]), ZERO: split_variance(fit, zero[0])}

    def variances(self, rows: Holds) -> dict[str, Sources]:
        """Variances of each result over the range of use."""
        return self.results_at(rows, np.linspace(*self.range_degc, LEVELS), self.order)

    def angle(
        self, fit: Fit, scale: Array, own_axis_errors: Sequence[tuple[str, str]], mountings: int
    ) -> Sources:
        """Variances [°²] of what gyros show about an axis across their own, by derivatives [m, p]
        of scale factors [ppm], without `own_axis_errors`, which matter along the own axis alone.
        """
        sources = split_variance(fit, np.degrees(scale / PPM))
        for group, effect in own_axis_errors:
            sources.pop(f"{effect} of the {group}", None)
        mounted = np.full(len(scale), mountings * self.device.size(*MOUNTING) ** 2)
        return sources | {"angle of the mounting": mounted}

    def temperatures(self, rows: Holds) -> list[Array]:
        """Of the holds about each axis."""
        return [rows.row_degc[rows.line == line] for line in range(len(self.axes))]

    def coefficients(self, rows: Holds) -> Iterator[PredictedCoefficient]:
        """K and F0 of each gyro at the reference temperature."""
        variances = self.results_at(rows, np.array([self.reference_degc]), self.order)
        for gyro, (letter, name) in product(self.spec.gyros, (("K", SCALE), ("F0", ZERO))):
            u = float(np.sqrt(total_variance(variances[name]))[0])
            yield PredictedCoefficient(f"gyro_{gyro}", letter, UNIT[name], u)

    def choices(self) -> Iterator[tuple[int, ...]]:
        """Rates [°/s] up to the fastest, in even steps so that a bend of the response shows."""
        for number in self.table.rates:
            step = self.table.fastest_dps / number
            yield tuple(round(step * (k + 1)) for k in range(number))

    def tours(self) -> list[Tour]:
        """Temperatures of campaigns; beside what is measured also none but what was measured about
        other axes.
        """
        return [degc for degc in ((), *super().tours()) if self.by_axis(degc)]

    def by_axis(self, degc: Tour) -> dict[str, Tour]:
        """Table axis → temperatures of its runs: those that were measured about other axes but not
        about this one, and those of a design.
        """
        tours, measured_degc = {}, sorted(chain(*map(self.measured_degc, self.axes)))
        for axis in self.axes:
            axis_degc, lacking = [*self.measured_degc(axis), *degc], list[int]()
            for level in measured_degc:
                distances = [abs(level - axis_level) for axis_level in (*axis_degc, *lacking)]
                if all(distance > ONE_LEVEL_DEGC for distance in distances):
                    lacking.append(round(level))
            if lacking or degc:
                tours[axis] = (*lacking, *degc)
        return tours

    def design(self, degc: Tour, choice: tuple[int, ...], dwell_s: float) -> Design:
        """Runs at temperatures in their order, about each axis: rates one way, then the other."""
        tours, clock = self.by_axis(degc), Clock(self.task.equipment)
        signed = [float(sign * rate) for sign in (1, -1) for rate in choice]
        line_of, files = dict[str, int](), dict[str, str]()
        for number, (axis, tour) in enumerate(tours.items()):
            if number > 0:
                clock.remount(self.task.equipment.fastest(self.device))
            stem = self.task.name_log(f"about_{axis}" if axis else "run")
            files[axis] = f"{stem}_*.csv"
            runs = [(level, f"{stem}_{k + 1:02d}_{level}.csv") for k, level in enumerate(tour)]
            if not self.task.withheld and number < self.withheld:
                lowest = sorted({*tour, *map(round, self.measured_degc(axis))})[:2]
                withheld_degc = round(sum(lowest) / len(lowest))
                runs.insert(1, (withheld_degc, f"{WITHHELD}{stem}_{withheld_degc}.csv"))
            for level, log in runs:
                line_of[log] = self.axes.index(axis)
                clock.settle(self.device, level)
                # the table rests for 3 s, and settles for 6 s of a hold: of a slow rate more than a
                # whole revolution stays
                clock.now_s += 3.0
                for before, rate in zip((0.0, *signed), signed, strict=False):
                    clock.now_s += abs(rate - before) / self.table.acceleration_dps2
                    turn_s = 1.02 * REVOLUTION_DEG / abs(rate)
                    clock.add("rate", max(dwell_s, 6.0 + turn_s), log, table_rate_dps=rate)
        levels = count(len({*chain(*tours.values())}), "temperature")
        axes_text = f", about {len(tours)} {'axis' if len(tours) == 1 else 'axes'}"
        label = (
            f"{len(choice)} rates both ways, {count(sum(map(len, tours.values())), 'run')} at"
            f" {levels}{axes_text if len(self.axes) > 1 else ''}, holds of {dwell_s:g} s"
        )
        schedule = clock.schedule()
        rows = planned_holds(schedule, self.device, line_of.__getitem__)
        return Design(label, schedule, tuple(files.values()), rows, self.changes(files))

    def changes(self, files: Mapping[str, str]) -> dict[str, Any]:  # noqa: ARG002 (as of more axes)
        """Keys of the recipe that name the logs about each axis."""
        return {}


class ThreeAxesBench(GyroBench):
    """Campaigns of gyros that are turned about three table axes."""

    results = {SCALE: UNIT[SCALE], ANGLE: UNIT[ANGLE]}
    axes = forms.AXES

    def results_of(self, fit: Fit, scale: Array, zero: Array) -> dict[str, Sources]:  # noqa: ARG002
        """Variances of the scale factor of the axis that is known worst, and of the angle between
        two gyros, which is what each shows about the axis of the other, where no scale factor
        matters.
        """
        by_axis = [split_variance(fit, slopes) for slopes in scale]
        *_, second, worst = np.argsort([total_variance(axis).mean() for axis in by_axis])
        angle = self.angle(fit, scale[second] + scale[worst], [RUN_SCALE], mountings=2)
        return {SCALE: by_axis[worst], ANGLE: angle}

    def coefficients(self, rows: Holds) -> Iterator[PredictedCoefficient]:
        """Angles between the gyros at the reference temperature, those of its runs alone, as each
        set of runs at one temperature has angles of its own in a fit.
        """
        near_reference = np.zeros(rows.run.size, dtype=np.bool_)
        for line in range(len(self.axes)):
            degc = np.where(rows.line == line, rows.row_degc, np.inf)
            nearest = degc[np.argmin(np.abs(degc - self.reference_degc))]
            near_reference |= np.abs(degc - nearest) <= ONE_LEVEL_DEGC
        columns = {field.name: getattr(rows, field.name)[near_reference] for field in fields(rows)}
        columns["run"] = np.unique(columns["run"], return_inverse=True)[1]
        results = self.results_at(Holds(**columns), np.array([self.reference_degc]), 0)
        u = float(np.sqrt(total_variance(results[ANGLE]))[0])
        for a, b in combinations(self.spec.gyros, 2):
            yield PredictedCoefficient("triad", f"orthogonality_error_deg.{a}_{b}", "deg", u)

    def changes(self, files: Mapping[str, str]) -> dict[str, Any]:
        """Keys of the recipe that name the logs about each axis."""
        axis_files = dict(self.spec.axes) if self.task.have else {}
        for axis, file in files.items():
            axis_files[axis] = (*axis_files.get(axis, ()), file)
        return {"axes": axis_files}


class PairBench(GyroBench):
    """Campaigns of two gyros at one temperature, a run about the axis of each."""

    results = {RATIO: UNIT[RATIO], ANGLE: UNIT[ANGLE]}
    units, default_degc = UNITS | {TEMPERATURE: "degC"}, None
    axes, withheld = ("a", "b"), 1

    def __init__(self, spec: Spec, task: Task) -> None:
        """At the temperature of what is measured; FitError also for two runs about one axis."""
        super().__init__(spec, task)
        self.order = 0
        # a fit of a pair sees the scale of its runs in their scatter, and the mounting not
        self.not_stated = self.units.keys() - {MOUNTING}
        if len({axis for axis, _ in self.runs}) < len(self.runs):
            raise FitError(
                f"{len(self.runs)} logs, expected one of each table axis",
                hint="name the log of each axis under [pair]",
            )
        if self.runs:
            self.reference_degc = float(np.mean([run.temp_degc for _, run in self.runs]))
            self.range_degc = self.reference_degc, self.reference_degc

    def results_of(self, fit: Fit, scale: Array, zero: Array) -> dict[str, Sources]:  # noqa: ARG002
        """Variances of N, and of the angle that B shows about A's axis, where it turns little and
        neither scale factor nor response matters.
        """
        a, b = scale
        difference_degc = np.sqrt(2.0) * self.device.size(*TEMPERATURE)
        of_temperature = np.full(len(a), (PPM * difference_degc * scale_per_degc(self.spec)) ** 2)
        ratio = split_variance(fit, b - a) | {"temperature of the run": of_temperature}
        return {RATIO: ratio, ANGLE: self.angle(fit, a, [RUN_SCALE, RESPONSE], mountings=1)}

    def coefficients(self, rows: Holds) -> Iterator[PredictedCoefficient]:
        """N and the angle between the axes."""
        results = self.predict(rows)
        yield PredictedCoefficient("pair", "N", "1", results[RATIO].u / PPM)
        yield PredictedCoefficient("pair", "alpha_deg", "deg", results[ANGLE].u)

    def tours(self) -> list[Tour]:
        """One run about each axis: none about one that is measured."""
        return [degc for degc in super().tours() if not (degc and self.task.have)]

    def changes(self, files: Mapping[str, str]) -> dict[str, Any]:
        """Keys of the recipe that name the logs."""
        return {"pair": {f"axis_{axis}": file for axis, file in files.items()}}


def prepare_plan(spec: Spec, task: Task) -> GyroBench:
    """Campaigns of a gyro, of three gyros about three axes, or of two."""
    benches = {"gyro_triad": ThreeAxesBench, "gyro_pair": PairBench}
    return benches.get(spec.procedure, GyroBench)(spec, task)


def scale_per_degc(spec: GyroPairRecipe) -> float:
    """Standard deviation of what temperature changes N by [1/°C], as the fit takes it."""
    if spec.pair.temperature_coefficients_ppm_degc is None:
        return spec.pair.largest_temperature_coefficient_ppm_degc / PPM / float(np.sqrt(3.0))
    # each gyro is brought to the middle of both temperatures by its own coefficient
    return spec.pair.temperature_coefficient_uncertainty_ppm_degc / PPM / float(np.sqrt(2.0))


def simulate_plan(spec: Spec, schedule: Schedule, device: Device, seed: int) -> Campaign:
    """Logs of gyros on a table that was run by a schedule, with the noise and the errors of
    mountings and runs that the plan assumes, and their truth, which states what is not of the plan.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    # a sample each second, of a scale factor near 10,000
    noise_lsb = 1e4 * device.noise_of(1.0)
    gyros = {name: simulate.RateGyro.draw(rng, noise_lsb=noise_lsb) for name in spec.gyros}
    if isinstance(spec, GyroPairRecipe):
        # both gyros change with temperature alike
        per_degc = float(rng.normal(0.0, scale_per_degc(spec)))
        gyros = {name: replace(gyro, K_per_degc=per_degc) for name, gyro in gyros.items()}
    # input axes are within a few mrad of those of the base
    directions = np.eye(3)[: len(gyros)] + rng.normal(0.0, 3e-3, (len(gyros), 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    shortest_s = min(hold.duration_s for hold in schedule.recorded("rate"))
    table = simulate.TurnedTable(interval_s=1.0, shortest_hold_s=shortest_s)
    # the base is mounted with its axes, or with the axis of each gyro of a pair, along the table's
    mounted = directions if isinstance(spec, GyroPairRecipe) else np.eye(3)
    tilts = np.radians(rng.normal(0.0, device.size(*MOUNTING), (3, 3)))
    logs: dict[str, dict[str, Array]] = {}
    for log, actions in schedule.by_log().items():
        axis = spec.find_axis(log.removeprefix(WITHHELD))
        axis_cosines = np.ones(len(gyros))
        if axis:
            axis_index = ("xyz" if axis in forms.AXES else "ab").index(axis)
            axis_cosines = directions @ (
                mounted[axis_index] + np.cross(tilts[axis_index], mounted[axis_index])
            )
        log_gyros = {}
        for (name, gyro), cosine in zip(gyros.items(), axis_cosines.tolist(), strict=True):
            to_table_deg = float(np.degrees(np.arccos(min(cosine, 1.0))))
            log_gyros[f"gyro_{name}_lsb"] = replace(
                gyro,
                axis=simulate.tilted(to_table_deg, rng.uniform(0.0, 360.0)),
                K=gyro.K * (1.0 + rng.normal(0.0, device.size(*RUN_SCALE) / PPM)),
                bias_dps=gyro.bias_dps + rng.normal(0.0, device.size(*RUN_ZERO) / DPH_PER_DPS),
            )
        degc = actions[0].set_degc - table.warming_degc / 2.0
        degc += rng.normal(0.0, device.size(*TEMPERATURE))
        rates = [hold.table_rate_dps for hold in actions]
        logs[log] = simulate.run(log_gyros, table, rates, degc, rng)
    truth: dict[str, Any] = {
        "gyros": {name: asdict(gyro) for name, gyro in gyros.items()},
        "directions": directions.tolist(),
        "tilts_rad": tilts.tolist(),
        "not_of_the_plan": "the response at a rate, which the gyros have of their own; the drift of"
        " the zero within a run, which is none",
    }
    if isinstance(spec, GyroPairRecipe):
        K_a, K_b = (
            gyro.best_line(table, rates, spec.reference_temp_degc)[0] for gyro in gyros.values()
        )
        alpha_deg = float(np.degrees(np.arccos(directions[0] @ directions[1])))
        truth["coefficients"] = {"pair": {"N": K_b / K_a, "alpha_deg": alpha_deg}}
    decimals = simulate.DECIMALS | {f"gyro_{name}_lsb": 1 for name in gyros}
    return Campaign(logs, decimals, truth)
