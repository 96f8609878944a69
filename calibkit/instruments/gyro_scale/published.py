"""Published methods for one run of a rate table: the straight line, and the figures of a gyro's
scale factor as GJB 2426A and IEEE Std 952 define them.

    F_j = K Ω_j + F0                                                                       (1)

by least squares with equal weights over the held rates Ω_j, for K is the slope of the best straight
line; F0, which holds the earth's rate about the table axis, is always fitted: rates of one sign
give the same K. And of two gyros, K_A and K_B about their own axes, K_Ba that of B about A's axis:

    N = K_B/K_A,   ε = K_Ba/K_A = N cos α,   γ = ε/N = K_Ba/K_B = cos α                      (2)
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import ARCSECONDS_PER_DEGREE
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import LinearFit, linear, rank
from calibkit.records.coefficients import Figure

PPM = 1e6
GJB, IEEE = "GJB 2426A", "IEEE Std 952"
"""Standards that define the figures."""
HALF = 0.5
"""Share of the expected output from which a rate or step counts as detected (GJB 2426A, IEEE Std
952: threshold, resolution).
"""
SEEN = 4.0
"""Least significance of a response, in standard uncertainties."""
REST = 1e-9
"""Rate, relative to the largest, up to which the table rests, and step [°/s] that is none."""
ROOM_DEGC = 5.0
"""Largest difference from room temperature [°C] of runs that count as repeated (GJB 2426A)."""
LINE_KEYS = r"gyro_scale\.(nonlinearity_full_scale|asymmetry)\.GJB 2426A\..+"
"""Pattern of the key figures of lines."""
_NAME = re.compile(rf"(\w+)\.(?:({GJB}|{IEEE})\.)?(.+)")


class FigureName(NamedTuple):
    """Parts of a figure's name in gyro_scale.json: quantity, standard that defines it (or ""), and
    model.
    """

    kind: str
    standard: str
    model: str

    @classmethod
    def of(cls, text: str) -> "FigureName":
        """Parts of a name in the coefficient file."""
        parts = _NAME.fullmatch(text)
        return cls(parts[1], parts[2] or "", parts[3]) if parts else cls(text, "", "")

    @property
    def text(self) -> str:
        """Name in the coefficient file."""
        return ".".join(filter(None, self))


@dataclass(frozen=True)
class Line:
    """Best straight line (1) of one gyro over the held rates Ω_j [p] of a run, with means F_j and
    their standard uncertainty by noise within the held rates.
    """

    rate_dps: Array
    indication: Array
    noise: Array

    @cached_property
    def fit(self) -> LinearFit:
        """K and F0 with residuals; FitError where all rates are one."""
        design = np.column_stack((self.rate_dps, np.ones_like(self.rate_dps)))
        return linear(design, self.indication, names=("K", "F0"))

    @property
    def K(self) -> float:  # noqa: N802 - the letter of the standards
        """Scale factor [1/deg]."""
        return float(self.fit.coefficients[0])

    @property
    def F0(self) -> float:  # noqa: N802 - the letter of the standards
        """Zero-rate indication [1/s]."""
        return float(self.fit.coefficients[1])

    @property
    def of_full_scale_ppm(self) -> tuple[Array, Array]:
        """(F_j − F̂_j)/max |F_j| and their standard uncertainties [p, ppm]."""
        full_scale = float(np.max(np.abs(self.indication)))
        if full_scale == 0.0:
            raise FitError("every indication is zero", hint="check the column of the gyro")
        ppm = PPM / full_scale
        return self.fit.residuals * ppm, self.noise * ppm

    @property
    def seen(self) -> Mask:
        """Which rates [p] turn the gyro by more than the noise of their means hides; rest is
        none.
        """
        size = np.abs(self.rate_dps)
        turning = size > REST * np.max(size, initial=0.0)
        return np.asarray(turning & (self.noise * SEEN < HALF * np.abs(self.K) * size))

    @property
    def per_point_ppm(self) -> tuple[Array, Array]:
        """(F_j − F̂_j)/|K Ω_j| and their standard uncertainties [p, ppm]; NaN where the table does
        not turn, or noise hides that: one that stops still turns by its encoder's noise.
        """
        expected = np.abs(self.K * self.rate_dps)
        with np.errstate(divide="ignore", invalid="ignore"):
            deviation = np.where(self.seen, self.fit.residuals / expected * PPM, np.nan)
            return deviation, self.noise / expected * PPM

    @property
    def residual_over_noise(self) -> float:
        """√(Σ (F_j − F̂_j)²/u_j² / E), E what noise alone lets expect; NaN where no noise is known.

        With equal weights the residual of a quiet mean holds the noise of the others: E is the sum
        over j, k of (δ_jk − H_jk)² u_k²/u_j², H = X X⁺, not the degrees of freedom.
        """
        if not (self.noise > 0.0).all():
            return float("nan")
        q, _ = np.linalg.qr(np.column_stack((self.rate_dps, np.ones_like(self.rate_dps))))
        remover = np.eye(self.noise.size) - q @ q.T
        expected = np.sum((remover * self.noise / self.noise[:, None]) ** 2)
        return float(np.sqrt(np.sum((self.fit.residuals / self.noise) ** 2) / expected))


def figures(line: Line, u_K: float, model: str = "") -> Iterator[Figure]:
    """Figures of one run that its rates determine, under the name of its model; their uncertainties
    are those of the means, that of K [1/deg] is given. Tested rates have none.
    """

    def figure(
        kind: str, standard: str, value: float, unit: str, u: float | np.floating[Any]
    ) -> Figure:
        return Figure(FigureName(kind, standard, model).text, float(value), unit, float(u))

    K, noise = abs(line.K), line.noise
    yield figure("scale_factor", GJB, line.K, "1/deg", u_K)
    # K in pulses a degree, 3600/K in arc-seconds a pulse
    pulse = ARCSECONDS_PER_DEGREE / K
    yield figure("scale_factor", IEEE, pulse, "arcsec", pulse * u_K / K)
    # max |F_j − F̂_j| / max |F_j|, with the noise of the point that decides it
    residuals, u_residuals = line.of_full_scale_ppm
    worst = int(np.argmax(np.abs(residuals)))
    value = abs(residuals[worst])
    yield figure("nonlinearity_full_scale", GJB, value, "ppm", u_residuals[worst])
    # max |F_j − F̂_j| / |K Ω_j|
    deviation, u_deviation = line.per_point_ppm
    if np.isfinite(deviation).any():
        worst = int(np.nanargmax(np.abs(deviation)))
        value = abs(deviation[worst])
        yield figure("nonlinearity_per_point", GJB, value, "ppm", u_deviation[worst])
    u = rms(noise) / K / np.sqrt(2.0 * noise.size)
    yield figure("linearity_error_rms", IEEE, line.fit.residual_rms / K, "deg/s", u)
    rate, intercept, size = line.rate_dps, np.ones_like(line.rate_dps), np.abs(line.rate_dps)
    asymmetries: list[tuple[str, Array, float]] = []
    sides = rate > 0.0, rate < 0.0
    if all(np.unique(np.round(rate[side], 9)).size >= 2 for side in sides):
        # matrix [2, p] that makes the slopes of positive and of negative rates of the means. GJB: a
        # line with an intercept of its own on each side, |K₊ − K₋| / K̄, K̄ = (K₊ + K₋)/2
        slopes = np.zeros((2, rate.size))
        for row, side in zip(slopes, sides, strict=True):
            row[side] = np.linalg.pinv(np.column_stack((rate, intercept))[side])[0]
        asymmetries.append((GJB, slopes, abs(float(np.mean(slopes @ line.indication)))))
        # IEEE: two slopes from one intercept, |K₊ − K₋| / K
        design = np.column_stack((np.maximum(rate, 0.0), np.minimum(rate, 0.0), intercept))
        if rank(design) == design.shape[1]:
            asymmetries.append((IEEE, np.linalg.pinv(design)[:2], K))
    for standard, slopes, mean_K in asymmetries:
        slope_difference = slopes[0] - slopes[1]
        value = abs(slope_difference @ line.indication) / mean_K * PPM
        u = np.linalg.norm(slope_difference * noise) / K * PPM
        yield figure("asymmetry", standard, value, "ppm", u)
    # Threshold and resolution, the smallest tested rate and step of rate from which all outputs are
    # at least half of the expected ones: upper limits, as smaller ones were not tested, or noise
    # hides them. And the dead zone, the width of the rates through zero without response, by fine
    # rates of both directions; its uncertainty is that of the steps between them.
    turning = size > REST * np.max(size, initial=0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        responds = line.seen & ((line.indication - line.F0) / (line.K * rate) >= HALF)
    threshold = _smallest_from_which(size[turning], responds[turning])
    order = np.argsort(rate, kind="stable")
    step, noise = np.diff(rate[order]), noise[order]
    half = HALF * K * step
    step_seen = np.hypot(noise[1:], noise[:-1]) * SEEN < half
    follows = np.sign(line.K) * np.diff(line.indication[order]) >= half
    real = step > REST
    resolution = _smallest_from_which(step[real], (step_seen & follows)[real])
    width, variance = 0.0, 0.0
    for direction in (1.0, -1.0):
        side = line.seen & (direction * rate > 0.0)
        first = _smallest_from_which(size[side], responds[side])
        silent = float(np.max(size[side & (size < first)], initial=-np.inf))
        # in the middle between the last silent and the first responding rate, ± step/2
        width += (first + silent) / 2.0
        variance += (first - silent) ** 2 / 12.0
    for kind, value, u in (
        ("threshold", threshold, 0.0),
        ("resolution", resolution, 0.0),
        ("dead_zone", width, np.sqrt(variance)),
    ):
        if np.isfinite(value):
            yield figure(kind, GJB, value, "deg/s", u)


def _smallest_from_which(sizes: Array, responds: Mask) -> float:
    """Smallest size for which it and all larger sizes respond; NaN where the largest does not."""
    order = np.argsort(sizes, kind="stable")
    silent = np.flatnonzero(~responds[order])
    first = int(silent[-1]) + 1 if silent.size else 0
    return float(sizes[order][first]) if first < sizes.size else float("nan")


def repeatability(K: Array) -> float:
    """sd(K_i)/K̄ [ppm] of the scale factors [Q] of Q runs (GJB 2426A); FitError for one run."""
    if K.size < 2:
        raise FitError(
            "repeatability needs two runs or more", hint="repeat the run at the same temperature"
        )
    return float(np.std(K, ddof=1) / abs(np.mean(K))) * PPM


def temperature_sensitivity(K: Array, temp_degc: Array, room_degc: float) -> float:
    """Max |K_i − K_m|/(K_m |T_i − T_m|) [ppm/°C] (GJB 2426A).

    K [q] and temperatures [q] [°C]; K_m and T_m are the means of the runs nearest room temperature,
    within 5 °C of it.
    """
    at_room = np.abs(temp_degc - room_degc) <= ROOM_DEGC
    if not at_room.any() or at_room.all():
        raise FitError(
            f"temperature sensitivity needs runs within 5 °C of {room_degc:g} °C and others"
            " outside",
            hint="add runs, or state the room temperature",
        )
    K_m, T_m = float(K[at_room].mean()), float(temp_degc[at_room].mean())
    relative = np.abs(K[~at_room] - K_m) / (abs(K_m) * np.abs(temp_degc[~at_room] - T_m))
    return float(np.max(relative)) * PPM


@dataclass(frozen=True, slots=True)
class Ratios:
    """Ratios and angle of two gyros, equation (2).

    Attributes
    ----------
    results : N, ε, γ within [−1, 1], and the angle α of B's input axis to A's axis [°], 0 to
        180.
    covariance : [4, 4] of these; type A: N and ε share K_A, N and γ share K_B, so errors are
        correlated.
    dof : effective degrees of freedom [4].
    alpha_interval_deg : 95 % interval of α; where |γ| is within noise of one it begins at 0° or
        ends at 180°.
    indicated : K_Ba/K_B before it was clamped, with its uncertainty to first order.

    """

    results: tuple[float, float, float, float]
    covariance: Array
    dof: tuple[float, ...]
    alpha_interval_deg: tuple[float, float]
    indicated: Value


def find_ratios(K: Fit) -> Ratios:
    """Ratios and angle of two gyros from a fit of K_A, K_B and K_Ba, in one unit.

    Raises FitError for a scale factor about its own axis that is zero or not finite, or |γ| too far
    above one for noise.
    """
    K_A, K_B, K_Ba = K.parameters.tolist()
    indicated = indicate(K)
    ratios = K.restated(lambda k: np.stack((k[1] / k[0], k[2] / k[0], k[2] / k[1])))
    dof = ratios.of(lambda r: r).dof.tolist()
    u_gamma, gamma = float(indicated.u), float(np.clip(indicated.value, -1.0, 1.0))
    # α is monotonic in γ: its interval is that of γ, which ends at ±1
    half = gum.coverage_factor(float(indicated.dof), probability=0.95) * u_gamma
    ends = np.degrees(np.arccos(np.clip([gamma + half, gamma - half], -1.0, 1.0)))
    # within ten standard uncertainties of |γ| = 1 first-order propagation to α fails
    if 1.0 - abs(gamma) > 10.0 * u_gamma:
        slope = -180.0 / np.pi / np.sqrt(1.0 - gamma**2)
    else:
        # dα/dγ = -1/sin α diverges at 0° and 180°: the mean slope over the interval
        slope = -np.ptp(ends) / (2.0 * half) if half else 0.0
    of_all = np.vstack((np.eye(3), [0.0, 0.0, slope]))
    results = K_B / K_A, K_Ba / K_A, gamma, float(np.degrees(np.arccos(gamma)))
    covariance = of_all @ ratios.total_covariance @ of_all.T
    interval = float(ends[0]), float(ends[1])
    return Ratios(results, covariance, (*dof, dof[2]), interval, indicated)


def indicate(K: Fit) -> Value:
    """γ = K_Ba/K_B as it is indicated; FitError for K_A, K_B, K_Ba that no pair can have."""
    values, (K_A, K_B, K_Ba) = K.parameters, K.parameters.tolist()
    finite = np.isfinite(values).all() and np.isfinite(K.total_covariance).all()
    if not finite or K_A == 0.0 or K_B == 0.0:
        raise FitError(f"scale factors K_A {K_A:g}, K_B {K_B:g}, K_Ba {K_Ba:g} cannot give ratios")
    # an excess that neither noise nor misalignment explains: logs of other axes
    if abs(K_Ba / K_B) > 1.05:
        raise FitError(
            f"gamma {K_Ba / K_B:g} is far beyond 1: gyro B indicates more about A's axis than"
            " about its own",
            hint="check which log is of which table axis and which column is of which gyro",
        )
    return K.of(lambda k: k[2] / k[1])
