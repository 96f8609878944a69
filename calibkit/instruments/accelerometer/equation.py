"""Triad over temperature, with cross-axis terms that act on compensated values.

    a_i = G_i (k_i0 + k_i1 t + k_i2 t² + k_i3 t³) - (z_i0 + z_i1 t + z_i2 t² + z_i3 t³)        (1)
    g_i = a_i - (c_ij + d_ij t) a_j - (c_ik + d_ik t) a_k
              + n_i,ii a_i² + n_i,ij a_i a_j + n_i,ik a_i a_k + n_i,iii a_i³                   (2)

G are indications, g is gravity in the frame of the triad, t the temperature. Where cross-axis terms
act on indications and are constant, as K8 and K9 of the published form do, the true effect grows
with the scale factor over temperature and theirs does not: beside an index error of each attitude,
which takes the mean of the attitude, that false change decides about them. In (2) a turn of the
triad changes nothing over temperature.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative, length
from calibkit.instruments.accelerometer import published
from calibkit.numeric.least_squares import polynomial

AXES = "xyz"
TILT = ("tilt_north_rad", "tilt_east_rad")
FIXTURE = ("fixture_x_rad", "fixture_y_rad", "fixture_z_rad")
SMALL_ANGLE = 1e-3
"""Angle [rad] below which the series of sin(a)/a has all digits."""

PER_DEGREE = ("", "/degC", *(f"/degC{power}" for power in range(2, 10)))
"""What a power of temperature [°C] adds to the unit of its coefficient."""

Orders = Sequence[int]
"""Highest power of temperature of x, y and z; -1 leaves the term out."""


@dataclass(frozen=True, slots=True)
class Term:
    """One parameter of the equation."""

    name: str
    """In coefficient files: k_x0, z_y3, c_xy, d_xy, n_x_xx, tilt_north_rad."""
    unit: str
    """In powers of °C."""
    symbol: str
    """k_x, z_y, c_xy, n_x_xx, tilt_north_rad: what its powers of temperature have in common."""
    kind: Literal["k", "z", "c", "n", "tilt", "fixture", "m", "b"]
    """The last two are entries of the matrix and the bias of accel-affine/1."""
    axis: int
    """Axis that the term is added to, or number of the nuisance angle."""
    factors: tuple[int, ...] = ()
    """Axes of the values that the term multiplies: indications in (1), compensated ones in (2)."""
    power: int = 0
    """Power of temperature."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Parameters p of the equation, in their order."""

    listed: tuple[Term, ...]

    @classmethod
    def of_orders(
        cls,
        scale: Orders,
        zero: Orders,
        cross: Orders,
        *,
        triangular: bool = False,
        second_order: bool = False,
        third_order: bool = False,
        tilt: bool = False,
        fixture: bool = False,
    ) -> "Terms":
        """Parameters up to orders of temperature; `triangular` keeps the frame on the x axis, as
        fixture angles and lengths need it.
        """
        terms: list[Term] = []
        kinds: list[tuple[Literal["k", "z"], Orders, str]] = [("k", scale, "1"), ("z", zero, "g")]
        for (kind, orders, unit), (i, axis) in product(kinds, enumerate(AXES)):
            factors = (i,) if kind == "k" else ()  # scale factors multiply the indication
            for n in range(orders[i] + 1):
                symbol, per = f"{kind}_{axis}", PER_DEGREE[n]
                terms.append(Term(f"{symbol}{n}", unit + per, symbol, kind, i, factors, n))
        for i, j in product(range(3), repeat=2):
            if j < i or (j > i and not triangular):
                axes = AXES[i] + AXES[j]
                for n, letter in enumerate("cd"[: cross[i] + 1]):
                    unit = "1" + PER_DEGREE[n]
                    terms.append(Term(f"{letter}_{axes}", unit, f"c_{axes}", "c", i, (j,), n))
        for i in range(3):
            products = [(i, i), *((i, j) for j in range(3) if j != i)] if second_order else []
            for higher in [*products, *([(i, i, i)] if third_order else [])]:
                name = f"n_{AXES[i]}_{''.join(AXES[j] for j in higher)}"
                unit = "1/g" if len(higher) == 2 else "1/g2"
                terms.append(Term(name, unit, name, "n", i, higher))
        tilts = [Term(name, "rad", name, "tilt", i) for i, name in enumerate(TILT)]
        turns = [Term(name, "rad", name, "fixture", i) for i, name in enumerate(FIXTURE)]
        return cls((*terms, *(tilts if tilt else ()), *(turns if fixture else ())))

    @classmethod
    def named(cls, names: Sequence[str]) -> "Terms":
        """Parameters of a coefficient file; raises FitError for a name that is none of them."""
        unknown = [name for name in names if name not in _BY_NAME]
        if unknown:
            raise FitError(
                f"a triad has no parameter {unknown[0]!r}",
                hint="names are k_x0, z_x0, c_xy, d_xy, n_x_xx, m_xy0, b_x0 with axes x, y, z",
            )
        return cls(tuple(_BY_NAME[name] for name in names))

    @property
    def names(self) -> tuple[str, ...]:
        """Names [p]."""
        return tuple(term.name for term in self.listed)

    @property
    def order(self) -> int:
        """Highest power of temperature."""
        return max(term.power for term in self.listed)

    @property
    def polynomials(self) -> dict[str, list[int]]:
        """Symbol → places of its terms, in ascending powers of temperature."""
        places: dict[str, list[int]] = {}
        for k, term in enumerate(self.listed):
            places.setdefault(term.symbol, []).append(k)
        return places

    @property
    def nominal(self) -> Array:
        """Parameters [p] of a triad without an error."""
        return self.of_constants(np.ones(3), np.zeros(3))

    def of_constants(self, scale: Array, zero: Array) -> Array:
        """Parameters [p] of scale factors [3] and zeros [3, g] alone, which do not change."""
        constants = {"k": scale, "z": zero}
        return np.array(
            [
                constants[term.kind][term.axis] if term.kind in "kz" and term.power == 0 else 0.0
                for term in self.listed
            ]
        )

    def of_axis(self, axis: int) -> list[int]:
        """Places of the parameters that are added to an axis."""
        return [k for k, t in enumerate(self.listed) if t.axis == axis and t.kind in "kzcn"]

    def of_kind(self, *kinds: str) -> list[int]:
        """Places of the parameters of some kinds."""
        return [k for k, term in enumerate(self.listed) if term.kind in kinds]

    def in_degrees(self, middle: float, half: float) -> np.ndarray:
        """Matrix [p, p], in extended precision, from parameters for temperature mapped to [-1, 1]
        to those in powers of °C.
        """
        powers = polynomial.to_raw_powers(middle, half, max(self.order, 1))
        matrix = np.eye(len(self.listed), dtype=np.longdouble)
        for places in self.polynomials.values():
            orders = [self.listed[k].power for k in places]
            matrix[np.ix_(places, places)] = powers[np.ix_(orders, orders)]
        return matrix

    def sum_terms(self, kinds: str, p: Numbers, components: Numbers, t: Array) -> Numbers:
        """Sum [n, 3] of the terms of some kinds, axis by axis: polynomial of temperature [n] times
        components [n, 3].
        """
        columns = components.T.copy()  # an axis in a row of its own: strides take the time
        total = np.zeros(columns.shape, dtype=np.result_type(p, components))
        powers: list[Any] = [1.0, t]
        while len(powers) <= self.order:
            powers.append(powers[-1] * t)
        for places in self.polynomials.values():
            term = self.listed[places[0]]
            if term.kind in kinds:
                size = sum(p[k] * powers[self.listed[k].power] for k in places)
                for axis in term.factors:
                    size = size * columns[axis]
                total[term.axis] += size
        return total.T

    def corrected(self, p: Numbers, indication: Array, t: Array) -> Numbers:
        """Gravity [n, 3] that indications [n, 3] mean, by (1) and (2); temperatures t [n] are in
        the unit that p is meant for.

        Of accel-affine/1, the form of 0.2, which is read and applied and no fit writes, it is
        M(t) (G - b(t)) with products of indications.
        """
        if self.of_kind("m"):
            unbiased = indication - self.sum_terms("b", p, indication, t)
            return self.sum_terms("m", p, unbiased, t) + self.sum_terms("n", p, indication, t)
        a = self.sum_terms("k", p, indication, t) - self.sum_terms("z", p, indication, t)
        return a - self.sum_terms("c", p, a, t) + self.sum_terms("n", p, a, t)

    def axes(self, p: Numbers, t: float) -> Numbers:
        """Unit vectors [3, 3] of the sensitive axes at a temperature: rows of (I - C - D t)⁻¹."""
        C = self.sum_terms("c", p, np.eye(3), np.full(3, t)).T
        sensitivity = np.linalg.inv(np.eye(3) - C)
        return sensitivity / length(sensitivity)[:, None]

    def small_angles(self, p: Numbers, t: float) -> Numbers:
        """Q1, Q2, Q3 [3] [rad] at a temperature."""
        return published.small_angles(self.axes(p, t))

    def at_temperature(self, p: Numbers, t: float) -> Numbers:
        """Scale factors, zeros [g] and Q [rad] [9] at a temperature."""
        along_axes = np.ones((1, 3)), np.array([t])
        k, z = (self.sum_terms(kind, p, *along_axes)[0] for kind in "kz")
        return np.concatenate([k, z, self.small_angles(p, t)])

    def slopes(self, p: Array, indication: Array, t: Array) -> Array:
        """Derivatives [n, 3, p] of the corrected values by the parameters."""
        return derivative(lambda q: self.corrected(q, indication, t), p)


_BY_NAME = {
    term.name: term
    for term in (
        *Terms.of_orders(
            *((9, 9, 9), (9, 9, 9), (1, 1, 1)),
            second_order=True,
            third_order=True,
            tilt=True,
            fixture=True,
        ).listed,
        *(
            Term(f"m_{AXES[i]}{AXES[j]}{n}", "", f"m_{AXES[i]}{AXES[j]}", "m", i, (j,), n)
            for i, j, n in product(range(3), range(3), range(10))
        ),
        *(
            Term(f"b_{AXES[i]}{n}", "", f"b_{AXES[i]}", "b", i, (), n)
            for i, n in product(range(3), range(10))
        ),
    )
}
"""Name → parameter, for every one that a coefficient file can hold."""


def rotation(angles: Numbers) -> Numbers:
    """Rotation matrix [3, 3] of a rotation vector [3] [rad] (Rodrigues 1840)."""
    x, y, z = angles
    cross = np.array([[0.0 * x, -z, y], [z, 0.0 * x, -x], [-y, x, 0.0 * x]])
    square = x**2 + y**2 + z**2
    if np.real(square) < SMALL_ANGLE**2:
        first, second = 1.0 - square / 6.0 + square**2 / 120.0, 0.5 - square / 24.0
    else:
        angle = np.sqrt(square)
        first, second = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def tilted_gravity(tool_rotation: Array, tilt: Numbers) -> Numbers:
    """Gravity [n, 3] in the tool with the table's base tilted by two angles [rad], from the
    rotations [n, 3, 3] of the table's base to the tool.
    """
    down = np.stack([tilt[0], tilt[1], 1.0 + 0.0 * tilt[0]])
    return np.asarray(tool_rotation @ (down / length(down)))
