"""Campaigns of a triad: which attitudes at which temperatures, in which order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    forms,
    plan_magnitude,
    published,
    shared_errors,
    simulate as simulated,
)
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.fit import asked_terms, k_terms
from calibkit.instruments.accelerometer.numeric import k_factor
from calibkit.instruments.accelerometer.shared_errors import Circumstances
from calibkit.instruments.accelerometer.triad import residual_of
from calibkit.numeric import attitude, exchange
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.planning import pools
from calibkit.planning.assumptions import assume, read_sizes, seen_errors
from calibkit.planning.levels import list_usual_levels
from calibkit.planning.proposal import WITHHELD, Coefficient, Design, count, cover_range
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, split_variance
from calibkit.planning.simulation import as_planned, draw
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.fit.complex_step import Numbers
    from calibkit.fit.shared import Shared
    from calibkit.instruments.accelerometer.equation import Terms
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Action, Schedule
    from calibkit.simulate.campaign import Campaign

LOG = "positions.csv"
RESULTS = {"inclination": "deg", "toolface times sin(inclination)": "deg", "component": "g"}
RANGE_DEGC = (-20.0, 125.0)
MOST_SOAKS = 5
"""Temperatures that the search takes at most beyond what the order needs."""
COUNTS = (6, 8, 10, 12, 16, 20, 24, 30, 36, 42, 50)
"""Numbers of attitudes that the search takes."""
FEW = 24
"""Attitudes of a fixture below which the search takes some twice."""
ORDERED_BY = 12
"""Attitudes by which the order of the soaks is chosen."""
COUNTED = 16
"""Attitudes by which the time of a soak is reckoned before they are chosen."""
LEFT_OUT = 2
"""Attitudes that are withheld."""
STEPS_DEGC = (-20, -5, -1, 1, 5, 20)
"""Exchanges of a temperature."""
APART = 0.5
"""Least distance of two temperatures, of that of as many in even steps: so that the one beyond the
order shows a lack of fit.
"""
DECIMALS = 12
"""Of a direction, so that rounding leaves nothing of a right angle."""
USED_LEVELS = 9
"""Temperatures of use at which an uncertainty is predicted."""
CHAMBER_DEGC = 0.1
"""Standard deviation of the temperature that is reached about the set point."""
THERMOMETER_DEGC = 0.002
"""Standard deviation of a thermometer reading that is averaged over a dwell."""
EVERYWHERE = (
    (0, 0),
    *((tilt, roll) for tilt in range(30, 151, 30) for roll in range(0, 360, 45)),
    (180, 0),
)
"""Attitudes in which a triad is used, and those of the sample logs."""
_CORNERS = tuple((tilt, roll) for tilt in (54.7356, 125.2644) for roll in (45, 135, 225, 315))
_FACES = ((0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, 270))
_EDGES = (
    *((tilt, roll) for tilt in (45, 135) for roll in (0, 90, 180, 270)),
    *((90, roll) for roll in (45, 135, 225, 315)),
)
USUAL = {
    "6 faces, 9 temperatures": _FACES,
    "12 edges, 9 temperatures": _EDGES,
    "18 faces and edges, 9 temperatures": (*_FACES, *_EDGES),
    "26 faces, edges and corners, 9 temperatures": (*_FACES, *_EDGES, *_CORNERS),
    "42 attitudes of the sample logs, 9 temperatures": EVERYWHERE,
}
"""Usual sets of attitudes: directions to the faces, edges and corners of a cube."""


@dataclass(frozen=True, slots=True)
class Dwells:
    """Planned or measured dwells [n]."""

    spots: Array
    """Inclination and toolface [n, 2] [°]."""
    degc: Array
    soak: Integers
    """Number of the soak."""
    hours: Array
    """Time since the first dwell [h]; NaN where it is not known."""
    noise: Array
    """Standard deviation of the mean of a dwell [g]."""

    @property
    def gravity(self) -> Array:
        """Reference vectors [n, 3] [g]."""
        return np.round(attitude.gravity_vector(*self.spots.T), DECIMALS)

    def errors(self) -> list[Shared]:
        """Errors that the dwells share, as the fit lists them."""
        count = len(self.soak)
        one_log = np.zeros(count, dtype=np.int64)
        tilt, turn = np.radians(self.spots).T
        hours = self.hours if np.isfinite(self.hours).all() else None
        where = Circumstances(self.soak, hours, self.gravity, one_log, tilt, turn)
        return shared_errors.list_errors(where, np.broadcast_to(np.eye(3), (count, 3, 3)))

    def exact(self) -> DwellSet:
        """The dwells of a triad without an error."""
        none = np.full(len(self.soak), np.nan)
        unknown = np.full((len(none), 3), np.nan)
        tilt, turn = self.spots.T
        return DwellSet(self.gravity, self.degc, tilt, turn, unknown, none, self.soak, (), ())


@dataclass(frozen=True, slots=True)
class Soaks:
    """Soaks of a campaign in their order; each mounting has all of them."""

    degc: tuple[int, ...]
    middle_h: tuple[float, ...]
    """Middle of the dwells of each soak [h]."""
    mounting: Integers
    """[c], number of the mounting of each attitude."""

    def hold(self, spots: Array, noise: float) -> Dwells:
        """Dwells at attitudes [c, 2], all soaks of an attitude together."""
        attitudes, levels = len(spots), len(self.degc)
        _, mounting = np.unique(self.mounting, return_inverse=True)
        cycle = self.middle_h[-1] + 1.0
        return Dwells(
            np.repeat(spots, levels, axis=0),
            np.tile(np.array(self.degc, dtype=np.float64), attitudes),
            (np.arange(levels) + levels * mounting[:, None]).ravel(),
            (np.array(self.middle_h) + cycle * mounting[:, None]).ravel(),
            np.full(attitudes * levels, noise),
        )


@dataclass(frozen=True, slots=True)
class _Choice:
    """Soaks of a design in their order, its attitudes by number, and how long each is held."""

    degc: tuple[int, ...]
    chosen: tuple[int, ...]
    dwell_s: float


@dataclass(frozen=True)
class TriadBench(Bench):
    """Campaigns of a triad in known attitudes."""

    terms: Terms
    k: tuple[k_factor.KTerms, ...]
    """Terms of the K-factor, where that is what compensates."""
    fixture: str
    spots: Array
    """Inclination and toolface [c, 2] [°] of the fixture's attitudes."""
    mounting: Integers
    """[c]."""

    @property
    def rate(self) -> float:
        """Ramp between soaks [°C/min]."""
        return self.task.equipment.fastest(self.assumed.device)

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] [°C] mapped from the range of use to [-1, 1]."""
        low, high = self.assumed.range_degc
        return np.asarray((2.0 * degc - low - high) / max(high - low, 1.0))

    def state(self, dwells: Dwells) -> list[Shared]:
        """Errors of dwells with their sizes, without what the recipe makes a parameter."""
        affine = self.spec.affine
        parameter = shared_errors.SECOND_ORDER if affine.enabled and affine.second_order else ()
        listed = [one for one in dwells.errors() if (one.group, one.effect) != parameter]
        return self.assumed.state(listed)

    def residual(self, dwells: Dwells) -> Callable[[Numbers], Numbers]:
        """Residual of the fit, of dwells of a triad without an error."""
        return residual_of(dwells.exact(), self.terms, self.mapped(dwells.degc), lengths=False)

    def fit(self, dwells: Dwells) -> Fit:
        """What a fit will tell of the parameters, or of K."""
        noise = np.repeat(dwells.noise, 3)
        fit = predict(
            self.residual(dwells),
            self.terms.nominal,
            self.state(dwells),
            noise=noise,
            names=self.terms.names,
        )
        if not self.k:
            return fit
        form = published.corrections(self.k, dwells.gravity, self.mapped(dwells.degc))
        return fit.linear(published.pseudo_inverse(form, 1.0 / noise), dwells.gravity.ravel())

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, p] where it is used."""
        levels = np.linspace(*self.assumed.range_degc, USED_LEVELS)
        spots = np.tile(np.array(EVERYWHERE, dtype=np.float64), (USED_LEVELS, 1))
        gravity = attitude.gravity_vector(*spots.T)
        t = self.mapped(np.repeat(levels, len(EVERYWHERE)))
        if self.k:
            vector = published.corrections(self.k, gravity, t)
        else:
            vector = self.terms.slopes(self.terms.nominal, gravity, t)
        up, across = shared_errors.angle_slopes(*np.radians(spots).T)
        angles = [np.degrees(np.einsum("ni,nip->np", along, vector)) for along in (up, across)]
        return dict(zip(RESULTS, [*angles, vector.reshape(-1, vector.shape[2])], strict=True))

    def rows(self, design: Design) -> Dwells:
        """Dwells of what is measured already and of a design; logs have no time in common."""
        dwells: Dwells = super().rows(design)
        unknown = np.full(len(dwells.soak), np.nan)
        return replace(dwells, hours=unknown) if self.have and design.rows else dwells

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        return cover_range(self.rows(design).degc, self.order + 2, self.assumed.range_degc)

    @property
    def order(self) -> int:
        """Highest power of temperature of all models that the recipe fits."""
        k = [max(k.scale_order, k.zero_order) for k in k_terms(self.spec)]
        return int(max([self.terms.order, *(k if self.spec.k.enabled else ())]))

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result."""
        fit = self.fit(self.rows(design))
        return {name: split_variance(fit, slopes) for name, slopes in self.slopes.items()}

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """In powers of °C."""
        fit, (low, high) = self.fit(self.rows(design)), self.assumed.range_degc
        half = max(high - low, 1.0) / 2.0
        if not self.k:
            to_raw = np.asarray(self.terms.in_degrees((low + high) / 2.0, half), dtype=np.float64)
            u = fit.of(lambda p: to_raw @ p).u.tolist()
            for term, size in zip(self.terms.listed, u, strict=True):
                yield Coefficient("triad", term.name, term.unit, size)
            return
        for name, part, block in zip(
            forms.K_MODELS, self.k, published.blocks_of(self.k), strict=True
        ):
            places = list(part.fitted)
            to_raw = published.to_degrees((low + high) / 2.0, half)[np.ix_(places, places)]
            matrix = np.zeros((len(places), len(fit.parameters)))
            matrix[:, block] = to_raw
            u = fit.of(partial(np.matmul, matrix)).u.tolist()
            for place, size in zip(places, u, strict=True):
                yield Coefficient(name, k_factor.NAMES[place], forms.K_UNITS[place], size)

    def design(
        self, degc: Sequence[int], chosen: Sequence[int], dwell_s: float, label: str = ""
    ) -> Design:
        """Soaks at temperatures in their order, attitudes by number; where nothing is withheld yet,
        with those that lie farthest from them in a log that is.
        """
        equipment, device = self.task.equipment, self.assumed.device
        fixture, log = equipment.fixture(self.fixture), self.task.name_log(LOG)
        mountings = np.unique(self.mounting[list(chosen)])
        allowed = np.flatnonzero(np.isin(self.mounting, mountings))
        gravity = attitude.gravity_vector(*self.spots[allowed].T)
        taken = [int(np.searchsorted(allowed, k)) for k in chosen]
        left_out = 0 if self.task.withheld or label else LEFT_OUT
        withheld = allowed[pools.spread_apart(gravity, taken, left_out)].tolist()
        clock, fitted, soak = Clock(equipment), [], -1
        for number, mounting in enumerate(mountings.tolist()):
            if number:
                clock.remount(self.rate)
            recorded = [(k, log) for k in chosen if self.mounting[k] == mounting]
            recorded += [(k, f"{WITHHELD}{log}") for k in withheld if self.mounting[k] == mounting]
            for level in degc:
                soak += 1
                change = level - clock.degc
                clock.ramp(float(level), self.rate)
                clock.soak(equipment.soak_s(device, change, self.rate))
                for k, name in recorded:
                    if fixture.attended:
                        clock.attend(fixture.move_s + dwell_s)
                    clock.move(fixture.move_s)
                    clock.dwell(self.spots[k].tolist(), dwell_s, name)
                    if name == log:
                        fitted.append((k, level, soak, clock.now_s / 3600.0))
        spots, level_of, soaks, hours = (np.array(part) for part in zip(*fitted, strict=True))
        noise = np.full(len(spots), self.assumed.noise_of(dwell_s))
        dwells = Dwells(self.spots[spots], level_of.astype(np.float64), soaks, hours, noise)
        levels = count(len(set(degc)), "temperature")
        label = label or f"{len(chosen)} attitudes, {levels}, dwells of {dwell_s:g} s"
        how = _Choice(tuple(degc), tuple(chosen), dwell_s)
        settings = {"noise_g": float(noise[0])}
        # logs beside those that are measured are as these are
        changes = {} if self.task.have else {"dwells": {"mode": "rows"}}
        return Design(label, clock.schedule(), (log,), dwells, how, settings, changes)

    def soaks(self, degc: Sequence[int], mounting: Integers, number: int, dwell_s: float) -> Soaks:
        """Soaks in their order, with a number of dwells each."""
        equipment = self.task.equipment
        length_s = number * (equipment.fixture(self.fixture).move_s + dwell_s)
        now, middle = 0.0, [length_s / 2.0]
        for a, b in pairwise(degc):
            now += length_s + abs(b - a) / self.rate * 60.0
            now += equipment.soak_s(self.assumed.device, b - a, self.rate)
            middle.append(now + length_s / 2.0)
        return Soaks(tuple(degc), tuple(one / 3600.0 for one in middle), mounting)

    def jacobian(self, dwells: Dwells) -> Array:
        """Derivatives [3 n, p] of the residuals of dwells."""
        residual = self.residual(dwells)
        return derivative(lambda p: residual(p).ravel(), self.terms.nominal)

    @cached_property
    def base(self) -> Array:
        """Information [p, p] of what is measured already."""
        if self.have is None:
            return np.zeros((len(self.terms.listed),) * 2)
        noise = np.repeat(self.have.noise, 3)
        return pools.information(self.jacobian(self.have), self.state(self.have), noise)

    @cached_property
    def inclination(self) -> Array:
        """Derivatives [m, p] of the inclination by the parameters of the triad."""
        return replace(self, k=()).slopes["inclination"]

    def pool(self, spots: Array, soaks: Soaks, noise: float) -> exchange.Pool:
        """Candidates of a design: each attitude of spots [c, 2] held at all soaks; the criterion is
        the mean variance of the inclination.
        """
        dwells = soaks.hold(spots, noise)
        stated = [one for one in self.state(dwells) if one.size]
        single = [one for one in stated if (one.group, one.effect) == shared_errors.INDEX]
        common = [one for one in stated if one not in single]
        return pools.pool(
            *(self.jacobian(dwells), common, single, np.repeat(dwells.noise, 3), len(spots)),
            *(self.base, self.inclination),
        )

    def designs(self) -> Iterator[Design]:
        """Campaigns of all sizes, each the best of its size."""
        if self.have is not None:
            yield Design.nothing()
        order = self.order
        sizes = range(1 if self.have is not None else order + 2, order + 2 + MOST_SOAKS)
        groups = np.unique(self.mounting)
        choices = list(combinations(groups.tolist(), min(self.task.remountings + 1, len(groups))))
        rng = np.random.default_rng(self.task.seed)
        labels = [f"{levels} temperatures" for levels in sizes]
        for levels, _ in zip(sizes, self.task.progress(labels, "searching"), strict=True):
            for mountings in choices:
                allowed = np.flatnonzero(np.isin(self.mounting, mountings))
                yield from self.designs_at(levels, allowed, rng)

    def designs_at(
        self, levels: int, allowed: Integers, rng: np.random.Generator
    ) -> Iterator[Design]:
        """Campaigns with a number of temperatures, at the attitudes that are allowed."""
        shortest = min(self.assumed.device.dwell_s)
        degc = self.order_soaks(levels, allowed)
        spots, noise = self.spots[allowed], self.assumed.noise_of(shortest)
        soaks = self.soaks(degc, self.mounting[allowed], COUNTED, shortest)
        pool = self.pool(spots, soaks, noise)
        if not np.isfinite(pool.criterion(range(len(spots)))):
            return
        if len(spots) < FEW:
            pool = replace(pool, most=-(-FEW // len(spots)))
        counts = [n for n in COUNTS if n <= len(spots) * pool.most]
        for size in counts or [len(spots)]:
            chosen, _ = pool.search(size, rng, self.task.restarts)
            for dwell_s in self.assumed.device.dwell_s:
                yield self.design(degc, allowed[chosen].tolist(), dwell_s)

    def order_soaks(self, levels: int, allowed: Integers) -> tuple[int, ...]:
        """Temperatures of a campaign in their order, and back to the first: where the coefficients
        are best determined beside the drift of the session.
        """
        low, high = self.assumed.range_degc
        ends = int(np.ceil(low)), int(np.floor(high))
        if levels == 1:
            return (round((low + high) / 2.0),)
        gravity = attitude.gravity_vector(*self.spots[allowed].T)
        taken = allowed[pools.spread_apart(gravity, [0], ORDERED_BY - 1)]
        shortest = min(self.assumed.device.dwell_s)

        def criterion(order: Sequence[int]) -> float:
            degc = (*order, order[0])
            soaks = self.soaks(degc, self.mounting[taken], len(taken), shortest)
            pool = self.pool(self.spots[taken], soaks, self.assumed.noise_of(shortest))
            return pool.criterion(range(len(taken)))

        start = polynomial.space_levels(*ends, levels)
        # every second temperature on the way back, so that drift is separated from temperature
        order = [*start[::2], *start[1::2][::-1]]
        order, _ = exchange.exchange_values(order, partial(_moves, ends=ends), criterion)
        return (*order, order[0])

    def smaller(self, design: Design) -> Design | None:
        """A design with one attitude less."""
        choice: _Choice | None = design.how
        if choice is None or len(choice.chosen) <= COUNTS[0]:
            return None
        noise = self.assumed.noise_of(choice.dwell_s)
        soaks = self.soaks(choice.degc, self.mounting, len(choice.chosen), choice.dwell_s)
        pool = self.pool(self.spots, soaks, noise)
        fewer = [[*choice.chosen[:k], *choice.chosen[k + 1 :]] for k in range(len(choice.chosen))]
        chosen, _ = pool.exchange(min(fewer, key=pool.criterion))
        return self.design(choice.degc, sorted(chosen), choice.dwell_s)

    def usual(self) -> Iterator[Design]:
        """6, 12, 18 and 26 attitudes at nine temperatures, from low to high."""
        if self.fixture != "two-axis":
            return
        degc = list_usual_levels(self.assumed.range_degc)
        for name, spots in USUAL.items():
            mounting = np.zeros(len(spots), dtype=np.int64)
            table = replace(self, spots=np.array(spots, dtype=np.float64), mounting=mounting)
            every = range(len(spots))
            yield table.design(degc, every, min(self.assumed.device.dwell_s), label=name)


def _moves(order: Sequence[int], place: int, ends: tuple[int, int]) -> list[int]:
    """Whole temperatures that a place may have beside the others; the ends of the range stay."""
    if order[place] in ends:
        return []
    others = [degc for k, degc in enumerate(order) if k != place]
    apart = APART * (ends[1] - ends[0]) / len(others)
    tried = [order[place] + step for step in STEPS_DEGC]
    return [
        degc
        for degc in tried
        if ends[0] < degc < ends[1] and min(abs(degc - other) for other in others) >= apart
    ]


def prepare_plan(spec: AccelerometerRecipe, task: Task) -> Bench:
    """What the search needs; UsageError for what cannot be planned."""
    if spec.reference.kind == "magnitude":
        spots, _ = list_spots(task, "file" if task.spots else plan_magnitude.FIXTURE)
        return plan_magnitude.prepare(spec, task, spots)
    if spec.affine.tilt or spec.affine.fixture:
        raise UsageError(
            "a plan of a triad is one of its K-factor or its affine model against known attitudes",
            hint='use reference.kind = "attitude", compensation = "k" or "affine", and neither'
            " affine.tilt nor affine.fixture",
        )
    device = task.equipment.known_device(spec.procedure, "g")
    noise, earlier = device.noise, list[ErrorComponent]()
    notes: tuple[str, ...] = ()
    if task.earlier is not None:
        models = [
            model
            for record in task.earlier.values()
            for model in record.models
            if model.form in (forms.K.name, forms.AFFINE.name, forms.TRIAD.name)
        ]
        if not models:
            raise UsageError(
                "that run has neither K-factor nor affine model", hint="name a run of such a triad"
            )
        earlier = seen_errors(models)
        noise = rms([model.residual_rms for model in models])
        notes = (f"noise {1e6 * noise:.3g} µg and {len(earlier)} shared errors of that run",)
    assumed = assume(
        *(spec, task, device, shared_errors.UNITS),
        default_degc=RANGE_DEGC,
        # several logs have no drift in common
        passed_on=shared_errors.UNITS.keys() - ({shared_errors.DRIFT} if task.have else ()),
        earlier=earlier,
        noise=noise,
        notes=notes,
    )
    fixture = task.attitudes if task.attitudes in task.equipment.attitudes else "file"
    spots, mounting = list_spots(task, fixture)
    k = k_terms(spec) if spec.compensation == "k" else ()
    have = _measure(spec, task, noise)
    terms = asked_terms(spec)
    return TriadBench(spec, task, assumed, RESULTS, have, terms, k, fixture, spots, mounting)


def _measure(spec: AccelerometerRecipe, task: Task, noise: float) -> Dwells | None:
    """Dwells that are measured already."""
    if not task.have:
        return None
    dwells = triad_dwells.collect_dwells(task.have, spec)
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    timed = dwells.log.max() == 0 and bool(np.isfinite(dwells.time).all())
    hours = dwells.time / 3600.0 if timed else np.full(len(soak), np.nan)
    spots = np.column_stack([dwells.inclination, dwells.toolface])
    return Dwells(spots, dwells.temperature, soak, hours, np.full(len(soak), noise))


def list_spots(task: Task, fixture: str) -> tuple[Array, Integers]:
    """Attitudes [c, 2] [°] of a fixture, and the mounting of each [c]."""
    step = task.equipment.fixture(fixture).step_deg
    turns = range(0, 360, step)
    mountings = 1
    if fixture == "file":
        spots = [*task.spots]
    elif fixture == "faces":
        spots = [*_FACES]
    elif fixture in ("two-axis", "hand"):
        tilts = [(tilt, roll) for tilt in range(step, 180, step) for roll in turns]
        spots = [(0, 0), *tilts, (180, 0)]
    else:
        # along the head's axis; across it, in two planes that hold the tool's axis
        spots = [(90, roll) for roll in turns]
        for roll in (0, 90):
            spots += [(turn, roll) if turn <= 180 else (360 - turn, roll + 180) for turn in turns]
        mountings = 3
    mounting = np.repeat(np.arange(mountings), len(spots) // mountings)
    return np.array(spots, dtype=np.float64), mounting


def simulate_plan(
    spec: AccelerometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of a triad of physical sensors, with the errors that the plan assumes, and its truth."""
    if spec.reference.kind == "magnitude":
        return plan_magnitude.simulate(spec, schedule, document, seed)
    rng = np.random.default_rng(seed)
    sensors = simulated.draw_triad(rng)
    sizes = read_sizes(document, shared_errors.UNITS)
    sizes[shared_errors.SECOND_ORDER] = 0.0  # these sensors have errors of their own
    actions = schedule.recorded("dwell")
    dwells = planned_dwells(actions, document["settings"]["noise_g"])
    indicate = partial(simulated.indications, sensors)
    measured, drawn = simulate_dwells(rng, indicate, dwells, sizes)
    time = np.array([one.start_s + one.duration_s / 2.0 for one in actions])
    columns = {"time_s": time, **measured}
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    for axis in simulated.AXES:
        columns[f"accel_{axis}_g"] *= sign
    names = np.array([one.log for one in actions])
    logs = {
        log: {column: values[names == log] for column, values in columns.items()}
        for log in schedule.by_log()
    }
    truth = {"shared_errors": drawn, "sensors": simulated.describe(sensors)}
    return as_planned(document, seed, logs, simulated.DECIMALS, truth)


def planned_dwells(actions: Sequence[Action], noise: float) -> Dwells:
    """Dwells of a schedule, each with a noise [g] of its mean."""
    degc = np.array([one.set_degc for one in actions])
    return Dwells(
        np.array([(one.inclination_deg, one.toolface_deg) for one in actions]),
        degc,
        np.cumsum(np.diff(degc, prepend=degc[:1]) != 0.0),
        np.array([one.start_s + one.duration_s / 2.0 for one in actions]) / SECONDS_PER_HOUR,
        np.full(len(actions), noise),
    )


def simulate_dwells(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    dwells: Dwells,
    sizes: Mapping[tuple[str, str], float],
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Columns of dwells of a triad that indicates gravity [n, 3] [g] at temperatures [n] [°C], and
    the shared errors that were drawn, of sizes by (group, effect).

    Errors of the table and the fixture turn gravity before the sensors see it; those of the
    sensors are added to what they indicate.
    """
    shape = (len(dwells.soak), 3)
    of_gravity, of_sensors = np.zeros(shape), np.zeros(shape)
    drawn = {}
    for error, size in draw(rng, dwells.errors(), sizes):
        turned = of_gravity if error.unit == "rad" else of_sensors
        turned += error.along(size).reshape(shape)
        drawn[f"{error.effect} of the {error.group}"] = size.tolist()
    seen = dwells.gravity + of_gravity
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    case = dwells.degc + rng.normal(0.0, CHAMBER_DEGC, dwells.degc.size)[dwells.soak]
    indicated = indicate(seen, case) + of_sensors
    indicated += rng.normal(0.0, dwells.noise[:, None], shape)
    return {
        "temp_case_degc": case + rng.normal(0.0, THERMOMETER_DEGC, case.size),
        "inclination_deg": dwells.spots[:, 0],
        "toolface_deg": dwells.spots[:, 1],
        **{f"accel_{name}_g": indicated[:, i] for i, name in enumerate(simulated.AXES)},
    }, drawn
