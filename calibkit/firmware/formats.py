"""Number formats of firmware: IEEE 754 single and double."""

from dataclasses import dataclass
from fractions import Fraction

from calibkit.errors import UsageError


@dataclass(frozen=True, slots=True)
class Format:
    """How a number is stored, what C calls it, and how it is printed."""

    name: str
    c_type: str
    bits: int
    """Significant bits."""

    @property
    def size(self) -> int:
        """Bytes of a number."""
        return 4 if self.bits == 24 else 8

    def nearest(self, x: Fraction) -> float:
        """Number of the format nearest to x, ties to even."""
        if x == 0:
            return 0.0
        e = abs(x.numerator).bit_length() - x.denominator.bit_length()
        quantum = Fraction(2) ** (e - self.bits)
        if abs(x) / quantum >= 2**self.bits:
            quantum *= 2
        # denormal numbers keep the spacing of the smallest normal one
        quantum = max(quantum, Fraction(2) ** (-149 if self.bits == 24 else -1074))
        return float(round(x / quantum) * quantum)

    def text(self, x: float) -> str:
        """C literal that reads back to the same number."""
        # digits that give every number of the format back
        digits = f"{x:.9g}" if self.bits == 24 else f"{x:.17g}"
        # without a point C reads an integer, and 1F is no constant
        literal = digits if any(mark in digits for mark in ".e") else f"{digits}.0"
        return f"{literal}F" if self.bits == 24 else literal

    @staticmethod
    def find(name: str) -> "Format":
        """Number format of that name, or UsageError."""
        if name not in FORMATS:
            raise UsageError(
                f"--number {name}: no such number format",
                hint=f"the formats are {', '.join(FORMATS)}",
            )
        return FORMATS[name]


FORMATS = {
    "f32": Format("f32", "float", 24),
    "f64": Format("f64", "double", 53),
}
