"""Dwells under a correction → errors of inclination and toolface, and what a recipe accepts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Criterion, Figure, Model, at_most, over_u
from calibkit.errors import FitError
from calibkit.fit.unseen import unseen
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.coefficient_files import Correction
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.recipe.type_b import TypeB

TOOLFACE_RANGE_DEG = (10.0, 170.0)
"""Default inclination range [°] in which toolface errors are quoted."""


@dataclass(frozen=True, slots=True)
class AttitudeErrors:
    """Inclination and toolface errors of n dwells against a reference attitude; toolface errors
    only within an inclination range.
    """

    inclination_error_deg: Array
    """[n], indicated minus reference [°]."""
    toolface_error_deg: Array
    """[n], indicated minus reference in (−180, 180] [°], NaN outside the inclination range."""
    inclination_range_deg: tuple[float, float]
    """Range of reference inclination [°] that the toolface figures refer to."""
    inclination_rms_deg: float
    inclination_max_deg: float
    toolface_rms_deg: float
    """NaN where no dwell lies in the inclination range."""
    toolface_max_deg: float
    toolface_scaled_max_deg: float
    """Largest |toolface error| · sin(inclination) in the range [°]: hardly depends on the range,
    because toolface errors grow as 1/sin(inclination).
    """


@dataclass(frozen=True, slots=True)
class DwellErrors:
    """Errors of a set of dwells against the reference."""

    residual: Array
    """Residuals of the components [n, 3, g], or of the magnitude of gravity [n, 1, g]."""
    angles: AttitudeErrors | None
    """Attitude errors; None where the magnitude of gravity is the only reference."""
    noise_g: float = np.nan
    """Noise of a dwell by the fit of the correction [g]; NaN where nothing is corrected."""

    @property
    def residual_rms_g(self) -> float:
        """Root mean square of the residual [g]."""
        return rms(self.residual)

    def judge_errors(self, spec: AccelerometerRecipe) -> tuple[Criterion, ...]:
        """Criteria of the recipe's acceptance limits on the corrected dwells."""
        limits, angles = spec.acceptance, self.angles
        over_noise = self.residual_rms_g / self.noise_g if self.noise_g > 0.0 else 0.0
        stated = [
            ("residual rms", self.residual_rms_g, limits.max_residual_rms_g, "g"),
            ("residual over noise", over_noise, limits.max_residual_over_noise, "1"),
        ]
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

    def judge_uncertainty(
        self, name: str, dwells: DwellSet, correction: Correction, terms: Sequence[TypeB] = ()
    ) -> Criterion:
        """Criterion that the errors of unseen, corrected dwells are as large as their uncertainty
        states, whose parts of the coefficients and of type B terms they share.
        """
        shared, own = correction.uncertainty(dwells)
        known = [correction.by_term(dwells, term) for term in terms]
        shared = np.concatenate([shared, *(part[:, :, None] for part in known)], axis=2)
        if self.angles is None:  # lengths: along the corrected vector
            vector = correction(dwells.indication, dwells.temperature)
            unit = vector / np.linalg.norm(vector, axis=1)[:, None]
            shared = np.einsum("ni,nik->nk", unit, shared)[:, None]
            own = np.sum(unit**2 * own, axis=1)[:, None]
        judged = unseen(
            self.residual.ravel(),
            shared.reshape(self.residual.size, -1),
            own.ravel(),
            dof=correction.dof,
        )
        return over_u(f"{name}: rms error", judged.to_object())

    @classmethod
    def compare(
        cls, dwells: DwellSet, spec: AccelerometerRecipe, correction: Correction | None = None
    ) -> Self:
        """Errors of dwells against the reference attitudes or the magnitude of gravity, for raw
        indications or, where a correction is given, for corrected components.
        """
        vector, noise = dwells.indication, np.nan
        if correction is not None:
            vector, noise = correction(vector, dwells.temperature), correction.noise_g
        if spec.reference.kind == "magnitude":
            return cls(np.linalg.norm(vector, axis=1)[:, None] - 1.0, None, noise)
        angles = _attitude_errors(
            vector,
            dwells.inclination,
            dwells.toolface,
            inclination_range_deg=spec.toolface_range_deg,
        )
        return cls(vector - dwells.reference, angles, noise)


def propagate_uncertainty(
    affine: Model, dwells: DwellSet, toolface_range_deg: tuple[float, float]
) -> tuple[Figure, ...]:
    """Largest standard uncertainties (type A) of inclination and toolface over the dwells,
    propagated from the covariance of the coefficients and the residual of an affine model.

    The toolface uncertainty is multiplied by sin(inclination) and limited to the inclination range.
    """
    at = forms.inputs(dwells.indication, dwells.temperature)
    vector, slopes = forms.TRIAD.evaluate(affine, at), forms.TRIAD.gradient(affine, at)
    covariance = slopes @ np.array(affine.covariance) @ np.swapaxes(slopes, 1, 2)
    covariance += affine.residual_rms**2 * np.eye(3)
    u_inclination, u_toolface = _attitude_uncertainty(vector, covariance)
    tilt = attitude.inclination(vector)
    inside = (tilt >= toolface_range_deg[0]) & (tilt <= toolface_range_deg[1])
    figures = [
        Figure("inclination_standard_uncertainty_max", float(u_inclination.max()), "deg", 0.0)
    ]
    if inside.any():
        scaled = float((u_toolface * np.sin(np.radians(tilt)))[inside].max())
        figures.append(Figure("toolface_sin_standard_uncertainty_max", scaled, "deg", 0.0))
    return tuple(figures)


def _attitude_errors(
    vector: Array,
    inclination_deg: Array,
    toolface_deg: Array,
    *,
    inclination_range_deg: tuple[float, float] = TOOLFACE_RANGE_DEG,
) -> AttitudeErrors:
    """Inclination and toolface errors of gravity vectors [n, 3] against reference angles [n] [°].

    Toolface errors grow as 1/sin(inclination): they are given between the two inclinations of the
    range [°] and NaN elsewhere, and their largest value is also given multiplied by
    sin(inclination).
    """
    low, high = inclination_range_deg
    if not 0.0 < low < high < 180.0:
        raise FitError(
            f"a toolface cannot be quoted for inclinations {low:g}..{high:g}°",
            hint=(
                "the range lies inside 0..180°, both ends excluded: there the toolface does not"
                " exist"
            ),
        )
    tilt = attitude.inclination(vector) - inclination_deg
    inside = (inclination_deg >= low) & (inclination_deg <= high)
    roll = np.where(inside, attitude.wrapped(attitude.toolface(vector) - toolface_deg), np.nan)
    scaled = (roll * np.sin(np.radians(inclination_deg)))[inside]
    return AttitudeErrors(
        inclination_error_deg=tilt,
        toolface_error_deg=roll,
        inclination_range_deg=(low, high),
        inclination_rms_deg=rms(tilt),
        inclination_max_deg=_largest(tilt),
        toolface_rms_deg=rms(roll[inside]),
        toolface_max_deg=_largest(roll[inside]),
        toolface_scaled_max_deg=_largest(scaled),
    )


def _attitude_uncertainty(vector: Array, covariance: Array) -> tuple[Array, Array]:
    """Standard uncertainties [n], [n] [°] of inclination and toolface from the covariance [n, 3, 3]
    of vectors [n, 3].

    First order (GUM 5.2.2). For a vertical vector the toolface uncertainty is NaN, and the
    inclination uncertainty is the root mean square of the two horizontal components.
    """
    gx, gy, gz = np.moveaxis(vector, -1, 0)
    flat, square = np.hypot(gx, gy), np.sum(vector**2, axis=-1)
    upright = flat == 0.0
    radius = np.where(upright, 1.0, flat)
    toward = np.stack([gx * gz / radius, gy * gz / radius, -flat], axis=-1) / square[..., None]
    around = np.stack([gy, -gx, np.zeros_like(gx)], axis=-1) / (radius**2)[..., None]
    tilt = np.einsum("...i,...ij,...j->...", toward, covariance, toward)
    roll = np.einsum("...i,...ij,...j->...", around, covariance, around)
    level = (covariance[..., 0, 0] + covariance[..., 1, 1]) / (2.0 * square)
    inclination_deg = np.degrees(np.sqrt(np.where(upright, level, tilt)))
    return inclination_deg, np.where(upright, np.nan, np.degrees(np.sqrt(roll)))


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if values.size else float("nan")
