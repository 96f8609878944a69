"""Fits of a triad → accel_k.json, accel_q.json, accel_affine.json → corrected indications."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Condition, Figure, Model, Record, StageResult
from calibkit.errors import CoefficientError
from calibkit.forms import Form, within_ranges
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.fit import TriadFit
from calibkit.numeric import chunks, gum
from calibkit.numeric.dispersion import rms

STAGES = {"accel_k": forms.K, "accel_q": forms.Q, "accel_affine": forms.AFFINE}
"""Stage → form of its models; the stage names its coefficient file."""
COMPENSATIONS = {
    "k": ("accel_k",),
    "kq": ("accel_k", "accel_q"),
    "affine": ("accel_affine",),
}
"""Compensation of a recipe → stages that correct the indications, in the order of application."""


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a triad's indications by the models of one or more stages, applied in order."""

    stages: tuple[tuple[Form, tuple[Model, ...]], ...]

    @property
    def temperature_range(self) -> tuple[float, float]:
        """Temperature range [°C] of the calibration."""
        return self.stages[0][1][0].valid[forms.TEMPERATURE]

    @property
    def noise_g(self) -> float:
        """Noise of a component of a dwell [g], by the fit: residual rms of its models."""
        return rms([model.residual_rms for model in self.stages[0][1]])

    def __call__(self, indication: Array, temperature: Array) -> Array:
        """Corrected components [n, 3, g] of indications [n, 3, g]; temperatures [n, °C] are clamped
        to the range of the calibration.
        """
        for form, models in self.stages:
            at, _ = within_ranges(models[0], forms.inputs(indication, temperature))
            indication = np.column_stack([form.evaluate(model, at) for model in models])
        return indication

    def uncertainty(self, indication: Array, temperature: Array) -> tuple[Array, Array]:
        """Type A uncertainty of corrected components [n, 3, g] of a log of its own: errors that its
        dwells share [n, 3, k, g], and variances [n, 3, g²] of those that they do not.
        """
        shared, own, dwells = [], np.zeros_like(indication), len(indication)
        for form, models in self.stages:
            at, _ = within_ranges(models[0], forms.inputs(indication, temperature))
            for axis, model in enumerate(models):
                along = np.eye(3) if len(models) == 1 else np.eye(3)[:, axis : axis + 1]
                slopes = form.gradient(model, at) @ gum.square_root(np.array(model.covariance))
                slopes = slopes.reshape(dwells, along.shape[1], -1)
                shared.append(np.einsum("ia,nak->nik", along, slopes))
                own += along.sum(axis=1) * model.residual_rms**2
                for part in model.components:
                    size = part.value * (indication if part.unit == "1" else np.ones((dwells, 3)))
                    if part.group == "attitude":  # which a log seldom repeats
                        own += along.sum(axis=1) * size**2
                    else:
                        shared.append(size[:, :, None] * along)
            indication = np.column_stack([form.evaluate(model, at) for model in models])
        return np.concatenate(shared, axis=2), own

    @property
    def dof(self) -> tuple[float, float]:
        """Fewest effective degrees of freedom of a coefficient, and those of the residuals."""
        models = [model for _, models in self.stages for model in models]
        coefficients = (model.dof_of(c) for model in models for c in model.coefficients)
        return max(min(coefficients), 1.0), max(min(model.dof for model in models), 1.0)

    def outside(self, temperature: Array) -> float:
        """Share of the temperatures [n, °C] that are outside the calibrated range and clamped."""
        low, high = self.temperature_range
        return (
            chunks.count(temperature, lambda part: (part < low) | (part > high)) / temperature.size
        )


def find_correction(compensation: str, stages: Iterable[Record | StageResult]) -> Correction:
    """Correction that a recipe names, from the stages of a run or of a fit; raises CoefficientError
    for a missing stage.
    """
    models = {stage.stage: stage.models for stage in stages}
    for name in COMPENSATIONS[compensation]:
        if name not in models:
            raise CoefficientError(
                f"the run holds no {name}.json", hint="it is not a run of accelerometer"
            )
    return Correction(tuple((STAGES[name], models[name]) for name in COMPENSATIONS[compensation]))


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
    results = []
    if fitted.k:
        flags = tuple(dict.fromkeys((*fitted.k_flags, *fitted.k_not_fitted)))
        results.append(StageResult("accel_k", fitted.k, (), flags, conditions))
    if fitted.q is not None and fitted.affine is not None:
        flags = tuple(dict.fromkeys((*dwells.flags, *fitted.affine_flags)))
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
