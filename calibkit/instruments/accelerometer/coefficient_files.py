"""Fits of a triad → accel_k.json, accel_q.json, accel_affine.json, how they move with errors of the
table's angles, the thermometer and local gravity, and the corrected indications that they give.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Component, Condition, Figure, Model, Record, StageResult
from calibkit.errors import CoefficientError, FrameError
from calibkit.forms import Form, within_ranges
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.dwells import ATTITUDE, DwellSet
from calibkit.instruments.accelerometer.fit import TriadFit, list_models
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric import chunks, gum
from calibkit.numeric.dispersion import rms
from calibkit.recipe import type_b
from calibkit.recipe.type_b import RELATIVE, TypeB
from calibkit.sensitivities import InputError, Sensitivity, differentiate, of_thermometer

COMPENSATIONS = {"k": "accel_k", "affine": "accel_affine"}
"""Compensation of a recipe → stage whose models correct the indications."""

FIELDS = {
    "inclination_deg": "inclination",
    "toolface_deg": "toolface",
    forms.TEMPERATURE: "temperature",
    "gravity_mps2": "indication",
}
"""Input → array of the dwells that its error shifts."""
ANGLE_STEP_DEG, GRAVITY_STEP = 1e-3, 1e-5


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a triad's indications by the models of a stage: one of the triad, or one of
    each axis.
    """

    form: Form
    models: tuple[Model, ...]

    @classmethod
    def of(cls, stage: Record | StageResult) -> "Correction":
        """Correction by the models of a stage of a run or of a fit."""
        form = {form.name: form for form in forms.FORMS}[stage.models[0].form]
        return cls(form, stage.models)

    @property
    def temperature_range(self) -> tuple[float, float]:
        """Temperature range [°C] of the calibration."""
        return self.models[0].valid[forms.TEMPERATURE]

    @property
    def noise_g(self) -> float:
        """Noise of a component of a dwell [g], by the fit: residual rms of its models."""
        return rms([model.residual_rms for model in self.models])

    @property
    def noise_of_axes(self) -> Array:
        """Noise of each component of a dwell [3, g]; the same in all where one was stated."""
        if len(self.models) == 3:
            return np.array([model.residual_rms for model in self.models])
        (triad,) = self.models
        noise = {p.name: p.value for p in triad.parameters}
        return np.array([noise.get(f"noise_{a}", triad.residual_rms) for a in "xyz"])

    def __call__(self, indication: Array, temperature: Array) -> Array:
        """Corrected components [n, 3, g] of indications [n, 3, g]; temperatures [n, °C] are clamped
        to the range of the calibration.
        """
        at, _ = within_ranges(self.models[0], forms.inputs(indication, temperature))
        return np.column_stack([self.form.evaluate(model, at) for model in self.models])

    def uncertainty(self, unseen: DwellSet) -> tuple[Array, Array]:
        """Type A uncertainty of corrected components [n, 3, g] of a log of its own: errors that its
        dwells share [n, 3, k, g], and variances [n, 3, g²] of those that they do not.

        Raises FrameError where an error grows with time and the log tells none.
        """
        indication = unseen.indication
        at, _ = within_ranges(self.models[0], forms.inputs(indication, unseen.temperature))
        shared, own = [], np.zeros_like(indication)
        own += self.noise_of_axes**2
        of_axes = [np.eye(3)] if len(self.models) == 1 else [*np.eye(3)[:, :, None]]
        for model, axes in zip(self.models, of_axes, strict=True):  # [3, a] of those it corrects
            slopes = self.form.gradient(model, at) @ gum.square_root(np.array(model.covariance))
            slopes = slopes.reshape(len(indication), axes.shape[1], -1)
            shared.append(np.einsum("ia,nak->nik", axes, slopes))
            if self.form.further is not None:
                own += axes.sum(axis=1) * self.form.further(model, at)[:, None] ** 2
            for part in model.components:
                size = part.value * _growth(part, unseen)
                if part.group == "attitude":  # which a log seldom repeats
                    own += axes.sum(axis=1) * size**2
                else:
                    shared.append(size[:, :, None] * axes)
        return np.concatenate(shared, axis=2), own

    def by_term(self, dwells: DwellSet, term: TypeB) -> Array:
        """Errors [n, 3, g] of corrected dwells against the reference for one standard uncertainty
        of a type B term: on the reference's angles, the thermometer, an indication or a
        coefficient; 0 of any other.
        """
        indication, temperature = dwells.indication, dwells.temperature
        moved = {}
        if term.quantity in {*ATTITUDE, forms.TEMPERATURE}:
            field = FIELDS[term.quantity]
            moved[field] = getattr(dwells, field) + term.u_of(0.0)
        elif term.quantity in forms.COMPONENTS:
            axis, off = forms.COMPONENTS.index(term.quantity), np.zeros_like(indication)
            off[:, axis] = term.u_of(1.0) * (indication[:, axis] if term.unit in RELATIVE else 1.0)
            moved["indication"] = indication + off
        if moved:
            other = replace(dwells, **moved)
            by_input = self(other.indication, other.temperature) - self(indication, temperature)
            # without angles, lengths do not depend on them
            return by_input + np.nan_to_num(other.reference - dwells.reference)
        wanted, errors = term.result or term.quantity, np.zeros_like(indication)
        at, _ = within_ranges(self.models[0], forms.inputs(indication, temperature))
        for axis, model in enumerate(self.models):
            for j, c in enumerate(model.coefficients):
                if wanted in {c.name, f"{model.name}.{c.name}"}:
                    size = type_b.combine_terms((term,), (wanted,), c.value, c.unit)
                    axes = slice(None) if len(self.models) == 1 else axis
                    errors[:, axes] = size * self.form.gradient(model, at)[..., j]
                    return errors
        return errors

    @property
    def dof(self) -> tuple[float, float]:
        """Fewest effective degrees of freedom of a coefficient, and those of the residuals."""
        coefficients = (model.dof_of(c) for model in self.models for c in model.coefficients)
        return max(min(coefficients), 1.0), max(min(model.dof for model in self.models), 1.0)

    def outside(self, temperature: Array) -> float:
        """Share of the temperatures [n, °C] that are outside the calibrated range and clamped."""
        low, high = self.temperature_range
        return (
            chunks.count(temperature, lambda part: (part < low) | (part > high)) / temperature.size
        )


def _growth(component: Component, dwells: DwellSet) -> Array:
    """Errors [n, 3] of dwells by one unit of a component: in proportion to the indication, to the
    time about its mean [h], or the same in all.
    """
    if component.unit == "1":
        return dwells.indication
    if not component.unit.endswith("/h"):
        return np.ones_like(dwells.indication)
    if not np.isfinite(dwells.time).all():
        raise FrameError(
            f"{dwells.place[0]}: no time_s, expected one: the {component.effect} of the"
            f" {component.group}, {component.value:.3g} {component.unit}, grows with time",
            hint="log time_s",
        )
    return np.tile((dwells.time - dwells.time.mean())[:, None] / 3600.0, 3)


def find_stage(compensation: str) -> str:
    """Stage of a compensation; raises CoefficientError for the mixed one of 0.2."""
    if compensation not in COMPENSATIONS:
        raise CoefficientError(
            f"compensation = {compensation!r} is no longer supported, expected 'affine' or 'k'",
            hint="'affine' corrects scale, zero and angles together; K and Q stay in their files",
        )
    return COMPENSATIONS[compensation]


def find_correction(compensation: str, stages: Iterable[Record | StageResult]) -> Correction:
    """Correction that a recipe names, from the stages of a run or of a fit; raises CoefficientError
    for a missing stage.
    """
    needed = find_stage(compensation)
    for stage in stages:
        if stage.stage == needed:
            return Correction.of(stage)
    raise CoefficientError(
        f"the run holds no {needed}.json", hint="it is not a run of accelerometer"
    )


def list_results(
    fitted: TriadFit,
    dwells: DwellSet,
    gravity_mps2: float | None,
    attitude_figures: tuple[Figure, ...],
) -> tuple[StageResult, ...]:
    """Coefficient files of the models that were fitted."""
    conditions = (
        (Condition("local_gravity", gravity_mps2, "m/s^2"),) if gravity_mps2 is not None else ()
    )
    flags = tuple(dict.fromkeys((*dwells.flags, *fitted.flags)))
    results = []
    if fitted.k:
        of_k = (*flags, *fitted.k_not_fitted)
        results.append(StageResult("accel_k", fitted.k, (), of_k, conditions))
    if fitted.q is not None and fitted.affine is not None:
        at = forms.inputs(np.eye(3), np.full(3, fitted.q.value("temperature")))
        # the exact matrix, lower triangular, turns the unit vectors of the axes into its columns
        matrix = forms.Q.evaluate(fitted.q, at).T
        u = forms.Q.standard_uncertainty(fitted.q, at).T
        exact = (
            Figure(f"Q_exact_{'xyz'[i]}{'xyz'[j]}", float(matrix[i, j]), "1", float(u[i, j]))
            for i in range(3)
            for j in range(i + 1)
        )
        figures = (*exact, *fitted.intervals)
        results += [
            StageResult("accel_q", (fitted.q,), figures, flags, conditions),
            StageResult("accel_affine", (fitted.affine,), attitude_figures, flags, conditions),
        ]
    return tuple(results)


def find_sensitivities(
    fitted: TriadFit, dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[Sensitivity, ...]:
    """Sensitivities of the coefficients of a fit to `dwells`."""
    errors = [*of_thermometer(forms.TEMPERATURE, *dwells.valid[forms.TEMPERATURE])]
    if spec.reference.kind == "attitude":
        names = ("inclination_deg", "toolface_deg")
        errors += [InputError(name, "offset", ANGLE_STEP_DEG) for name in names]
    gravity = spec.site.local_gravity()
    if gravity is not None and any(
        name in spec.columns and spec.columns[name].unit == "m/s^2" for name in forms.COMPONENTS
    ):
        errors.append(InputError("gravity_mps2", "offset", GRAVITY_STEP * gravity))

    def shift(error: InputError) -> DwellSet:
        field = FIELDS[error.input]
        values = getattr(dwells, field)
        if error.input == "gravity_mps2":  # what is logged in m/s² is divided by it
            assert gravity is not None  # noqa: S101 (no such error otherwise)
            return replace(dwells, indication=values / (1.0 + error.step / gravity))
        return replace(dwells, **{field: error.shift(values)})

    def models(shifted: DwellSet, triad: Triad) -> tuple[StageResult, ...]:
        k, _, q, affine = list_models(shifted, spec, triad)
        moved = replace(fitted, k=k, q=q, affine=affine, intervals=())
        return list_results(moved, shifted, gravity, ())

    shifted = [shift(error) for error in errors]
    triads = fitted.triad.shifted(dwells, shifted)
    results = dict(zip(errors, map(models, shifted, triads), strict=True))
    return differentiate(errors, models(dwells, fitted.triad), results.__getitem__)
