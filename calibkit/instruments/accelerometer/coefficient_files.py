"""Fits of a triad → accel_k.json, accel_q.json, accel_affine.json, how they move with errors of the
table's angles, the thermometer and local gravity, and the corrected indications that they give.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Condition, Figure, Model, Record, StageResult
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import CoefficientError, FrameError
from calibkit.forms import Form, within_ranges
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.dwells import ATTITUDE, DwellSet
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.fit import TriadFit, list_models
from calibkit.instruments.accelerometer.numeric import q_factor
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
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

    def __call__(self, indication: Array, temperature: Array) -> Array:
        """Corrected components [n, 3, g] of indications [n, 3, g]; temperatures [n, °C] are clamped
        to the range of the calibration.
        """
        readings, _ = within_ranges(self.models[0], forms.inputs(indication, temperature))
        return np.column_stack([self.form.evaluate(model, readings) for model in self.models])

    def uncertainty(self, unseen: DwellSet) -> tuple[Array, Array]:
        """Type A uncertainty of corrected components [n, 3, g] of a log of its own: errors that its
        dwells share [n, 3, k, g], and variances [n, 3, g²] of those that they do not.

        Raises FrameError where an error grows with time and the log tells none.
        """
        indication, time = unseen.indication, unseen.time
        readings, _ = within_ranges(self.models[0], forms.inputs(indication, unseen.temperature))
        shared, independent = [], np.zeros_like(indication)
        of_axes = [np.eye(3)] if len(self.models) == 1 else [*np.eye(3)[:, :, None]]
        for model, axes in zip(self.models, of_axes, strict=True):  # [3, a] of those it corrects
            corrects = axes.sum(axis=1)
            # where the fit has a noise of each axis, it is that
            noise = {p.name: p.value for p in model.parameters}
            independent += corrects * [
                noise.get(f"noise_{a}", model.residual_rms) ** 2 for a in "xyz"
            ]
            slopes = self.form.gradient(model, readings) @ gum.square_root(
                np.array(model.covariance)
            )
            slopes = slopes.reshape(len(indication), axes.shape[1], -1)
            shared.append(np.einsum("ia,nak->nik", axes, slopes))
            if self.form.further is not None:
                independent += corrects * self.form.further(model, readings)[:, None] ** 2
            for part in model.components:
                # by one unit: in proportion to the indication, to the time, or the same in all
                growth = indication if part.unit == "1" else np.ones_like(indication)
                if part.unit.endswith("/h"):
                    if not np.isfinite(time).all():
                        raise FrameError(
                            f"{unseen.place[0]}: no time_s, expected one: the {part.effect} of the"
                            f" {part.group}, {part.value:.3g} {part.unit}, grows with time",
                            hint="log time_s",
                        )
                    growth = np.tile((time - time.mean())[:, None] / SECONDS_PER_HOUR, 3)
                size = part.value * growth
                if part.group == "attitude":  # which a log seldom repeats
                    independent += corrects * size**2
                else:
                    shared.append(size[:, :, None] * axes)
        return np.concatenate(shared, axis=2), independent

    def by_term(self, dwells: DwellSet, term: TypeB) -> Array:
        """Errors [n, 3, g] of corrected dwells against the reference for one standard uncertainty
        of a type B term: on the reference's angles, the thermometer, an indication or a
        coefficient; 0 of any other.
        """
        indication, temperature = dwells.indication, dwells.temperature
        shifted_inputs = {}
        if term.quantity in {*ATTITUDE, forms.TEMPERATURE}:
            field = FIELDS[term.quantity]
            shifted_inputs[field] = getattr(dwells, field) + term.u_of(0.0)
        elif term.quantity in forms.COMPONENTS:
            axis, offset = forms.COMPONENTS.index(term.quantity), np.zeros_like(indication)
            offset[:, axis] = term.u_of(1.0) * (
                indication[:, axis] if term.unit in RELATIVE else 1.0
            )
            shifted_inputs["indication"] = indication + offset
        if shifted_inputs:
            shifted_dwells = replace(dwells, **shifted_inputs)
            by_input = self(shifted_dwells.indication, shifted_dwells.temperature) - self(
                indication, temperature
            )
            # without angles, lengths do not depend on them
            return by_input + np.nan_to_num(shifted_dwells.reference - dwells.reference)
        result_name, errors = term.result or term.quantity, np.zeros_like(indication)
        readings, _ = within_ranges(self.models[0], forms.inputs(indication, temperature))
        for axis, model in enumerate(self.models):
            for j, c in enumerate(model.coefficients):
                if result_name in {c.name, f"{model.name}.{c.name}"}:
                    size = type_b.combine_terms((term,), (result_name,), c.value, c.unit)
                    axes = slice(None) if len(self.models) == 1 else axis
                    errors[:, axes] = size * self.form.gradient(model, readings)[..., j]
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
    stage_name = find_stage(compensation)
    for stage in stages:
        if stage.stage == stage_name:
            return Correction.of(stage)
    raise CoefficientError(
        f"the run holds no {stage_name}.json", hint="it is not a run of accelerometer"
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
        t, terms = float(fitted.triad.mapped(fitted.q.value("temperature"))), fitted.triad.terms
        exact = fitted.triad.fit.of(
            lambda p: q_factor.exact_matrix(q_factor.axes_from_angles(terms.small_angles(p, t)))
        )
        exact_figures = [
            Figure(f"Q_exact_{row}{column}", float(exact.value[i, j]), "1", float(exact.u[i, j]))
            for i, row in enumerate(AXES)
            for j, column in enumerate(AXES[: i + 1])
        ]
        figures = (*exact_figures, *fitted.intervals)
        results += [
            StageResult("accel_q", (fitted.q,), figures, flags, conditions),
            StageResult("accel_affine", (fitted.affine,), attitude_figures, flags, conditions),
        ]
    return tuple(results)


def find_sensitivities(
    fitted: TriadFit, dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[Sensitivity, ...]:
    """Sensitivities of the coefficients of a fit to `dwells`, by fits to dwells that are shifted by
    an error of the thermometer, of the table's angles and, where it divides what is logged, of
    local gravity.
    """
    errors = [*of_thermometer(forms.TEMPERATURE, *dwells.valid[forms.TEMPERATURE])]
    if spec.reference.kind == "attitude":
        errors += [InputError(name, "offset", ANGLE_STEP_DEG) for name in ATTITUDE]
    gravity = spec.site.local_gravity()
    units = [spec.columns[name].unit for name in forms.COMPONENTS if name in spec.columns]
    if gravity is not None and "m/s^2" in units:
        errors.append(InputError("gravity_mps2", "offset", GRAVITY_STEP * gravity))
    shifted = []
    for error in errors:
        field = FIELDS[error.input]
        values = getattr(dwells, field)
        # a larger gravity makes what is logged in m/s² a smaller multiple of it
        is_gravity = error.input == "gravity_mps2"
        moved_dwells = values / (1.0 + GRAVITY_STEP) if is_gravity else error.shift(values)
        shifted.append(replace(dwells, **{field: moved_dwells}))
    refits = {}
    triads = fitted.triad.shifted(dwells, shifted)
    for error, moved_dwells, triad in zip(errors, shifted, triads, strict=True):
        k, q, affine = list_models(moved_dwells, spec, triad)
        refit = replace(fitted, triad=triad, k=k, q=q, affine=affine, intervals=())
        refits[error] = list_results(refit, moved_dwells, gravity, ())
    return differentiate(errors, list_results(fitted, dwells, gravity, ()), refits.__getitem__)
