"""Noise of one reading of a sensor pair: stated by the recipe, estimated from how stations close,
or taken from a calibration; and detection of stations with an outlier.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import gum

CONTRADICTED = 1e-6
"""Probability below which closures contradict a known noise; the noise is then estimated from the
readings alone.
"""
FEWEST = 8
"""Fewest stations for outlier detection: the median of fewer is too uncertain."""
IMPROBABLE = 1e-20
"""Probability of a closure by noise below which it is an outlier: 9.3 standard deviations with one
degree of freedom.

With eight stations of one degree of freedom 0.08 % of campaigns have such a closure by chance,
with twelve 0.02 %, because the median of a few stations is uncertain itself.
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
        before: "Noise",
        last_digit: tuple[float, float],
        spec: InclinometerRecipe,
        axis: Sensor,
    ) -> "Noise":
        """Noise stated by the recipe, otherwise estimated from the readings and pooled with a
        calibration's; never below the last digit's.

        Raises FitError where it is unknown.
        """
        stated = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
        shown, calibrated = (self.accel_g, self.gyro_dph), (before.accel_g, before.gyro_dph)
        decided = []
        for k, (kind, unit, _) in enumerate(KINDS):
            given = stated[k]
            if given != "auto":
                decided.append(given)
                continue
            if self.dof + before.dof == 0:
                raise FitError(
                    f"{kind}_{axis}_{unit}: no station tells the noise of a reading",
                    hint=(
                        f"give stations.{kind}_noise_{unit} in the recipe, or stations with more"
                        " positions"
                    ),
                )
            pooled = _pool_noise(shown[k], self.dof, calibrated[k], before.dof)
            decided.append(max(pooled, last_digit[k] / float(np.sqrt(12.0))))
        return Noise(decided[0], decided[1], self.dof + before.dof)

    def widen(self, spec: InclinometerRecipe) -> "Noise":
        """Noise for propagation: a noise estimated from few degrees of freedom is raised by
        Student's t, so that k = 2 covers 95 %.
        """
        if not self.dof:
            return self
        factor = gum.widening(self.dof)
        accel = factor if spec.stations.accel_noise_g == "auto" else 1.0
        gyro = factor if spec.stations.gyro_noise_dph == "auto" else 1.0
        return Noise(accel * self.accel_g, gyro * self.gyro_dph, self.dof)


NO_NOISE = Noise(0.0, 0.0, 0)
"""Noise before any reading: zero, from no degrees of freedom."""


def least_noise(
    before: Noise, last_digit: tuple[float, float], spec: InclinometerRecipe
) -> tuple[float, float]:
    """Lower limits of the noise of accelerometer [g] and gyro [°/h]: the largest of the recipe's,
    the calibration's and the last digit's.
    """
    stated = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
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
        square, dof = squares[:, column], dofs[:, column]
        variance = max(usual_square(square, dof), least[column] ** 2)
        for k in np.flatnonzero(find_outliers(square, dof, variance)).tolist():
            size = float(np.sqrt(square[k] / dof[k]))
            times = f"{size / np.sqrt(variance):.0f} times the noise of the others"
            reasons[k] = (
                reasons[k] or f"an outlier: the {kind} does not close by {size:.2g} {unit}, {times}"
            )
    kept = np.array([not reason for reason in reasons])
    accel, gyro = (estimate_noise(squares[kept, k], dofs[kept, k]) for k in range(2))
    return Noise(accel, gyro, int(dofs[kept, 1].sum())), tuple(reasons)


def usual_square(squares: Array, dof: Integers) -> float:
    """Variance of one reading from the median of sums of squares [n] with degrees of freedom [n];
    robust against one outlier.

    The median is divided by that of χ²/ν at the median degrees of freedom, which is not 1; NaN
    where no station has any.
    """
    known = dof > 0
    if not known.any():
        return float("nan")
    from scipy.special import gammaincinv

    median_dof = float(np.median(dof[known]))
    median = 2.0 * float(gammaincinv(median_dof / 2.0, 0.5)) / median_dof
    return float(np.median(squares[known] / dof[known])) / median


def find_outliers(squares: Array, dof: Integers, variance: float) -> Mask:
    """Mask [n] of stations with an outlier: their sums of squares are far above those of the
    variance of a reading.
    """
    known = dof > 0
    if int(known.sum()) < FEWEST:
        return np.zeros(squares.size, dtype=np.bool_)
    from scipy.special import chdtri

    limit = variance * chdtri(np.maximum(dof, 1), IMPROBABLE)
    return np.asarray(known & (squares > limit), dtype=np.bool_)


def estimate_noise(squares: Array, dof: Integers) -> float:
    """Standard deviation of one reading from sums of squares [n] with degrees of freedom [n]; 0
    where there are none.
    """
    total = int(dof.sum())
    return float(np.sqrt(squares.sum() / total)) if total else 0.0


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
