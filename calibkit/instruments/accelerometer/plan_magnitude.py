"""Campaigns of a triad whose attitudes are unknown: how many positions by hand, how long each, and
what they will give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError, UsageError
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import known_effects
from calibkit.instruments.accelerometer import (
    assumptions,
    dwells as triad_dwells,
    shared_errors,
    simulate_magnitude,
)
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.numeric import planned, q_factor
from calibkit.instruments.accelerometer.shared_errors import Circumstances
from calibkit.numeric import attitude
from calibkit.numeric.exchange import Pool
from calibkit.numeric.information import Information, find_information
from calibkit.planning import recipe_text
from calibkit.planning.linear import (
    Results,
    assume_errors,
    known_sizes,
    read_sizes,
    refuse_range,
)
from calibkit.planning.proposal import (
    NOTHING,
    WITHHELD,
    Candidate,
    Coefficient,
    Planner,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    find_front,
)
from calibkit.planning.schedule import Clock
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.planning.equipment import Device
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

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
TERMS = Terms.of_orders((0, 0, 0), (0, 0, 0), (0, 0, 0), triangular=True)
"""The nine parameters of a triad that knows no temperature."""
UNITS = {
    name: shared_errors.UNITS[name] for name in (shared_errors.ZERO, shared_errors.SECOND_ORDER)
}
"""(group, effect) of the errors that lengths of gravity at one temperature share."""


@dataclass(frozen=True, slots=True)
class _Design:
    """A campaign: positions by number among those of the hand, time in each."""

    chosen: tuple[int, ...]
    dwell_s: float

    @property
    def label(self) -> str:
        """The campaign in a few words."""
        held = f"{len(self.chosen)} positions of {self.dwell_s:g} s"
        return held if self.chosen else NOTHING


@dataclass(frozen=True, slots=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    components: tuple[ErrorComponent, ...]
    spots: Array
    """Inclination and toolface [c, 2] [°]."""
    results: Results
    window_s: float
    """Time of a position that a fit leaves out, half of it at each end."""
    have: Information | None

    def noise_of(self, dwell_s: float) -> float:
        """Noise [g] of the mean of a position."""
        return float(self.device.noise * np.sqrt(self.device.noise_s / (dwell_s - self.window_s)))

    def information(self, design: _Design) -> Information | None:
        """Information of what is measured already and of a design."""
        if not design.chosen:
            return self.have
        gravity = attitude.gravity_vector(*self.spots[list(design.chosen)].T)
        own = _information(gravity, self.noise_of(design.dwell_s), self.components)
        return own if self.have is None else self.have.join(own)

    def schedule(self, design: _Design) -> Schedule:
        """Schedule of a design; where nothing is withheld yet, with positions that lie farthest
        from the others in a log that is.
        """
        clock, fixture = Clock(self.task.equipment), self.task.equipment.fixture(FIXTURE)
        if not design.chosen:
            return clock.schedule()
        log = self.task.name_log(LOG)
        held = [(k, log) for k in design.chosen]
        if not self.task.withheld:
            apart = planned.spread_apart(self.spots, design.chosen, LEFT_OUT)
            held += [(k, f"{WITHHELD}{log}") for k in apart]
        if fixture.attended:
            clock.attend(len(held) * (fixture.move_s + design.dwell_s))
        for place, name in held:
            clock.move(fixture.move_s)
            clock.dwell(self.spots[place].tolist(), design.dwell_s, name)
        return clock.schedule()

    def candidate(self, design: _Design) -> Candidate | None:
        """A campaign with its hours and uncertainties; None where it does not determine all."""
        found = self.information(design)
        if found is None:
            return None
        return self.results.candidate(design.label, self.schedule(design).hours, found, design)


def propose(spec: AccelerometerRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign of a recipe that meets the wishes, or the best within hours."""
    wishes = tuple(Wish.parse(text, RESULTS) for text in task.wishes)
    bench = _prepare(spec, task)
    name = wishes[0].name if wishes else "component"
    found = [one for one in map(bench.candidate, _list_designs(bench)) if one is not None]
    if not found:
        raise FitError(
            "no campaign determines scale factors, biases and angles",
            hint="state more positions, or a smaller step_deg of the fixture",
        )
    best = choose(found, wishes, task.within_h, name)
    design: _Design = best.design
    information = bench.information(design)
    assert information is not None  # noqa: S101 (it is that of a candidate)
    at = spec.reference_temp_degc
    return Proposal(
        best.label,
        bench.schedule(design),
        bench.results.predict(information),
        tuple(_list_coefficients(information)),
        (at, at),
        recipe_text.write_recipe(
            spec,
            [task.name_log(LOG)] if design.chosen else [],
            bench.components,
            {},
            added=bool(task.have),
        ),
        bench.device.noise,
        "g",
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else tuple(_list_usual(bench)),
        (),
        {"dwell_s": design.dwell_s, "noise_1s": bench.device.noise * bench.device.noise_s**0.5},
    ), wishes


def _list_coefficients(information: Information) -> Iterator[Coefficient]:
    """Predicted standard uncertainties of the parameters."""
    u = np.sqrt(np.diag(information.covariance)).tolist()
    for term, size in zip(TERMS.listed, u, strict=True):
        yield Coefficient("triad", term.name, term.unit, size)


def judge(spec: AccelerometerRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the positions that are measured tell; empty where they do not determine all."""
    bench = _prepare(spec, task)
    if bench.have is None or not bench.have.determined:
        return ()
    return bench.results.predict(bench.have)


def _prepare(spec: AccelerometerRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(DEVICE)
    if spec.affine.enabled or spec.dwells.mode != "series" or device.noise_unit != "g":
        raise UsageError(
            "a plan of unknown attitudes is for one temperature, and for a continuous log with a"
            " noise in g",
            hint='use affine.enabled = false and dwells.mode = "series"',
        )
    refuse_range(task, DEVICE)
    if task.attitudes in ("faces", "dividing-head"):
        raise UsageError(
            f"--attitudes {task.attitudes}: attitudes that are unknown are those of a hand",
            hint="leave it out, or name a file of attitudes",
        )
    stated = assume_errors(spec, device, (), UNITS)
    components = tuple(stated.values())
    spots, _ = assumptions.list_spots(task, "file" if task.spots else FIXTURE)
    have = None
    if task.have:
        found = triad_dwells.collect_dwells(list(task.have), spec)
        known = found.weights is not None
        noise = float(np.sqrt(np.mean(found.noise**2))) if known else device.noise
        have = _information(found.indication, noise, components, found)
    slopes = {"component": _component_slopes(), "axis angle": _angle_slopes()}
    results, window_s = Results(RESULTS, slopes), spec.dwells.window_s
    if min(device.dwell_s) < window_s + spec.dwells.shortest_s:
        raise UsageError(
            f"dwell_s of [device.{DEVICE}] has {min(device.dwell_s):g} s, expected at least"
            f" {window_s + spec.dwells.shortest_s:g} s: dwells.window_s and dwells.shortest_s",
            hint="state longer positions, or shorter ones in [dwells]",
        )
    return _Bench(task, device, components, spots, results, window_s, have)


def _information(
    gravity: Array,
    noise_g: float,
    components: tuple[ErrorComponent, ...],
    dwells: triad_dwells.DwellSet | None = None,
) -> Information:
    """Information of lengths of gravity on the nine parameters, in directions [n, 3], with the
    errors that they share.
    """
    unit = gravity / np.linalg.norm(gravity, axis=1)[:, None]
    soak = np.zeros(len(unit), dtype=np.int64) if dwells is None else dwells.log
    sizes = known_sizes(components, UNITS)
    listed = shared_errors.list_errors(Circumstances(soak, None, unit, soak), unit[:, None])
    return find_information(_length_slopes(unit), noise_g, known_effects(listed, sizes))


def _length_slopes(unit: Array) -> Array:
    """Derivatives [n, 9] of lengths of gravity by the parameters, in directions [n, 3]."""
    slopes = TERMS.slopes(TERMS.nominal, unit, np.zeros(len(unit)))
    return np.asarray(np.einsum("ni,nip->np", unit, slopes), dtype=np.float64)


def _component_slopes() -> Array:
    """Derivatives [m, 9] of corrected components [g] by the nine parameters, in all directions."""
    tilt, roll = np.meshgrid(planned.TILTS_DEG, planned.TOOLFACES_DEG)
    unit = attitude.gravity_vector(tilt.ravel(), roll.ravel())
    slopes = TERMS.slopes(TERMS.nominal, unit, np.zeros(len(unit)))
    return slopes.reshape(-1, len(TERMS.listed))


def _angle_slopes() -> Array:
    """Derivatives [3, 9] of the angles Q [°] between the axes."""
    return np.degrees(derivative(lambda p: TERMS.small_angles(p, 0.0), TERMS.nominal))


def _list_designs(bench: _Bench) -> Iterator[_Design]:
    """Campaigns of all numbers of positions, each the best of its number; beside what is measured,
    an empty one.
    """
    if bench.have is not None:
        yield _Design((), 0.0)
    gravity = attitude.gravity_vector(*bench.spots.T)
    noise = bench.noise_of(min(bench.device.dwell_s))
    rows = _length_slopes(gravity) / noise
    base = np.zeros((len(TERMS.listed),) * 2)
    if bench.have is not None:
        base += planned.reduce_to_coefficients(bench.have)
    slopes = bench.results.slopes["component"]
    target = slopes.T @ slopes / len(slopes)
    pool = Pool(base, np.einsum("ci,cj->cij", rows, rows), target)
    rng = np.random.default_rng(bench.task.seed)
    counts = [n for n in (COUNTS if bench.have is None else ADDED) if n <= len(gravity)]
    labels = [f"{count} positions" for count in counts]
    for count, _ in zip(counts, bench.task.progress(labels, "searching"), strict=True):
        chosen = tuple(sorted(pool.search(count, rng, bench.task.restarts)[0]))
        yield from (_Design(chosen, dwell_s) for dwell_s in bench.device.dwell_s)


def _list_usual(bench: _Bench) -> Iterator[Candidate]:
    """The usual campaign: 24 positions spread over the sphere, as short as they may be."""
    spread = (0, *planned.spread_apart(bench.spots, [0], 23))
    found = bench.candidate(_Design(spread, min(bench.device.dwell_s)))
    if found is not None:
        yield replace(found, label=f"usual: {found.label}")


def simulate(
    spec: AccelerometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of a triad that is turned by hand into the positions of a schedule, and its truth."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    size = read_sizes(document, UNITS)
    k, b, q = (rng.normal(0.0, one, 3) for one in simulate_magnitude.SIZES)
    axes = q_factor.axes_from_angles(q)
    second = rng.normal(0.0, size[shared_errors.SECOND_ORDER], 3)
    zero = rng.normal(0.0, size["soak", "zero"], 3)
    noise = settings["noise_1s"] / np.sqrt(simulate_magnitude.INTERVAL_S)
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    logs: dict[str, dict[str, Array]] = {}
    for name in dict.fromkeys(one.log for one in schedule.recorded("dwell")):
        held = [one for one in schedule.recorded("dwell") if one.log == name]
        spots = np.array([(one.inclination_deg, one.toolface_deg) for one in held])
        gravity = attitude.gravity_vector(*spots.T) + rng.normal(0.0, BY_HAND, (len(held), 3))
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
    facts = {"seed": seed, "plan": document["sha256"]}
    facts["coefficients"] = {"triad": dict(zip(TERMS.names, map(float, truth), strict=True))}
    return Campaign(logs, simulate_magnitude.DECIMALS, facts)


BY_HAND = 0.04
"""Standard deviation [1] of a direction that a hand reaches."""
PLANNER = Planner(propose, judge, simulate)
"""How campaigns without attitudes are planned."""
