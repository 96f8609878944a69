"""Detection of a wrong latitude: it causes a scatter of the roots of s that the noise of the
readings does not explain.
"""

from collections.abc import Mapping

import numpy as np

from calibkit.instruments.inclinometer.forms import ScaleFit
from calibkit.instruments.inclinometer.numeric import root_choice
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.solve import SolvedStations
from calibkit.instruments.inclinometer.stations import Stations

SCATTERS = 3.0
"""Scatter of s, in standard uncertainties of a root, above which it is flagged; 16 simulated
sensors showed 0 to 1.6.
"""
STEP_DEG = 0.02
"""Step of latitude [°] for the numerical derivative of the roots of s."""
SIGNIFICANT, LEAST_DEG = 4.0, 0.03
"""Least offset of the latitude that is reported, in standard uncertainties and in degrees."""
FEWEST = 5
"""Fewest stations, beyond the number of coefficients of s(T), for an estimate of the latitude."""


def flag_latitude(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: SolvedStations,
    spec: InclinometerRecipe,
) -> list[str]:
    """Flags of gyros with more scatter of s than their readings explain; each states the latitude
    that would explain it, or other causes.
    """
    flags = []
    for axis, fit in fits.items():
        u = seen.solutions[axis].s_root_uncertainty[fit.used]
        expected = float(np.median(u)) if u.size else 0.0
        if not expected or not fit.dof or fit.model.scatter <= SCATTERS * expected:
            continue
        what = (
            f"{axis}: s scatters by {fit.model.scatter:.1e} beyond its readings, which are good for"
            f" {expected:.1e}"
        )
        offset, u_offset = _fit_offset(axis, fit, stations, seen, spec)
        stated = spec.site.latitude_deg
        reason = (
            "see that site.latitude_deg is right and the gyro does not change from station to"
            " station"
            if abs(offset) < max(SIGNIFICANT * u_offset, LEAST_DEG)
            else f"the stations fit a latitude of {stated + offset:.2f}° ± {u_offset:.2f}°,"
            f" site.latitude_deg says {stated:g}°"
        )
        flags.append(f"{what} ({fit.model.scatter / expected:.1f} times): {reason}")
    return flags


def _fit_offset(
    axis: Sensor, fit: ScaleFit, stations: Stations, seen: SolvedStations, spec: InclinometerRecipe
) -> tuple[float, float]:
    """Latitude fitted to the stations minus the recipe's, and its standard uncertainty [°]; 0 where
    the stations do not determine it.
    """
    pair, latitude = seen.solutions[axis], spec.site.latitude_deg
    higher, lower = (
        root_choice.solve(
            stations.components[axis], at, fit.left_out, refused=stations.status[axis],
            limits=root_choice.Limits(**spec.limits.model_dump()),
        )
        for at in (latitude + STEP_DEG, latitude - STEP_DEG)
    )  # fmt: skip
    slope = (higher.s_root - lower.s_root) / (2.0 * STEP_DEG)
    order = fit.model.coefficients.size
    same = (higher.root == pair.root) & (lower.root == pair.root)
    kept = (
        fit.used
        & same
        & np.isfinite(slope)
        & np.isfinite(pair.s_root)
        & (pair.s_root_uncertainty > 0.0)
    )
    if int(kept.sum()) < order + FEWEST:
        return 0.0, 0.0
    temperature = np.where(np.isfinite(stations.temperature), stations.temperature, 0.0)[kept]
    # model: the root at the recipe's latitude is s(T) − slope × latitude offset
    design = np.column_stack([np.vander(temperature / 100.0, order, increasing=True), -slope[kept]])
    weight = 1.0 / pair.s_root_uncertainty[kept]
    solved, _, rank, _ = np.linalg.lstsq(
        design * weight[:, None], pair.s_root[kept] * weight, rcond=None
    )
    if rank < design.shape[1]:
        return 0.0, 0.0
    left = (pair.s_root[kept] - design @ solved) * weight
    factor = max(float(left @ left) / (left.size - rank), 1.0)
    normal = (design * weight[:, None]).T @ (design * weight[:, None])
    return float(solved[-1]), float(np.sqrt(factor * np.linalg.inv(normal)[-1, -1]))
