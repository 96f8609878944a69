"""Any number of gyros over three table axes: sensitivity vectors, angles between input axes,
misalignment matrix.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric import scale_factor
from calibkit.instruments.gyro_scale.numeric.scale_factor import RunScales
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

COLLINEAR = 4.0
"""Distance of an angle from 0° or 180°, in standard uncertainties, below which its first-order
uncertainty is flagged.
"""


@dataclass(frozen=True, slots=True)
class Triad:
    """Sensitivity vectors of g gyros in the axes of the table."""

    sensitivity: Array
    """s_g = (K_gx, K_gy, K_gz) [g, 3], scale factor about each table axis."""
    covariance: Array
    """[g, 3, g, 3] of the sensitivities; type A."""
    magnitude: Array
    """|s_g| [g]: scale factor about the gyro's own input axis."""
    magnitude_uncertainty: Array
    misalignment: Array
    """Misalignment matrix [g, 3]: the unit vectors u_g = s_g/|s_g| as rows; the identity for an
    ideal triad.
    """
    misalignment_uncertainty: Array
    """[g, 3]."""
    angles_deg: Array
    """Angles between the input axes [g, g] [°]."""
    angle_uncertainty_deg: Array
    """[g, g] [°], first order; flagged where an angle is within noise of 0° or 180°."""
    flags: tuple[str, ...]
    angle_dof: Array
    """Effective degrees of freedom of the angles [g, g]; infinite where noise alone is known."""


@dataclass(frozen=True, slots=True)
class TriadOverTemperature:
    """Sensitivities of g gyros as polynomials of temperature in °C, each of its own order."""

    curves: tuple[tuple[TemperaturePolynomial, ...], ...]
    """[g][3]."""

    @property
    def valid_degc(self) -> tuple[float, float]:
        """Fitted temperature range [°C]."""
        return self.curves[0][0].valid_degc

    def at(self, temp_degc: float) -> Triad:
        """Triad at a temperature [°C], which is clamped to the fitted range with a flag."""
        points = [[curve.at(temp_degc) for curve in row] for row in self.curves]
        sensitivity = np.array([[float(value[0]) for value, _ in row] for row in points])
        u = np.array([[float(u[0]) for _, u in row] for row in points])
        low, high = self.valid_degc
        flag = f"{temp_degc:g} °C is outside the fitted {low:g} to {high:g} °C: clamped"
        return _triad(
            sensitivity, np.diag(u.ravel() ** 2), flags=() if low <= temp_degc <= high else (flag,)
        )


def from_runs(
    about_x: RunScales,
    about_y: RunScales,
    about_z: RunScales,
    *,
    mounting_deg: tuple[float, float] = (0.0, float("inf")),
) -> Triad:
    """Triad from one table run about each axis, the same gyros in the same order in all three.

    `mounting_deg` is the standard deviation of the tilt of each mounting, about each of the two
    axes across the table's, and its degrees of freedom.
    """
    runs = (about_x, about_y, about_z)
    count = {run.K.size for run in runs}
    if len(count) > 1:
        raise FitError(
            f"the runs about the three axes have {', '.join(str(run.K.size) for run in runs)} gyros"
        )
    size = count.pop()
    covariance, mounted = np.zeros((size, 3, size, 3)), np.zeros((size, 3, size, 3))
    sensitivity = np.column_stack([run.K for run in runs])
    for axis, run in enumerate(runs):
        # gyros of one run share samples and mounting, the three runs do not
        covariance[:, axis, :, axis] = run.covariance
        across = np.radians(mounting_deg[0]) * np.delete(sensitivity, axis, axis=1)
        mounted[:, axis, :, axis] = across @ across.T
    noise, full = (
        _triad(sensitivity, part.reshape(3 * size, 3 * size))
        for part in (covariance, covariance + mounted)
    )
    share = full.angle_uncertainty_deg**2 - noise.angle_uncertainty_deg**2
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = mounting_deg[1] * (full.angle_uncertainty_deg**2 / share) ** 2
    return replace(full, angle_dof=np.where(share > 0.0, dof, np.inf))


def _triad(sensitivity: Array, covariance: Array, *, flags: Sequence[str] = ()) -> Triad:
    """Angles and misalignment of g gyros from their scale factors about three orthogonal table
    axes.

    Parameters
    ----------
    sensitivity : [g, 3], row g the scale factors of gyro g about x, y, z.
    covariance : [3 g, 3 g] of the sensitivities, gyro by gyro.

    Returns
    -------
    Triad: u_g = s_g/|s_g|, α_gh = atan2(|u_g × u_h|, u_g · u_h), which loses no digits near 0° and
    180°.

    Raises
    ------
    FitError
        Values that are not finite, or a gyro that senses none of the axes.

    """
    count = len(sensitivity)
    if not (np.isfinite(sensitivity).all() and np.isfinite(covariance).all()):
        raise FitError("a sensitivity is not finite", hint="check the run about each axis")
    size = np.linalg.norm(sensitivity, axis=1)
    if not (size > 0.0).all():
        raise FitError(f"gyro {int(np.argmin(size)) + 1} senses none of the three table axes")
    unit = sensitivity / size[:, None]
    full = covariance.reshape(count, 3, count, 3)
    u_size = np.sqrt(np.einsum("ga,gagb,gb->g", unit, full, unit))
    across = (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / size[:, None, None]
    u_unit = np.sqrt(np.einsum("gij,gjgk,gik->gi", across, full, across))
    angles, uncertainty = np.zeros((count, count)), np.zeros((count, count))
    for g in range(count):
        for h in range(g + 1, count):
            angles[g, h], uncertainty[g, h] = _angle(unit, size, full, g, h)
    angles, uncertainty = angles + angles.T, uncertainty + uncertainty.T
    near = np.minimum(angles, 180.0 - angles) < COLLINEAR * uncertainty
    noted = [
        f"gyros {g + 1} and {h + 1} are collinear within noise"
        for g, h in np.argwhere(np.triu(near, 1))
    ]
    if np.linalg.matrix_rank(unit, tol=1e-6) < 3:
        noted.append("the gyros do not span three axes: the compensation leaves rates out")
    return Triad(
        sensitivity=sensitivity,
        covariance=full,
        magnitude=size,
        magnitude_uncertainty=u_size,
        misalignment=unit,
        misalignment_uncertainty=u_unit,
        angles_deg=angles,
        angle_uncertainty_deg=uncertainty,
        flags=(*flags, *noted),
        angle_dof=np.full((count, count), np.inf),
    )


def _angle(unit: Array, size: Array, covariance: Array, g: int, h: int) -> tuple[float, float]:
    """Angle [°] between two input axes and its standard uncertainty [°], to first order."""
    a, b = unit[g], unit[h]
    cosine, sine = float(a @ b), float(np.linalg.norm(np.cross(a, b)))
    angle = float(np.degrees(np.arctan2(sine, cosine)))
    if sine < 1e-12:
        # every direction across the axis is possible: the largest variance counts
        spread = covariance[g, :, g, :] / size[g] ** 2 + covariance[h, :, h, :] / size[h] ** 2
        return angle, float(np.degrees(np.sqrt(np.linalg.eigvalsh(spread)[-1])))
    toward_b, toward_a = (b - cosine * a) / sine, (a - cosine * b) / sine
    gradient = np.concatenate((-toward_b / size[g], -toward_a / size[h]))
    rows = np.ix_((g, h), range(3), (g, h), range(3))
    return angle, float(
        np.degrees(np.sqrt(max(gradient @ covariance[rows].reshape(6, 6) @ gradient, 0.0)))
    )


def over_temperature(
    triads: Sequence[Triad], temp_degc: Array, *, order: int | None = None
) -> TriadOverTemperature:
    """Fit each entry of the sensitivities of t triads at temperatures [t] [°C] as a polynomial.

    The order is by default each entry's of least leave-one-temperature-out error. Raises FitError
    for fewer temperatures than coefficients. The covariance is the larger of scatter and noise.
    """

    def curve(g: int, axis: int) -> TemperaturePolynomial:
        values = np.array([entry.sensitivity[g, axis] for entry in triads])
        noise = np.sqrt([entry.covariance[g, axis, g, axis] for entry in triads])
        return scale_factor.over_temperature(values, noise, temp_degc, order=order)

    count = len(triads[0].sensitivity)
    return TriadOverTemperature(
        tuple(tuple(curve(g, axis) for axis in range(3)) for g in range(count))
    )
