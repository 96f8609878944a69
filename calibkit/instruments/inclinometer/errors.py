"""Angle errors of solved stations before and after, and the acceptance limits on them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Criterion, at_most, over_u
from calibkit.fit.unseen import unseen
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.solve import SolvedStations
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.numeric import dispersion
from calibkit.numeric.attitude import wrapped

TURNED = 5.0
"""Standard uncertainties above which unseen azimuths are turned together; 260 simulated tools had
at most 3.4.
"""


@dataclass(frozen=True, slots=True)
class AngleErrors:
    """Errors [n] [°] against the reference; NaN without reference or result. `before` is the
    azimuth error with s = 1.
    """

    inclination: Array
    toolface: Array
    before: Array
    after: Array
    standard_uncertainty: Array
    """Of the corrected azimuth [n] [°]."""
    noise: Array
    """The same without what the mounting of the sensors adds [n] [°]."""
    stated: Array
    """What the recipe states of the mounting, or of the reference [n] [°]."""
    by_turn: Array
    """Derivative of the azimuth by a turn of the gyros against the accelerometers [n] [°/°]."""

    @property
    def known(self) -> Mask:
        """Mask [n] of the stations with a reference azimuth and a result."""
        return np.isfinite(self.after) & np.isfinite(self.before)

    @property
    def excess(self) -> Array:
        """Increase of the azimuth error's magnitude by the correction, in its standard
        uncertainties, for the known stations.
        """
        known = self.known
        worse = np.abs(self.after[known]) - np.abs(self.before[known])
        return np.asarray(worse / self.standard_uncertainty[known], dtype=np.float64)

    def turn(self) -> tuple[float, float]:
        """Turn of the gyros against the accelerometers, or of the reference azimuths, that the
        errors of the known stations share, and its standard uncertainty [°].
        """
        slope, u, known = self.by_turn, self.noise, self.known
        weight = np.where(known, slope / u**2, 0.0)
        power = float(np.nansum(weight * slope))
        shared = rms(self.stated[known]) / rms(slope[known])
        return float(np.nansum(weight * self.after)) / power, float(np.hypot(power**-0.5, shared))

    def judge_uncertainty(self, name: str) -> Criterion:
        """Criterion that azimuth errors of unseen stations are as large as stated; they may share
        them altogether, since s(T) is common to all.
        """
        u = self.standard_uncertainty[self.known]
        judged = unseen(self.after[self.known], u[:, None])
        return over_u(f"{name}: rms azimuth error", judged.to_object())

    def judge_turn(self, name: str) -> Criterion:
        """Criterion that azimuth errors of unseen stations share no turn."""
        angle, u = self.turn()
        what = f"{name}: turn that azimuths share, over its u"
        return at_most(what, abs(angle) / u, TURNED, "1", "calibkit")

    def criteria(self, spec: InclinometerRecipe) -> tuple[Criterion, ...]:
        """Criteria of the recipe's acceptance limits."""
        limits, known = spec.acceptance, self.known
        tests = [
            ("azimuth rms", rms(self.after[known]), limits.max_azimuth_rms_deg),
            ("largest azimuth error", largest(self.after), limits.max_azimuth_error_deg),
            (
                "largest inclination error",
                largest(self.inclination),
                limits.max_inclination_error_deg,
            ),
            ("largest toolface error", largest(self.toolface), limits.max_toolface_error_deg),
        ]
        return tuple(
            at_most(name, value, limit, "deg")
            for name, value, limit in tests
            if limit is not None and np.isfinite(value)
        )

    @classmethod
    def compare(cls, stations: Stations, seen: SolvedStations) -> Self:
        """Errors of all stations."""
        reference, combined, mounted = stations.reference, seen.combined, seen.mounted
        with np.errstate(invalid="ignore"):
            return cls(
                np.where(seen.refused, np.nan, combined.inclination_deg - reference[:, 0]),
                wrapped(combined.toolface_deg - reference[:, 1]),
                wrapped(combined.uncorrected_deg - reference[:, 2]),
                wrapped(combined.azimuth_deg - reference[:, 2]),
                combined.standard_uncertainty[:, 2],
                np.sqrt(combined.covariance[:, 2, 2] - mounted.variance),
                np.sqrt(mounted.stated),
                mounted.by_turn,
            )


def rms(values: Array) -> float:
    """Root mean square of the finite values, NaN where there is none."""
    return dispersion.rms(values[np.isfinite(values)])


def largest(values: Array) -> float:
    """Largest magnitude of the finite values, NaN where there is none."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if finite.size else float("nan")
