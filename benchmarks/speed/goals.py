"""What a row of the table wants, and what was found: records that measuring and writing share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from speed.pairs import Spread


@dataclass(frozen=True, slots=True)
class Goal:
    """One row of the table.

    `faster` rows ask how many times as fast as the peer calibkit is and want at least the target;
    the others ask how many times as much it takes and want at most the target.
    """

    name: str
    title: str
    peer: str
    target: float | None
    """None where the row is shown for its own sake."""
    at_rows: int
    """Rows that the target holds at."""
    digits: float | None = None
    """To which both sides must agree at least; None where they do not compute the same thing."""
    reach: float | None = None
    faster: bool = True
    clock: Literal["cpu", "wall", "peak"] = "cpu"
    """What the target is held against: the processor's time where both sides use one thread, and
    never a busy machine's.
    """
    rows_are: str = "rows"
    note: str = ""

    def reached(self, ratio: float) -> bool:
        """Whether a ratio meets the target."""
        return self.target is None or (
            ratio >= self.target if self.faster else ratio <= self.target
        )


@dataclass(frozen=True, slots=True)
class Line:
    """What was measured of one row at one size: ratios by each clock, seconds and bytes of both
    sides, agreeing digits.
    """

    name: str
    rows: int
    ratios: dict[str, Spread]
    seconds: tuple[float, float]
    """Of calibkit and of the peer, by the row's clock; nothing to compare between machines."""
    peaks: tuple[int, int]
    """Bytes beyond the data of a call, or of a whole process."""
    digits: float | None
    said: str = ""
    """What kept the row from being measured, or what must be said of this size."""

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        ratios = {
            clock: [spread.median, spread.least, spread.largest]
            for clock, spread in self.ratios.items()
        }
        return {
            "name": self.name,
            "rows": self.rows,
            "ratios": ratios,
            "seconds": list(self.seconds),
            "peaks": list(self.peaks),
            "digits": self.digits,
            "said": self.said,
        }

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> Line:
        """The line of plain values."""
        ratios = {clock: Spread(*values) for clock, values in found["ratios"].items()}
        seconds, peaks = tuple(found["seconds"]), tuple(found["peaks"])
        return cls(
            found["name"], found["rows"], ratios, seconds, peaks, found["digits"], found["said"]
        )
