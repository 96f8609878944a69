"""Sensor pairs at one station: each is solved with its own s, then they are combined."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.inclinometer.numeric.root_choice import Solution
from calibkit.instruments.inclinometer.published import Sensor, full_circle
from calibkit.numeric.attitude import wrapped

ANGLES = (0, 1, 3)
"""Indices of the angles in a solution's covariance: inclination, toolface, azimuth."""
NAMES = ("inclination", "toolface", "azimuth")
DISAGREE = 5.0
"""Difference of two sensor pairs, in standard uncertainties, above which it is flagged."""
EXACT, UNKNOWN = 1e-300, 1e300
"""Least and largest variance in a weight: pairs that are both exact, or both not known, count
alike.
"""


@dataclass(frozen=True, slots=True)
class Combined:
    """North seeking of n stations by all sensor pairs; a station that no pair solves is NaN, with
    the reason in `status`.
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
    own = np.array([pair.pair_covariance[:, ANGLES][:, :, ANGLES] for pair in pairs.values()])
    by_latitude = np.array([pair.by_latitude[:, ANGLES] for pair in pairs.values()])
    variance = np.nan_to_num(np.diagonal(own, axis1=2, axis2=3), nan=UNKNOWN)
    precision = np.where(used[:, :, None], 1.0 / np.clip(variance, EXACT, UNKNOWN), 0.0)
    with np.errstate(invalid="ignore"):
        weight = precision / precision.sum(axis=0)
    # the mean about the first pair that is used; the uncorrected azimuth by the azimuth's weights
    first = angles[np.argmax(used, axis=0), np.arange(used.shape[1])]
    moved = weight[:, :, [0, 1, 2, 2]] * wrapped(angles - first)
    mean = first + np.where(used[:, :, None], moved, 0.0).sum(axis=0)
    weighted = weight[:, :, :, None] * own * weight[:, :, None, :]
    covariance = np.where(used[:, :, None, None], weighted, 0.0).sum(axis=0)
    # the latitude's error is one error of all pairs
    shared = np.where(used[:, :, None], weight * by_latitude, 0.0).sum(axis=0)
    covariance += shared[:, :, None] * shared[:, None, :]
    solved = np.asarray(used.any(axis=0), dtype=np.bool_)
    reasons = zip(*(pair.status for pair in pairs.values()), strict=True)
    return Combined(
        inclination_deg=np.where(solved, mean[:, 0], np.fmax.reduce(angles[:, :, 0])),
        toolface_deg=wrapped(mean[:, 1]),
        azimuth_deg=full_circle(mean[:, 2], 360.0),
        uncorrected_deg=full_circle(mean[:, 3], 360.0),
        covariance=np.where(solved[:, None, None], covariance, np.nan),
        status=tuple(_state_refusal(dict(zip(pairs, each, strict=True))) for each in reasons),
        flags=_flags(pairs, used),
    )


def _state_refusal(reasons: Mapping[Sensor, str]) -> str:
    """Why no pair solves a station, of the reason of each; empty where one does."""
    different = set(reasons.values())
    if "" in different:
        return ""
    if len(different) == 1:
        return different.pop()
    return "; ".join(f"{axis}: {reason}" for axis, reason in reasons.items())


def _flags(pairs: Mapping[Sensor, Solution], used: Mask) -> tuple[tuple[str, ...], ...]:
    """Flags [n] of the pairs, of pairs that could not be used, and of two that disagree."""
    if len(pairs) == 1:
        return next(iter(pairs.values())).flags
    x, y = pairs.values()
    by_latitude = x.by_latitude - y.by_latitude
    variance = np.diagonal(x.pair_covariance + y.pair_covariance, axis1=1, axis2=2) + by_latitude**2
    limit = DISAGREE * np.sqrt(variance[:, ANGLES]) + 1e-9
    apart = wrapped(
        np.column_stack(
            (
                y.inclination_deg - x.inclination_deg,
                y.toolface_deg - x.toolface_deg,
                y.azimuth_deg - x.azimuth_deg,
            )
        )
    )
    lines = []
    for k, solved in enumerate(used.T):
        flags = [f"{axis}: {flag}" for axis, pair in pairs.items() for flag in pair.flags[k]]
        if solved.any():
            flags += [
                f"{axis} not used: {pair.status[k]}"
                for axis, pair in pairs.items()
                if pair.status[k]
            ]
        flags += [
            f"the pairs differ by {apart[k, j]:.3f}° in {NAMES[j]}, more than their noise explains"
            for j in np.flatnonzero(solved.all() & (np.abs(apart[k]) > limit[k])).tolist()
        ]
        lines.append(tuple(flags))
    return tuple(lines)
