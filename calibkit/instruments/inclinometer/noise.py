"""Noise of one reading of a sensor pair: stated by the recipe, estimated from how stations close,
or taken from a calibration; and detection of stations with an outlier.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.published import SENSORS, Sensor
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


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of one reading of a sensor pair, and the degrees of freedom of their
    estimate.
    """

    accel_g: float
    gyro_dph: float
    dof: int

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


def decide_noise(
    squares: Array,
    dofs: Integers,
    before: Noise,
    last_digit: Sequence[float],
    spec: InclinometerRecipe,
    axis: Sensor,
) -> tuple[Noise, tuple[str, ...]]:
    """Noise of one reading of accelerometer and gyro, and for each station [n] the reason why it is
    refused, or an empty string.

    `squares` and `dofs` [n, 2] are the sums of squares by which stations fail to close, of
    accelerometer and gyro, and their degrees of freedom. A station that fails by far more than the
    others holds an outlier, and its noise is not that of the others. The noise is that which the
    recipe states, otherwise the one of the stations that close, pooled with a calibration's
    `before`; never below the last digit's. Raises FitError where it is unknown.
    """
    stated_sizes = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
    calibrated = before.accel_g, before.gyro_dph
    of_digit = [digit / float(np.sqrt(12.0)) for digit in last_digit]
    reasons = [""] * len(squares)
    for k, (kind, _, unit_mark) in enumerate(SENSORS):
        square, dof, stated_size = squares[:, k], dofs[:, k], stated_sizes[k]
        least_size = max(of_digit[k], calibrated[k], 0.0 if stated_size == "auto" else stated_size)
        variance = max(usual_square(square, dof), least_size**2)
        for row in np.flatnonzero(find_outliers(square, dof, variance)).tolist():
            size = float(np.sqrt(square[row] / dof[row]))
            times = f"{size / np.sqrt(variance):.0f} times the noise of the others"
            outlier = f"an outlier: the {kind} does not close by {size:.2g} {unit_mark}, {times}"
            reasons[row] = reasons[row] or outlier
    closing = np.array([not reason for reason in reasons])
    # the gyro's for both: it has fewer, where its drift within a station is fitted
    shown_dof = int(dofs[closing, 1].sum())
    sizes = []
    for k, (kind, suffix, _) in enumerate(SENSORS):
        stated_size = stated_sizes[k]
        if stated_size != "auto":
            sizes.append(stated_size)
            continue
        if shown_dof + before.dof == 0:
            raise FitError(
                f"{kind}_{axis}_{suffix}: no station tells the noise of a reading",
                hint=f"give stations.{kind}_noise_{suffix} in the recipe, or stations with more"
                " positions",
            )
        # variances of a reading
        of_readings = float(squares[closing, k].sum() / max(dofs[closing, k].sum(), 1))
        of_calibration = calibrated[k] ** 2
        weighted = shown_dof * of_readings + before.dof * of_calibration
        pooled = weighted / (shown_dof + before.dof)
        if shown_dof and before.dof and of_calibration > 0.0:
            from scipy.special import fdtr, fdtrc

            ratio = of_readings / of_calibration
            tails = fdtr(shown_dof, before.dof, ratio), fdtrc(shown_dof, before.dof, ratio)
            pooled = of_readings if min(tails) < CONTRADICTED else pooled
        sizes.append(max(float(np.sqrt(pooled)), of_digit[k]))
    return Noise(sizes[0], sizes[1], shown_dof + before.dof), tuple(reasons)


def usual_square(squares: Array, dof: Integers) -> float:
    """Variance of one reading from the median of sums of squares [n] with degrees of freedom [n];
    robust against one outlier.

    The median is divided by that of χ²/ν at the median degrees of freedom, which is not 1; NaN
    where no station has any.
    """
    redundant = dof > 0
    if not redundant.any():
        return float("nan")
    from scipy.special import gammaincinv

    median_dof = float(np.median(dof[redundant]))
    median = 2.0 * float(gammaincinv(median_dof / 2.0, 0.5)) / median_dof
    return float(np.median(squares[redundant] / dof[redundant])) / median


def find_outliers(squares: Array, dof: Integers, variance: float) -> Mask:
    """Mask [n] of stations with an outlier: their sums of squares are far above those of the
    variance of a reading.
    """
    redundant = dof > 0
    if int(redundant.sum()) < FEWEST:
        return np.zeros(squares.size, dtype=np.bool_)
    from scipy.special import chdtri

    limit = variance * chdtri(np.maximum(dof, 1), IMPROBABLE)
    return np.asarray(redundant & (squares > limit), dtype=np.bool_)
