"""Units of coefficient files → D-SI: products of powers of units that the SI Brochure knows.

D-SI has no standard gravity, no part per million that every reader knows, no revolution: such a
unit becomes a number times others. Which acceleration 1 g is, is a fact of the site: with the local
gravity known, g is that many m/s²; without it, a value in g stays the ratio to local gravity that
it is.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from calibkit.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Mapping

ATOMS: dict[str, tuple[str, float]] = {
    "1": ("", 1.0),
    "sample": ("", 1.0),
    "lsb": ("", 1.0),
    "ppm": ("", 1e-6),
    "percent": ("", 1e-2),
    "s": (r"\second", 1.0),
    "ms": (r"\second", 1e-3),
    "us": (r"\second", 1e-6),
    "ns": (r"\second", 1e-9),
    "min": (r"\minute", 1.0),
    "h": (r"\hour", 1.0),
    "d": (r"\day", 1.0),
    "Hz": (r"\hertz", 1.0),
    "degC": (r"\degreecelsius", 1.0),
    "K": (r"\kelvin", 1.0),
    "deg": (r"\degree", 1.0),
    "mdeg": (r"\degree", 1e-3),
    "arcmin": (r"\arcminute", 1.0),
    "arcsec": (r"\arcsecond", 1.0),
    "rad": (r"\radian", 1.0),
    "mrad": (r"\radian", 1e-3),
    "urad": (r"\radian", 1e-6),
    "rev": (r"\degree", 360.0),
    "m": (r"\metre", 1.0),
    "cm": (r"\metre", 1e-2),
    "mm": (r"\metre", 1e-3),
    "V": (r"\volt", 1.0),
    "mV": (r"\volt", 1e-3),
    "uV": (r"\volt", 1e-6),
    "A": (r"\ampere", 1.0),
    "mA": (r"\ampere", 1e-3),
    "ohm": (r"\ohm", 1.0),
}
"""Unit → the D-SI unit of the same kind (none for a pure number), and how many of it one is."""
GRAVITY: dict[str, float] = {"g": 1.0, "mg": 1e-3, "ug": 1e-6}
"""Units of acceleration that local gravity is one of, or a part of."""
REPLACED: dict[str, str] = {"rpm": "rev/min"}
"""Units that are a compound of others."""
CELSIUS, KELVIN = r"\degreecelsius", r"\kelvin"
_POWER = re.compile(r"(?<=[A-Za-z)])\^?(-?\d+(?:\.\d+)?)")
"""A power, with or without its mark: m^2, degC3."""


@dataclass(frozen=True, slots=True)
class DccUnit:
    """A D-SI unit as powers of its parts, the factor that a value is multiplied by, and the power
    of local gravity in it.
    """

    powers: Mapping[str, Fraction] = field(default_factory=dict)
    factor: float = 1.0
    gravity: Fraction = Fraction(0)

    def __mul__(self, other: DccUnit) -> DccUnit:
        powers = {
            n: self.powers.get(n, Fraction(0)) + other.powers.get(n, Fraction(0))
            for n in dict.fromkeys((*self.powers, *other.powers))
        }
        nonzero_powers = {name: power for name, power in powers.items() if power}
        return DccUnit(nonzero_powers, self.factor * other.factor, self.gravity + other.gravity)

    def __pow__(self, power: Fraction) -> DccUnit:
        powers = {name: exponent * power for name, exponent in self.powers.items()}
        return DccUnit(powers, self.factor ** float(power), self.gravity * power)

    def with_gravity(self, gravity_mps2: float | None) -> DccUnit:
        """The unit with g as the given m/s²; unknown, g stays a ratio to local gravity."""
        if not self.gravity or gravity_mps2 is None:
            return DccUnit(self.powers, self.factor)
        meters = DccUnit({r"\metre": Fraction(1), r"\second": Fraction(-2)}, gravity_mps2)
        return DccUnit(self.powers, self.factor) * meters**self.gravity

    @property
    def text(self) -> str:
        r"""Spelling in D-SI: \degree\hour\tothe{-1}, \one for a pure number."""
        powers = {name: power for name, power in self.powers.items() if power}
        if powers != {CELSIUS: 1}:  # a degree of a difference, which is a kelvin
            powers = {KELVIN if name == CELSIUS else name: power for name, power in powers.items()}
        parts = (
            name if power == 1 else f"{name}\\tothe{{{float(power):g}}}"
            for name, power in powers.items()
        )
        return "".join(parts) or r"\one"


def dsi(unit: str) -> DccUnit:
    """D-SI unit of a unit as calibkit spells it; OutputError for one that the table lacks.

    A unit is an expression of atoms, which Python's own parser takes apart.
    """
    expression = _POWER.sub(r"**\1", unit.replace("%", "percent"))
    try:
        return _evaluate(ast.parse(expression, mode="eval").body)
    except (SyntaxError, ValueError, KeyError, RecursionError, MemoryError):
        raise OutputError(f"unit '{unit}' has no D-SI spelling", hint="this is a bug") from None


def _evaluate(node: ast.expr) -> DccUnit:  # noqa: PLR0911 (one return per kind of expression)
    """Unit of an expression: products, quotients, powers, square roots; ValueError or KeyError for
    anything else.
    """
    match node:
        case ast.BinOp(left, ast.Mult(), right):
            return _evaluate(left) * _evaluate(right)
        case ast.BinOp(left, ast.Div(), right):
            return _evaluate(left) * _evaluate(right) ** Fraction(-1)
        case ast.BinOp(left, ast.Pow(), right):
            return _evaluate(left) ** Fraction(ast.literal_eval(right))
        case ast.Call(ast.Name("sqrt"), [radicand]):
            return _evaluate(radicand) ** Fraction(1, 2)
        case ast.Name(name) if name in REPLACED:
            return dsi(REPLACED[name])
        case ast.Name(name) if name in GRAVITY:
            return DccUnit(factor=GRAVITY[name], gravity=Fraction(1))
        case ast.Name() | ast.Constant(1):
            spelling, factor = ATOMS["1" if isinstance(node, ast.Constant) else node.id]
            return DccUnit({spelling: Fraction(1)} if spelling else {}, factor)
    raise ValueError(node)
