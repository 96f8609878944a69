"""Campaigns of a triad: which attitudes at which temperatures, in which order; where attitudes are
unknown, how many positions by hand, how long each.

What dwells will tell is predicted by the equation, the shared errors and the noise of the fit
(`equation`, `shared_errors`, `triad`), for a triad without an error. The best attitudes of each
number are sought by exchange, at the temperatures of the shortest campaign; then all are compared.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import product
from typing import Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import Residual, Shared
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    forms,
    shared_errors,
    simulate as simulated,
    simulate_magnitude,
    triad,
)
from calibkit.instruments.accelerometer.corrections import COMPENSATIONS
from calibkit.instruments.accelerometer.determination import asked_terms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import rms
from calibkit.planning.bench import (
    WITHHELD,
    Bench,
    Design,
    PredictedCoefficient,
    Task,
    Tour,
    Units,
    count,
    draw_errors,
)
from calibkit.planning.equipment import Device
from calibkit.planning.exchange import Pool, pool, spread_apart
from calibkit.planning.schedule import Action, Clock, Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.coefficients import Record, StageResult
from calibkit.records.frame import Log
from calibkit.simulate.campaign import Campaign

DECIMALS = 12
"""Of a direction, so that rounding leaves nothing of a right angle."""
FEW = 24
"""Attitudes of a fixture below which the search takes some twice."""
USED_LEVELS = 9
"""Temperatures of use at which an uncertainty is predicted."""


class TriadBench(Bench):
    """Campaigns of a triad in known attitudes, by its equation; the K-factor is fitted to the same
    dwells.
    """

    results: Mapping[str, str] = {
        "inclination": "deg",
        "toolface times sin(inclination)": "deg",
        "component": "g",
    }
    units: Units = shared_errors.UNITS
    default_degc: tuple[float, float] | None = (-20.0, 125.0)
    files: tuple[str, ...] = tuple(f"{stage}.json" for stage in COMPENSATIONS.values())
    noise_unit = "g"
    lengths = False
    """Whether the fit knows the length of gravity alone."""
    log = "positions.csv"
    counts = (*range(6, 17), 18, 20, 22, 24, 27, 30, 33, 36, 39, 42, 46, 50)
    """Numbers of attitudes that the search takes."""
    left_out = 2
    """Attitudes that are withheld."""
    everywhere: tuple[tuple[int, int], ...] = (
        (0, 0),
        *product(range(30, 151, 30), range(0, 360, 45)),
        (180, 0),
    )
    """Attitudes [°] in which the triad is used."""
    unused_s = 0.0
    """Part of a dwell [s] that a fit leaves out."""

    def __init__(self, spec: AccelerometerRecipe, task: Task) -> None:
        """UsageError also for an equation that no plan knows."""
        super().__init__(spec, task)
        if (
            spec.affine.tilt
            or spec.affine.fixture
            or (spec.compensation == "k" and not self.lengths)
        ):
            raise UsageError(
                "a plan of a triad is one of its affine model against known attitudes",
                hint='use compensation = "affine" (K is fitted to the same dwells), and neither'
                " affine.tilt nor affine.fixture",
            )
        self.terms, of_k = asked_terms(spec)
        self.order = max(self.terms.power)
        if spec.k.enabled and not self.lengths:  # of lengths no K is fitted
            self.order = max(self.order, *of_k.power)
        # Attitudes [c, 2] [°] of the fixture in each mounting. A dividing head turns the tool about
        # one horizontal axis: along the tool, then across it in two planes that hold it.
        fixture = task.equipment.fixture(task.attitudes or ("hand" if self.lengths else "two-axis"))
        turns, step = range(0, 360, fixture.step_deg), fixture.step_deg
        spots = [*(fixture.spots or ((0, 0), *product(range(step, 180, step), turns), (180, 0)))]
        mountings = [spots]
        if task.attitudes == "dividing-head" and not fixture.spots:
            across_tool = [(turn, 0) if turn <= 180 else (360 - turn, 180) for turn in turns]
            quarter_on = [(tilt, roll + 90) for tilt, roll in across_tool]
            mountings = [[(90, roll) for roll in turns], [*across_tool], [*quarter_on]]
        self.fixture = fixture
        self.mountings = [np.array(spots, dtype=np.float64) for spots in mountings]

    def errors_of_run(
        self, records: Sequence[Record | StageResult]
    ) -> tuple[list[ErrorComponent], float | None]:
        """Also the noise of a dwell."""
        models = [model for record in records for model in record.models]
        # residuals hold the errors that dwells share, which are assumed beside the noise
        stated = [p for model in models for p in model.parameters if p.name.startswith("noise_")]
        noises = [p.value for p in stated] or [model.residual_rms for model in models]
        return super().errors_of_run(records)[0], rms(noises) if noises else None

    def rows_of_logs(self, logs: Sequence[Log]) -> DwellSet:
        """Dwells of a triad without an error, in the attitudes of the logs; of lengths, with the
        noise that positions show and at the reference temperature.
        """
        dwells, noise = triad_dwells.collect_dwells(logs, self.spec), self.device.noise
        indication, degc = np.round(dwells.reference, DECIMALS), dwells.temperature
        if self.lengths:
            indication = dwells.indication / np.linalg.norm(dwells.indication, axis=1)[:, None]
            degc = np.full(len(indication), self.spec.reference_temp_degc)
            if np.all(dwells.noise > 0.0):  # of a log with a row for each dwell no noise is known
                noise = rms(dwells.noise)
        of_each = np.full_like(indication, noise)
        return replace(dwells, indication=indication, noise=of_each, temperature=degc)

    def equation(self, dwells: DwellSet) -> tuple[Residual, list[Shared], Array]:
        """Residual of the fit of the dwells, errors that they share, with the sizes that are
        assumed (of lengths those alone), and noise [n] of the residuals.
        """
        gravity, t = dwells.indication, self.mapped(dwells.temperature)
        axes = np.broadcast_to(np.eye(3), (len(gravity), 3, 3))
        spec = self.spec.model_copy(update={"errors": self.device.errors})
        shared = shared_errors.state_errors(
            dwells, gravity, gravity[:, None] if self.lengths else axes, spec
        )
        if self.lengths:
            shared = [error for error in shared if error.size is not None]
        residual = partial(
            triad.residual, dwells=dwells, terms=self.terms, t=t, lengths=self.lengths
        )
        return residual, shared, dwells.relative_noise(lengths=self.lengths)

    def fit(self, rows: DwellSet) -> Fit:
        """What a fit will tell of the parameters."""
        residual, shared, noise = self.equation(rows)
        return predict(residual, self.terms.start(), shared, noise=noise, names=self.terms.names)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, p] where it is used."""
        spots = np.tile(np.array(self.everywhere, dtype=np.float64), (USED_LEVELS, 1))
        levels = np.repeat(np.linspace(*self.range_degc, USED_LEVELS), len(self.everywhere))
        gravity, t = attitude.gravity_vector(*spots.T), self.mapped(levels)
        start = self.terms.start()
        vector = derivative(lambda p: self.terms.corrected(p, gravity, t), start)
        component = vector.reshape(-1, vector.shape[2])
        if self.lengths:
            by_angles = derivative(lambda p: self.terms.at_temperature(p, 0.0)[6:], start)
            return dict(zip(self.results, (component, np.degrees(by_angles)), strict=True))
        angles = [
            np.degrees(np.einsum("ni,nip->np", angle_slope, vector))
            for angle_slope in shared_errors.angle_slopes(*np.radians(spots).T)
        ]
        return dict(zip(self.results, [*angles, component], strict=True))

    def coefficients(self, rows: DwellSet) -> Iterator[PredictedCoefficient]:
        """In powers of °C."""
        to_raw: Array = np.asarray(self.terms.to_degrees(*self.middle_half), dtype=np.float64)
        u = self.fit(rows).of(lambda p: to_raw @ p).u.tolist()
        for name, unit, size in zip(self.terms.names, self.terms.units, u, strict=True):
            yield PredictedCoefficient("triad", name, unit, size)

    def choices(self) -> Iterator[list[int]]:
        """Best attitudes of each number, on one, two … mountings: for the shortest dwells at the
        fewest temperatures, which are nearly the best of all.
        """
        # one seed for the random starts of the search: the same plan gives the same bytes
        rng, number = np.random.default_rng(1), 0
        for spots in self.mountings:
            number += len(spots)
            pool = self.pool(number, self.tours()[0], min(self.device.dwell_s))
            if not np.isfinite(pool.criterion(range(number))):
                continue
            if number < FEW:
                pool = replace(pool, most_uses=-(-FEW // number))
            most = number * pool.most_uses
            for size in [size for size in self.counts if size <= most] or [number]:
                yield pool.search(size, rng)[0]

    def design(self, degc: Tour, choice: Sequence[int], dwell_s: float) -> Design:
        """Soaks at temperatures in their order, attitudes by number; where nothing is withheld yet,
        with those that lie farthest from them in a log that is.
        """
        log, clock = self.task.name_log(self.log), Clock(self.task.equipment)
        spots = np.concatenate(self.mountings)
        mounting = np.repeat(np.arange(len(self.mountings)), [*map(len, self.mountings)])
        last = max(mounting[list(choice)])
        recorded = [(k, log) for k in choice]
        if not self.task.withheld:
            reached = attitude.gravity_vector(*spots[mounting <= last].T)
            farthest = spread_apart(reached, choice, self.left_out)
            recorded += [(k, f"{WITHHELD}{log}") for k in farthest]
        for number in range(last + 1):
            if number > 0:
                clock.remount(self.task.equipment.fastest(self.device))
            for level in degc:
                if not self.lengths:
                    clock.settle(self.device, level)
                for k, name in recorded:
                    if mounting[k] == number:
                        clock.dwell(self.fixture, spots[k].tolist(), dwell_s, name)
        schedule = clock.schedule()
        levels = count(len(set(degc)), "temperature")
        label = f"{len(choice)} attitudes, {levels}, dwells of {dwell_s:g} s"
        if self.lengths:
            label = f"{len(choice)} positions of {dwell_s:g} s"
        # logs beside those that are measured are as these are
        mode = {} if self.task.have or self.lengths else {"dwells": {"mode": "rows"}}
        noise = self.device.noise_of(dwell_s - self.unused_s)
        rows = planned_dwells(schedule.by_log()[log], noise)
        return Design(label, schedule, (log,), rows, mode)

    def pool(self, number: int, degc: Tour, dwell_s: float) -> Pool:
        """The first attitudes as candidates, each held in the middle of all soaks; the criterion is
        the mean variance of the first result.
        """
        clock, actions = Clock(self.task.equipment), list[Action]()
        # a soak is taken to have 16 attitudes before they are chosen
        soak_s = 16 * (self.fixture.move_s + dwell_s)
        for level in degc:
            clock.settle(self.device, level)
            middle_s = clock.now_s + soak_s / 2.0
            actions += [
                Action(middle_s, "dwell", level, inclination_deg=tilt, toolface_deg=roll)
                for tilt, roll in np.concatenate(self.mountings)[:number].tolist()
            ]
            clock.now_s += soak_s
        dwells = planned_dwells(actions, self.device.noise_of(dwell_s - self.unused_s))
        residual, shared, noise = self.equation(dwells)
        # an index error is of one attitude, the others are of several
        of_attitude, common = list[Shared](), list[Shared]()
        for error in shared:
            if error.size:
                is_index = (error.group, error.effect) == shared_errors.INDEX
                (of_attitude if is_index else common).append(error)
        place = np.tile(np.arange(number), len(degc))
        return pool(
            derivative(lambda p: residual(p).ravel(), self.terms.start()),
            common,
            of_attitude,
            noise,
            np.repeat(place, len(noise) // len(place)),
            next(iter(self.slopes.values())),
        )


class HandBench(TriadBench):
    """Campaigns of a triad whose attitudes are unknown: positions by hand at one temperature."""

    results = {"component": "g", "axis angle": "deg"}
    units = {
        name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
    }
    default_degc, device_name, lengths = None, "accelerometer_magnitude", True
    # a log of positions shows noise in its own rows, and no other error alone
    files, log, left_out = (), "tumble.csv", 6
    counts, everywhere = (
        (*range(12, 20), 24, 30, 40),
        tuple(product(range(0, 181, 30), range(0, 360, 45))),
    )

    def __init__(self, spec: AccelerometerRecipe, task: Task) -> None:
        """UsageError also for a log, positions or a fixture that do not suit a hand."""
        super().__init__(spec, task)
        # a hand does not hold both ends of a position
        self.unused_s = spec.dwells.window_s
        shortest_s, dwell_s = self.unused_s + spec.dwells.shortest_s, min(self.device.dwell_s)
        if spec.affine.enabled or spec.dwells.mode != "series":
            raise UsageError(
                "a plan of unknown attitudes is for one temperature, and for a continuous log",
                hint='use affine.enabled = false and dwells.mode = "series"',
            )
        if dwell_s < shortest_s:
            raise UsageError(
                f"dwell_s of [device.{self.device_name}] has {dwell_s:g} s, expected at least"
                f" {shortest_s:g} s: dwells.window_s and dwells.shortest_s",
                hint="state longer positions, or shorter ones in [dwells]",
            )
        if task.attitudes and not self.fixture.spots:
            raise UsageError(
                f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
                hint="leave it out, or name a fixture with its own spots in the equipment file",
            )


def prepare_plan(spec: AccelerometerRecipe, task: Task) -> TriadBench:
    """Campaigns where attitudes are known, or not."""
    return (HandBench if spec.reference.kind == "magnitude" else TriadBench)(spec, task)


def planned_dwells(actions: Sequence[Action], noise: float) -> DwellSet:
    """Dwells [n] of a triad without an error in one log, at the middle of each action, each with a
    noise [g] of its mean.
    """
    number = len(actions)
    tilt, roll = np.array([(dwell.inclination_deg, dwell.toolface_deg) for dwell in actions]).T
    return DwellSet(
        indication=np.round(attitude.gravity_vector(tilt, roll), DECIMALS),
        temperature=np.array([float(dwell.set_degc) for dwell in actions]),
        inclination=tilt,
        toolface=roll,
        noise=np.full((number, 3), noise),
        time=np.array([dwell.start_s + dwell.duration_s / 2.0 for dwell in actions]),
        log=np.zeros(number, dtype=np.int64),
        place=(),
        flags=(),
    )


def simulate_plan(
    spec: AccelerometerRecipe, schedule: Schedule, device: Device, seed: int
) -> Campaign:
    """Logs of a triad of physical sensors, with the errors that the plan assumes, and its truth."""
    rng = np.random.default_rng(seed)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    if spec.reference.kind == "magnitude":
        return _simulate_lengths(spec, schedule, device, sign, rng)
    sensors = simulated.draw_triad(rng)
    actions = schedule.recorded("dwell")
    dwells = planned_dwells(actions, device.noise_of(actions[0].duration_s))
    indicate = partial(simulated.indications, sensors)
    not_of_the_plan = [shared_errors.SECOND_ORDER]  # these sensors have errors of their own
    indication, degc, drawn = simulate_dwells(rng, indicate, dwells, spec, device, not_of_the_plan)
    columns = {
        "time_s": dwells.time,
        "temp_case_degc": degc,
        "inclination_deg": dwells.inclination,
        "toolface_deg": dwells.toolface,
        **dict(zip(forms.COMPONENTS, sign * indication.T, strict=True)),
    }
    log_of = np.array([dwell.log for dwell in actions])
    logs = {
        log: {name: column[log_of == log] for name, column in columns.items()}
        for log in schedule.by_log()
    }
    truth = {
        "shared_errors": drawn,
        "sensors": simulated.describe(sensors),
        "not_of_the_plan": "the second order of the sensors, which have errors of their own",
    }
    return Campaign(logs, simulated.DECIMALS, truth)


def simulate_dwells(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    device: Device,
    left_out: Collection[tuple[str, str]] = (),
) -> tuple[Array, Array, dict[str, Any]]:
    """Indications [n, 3] [g] and case temperatures [n] [°C] of dwells of a triad that indicates
    gravity [n, 3] [g] at temperatures [n] [°C], with the noise of the dwells and the errors that
    the device is assumed to have, which were drawn, but for those left out.
    """
    shape = dwells.indication.shape
    axes = np.broadcast_to(np.eye(3), (*shape, 3))
    assumed = spec.model_copy(update={"errors": device.errors})
    shared = shared_errors.state_errors(dwells, dwells.indication, axes, assumed)
    shared = [error for error in shared if (error.group, error.effect) not in left_out]
    errors, drawn = draw_errors(shared, rng)
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    # the chamber settles 0.1 °C off its set point; a reading is averaged over the dwell
    case = dwells.temperature + rng.normal(0.0, 0.1, soak.size)[soak]
    felt = dwells.indication + errors.reshape(shape)
    indication = indicate(felt, case) + rng.normal(0.0, dwells.noise)
    return indication, case + rng.normal(0.0, 0.002, case.size), drawn


def _simulate_lengths(
    spec: AccelerometerRecipe,
    schedule: Schedule,
    device: Device,
    sign: float,
    rng: np.random.Generator,
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    scale, zero, cross = (rng.normal(0.0, typical, 3) for typical in simulate_magnitude.SIZES)
    scale += 1.0
    # a = (I - C)⁻¹ g acts along the axes, and G = (a + z)/k is indicated
    C = np.zeros((3, 3))
    C[(1, 2, 2), (0, 0, 1)] = cross
    second = rng.normal(0.0, device.size(*shared_errors.SECOND_ORDER), 3)
    zero_of_soak = rng.normal(0.0, device.size(*shared_errors.ZERO), 3)
    noise = device.noise_of(simulate_magnitude.INTERVAL_S)
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        planned = planned_dwells(actions, noise).reference
        # a hand reaches a direction within two degrees
        gravity = planned + rng.normal(0.0, 0.04, planned.shape)
        gravity /= np.linalg.norm(gravity, axis=1)[:, None]
        path = simulate_magnitude.path(rng, gravity, actions[0].duration_s)
        a = path @ np.linalg.inv(np.eye(3) - C).T
        indication = (a + second * a**2 + zero_of_soak + zero) / scale
        indication += rng.normal(0.0, noise, indication.shape)
        time_s = simulate_magnitude.INTERVAL_S * np.arange(float(len(indication)))
        by_axis = zip(forms.COMPONENTS, sign * indication.T, strict=True)
        logs[name] = {"time_s": time_s, **dict(by_axis)}
    truth = np.concatenate([scale, zero, cross]).tolist()
    coefficients = dict(zip(asked_terms(spec)[0].names, truth, strict=True))
    return Campaign(logs, simulate_magnitude.DECIMALS, {"coefficients": {"triad": coefficients}})
