"""Two loggers, two clocks: the offset and the drift between them from a quantity that both of them
logged.

Logger B's time t_B on logger A's clock is t_B + δ + d (t_B − t_m), t_m the middle of B's log. What
A logged is g b(t) + c of what B logged, with unknown gain and level, so both must have measured the
same quantity. Two quantities of which one follows the other, like chamber air and gyro case, do not
tell an offset from a lag: on 18 simulated ramps with an exact clock, fits of offset and one
first-order lag were off by 19 to 51 s and claimed 0.7 to 2.2 s.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import anomalies, dispersion
from calibkit.numeric.arrays import Array
from calibkit.records.frame import GAP

_MOST_POINTS = 20_000
"""Rows of logger A that enter the estimate: more would add only correlated noise."""
_COARSE_POINTS = 4_000
"""Rows that enter the search over offsets."""
_SMOOTH = 10.0
"""Sampling intervals of logger B on each side over which its slope is evaluated."""
_UNLIKE = 6.0
"""Largest residual of a shared quantity, in noises of the two sensors; beyond it they measure two
quantities.
"""
_LEAST = 30
"""Fewest common rows for an estimate."""
_RIVAL = 0.25
"""Relative excess of a second offset's sum of squares below which it explains the logs as well as
the best one.
"""


@dataclass(frozen=True, slots=True)
class Clocks:
    """Clock of logger B against that of logger A: offset [s] at `middle_s` of B's time, drift [1],
    their covariance.
    """

    offset_s: float
    drift: float
    covariance: Array
    """[2, 2] of offset and drift."""
    middle_s: float
    gain: float
    residual_rms: float
    rows: int

    @property
    def standard_uncertainty(self) -> tuple[float, float]:
        """Of offset [s] and drift [1]."""
        u = np.sqrt(np.diag(self.covariance))
        return float(u[0]), float(u[1])

    def largest_uncertainty(self, time_s: Array) -> float:
        """Largest standard uncertainty [s] of the joined time over times [n, s] of B."""
        design = np.column_stack(
            (np.ones(2), np.array([time_s.min(), time_s.max()]) - self.middle_s)
        )
        return float(np.sqrt(np.max(np.einsum("ij,jk,ik->i", design, self.covariance, design))))

    def on_a(self, time_s: Array) -> Array:
        """Times [n, s] of B on the clock of A."""
        return time_s + self.offset_s + self.drift * (time_s - self.middle_s)


def resample(time_s: Array, value: Array, at_s: Array) -> Array:
    """Values of a log [n] at other times [m, s], linear between neighbours; NaN in gaps and beyond
    the ends.
    """
    step = np.diff(time_s)
    usual = float(np.median(step))
    after = np.clip(np.searchsorted(time_s, at_s, side="left"), 1, time_s.size - 1)
    within_log = (at_s >= time_s[0]) & (at_s <= time_s[-1])
    # a time that was logged needs no neighbour, though a gap may begin or end there
    logged = (time_s[after] == at_s) | (time_s[after - 1] == at_s)
    return np.where(
        within_log & (logged | (step[after - 1] <= GAP * usual)),
        np.interp(at_s, time_s, value),
        np.nan,
    )


def average(time_s: Array, value: Array, at_s: Array) -> Array:
    """Means of a faster log [n] over the sampling intervals about other times [m, s]; NaN where a
    mean lacks half its rows.
    """
    step, usual = float(np.median(np.diff(at_s))), float(np.median(np.diff(time_s)))
    # above the first value: a sum of many large readings loses the digits of their means
    total = np.concatenate(([0.0], np.cumsum(value - value[0])))
    first = np.searchsorted(time_s, at_s - step / 2.0, side="left")
    stop = np.searchsorted(time_s, at_s + step / 2.0, side="left")
    count = stop - first
    mean = (total[stop] - total[first]) / np.maximum(count, 1) + value[0]
    return np.where(count >= 0.5 * step / usual, mean, np.nan)


def estimate_clock(
    time_a: Array,
    a: Array,
    time_b: Array,
    b: Array,
    *,
    near_s: float = 0.0,
    search_s: float = 120.0,
    drift: bool = True,
) -> Clocks:
    """Estimate offset and drift of logger B's clock against logger A's from a quantity that both
    logged.

    Parameters
    ----------
    time_a, a : [n], times [s] and values of logger A, whose clock is kept.
    time_b, b : [m], of logger B.
    near_s, search_s : the offset is looked for at near_s ± search_s [s].
    drift : whether the clocks may run at different rates.

    Returns
    -------
    Clocks. The covariance allows for autocorrelated residuals (Newey & West 1987) and for the gain
    and the level, which are fitted with it.

    Raises
    ------
    FitError
        Where fewer than 30 rows are common, nothing varies, two offsets explain the logs alike, or
        the best one lies at the end of the search.

    """
    keep = np.linspace(0, time_a.size - 1, min(time_a.size, _MOST_POINTS)).astype(np.int64)
    t, x = time_a[keep], a[keep]
    if min(time_a.size, time_b.size) < _LEAST or np.ptp(x) == 0.0 or np.ptp(b) == 0.0:
        raise FitError(
            "the two logs share no quantity that varies", hint="state the clock in the recipe"
        )
    start = _search_offset(t, x, time_b, b, near_s, search_s)
    middle = float(np.median(time_b))
    theta = _refine(np.array([start, 0.0] if drift else [start]), t, x, time_b, b, middle)
    if abs(float(theta[0]) - near_s) >= search_s:
        raise FitError(
            f"the best clock offset lies at the end of the search, {theta[0]:+.1f} s",
            hint="widen search_s, or state it",
        )
    return _estimate_covariance(theta, t, x, time_b, b, middle)


def _search_offset(
    t: Array, x: Array, time_b: Array, b: Array, near_s: float, search_s: float
) -> float:
    """Offset [s] of the largest correlation on a grid; raises FitError where another offset is as
    good.
    """
    step = max(float(np.median(np.diff(time_b))), float(np.median(np.diff(t))), search_s / 500.0)
    thin = slice(None, None, max(1, t.size // _COARSE_POINTS))
    offsets = near_s + np.arange(-search_s, search_s + step / 2.0, step)
    unexplained = np.array(
        [_unexplained(x[thin], resample(time_b, b, t[thin] - offset)) for offset in offsets]
    )
    if not np.isfinite(unexplained).any():
        raise FitError(
            "the two logs have no time in common",
            hint="state offset_s near the true one, or widen search_s",
        )
    best = int(np.nanargmin(unexplained))
    falls_before = unexplained[1:-1] < unexplained[:-2]
    rises_after = unexplained[1:-1] < unexplained[2:]
    local_minimum = np.r_[False, falls_before & rises_after, False]
    competitive = unexplained < (1.0 + _RIVAL) * max(float(unexplained[best]), 1e-12)
    rivals = [k for k in np.flatnonzero(local_minimum & competitive).tolist() if abs(k - best) > 1]
    if rivals:
        rival_offsets = ", ".join(f"{offsets[k]:+.0f} s" for k in rivals)
        raise FitError(
            f"clock offsets of {offsets[best]:+.0f} s and {rival_offsets} explain the two logs"
            " alike",
            hint="narrow search_s around the known offset (offset_s), or state the clock",
        )
    return float(offsets[best])


def _unexplained(x: Array, y: Array) -> float:
    """Share of the variance of x [n] that a straight line in y [n] does not explain; infinite where
    too few rows are common.
    """
    good = np.isfinite(y)
    if good.sum() < max(_LEAST, x.size // 4) or np.ptp(y[good]) == 0.0:
        return float("inf")
    return float(1.0 - np.corrcoef(x[good], y[good])[0, 1] ** 2)


def _sensor_noise(values: Array) -> float:
    """Standard deviation of a sensor's noise, at least that of its resolution."""
    return max(anomalies.scatter(values), anomalies.resolution(values) / float(np.sqrt(12.0)))


def _resample_b(theta: Array, t: Array, time_b: Array, b: Array, middle: float) -> Array:
    """Values of B at the times [n, s] of A; NaN where B has none."""
    skew = float(theta[1]) if theta.size > 1 else 0.0
    return resample(time_b, b, (t - theta[0] + skew * middle) / (1.0 + skew))


def _residuals(theta: Array, t: Array, x: Array, time_b: Array, b: Array, middle: float) -> Array:
    """Residuals of A [n] after a straight line in B; 0 where B has no value."""
    y = _resample_b(theta, t, time_b, b, middle)
    good = np.isfinite(y)
    if good.sum() < _LEAST:
        return np.full(t.size, float(np.std(x)))
    design = np.column_stack((y[good] - y[good].mean(), np.ones(int(good.sum()))))
    residual = np.zeros(t.size)
    residual[good] = x[good] - design @ np.linalg.lstsq(design, x[good], rcond=None)[0]
    return residual


def _refine(theta: Array, t: Array, x: Array, time_b: Array, b: Array, middle: float) -> Array:
    """Least squares over offset and drift; gain and level are eliminated at every step."""
    from scipy.optimize import least_squares

    scale = np.array([1.0, 1.0 / float(time_b[-1] - time_b[0])])[: theta.size]

    def residuals(scaled: Array) -> Array:
        return _residuals(scaled * scale, t, x, time_b, b, middle)

    solution = least_squares(
        residuals, theta / scale, diff_step=np.full(theta.size, 1e-3), max_nfev=200
    )
    return np.asarray(solution.x * scale, dtype=np.float64)


def _slopes(theta: Array, t: Array, time_b: Array, b: Array, middle: float, gain: float) -> Array:
    """Slopes [n, k] of gain · B at the times of A by offset [s] and drift; NaN where B has none."""
    # the ends are so far apart that the noise of B does not pass for its slope
    time_step_s = _SMOOTH * float(np.median(np.diff(time_b)))
    slopes = []
    for k in range(theta.size):
        step = np.zeros(theta.size)
        step[k] = time_step_s if k == 0 else time_step_s / (0.5 * float(time_b[-1] - time_b[0]))
        ends = [_resample_b(theta + sign * step, t, time_b, b, middle) for sign in (1.0, -1.0)]
        slopes.append(gain * (ends[0] - ends[1]) / (2.0 * step[k]))
    return np.column_stack(slopes)


def _estimate_covariance(
    theta: Array, t: Array, x: Array, time_b: Array, b: Array, middle: float
) -> Clocks:
    """The estimate with its covariance, from the slopes of the whole model at the solution.

    Raises FitError where the rows in common are too few, the sensors show two quantities, or an
    offset cannot be separated from a level.
    """
    y = _resample_b(theta, t, time_b, b, middle)
    good = np.isfinite(y)
    linear = np.column_stack((y[good] - y[good].mean(), np.ones(int(good.sum()))))
    gain, _ = np.linalg.lstsq(linear, x[good], rcond=None)[0].tolist()
    columns = _slopes(theta, t, time_b, b, middle, gain)
    sound = good & np.isfinite(columns).all(axis=1)
    if sound.sum() < _LEAST:
        raise FitError(
            "the two logs have too few rows in common", hint="state the clock in the recipe"
        )
    design = np.column_stack(
        (columns[sound], y[sound] - y[sound].mean(), np.ones(int(sound.sum())))
    )
    size = np.linalg.norm(design, axis=0)
    residual = _residuals(theta, t, x, time_b, b, middle)[sound]
    noise = np.hypot(_sensor_noise(x), abs(gain) * _sensor_noise(b))
    rms = dispersion.rms(residual)
    if rms > _UNLIKE * noise:
        raise FitError(
            f"the two sensors do not show one quantity: {rms:.2g} is left of it, their noise is"
            f" {noise:.2g}",
            hint=(
                "a sensor that follows another behind a lag shows no clock; name columns of one"
                " quantity, or state the clock"
            ),
        )
    if not (size > 0.0).all() or np.linalg.cond(design / size) > 1e8:
        raise FitError(
            "a clock offset cannot be separated from another level of the two sensors",
            hint="log a change that both loggers see, or state the clock",
        )
    covariance = _with_memory(design / size, residual) / np.outer(size, size)
    pair = np.zeros((2, 2))
    pair[: theta.size, : theta.size] = covariance[: theta.size, : theta.size]
    skew = float(theta[1]) if theta.size > 1 else 0.0
    return Clocks(float(theta[0]), skew, pair, middle, float(gain), rms, int(sound.sum()))


def _with_memory(design: Array, residual: Array) -> Array:
    """Covariance [p, p] of least squares whose residuals [n] are autocorrelated, by a Bartlett
    kernel over three times the rows that neighbours remember (Newey & West 1987).
    """
    count, columns = design.shape
    size = 1 << (2 * count).bit_length()
    spectrum = np.abs(np.fft.rfft(residual - residual.mean(), size)) ** 2
    products = np.fft.irfft(spectrum)[:count]
    uncorrelated = products < 2.0 / np.sqrt(count) * products[0]
    remembered = int(np.argmax(uncorrelated)) - 1 if uncorrelated.any() else count // 3
    width = min(3 * max(remembered, 0), count // 3) + 1
    # a sum of the products by 1 - k/width is that of squares of sums over `width` rows
    scores = np.pad(design * residual[:, None], ((width, width - 1), (0, 0)))
    sums = np.cumsum(scores, axis=0)
    sums = sums[width:] - sums[:-width]
    bread = np.linalg.inv(design.T @ design)
    small_sample_factor = count / (count - columns)
    return np.asarray(
        small_sample_factor * bread @ (sums.T @ sums / width) @ bread, dtype=np.float64
    )
