"""Campaigns of a four-position inclinometer: which stations at which temperatures, how long in each
position.

    s = Σ_k s_k x^k + δ ∂s/∂δ + b of the log + b of the station + e       (1) of `scale_fit`

s are the roots that stations will give: the s with which the measured rate has the horizontal part
Ω cos α is one of two solutions of a quadratic. x is the temperature mapped to [-1, 1], δ a turn of
the gyros against the accelerometers about the tool axis. An azimuth ψ at the latitude α is
uncertain by both,

    dψ = -tan α tan θ sin ψ ds + ∂ψ/∂δ dδ,   ∂ψ/∂δ = 1/cos θ at ψ = 90°                      (2)
"""

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from itertools import product

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import Prior
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.inclinometer import scale_fit, simulate as simulated, stations
from calibkit.instruments.inclinometer.forms import FILE
from calibkit.instruments.inclinometer.published import Components
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import estimate_roots, mounting_slopes
from calibkit.instruments.inclinometer.scale_fit import StationRoots
from calibkit.numeric import earth
from calibkit.numeric.arrays import Array, Mask
from calibkit.planning.bench import (
    LEVELS,
    WITHHELD,
    Bench,
    Design,
    Sources,
    Task,
    Tour,
    count,
    split_variance,
)
from calibkit.planning.equipment import Device
from calibkit.planning.exchange import Pool
from calibkit.planning.schedule import Clock, Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.frame import Log
from calibkit.simulate.campaign import Campaign

WALK, ACCEL = ("reading", "bias walk"), ("reading", "accelerometer noise")
INDEX, SCATTER = ("position", "index"), ("station", "scale")
TURN, OF_LOG = ("mounting", "gyro turn"), ("log", "scale")
UNITS = {WALK: "deg/h", ACCEL: "g", INDEX: "deg", SCATTER: "1", TURN: "deg", OF_LOG: "1"}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""
OF_TURN = "gyro turn of the mounting"


class StationBench(Bench):
    """Campaigns of an inclinometer."""

    results = {"azimuth": "deg", "scale factor": "ppm"}
    units, default_degc = UNITS, (20.0, 120.0)
    files, noise_unit = (FILE,), "deg/h"

    def __init__(self, spec: InclinometerRecipe, task: Task) -> None:
        """Of the order of the recipe, or of the equipment where the fit chooses it."""
        super().__init__(spec, task)
        order = spec.scale.order
        self.order = self.device.order if order == "auto" else order
        self.polynomials = [(axis, "s", "1", self.order + 1) for axis in spec.axes]
        # inclinations and azimuths [n, 2] [°] that the fixture has
        self.fixture = task.equipment.fixture("north")
        step = self.fixture.step_deg
        places = product(np.arange(step, 90.0, step), np.arange(0.0, 360.0, step))
        self.places: Array = np.array([*places])

    def rows_of_logs(self, logs: Sequence[Log]) -> StationRoots:
        """Stations of the sensor pair that tells less; FitError without temperatures."""
        admitted, _ = stations.admit_logs(list(logs), self.spec)
        rows = stations.gather_rows(admitted, self.spec.on_site())
        measured = stations.solve_components(rows, self.spec)
        if not np.isfinite(measured.temperature).all():
            raise FitError(
                f"{logs[0].file}: no case temperature, expected one to plan what is missing",
                hint="map it under [columns.temp_case_degc], or plan without --have",
            )
        pairs, scatter = [], self.device.size(*SCATTER)
        for axis in self.spec.axes:
            u, by_turn, _ = self.judge_roots(measured.components[axis], measured.status[axis])
            used = np.isfinite(u)
            x, s = self.mapped(measured.temperature[used]), np.ones(int(used.sum()))
            pairs.append(StationRoots(s, u[used], x, by_turn[used], measured.log[used]))
        return min(pairs, key=lambda roots: float(np.sum(1.0 / (roots.u**2 + scatter**2))))

    @cached_property
    def roots_by_dwell_s(self) -> dict[float, tuple[Array, Array]]:
        """Time in a position [s] → `judge_roots` of s = 1 at each place, u infinite where a fit
        would use its root by the history of s alone.
        """
        # components of a tool without errors
        tilt, azimuth = self.places.T
        attitudes, by_dwell_s = np.column_stack([tilt, np.zeros_like(tilt), azimuth]), {}
        earth_rate = earth.north_east_down(self.spec.site.latitude_deg)
        accel_x, accel_y, _ = simulated.rotated(attitudes, np.array([0.0, 0.0, 1.0])).T
        gyro_x, gyro_y, _ = simulated.rotated(attitudes, earth_rate).T
        for dwell_s in self.device.dwell_s:
            # half differences of two positions; the bias walks over both steps between them
            gyro = (self.device.noise_of(dwell_s) ** 2 + self.device.size(*WALK) ** 2) / 2.0
            accel = self.device.size(*ACCEL) ** 2 / 2.0
            covariance = np.tile(np.diag([accel, accel, gyro, gyro]), (len(tilt), 1, 1))
            parts = Components(accel_x, accel_y, gyro_x, gyro_y, covariance)
            u, by_turn, unambiguous = self.judge_roots(parts)
            by_dwell_s[dwell_s] = np.where(unambiguous, u, np.inf), by_turn
        return by_dwell_s

    def judge_roots(
        self, parts: Components, refused: Sequence[str] = ()
    ) -> tuple[Array, Array, Mask]:
        """Three figures of each station [n], of the root of s that is nearest to 1: its standard
        uncertainty with index errors, infinite where a fit would not use it; its derivative by a
        turn of the gyro [1/°]; whether the other root cannot be s.
        """
        latitude_deg, limits = self.spec.site.latitude_deg, self.spec.limits
        roots = estimate_roots(parts, latitude_deg, refused=refused, limits=limits)
        column = np.argmin(np.abs(np.nan_to_num(roots.s, nan=np.inf) - 1.0), axis=1)
        rows = np.arange(column.size)
        used = roots.usable[rows, column] & np.array([not reason for reason in roots.status])
        by_turn, by_index = np.radians(mounting_slopes(parts, roots.slopes[rows, column, :4]))
        index = by_index * self.device.size(*INDEX)
        u = np.where(used, np.hypot(roots.uncertainty[rows, column], index), np.inf)
        # a root that is negative, or no number, is no scale factor
        unambiguous = np.any(~(roots.s > 0.0), axis=1)
        return u, np.where(used, by_turn, 0.0), unambiguous

    def fit(self, rows: StationRoots, *, turn_known: bool = True) -> Fit:
        """What the roots will tell of s(T), of a gyro whose turn has a known size, or is
        measured.
        """
        of_log = scale_fit.scale_of_logs(rows.log)
        shared = self.device.state([*scale_fit.shared_errors(rows, None), of_log])
        size = max(self.device.size(*TURN), 1e-9)  # [°], of no turn
        turn = Prior(name=OF_TURN, block=slice(-1, None), size=size)
        return predict(
            partial(scale_fit.residual, roots=rows),
            np.eye(self.order + 2)[0],
            shared,
            priors=[turn] if turn_known else [],
            noise=rows.u,
            names=[*(f"s{k}" for k in range(self.order + 1)), "turn"],
        )

    def temperatures(self, rows: StationRoots) -> list[Array]:
        """Of all stations."""
        middle, half = self.middle_half
        return [middle + half * rows.x]

    def variances(self, rows: StationRoots) -> dict[str, Sources]:
        """Variance of s(T), and of the azimuth that it and a turn of the gyros, which the stations
        have to tell, leave.
        """
        unit_vectors = np.eye(self.order + 2)
        x = self.mapped(np.linspace(*self.range_degc, LEVELS))
        by_s = derivative(lambda p: scale_fit.scale(p, x), unit_vectors[0])
        psi_by_s, psi_by_turn = azimuth_slopes(self.spec.site.latitude_deg)
        # A turn is measured, and not taken out: the azimuth has what the stations leave unknown of
        # it, through s and by itself, and beside that the turn as it is assumed to be.
        slopes = psi_by_s * by_s + psi_by_turn * unit_vectors[-1]
        of_azimuth = split_variance(self.fit(rows, turn_known=False), slopes)
        mounted = {OF_TURN: np.full(LEVELS, (psi_by_turn * self.device.size(*TURN)) ** 2)}
        of_scale = split_variance(self.fit(rows), 1e6 * by_s, [OF_TURN])
        return {"azimuth": of_azimuth | mounted, "scale factor": of_scale}

    def passed_on(self, campaign: Design) -> list[ErrorComponent]:
        """A single log shows no difference between logs."""
        errors = super().passed_on(campaign)
        if len(self.task.have) + len(campaign.logs) > 1:
            return errors
        return [error for error in errors if (error.group, error.effect) != OF_LOG]

    def design(self, degc: Tour, choice: list[int], dwell_s: float) -> Design:
        """Stations at places, at each of the temperatures in their order; where nothing is withheld
        yet, with stations of other attitudes at the second temperature that are.
        """
        log, clock = self.task.name_log("stations.csv"), Clock(self.task.equipment)
        u, by_turn = self.roots_by_dwell_s[dwell_s]
        # the best of those that the design has not
        spare_places = [k for k in np.argsort(u).tolist() if k not in choice and np.isfinite(u[k])]
        withheld = spare_places[:: max(len(spare_places) // 4, 1)][:4]
        for number, level in enumerate(degc):
            clock.settle(self.device, level)
            recorded = [(place, log) for place in choice]
            if number == 1 and not self.task.withheld:
                recorded += [(place, f"{WITHHELD}{log}") for place in withheld]
            for place, name in recorded:
                tilt, azimuth = self.places[place].tolist()
                for position in simulated.POSITIONS_DEG.tolist():
                    clock.dwell(self.fixture, (tilt, position, azimuth), dwell_s, name)
        label = (
            f"{count(len(choice), 'station')} at each of {count(len(degc), 'soak')} at"
            f" {count(len({*degc}), 'temperature')}, {dwell_s:g} s in a position"
        )
        x = self.mapped(np.repeat(np.array(degc, dtype=np.float64), len(choice)))
        one_log, station_places = np.zeros(len(x), dtype=np.int64), list(choice)
        u, by_turn = (np.tile(of_place[station_places], len(degc)) for of_place in (u, by_turn))
        roots = StationRoots(np.ones(len(x)), u, x, by_turn, one_log)
        return Design(label, clock.schedule(), (log,), roots)

    def choices(self) -> Iterator[list[int]]:
        """Best places of each number at one temperature: of s beside a turn of the gyro of known
        size, and of the azimuth with a turn that is measured.
        """
        u, by_turn = self.roots_by_dwell_s[max(self.roots_by_dwell_s)]
        able, rng = np.flatnonzero(np.isfinite(u)), np.random.default_rng(1)
        rows = np.column_stack([np.ones(able.size), by_turn[able]])
        rows /= np.hypot(u[able], self.device.size(*SCATTER))[:, None]
        parts = rows[:, :, None] * rows[:, None, :]
        turn = self.device.size(*TURN) or 1.0
        of_azimuth = azimuth_slopes(self.spec.site.latitude_deg)
        # precision of s and of the turn; 1e-6 of what is not known, for M to have an inverse
        for prior, combination in ((turn**-2.0, np.array([1.0, 0.0])), (1e-6, of_azimuth)):
            pool = Pool(np.diag([1e-6, prior]), parts, np.outer(combination, combination))
            for number in (2, 3, 4, 6, 8, 12):
                if number <= able.size:
                    selection, _ = pool.search(number, rng, restarts=1)
                    yield able[selection].tolist()


def azimuth_slopes(latitude_deg: float) -> Array:
    """Derivatives (2) [2] of the azimuth by s [°] and by a turn of the gyro [1], at an inclination
    of 45° and an azimuth of 90°, where s matters.
    """
    alpha, theta = np.radians([latitude_deg, 45.0])
    return np.array([-np.degrees(np.tan(alpha) * np.tan(theta)), 1.0 / np.cos(theta)])


prepare_plan = StationBench


def simulate_plan(
    spec: InclinometerRecipe, schedule: Schedule, device: Device, seed: int
) -> Campaign:
    """Logs of the stations of a schedule, and the coefficients of s(T) of each gyro."""
    rng = np.random.default_rng(seed)
    noise = device.noise_of(schedule.recorded("dwell")[0].duration_s)
    pairs = [
        simulated.draw(rng, gyro_noise_dph=noise, ideal=True)
        | {
            "s_per_degc": rng.normal(0.0, 3e-5),
            "s_repeat": device.size(*SCATTER),
            "bias_walk_dph": device.size(*WALK),
            "accel_noise_g": device.size(*ACCEL),
            "gyro_turn_deg": rng.normal(0.0, device.size(*TURN)),
        }
        for _ in "xy"
    ]
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        spots = [
            (dwell.inclination_deg, dwell.azimuth_deg, dwell.set_degc) for dwell in actions[::4]
        ]
        tilt, azimuth, set_degc = np.array(spots).T
        attitudes = np.column_stack([tilt, np.zeros_like(tilt), azimuth])
        soak = np.unique(set_degc, return_inverse=True)[1]
        degc = np.round(set_degc + rng.normal(0.0, 0.1, tilt.size)[soak], 2)
        x, y = (pair | {"s": pair["s"] + rng.normal(0.0, device.size(*OF_LOG))} for pair in pairs)
        tool = simulated.Tool((x, y), index_deg=device.size(*INDEX))
        columns, _ = tool.stations(attitudes, spec.site.latitude_deg, degc, rng)
        log: dict[str, Array] = {key: np.asarray(column) for key, column in columns.items()}
        log["time_s"] = np.array([dwell.start_s for dwell in actions])
        for axis in "xy":
            log[f"accel_{axis}_g"] = sign * log[f"accel_{axis}_g"]
        if name.startswith(WITHHELD):
            columns_deg = np.repeat(attitudes, 4, axis=0).T
            log |= dict(zip(simulated.REFERENCE, columns_deg, strict=True))
        logs[name] = log
    truth = {
        axis: {
            "s0": pair["s"] - simulated.REFERENCE_DEGC * pair["s_per_degc"],
            "s1": pair["s_per_degc"],
            "s2": 0.0,
            "s3": 0.0,
        }
        for axis, pair in zip("xy", pairs, strict=True)
    }
    decimals = simulated.DECIMALS | dict.fromkeys(simulated.REFERENCE, 4)
    return Campaign(logs, decimals, {"coefficients": truth})
