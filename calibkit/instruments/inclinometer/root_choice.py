"""North seeking of stations by one sensor pair, and by two combined.

Step D (methods, four positions) has two roots s₊, s₋; from noise alone each has its own standard
uncertainty u±. Before a station is read, s is known as s₀ ± u₀, by s(T) of a calibration or by the
stations before it (`history_prior`). Then

    a root may be used        s > 0,  u ≤ limits.s_uncertainty,  |s₊ - s₋|/2 > limits.separation u
    log-likelihood of a root  -½ (s - s₀)²/(u² + u₀²) - ½ ln(u² + u₀²)                        (1)
    scale factor of a station s = w s± + (1 - w) s₀,   w = u₀²/(u±² + u₀²)                    (2)

The root is the one whose azimuth is nearer to an outside heading, or without any the likelier one.
w is 0 where the root may not be used, and where without a heading both may be and (1) differs by
less than 3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.published import (
    Attitude,
    Components,
    Sensor,
    full_circle,
)
from calibkit.instruments.inclinometer.recipe import DepartureSpec, HistorySpec, LimitSpec
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.attitude import wrapped

LIKELIER = 3.0
"""Least difference of log-likelihood between two positive roots for an unambiguous choice: odds of
20 to 1.
"""
ROOT_DISAGREES = 5.0
"""Difference between a root and its prior, in standard uncertainties, above which it is flagged."""
CLAMPED = "negative discriminant clamped to zero"
"""Flag of a station whose two roots coincide."""
AZIMUTH, ROOT = 3, 4
"""Index of the azimuth among inclination, toolface, s and azimuth, and of the root behind them."""
UNITS = np.array([np.degrees(1.0), np.degrees(1.0), 1.0, np.degrees(1.0)])
"""Of inclination, toolface, s and azimuth, in those of their derivatives: angles [°] in rad."""
ANGLES = (0, 1, 3)
"""Indices of the angles in a solution's covariance: inclination, toolface, azimuth."""
NAMES = ("inclination", "toolface", "azimuth")
PAIRS_DISAGREE = 8.0
"""Difference of two sensor pairs, in standard uncertainties, above which it is flagged: errors of
the positions weigh more in some attitudes than the one noise of all stations says.
"""
EXACT, UNKNOWN = 1e-300, 1e300
"""Least and largest variance in a weight: pairs that are both exact, or both not known, count
alike.
"""


DEFAULT_LIMITS, DEFAULT_HISTORY = LimitSpec(), HistorySpec()


@dataclass(frozen=True, slots=True)
class ScalePrior:
    """Value and standard uncertainty of s at each station [n] before its own readings."""

    s: Array
    standard_uncertainty: Array


@dataclass(frozen=True, slots=True)
class BothRoots:
    """Both roots of s at n stations; column 0 the + root, column 1 the − root."""

    parts: Components
    latitude_deg: Array
    attitude: Attitude
    clamped: Mask
    """[n], whether both are one, as noise made the discriminant negative."""
    s: Array
    """[n, 2]."""
    uncertainty: Array
    """[n, 2], standard uncertainty by the noise of the components."""
    slopes: Array
    """[n, 2, 5], derivatives by g_x, g_y [1/g], ω_x, ω_y [h/°] and the latitude [1/rad]."""
    by_heading: Integers
    """[n], column of the root that an outside heading chooses, −1 where there is none."""
    usable: Mask
    """[n, 2]."""
    status: tuple[str, ...]
    """[n]: empty, or why the station is refused."""

    @np.errstate(divide="ignore", invalid="ignore")
    def choose_root(self, prior: ScalePrior, rows: slice = slice(None)) -> tuple[Integers, Mask]:
        """Column [m] of the root of each selected station that the heading chooses, or else is
        likelier, and whether both are about equally likely.
        """
        s, by_heading = self.s[rows], self.by_heading[rows]
        variance = self.uncertainty[rows] ** 2 + prior.standard_uncertainty[:, None] ** 2
        # (1)
        score = -0.5 * (s - prior.s[:, None]) ** 2 / variance - 0.5 * np.log(variance)
        # roots with infinite uncertainty are equally unlikely, negative roots impossible
        score = np.where(np.isfinite(score), score, -1e300)
        score = np.where(s > 0.0, score, -np.inf)
        ambiguous = np.abs(score[:, 0] - score[:, 1]) < LIKELIER
        column = np.where(by_heading >= 0, by_heading, np.argmax(score, axis=1))
        return column, (by_heading < 0) & self.usable[rows].all(axis=1) & ambiguous


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles of n stations; those of a refused station are NaN, with the reason in `status`."""

    inclination_deg: Array
    toolface_deg: Array
    """In (−180, 180]."""
    azimuth_deg: Array
    """In [0, 360)."""
    uncorrected_deg: Array
    """Azimuth with s = 1."""
    status: tuple[str, ...]
    flags: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Solution(Angles):
    """North seeking of n stations by one sensor pair."""

    s: Array
    """s that was used [n]."""
    s_root: Array
    """Chosen root [n], before it was shrunk to the prior."""
    s_root_uncertainty: Array
    root: Integers
    """1 for the + root, −1 for the − root, 0 where neither is possible."""
    weight: Array
    """Weight of the root in s [n]; 0 where s is its prior, NaN where it has no result."""
    root_slopes: Array
    """[n, 5] of the chosen root, as `BothRoots.slopes`."""
    by_mounting: Array
    """[2, n], `mounting_slopes` of the azimuth [°/°]."""
    pair_covariance: Array
    """[n, 4, 4] of inclination [°], toolface [°], s, azimuth [°], by errors that other sensor pairs
    do not share.
    """
    by_latitude: Array
    """[n, 4], changes of the same by an error of the latitude, which all sensor pairs share, as
    large as its standard uncertainty.
    """


def tell(*conditions: tuple[Mask, str], **values: Array | float) -> tuple[tuple[str, ...], ...]:
    """Texts [n] of the conditions that hold at each station, a mask [n] beside its text, in which
    the station's values, or those of all stations, stand by name.
    """
    columns = dict(zip(values, np.broadcast_arrays(*values.values()), strict=True))
    texts = []
    for k in range(len(conditions[0][0])):
        of_station = {name: column[k] for name, column in columns.items()}
        texts.append(tuple(text.format(**of_station) for holds, text in conditions if holds[k]))
    return tuple(texts)


def seek_north(inputs: Numbers, plus: Mask, weight: Array) -> Numbers:
    """θ, φ, s = w s± + rest, ψ and the root s± [5, n] from g_x, g_y [g], ω_x, ω_y [°/h], α and the
    rest of s [6, n]; angles in rad, plus and weight [n] say which root and its w.
    """
    accel_x, accel_y, gyro_x, gyro_y, latitude, rest = inputs
    attitude = published.attitude(accel_x, accel_y)
    s_plus, s_minus, _ = published.scale_roots(gyro_x, gyro_y, attitude, latitude * 180.0 / np.pi)
    root = np.where(plus, s_plus, s_minus)
    # a root that is not used may be no number
    s = np.where(weight > 0.0, weight * root, 0.0) + rest
    psi = published.azimuth(accel_x, accel_y, s * gyro_x, s * gyro_y, latitude * 180.0 / np.pi)
    return np.stack([attitude.inclination, attitude.toolface, s, psi, root])


@np.errstate(divide="ignore", invalid="ignore")
def seek_with_slopes(
    parts: Components, latitude_deg: Array, plus: Mask, weight: Array, rest: Array
) -> tuple[Array, Array]:
    """Results [5, n] of `seek_north`, and their derivatives [n, 5, 6] by its inputs."""
    components = parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y
    inputs = np.stack([*components, np.radians(latitude_deg), rest])
    values = np.asarray(seek_north(inputs, plus, weight), dtype=np.float64)
    by_input = derivative(
        lambda step: seek_north(inputs + step[:, None], plus, weight), np.zeros(6)
    )
    return values, np.moveaxis(by_input, 1, 0)


def mounting_slopes(parts: Components, slopes: Array) -> Array:
    """Change [2, n] of a result with derivatives [n, 4] by the components, for each radian of a
    turn of the gyro against its accelerometer, ω_x' = ω_x + δ ω_y, ω_y' = ω_y − δ ω_x, and of an
    index error, by half of which positions ±x and ±y are turned to different sides.
    """
    none = np.zeros_like(parts.gyro_x)
    # ω_x' = ω_x + δ ω_y, ω_y' = ω_y - δ ω_x: accelerometers do not feel the turn of a gyro
    by_turn = np.column_stack([none, none, parts.gyro_y, -parts.gyro_x])
    by_index = np.column_stack([parts.accel_y, parts.accel_x, parts.gyro_y, parts.gyro_x]) / 2.0
    return np.stack([np.sum(slopes * by_turn, axis=1), np.sum(slopes * by_index, axis=1)])


@np.errstate(divide="ignore", invalid="ignore")
def estimate_roots(
    parts: Components,
    latitude_deg: ArrayLike,
    *,
    heading_deg: Array | None = None,
    refused: Sequence[str] = (),
    limits: LimitSpec = DEFAULT_LIMITS,
) -> BothRoots:
    """Both roots of s with uncertainty, and which stations are refused.

    Parameters
    ----------
    parts : components of n stations and their noise.
    latitude_deg : one or [n].
    heading_deg : [n], an outside heading that chooses the root; NaN where there is none.
    refused : [n], reasons why a station could not be read or fitted, or empty.
    limits : where a station is refused and a root is not used.

    """
    latitude = np.broadcast_to(np.asarray(latitude_deg, dtype=np.float64), parts.accel_x.shape)
    attitude = published.attitude(parts.accel_x, parts.accel_y)
    *both, clamped = published.scale_roots(parts.gyro_x, parts.gyro_y, attitude, latitude)
    s = np.column_stack(both)
    slopes, off_heading = np.empty((*s.shape, 5)), np.full(s.shape, np.inf)
    for k in range(2):
        is_plus, whole = np.full(len(s), k == 0), np.ones(len(s))
        results, by_input = seek_with_slopes(parts, latitude, is_plus, whole, 0.0 * whole)
        slopes[:, k] = by_input[:, ROOT, :5]
        if heading_deg is not None:
            off_heading[:, k] = np.abs(wrapped(np.degrees(results[AZIMUTH]) - heading_deg))
    # the latitude is one error of all stations and of both pairs: it is no noise of a root
    by_component = slopes[:, :, :4]
    variance = np.einsum("nki,nij,nkj->nk", by_component, parts.covariance, by_component)
    uncertainty = np.sqrt(variance)
    uncertainty[~np.isfinite(uncertainty) | clamped[:, None]] = np.inf
    half_difference = np.abs(s[:, :1] - s[:, 1:]) / 2.0
    separate = half_difference > limits.separation * uncertainty
    usable = (s > 0.0) & (uncertainty <= limits.s_uncertainty) & separate
    # of an impossible root the azimuth is near no heading
    off_heading[~(s > 0.0) | np.isnan(off_heading)] = np.inf
    with_heading = np.isfinite(off_heading).any(axis=1)
    by_heading = np.where(with_heading, np.argmin(off_heading, axis=1), -1)

    # why a station is refused
    inputs = (parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y, latitude)
    tilt = np.degrees(attitude.inclination)
    reasons = tell(
        (~np.all(np.isfinite(inputs), axis=0), "an indication or the latitude is not finite"),
        (
            np.abs(latitude) > limits.latitude_deg,
            (
                "latitude {latitude:g}° is beyond {most_latitude:g}°: the earth's horizontal rate"
                " is too small for an azimuth"
            ),
        ),
        (
            tilt > limits.horizontal_deg,
            (
                "inclination {tilt:.2f}° is above {horizontal:g}°: sensors across the tool give no"
                " azimuth there"
            ),
        ),
        (
            tilt < limits.vertical_deg,
            (
                "inclination {tilt:.3f}° is below {vertical:g}°: toolface and azimuth are not"
                " separable, their sum is {total:.2f}°"
            ),
        ),
        ((parts.gyro_x == 0.0) & (parts.gyro_y == 0.0), "the gyros show no rate at all"),
        tilt=tilt,
        total=np.degrees(published.toolface_plus_azimuth(parts.gyro_x, parts.gyro_y)),
        latitude=latitude,
        most_latitude=limits.latitude_deg,
        horizontal=limits.horizontal_deg,
        vertical=limits.vertical_deg,
    )
    before = refused or [""] * len(s)
    status = [
        text or (first[0] if first else "") for text, first in zip(before, reasons, strict=True)
    ]
    return BothRoots(
        *(parts, latitude, attitude, clamped, s, uncertainty, slopes),
        *(by_heading, usable, tuple(status)),
    )


def history_prior(
    roots: BothRoots, elapsed: Array, start: HistorySpec | DepartureSpec = DEFAULT_HISTORY
) -> ScalePrior:
    """Prior of s at each station from the stations before it: value and rate of change (step D), by
    a Kalman filter.

    Parameters
    ----------
    roots : of n stations in their order.
    elapsed : [n], not decreasing: hours, or the number of the station.
    start : before the first station.

    Notes
    -----
    State (s, ds/dt), its rate a random walk; a root that is not usable, or is as likely as the
    other, does not change the state.

    """
    if not np.isfinite(elapsed).all() or (np.diff(elapsed) < 0.0).any():
        raise FitError(
            "the stations' times decrease or are not finite", hint="sort the stations by time"
        )
    state = np.array([start.s, start.rate])
    covariance = np.diag([start.standard_uncertainty**2, start.rate_uncertainty**2])
    value, spread = np.empty_like(elapsed), np.empty_like(elapsed)
    for k, step in enumerate(np.diff(elapsed, prepend=elapsed[:1]).tolist()):
        move = np.array([[1.0, step], [0.0, 1.0]])
        # covariance that a random walk of the rate adds over a step
        walk = np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
        state = move @ state
        covariance = move @ covariance @ move.T + start.rate_walk**2 * walk
        # the filter's prediction may be zero or negative; the prior must be a positive scale factor
        value[k], spread[k] = max(float(state[0]), 1e-3), float(np.sqrt(covariance[0, 0]))
        station = slice(k, k + 1)
        column, ambiguous = roots.choose_root(ScalePrior(value[station], spread[station]), station)
        root = k, int(column[0])
        informative = not roots.status[k] and roots.usable[root] and not ambiguous[0]
        if informative and covariance[0, 0] > 0.0:
            # Kalman gain of a reading of s alone
            gain = covariance[:, 0] / (covariance[0, 0] + roots.uncertainty[root] ** 2)
            state = state + gain * (roots.s[root] - state[0])
            covariance = covariance - np.outer(gain, covariance[0])
    return ScalePrior(value, spread)


@np.errstate(divide="ignore", invalid="ignore")
def solve(roots: BothRoots, prior: ScalePrior, latitude_uncertainty_deg: float = 0.0) -> Solution:
    """Solve n stations of one sensor pair: choose the root, shrink it to the prior, correct the
    rates (step E), seek north (step F).

    Parameters
    ----------
    roots : both of n stations.
    prior : of s at each station: its history, or s(T) of a calibration. It chooses between two
        positive roots where no heading does.
    latitude_uncertainty_deg : standard uncertainty of the latitude.

    Returns
    -------
    Solution. s = w s_root + (1 − w) s_prior, w by inverse variance, and 0 where the root is not
    usable or both are equally likely. A station that cannot be solved has NaN and a reason; the
    others are not affected.

    """
    parts, latitude = roots.parts, roots.latitude_deg
    column, ambiguous = roots.choose_root(prior)
    stations = np.arange(column.size)
    s_root, u_root = roots.s[stations, column], roots.uncertainty[stations, column]
    accepted = roots.usable[stations, column] & ~ambiguous
    total = u_root**2 + prior.standard_uncertainty**2
    # where both are exact, they are taken to agree
    share = np.where(total > 0.0, prior.standard_uncertainty**2 / total, 1.0)
    weight = np.where(accepted, share, 0.0)
    # to first order, of the components, the latitude, and what the prior adds to s
    rest = np.where(accepted, (1.0 - weight) * prior.s, prior.s)
    (_, _, s, azimuth, _), by_input = seek_with_slopes(parts, latitude, column == 0, weight, rest)
    # with s = 1: what the station would give without any scale factor
    uncorrected = published.azimuth(
        parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y, latitude
    )
    jacobian = by_input[:, :4] * UNITS[:, None]
    inputs = np.zeros((column.size, 6, 6))
    inputs[:, :4, :4] = parts.covariance
    # (2): what is not the root's is the prior's, with its uncertainty
    inputs[:, 5, 5] = ((1.0 - weight) * prior.standard_uncertainty) ** 2
    covariance = jacobian @ inputs @ np.swapaxes(jacobian, 1, 2)

    solved = np.array([not reason for reason in roots.status])
    positive, both = s_root > 0.0, (roots.s > 0.0).all(axis=1)
    departure = np.abs(s_root - prior.s) / np.hypot(u_root, prior.standard_uncertainty)
    flags = tell(
        (roots.attitude.clamped, "accelerations across the tool exceed gravity: clamped"),
        (solved & roots.clamped, CLAMPED),
        (solved & ~positive, "no positive root of s: s is its prior"),
        (
            solved & positive & ambiguous,
            "both roots of s are about as likely: s is its prior",
        ),
        (
            solved & positive & ~ambiguous & ~accepted,
            (
                "s is its prior: the root {root:.4g} has a standard uncertainty of {u:.2g}, C is"
                " near 0"
            ),
        ),
        (
            solved & positive & accepted & (departure > ROOT_DISAGREES),
            (
                "the root {root:.5g} is {departure:.0f} standard uncertainties from its prior"
                " {prior:.5g}"
            ),
        ),
        (solved & both, "both roots of s are positive"),
        root=s_root,
        u=u_root,
        departure=departure,
        prior=prior.s,
    )

    def kept(values: Array) -> Array:
        return np.where(solved.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    return Solution(
        inclination_deg=np.degrees(roots.attitude.inclination),
        toolface_deg=kept(np.degrees(roots.attitude.toolface)),
        azimuth_deg=kept(np.degrees(azimuth)),
        uncorrected_deg=kept(np.degrees(uncorrected)),
        s=kept(s),
        s_root=kept(s_root),
        s_root_uncertainty=kept(u_root),
        root=np.where(solved & (s_root > 0.0), 1 - 2 * column, 0),
        weight=kept(weight),
        root_slopes=roots.slopes[stations, column],
        by_mounting=mounting_slopes(parts, kept(by_input[:, AZIMUTH, :4])),
        pair_covariance=kept(covariance),
        by_latitude=kept(jacobian[:, :, 4] * np.radians(latitude_uncertainty_deg)),
        status=roots.status,
        flags=flags,
    )


@dataclass(frozen=True, slots=True)
class Combined(Angles):
    """North seeking of n stations by all sensor pairs; a station that no pair solves is refused.
    The uncorrected azimuths have the weights of the corrected ones.
    """

    azimuth_weight: Array
    """[pairs, n], of the azimuth of each pair; 0 where it is not used."""
    covariance: Array
    """[n, 3, 3] of inclination, toolface, azimuth [°]."""

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [n, 3] of inclination, toolface, azimuth [°]."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@np.errstate(divide="ignore", invalid="ignore")
def combine(pairs: Mapping[Sensor, Solution]) -> Combined:
    """Combine the solutions of one or two sensor pairs, angle by angle: circular means weighted by
    inverse variance.

    A station that only one pair solves has that pair's result and is flagged; a station that
    neither pair solves is refused with both reasons.
    """
    used = np.array([[not reason for reason in pair.status] for pair in pairs.values()])
    angles = np.array(
        [
            np.column_stack(
                (pair.inclination_deg, pair.toolface_deg, pair.azimuth_deg, pair.uncorrected_deg)
            )
            for pair in pairs.values()
        ]
    )
    of_pairs = np.array([pair.pair_covariance[:, ANGLES][:, :, ANGLES] for pair in pairs.values()])
    by_latitude = np.array([pair.by_latitude[:, ANGLES] for pair in pairs.values()])
    variance = np.nan_to_num(np.diagonal(of_pairs, axis1=2, axis2=3), nan=UNKNOWN)
    precision = np.where(used[:, :, None], 1.0 / np.clip(variance, EXACT, UNKNOWN), 0.0)
    weight = precision / precision.sum(axis=0)
    # the mean about the first pair that is used; the uncorrected azimuth by the azimuth's weights
    first = angles[np.argmax(used, axis=0), np.arange(used.shape[1])]
    departures = weight[:, :, [0, 1, 2, 2]] * wrapped(angles - first)
    mean = first + np.where(used[:, :, None], departures, 0.0).sum(axis=0)
    # covariance of the weighted mean, whose weights differ from angle to angle
    weighted = weight[:, :, :, None] * of_pairs * weight[:, :, None, :]
    covariance = np.where(used[:, :, None, None], weighted, 0.0).sum(axis=0)
    # the latitude's error is one error of all pairs
    shared = np.where(used[:, :, None], weight * by_latitude, 0.0).sum(axis=0)
    covariance += shared[:, :, None] * shared[:, None, :]
    solved = np.asarray(used.any(axis=0), dtype=np.bool_)
    # no reason where a pair solves the station, one that both have, or that of each
    status = tuple(
        ""
        if not all(reasons)
        else reasons[0]
        if len(set(reasons)) == 1
        else "; ".join(f"{axis}: {reason}" for axis, reason in zip(pairs, reasons, strict=True))
        for reasons in zip(*(pair.status for pair in pairs.values()), strict=True)
    )
    # flags of each pair, of one that could not be used, and of two that disagree
    flags = list(next(iter(pairs.values())).flags)
    if len(pairs) == 2:
        difference = wrapped(angles[1] - angles[0])[:, :3]
        variance = np.diagonal(of_pairs.sum(axis=0), axis1=1, axis2=2)
        limit = PAIRS_DISAGREE * np.sqrt(variance + (by_latitude[0] - by_latitude[1]) ** 2) + 1e-9
        apart = (np.abs(difference) > limit) & np.asarray(used.all(axis=0))[:, None]
        for k, some_pair in enumerate(solved.tolist()):
            of_station = [
                f"{axis}: {flag}" for axis, pair in pairs.items() for flag in pair.flags[k]
            ]
            of_station += [
                f"{axis} not used: {pair.status[k]}"
                for axis, pair in pairs.items()
                if some_pair and pair.status[k]
            ]
            of_station += [
                f"the pairs differ by {difference[k, j]:.3f}° in {NAMES[j]}, more than their noise"
                " explains"
                for j in np.flatnonzero(apart[k]).tolist()
            ]
            flags[k] = tuple(of_station)
    return Combined(
        inclination_deg=np.where(solved, mean[:, 0], np.fmax.reduce(angles[:, :, 0])),
        toolface_deg=wrapped(mean[:, 1]),
        azimuth_deg=full_circle(mean[:, 2], 360.0),
        uncorrected_deg=full_circle(mean[:, 3], 360.0),
        azimuth_weight=np.where(used, weight[:, :, 2], 0.0),
        covariance=np.where(solved[:, None, None], covariance, np.nan),
        status=status,
        flags=tuple(flags),
    )
