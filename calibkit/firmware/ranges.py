"""Ranges of values in exact interval arithmetic: errors scale with them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from calibkit.firmware.exact import Poly

Range = tuple[Fraction, Fraction]
ONE = (Fraction(1), Fraction(1))


def product(a: Range, b: Range) -> Range:
    """Range of a product."""
    corners = [x * y for x in a for y in b]
    return min(corners), max(corners)


def magnitude(a: Range) -> Fraction:
    """Largest magnitude."""
    return max(abs(a[0]), abs(a[1]))


def polynomial(c: Sequence[Fraction], variable: Range) -> Range:
    """Range of a polynomial around its constant: an upper bound, not the narrowest."""
    # |c₀ + Σ c_k x^k − c₀| ≤ Σ |c_k| reach^k: no search for extremes, and safe
    reach = magnitude(variable)
    spread = sum((abs(x) * reach**k for k, x in enumerate(c[1:], start=1)), Fraction(0))
    return c[0] - spread, c[0] + spread


def total(parts: Sequence[Range]) -> Range:
    """Range of a sum."""
    low, high = (sum((part[end] for part in parts), Fraction(0)) for end in (0, 1))
    return low, high


@dataclass(slots=True)
class Ranges:
    """Ranges of a chain's values while they are found, step by step."""

    tables: Mapping[str, Poly]
    bounds: Mapping[str, Fraction]
    """Largest magnitudes of values that depend on their own past."""
    values: dict[str, Range] = field(default_factory=dict)
    terms: dict[Any, list[Range]] = field(default_factory=dict)
    """Ranges of the terms of sums, which are asked for often: exact arithmetic is slow."""
