"""What planned stations will tell of s(T): the roots of exact stations, with their uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.instruments.inclinometer.numeric.covariance import root_slopes
from calibkit.instruments.inclinometer.numeric.root_choice import Limits, estimate_roots
from calibkit.instruments.inclinometer.published import Components
from calibkit.numeric.information import Information, find_information
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Effect, Known

WALK, ACCEL = ("reading", "bias walk"), ("reading", "accelerometer noise")
INDEX, SCATTER = ("position", "index"), ("station", "scale")
TURN, OF_LOG = ("mounting", "gyro turn"), ("log", "scale")
UNITS = {WALK: "deg/h", ACCEL: "g", INDEX: "deg", SCATTER: "1", TURN: "deg", OF_LOG: "1"}
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""

Sizes = Mapping[tuple[str, str], Known]


@dataclass(frozen=True, slots=True)
class Roots:
    """Roots of s at n stations of one sensor pair."""

    degc: Array
    u: Array
    """Standard uncertainty of each, of what it shares with no other."""
    by_turn: Array
    """Derivative by a turn of the gyro [1/°]."""
    log: Integers

    def join(self, other: "Roots") -> "Roots":
        """These stations and those of other logs."""
        return Roots(
            np.concatenate([self.degc, other.degc]),
            np.concatenate([self.u, other.u]),
            np.concatenate([self.by_turn, other.by_turn]),
            np.concatenate([self.log, other.log + int(self.log.max(initial=-1)) + 1]),
        )

    def information(
        self,
        order: int,
        range_degc: tuple[float, float],
        sizes: Sizes,
        *,
        turn: bool = False,
    ) -> Information:
        """Information on the powers of temperature, mapped from the range of use to [−1, 1], and on
        a turn of the gyro [°], which a fit measures.
        """
        middle, half = polynomial.middle_and_half(np.array(range_degc))
        powers = polynomial.powers(self.degc, order, middle=middle, half=half)
        every = np.zeros(self.u.size, dtype=np.int64)
        effects = [
            Effect(*TURN, every, self.by_turn, sizes.get(TURN)),
            Effect(*OF_LOG, self.log, np.ones(self.u.size), sizes.get(OF_LOG)),
        ]
        if turn:
            powers, effects = np.column_stack([powers, self.by_turn]), effects[1:]
        weighted = [one.divided_by(self.u) for one in effects]
        return find_information(powers / self.u[:, None], 1.0, weighted)


def size_of(sizes: Sizes, name: tuple[str, str]) -> float:
    """Standard deviation of an error; 0 where none is assumed."""
    found = sizes.get(name)
    return 0.0 if found is None else found.value


def own_uncertainty(
    parts: Components, latitude_deg: float, plus: Mask, u_root: Array, sizes: Sizes
) -> tuple[Array, Array]:
    """Standard uncertainty of each root [n] with index errors and scatter, and its derivative by a
    turn of the gyro [1/°].
    """
    none = np.zeros_like(parts.gyro_x)
    gradient = root_slopes(parts, np.full(plus.size, latitude_deg), plus)[:, :4]
    turned = np.column_stack([none, none, parts.gyro_y, -parts.gyro_x])
    sheared = np.column_stack([parts.accel_y, parts.accel_x, parts.gyro_y, parts.gyro_x]) / 2.0
    by_turn, by_index = (
        np.radians(np.sum(gradient * moved, axis=1)) for moved in (turned, sheared)
    )
    index = by_index * size_of(sizes, INDEX)
    return np.sqrt(u_root**2 + index**2 + size_of(sizes, SCATTER) ** 2), by_turn


def plan_stations(
    gravity: Array,
    rate_dph: Array,
    noise_dph: float,
    latitude_deg: float,
    limits: Limits,
    sizes: Sizes,
) -> tuple[Array, Array]:
    """Standard uncertainty of the root of s = 1 at stations with vectors of gravity [n, 3] [g] and
    of the earth's rate [n, 3] [°/h] in the tool, infinite where a fit would not use it, and its
    derivative by a turn [1/°].
    """
    # half differences of two positions; the bias walks over both steps between them
    gyro = (noise_dph**2 + size_of(sizes, WALK) ** 2) / 2.0
    accel = size_of(sizes, ACCEL) ** 2 / 2.0
    covariance = np.tile(np.diag([accel, accel, gyro, gyro]), (len(gravity), 1, 1))
    across = (gravity[:, 0], gravity[:, 1], rate_dph[:, 0], rate_dph[:, 1])
    parts = Components(*across, covariance)
    found = estimate_roots(parts, latitude_deg, limits=limits)
    column = np.argmin(np.abs(found.s - 1.0), axis=1)
    rows = np.arange(column.size)
    used = found.usable[rows, column] & ~(found.s > 0.0).all(axis=1)
    used &= np.array([not reason for reason in found.status])
    u_root = np.where(used, found.uncertainty[rows, column], np.inf)
    u, by_turn = own_uncertainty(parts, latitude_deg, column == 0, u_root, sizes)
    return u, np.where(used, by_turn, 0.0)
