"""Two sensor pairs at one station: each is solved with its own s, then both are combined."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.inclinometer.numeric.root_choice import Solution, outer
from calibkit.instruments.inclinometer.published import full_circle
from calibkit.numeric.attitude import wrapped

ANGLES = (0, 1, 3)
"""Indices of the angles in a solution's covariance: inclination, toolface, azimuth."""
NAMES = ("inclination", "toolface", "azimuth")
DISAGREE = 5.0
"""Difference of two sensor pairs, in standard uncertainties, above which it is flagged."""


@dataclass(frozen=True, slots=True)
class Combined:
    """North seeking of n stations by both sensor pairs; a station that neither pair solves is NaN,
    with the reason in `status`.
    """

    inclination_deg: Array
    toolface_deg: Array
    """In (−180, 180]."""
    azimuth_deg: Array
    """In [0, 360)."""
    uncorrected_deg: Array
    """Azimuth with s = 1, combined with the same weights."""
    covariance: Array
    """[n, 3, 3] of inclination, toolface, azimuth [°]."""
    status: tuple[str, ...]
    flags: tuple[tuple[str, ...], ...]

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [n, 3] of inclination, toolface, azimuth [°]."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def combine(x: Solution, y: Solution) -> Combined:
    """Combine the solutions of the x and y sensor pairs, angle by angle: circular means weighted by
    inverse variance.

    A station that only one pair solves has that pair's result and is flagged; a station that
    neither pair solves is refused with both reasons.
    """
    used = np.column_stack([[not reason for reason in pair.status] for pair in (x, y)]).astype(
        np.bool_
    )
    weight = _weights(x, y, used)
    angles_x, angles_y = _angles(x), _angles(y)
    difference = wrapped(angles_y - angles_x)
    # a weight of 0 or 1 selects a single pair; NaN of the other pair must not propagate
    combined = np.where(
        used[:, :1],
        np.where(used[:, 1:], angles_x + (1.0 - weight) * difference, angles_x),
        angles_y,
    )
    plain = wrapped(y.uncorrected_deg - x.uncorrected_deg)
    uncorrected = np.where(used[:, 0], x.uncorrected_deg, y.uncorrected_deg)
    uncorrected = np.where(
        used[:, 0] & used[:, 1], x.uncorrected_deg + (1.0 - weight[:, 2]) * plain, uncorrected
    )
    # the latitude's error is one error of both pairs
    covariance, by_latitude = (
        part_x + part_y
        for part_x, part_y in zip(
            _weighted_errors(x, weight, used[:, 0]),
            _weighted_errors(y, 1.0 - weight, used[:, 1]),
            strict=True,
        )
    )
    covariance += outer(by_latitude)
    any_used = used[:, 0] | used[:, 1]
    covariance = np.where(any_used[:, None, None], covariance, np.nan)
    inclination = np.where(any_used, combined[:, 0], np.fmax(x.inclination_deg, y.inclination_deg))
    status = tuple(
        "" if u.any() else a if a == b else f"x: {a}; y: {b}"
        for u, a, b in zip(used, x.status, y.status, strict=True)
    )
    return Combined(
        inclination_deg=inclination,
        toolface_deg=wrapped(combined[:, 1]),
        azimuth_deg=full_circle(combined[:, 2], 360.0),
        uncorrected_deg=full_circle(uncorrected, 360.0),
        covariance=covariance,
        status=status,
        flags=_flags(x, y, used, difference),
    )


def _angles(pair: Solution) -> Array:
    """Inclination, toolface, azimuth [n, 3] [°]."""
    return np.column_stack((pair.inclination_deg, pair.toolface_deg, pair.azimuth_deg))


def _weights(x: Solution, y: Solution, used: Mask) -> Array:
    """Weight of the x pair in each angle [n, 3]: inverse variance, half where both variances are
    zero.
    """
    of_x, of_y = (np.diagonal(pair.pair_covariance, axis1=1, axis2=2)[:, ANGLES] for pair in (x, y))
    total = of_x + of_y
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(total > 0.0, of_y / total, 0.5)
    only = used[:, :1] != used[:, 1:]
    return np.where(only, used[:, :1].astype(np.float64), np.where(np.isnan(weight), 0.5, weight))


def _weighted_errors(pair: Solution, weight: Array, used: Mask) -> tuple[Array, Array]:
    """What one pair adds to the covariance [n, 3, 3] and to the changes by the latitude [n, 3]."""
    own = pair.pair_covariance[:, ANGLES][:, :, ANGLES]
    own = np.where(used[:, None, None], weight[:, :, None] * own * weight[:, None, :], 0.0)
    return own, np.where(used[:, None], weight * pair.by_latitude[:, ANGLES], 0.0)


def _flags(x: Solution, y: Solution, used: Mask, difference: Array) -> tuple[tuple[str, ...], ...]:
    """Flags [n] of both pairs, of pairs that could not be used, and of pairs that disagree."""
    lines = []
    apart = x.pair_covariance + y.pair_covariance + outer(x.by_latitude - y.by_latitude)
    variance = np.asarray(np.diagonal(apart, axis1=1, axis2=2)[:, ANGLES])
    for k in range(len(x.status)):
        flags = [*(f"x: {flag}" for flag in x.flags[k]), *(f"y: {flag}" for flag in y.flags[k])]
        if used[k].sum() == 1:
            lost, reason = ("y", y.status[k]) if used[k, 0] else ("x", x.status[k])
            flags.append(f"{lost} not used: {reason}")
        if used[k].all():
            flags += [
                f"the pairs differ by {difference[k, j]:.3f}° in {NAMES[j]}, more than their noise"
                " explains"
                for j in range(3)
                if abs(difference[k, j]) > DISAGREE * np.sqrt(variance[k, j]) + 1e-9
            ]
        lines.append(tuple(flags))
    return tuple(lines)
