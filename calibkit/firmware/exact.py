"""Exact arithmetic of coefficients: no printed digit may depend on the last bit of a mathematics
library.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from itertools import zip_longest

Poly = tuple[Fraction, ...]
"""Coefficients of a polynomial, ascending: index = power."""

DIGITS = Context(prec=60)
"""Decimal's exponential and root are correctly rounded to this many digits on every machine."""


def exp(x: Fraction) -> Fraction:
    """e^x to sixty digits."""
    return Fraction(DIGITS.exp(_decimal(x)))


def sqrt(x: Fraction) -> Fraction:
    """√x to sixty digits."""
    return Fraction(DIGITS.sqrt(_decimal(x)))


def _decimal(x: Fraction) -> Decimal:
    """Decimal of sixty digits."""
    return DIGITS.divide(Decimal(x.numerator), Decimal(x.denominator))


def add(*polynomials: Sequence[Fraction]) -> Poly:
    """Sum of polynomials."""
    return tuple(
        sum(column, Fraction(0)) for column in zip_longest(*polynomials, fillvalue=Fraction(0))
    )


def scale(polynomial: Sequence[Fraction], factor: Fraction) -> Poly:
    """Polynomial times a number."""
    return tuple(factor * c for c in polynomial)


def product(a: Sequence[Fraction], b: Sequence[Fraction]) -> Poly:
    """Product of two polynomials."""
    coefficients = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            coefficients[i + j] += x * y
    return tuple(coefficients)


def mapped(raw: Sequence[Fraction], middle: Fraction, half: Fraction) -> Poly:
    """Polynomial in u = (x − middle)/half of one in x, by Horner's scheme on polynomials."""
    polynomial: Poly = (raw[-1],)
    for c in reversed(raw[:-1]):
        polynomial = add(product(polynomial, (middle, half)), (c,))
    return polynomial


def value(polynomial: Sequence[Fraction], x: Fraction) -> Fraction:
    """Polynomial at x."""
    total = Fraction(0)
    for c in reversed(polynomial):
        total = total * x + c
    return total


def trimmed(polynomial: Sequence[Fraction]) -> Poly:
    """Polynomial without vanishing highest powers; empty where all vanish."""
    end = len(polynomial)
    while end and polynomial[end - 1] == 0:
        end -= 1
    return tuple(polynomial[:end])


def padded(polynomial: Sequence[Fraction], order: int) -> Poly:
    """Polynomial with zeros up to an order."""
    return (*polynomial, *[Fraction(0)] * (order + 1 - len(polynomial)))


def power_of_two(x: Fraction) -> int:
    """Least e with |x| ≤ 2^e, of an x that is not 0."""
    e = abs(x.numerator).bit_length() - x.denominator.bit_length() - 1
    while abs(x) > Fraction(2) ** e:
        e += 1
    return e


def round_to(x: float, digits: int, *, up: bool) -> float:
    """A number with so many digits, not below x where it is rounded up, not above it where not."""
    return float(Context(digits, ROUND_CEILING if up else ROUND_FLOOR).create_decimal(Decimal(x)))


def limits_text(low: float, high: float, digits: int = 4) -> str:
    """A range with so many digits, rounded outwards."""
    lower, upper = round_to(low, digits, up=False), round_to(high, digits, up=True)
    return f"{lower:.{digits}g} to {upper:.{digits}g}"


def span(low: float, high: float) -> tuple[Fraction, Fraction]:
    """Middle and half of a range as short binary numbers, the half rounded outwards; half > 0 also
    for a single point.

    Both are exact in every number format, so that the map to u adds no error of its own constants
    but the reciprocal's.
    """
    width = Fraction(high) - Fraction(low)
    # eleven bits: any float holds them, and the range grows by less than one percent
    quantum = Fraction(2) ** (power_of_two(width) - 10) if width > 0 else Fraction(1)
    middle = round((Fraction(low) + Fraction(high)) / 2 / quantum) * quantum
    half = -(-max(Fraction(high) - middle, middle - Fraction(low)) // quantum) * quantum
    return middle, half if half > 0 else Fraction(1)


def solve(matrix: Sequence[Sequence[Fraction]], right: Sequence[Fraction]) -> Poly:
    """Solution of a small linear system by Gauss and Jordan, exactly."""
    rows = [[*row, entry] for row, entry in zip(matrix, right, strict=True)]
    size = len(rows)
    for column in range(size):
        # exact numbers need no largest pivot
        pivot = next(k for k in range(column, size) if rows[k][column] != 0)
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [entry / rows[column][column] for entry in rows[column]]
        for k in range(size):
            if k != column:
                rows[k] = [
                    x - rows[k][column] * y for x, y in zip(rows[k], rows[column], strict=True)
                ]
    return tuple(row[-1] for row in rows)
