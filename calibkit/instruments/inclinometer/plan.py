"""Campaigns of a four-position inclinometer: which stations at which temperatures, how long in each
position, and what s(T) will be known to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.forms import power_unit
from calibkit.instruments.inclinometer import mounting, simulate, solve, stations
from calibkit.instruments.inclinometer.forms import FILE
from calibkit.instruments.inclinometer.numeric import planned
from calibkit.instruments.inclinometer.numeric.planned import Roots, Sizes
from calibkit.instruments.inclinometer.numeric.root_choice import Limits
from calibkit.instruments.inclinometer.rows import Rows
from calibkit.numeric import earth
from calibkit.numeric.least_squares import polynomial
from calibkit.planning import recipe_text
from calibkit.planning.linear import (
    LEVELS,
    assume_errors,
    choose_some,
    known_sizes,
    list_levels,
    list_usual_levels,
    order_there_and_back,
    raw_uncertainties,
    read_components,
)
from calibkit.planning.proposal import (
    NOTHING,
    WITHHELD,
    Candidate,
    Coefficient,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    count,
    cover_range,
    find_front,
)
from calibkit.planning.schedule import Clock

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibkit.arrays import Array
    from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
    from calibkit.numeric.information import Information
    from calibkit.planning.equipment import Device
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

RANGE_DEGC = (20.0, 120.0)
FIXTURE = "north"
LOG = "stations.csv"
RESULTS = {"azimuth": "deg", "scale factor": "ppm"}
USED_DEG = (45.0, 90.0)
"""Inclination and azimuth at which the azimuth is judged: where s matters."""
PPM = 1e6
MORE_LEVELS = 3
"""Temperatures that the search takes at most beyond one more than the order needs."""
STATIONS = (1, 2, 3, 4, 6, 8, 12)
"""Stations at each temperature."""
LEFT_OUT = 4
"""Stations that are withheld."""


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: temperatures in their order, places of stations at each, time in a position."""

    degc: tuple[int, ...]
    chosen: tuple[int, ...]
    dwell_s: float

    @property
    def label(self) -> str:
        """The campaign in a few words."""
        if not self.degc:
            return NOTHING
        held = count(len(self.chosen), "station")
        places = count(len(self.degc), "soak")
        levels = count(len({*self.degc}), "temperature")
        return f"{held} at each of {places} at {levels}, {self.dwell_s:g} s in a position"


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    spec: InclinometerRecipe
    order: int
    range_degc: tuple[float, float]
    components: tuple[ErrorComponent, ...]
    sizes: Sizes
    places: Array
    """[n, 2], inclination and azimuth [°] that the fixture has."""
    have: Roots

    def predict(self, roots: Roots) -> tuple[Predicted, ...]:
        """Predicted uncertainty of s(T), and of the azimuth that it and a turn of the gyros, which
        the stations have to tell, leave.
        """
        middle, half = polynomial.middle_and_half(np.array(self.range_degc))
        used = np.linspace(*self.range_degc, LEVELS)
        powers = polynomial.powers(used, self.order, middle=middle, half=half)
        latitude, tilt, azimuth = np.radians([self.spec.site.latitude_deg, *USED_DEG])
        by_scale = float(np.degrees(np.tan(latitude) * np.tan(tilt) * np.sin(azimuth)))
        turned = np.column_stack([by_scale * powers, np.ones(LEVELS)])
        both = self.information(roots, turn=True)
        mounted = planned.size_of(self.sizes, planned.TURN) ** 2
        parts = both.variances(turned) | {"gyro turn of the mounting": np.full(LEVELS, mounted)}
        alone = self.information(roots).variances(PPM * powers)
        return (
            Predicted.of("azimuth", RESULTS["azimuth"], parts),
            Predicted.of("scale factor", RESULTS["scale factor"], alone),
        )

    def uncertainty(self, dwell_s: float) -> tuple[Array, Array]:
        """Standard uncertainty of the root at each place, and its derivative by a turn [1/°]."""
        tilt, azimuth = self.places.T
        attitudes = simulate.Attitudes(tilt, np.zeros_like(tilt), azimuth)
        site = self.spec.site.latitude_deg
        return planned.plan_stations(
            simulate.rotated(attitudes, np.array([0.0, 0.0, 1.0])),
            simulate.rotated(attitudes, earth.north_east_down(site)),
            self.device.noise * float(np.sqrt(self.device.noise_s / dwell_s)),
            site,
            Limits(**self.spec.limits.model_dump()),
            self.sizes,
        )

    def roots(self, design: _Design) -> Roots:
        """What is measured already, and the stations of a design."""
        if not design.degc:
            return self.have
        u, by_turn = self.uncertainty(design.dwell_s)
        chosen, soaks = list(design.chosen), len(design.degc)
        return self.have.join(
            Roots(
                np.repeat(np.array(design.degc, dtype=np.float64), len(chosen)),
                np.tile(u[chosen], soaks),
                np.tile(by_turn[chosen], soaks),
                np.zeros(soaks * len(chosen), dtype=np.int64),
            )
        )

    def information(self, roots: Roots, *, turn: bool = False) -> Information:
        """Information of stations."""
        return roots.information(self.order, self.range_degc, self.sizes, turn=turn)

    def schedule(self, design: _Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with stations of other attitudes at
        its second temperature that are.
        """
        equipment, clock = self.task.equipment, Clock(self.task.equipment)
        rate, name = equipment.fastest(self.device), self.task.name_log(LOG)
        for number, degc in enumerate(design.degc):
            change = degc - clock.degc
            clock.ramp(float(degc), rate)
            clock.soak(equipment.soak_s(self.device, change, rate))
            for place in design.chosen:
                self._hold(clock, place, design.dwell_s, name)
            if number == 1 and not self.task.withheld:
                for place in self.withheld(design):
                    self._hold(clock, place, design.dwell_s, f"{WITHHELD}{name}")
        return clock.schedule()

    def withheld(self, design: _Design) -> tuple[int, ...]:
        """Places that are withheld: the best of those that the design has not."""
        u, _ = self.uncertainty(design.dwell_s)
        rest = [k for k in np.argsort(u).tolist() if k not in design.chosen and np.isfinite(u[k])]
        return tuple(rest[:: max(len(rest) // LEFT_OUT, 1)][:LEFT_OUT])

    def _hold(self, clock: Clock, place: int, dwell_s: float, log: str) -> None:
        """One station: its four positions."""
        tilt, azimuth = self.places[place].tolist()
        for position in simulate.POSITIONS_DEG.tolist():
            clock.move(self.task.equipment.fixture(FIXTURE).move_s)
            clock.dwell((tilt, position, azimuth), dwell_s, log)

    def candidate(self, design: _Design) -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all, or has
        no temperature more than the order needs or none at an end of the range.
        """
        roots = self.roots(design)
        if not cover_range(roots.degc, self.order + 2, self.range_degc):
            return None
        if not self.information(roots, turn=True).determined:
            return None
        largest = {one.name: one.largest_u for one in self.predict(roots)}
        return Candidate(design.label, self.schedule(design).hours, largest, design)


def propose(spec: InclinometerRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    found = [one for one in map(bench.candidate, _list_designs(bench)) if one is not None]
    if not found:
        raise FitError(
            "no campaign determines s(T) over the range",
            hint="plan without --have, for a narrower --range, or for another [site] latitude_deg",
        )
    name = wishes[0].name if wishes else "azimuth"
    best = choose(found, wishes, task.within_h, name)
    design: _Design = best.design
    information = bench.information(bench.roots(design))
    # a single log shows no difference between logs
    own = set(spec.error_groups) - (set() if task.have else {planned.OF_LOG[0]})
    of_recipe = [one for one in bench.components if one.group in own]
    return Proposal(
        best.label,
        bench.schedule(design),
        bench.predict(bench.roots(design)),
        tuple(_list_coefficients(bench, information)),
        bench.range_degc,
        recipe_text.write_recipe(
            spec,
            [task.name_log(LOG)] if design.degc else [],
            of_recipe,
            {},
            added=bool(task.have),
        ),
        bench.device.noise,
        bench.device.noise_unit,
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else tuple(_list_usual(bench)),
        task.describe_range(RANGE_DEGC),
        {"noise_dph": bench.device.noise * (bench.device.noise_s / max(design.dwell_s, 1.0)) ** 0.5}
        | {"order": bench.order, "latitude_deg": spec.site.latitude_deg},
    ), wishes


def judge(spec: InclinometerRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the stations that are measured tell; empty where they do not determine all."""
    bench = _prepare(spec, task)
    found = bench.information(bench.have, turn=True)
    return bench.predict(bench.have) if found.determined else ()


def _prepare(spec: InclinometerRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure, "deg/h")
    low, high = task.range_degc or RANGE_DEGC
    task.equipment.require_reached(low, high)
    earlier = () if task.earlier is None else read_components(task.earlier, FILE, spec.procedure)
    stated = assume_errors(spec, device, earlier, planned.UNITS)
    sizes = known_sizes(stated.values(), planned.UNITS)
    order = device.order if spec.scale.order == "auto" else spec.scale.order
    step = task.equipment.fixture(FIXTURE).step_deg
    tilts, azimuths = np.arange(step, 90, step), np.arange(0, 360, step)
    places = np.array([(tilt, azimuth) for tilt in tilts for azimuth in azimuths], dtype=np.float64)
    have = _measure(spec, task, sizes)
    components = tuple(stated.values())
    return _Bench(task, device, spec, order, (low, high), components, sizes, places, have)


def _measure(spec: InclinometerRecipe, task: Task, sizes: Sizes) -> Roots:
    """Roots of the stations of measured logs, of the sensor pair that tells less; FitError where no
    temperature is logged.
    """
    none = np.zeros(0)
    found = Roots(none, none, none, none.astype(np.int64))
    if not task.have:
        return found
    admitted, _ = stations.admit_logs(list(task.have), spec)
    seen = stations.solve_components(Rows.gather(admitted, spec.on_site()), spec)
    if not np.isfinite(seen.temperature).all():
        raise FitError(
            f"{task.have[0].file}: no case temperature, expected one to plan what is missing",
            hint="map it under [columns.temp_case_degc], or plan without --have",
        )
    pairs = []
    for axis in spec.axes:
        first = solve.solve_in_sequence(seen, spec, axis)
        used, turn = first.root_used, mounting.Circumstances.of(first, seen, spec, axis).turn
        u, by_turn = planned.own_uncertainty(
            seen.components[axis],
            spec.site.latitude_deg,
            first.root >= 0,
            first.s_root_uncertainty,
            sizes,
        )
        by_turn = by_turn if turn is not None else np.zeros_like(u)
        pairs.append(Roots(seen.temperature[used], u[used], by_turn[used], seen.log[used]))
    return min(pairs, key=lambda one: float(np.sum(one.u**-2.0)))


def _choose_places(bench: _Bench, dwell_s: float) -> Iterator[tuple[int, ...]]:
    """Places in the order in which each adds most to what those before it tell at one temperature:
    of s beside a turn of the gyro of known size, and of the azimuth with a turn that is measured.
    """
    u, by_turn = bench.uncertainty(dwell_s)
    able = np.flatnonzero(np.isfinite(u)).tolist()
    turn = planned.size_of(bench.sizes, planned.TURN)
    latitude, tilt, _ = np.radians([bench.spec.site.latitude_deg, *USED_DEG])
    of_azimuth = np.array([np.degrees(np.tan(latitude) * np.tan(tilt)), 1.0])
    for prior, wanted in ((turn**-2.0 if turn else 1.0, np.array([1.0, 0.0])), (1e-6, of_azimuth)):
        chosen: list[int] = []
        total = np.diag([1e-6, prior])
        for _ in range(min(max(STATIONS), len(able))):
            rest = [k for k in able if k not in chosen]
            rows = np.column_stack([np.ones(len(rest)), by_turn[rest]]) / u[rest, None]
            tried = total + rows[:, :, None] * rows[:, None, :]
            best = int(np.argmin(np.linalg.inv(tried) @ wanted @ wanted))
            chosen.append(rest[best])
            total = tried[best]
        yield tuple(chosen)


def _list_designs(bench: _Bench) -> Iterator[_Design]:
    """Campaigns of all sizes; beside what is measured, those of the temperatures that it lacks, and
    an empty one.
    """
    places = [
        (dwell_s, best)
        for dwell_s in bench.device.dwell_s
        for best in _choose_places(bench, dwell_s)
    ]
    seen: set[tuple[int, ...]] = set()
    if bench.have.u.size:
        yield _Design((), (), 0.0)
    for levels in list_levels(bench.task, bench.order, MORE_LEVELS, bench.range_degc):
        tour = order_there_and_back(levels)
        listed = [tour, *(choose_some(tour[:-1]) if bench.have.u.size else ())]
        for degc in listed:
            if degc not in seen:
                seen.add(degc)
                for dwell_s, best in places:
                    for number in STATIONS:
                        if number <= len(best):
                            yield _Design(degc, best[:number], dwell_s)


def _list_coefficients(bench: _Bench, information: Information) -> Iterator[Coefficient]:
    """Predicted standard uncertainties in powers of °C."""
    for axis in bench.spec.axes:
        for k, u in enumerate(raw_uncertainties(information, bench.order, bench.range_degc)):
            yield Coefficient(axis, f"s{k}", power_unit("1", "degC", k), u)


def _list_usual(bench: _Bench) -> Iterator[Candidate]:
    """The usual campaign: at each of nine temperatures, from low to high, stations to the north,
    east, south and west at one inclination near 30°, a minute in a position.
    """
    degc = list_usual_levels(bench.range_degc)
    u, _ = bench.uncertainty(60.0)
    tilt, azimuth = bench.places.T
    near = tilt[np.argmin(np.abs(tilt - 30.0))]
    spread = np.flatnonzero((tilt == near) & (azimuth % 90.0 == 0.0) & np.isfinite(u)).tolist()
    found = bench.candidate(_Design(degc, tuple(spread), 60.0)) if spread else None
    if found is not None:
        yield found
