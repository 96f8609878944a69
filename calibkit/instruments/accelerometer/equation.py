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

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, length
from calibkit.instruments.accelerometer import published
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.least_squares import polynomial

AXES = "xyz"
TILT = ("tilt_north_rad", "tilt_east_rad")
FIXTURE = ("fixture_x_rad", "fixture_y_rad", "fixture_z_rad")
UNITS = {"k": "1", "z": "g", "c": "1", "n": "1/g", "m": "1", "b": "g"}
"""Kind of a term → its unit; nuisance angles are in rad."""
SIGNS = {"k": 1.0, "z": -1.0, "c": -1.0, "n": 1.0, "m": 1.0, "b": -1.0}
"""Kind of a term → its sign in (1) and (2), and in M (G - b)."""
NAME = re.compile(r"[kzb]_[xyz]\d|m_[xyz]{2}\d|[cd]_[xyz]{2}|n_[xyz]_[xyz]{2,3}")
"""Of a parameter in coefficient files: letter, axis that it is added to, axes of the values that it
multiplies, power of temperature.
"""
LEAST_VOLUME = 1e-3
"""Volume that unit axes span, 1 of orthogonal ones, below which they lie in a plane."""

Orders = Sequence[int]
"""Highest power of temperature of x, y and z; -1 leaves the term out."""


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Table of the terms of the equation, a row for each of the parameters p."""

    names: tuple[str, ...]
    """In coefficient files: k_x0, z_y3, c_xy, d_xy, n_x_xx, tilt_north_rad."""
    units: tuple[str, ...]
    """In powers of °C."""
    symbol: np.ndarray
    """[p], what its powers of temperature have in common: k_x, z_y, c_xy, n_x_xx."""
    kind: np.ndarray
    """[p], letter of the symbol, tilt or fixture; m and b are entries of the matrix and the bias of
    accel-affine/1.
    """
    axis: Integers
    """[p], axis that the term is added to, or number of the nuisance angle."""
    factors: tuple[tuple[int, ...], ...]
    """Axes of the values that it multiplies: indications in (1), compensated ones in (2)."""
    power: Integers
    """[p], of temperature."""

    def start(self, scale: Array | float = 1.0, zero: Array | float = 0.0) -> Array:
        """Parameters [p] of scale factors [3] and zeros [3, g] alone, which do not change; those of
        a triad without an error.
        """
        k, z = (np.broadcast_to(constants, 3)[self.axis] for constants in (scale, zero))
        constant = np.where(self.kind == "k", k, np.where(self.kind == "z", z, 0.0))
        return np.where(self.power == 0, constant, 0.0)

    def to_degrees(self, middle: float, half: float) -> np.ndarray:
        """Matrix [p, p], in extended precision, from parameters for temperature mapped to [-1, 1]
        to those in powers of °C.
        """
        powers = polynomial.to_raw_powers(middle, half, max(1, *self.power))
        of_one_polynomial = self.symbol[:, None] == self.symbol
        return np.where(of_one_polynomial, powers[np.ix_(self.power, self.power)], 0.0)

    def add(self, kinds: str, p: Numbers, values: Numbers, t: Array) -> Numbers:
        """Sum [n, 3] of the terms of some kinds with their signs, axis by axis: polynomial of
        temperature [n] times values [n, 3].
        """
        by_axis = values.T.copy()  # an axis in a row of its own: strides take the time
        total = np.zeros(by_axis.shape, dtype=np.result_type(p, values))
        powers: list[Any] = [1.0, t]
        while len(powers) <= max(self.power):
            powers.append(powers[-1] * t)
        for symbol in dict.fromkeys(self.symbol[np.isin(self.kind, [*kinds])].tolist()):
            first, *further = np.flatnonzero(self.symbol == symbol)
            term = p[first] * powers[self.power[first]]
            for k in further:
                term = term + p[k] * powers[self.power[k]]
            for axis in self.factors[first]:
                term = term * by_axis[axis]
            total[self.axis[first]] += SIGNS[symbol[0]] * term
        return total.T

    def corrected(self, p: Numbers, indication: Array, t: Array) -> Numbers:
        """Gravity [n, 3] that indications [n, 3] mean, by (1) and (2); temperatures t [n] are in
        the unit that p is meant for.

        Of accel-affine/1, the form of 0.2, which is read and applied and no fit writes, it is
        M(t) (G - b(t)) with products of indications.
        """
        if "m" in self.kind:
            # accel-affine/1 of 0.2: M (G - b), with products of indications
            unbiased = indication + self.add("b", p, indication, t)
            return self.add("m", p, unbiased, t) + self.add("n", p, indication, t)
        # (1), then (2) on compensated values: a turn of the triad must change nothing over
        # temperature
        a = self.add("kz", p, indication, t)
        return a + self.add("cn", p, a, t)

    def at_temperature(self, p: Numbers, t: float) -> Numbers:
        """Scale factors, zeros [g] and Q1, Q2, Q3 [rad] [9] at a temperature; the sensitive axes
        are the rows of (I - C - D t)⁻¹. Raises FitError for axes that lie in a plane, and for a
        left-handed triad: one axis reversed.
        """
        k, minus_z = (self.add(kind, p, np.ones((1, 3)), np.array([t]))[0] for kind in "kz")
        minus_C = self.add("c", p, np.eye(3), np.full(3, t)).T
        # (2) inverted: rows are the axes along which the sensors feel gravity
        sensitivity = np.linalg.inv(np.eye(3) + minus_C)
        axes = sensitivity / length(sensitivity)[:, None]
        # a reversed axis has a negative scale factor, or a left-handed set of axes
        volume = np.real(np.linalg.det(axes) * np.prod(np.sign(np.real(k))))
        if not abs(volume) >= LEAST_VOLUME:
            raise FitError(
                "the three axes lie in one plane",
                hint="check that the columns of the three axes are different",
            )
        if volume < 0.0:
            raise FitError(
                "the triad is left-handed: one axis, or all three, has the wrong sign, two are"
                " exchanged, or toolface runs backwards",
                hint="state reference.convention, or sign and from of the columns, in the recipe",
            )
        return np.concatenate([k, -minus_z, published.small_angles(axes)])


@cache
def read_terms(names: tuple[str, ...]) -> Terms:
    """Terms of parameters by their names; raises FitError for a name that is none."""
    rows = []
    for name in names:
        symbol, power = name.rstrip("0123456789"), int(name[-1]) if name[-1:].isdigit() else 0
        factors: tuple[int, ...] = ()
        if name in TILT or name in FIXTURE:
            kind = "tilt" if name in TILT else "fixture"
            axis = (TILT if name in TILT else FIXTURE).index(name)
        elif NAME.fullmatch(name):
            kind = symbol[0]
            axis, *other_axes = (AXES.index(letter) for letter in symbol[1:].replace("_", ""))
            factors = (axis,) if kind == "k" else tuple(other_axes)
            if kind == "d":  # the change of c with temperature
                kind, symbol, power = "c", f"c{symbol[1:]}", 1
        else:
            raise FitError(
                f"a triad has no parameter {name!r}",
                hint="names are k_x0, z_x0, c_xy, d_xy, n_x_xx, m_xy0, b_x0 with axes x, y, z",
            )
        unit = "1/g2" if kind == "n" and len(factors) == 3 else UNITS.get(kind, "rad")
        per_degree = "/degC" + (f"{power}" if power > 1 else "") if power else ""
        rows.append((unit + per_degree, symbol, kind, axis, factors, power))
    units, symbols, kinds, axes, all_factors, powers = zip(*rows, strict=True)
    return Terms(
        *(names, units, np.array(symbols), np.array(kinds)),
        *(np.array(axes), all_factors, np.array(powers)),
    )


def name_terms(
    scale: Orders,
    zero: Orders,
    cross: Orders,
    *,
    triangular: bool = False,
    second_order: bool = False,
    third_order: bool = False,
    tilt: bool = False,
    fixture: bool = False,
) -> Terms:
    """Terms up to orders of temperature; `triangular` keeps the frame on the x axis, as fixture
    angles and lengths need it.
    """
    names = []
    for kind, orders in (("k", scale), ("z", zero)):
        for axis, order in zip(AXES, orders, strict=True):
            names += [f"{kind}_{axis}{power}" for power in range(order + 1)]
    for (i, axis), (j, other) in product(enumerate(AXES), repeat=2):
        # y and z against x, and z against y: the x axis keeps its direction
        if j < i or (j > i and not triangular):
            names += [f"{letter}_{axis}{other}" for letter in "cd"[: cross[i] + 1]]
    for axis in AXES:
        if second_order:
            names += [f"n_{axis}_{axis}{factor}" for factor in axis + AXES.replace(axis, "")]
        if third_order:
            names.append(f"n_{axis}_{axis * 3}")
    return read_terms((*names, *(TILT if tilt else ()), *(FIXTURE if fixture else ())))


def rotation(angles: Numbers) -> Numbers:
    """Rotation matrix [3, 3] of a rotation vector [3] [rad]: the exponential of its cross
    product.
    """
    from scipy.linalg import expm

    x, y, z = angles
    return np.asarray(expm(np.array([[0.0 * x, -z, y], [z, 0.0 * x, -x], [-y, x, 0.0 * x]])))


def tilted_gravity(tool_rotation: Array, tilt: Numbers) -> Numbers:
    """Gravity [n, 3] in the tool with the table's base tilted by two angles [rad], from the
    rotations [n, 3, 3] of the table's base to the tool.
    """
    # written with tilt[0], so that a complex step passes through
    down = np.stack([tilt[0], tilt[1], 1.0 + 0.0 * tilt[0]])
    return np.asarray(tool_rotation @ (down / length(down)))
