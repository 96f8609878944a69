"""Noise of one reading of a sensor pair: as the recipe states it, as the readings show it, as a
calibration knew it.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric import closure
from calibkit.instruments.inclinometer.numeric.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import gum

CONTRADICTED = 1e-6
"""Probability of closures so much smaller or larger than the known noise, below which they have a
noise of their own.
"""
KINDS = (("accel", "g", "g"), ("gyro", "dph", "deg/h"))
"""Sensors of a pair: name, last word of their column, unit."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of one reading of a sensor pair, and from how many degrees of freedom it
    is known.
    """

    accel_g: float
    gyro_dph: float
    dof: int

    def decide(
        self,
        known: "Noise | None",
        last_digit: tuple[float, float],
        spec: InclinometerRecipe,
        axis: Sensor,
    ) -> "Noise":
        """Noise as the recipe states it, else the readings' own pooled with that of a calibration;
        never below the last digit.

        Raises FitError where it is unknown.
        """
        stated = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
        before = known or NO_NOISE
        pairs = ((self.accel_g, before.accel_g), (self.gyro_dph, before.gyro_dph))
        found = []
        for given, (mine, calibrated), digit, (kind, unit, _) in zip(
            stated, pairs, last_digit, KINDS, strict=True
        ):
            if given != "auto":
                found.append(given)
            elif self.dof + before.dof == 0:
                raise FitError(
                    f"{kind}_{axis}_{unit}: no station tells the noise of a reading",
                    hint=(
                        f"give stations.{kind}_noise_{unit} in the recipe, or stations with more"
                        " positions"
                    ),
                )
            else:
                found.append(
                    max(_pool_noise(mine, self.dof, calibrated, before.dof), digit / np.sqrt(12.0))
                )
        return Noise(float(found[0]), float(found[1]), self.dof + before.dof)

    def widen(self, spec: InclinometerRecipe) -> "Noise":
        """Noise for propagation: one known from few degrees of freedom is raised by Student's t, so
        that k = 2 still means 95 %.
        """
        if not self.dof:
            return self
        factor = gum.widening(self.dof)
        given = spec.stations.accel_noise_g != "auto", spec.stations.gyro_noise_dph != "auto"
        accel, gyro = (1.0 if stated else factor for stated in given)
        return Noise(accel * self.accel_g, gyro * self.gyro_dph, self.dof)


NO_NOISE = Noise(0.0, 0.0, 0)
"""What is known of the noise before anything is read."""


def least_noise(
    known: Noise | None, last_digit: tuple[float, float], spec: InclinometerRecipe
) -> tuple[float, float]:
    """Least noise of (accelerometer [g], gyro [°/h]): the recipe's, a calibration's, that of the
    last digit.
    """
    stated = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
    before = known or NO_NOISE
    accel, gyro = (
        max(digit / float(np.sqrt(12.0)), calibrated, 0.0 if given == "auto" else given)
        for given, calibrated, digit in zip(
            stated, (before.accel_g, before.gyro_dph), last_digit, strict=True
        )
    )
    return accel, gyro


def judge_closures(
    squares: Array, dofs: Integers, least: tuple[float, float]
) -> tuple[Noise, tuple[str, ...]]:
    """Noise of the stations that close, and why each [n] of the others is refused (or empty).

    `squares` and `dofs` [n, 2] are the sums of squares by which stations fail to close, of
    accelerometer and gyro, and their degrees of freedom. A station that fails by far more than the
    others holds an outlier, and its noise is not that of the others.
    """
    reasons = [""] * len(squares)
    for column, (kind, _, unit) in enumerate(KINDS):
        own = squares[:, column], dofs[:, column]
        variance = max(closure.usual_square(*own), least[column] ** 2)
        for k in np.flatnonzero(closure.find_outliers(*own, least[column] ** 2)).tolist():
            size = float(np.sqrt(squares[k, column] / dofs[k, column]))
            times = f"{size / np.sqrt(variance):.0f} times the noise of the others"
            reasons[k] = (
                reasons[k]
                or f"a wild reading: the {kind} does not close by {size:.2g} {unit}, {times}"
            )
    kept = np.array([not reason for reason in reasons])[:, None]
    square, dof = np.where(kept, squares, 0.0), np.where(kept, dofs, 0)
    accel, gyro = (closure.estimate_noise(square[:, column], dof[:, column]) for column in (0, 1))
    return Noise(accel, gyro, int(dof[:, 1].sum())), tuple(reasons)


def _pool_noise(own: float, own_dof: int, known: float, known_dof: int) -> float:
    """Noise of both, weighted by degrees of freedom, or the readings' own where the known one
    cannot be theirs.
    """
    if own_dof and known_dof and known > 0.0:
        from scipy.special import fdtr, fdtrc

        ratio = (own / known) ** 2
        if min(fdtr(own_dof, known_dof, ratio), fdtrc(own_dof, known_dof, ratio)) < CONTRADICTED:
            return own
    return float(np.sqrt((own_dof * own**2 + known_dof * known**2) / (own_dof + known_dof)))
