"""Campaigns of a triad: which attitudes at which temperatures, in which order; where attitudes are
unknown, how many positions by hand, how long each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    forms,
    published,
    shared_errors,
    simulate as simulated,
    simulate_magnitude,
)
from calibkit.instruments.accelerometer.coefficient_files import COMPENSATIONS
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.fit import asked_terms
from calibkit.instruments.accelerometer.numeric import k_factor, q_factor
from calibkit.instruments.accelerometer.triad import residual_of
from calibkit.numeric import attitude, exchange
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.planning import pools
from calibkit.planning.assumptions import assume, read_earlier, read_sizes, seen_errors
from calibkit.planning.levels import cover_range, list_usual_levels, order_there_and_back
from calibkit.planning.proposal import WITHHELD, Coefficient, Design, count
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.fit.shared import Residual, Shared
    from calibkit.instruments.accelerometer.equation import Terms
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe, KAxisSpec
    from calibkit.planning.levels import Tour
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Action, Schedule
    from calibkit.recipe.tables import ErrorComponent

LOG, TUMBLE = "positions.csv", "tumble.csv"
RESULTS = {"inclination": "deg", "toolface times sin(inclination)": "deg", "component": "g"}
OF_LENGTHS = {"component": "g", "axis angle": "deg"}
"""Results where attitudes are unknown."""
MAGNITUDE, HAND = "accelerometer_magnitude", "hand"
"""Device and fixture where attitudes are unknown."""
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
POSITIONS, FURTHER = (12, 15, 18, 24, 30, 40), (3, 6, 9, 12, 18)
"""Numbers of positions by hand that the search takes, and that are added to what is measured."""
LEFT_OUT, LEFT_BY_HAND = 2, 6
"""Attitudes that are withheld, and positions by hand."""
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
BY_HAND = 0.04
"""Standard deviation [1] of a direction that a hand reaches."""
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
USUAL_POSITIONS = 24
"""Positions by hand of the usual campaign."""
LENGTH_UNITS = {
    name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
}
"""(group, effect) of the errors that lengths of gravity at one temperature share."""


def exact_dwells(spots: Array, degc: Array, time_s: Array, noise: float) -> DwellSet:
    """Dwells [n] of a triad without an error in one log, at inclinations and toolfaces [n, 2] [°],
    each with a noise [g] of its mean.
    """
    number, (tilt, roll) = len(spots), spots.T
    gravity = np.round(attitude.gravity_vector(tilt, roll), DECIMALS)
    one_log = np.zeros(number, dtype=np.int64)
    noise_of = np.full((number, 3), noise)
    return DwellSet(gravity, degc, tilt, roll, noise_of, time_s, one_log, (), ())


@dataclass(frozen=True)
class TriadBench(Bench):
    """Campaigns of a triad in known attitudes."""

    terms: Terms
    k: tuple[KAxisSpec, ...]
    """Terms of the K-factor, where that is what compensates."""
    fixture: str
    spots: Array
    """Inclination and toolface [c, 2] [°] of the fixture's attitudes."""
    mounting: Integers
    """[c]."""

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of attitudes that the search takes."""
        return COUNTS

    @property
    def lengths(self) -> bool:
        """Whether the fit knows the length of gravity alone."""
        return bool(self.spec.reference.kind == "magnitude")

    def state(self, dwells: DwellSet) -> list[Shared]:
        """Errors that a fit of the dwells has, with the sizes that are assumed; of lengths those
        whose sizes are stated.
        """
        gravity = dwells.indication
        along = (
            gravity[:, None] if self.lengths else np.broadcast_to(np.eye(3), (len(gravity), 3, 3))
        )
        # what is assumed these dwells need not have, as what earlier runs had
        known = {"component": self.assumed.components, "source": "history", "groups": "auto"}
        errors = self.spec.errors.model_copy(update=known)
        where = shared_errors.find_circumstances(dwells, gravity, self.spec)
        listed = shared_errors.state_errors(
            where, along, self.spec.model_copy(update={"errors": errors})
        )
        return [one for one in listed if one.size is not None or not self.lengths]

    def residual(self, dwells: DwellSet) -> Residual:
        """Residual of the fit."""
        t = self.assumed.mapped(dwells.temperature)
        return residual_of(dwells, self.terms, t, lengths=self.lengths)

    def noise_of(self, dwell_s: float) -> float:
        """Noise [g] of the mean of a dwell."""
        return self.assumed.noise_of(dwell_s)

    def noise(self, dwells: DwellSet) -> Array:
        """Standard deviation of each residual [g]."""
        if self.lengths:
            return np.asarray(np.sqrt(np.mean(dwells.noise**2, axis=1)))
        return dwells.noise.ravel()

    def fit(self, rows: DwellSet) -> Fit:
        """What a fit will tell of the parameters, or of K."""
        noise, nominal = self.noise(rows), self.terms.nominal
        shared = self.state(rows)
        fit = predict(self.residual(rows), nominal, shared, noise=noise, names=self.terms.names)
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

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        return cover_range(self.rows(design).temperature, self.order + 2, self.assumed.range_degc)

    @property
    def order(self) -> int:
        """Highest power of temperature of all models that the recipe fits."""
        k = [max(k.scale_order, k.zero_order) for k in self.spec.k.axes]
        return int(max([self.terms.order, *(k if self.spec.k.enabled else ())]))

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """In powers of °C."""
        fit, (low, high) = self.fit(self.rows(design)), self.assumed.range_degc
        middle_half = (low + high) / 2.0, max(high - low, 1.0) / 2.0
        if not self.k:
            to_raw = np.asarray(self.terms.in_degrees(*middle_half), dtype=np.float64)
            u = fit.of(lambda p: to_raw @ p).u.tolist()
            for term, size in zip(self.terms.listed, u, strict=True):
                yield Coefficient("triad", term.name, term.unit, size)
            return
        to_raw = np.asarray(published.to_degrees(*middle_half), dtype=np.float64)
        blocks = published.blocks_of(self.k)
        for name, part, block in zip(forms.K_MODELS, self.k, blocks, strict=True):
            places = list(part.fitted)
            matrix = np.zeros((len(places), len(fit.parameters)))
            matrix[:, block] = to_raw[np.ix_(places, places)]
            u = fit.of(partial(np.matmul, matrix)).u.tolist()
            for place, size in zip(places, u, strict=True):
                yield Coefficient(name, k_factor.NAMES[place], forms.K_UNITS[place], size)

    def passed_on(self, design: Design) -> list[ErrorComponent]:
        """Errors that a fit of these dwells has; several logs have no drift in common."""
        listed = {(one.group, one.effect) for one in self.state(self.rows(design))}
        return [one for one in self.assumed.components if (one.group, one.effect) in listed]

    def apart(self, chosen: Sequence[int], allowed: Integers, number: int) -> list[int]:
        """Attitudes by number that lie farthest from those that are chosen, of those that are
        allowed.
        """
        gravity = attitude.gravity_vector(*self.spots[allowed].T)
        taken = [int(np.searchsorted(allowed, k)) for k in chosen]
        return [int(k) for k in allowed[pools.spread_apart(gravity, taken, number)]]

    def design(
        self, degc: Sequence[float], chosen: Sequence[int], dwell_s: float, label: str = ""
    ) -> Design:
        """Soaks at temperatures in their order, attitudes by number; where nothing is withheld yet,
        with those that lie farthest from them in a log that is.
        """
        equipment, log = self.task.equipment, self.task.name_log(TUMBLE if self.lengths else LOG)
        fixture, clock = equipment.fixture(self.fixture), Clock(equipment)
        mountings = np.unique(self.mounting[list(chosen)])
        allowed = np.flatnonzero(np.isin(self.mounting, mountings))
        number = LEFT_BY_HAND if self.lengths else LEFT_OUT
        withheld = [] if self.task.withheld else self.apart(chosen, allowed, number)
        recorded = [(k, log) for k in chosen] + [(k, f"{WITHHELD}{log}") for k in withheld]
        for mounting in mountings.tolist():
            if clock.now_s:
                clock.remount(equipment.fastest(self.assumed.device))
            for level in degc:
                if not self.lengths:
                    clock.settle(self.assumed.device, level)
                for k, name in recorded:
                    if self.mounting[k] == mounting:
                        if fixture.attended:
                            clock.attend(fixture.move_s + dwell_s)
                        clock.move(fixture.move_s)
                        clock.dwell(self.spots[k].tolist(), dwell_s, name)
        schedule, noise = clock.schedule(), self.noise_of(dwell_s)
        fitted = [one for one in schedule.recorded("dwell") if one.log == log]
        levels = count(len(set(degc)), "temperature")
        usual = f"{len(chosen)} attitudes, {levels}, dwells of {dwell_s:g} s"
        if self.lengths:
            usual = f"{len(chosen)} positions of {dwell_s:g} s"
        return Design(
            label or usual,
            schedule,
            (log,),
            planned_dwells(fitted, noise),
            {"noise_g": noise, "dwell_s": dwell_s, "noise_1s": self.assumed.noise_of(1.0)},
            # logs beside those that are measured are as these are
            {} if self.task.have or self.lengths else {"dwells": {"mode": "rows"}},
            (tuple(degc), tuple(chosen), dwell_s),
        )

    def held_everywhere(
        self, attitudes: Integers, degc: Sequence[int], number: int, dwell_s: float
    ) -> tuple[DwellSet, Integers]:
        """Each of some attitudes at all soaks, in the middle of soaks that are as long as a number
        of dwells; each mounting has all soaks. With the place of the attitude of each dwell.
        """
        equipment, clock, middle_s = self.task.equipment, Clock(self.task.equipment), []
        clock.degc = degc[0]
        length_s = number * (equipment.fixture(self.fixture).move_s + dwell_s)
        for level in degc:
            clock.settle(self.assumed.device, level)
            middle_s.append(clock.now_s + length_s / 2.0)
            clock.move(length_s)
        cycle_s = middle_s[-1] + SECONDS_PER_HOUR
        time_s = (np.array(middle_s) + cycle_s * self.mounting[attitudes][:, None]).ravel()
        order = np.argsort(time_s, kind="stable")
        place = np.repeat(np.arange(len(attitudes)), len(degc))[order]
        held_degc = np.tile(np.array(degc, dtype=np.float64), len(attitudes))[order]
        spots, noise = self.spots[attitudes][place], self.noise_of(dwell_s)
        return exact_dwells(spots, held_degc, time_s[order], noise), place

    def jacobian(self, dwells: DwellSet) -> Array:
        """Derivatives [n, p] of the residuals of dwells."""
        residual = self.residual(dwells)
        return derivative(lambda p: residual(p).ravel(), self.terms.nominal)

    @cached_property
    def base(self) -> Array:
        """Information [p, p] of what is measured already."""
        if self.have is None:
            return np.zeros((len(self.terms.listed),) * 2)
        noise = self.noise(self.have)
        return pools.information(self.jacobian(self.have), self.state(self.have), noise)

    @cached_property
    def sought(self) -> Array:
        """Derivatives [m, p] by the parameters of the triad of what the search lowers."""
        return replace(self, k=()).slopes["inclination"]

    def pool(
        self, attitudes: Integers, degc: Sequence[int], number: int, dwell_s: float
    ) -> exchange.Pool:
        """Candidates of a design: each attitude held at all soaks; the criterion is the mean
        variance of what is sought.
        """
        dwells, place = self.held_everywhere(attitudes, degc, number, dwell_s)
        stated = [one for one in self.state(dwells) if one.size]
        single = [one for one in stated if (one.group, one.effect) == shared_errors.INDEX]
        common = [one for one in stated if one not in single]
        return pools.pool(
            *(self.jacobian(dwells), common, single, self.noise(dwells)),
            *(np.repeat(place, 1 if self.lengths else 3), self.base, self.sought),
        )

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Campaigns of all numbers of temperatures, each the best of its size."""
        fewest = 1 if self.task.have else self.order + 2
        rng = np.random.default_rng(self.task.seed)
        return {
            f"{levels} temperatures": self.designs(levels, rng)
            for levels in range(fewest, self.order + 2 + MOST_SOAKS)
        }

    def designs(self, levels: int, rng: np.random.Generator) -> Iterator[Design]:
        """Campaigns with a number of temperatures, on as many mountings as may be."""
        lengths, mountings = self.assumed.device.dwell_s, np.unique(self.mounting).tolist()
        for chosen in combinations(mountings, min(self.task.remountings + 1, len(mountings))):
            allowed = np.flatnonzero(np.isin(self.mounting, chosen))
            degc = self.order_soaks(levels, allowed)
            pool = self.pool(allowed, degc, COUNTED, min(lengths))
            if not np.isfinite(pool.criterion(range(len(allowed)))):
                continue
            if len(allowed) < FEW:
                pool = replace(pool, most=-(-FEW // len(allowed)))
            counts = [n for n in self.counts if n <= len(allowed) * pool.most]
            for size in counts or [len(allowed)]:
                attitudes, _ = pool.search(size, rng, self.task.restarts)
                for dwell_s in lengths:
                    yield self.design(degc, allowed[attitudes].tolist(), dwell_s)

    def order_soaks(self, levels: int, allowed: Integers) -> Tour:
        """Temperatures of a campaign in their order, and back to the first: where the coefficients
        are best determined beside the drift of the session.
        """
        low, high = self.assumed.range_degc
        ends = int(np.ceil(low)), int(np.floor(high))
        if levels == 1:
            return (round((low + high) / 2.0),)
        few = np.array([allowed[0], *self.apart(allowed[:1].tolist(), allowed, ORDERED_BY - 1)])
        shortest = min(self.assumed.device.dwell_s)

        def criterion(order: Sequence[int]) -> float:
            pool = self.pool(few, (*order, order[0]), len(few), shortest)
            return pool.criterion(range(len(few)))

        start = order_there_and_back(polynomial.space_levels(*ends, levels))[:-1]
        order, _ = exchange.exchange_values(start, partial(_moves, ends=ends), criterion)
        return (*order, order[0])

    def smaller(self, design: Design) -> Design | None:
        """A design with one attitude less."""
        degc, chosen, dwell_s = design.choice or ((), (), 0.0)
        if len(chosen) <= self.counts[0]:
            return None
        pool = self.pool(np.arange(len(self.spots)), degc, len(chosen), dwell_s)
        fewer = [[*chosen[:k], *chosen[k + 1 :]] for k in range(len(chosen))]
        best, _ = pool.exchange(min(fewer, key=pool.criterion))
        return self.design(degc, sorted(best), dwell_s)

    def usual(self) -> Iterator[Design]:
        """6, 12, 18, 26 and 42 attitudes at nine temperatures, from low to high."""
        if self.fixture != "two-axis":
            return
        degc = list_usual_levels(self.assumed.range_degc)
        for name, spots in USUAL.items():
            mounting = np.zeros(len(spots), dtype=np.int64)
            task = replace(self.task, withheld=True)
            table = replace(
                self, task=task, spots=np.array(spots, dtype=np.float64), mounting=mounting
            )
            yield table.design(degc, range(len(spots)), min(self.assumed.device.dwell_s), name)


@dataclass(frozen=True)
class LengthBench(TriadBench):
    """Campaigns of a triad that is turned by hand at one temperature, in attitudes that its fit
    does not know.
    """

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

    @cached_property
    def sought(self) -> Array:
        """Derivatives [m, 9] of corrected components."""
        return self.slopes["component"]

    def covers(self, design: Design) -> bool:  # noqa: ARG002 (as every bench's)
        """At one temperature there is no range."""
        return True

    def noise_of(self, dwell_s: float) -> float:
        """Noise [g] of the mean of a position, of which a fit leaves out both ends."""
        return self.assumed.noise_of(dwell_s - self.spec.dwells.window_s)

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of positions that the search takes."""
        return FURTHER if self.task.have else POSITIONS

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Campaigns of all numbers of positions, each the best of its number."""
        return {"positions": self.designs(1, np.random.default_rng(self.task.seed))}

    def usual(self) -> Iterator[Design]:
        """Positions spread over the sphere, as short as they may be."""
        spread = [0, *self.apart([0], np.arange(len(self.spots)), USUAL_POSITIONS - 1)]
        shortest = min(self.assumed.device.dwell_s)
        label = f"usual: {USUAL_POSITIONS} positions of {shortest:g} s"
        yield self.design(self.assumed.range_degc[:1], spread, shortest, label)


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


def prepare_plan(spec: AccelerometerRecipe, task: Task) -> TriadBench:
    """What the search needs; UsageError for what cannot be planned."""
    if spec.reference.kind == "magnitude":
        return _prepare_lengths(spec, task)
    if spec.affine.tilt or spec.affine.fixture:
        raise UsageError(
            "a plan of a triad is one of its K-factor or its affine model against known attitudes",
            hint='use reference.kind = "attitude", compensation = "k" or "affine", and neither'
            " affine.tilt nor affine.fixture",
        )
    device = task.equipment.known_device(spec.procedure, "g")
    files = (f"{stage}.json" for stage in COMPENSATIONS.values())
    records = read_earlier(task, spec.procedure, *files)
    scatter = [model.residual_rms for record in records for model in record.models]
    assumed = assume(
        *(spec, task, device, shared_errors.UNITS),
        default_degc=RANGE_DEGC,
        earlier=seen_errors(records),
        noise=rms(scatter) if scatter else None,
    )
    fixture = task.attitudes if task.attitudes in task.equipment.attitudes else "file"
    k = spec.k.axes if spec.compensation == "k" else ()
    have = None
    if task.have:
        have = triad_dwells.collect_dwells(task.have, spec)
        noise = np.full_like(have.noise, assumed.noise)
        have = replace(have, indication=np.round(have.reference, DECIMALS), noise=noise)
    terms, places = asked_terms(spec), list_spots(task, fixture)
    return TriadBench(spec, task, assumed, RESULTS, have, terms, k, fixture, *places)


def _prepare_lengths(spec: AccelerometerRecipe, task: Task) -> LengthBench:
    """What the search needs where attitudes are unknown."""
    device = task.equipment.known_device(MAGNITUDE, "g")
    if spec.affine.enabled or spec.dwells.mode != "series":
        raise UsageError(
            "a plan of unknown attitudes is for one temperature, and for a continuous log",
            hint='use affine.enabled = false and dwells.mode = "series"',
        )
    if task.attitudes in ("faces", "dividing-head"):
        raise UsageError(
            f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
            hint="leave it out, or name a file of attitudes",
        )
    assumed = assume(spec, task, device, LENGTH_UNITS)
    shortest = spec.dwells.window_s + spec.dwells.shortest_s
    if min(device.dwell_s) < shortest:
        raise UsageError(
            f"dwell_s of [device.{MAGNITUDE}] has {min(device.dwell_s):g} s, expected at least"
            f" {shortest:g} s: dwells.window_s and dwells.shortest_s",
            hint="state longer positions, or shorter ones in [dwells]",
        )
    places = list_spots(task, "file" if task.spots else HAND)
    terms = asked_terms(spec)
    bench = LengthBench(spec, task, assumed, OF_LENGTHS, None, terms, (), HAND, *places)
    if not task.have:
        return bench
    dwells = triad_dwells.collect_dwells(task.have, spec)
    known = dwells.weights is not None
    noise = float(np.sqrt(np.mean(dwells.noise**2))) if known else device.noise
    unit = dwells.indication / np.linalg.norm(dwells.indication, axis=1)[:, None]
    have = replace(dwells, indication=unit, noise=np.full_like(unit, noise))
    return replace(bench, have=have)


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
    rng = np.random.default_rng(seed)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    if spec.reference.kind == "magnitude":
        return _simulate_lengths(spec, schedule, document, sign, rng)
    sensors = simulated.draw_triad(rng)
    sizes = read_sizes(document, shared_errors.UNITS)
    sizes[shared_errors.SECOND_ORDER] = 0.0  # these sensors have errors of their own
    actions = schedule.recorded("dwell")
    dwells = planned_dwells(actions, document["settings"]["noise_g"])
    indicate = partial(simulated.indications, sensors)
    measured, drawn = simulate_dwells(rng, indicate, dwells, spec, sizes)
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


def planned_dwells(actions: Sequence[Action], noise: float) -> DwellSet:
    """Dwells of a schedule, each with a noise [g] of its mean."""
    spots = np.array([(one.inclination_deg, one.toolface_deg) for one in actions])
    middle_s = np.array([one.start_s + one.duration_s / 2.0 for one in actions])
    return exact_dwells(spots, np.array([one.set_degc for one in actions]), middle_s, noise)


def simulate_dwells(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    sizes: Mapping[tuple[str, str], float],
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Columns of dwells of a triad that indicates gravity [n, 3] [g] at temperatures [n] [°C], and
    the shared errors that were drawn, of sizes by (group, effect).

    Errors of the table and the fixture turn gravity before the sensors see it; those of the
    sensors are added to what they indicate.
    """
    shape = dwells.indication.shape
    of_gravity, of_sensors = np.zeros(shape), np.zeros(shape)
    drawn, hours = {}, dwells.time / SECONDS_PER_HOUR
    # a zero drifts, whether a fit of one soak can tell or not
    where = replace(shared_errors.find_circumstances(dwells, dwells.indication, spec), hours=hours)
    for error in shared_errors.list_errors(where, np.broadcast_to(np.eye(3), (*shape, 3))):
        size = rng.normal(0.0, 1.0, (error.levels, error.width))
        size *= sizes.get((error.group, error.effect), 0.0)
        turned = of_gravity if error.unit == "rad" else of_sensors
        turned += error.along(size).reshape(shape)
        drawn[f"{error.effect} of the {error.group}"] = size.tolist()
    seen = dwells.indication + of_gravity
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    case = dwells.temperature + rng.normal(0.0, CHAMBER_DEGC, len(where.soak))[where.soak]
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
    document: Mapping[str, Any],
    sign: float,
    rng: np.random.Generator,
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    settings = document["settings"]
    size = read_sizes(document, LENGTH_UNITS)
    k, b, q = (rng.normal(0.0, typical, 3) for typical in simulate_magnitude.SIZES)
    axes = q_factor.axes_from_angles(q)
    second = rng.normal(0.0, size[shared_errors.SECOND_ORDER], 3)
    zero = rng.normal(0.0, size[shared_errors.ZERO], 3)
    noise = settings["noise_1s"] / np.sqrt(simulate_magnitude.INTERVAL_S)
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        spots = np.array([(one.inclination_deg, one.toolface_deg) for one in actions])
        gravity = attitude.gravity_vector(*spots.T) + rng.normal(0.0, BY_HAND, (len(actions), 3))
        gravity /= np.linalg.norm(gravity, axis=1)[:, None]
        along = simulate_magnitude.path(rng, gravity, settings["dwell_s"]) @ axes.T
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
