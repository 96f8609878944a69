"""Dwells and a correction → inclination and toolface errors before and after, with what the summary
and figures need.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Figure, at_most
from calibkit.instruments.accelerometer.figures import TriadReport
from calibkit.instruments.accelerometer.numeric import affine as accel_affine
from calibkit.instruments.accelerometer.numeric import affine_model, q_factor
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table, number_or_none

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Array
    from calibkit.coefficients import Criterion
    from calibkit.instruments.accelerometer.coefficient_files import Correction
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.fit import Triad, TriadFit
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe


STANDS = {"affine": "affine", "k": "K-factor", "kq": "K- and Q-factor"}
"""Correction that a recipe names → what its row is called."""


@dataclass(frozen=True, slots=True)
class Stand:
    """How a set of dwells stands under one correction: errors against the reference, residual of
    each component [g].
    """

    name: str
    vector: Array
    errors: attitude.AttitudeErrors | None
    residual_rms_g: float
    residual: Array


def stand(name: str, vector: Array, dwells: DwellSet, spec: AccelerometerRecipe) -> Stand:
    """Errors of vectors [n, 3, g]: against reference attitudes, or against the length of gravity
    alone.
    """
    if spec.reference.kind == "magnitude":
        residual = np.linalg.norm(vector, axis=1)[:, None] - 1.0
        return Stand(name, vector, None, rms(residual), residual)
    residual = vector - dwells.reference
    errors = attitude.errors(
        vector, dwells.inclination, dwells.toolface, inclination_range_deg=spec.toolface_range_deg
    )
    return Stand(name, vector, errors, rms(residual), residual)


def before_after(
    dwells: DwellSet, corrections: Sequence[tuple[str, Correction]], spec: AccelerometerRecipe
) -> list[Stand]:
    """The indication as it is, then under each correction."""
    stands = [stand("indication", dwells.indication, dwells, spec)]
    for name, correction in corrections:
        stands.append(stand(name, correction(dwells.indication, dwells.temperature), dwells, spec))
    return stands


def propagated(
    affine: Triad, dwells: DwellSet, toolface_range_deg: tuple[float, float]
) -> tuple[Figure, ...]:
    """Largest standard uncertainties (type A) of inclination and toolface over the dwells, from
    coefficients and residual.

    The toolface's is given times sin(inclination), over the inclinations of the range.
    """
    entries = [accel_affine.entry_of(name) for name in affine.names]
    vector, slopes = affine_model.evaluate(
        entries, affine.coefficients, dwells.indication, dwells.temperature
    )
    covariance = slopes @ affine.covariance @ np.swapaxes(
        slopes, 1, 2
    ) + affine.residual_rms**2 * np.eye(3)
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


def table(stands: Sequence[Stand], spec: AccelerometerRecipe, title: str) -> Table:
    """Attitude errors under each correction; the toolface only with its inclination range."""
    if spec.reference.kind == "magnitude":
        lengths = tuple((s.name, f"{1e6 * s.residual_rms_g:.1f}") for s in stands)
        return Table(title, ("", "| |G| - g | rms [µg]"), lengths)
    low, high = spec.toolface_range_deg
    heads = (
        "",
        "residual rms [µg]",
        "inclination rms, max [°]",
        f"toolface rms, max [°], {low:g}-{high:g}°",
        "max toolface·sin(incl.) [°]",
    )
    rows = tuple(
        (
            s.name,
            f"{1e6 * s.residual_rms_g:.1f}",
            f"{number(s.errors.inclination_rms_deg, 3)}, {number(s.errors.inclination_max_deg, 3)}",
            f"{number(s.errors.toolface_rms_deg, 3)}, {number(s.errors.toolface_max_deg, 3)}",
            number(s.errors.toolface_scaled_max_deg, 3),
        )
        for s in stands
        if s.errors is not None
    )
    return Table(title, heads, rows)


def criteria(last: Stand, spec: AccelerometerRecipe) -> tuple[Criterion, ...]:
    """Acceptance limits of the recipe on the corrected dwells."""
    limits, found = spec.acceptance, []
    if last.errors is not None and limits.max_inclination_error_deg is not None:
        value, limit = last.errors.inclination_max_deg, limits.max_inclination_error_deg
        found.append(at_most("largest inclination error", value, limit, "deg"))
    if last.errors is not None and limits.max_toolface_error_sin_deg is not None:
        value, limit = last.errors.toolface_scaled_max_deg, limits.max_toolface_error_sin_deg
        found.append(at_most("largest toolface error times sin(inclination)", value, limit, "deg"))
    if limits.max_residual_rms_g is not None:
        value, limit = last.residual_rms_g, limits.max_residual_rms_g
        found.append(at_most("residual rms", value, limit, "g"))
    return tuple(found)


def improved(stands: Sequence[Stand]) -> Criterion:
    """Correction may not make unseen dwells worse than they were."""
    share = (
        stands[1].residual_rms_g / stands[0].residual_rms_g
        if stands[0].residual_rms_g > 0.0
        else 1.0
    )
    return at_most("residual rms after/before", share, 1.0, "1")


def coefficient_tables(fitted: TriadFit) -> tuple[Table, ...]:
    """K of the three axes and Q with standard uncertainties."""
    tables = []
    if fitted.k:
        rows = tuple(
            (
                f"K{k}",
                *(
                    f"{axis.coefficients[k]:.6e} ± {axis.standard_uncertainty[k]:.0e}"
                    for axis in fitted.k
                ),
            )
            for k in range(10)
        )
        title = "K-factor for °C (± standard uncertainty, type A)"
        tables.append(Table(title, ("", "accel_x", "accel_y", "accel_z"), rows))
    if fitted.affine is not None:
        u = np.sqrt(np.diag(fitted.q_covariance))
        pairs = zip(q_factor.NAMES, fitted.q, u, strict=True)
        rows = tuple((n, f"{1e3 * value:.4f} ± {1e3 * error:.4f}") for n, value, error in pairs)
        tables.append(
            Table(f"Q-factor at {fitted.q_temperature:.1f} °C [mrad]", ("", "small-angle"), rows)
        )
    return tuple(tables)


def summary(
    fitted: TriadFit, stands: Sequence[Stand], spec: AccelerometerRecipe, figures: Sequence[Figure]
) -> Summary:
    """What the console says of a fit."""
    shown = [*coefficient_tables(fitted), table(stands, spec, "The fitted dwells before and after")]
    if figures:
        rows = tuple((figure.name, number(figure.value, 2), figure.unit) for figure in figures)
        shown.append(
            Table("Uncertainty of one corrected dwell (type A)", ("", "largest", "unit"), rows)
        )
    return Summary(spec.title, tuple(shown), fitted.flags, criteria(_chosen(stands, spec), spec))


def _chosen(stands: Sequence[Stand], spec: AccelerometerRecipe) -> Stand:
    """The stand under the correction that `apply` will use."""
    return next(s for s in stands if s.name == STANDS[spec.compensation])


def drawing(dwells: DwellSet, stands: Sequence[Stand], spec: AccelerometerRecipe) -> TriadReport:
    """What the figures show."""
    last = _chosen(stands, spec)
    first = stands[0]
    nan = np.full(len(dwells.indication), np.nan)
    return TriadReport(
        dwells.temperature,
        dwells.indication,
        last.residual,
        first.errors.inclination_error_deg if first.errors else nan,
        last.errors.inclination_error_deg if last.errors else nan,
        first.errors.toolface_error_deg if first.errors else nan,
        last.errors.toolface_error_deg if last.errors else nan,
        dwells.inclination,
        spec.toolface_range_deg,
    )


def entry(file: str, sha256: str, rows: int, stands: Sequence[Stand]) -> dict[str, object]:
    """JSON object of one validated log."""
    return {
        "name": file,
        "sha256": sha256,
        "rows": rows,
        "before": _figures(stands[0]),
        "after": _figures(stands[1]),
    }


def _figures(s: Stand) -> dict[str, object]:
    """Figures of one stand; the toolface with its inclination range."""
    found: dict[str, object] = {"residual_rms_g": s.residual_rms_g}
    if s.errors is not None:
        found |= {
            "inclination_rms_deg": s.errors.inclination_rms_deg,
            "inclination_max_deg": s.errors.inclination_max_deg,
            "toolface_rms_deg": number_or_none(s.errors.toolface_rms_deg),
            "toolface_max_deg": number_or_none(s.errors.toolface_max_deg),
            "toolface_sin_max_deg": number_or_none(s.errors.toolface_scaled_max_deg),
            "toolface_inclination_range_deg": list(s.errors.inclination_range_deg),
        }
    return found
