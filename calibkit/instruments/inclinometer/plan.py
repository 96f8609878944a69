"""Campaigns of a four-position inclinometer: which stations at which temperatures, how long in each
position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import Prior
from calibkit.fit.solve import Fit, predict
from calibkit.forms import power_unit
from calibkit.instruments.inclinometer import (
    mounting,
    scale_fit,
    simulate as simulated,
    solve,
    stations,
)
from calibkit.instruments.inclinometer.forms import FILE, MOUNTING
from calibkit.instruments.inclinometer.published import Components
from calibkit.instruments.inclinometer.root_choice import estimate_roots
from calibkit.instruments.inclinometer.rows import Rows
from calibkit.instruments.inclinometer.scale_fit import Roots
from calibkit.numeric import earth
from calibkit.planning.assumptions import Assumed, assume, read_earlier, read_sizes, seen_errors
from calibkit.planning.levels import (
    LEVELS,
    Tour,
    choose_some,
    cover_range,
    list_tours,
    list_usual_levels,
    order_there_and_back,
    raw_uncertainties,
)
from calibkit.planning.proposal import WITHHELD, Coefficient, Design, count
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, split_variance
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers, Mask
    from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
    from calibkit.planning.proposal import Task
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
USUAL_DEG, USUAL_S = 30.0, 60.0
"""Inclination and time in a position of the usual campaign."""
NO_TURN_DEG = 1e-9
"""Size of a turn of the gyro where none is assumed."""
WALK, ACCEL = ("reading", "bias walk"), ("reading", "accelerometer noise")
INDEX, SCATTER = ("position", "index"), ("station", "scale")
TURN, OF_LOG = ("mounting", "gyro turn"), ("log", "scale")
UNITS = {WALK: "deg/h", ACCEL: "g", INDEX: "deg", SCATTER: "1", TURN: "deg", OF_LOG: "1"}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""
OF_TURN = "gyro turn of the mounting"
SIZES = (3e-3, 3e-5, 1e-7, 1e-9)
"""Standard deviations of the simulated coefficients of s(T) about 1, in powers of °C."""
BIAS = (1e-3, 0.3)
"""Standard deviations of the biases of a simulated accelerometer [g] and gyro [°/h]."""
REACHED_DEGC = 0.1
"""Standard deviation of the temperature that is reached."""


@dataclass(frozen=True)
class StationBench(Bench):
    """Campaigns of an inclinometer."""

    order: int
    places: Array
    """[n, 2], inclination and azimuth [°] that the fixture has."""

    @cached_property
    def known(self) -> dict[float, tuple[Array, Array]]:
        """Time in a position [s] → standard uncertainty of the root at each place without scatter,
        infinite where a fit would not use it, and its derivative by a turn [1/°].
        """
        times = {USUAL_S, *self.assumed.device.dwell_s}
        return {dwell_s: _plan_stations(self, dwell_s) for dwell_s in times}

    def fit(self, rows: Roots, *, turn_known: bool = True) -> Fit:
        """What the roots will tell of s(T), of a gyro whose turn has a known size, or is
        measured.
        """
        of_log = mounting.scale_of_logs(rows.log)
        shared = self.assumed.state([*scale_fit.shared_errors(rows, None), of_log])
        size = max(self.assumed.size(*TURN), NO_TURN_DEG)
        turn = Prior(name=OF_TURN, block=slice(-1, None), size=size)
        return predict(
            partial(scale_fit.residual, roots=rows),
            np.eye(self.order + 2)[0],
            shared,
            priors=[turn] if turn_known else [],
            noise=rows.u,
            names=[*(f"s{k}" for k in range(self.order + 1)), "turn"],
        )

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        low, high = self.assumed.range_degc
        degc = low + (self.rows(design).x + 1.0) / 2.0 * (high - low)
        return cover_range(degc, self.order + 2, (low, high))

    def variances(self, design: Design) -> dict[str, Sources]:
        """Variance of s(T), and of the azimuth that it and a turn of the gyros, which the stations
        have to tell, leave.
        """
        roots = self.rows(design)
        used = self.assumed.mapped(np.linspace(*self.assumed.range_degc, LEVELS))
        latitude, tilt, azimuth = np.radians([self.spec.site.latitude_deg, *USED_DEG])
        by_scale = float(np.degrees(np.tan(latitude) * np.tan(tilt) * np.sin(azimuth)))
        by_s = derivative(lambda p: scale_fit.scale(p, used), np.eye(self.order + 2)[0])
        by_turn = np.eye(self.order + 2)[-1]
        of_azimuth = split_variance(self.fit(roots, turn_known=False), by_scale * by_s + by_turn)
        mounted = {OF_TURN: np.full(LEVELS, self.assumed.size(*TURN) ** 2)}
        of_scale = split_variance(self.fit(roots), PPM * by_s, [OF_TURN])
        return {"azimuth": of_azimuth | mounted, "scale factor": of_scale}

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """Of s(T) in powers of °C."""
        covariance = self.fit(self.rows(design)).covariance[:-1, :-1]
        u = raw_uncertainties(covariance, self.assumed.range_degc)
        for axis, (k, size) in product(self.spec.axes, enumerate(u)):
            yield Coefficient(axis, f"s{k}", power_unit("1", "degC", k), size)

    def passed_on(self, design: Design) -> list[ErrorComponent]:
        """A single log shows no difference between logs."""
        several = len(self.task.have) + len(design.logs) > 1
        stated = super().passed_on(design)
        return [one for one in stated if several or (one.group, one.effect) != OF_LOG]

    def design(self, degc: Tour, places: Sequence[int], dwell_s: float) -> Design:
        """Stations at places, at each of the temperatures in their order; where nothing is withheld
        yet, with stations of other attitudes at the second temperature that are.
        """
        equipment, clock = self.task.equipment, Clock(self.task.equipment)
        log = self.task.name_log(LOG)
        u, by_turn = self.known[dwell_s]
        # the best of those that the design has not
        rest = [k for k in np.argsort(u).tolist() if k not in places and np.isfinite(u[k])]
        withheld = rest[:: max(len(rest) // LEFT_OUT, 1)][:LEFT_OUT]
        for number, level in enumerate(degc):
            clock.settle(self.assumed.device, level)
            recorded = [(place, log) for place in places]
            if number == 1 and not self.task.withheld:
                recorded += [(place, f"{WITHHELD}{log}") for place in withheld]
            for place, name in recorded:
                tilt, azimuth = self.places[place].tolist()
                for position in simulated.POSITIONS_DEG.tolist():
                    clock.move(equipment.fixture(FIXTURE).move_s)
                    clock.dwell((tilt, position, azimuth), dwell_s, name)
        label = (
            f"{count(len(places), 'station')} at each of {count(len(degc), 'soak')} at"
            f" {count(len({*degc}), 'temperature')}, {dwell_s:g} s in a position"
        )
        x = self.assumed.mapped(np.repeat(np.array(degc, dtype=np.float64), len(places)))
        one_log, chosen = np.zeros(len(x), dtype=np.int64), list(places)
        u, by_turn = (np.tile(of_place[chosen], len(degc)) for of_place in (u, by_turn))
        settings = {
            "noise_dph": self.assumed.noise_of(dwell_s),
            "order": self.order,
            "latitude_deg": self.spec.site.latitude_deg,
        }
        roots = Roots(np.ones(len(x)), u, x, by_turn, one_log)
        return Design(label, clock.schedule(), (log,), roots, settings)

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Campaigns of all numbers of temperatures; beside what is measured, also those of the
        temperatures that it lacks.
        """
        held = [
            (best[:number], dwell_s)
            for dwell_s in self.assumed.device.dwell_s
            for best in self.choose_places(dwell_s)
            for number in STATIONS
            if number <= len(best)
        ]

        def tours_of(levels: list[int]) -> Iterator[Tour]:
            yield (tour := order_there_and_back(levels))
            yield from choose_some(tour[:-1]) if self.task.have else ()

        sized = list_tours(self.order, MORE_LEVELS, self.assumed.range_degc, tours_of)
        return {
            size: (self.design(degc, *stations) for degc, stations in product(tours, held))
            for size, tours in sized.items()
        }

    def choose_places(self, dwell_s: float) -> Iterator[list[int]]:
        """Places in the order in which each adds most to what those before it tell at one
        temperature: of s beside a turn of the gyro of known size, and of the azimuth with a turn
        that is measured.
        """
        u, by_turn = self.known[dwell_s]
        u = np.hypot(u, self.assumed.size(*SCATTER))
        able = np.flatnonzero(np.isfinite(u)).tolist()
        turn = self.assumed.size(*TURN) or 1.0
        latitude, tilt, _ = np.radians([self.spec.site.latitude_deg, *USED_DEG])
        of_azimuth = np.array([np.degrees(np.tan(latitude) * np.tan(tilt)), 1.0])
        for prior, wanted in ((turn**-2.0, np.array([1.0, 0.0])), (1e-6, of_azimuth)):
            chosen: list[int] = []
            total = np.diag([1e-6, prior])
            for _ in range(min(max(STATIONS), len(able))):
                rest = [k for k in able if k not in chosen]
                rows = np.column_stack([np.ones(len(rest)), by_turn[rest]]) / u[rest, None]
                tried = total + rows[:, :, None] * rows[:, None, :]
                best = int(np.argmin(np.linalg.inv(tried) @ wanted @ wanted))
                chosen.append(rest[best])
                total = tried[best]
            yield chosen

    def usual(self) -> Iterator[Design]:
        """At each of nine temperatures, from low to high, stations to the north, east, south and
        west at one inclination, a minute in a position.
        """
        u, _ = self.known[USUAL_S]
        tilt, azimuth = self.places.T
        near = tilt[np.argmin(np.abs(tilt - USUAL_DEG))]
        spread = np.flatnonzero((tilt == near) & (azimuth % 90.0 == 0.0) & np.isfinite(u)).tolist()
        if spread:
            yield self.design(list_usual_levels(self.assumed.range_degc), spread, USUAL_S)


def prepare_plan(spec: InclinometerRecipe, task: Task) -> StationBench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure, "deg/h")
    earlier = seen_errors(read_earlier(task, spec.procedure, FILE))
    assumed = assume(spec, task, device, UNITS, default_degc=RANGE_DEGC, earlier=earlier)
    order = device.order if spec.scale.order == "auto" else spec.scale.order
    step = task.equipment.fixture(FIXTURE).step_deg
    places = [*product(np.arange(step, 90.0, step), np.arange(0.0, 360.0, step))]
    bench = StationBench(spec, task, assumed, RESULTS, None, order, np.array(places))
    return replace(bench, have=_measure(bench)) if task.have else bench


def _measure(bench: StationBench) -> Roots:
    """Roots of the stations of measured logs, of the sensor pair that tells less; FitError where no
    temperature is logged.
    """
    spec, logs = bench.spec, bench.task.have
    admitted, _ = stations.admit_logs(list(logs), spec)
    seen = stations.solve_components(Rows.gather(admitted, spec.on_site()), spec)
    if not np.isfinite(seen.temperature).all():
        raise FitError(
            f"{logs[0].file}: no case temperature, expected one to plan what is missing",
            hint="map it under [columns.temp_case_degc], or plan without --have",
        )
    pairs = []
    for axis in spec.axes:
        first = solve.solve_in_sequence(seen, spec, axis)
        used, shared = first.root_used, mounting.shared_errors(first, seen, spec, axis)
        u, by_turn = _with_index(
            *(seen.components[axis], spec.site.latitude_deg, first.root >= 0),
            *(first.s_root_uncertainty, bench.assumed),
        )
        by_turn = by_turn if MOUNTING in shared else np.zeros_like(u)
        x = bench.assumed.mapped(seen.temperature[used])
        pairs.append(Roots(np.ones(len(x)), u[used], x, by_turn[used], seen.log[used]))
    scatter = bench.assumed.size(*SCATTER)
    return min(pairs, key=lambda one: float(np.sum(1.0 / (one.u**2 + scatter**2))))


def _with_index(
    parts: Components, latitude_deg: float, plus: Mask, u_root: Array, assumed: Assumed
) -> tuple[Array, Array]:
    """Standard uncertainty of each root [n] with index errors, and its derivative by a turn of the
    gyro [1/°].
    """
    by_turn, by_index = mounting.slopes_of_roots(parts, latitude_deg, plus)
    return np.hypot(u_root, by_index * assumed.size(*INDEX)), by_turn


def _plan_stations(bench: StationBench, dwell_s: float) -> tuple[Array, Array]:
    """Standard uncertainty of the root of s = 1 at each place, infinite where a fit would not use
    it, and its derivative by a turn [1/°].
    """
    spec, assumed = bench.spec, bench.assumed
    latitude_deg = spec.site.latitude_deg
    tilt, azimuth = bench.places.T
    attitudes = simulated.Attitudes(tilt, np.zeros_like(tilt), azimuth)
    gravity = simulated.rotated(attitudes, np.array([0.0, 0.0, 1.0]))
    rate_dph = simulated.rotated(attitudes, earth.north_east_down(latitude_deg))
    # half differences of two positions; the bias walks over both steps between them
    gyro = (assumed.noise_of(dwell_s) ** 2 + assumed.size(*WALK) ** 2) / 2.0
    accel = assumed.size(*ACCEL) ** 2 / 2.0
    covariance = np.tile(np.diag([accel, accel, gyro, gyro]), (len(gravity), 1, 1))
    across = (gravity[:, 0], gravity[:, 1], rate_dph[:, 0], rate_dph[:, 1])
    parts = Components(*across, covariance)
    roots = estimate_roots(parts, latitude_deg, limits=spec.limits)
    column = np.argmin(np.abs(roots.s - 1.0), axis=1)
    rows = np.arange(column.size)
    used = roots.usable[rows, column] & ~(roots.s > 0.0).all(axis=1)
    used &= np.array([not reason for reason in roots.status])
    u_root = np.where(used, roots.uncertainty[rows, column], np.inf)
    u, by_turn = _with_index(parts, latitude_deg, column == 0, u_root, assumed)
    return u, np.where(used, by_turn, 0.0)


def simulate_plan(
    spec: InclinometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of the stations of a schedule, and the coefficients of s(T) of each gyro."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    size = read_sizes(document, UNITS)
    coefficients, turn_deg, biases = {}, {}, {}
    for axis in spec.axes:
        order = settings["order"]
        coefficients[axis] = np.eye(order + 1)[0] + rng.normal(0.0, SIZES[: order + 1])
        turn_deg[axis], biases[axis] = rng.normal(0.0, size[TURN]), rng.normal(0.0, BIAS)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    logs: dict[str, dict[str, Array | Integers]] = {}
    for name, actions in schedule.by_log().items():
        at, number = actions[::4], len(actions) // 4
        tilt, azimuth, set_degc = np.array(
            [(one.inclination_deg, one.azimuth_deg, one.set_degc) for one in at]
        ).T
        attitudes = simulated.Attitudes(tilt, np.zeros(number), azimuth)
        soak = np.unique(set_degc, return_inverse=True)[1]
        degc = np.round(set_degc + rng.normal(0.0, REACHED_DEGC, number)[soak], 2)
        index = rng.normal(0.0, size[INDEX], (number, 4))
        logs[name] = columns = {
            "station": np.repeat(np.arange(1, number + 1), 4),
            "position_deg": np.tile(simulated.POSITIONS_DEG, number),
            "time_s": np.array([one.start_s for one in actions]),
            "temp_case_degc": np.repeat(degc, 4),
        }
        gravity = simulated.rotated(attitudes, np.array([0.0, 0.0, 1.0]))
        rate = simulated.rotated(attitudes, earth.north_east_down(settings["latitude_deg"]))
        for axis in spec.axes:
            seen_deg = (0.0 if axis == "x" else 90.0) + simulated.POSITIONS_DEG + index
            accel = simulated.resolve_along(gravity, seen_deg, 0.0) + biases[axis][0]
            accel += rng.normal(0.0, size[ACCEL], index.shape)
            s = np.polynomial.polynomial.polyval(degc, coefficients[axis])
            s = s + rng.normal(0.0, size[SCATTER], number)
            s = s + rng.normal(0.0, size[OF_LOG])
            walk = np.cumsum(rng.normal(0.0, size[WALK], index.shape), axis=1)
            across = simulated.resolve_along(rate, seen_deg + turn_deg[axis], 0.0)
            gyro = across / s[:, None] + walk
            gyro += biases[axis][1] + rng.normal(0.0, settings["noise_dph"], index.shape)
            columns[f"accel_{axis}_g"] = sign * accel.ravel()
            columns[f"gyro_{axis}_dph"] = gyro.ravel()
        for column in simulated.REFERENCE if name.startswith(WITHHELD) else ():
            columns[column] = np.repeat(getattr(attitudes, column), 4)
    drawn = {
        axis: {f"s{k}": value for k, value in enumerate(powers.tolist())}
        for axis, powers in coefficients.items()
    }
    decimals = simulated.DECIMALS | dict.fromkeys(simulated.REFERENCE, 4)
    return Campaign(logs, decimals, {"coefficients": drawn})
