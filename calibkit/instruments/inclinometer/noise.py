"""Noise of one reading of a sensor pair: stated by the recipe, estimated from the readings, or
taken from a calibration.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric import closure
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import gum

CONTRADICTED = 1e-6
"""Probability below which closures contradict a known noise; the noise is then estimated from the
readings alone.
"""
KINDS = (("accel", "g", "g"), ("gyro", "dph", "deg/h"))
"""Sensors of a pair: name, last word of their column, unit."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of one reading of a sensor pair, and the degrees of freedom of their
    estimate.
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
        """Noise stated by the recipe, otherwise estimated from the readings and pooled with a
        calibration's; never below the last digit's.

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
        """Noise for propagation: a noise estimated from few degrees of freedom is raised by
        Student's t, so that k = 2 covers 95 %.
        """
        if not self.dof:
            return self
        factor = gum.widening(self.dof)
        given = spec.stations.accel_noise_g != "auto", spec.stations.gyro_noise_dph != "auto"
        accel, gyro = (1.0 if stated else factor for stated in given)
        return Noise(accel * self.accel_g, gyro * self.gyro_dph, self.dof)


NO_NOISE = Noise(0.0, 0.0, 0)
"""Noise before any reading: zero, from no degrees of freedom."""


def least_noise(
    known: Noise | None, last_digit: tuple[float, float], spec: InclinometerRecipe
) -> tuple[float, float]:
    """Lower limits of the noise of accelerometer [g] and gyro [°/h]: the largest of the recipe's,
    the calibration's and the last digit's.
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
    """Noise estimated from the stations that close, and for each station [n] the reason why it is
    refused, or an empty string.

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
                reasons[k] or f"an outlier: the {kind} does not close by {size:.2g} {unit}, {times}"
            )
    kept = np.array([not reason for reason in reasons])[:, None]
    square, dof = np.where(kept, squares, 0.0), np.where(kept, dofs, 0)
    accel, gyro = (closure.estimate_noise(square[:, column], dof[:, column]) for column in (0, 1))
    return Noise(accel, gyro, int(dof[:, 1].sum())), tuple(reasons)


def _pool_noise(own: float, own_dof: int, known: float, known_dof: int) -> float:
    """Noise pooled by degrees of freedom; the readings' own noise alone where the known noise
    contradicts it.
    """
    if own_dof and known_dof and known > 0.0:
        from scipy.special import fdtr, fdtrc

        ratio = (own / known) ** 2
        if min(fdtr(own_dof, known_dof, ratio), fdtrc(own_dof, known_dof, ratio)) < CONTRADICTED:
            return own
    return float(np.sqrt((own_dof * own**2 + known_dof * known**2) / (own_dof + known_dof)))
