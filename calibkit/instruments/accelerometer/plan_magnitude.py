"""Campaigns of a triad whose attitudes are unknown: how many positions by hand, how long each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.fit.complex_step import derivative, length
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    shared_errors,
    simulate_magnitude,
)
from calibkit.instruments.accelerometer.fit import asked_terms
from calibkit.instruments.accelerometer.numeric import q_factor
from calibkit.instruments.accelerometer.shared_errors import Circumstances
from calibkit.numeric import attitude
from calibkit.planning import pools
from calibkit.planning.assumptions import assume, read_sizes
from calibkit.planning.proposal import WITHHELD, Coefficient, Design
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, split_variance
from calibkit.planning.simulation import as_planned

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array, Integers
    from calibkit.fit.complex_step import Numbers
    from calibkit.fit.shared import Shared
    from calibkit.instruments.accelerometer.equation import Terms
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.simulate.campaign import Campaign

DEVICE = "accelerometer_magnitude"
FIXTURE = "hand"
LOG = "tumble.csv"
RESULTS = {"component": "g", "axis angle": "deg"}
COUNTS = (12, 15, 18, 24, 30, 40)
"""Positions that the search takes."""
ADDED = (3, 6, 9, 12, 18)
"""Positions that are added to what is measured."""
LEFT_OUT = 6
"""Positions that are withheld."""
USUAL = 24
"""Positions of the usual campaign."""
BY_HAND = 0.04
"""Standard deviation [1] of a direction that a hand reaches."""
UNITS = {
    name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
}
"""(group, effect) of the errors that lengths of gravity at one temperature share."""


@dataclass(frozen=True, slots=True)
class Lengths:
    """Planned or measured positions [n] of a triad without an error."""

    gravity: Array
    """[n, 3] [g]."""
    log: Integers
    noise: Array
    """Of the length of gravity [g]."""


@dataclass(frozen=True)
class LengthBench(Bench):
    """Campaigns of a triad that is turned by hand."""

    terms: Terms
    spots: Array
    """Inclination and toolface [c, 2] [°]."""

    def noise_of(self, dwell_s: float) -> float:
        """Noise [g] of the mean of a position, of which a fit leaves out both ends."""
        return self.assumed.noise_of(dwell_s - self.spec.dwells.window_s)

    @cached_property
    def directions(self) -> Array:
        """Unit vectors [c, 3]."""
        return attitude.gravity_vector(*self.spots.T)

    def state(self, rows: Lengths) -> list[Shared]:
        """Errors that the lengths share, with their sizes; none is assumed of what is not
        stated.
        """
        where = Circumstances(rows.log, None, rows.gravity, rows.log)
        listed = shared_errors.list_errors(where, rows.gravity[:, None])
        assumed = self.assumed.state(listed)
        return [one for one in assumed if one.size is not None]

    def lengths(self, rows: Lengths, p: Numbers) -> Numbers:
        """Residual [n] of the fit to the length of gravity."""
        return length(self.terms.corrected(p, rows.gravity, np.zeros(len(rows.log)))) - 1.0

    def fit(self, rows: Lengths) -> Fit:
        """What positions will tell of the parameters."""
        return predict(
            lambda p: self.lengths(rows, p),
            self.terms.nominal,
            self.state(rows),
            noise=rows.noise,
            names=self.terms.names,
        )

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
        return dict(zip(RESULTS, (component.reshape(-1, len(nominal)), angles), strict=True))

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result."""
        fit = self.fit(self.rows(design))
        return {name: split_variance(fit, slopes) for name, slopes in self.slopes.items()}

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """Scale factors, zeros and angles."""
        u = self.fit(self.rows(design)).of(lambda p: p).u.tolist()
        for term, size in zip(self.terms.listed, u, strict=True):
            yield Coefficient("triad", term.name, term.unit, size)

    def design(self, chosen: tuple[int, ...], dwell_s: float, label: str = "") -> Design:
        """Positions by number, with a time in each; where nothing is withheld yet, with those that
        lie farthest from them in a log that is.
        """
        clock, fixture = Clock(self.task.equipment), self.task.equipment.fixture(FIXTURE)
        log = self.task.name_log(LOG)
        recorded = [(k, log) for k in chosen]
        if not self.task.withheld:
            apart = pools.spread_apart(self.directions, chosen, LEFT_OUT)
            recorded += [(k, f"{WITHHELD}{log}") for k in apart]
        if fixture.attended:
            clock.attend(len(recorded) * (fixture.move_s + dwell_s))
        for k, name in recorded:
            clock.move(fixture.move_s)
            clock.dwell(self.spots[k].tolist(), dwell_s, name)
        noise = np.full(len(chosen), self.noise_of(dwell_s))
        one_log = np.zeros(len(chosen), dtype=np.int64)
        rows = Lengths(self.directions[list(chosen)], one_log, noise)
        label += f"{len(chosen)} positions of {dwell_s:g} s"
        settings = {"dwell_s": dwell_s, "noise_1s": self.assumed.noise_of(1.0)}
        return Design(label, clock.schedule(), (log,), rows, None, settings)

    def designs(self) -> Iterator[Design]:
        """Campaigns of all numbers of positions, each the best of its number."""
        dwells, count = self.assumed.device.dwell_s, len(self.directions)
        base = np.zeros((len(self.terms.listed),) * 2)
        counts: tuple[int, ...] = COUNTS
        if self.have is not None:
            yield Design.nothing()
            base, counts = self.information(self.have), ADDED
        noise = np.full(count, self.noise_of(min(dwells)))
        rows = Lengths(self.directions, np.zeros(count, dtype=np.int64), noise)
        jacobian = derivative(lambda p: self.lengths(rows, p), self.terms.nominal)
        pool = pools.pool(jacobian, (), (), noise, count, base, self.slopes["component"])
        rng = np.random.default_rng(self.task.seed)
        sizes = [size for size in counts if size <= count]
        labels = [f"{size} positions" for size in sizes]
        for size, _ in zip(sizes, self.task.progress(labels, "searching"), strict=True):
            chosen = tuple(sorted(pool.search(size, rng, self.task.restarts)[0]))
            yield from (self.design(chosen, dwell_s) for dwell_s in dwells)

    def information(self, rows: Lengths) -> Array:
        """Information [9, 9] of positions."""
        jacobian = derivative(lambda p: self.lengths(rows, p), self.terms.nominal)
        return pools.information(jacobian, self.state(rows), rows.noise)

    def usual(self) -> Iterator[Design]:
        """Positions spread over the sphere, as short as they may be."""
        spread = (0, *pools.spread_apart(self.directions, [0], USUAL - 1))
        yield self.design(spread, min(self.assumed.device.dwell_s), label="usual: ")


def prepare(spec: AccelerometerRecipe, task: Task, spots: Array) -> LengthBench:
    """What the search needs, of the positions [c, 2] [°] that are known; UsageError for what cannot
    be planned.
    """
    device = task.equipment.known_device(DEVICE)
    if spec.affine.enabled or spec.dwells.mode != "series" or device.noise_unit != "g":
        raise UsageError(
            "a plan of unknown attitudes is for one temperature, and for a continuous log with a"
            " noise in g",
            hint='use affine.enabled = false and dwells.mode = "series"',
        )
    if task.attitudes in ("faces", "dividing-head"):
        raise UsageError(
            f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
            hint="leave it out, or name a file of attitudes",
        )
    assumed = assume(spec, task, device, UNITS)
    shortest = spec.dwells.window_s + spec.dwells.shortest_s
    if min(device.dwell_s) < shortest:
        raise UsageError(
            f"dwell_s of [device.{DEVICE}] has {min(device.dwell_s):g} s, expected at least"
            f" {shortest:g} s: dwells.window_s and dwells.shortest_s",
            hint="state longer positions, or shorter ones in [dwells]",
        )
    have = None
    if task.have:
        dwells = triad_dwells.collect_dwells(list(task.have), spec)
        known = dwells.weights is not None
        noise = float(np.sqrt(np.mean(dwells.noise**2))) if known else device.noise
        unit = dwells.indication / np.linalg.norm(dwells.indication, axis=1)[:, None]
        have = Lengths(unit, dwells.log, np.full(len(unit), noise))
    return LengthBench(spec, task, assumed, RESULTS, have, asked_terms(spec), spots)


def simulate(
    spec: AccelerometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    size = read_sizes(document, UNITS)
    k, b, q = (rng.normal(0.0, typical, 3) for typical in simulate_magnitude.SIZES)
    axes = q_factor.axes_from_angles(q)
    second = rng.normal(0.0, size[shared_errors.SECOND_ORDER], 3)
    zero = rng.normal(0.0, size[shared_errors.ZERO], 3)
    noise = settings["noise_1s"] / np.sqrt(simulate_magnitude.INTERVAL_S)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
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
    return as_planned(document, seed, logs, simulate_magnitude.DECIMALS, coefficients)
