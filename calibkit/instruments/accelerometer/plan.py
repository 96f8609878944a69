"""Campaigns of a triad: which attitudes at which temperatures, in which order; where attitudes are
unknown, how many positions by hand, how long each.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, ClassVar

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import Residual, Shared
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    forms,
    published,
    shared_errors,
    simulate as simulated,
    simulate_magnitude,
    triad,
)
from calibkit.instruments.accelerometer.coefficient_files import COMPENSATIONS
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.fit import asked_terms
from calibkit.instruments.accelerometer.numeric import k_factor, q_factor
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe, KAxisSpec
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.planning.equipment import Device, Fixture
from calibkit.planning.exchange import Pool, pool, spread_apart
from calibkit.planning.levels import Tour
from calibkit.planning.schedule import Action, Clock, Schedule
from calibkit.planning.search import WITHHELD, Coefficient, Design, TourBench, count
from calibkit.planning.task import Assumed, Task, assume, read_earlier, seen_errors
from calibkit.simulate.campaign import Campaign

RESULTS = {"inclination": "deg", "toolface times sin(inclination)": "deg", "component": "g"}
OF_LENGTHS = {"component": "g", "axis angle": "deg"}
"""Results where attitudes are unknown."""
MAGNITUDE, HAND = "accelerometer_magnitude", "hand"
"""Device and fixture where attitudes are unknown."""
TWO_AXIS, HEAD = "two-axis", "dividing-head"
"""Fixture that is assumed, and one that turns the tool about one horizontal axis, in three
mountings.
"""
RANGE_DEGC = (-20.0, 125.0)
COUNTS = (*range(6, 17), 18, 20, 22, 24, 27, 30, 33, 36, 39, 42, 46, 50)
"""Numbers of attitudes that the search takes."""
POSITIONS = (*range(12, 20), 24, 30, 40)
"""Numbers of positions by hand that the search takes."""
FEW = 24
"""Attitudes of a fixture below which the search takes some twice."""
COUNTED = 16
"""Attitudes by which the time of a soak is reckoned before they are chosen."""
SEED = 1
"""Of the random starts of the search: the same plan gives the same bytes."""
DECIMALS = 12
"""Of a direction, so that rounding leaves nothing of a right angle."""
USED_LEVELS = 9
"""Temperatures of use at which an uncertainty is predicted."""
CHAMBER_DEGC = 0.1
"""Standard deviation of the temperature that is reached about the set point."""
THERMOMETER_DEGC = 0.002
"""Standard deviation of a thermometer reading that is averaged over a dwell."""
BY_HAND = 0.04
"""Standard deviation [1] of a direction that a hand reaches."""
EVERYWHERE = (
    (0, 0),
    *((tilt, roll) for tilt in range(30, 151, 30) for roll in range(0, 360, 45)),
    (180, 0),
)
"""Attitudes in which a triad is used."""
LENGTH_UNITS = {
    name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
}
"""(group, effect) of the errors that lengths of gravity at one temperature share."""


@dataclass(frozen=True)
class TriadBench(TourBench):
    """Campaigns of a triad in known attitudes; its recipe states the errors that are assumed."""

    lengths: ClassVar[bool] = False
    """Whether the fit knows the length of gravity alone."""
    log: ClassVar[str] = "positions.csv"
    left_out: ClassVar[int] = 2
    """Attitudes that are withheld."""
    counts: ClassVar[tuple[int, ...]] = COUNTS
    terms: Terms
    k: tuple[KAxisSpec, ...]
    """Terms of the K-factor, where that is what compensates."""
    fixture: Fixture
    spots: Array
    """Inclination and toolface [c, 2] [°] of the fixture's attitudes."""
    mounting: Integers
    """[c], rising."""

    @cached_property
    def gravity(self) -> Array:
        """Directions of gravity [c, 3] of the attitudes."""
        return attitude.gravity_vector(*self.spots.T)

    def state(self, dwells: DwellSet) -> list[Shared]:
        """Errors that a fit of the dwells has, with the sizes that are assumed; of lengths those
        whose sizes are stated.
        """
        gravity = dwells.indication
        along = np.broadcast_to(np.eye(3), (len(gravity), 3, 3))
        if self.lengths:
            along = gravity[:, None]
        listed = shared_errors.state_errors(dwells, gravity, along, self.spec)
        return [one for one in listed if one.size is not None or not self.lengths]

    def residual(self, dwells: DwellSet) -> Residual:
        """Residual of the fit."""
        t = self.assumed.mapped(dwells.temperature)
        return triad.residual_of(dwells, self.terms, t, lengths=self.lengths)

    def fit(self, rows: DwellSet) -> Fit:
        """What a fit will tell of the parameters, or of K."""
        noise, nominal = triad.relative_noise(rows, lengths=self.lengths), self.terms.nominal
        residual, shared = self.residual(rows), self.state(rows)
        fit = predict(residual, nominal, shared, noise=noise, names=self.terms.names)
        if not self.k:
            return fit
        form = published.corrections(self.k, rows.indication, self.assumed.mapped(rows.temperature))
        return fit.linear(published.pseudo_inverse(form, 1.0 / noise), rows.indication.ravel())

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, p] where it is used."""
        levels = np.linspace(*self.assumed.range_degc, USED_LEVELS)
        spots = np.tile(np.array(EVERYWHERE, dtype=np.float64), (USED_LEVELS, 1))
        gravity = attitude.gravity_vector(*spots.T)
        t = self.assumed.mapped(np.repeat(levels, len(EVERYWHERE)))
        if self.k:
            vector = published.corrections(self.k, gravity, t)
        else:
            vector = self.terms.slopes(self.terms.nominal, gravity, t)
        up, across = shared_errors.angle_slopes(*np.radians(spots).T)
        angles = [np.degrees(np.einsum("ni,nip->np", along, vector)) for along in (up, across)]
        return dict(zip(RESULTS, [*angles, vector.reshape(-1, vector.shape[2])], strict=True))

    def temperatures(self, rows: DwellSet) -> list[Array]:
        """Of all dwells."""
        return [rows.temperature]

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """In powers of °C."""
        fit, (low, high) = self.fit(self.rows(design)), self.assumed.range_degc
        middle_half = (low + high) / 2.0, max(high - low, 1.0) / 2.0
        if self.k:
            of_axis = np.asarray(published.to_degrees(*middle_half), dtype=np.float64)
            to_raw = np.kron(np.eye(3), of_axis)
            numbered = list(zip(k_factor.NAMES, forms.K_UNITS, strict=True))
            named = [(model, *words) for model in forms.K_MODELS for words in numbered]
            fitted = [number in part.fitted for part in self.k for number in range(10)]
        else:
            to_raw = np.asarray(self.terms.in_degrees(*middle_half), dtype=np.float64)
            named = [("triad", term.name, term.unit) for term in self.terms.listed]
            fitted = [True] * len(named)
        u = fit.of(lambda p: to_raw @ p).u.tolist()
        for words, size, stated in zip(named, u, fitted, strict=True):
            if stated:
                yield Coefficient(*words, size)

    def noise_of(self, dwell_s: float) -> float:
        """Noise [g] of the mean of a dwell, of a position by hand without both ends."""
        unused_s = self.spec.dwells.window_s if self.lengths else 0.0
        return self.assumed.noise_of(dwell_s - unused_s)

    def design(self, degc: Tour, choice: Sequence[int], dwell_s: float) -> Design:
        """Soaks at temperatures in their order, attitudes by number; where nothing is withheld yet,
        with those that lie farthest from them in a log that is.
        """
        log, clock = self.task.name_log(self.log), Clock(self.task.equipment)
        last = max(self.mounting[list(choice)])
        reached = self.gravity[self.mounting <= last]
        number = 0 if self.task.withheld else self.left_out
        recorded = [(k, log) for k in choice]
        recorded += [(k, f"{WITHHELD}{log}") for k in spread_apart(reached, choice, number)]
        for mounting in range(last + 1):
            if mounting > 0:
                clock.remount(self.task.equipment.fastest(self.assumed.device))
            for level in degc:
                if not self.lengths:
                    clock.settle(self.assumed.device, level)
                for k, name in recorded:
                    if self.mounting[k] == mounting:
                        clock.dwell(self.fixture, self.spots[k].tolist(), dwell_s, name)
        schedule = clock.schedule()
        fitted = [one for one in schedule.recorded("dwell") if one.log == log]
        levels = count(len(set(degc)), "temperature")
        label = f"{len(choice)} attitudes, {levels}, dwells of {dwell_s:g} s"
        if self.lengths:
            label = f"{len(choice)} positions of {dwell_s:g} s"
        # logs beside those that are measured are as these are
        mode = {} if self.task.have or self.lengths else {"dwells": {"mode": "rows"}}
        rows = planned_dwells(fitted, self.noise_of(dwell_s))
        return Design(label, schedule, (log,), rows, mode)

    def choices(self) -> Iterator[list[int]]:
        """Best attitudes of each number, on one, two … mountings: for the shortest dwells at the
        fewest temperatures, which are nearly the best of all.
        """
        rng, degc = np.random.default_rng(SEED), self.tours()[0]
        for last in range(int(self.mounting.max()) + 1):
            number = int(np.sum(self.mounting <= last))
            pool = self.pool(number, degc, min(self.assumed.device.dwell_s))
            if not np.isfinite(pool.criterion(range(number))):
                continue
            if number < FEW:
                pool = replace(pool, most=-(-FEW // number))
            sizes = [size for size in self.counts if size <= number * pool.most]
            for size in sizes or [number]:
                yield pool.search(size, rng)[0]

    def pool(self, number: int, degc: Tour, dwell_s: float) -> Pool:
        """The first attitudes as candidates, each held in the middle of all soaks; the criterion is
        the mean variance of the first result.
        """
        clock, actions = Clock(self.task.equipment), list[Action]()
        soak_s = COUNTED * (self.fixture.move_s + dwell_s)
        for level in degc:
            clock.settle(self.assumed.device, level)
            middle_s = clock.now_s + soak_s / 2.0
            actions += [
                Action(middle_s, "dwell", level, inclination_deg=tilt, toolface_deg=roll)
                for tilt, roll in self.spots[:number].tolist()
            ]
            clock.now_s += soak_s
        dwells = planned_dwells(actions, self.noise_of(dwell_s))
        stated = [one for one in self.state(dwells) if one.size]
        single = [one for one in stated if (one.group, one.effect) == shared_errors.INDEX]
        residual = self.residual(dwells)
        place = np.tile(np.arange(number), len(degc))
        return pool(
            derivative(lambda p: residual(p).ravel(), self.terms.nominal),
            [one for one in stated if one not in single],
            single,
            triad.relative_noise(dwells, lengths=self.lengths),
            np.repeat(place, 1 if self.lengths else 3),
            next(iter(replace(self, k=()).slopes.values())),
        )


@dataclass(frozen=True)
class LengthBench(TriadBench):
    """Campaigns of a triad that is turned by hand at one temperature, in attitudes that its fit
    does not know.
    """

    lengths = True
    log = "tumble.csv"
    left_out = 6
    counts = POSITIONS

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, 9]: of corrected components in all directions, and of the
        angles Q between the axes.
        """
        tilt, roll = np.meshgrid(np.arange(0.0, 181.0, 30.0), np.arange(0.0, 360.0, 45.0))
        unit = attitude.gravity_vector(tilt.ravel(), roll.ravel())
        nominal = self.terms.nominal
        component = self.terms.slopes(nominal, unit, np.zeros(len(unit)))
        angles = np.degrees(derivative(lambda p: self.terms.small_angles(p, 0.0), nominal))
        return dict(zip(OF_LENGTHS, (component.reshape(-1, len(nominal)), angles), strict=True))


def planned_dwells(actions: Sequence[Action], noise: float) -> DwellSet:
    """Dwells [n] of a triad without an error in one log, at the middle of each action, each with a
    noise [g] of its mean.
    """
    number = len(actions)
    tilt, roll = np.array([(one.inclination_deg, one.toolface_deg) for one in actions]).T
    return DwellSet(
        indication=np.round(attitude.gravity_vector(tilt, roll), DECIMALS),
        temperature=np.array([float(one.set_degc) for one in actions]),
        inclination=tilt,
        toolface=roll,
        noise=np.full((number, 3), noise),
        time=np.array([one.start_s + one.duration_s / 2.0 for one in actions]),
        log=np.zeros(number, dtype=np.int64),
        place=(),
        flags=(),
    )


def prepare_plan(spec: AccelerometerRecipe, task: Task) -> TriadBench:
    """What the search needs, where attitudes are known or not; UsageError for what cannot be
    planned.
    """
    lengths = spec.reference.kind == "magnitude"
    name = MAGNITUDE if lengths else spec.procedure
    device, have = task.equipment.known_device(name, "g"), None
    if lengths:
        _require_one_temperature(spec, task, device)
        assumed = assume(spec, task, device, LENGTH_UNITS)
    elif spec.affine.tilt or spec.affine.fixture:
        raise UsageError(
            "a plan of a triad is one of its K-factor or its affine model against known attitudes",
            hint='use reference.kind = "attitude", compensation = "k" or "affine", and neither'
            " affine.tilt nor affine.fixture",
        )
    else:
        files = (f"{stage}.json" for stage in COMPENSATIONS.values())
        records = read_earlier(task, name, *files)
        scatter = [model.residual_rms for record in records for model in record.models]
        assumed = assume(
            spec,
            task,
            device,
            shared_errors.UNITS,
            default_degc=RANGE_DEGC,
            earlier=seen_errors(records),
            noise=rms(scatter) if scatter else None,
        )
    if task.have:
        have = triad_dwells.collect_dwells(task.have, spec)
        indication, noise, degc = have.reference, assumed.noise, have.temperature
        if lengths:
            indication = have.indication / np.linalg.norm(have.indication, axis=1)[:, None]
            degc = np.full(len(indication), spec.reference_temp_degc)
            # of a log with a row for each dwell no noise is known
            logged = have.weights is not None
            noise = float(np.sqrt(np.mean(have.noise**2))) if logged else device.noise
        else:
            indication = np.round(indication, DECIMALS)
        of_each = np.full_like(indication, noise)
        have = replace(have, indication=indication, noise=of_each, temperature=degc)
    fixture = task.equipment.fixture(task.attitudes or (HAND if lengths else TWO_AXIS))
    spots, mounting = list_spots(fixture, mountings=3 if task.attitudes == HEAD else 1)
    # dwells need not have the errors that are assumed, as those that earlier runs had
    errors = {"component": assumed.components, "source": "history", "groups": "auto"}
    stated = spec.errors.model_copy(update=errors)
    terms, k = asked_terms(spec), spec.k.axes if spec.compensation == "k" else ()
    fitted = spec.k.axes if spec.k.enabled else ()
    orders = [terms.order, *(max(axis.scale_order, axis.zero_order) for axis in fitted)]
    bench = LengthBench if lengths else TriadBench
    return bench(
        spec=spec.model_copy(update={"errors": stated}),
        task=task,
        assumed=assumed,
        results=OF_LENGTHS if lengths else RESULTS,
        have=have,
        order=0 if lengths else max(orders),
        terms=terms,
        k=() if lengths else k,
        fixture=fixture,
        spots=spots,
        mounting=mounting,
    )


def _require_one_temperature(spec: AccelerometerRecipe, task: Task, device: Device) -> None:
    """Raise UsageError for what no plan of unknown attitudes can be."""
    if spec.affine.enabled or spec.dwells.mode != "series":
        raise UsageError(
            "a plan of unknown attitudes is for one temperature, and for a continuous log",
            hint='use affine.enabled = false and dwells.mode = "series"',
        )
    shortest = spec.dwells.window_s + spec.dwells.shortest_s
    if min(device.dwell_s) < shortest:
        raise UsageError(
            f"dwell_s of [device.{MAGNITUDE}] has {min(device.dwell_s):g} s, expected at least"
            f" {shortest:g} s: dwells.window_s and dwells.shortest_s",
            hint="state longer positions, or shorter ones in [dwells]",
        )
    if task.attitudes and not task.equipment.fixture(task.attitudes).spots:
        raise UsageError(
            f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
            hint="leave it out, or name a fixture with its own spots in the equipment file",
        )


def list_spots(fixture: Fixture, mountings: int = 1) -> tuple[Array, Integers]:
    """Attitudes [c, 2] [°] of a fixture, and the mounting of each [c]; of several mountings of one
    horizontal axis, along which a tool is mounted, then across it in two planes that hold it.
    """
    turns, step = range(0, 360, fixture.step_deg), fixture.step_deg
    spots: list[tuple[float, float]] = [(0, 0), *product(range(step, 180, step), turns), (180, 0)]
    if fixture.spots:
        spots = [*fixture.spots]
    elif mountings > 1:
        spots = [(90, roll) for roll in turns]
        for roll in (0, 90):
            spots += [(turn, roll) if turn <= 180 else (360 - turn, roll + 180) for turn in turns]
    mounting = np.repeat(np.arange(mountings), len(spots) // mountings)
    return np.array(spots, dtype=np.float64), mounting


def simulate_plan(
    spec: AccelerometerRecipe, schedule: Schedule, assumed: Assumed, seed: int
) -> Campaign:
    """Logs of a triad of physical sensors, with the errors that the plan assumes, and its truth."""
    rng = np.random.default_rng(seed)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    if spec.reference.kind == "magnitude":
        return _simulate_lengths(spec, schedule, assumed, sign, rng)
    sensors = simulated.draw_triad(rng)
    sizes = {name: assumed.size(*name) for name in shared_errors.UNITS}
    sizes[shared_errors.SECOND_ORDER] = 0.0  # these sensors have errors of their own
    actions = schedule.recorded("dwell")
    dwells = planned_dwells(actions, assumed.noise_of(actions[0].duration_s))
    indicate = partial(simulated.indications, sensors)
    measured, drawn = simulate_dwells(rng, indicate, dwells, sizes)
    time = np.array([one.start_s + one.duration_s / 2.0 for one in actions])
    columns = {"time_s": time, **measured}
    for axis in simulated.AXES:
        columns[f"accel_{axis}_g"] *= sign
    names = np.array([one.log for one in actions])
    logs = {
        log: {column: values[names == log] for column, values in columns.items()}
        for log in schedule.by_log()
    }
    truth = {"shared_errors": drawn, "sensors": simulated.describe(sensors)}
    return Campaign(logs, simulated.DECIMALS, truth)


def simulate_dwells(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    dwells: DwellSet,
    sizes: Mapping[tuple[str, str], float],
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Columns of dwells of a triad that indicates gravity [n, 3] [g] at temperatures [n] [°C], and
    the shared errors that were drawn, of sizes by (group, effect).

    Errors of the table and the fixture turn gravity before the sensors see it; those of the
    sensors are added to what they indicate.
    """
    shape = dwells.indication.shape
    of_gravity, of_sensors = np.zeros(shape), np.zeros(shape)
    drawn, axes = {}, np.broadcast_to(np.eye(3), (*shape, 3))
    # a zero drifts, whether a fit of one soak can tell or not
    for error in shared_errors.list_errors(dwells, dwells.indication, axes, timed=True):
        size = rng.normal(0.0, 1.0, (error.levels, error.width))
        size *= sizes.get((error.group, error.effect), 0.0)
        turned = of_gravity if error.unit == "rad" else of_sensors
        turned += error.along(size).reshape(shape)
        drawn[f"{error.effect} of the {error.group}"] = size.tolist()
    seen = dwells.indication + of_gravity
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    case = dwells.temperature + rng.normal(0.0, CHAMBER_DEGC, soak.size)[soak]
    indicated = indicate(seen, case) + of_sensors + rng.normal(0.0, dwells.noise)
    return {
        "temp_case_degc": case + rng.normal(0.0, THERMOMETER_DEGC, case.size),
        "inclination_deg": dwells.inclination,
        "toolface_deg": dwells.toolface,
        **{f"accel_{name}_g": indicated[:, i] for i, name in enumerate(simulated.AXES)},
    }, drawn


def _simulate_lengths(
    spec: AccelerometerRecipe,
    schedule: Schedule,
    assumed: Assumed,
    sign: float,
    rng: np.random.Generator,
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    k, b, q = (rng.normal(0.0, typical, 3) for typical in simulate_magnitude.SIZES)
    axes = q_factor.axes_from_angles(q)
    second = rng.normal(0.0, assumed.size(*shared_errors.SECOND_ORDER), 3)
    zero = rng.normal(0.0, assumed.size(*shared_errors.ZERO), 3)
    noise = assumed.noise_of(simulate_magnitude.INTERVAL_S)
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        spots = np.array([(one.inclination_deg, one.toolface_deg) for one in actions])
        gravity = attitude.gravity_vector(*spots.T) + rng.normal(0.0, BY_HAND, (len(actions), 3))
        gravity /= np.linalg.norm(gravity, axis=1)[:, None]
        along = simulate_magnitude.path(rng, gravity, actions[0].duration_s) @ axes.T
        seen = (1.0 + k) * (along + second * along**2) + b + zero
        seen = sign * (seen + rng.normal(0.0, noise, seen.shape))
        logs[name] = {
            "time_s": simulate_magnitude.INTERVAL_S * np.arange(len(seen), dtype=np.float64),
            **{f"accel_{axis}_g": seen[:, i] for i, axis in enumerate("xyz")},
        }
    # with M the inverse of the axes: k_i0 = M_ii/(1 + k_i), z_i0 = b_i k_i0, c_ij = -M_ij/M_jj
    matrix = np.linalg.inv(axes)
    scale = np.diag(matrix) / (1.0 + k)
    cross = -matrix / np.diag(matrix)
    truth = [*scale, *(b * scale), cross[1, 0], cross[2, 0], cross[2, 1]]
    named = dict(zip(asked_terms(spec).names, map(float, truth), strict=True))
    coefficients = {"coefficients": {"triad": named}}
    return Campaign(logs, simulate_magnitude.DECIMALS, coefficients)
