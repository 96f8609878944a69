"""What a plan assumes of a triad: noise, errors that dwells share, what is measured already."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import UsageError
from calibkit.instruments.accelerometer import dwells as triad_dwells, forms, shared_errors
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.numeric import k_factor, planned
from calibkit.planning import recipe_text
from calibkit.planning.linear import assume_errors, known_sizes
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array, Integers
    from calibkit.coefficients import Record, StageResult
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.planning.equipment import Device
    from calibkit.planning.proposal import Task

_CORNERS = tuple((tilt, roll) for tilt in (54.7356, 125.2644) for roll in (45, 135, 225, 315))
_FACES = ((0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, 270))
_EDGES = (
    *((tilt, roll) for tilt in (45, 135) for roll in (0, 90, 180, 270)),
    *((90, roll) for roll in (45, 135, 225, 315)),
)
RANGE_DEGC = (-20.0, 125.0)
USUAL = {
    "6 faces, 9 temperatures": _FACES,
    "12 edges, 9 temperatures": _EDGES,
    "18 faces and edges, 9 temperatures": (*_FACES, *_EDGES),
    "26 faces, edges and corners, 9 temperatures": (*_FACES, *_EDGES, *_CORNERS),
    "42 attitudes of the sample logs, 9 temperatures": (
        (0, 0),
        *((tilt, roll) for tilt in range(30, 151, 30) for roll in range(0, 360, 45)),
        (180, 0),
    ),
}
"""Usual sets of attitudes: directions to the faces, edges and corners of a cube."""


@dataclass(frozen=True, slots=True)
class Assumed:
    """What a plan assumes."""

    device: Device
    fixture: str
    range_degc: tuple[float, float]
    noise_g: float
    components: tuple[ErrorComponent, ...]
    order: int
    """Highest power of temperature of all models that the recipe fits."""
    have: planned.Dwells | None
    notes: tuple[str, ...]

    @property
    def sizes(self) -> planned.Sizes:
        """Standard deviations of the shared errors in the units of the fit."""
        return known_sizes(self.components, shared_errors.UNITS)

    def noise_of(self, dwell_s: float) -> float:
        """Standard deviation [g] of the mean of a dwell of a length [s]."""
        return float(self.noise_g * np.sqrt(self.device.noise_s / dwell_s))


def assume(spec: AccelerometerRecipe, task: Task) -> Assumed:
    """Assumptions of a plan; UsageError for a recipe that is not planned."""
    _require_planned(spec)
    device = task.equipment.known_device(spec.procedure, "g")
    noise, notes, earlier = device.noise, [], dict[tuple[str, str], ErrorComponent]()
    if task.earlier is not None:
        noise, earlier = _read_run(task.earlier)
        notes.append(f"noise {1e6 * noise:.3g} µg and {len(earlier)} shared errors of that run")
    found = assume_errors(spec, device, earlier.values(), shared_errors.UNITS)
    low, high = task.range_degc or RANGE_DEGC
    fixtures = task.equipment.attitudes
    fixture = task.attitudes if task.attitudes in fixtures else "file"
    components = tuple(found.values())
    return Assumed(
        *(device, fixture, (low, high), noise, components),
        order=_highest_order(spec),
        have=_measured(spec, task, noise),
        notes=tuple(notes),
    )


def list_spots(task: Task, fixture: str) -> tuple[Array, Integers]:
    """Attitudes [c, 2] [°] of a fixture, and the mounting of each [c]."""
    step = task.equipment.fixture(fixture).step_deg
    if fixture == "file":
        return np.array(task.spots), np.zeros(len(task.spots), dtype=np.int64)
    if fixture == "faces":
        return np.array(_FACES, dtype=np.float64), np.zeros(6, dtype=np.int64)
    turns = range(0, 360, step)
    if fixture in ("two-axis", "hand"):
        tilts = [(tilt, roll) for tilt in range(step, 180, step) for roll in turns]
        spots = np.array([(0, 0), *tilts, (180, 0)], dtype=np.float64)
        return spots, np.zeros(len(spots), dtype=np.int64)
    # along the head's axis; across it, in two planes that hold the tool's axis
    along = [(90, roll) for roll in turns]
    planes = [
        [(turn, roll) if turn <= 180 else (360 - turn, roll + 180) for turn in turns]
        for roll in (0, 90)
    ]
    spots = np.array([*along, *planes[0], *planes[1]], dtype=np.float64)
    return spots, np.repeat(np.arange(3), len(along))


def _require_planned(spec: AccelerometerRecipe) -> None:
    """Raise UsageError for a recipe that is not planned."""
    nuisance = spec.affine.tilt or spec.affine.fixture
    if spec.reference.kind != "attitude" or nuisance:
        raise UsageError(
            "a plan of a triad is one of its K-factor or its affine model against known attitudes",
            hint='use reference.kind = "attitude", compensation = "k" or "affine", and neither'
            " affine.tilt nor affine.fixture",
        )


def _highest_order(spec: AccelerometerRecipe) -> int:
    """Highest power of temperature of the models that a recipe fits."""
    k = [order for axis in spec.k.axes for order in (axis.scale_order, axis.zero_order)]
    triad = spec.affine
    own = [triad.scale_order, triad.cross_order, triad.bias_order]
    return int(max([*(k if spec.k.enabled else ()), *(own if triad.enabled else ())]))


def planned_model(spec: AccelerometerRecipe, assumed: Assumed) -> planned.Model:
    """Model that the recipe compensates with."""
    if spec.compensation == "k":
        terms = [k_factor.KTerms(a.scale_order, a.zero_order, a.cross) for a in spec.k.axes]
        named = [(name, forms.K_UNITS) for name in forms.K_MODELS]
        fitted = [part.fitted for part in terms]
        return planned.k_model(fitted, named, assumed.range_degc, assumed.sizes)
    triad = spec.affine
    fitted_terms = Terms.of_orders(
        (triad.scale_order,) * 3,
        (triad.bias_order,) * 3,
        (min(triad.cross_order, 1),) * 3,
        second_order=triad.second_order,
        third_order=triad.third_order,
    )
    parameters = {shared_errors.SECOND_ORDER} if triad.second_order else set()
    sizes = {key: size for key, size in assumed.sizes.items() if key not in parameters}
    return planned.triad(fitted_terms, assumed.range_degc, sizes)


def _read_run(
    records: Mapping[str, Record | StageResult],
) -> tuple[float, dict[tuple[str, str], ErrorComponent]]:
    """Noise [g] of a dwell and shared errors of a run; UsageError for one of no triad."""
    models = [model for record in records.values() for model in record.models]
    own = [m for m in models if m.form in (forms.K.name, forms.AFFINE.name, forms.TRIAD.name)]
    if not own:
        raise UsageError(
            "that run has neither K-factor nor affine model", hint="name a run of such a triad"
        )
    noise = float(np.sqrt(np.mean([model.residual_rms**2 for model in own])))
    found = {
        (one.group, one.effect): ErrorComponent(
            group=one.group, effect=one.effect, value=one.value, unit=one.unit, dof=20.0
        )
        for one in own[0].components
        if one.value > one.standard_uncertainty
    }
    return noise, found


def _measured(spec: AccelerometerRecipe, task: Task, noise: float) -> planned.Dwells | None:
    """Dwells that are measured already."""
    if not task.have:
        return None
    found = triad_dwells.collect_dwells(task.have, spec)
    soak = shared_errors.number_soaks(found.temperature, found.log)
    timed = bool(np.isfinite(found.time).all())
    hours = found.time / 3600.0 if timed else np.zeros(len(soak))
    spots = np.column_stack([found.inclination, found.toolface])
    return planned.Dwells(spots, found.temperature, soak, hours, noise)


def write_recipe(spec: AccelerometerRecipe, task: Task, assumed: Assumed, log: str | None) -> str:
    """Recipe of the planned campaign."""
    # logs beside those that are measured are as these are
    changes = {} if task.have else {"dwells": {"mode": "rows"}}
    return recipe_text.write_recipe(
        spec, [log] if log else [], assumed.components, changes, added=bool(task.have)
    )
