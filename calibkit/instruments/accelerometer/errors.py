"""Dwells under a correction → errors of inclination and toolface, and what a recipe accepts."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Criterion, Figure, Model, at_most
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.coefficient_files import Correction
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms


@dataclass(frozen=True, slots=True)
class DwellErrors:
    """Errors of a set of dwells against the reference."""

    residual: Array
    """Of each component [n, 3, g], or of the length of gravity alone [n, 1, g]."""
    angles: attitude.AttitudeErrors | None
    """Of inclination and toolface; None where the length of gravity is the reference."""

    @property
    def residual_rms_g(self) -> float:
        """Root mean square of the residual [g]."""
        return rms(self.residual)


def compare_dwells(
    dwells: DwellSet, spec: AccelerometerRecipe, correction: Correction | None = None
) -> DwellErrors:
    """Errors of dwells against reference attitudes, or against the length of gravity alone: of the
    indication, or as a correction leaves it.
    """
    vector = dwells.indication
    if correction is not None:
        vector = correction(vector, dwells.temperature)
    if spec.reference.kind == "magnitude":
        return DwellErrors(np.linalg.norm(vector, axis=1)[:, None] - 1.0, None)
    angles = attitude.errors(
        vector, dwells.inclination, dwells.toolface, inclination_range_deg=spec.toolface_range_deg
    )
    return DwellErrors(vector - dwells.reference, angles)


def propagate_uncertainty(
    affine: Model, dwells: DwellSet, toolface_range_deg: tuple[float, float]
) -> tuple[Figure, ...]:
    """Largest standard uncertainties (type A) of inclination and toolface over the dwells, from
    coefficients and residual of an affine model.

    The toolface's is given times sin(inclination), over the inclinations of the range.
    """
    at = forms.inputs(dwells.indication, dwells.temperature)
    vector, slopes = forms.AFFINE.evaluate(affine, at), forms.AFFINE.gradient(affine, at)
    covariance = slopes @ np.array(affine.covariance) @ np.swapaxes(slopes, 1, 2)
    covariance += affine.residual_rms**2 * np.eye(3)
    u_inclination, u_toolface = attitude.standard_uncertainty(vector, covariance)
    tilt = attitude.inclination(vector)
    inside = (tilt >= toolface_range_deg[0]) & (tilt <= toolface_range_deg[1])
    figures = [
        Figure("inclination_standard_uncertainty_max", float(u_inclination.max()), "deg", 0.0)
    ]
    if inside.any():
        scaled = float((u_toolface * np.sin(np.radians(tilt)))[inside].max())
        figures.append(Figure("toolface_sin_standard_uncertainty_max", scaled, "deg", 0.0))
    return tuple(figures)


def judge_errors(after: DwellErrors, spec: AccelerometerRecipe) -> tuple[Criterion, ...]:
    """Acceptance limits of the recipe on the corrected dwells."""
    limits, angles = spec.acceptance, after.angles
    stated = [("residual rms", after.residual_rms_g, limits.max_residual_rms_g, "g")]
    if angles is not None:
        inclination, toolface = angles.inclination_max_deg, angles.toolface_scaled_max_deg
        scaled = "largest toolface error times sin(inclination)"
        stated = [
            ("largest inclination error", inclination, limits.max_inclination_error_deg, "deg"),
            (scaled, toolface, limits.max_toolface_error_sin_deg, "deg"),
            *stated,
        ]
    return tuple(
        at_most(name, value, limit, unit)
        for name, value, limit, unit in stated
        if limit is not None
    )


def judge_improvement(before: DwellErrors, after: DwellErrors) -> Criterion:
    """Correction may not make unseen dwells worse than they were."""
    rms_before = before.residual_rms_g
    share = after.residual_rms_g / rms_before if rms_before > 0.0 else 1.0
    return at_most("residual rms after/before", share, 1.0, "1")
