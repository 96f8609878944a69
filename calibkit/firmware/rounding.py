"""What the errors of a program's values are made of: rounded numbers of its tables, and one
rounding an operation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calibkit.firmware.ranges import Ranges


@dataclass(frozen=True, slots=True)
class Rounding:
    """Magnitudes and rounding errors of a program."""

    bits: int
    """Significant bits of a number."""
    ranges: Ranges
    reaches: Mapping[str, float]
    """Largest magnitude of each value."""
    stored: Mapping[str, Sequence[float]]
    """How far each number of a table is from the exact one."""

    def of(self, reach: float) -> float:
        """Error of one rounding of a number of that magnitude."""
        return float(2.0**-self.bits) * reach
