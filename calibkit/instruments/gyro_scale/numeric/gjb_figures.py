"""Published methods for one run of a rate table: the straight line, and the figures of a gyro's
scale factor as GJB 2426A and IEEE Std 952 define them.

    F_j = K Ω_j + F0                                                                       (1)

by least squares with equal weights over the held rates Ω_j, for K is the slope of the best straight
line; F0, which holds the earth's rate about the table axis, is always fitted: rates of one sign
give the same K.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.constants import ARCSECONDS_PER_DEGREE
from calibkit.errors import FitError
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import LinearFit, linear, rank

PPM = 1e6
GJB, IEEE = "GJB 2426A", "IEEE Std 952"
"""Standards that define the figures."""
HALF = 0.5
"""Share of the expected output from which a rate or step counts as detected (GJB 2426A, IEEE Std
952: threshold, resolution).
"""
SEEN = 4.0
"""Least significance of a response, in standard uncertainties."""
ROOM_DEGC = 5.0
"""Largest difference from room temperature [°C] of runs that count as repeated (GJB 2426A)."""


@dataclass(frozen=True)
class Line:
    """Best straight line (1) of one gyro over the p held rates of a run."""

    rate_dps: Array
    """[p]."""
    indication: Array
    """Means F_j [p]."""
    noise: Array
    """Standard uncertainty [p] of the means by noise within the held rates."""

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
    def residuals(self) -> Array:
        """F_j − F̂_j [p, 1/s]."""
        return self.fit.residuals

    @property
    def expected(self) -> Array:
        """|K Ω_j| [p, 1/s]."""
        return np.abs(self.K * self.rate_dps)

    @property
    def turning(self) -> Mask:
        """Which rates [p] are not rest."""
        size = np.abs(self.rate_dps)
        return np.asarray(size > 1e-9 * np.max(size, initial=0.0), dtype=np.bool_)

    @property
    def seen(self) -> Mask:
        """Which rates [p] turn the gyro by more than the noise of their means hides."""
        seen = self.noise * SEEN < HALF * self.expected
        return np.asarray(self.turning & seen, dtype=np.bool_)

    @property
    def responds(self) -> Mask:
        """Whether the output of each rate [p] is at least half of what is expected."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (self.indication - self.F0) / (self.K * self.rate_dps)
        return np.asarray(share >= HALF, dtype=np.bool_)

    @property
    def full_scale(self) -> float:
        """Largest one-sided output max |F_j| [1/s]."""
        largest = float(np.max(np.abs(self.indication)))
        if largest == 0.0:
            raise FitError("every indication is zero", hint="check the column of the gyro")
        return largest

    @property
    def of_full_scale_ppm(self) -> tuple[Array, Array]:
        """Residuals and their standard uncertainties [p, ppm of full scale]."""
        ppm = PPM / self.full_scale
        return self.residuals * ppm, self.noise * ppm

    @property
    def per_point_ppm(self) -> Array:
        """(F_j − F̂_j)/|K Ω_j| [p, ppm]; NaN where the table does not turn, or noise hides that: one
        that stops still turns by its encoder's noise.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.seen, self.residuals / self.expected * PPM, np.nan)

    @property
    def u_per_point_ppm(self) -> Array:
        """Standard uncertainty [p, ppm] of these by noise."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.noise / self.expected * PPM

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
        return float(np.sqrt(np.sum((self.residuals / self.noise) ** 2) / expected))


@dataclass(frozen=True, slots=True)
class Figure:
    """A value with its standard uncertainty (type A), its unit and the standard that defines it."""

    name: str
    value: float
    standard_uncertainty: float
    unit: str
    standard: str


def figures(line: Line, u_K: float) -> Iterator[Figure]:
    """Figures of one run that its rates determine; their uncertainties are those of the means, that
    of K [1/deg] is given. Tested rates have none.
    """
    yield Figure("scale_factor", line.K, u_K, "1/deg", GJB)
    # K in pulses a degree, 3600/K in arc-seconds a pulse
    pulse = ARCSECONDS_PER_DEGREE / abs(line.K)
    yield Figure("scale_factor", pulse, pulse * u_K / abs(line.K), "arcsec", IEEE)
    yield from _nonlinearities(line)
    yield from _asymmetries(line)
    dead_zone, u_dead_zone = _dead_zone_dps(line)
    for name, value, u in (
        ("threshold", _threshold_dps(line), 0.0),
        ("resolution", _resolution_dps(line), 0.0),
        ("dead_zone", dead_zone, u_dead_zone),
    ):
        if np.isfinite(value):
            yield Figure(name, value, u, "deg/s", GJB)


def _nonlinearities(line: Line) -> Iterator[Figure]:
    """Nonlinearity over full scale and per point, with the noise of the point that decides it, and
    the rms error of the line.
    """
    # max |F_j − F̂_j| / max |F_j|
    worst = int(np.argmax(np.abs(line.residuals)))
    value, u = (PPM / line.full_scale * abs(x[worst]) for x in (line.residuals, line.noise))
    yield Figure("nonlinearity_full_scale", float(value), float(u), "ppm", GJB)
    # max |F_j − F̂_j| / |K Ω_j|
    per_point = np.abs(line.per_point_ppm)
    if np.isfinite(per_point).any():
        point = int(np.nanargmax(per_point))
        u = float(line.u_per_point_ppm[point])
        yield Figure("nonlinearity_per_point", float(per_point[point]), u, "ppm", GJB)
    error_dps, noise_dps = line.fit.residual_rms / abs(line.K), rms(line.noise) / abs(line.K)
    u = noise_dps / np.sqrt(2.0 * line.noise.size)
    yield Figure("linearity_error_rms", error_dps, float(u), "deg/s", IEEE)


def _asymmetries(line: Line) -> Iterator[Figure]:
    """Asymmetry in the senses of both standards; none without two rates of each sign."""
    rate = line.rate_dps
    sides = rate > 0.0, rate < 0.0
    if any(np.unique(np.round(rate[side], 9)).size < 2 for side in sides):
        return
    one = np.ones_like(rate)
    # GJB: a line with an intercept of its own on each side, |K₊ − K₋| / K̄, K̄ = (K₊ + K₋)/2
    slopes = np.zeros((2, rate.size))
    for row, side in zip(slopes, sides, strict=True):
        row[side] = np.linalg.pinv(np.column_stack((rate, one))[side])[0]
    yield _asymmetry(line, slopes, abs(float(np.mean(slopes @ line.indication))), GJB)
    # IEEE: two slopes from one intercept, |K₊ − K₋| / K
    design = np.column_stack((np.maximum(rate, 0.0), np.minimum(rate, 0.0), one))
    if rank(design) == design.shape[1]:
        yield _asymmetry(line, np.linalg.pinv(design)[:2], abs(line.K), IEEE)


def _asymmetry(line: Line, slopes: Array, K: float, standard: str) -> Figure:
    """Asymmetry by the slopes of positive and negative rates, matrix [2, p] on the means."""
    apart = slopes[0] - slopes[1]
    value, u = abs(float(apart @ line.indication)), float(np.linalg.norm(apart * line.noise))
    return Figure("asymmetry", value / K * PPM, u / abs(line.K) * PPM, "ppm", standard)


def _threshold_dps(line: Line) -> float:
    """Smallest tested rate [°/s] from which all outputs are at least half of the expected ones; NaN
    where noise hides it. An upper limit: smaller rates were not tested.
    """
    responds = line.seen & line.responds
    return _smallest_from_which(np.abs(line.rate_dps[line.turning]), responds[line.turning])


def _resolution_dps(line: Line) -> float:
    """Smallest tested step of rate [°/s] from which the output changes by at least half of the
    expected change; NaN where noise hides it.
    """
    order = np.argsort(line.rate_dps, kind="stable")
    step, change = np.diff(line.rate_dps[order]), np.diff(line.indication[order])
    noise = np.hypot(line.noise[order][1:], line.noise[order][:-1])
    real = step > 1e-9
    seen = noise[real] * SEEN < HALF * np.abs(line.K) * step[real]
    responds = change[real] / (line.K * step[real]) >= HALF
    return _smallest_from_which(step[real], seen & responds)


def _dead_zone_dps(line: Line) -> tuple[float, float]:
    """Width [°/s] of the rates through zero without response, and its standard uncertainty from the
    steps between the tested rates; NaN where a direction has no fine rate without response that
    noise does not hide.
    """
    width, variance = 0.0, 0.0
    for direction in (1.0, -1.0):
        side = line.seen & (direction * line.rate_dps > 0.0)
        rates = np.abs(line.rate_dps[side])
        first = _smallest_from_which(rates, line.responds[side])
        silent = rates[rates < first]
        if not silent.size:
            return float("nan"), float("nan")
        step = first - float(silent.max())
        # in the middle between the last silent and the first responding rate, ± step/2
        width, variance = width + first - step / 2.0, variance + step**2 / 12.0
    return width, float(np.sqrt(variance))


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
