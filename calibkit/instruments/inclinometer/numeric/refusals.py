"""Why a station is refused before its root is chosen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric import published
from calibkit.instruments.inclinometer.numeric.published import Attitude, Components


@dataclass(frozen=True, slots=True)
class Limits:
    """Where a station is refused, and where its s is not used."""

    latitude_deg: float = 80.0
    """|latitude| above which the earth's horizontal rate is too small for an azimuth."""
    vertical_deg: float = 0.5
    """Inclination below which toolface and azimuth are not separable."""
    horizontal_deg: float = 85.0
    """Inclination above which neither inclination nor azimuth can be had from the sensors across
    the tool.
    """
    s_uncertainty: float = 0.02
    """Standard uncertainty of a root above which s is its prior."""
    separation: float = 6.0
    """Standard uncertainties from the middle of both roots, twice those of the discriminant from
    zero, below which noise alone could have parted the roots.
    """


def _joined(before: Sequence[str], own: tuple[str, ...]) -> tuple[str, ...]:
    """Reasons known before, and the stations' own where there are none."""
    if not before:
        return own
    if len(before) != len(own):
        raise FitError(f"{len(before)} reasons for {len(own)} stations")
    return tuple(first or second for first, second in zip(before, own, strict=True))


def _refusals(
    parts: Components, found: Attitude, latitude: Array, limits: Limits
) -> tuple[str, ...]:
    """Why each station is refused; empty where it is not."""
    inclination = np.degrees(found.inclination)
    total = np.degrees(published.toolface_plus_azimuth(parts.gyro_x, parts.gyro_y))
    inputs = np.column_stack((parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y, latitude))
    finite = [bool(np.isfinite(row).all()) for row in inputs]
    silent = (parts.gyro_x == 0.0) & (parts.gyro_y == 0.0)
    rows = zip(finite, silent, latitude, inclination, total, strict=True)
    return tuple(
        _refusal(a, bool(b), float(c), float(d), float(e), limits) for a, b, c, d, e in rows
    )


def _refusal(
    finite: bool,  # noqa: FBT001 - one row of the table of facts above
    silent: bool,  # noqa: FBT001 - the same
    latitude: float,
    inclination: float,
    total: float,
    limits: Limits,
) -> str:
    """Reason to refuse one station, or nothing."""
    if not finite:
        return "an indication or the latitude is not finite"
    if abs(latitude) > limits.latitude_deg:
        return (
            f"latitude {latitude:g}° is beyond {limits.latitude_deg:g}°: the earth's horizontal"
            " rate is too small for an azimuth"
        )
    if inclination > limits.horizontal_deg:
        return (
            f"inclination {inclination:.2f}° is above {limits.horizontal_deg:g}°: sensors across"
            " the tool give no azimuth there"
        )
    if inclination < limits.vertical_deg:
        return (
            f"inclination {inclination:.3f}° is below {limits.vertical_deg:g}°: toolface and"
            f" azimuth are not separable, their sum is {total:.2f}°"
        )
    return "the gyros show no rate at all" if silent else ""
