"""Campaigns of a triad: which attitudes at which temperatures, in which order; where attitudes are
unknown, how many positions by hand, how long each.

What dwells will tell is predicted by the equation, the shared errors and the noise of the fit
(`equation`, `shared_errors`, `triad`), for a triad without an error. The best attitudes of each
number are sought by exchange, at the temperatures of the shortest campaign; then all are compared.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import Any

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
from calibkit.instruments.accelerometer.corrections import COMPENSATIONS
from calibkit.instruments.accelerometer.determination import asked_terms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe, KAxisSpec
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.planning.equipment import Fixture
from calibkit.planning.exchange import Pool, pool, spread_apart
from calibkit.planning.schedule import Action, Clock, Schedule
from calibkit.planning.search import WITHHELD, Bench, Design, PredictedCoefficient, Tour, count
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
NOISES = ("noise_x", "noise_y", "noise_z")
"""Parameters of a triad's model that state the noise of a dwell along each axis [g]."""
COUNTS = (*range(6, 17), 18, 20, 22, 24, 27, 30, 33, 36, 39, 42, 46, 50)
POSITIONS = (*range(12, 20), 24, 30, 40)
"""Numbers of attitudes that the search takes, and of positions by hand."""
LEFT_OUT, POSITIONS_LEFT_OUT = 2, 6
"""Attitudes and positions that are withheld."""
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
BY_LENGTHS = tuple(product(range(0, 181, 30), range(0, 360, 45)))
"""Attitudes in which a triad is used, where it was calibrated in known and in unknown ones."""
LENGTH_UNITS = {
    name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
}
"""(group, effect) of the errors that lengths of gravity at one temperature share."""


@dataclass(frozen=True, kw_only=True)
class TriadBench(Bench):
    """Campaigns of a triad; its recipe states the errors that are assumed."""

    lengths: bool
    """Whether the fit knows the length of gravity alone, in positions by hand at one
    temperature.
    """
    terms: Terms
    k: tuple[KAxisSpec, ...]
    """Terms of the K-factor, where that is what compensates."""
    fixture: Fixture
    spots: Array
    """Inclination and toolface [c, 2] [°] of the fixture's attitudes."""
    mounting: Integers
    """[c], rising."""

    @property
    def gravity(self) -> Array:
        """Directions of gravity [c, 3] of the attitudes."""
        return attitude.gravity_vector(*self.spots.T)

    def dwells(self, actions: Sequence[Action], dwell_s: float) -> DwellSet:
        """Planned dwells of a length [s], of a position by hand without both ends."""
        unused_s = self.spec.dwells.window_s if self.lengths else 0.0
        return planned_dwells(actions, self.assumed.noise_of(dwell_s - unused_s))

    def equation(self, dwells: DwellSet) -> tuple[Residual, list[Shared], Array]:
        """Residual of the fit of the dwells, errors that they share, with the sizes that are
        assumed (of lengths those alone), and noise [n] of the residuals.
        """
        gravity, t = dwells.indication, self.assumed.mapped(dwells.temperature)
        residual_axes = np.broadcast_to(np.eye(3), (len(gravity), 3, 3))
        if self.lengths:
            residual_axes = gravity[:, None]
        shared = shared_errors.state_errors(dwells, gravity, residual_axes, self.spec)
        if self.lengths:
            shared = [error for error in shared if error.size is not None]
        residual = partial(
            triad.residual, dwells=dwells, terms=self.terms, t=t, lengths=self.lengths
        )
        return residual, shared, dwells.relative_noise(lengths=self.lengths)

    def fit(self, rows: DwellSet) -> Fit:
        """What a fit will tell of the parameters, or of K."""
        residual, shared, noise = self.equation(rows)
        names = self.terms.names
        fit = predict(residual, self.terms.nominal, shared, noise=noise, names=names)
        if self.k:
            form = k_design(self.k, rows.indication, self.assumed.mapped(rows.temperature))
            P = np.linalg.pinv(form.reshape(len(noise), -1) / noise[:, None]) / noise
            P[~form.any(axis=(0, 1))] = 0.0  # what is not fitted has no rounding either
            fit = fit.linear(P, rows.indication.ravel())
        return fit

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, p] where it is used."""
        levels = np.linspace(*self.assumed.range_degc, USED_LEVELS)
        everywhere = BY_LENGTHS if self.lengths else EVERYWHERE
        spots = np.tile(np.array(everywhere, dtype=np.float64), (USED_LEVELS, 1))
        gravity, nominal = attitude.gravity_vector(*spots.T), self.terms.nominal
        t = self.assumed.mapped(np.repeat(levels, len(everywhere)))
        vector = self.terms.slopes(nominal, gravity, t)
        if self.k:
            vector = k_design(self.k, gravity, t)
        component = vector.reshape(-1, vector.shape[2])
        if self.lengths:
            by_angles = derivative(lambda p: self.terms.small_angles(p, 0.0), nominal)
            return dict(zip(OF_LENGTHS, (component, np.degrees(by_angles)), strict=True))
        angles = [
            np.degrees(np.einsum("ni,nip->np", angle_slope, vector))
            for angle_slope in shared_errors.angle_slopes(*np.radians(spots).T)
        ]
        return dict(zip(RESULTS, [*angles, component], strict=True))

    def coefficients(self, rows: DwellSet) -> Iterator[PredictedCoefficient]:
        """In powers of °C; of K those that are fitted."""
        middle_half = self.assumed.middle_half
        to_raw: Array = np.asarray(self.terms.in_degrees(*middle_half), dtype=np.float64)
        labels = [("triad", term.name, term.unit) for term in self.terms.listed]
        if self.k:
            to_raw = np.kron(np.eye(3), published.to_degrees(*middle_half)).astype(np.float64)
            numbers = list(zip(published.K_NAMES, published.K_UNITS, strict=True))
            labels = [(model, *number) for model in forms.K_MODELS for number in numbers]
        for label, u in zip(labels, self.fit(rows).of(lambda p: to_raw @ p).u, strict=True):
            if u > 0.0:
                yield PredictedCoefficient(*label, float(u))

    def design(self, degc: Tour, choice: Sequence[int], dwell_s: float) -> Design:
        """Soaks at temperatures in their order, attitudes by number; where nothing is withheld yet,
        with those that lie farthest from them in a log that is.
        """
        log = self.task.name_log("tumble.csv" if self.lengths else "positions.csv")
        number = POSITIONS_LEFT_OUT if self.lengths else LEFT_OUT
        clock, last = Clock(self.task.equipment), max(self.mounting[list(choice)])
        reached = self.gravity[self.mounting <= last]
        recorded = [(k, log) for k in choice]
        if not self.task.withheld:
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
        levels = count(len(set(degc)), "temperature")
        label = f"{len(choice)} attitudes, {levels}, dwells of {dwell_s:g} s"
        if self.lengths:
            label = f"{len(choice)} positions of {dwell_s:g} s"
        # logs beside those that are measured are as these are
        mode = {} if self.task.have or self.lengths else {"dwells": {"mode": "rows"}}
        rows = self.dwells(schedule.by_log()[log], dwell_s)
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
                pool = replace(pool, most_uses=-(-FEW // number))
            counts, most = POSITIONS if self.lengths else COUNTS, number * pool.most_uses
            for size in [size for size in counts if size <= most] or [number]:
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
        residual, shared, noise = self.equation(self.dwells(actions, dwell_s))
        # an index error is of one attitude, the others are of several
        of_attitude, common = list[Shared](), list[Shared]()
        for error in shared:
            if error.size:
                is_index = (error.group, error.effect) == shared_errors.INDEX
                (of_attitude if is_index else common).append(error)
        place = np.tile(np.arange(number), len(degc))
        return pool(
            derivative(lambda p: residual(p).ravel(), self.terms.nominal),
            common,
            of_attitude,
            noise,
            np.repeat(place, len(noise) // len(place)),
            next(iter(replace(self, k=()).slopes.values())),
        )


def k_design(axes: Sequence[KAxisSpec], indication: Array, t: Array) -> Array:
    """Design [n, 3, 30] of corrected components by K0 … K9 of x, then y and z, 0 where one is not
    fitted, for temperatures t [n] in the unit that K is meant for.
    """
    design = np.zeros((len(t), 3, 3, 10))
    for axis, orders in enumerate(axes):
        fitted = [*orders.fitted]
        design[:, axis, axis, fitted] = published.columns(indication, t, axis)[:, fitted]
    return design.reshape(len(t), 3, 30)


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


def prepare_plan(spec: AccelerometerRecipe, task: Task) -> TriadBench:
    """What the search needs, where attitudes are known or not; UsageError for what cannot be
    planned.
    """
    lengths = spec.reference.kind == "magnitude"
    device = task.equipment.known_device(MAGNITUDE if lengths else spec.procedure, "g")
    if lengths:
        _require_one_temperature(spec, task, min(device.dwell_s))
        assumed = assume(spec, task, device, LENGTH_UNITS)
    elif spec.affine.tilt or spec.affine.fixture:
        raise UsageError(
            "a plan of a triad is one of its K-factor or its affine model against known attitudes",
            hint='use reference.kind = "attitude", compensation = "k" or "affine", and neither'
            " affine.tilt nor affine.fixture",
        )
    else:
        files = [f"{stage}.json" for stage in COMPENSATIONS.values()]
        records = read_earlier(task, spec.procedure, *files)
        models = [model for record in records for model in record.models]
        # residuals hold the errors that dwells share, which are assumed beside the noise
        stated_noises = [p.value for model in models for p in model.parameters if p.name in NOISES]
        noises = stated_noises or [model.residual_rms for model in models]
        assumed = assume(
            spec,
            task,
            device,
            shared_errors.UNITS,
            default_degc=RANGE_DEGC,
            earlier=seen_errors(records),
            noise=rms(noises) if noises else None,
        )

    have = None
    if task.have:
        measured, noise = triad_dwells.collect_dwells(task.have, spec), assumed.noise
        indication, degc = np.round(measured.reference, DECIMALS), measured.temperature
        if lengths:
            indication = measured.indication
            indication = indication / np.linalg.norm(indication, axis=1)[:, None]
            degc = np.full(len(indication), spec.reference_temp_degc)
            # of a log with a row for each dwell no noise is known
            noise = rms(measured.noise) if np.all(measured.noise > 0.0) else device.noise
        of_each = np.full_like(indication, noise)
        have = replace(measured, indication=indication, noise=of_each, temperature=degc)

    # Attitudes of the fixture. A dividing head turns the tool about one horizontal axis: along the
    # tool, then across it in two planes that hold it, each of which is a mounting.
    fixture = task.equipment.fixture(task.attitudes or (HAND if lengths else TWO_AXIS))
    mountings = 3 if task.attitudes == HEAD and not fixture.spots else 1
    turns, step = range(0, 360, fixture.step_deg), fixture.step_deg
    spots = fixture.spots or ((0, 0), *product(range(step, 180, step), turns), (180, 0))
    if mountings > 1:
        across_tool = [(turn, 0) if turn <= 180 else (360 - turn, 180) for turn in turns]
        quarter_on = [(tilt, roll + 90) for tilt, roll in across_tool]
        spots = (*((90, roll) for roll in turns), *across_tool, *quarter_on)

    # of lengths neither K nor a temperature coefficient is fitted
    terms, k = asked_terms(spec), spec.k.axes if spec.k.enabled and not lengths else ()
    orders = [terms.order, *(max(axis.scale_order, axis.zero_order) for axis in k)]
    return TriadBench(
        spec=spec.model_copy(update={"errors": assumed.stated}),
        task=task,
        assumed=assumed,
        results=OF_LENGTHS if lengths else RESULTS,
        have=have,
        order=max(orders),
        lengths=lengths,
        terms=terms,
        k=k if spec.compensation == "k" else (),
        fixture=fixture,
        spots=np.array(spots, dtype=np.float64),
        mounting=np.repeat(np.arange(mountings), len(spots) // mountings),
    )


def _require_one_temperature(spec: AccelerometerRecipe, task: Task, dwell_s: float) -> None:
    """Raise UsageError for what no plan of unknown attitudes can be."""
    shortest = spec.dwells.window_s + spec.dwells.shortest_s
    if spec.affine.enabled or spec.dwells.mode != "series":
        raise UsageError(
            "a plan of unknown attitudes is for one temperature, and for a continuous log",
            hint='use affine.enabled = false and dwells.mode = "series"',
        )
    if dwell_s < shortest:
        raise UsageError(
            f"dwell_s of [device.{MAGNITUDE}] has {dwell_s:g} s, expected at least"
            f" {shortest:g} s: dwells.window_s and dwells.shortest_s",
            hint="state longer positions, or shorter ones in [dwells]",
        )
    if task.attitudes and not task.equipment.fixture(task.attitudes).spots:
        raise UsageError(
            f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
            hint="leave it out, or name a fixture with its own spots in the equipment file",
        )


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
    indication, degc, drawn = simulate_dwells(rng, indicate, dwells, sizes)
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
    truth = {"shared_errors": drawn, "sensors": simulated.describe(sensors)}
    return Campaign(logs, simulated.DECIMALS, truth)


def simulate_dwells(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    dwells: DwellSet,
    sizes: Mapping[tuple[str, str], float],
) -> tuple[Array, Array, dict[str, Any]]:
    """Indications [n, 3] [g] and case temperatures [n] [°C] of dwells of a triad that indicates
    gravity [n, 3] [g] at temperatures [n] [°C], and the shared errors that were drawn, of sizes by
    (group, effect).

    Errors of the table and the fixture turn gravity before the sensors see it; those of the
    sensors are added to what they indicate.
    """
    shape = dwells.indication.shape
    axes = np.broadcast_to(np.eye(3), (*shape, 3))
    of_gravity, of_sensors, drawn = np.zeros(shape), np.zeros(shape), {}
    # a zero drifts, whether a fit of a single soak can tell or not
    for error in shared_errors.list_errors(dwells, dwells.indication, axes, timed=True):
        size = rng.normal(0.0, 1.0, (error.levels, error.width))
        size *= sizes.get((error.group, error.effect), 0.0)
        errors = of_gravity if error.unit == "rad" else of_sensors
        errors += error.along(size).reshape(shape)
        drawn[f"{error.effect} of the {error.group}"] = size.tolist()
    gravity = dwells.indication + of_gravity
    gravity /= np.linalg.norm(gravity, axis=1)[:, None]
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    case = dwells.temperature + rng.normal(0.0, CHAMBER_DEGC, soak.size)[soak]
    indication = indicate(gravity, case) + of_sensors + rng.normal(0.0, dwells.noise)
    return indication, case + rng.normal(0.0, THERMOMETER_DEGC, case.size), drawn


def _simulate_lengths(
    spec: AccelerometerRecipe,
    schedule: Schedule,
    assumed: Assumed,
    sign: float,
    rng: np.random.Generator,
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    k, b, q = (rng.normal(0.0, typical, 3) for typical in simulate_magnitude.SIZES)
    axes = published.axes_from_angles(q)
    second = rng.normal(0.0, assumed.size(*shared_errors.SECOND_ORDER), 3)
    zero = rng.normal(0.0, assumed.size(*shared_errors.ZERO), 3)
    noise = assumed.noise_of(simulate_magnitude.INTERVAL_S)
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        planned = planned_dwells(actions, noise).reference
        gravity = planned + rng.normal(0.0, BY_HAND, planned.shape)
        gravity /= np.linalg.norm(gravity, axis=1)[:, None]
        axis_components = simulate_magnitude.path(rng, gravity, actions[0].duration_s) @ axes.T
        indication = (1.0 + k) * (axis_components + second * axis_components**2) + b + zero
        indication += rng.normal(0.0, noise, indication.shape)
        time_s = simulate_magnitude.INTERVAL_S * np.arange(float(len(indication)))
        by_axis = zip(forms.COMPONENTS, sign * indication.T, strict=True)
        logs[name] = {"time_s": time_s, **dict(by_axis)}
    # with M the inverse of the axes: k_i0 = M_ii/(1 + k_i), z_i0 = b_i k_i0, c_ij = -M_ij/M_jj
    M = np.linalg.inv(axes)
    scale, cross = np.diag(M) / (1.0 + k), -M / np.diag(M)
    truth = np.array([*scale, *(b * scale), cross[1, 0], cross[2, 0], cross[2, 1]])
    coefficients = dict(zip(asked_terms(spec).names, truth.tolist(), strict=True))
    return Campaign(logs, simulate_magnitude.DECIMALS, {"coefficients": {"triad": coefficients}})
