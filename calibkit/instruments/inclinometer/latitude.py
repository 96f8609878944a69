"""Detection of a wrong latitude: it causes a scatter of the roots of s that the noise of the
readings does not explain.
"""

from collections.abc import Mapping

import numpy as np

from calibkit.instruments.inclinometer.forms import ScaleFit
from calibkit.instruments.inclinometer.numeric.covariance import root_slopes
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.solve import SolvedStations
from calibkit.instruments.inclinometer.stations import Stations

SCATTERS = 3.0
"""Scatter of s, in standard uncertainties of a root, above which it is flagged; 16 simulated
sensors showed 0 to 1.6.
"""
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
    flags, stated = [], spec.site.latitude_deg
    for axis, fit in fits.items():
        u = seen.solutions[axis].s_root_uncertainty[fit.used]
        expected = float(np.median(u)) if u.size else 0.0
        if not expected or fit.over is None or fit.model.scatter <= SCATTERS * expected:
            continue
        what = (
            f"{axis}: s scatters by {fit.model.scatter:.1e} beyond its readings, which are good for"
            f" {expected:.1e}"
        )
        # the root at the recipe's latitude is s(T) - ds/dα × offset
        pair, parts = seen.solutions[axis], stations.components[axis]
        latitude = np.full(pair.s.size, stated)
        by_latitude = np.radians(root_slopes(parts, latitude, pair.root >= 0)[:, 4])
        offset, u_offset = fit.over.further_error(-by_latitude, FEWEST)
        reason = (
            "see that site.latitude_deg is right and the gyro does not change from station to"
            " station"
            if abs(offset) < max(SIGNIFICANT * u_offset, LEAST_DEG)
            else f"the stations fit a latitude of {stated + offset:.2f}° ± {u_offset:.2f}°,"
            f" site.latitude_deg says {stated:g}°"
        )
        flags.append(f"{what} ({fit.model.scatter / expected:.1f} times): {reason}")
    return flags
