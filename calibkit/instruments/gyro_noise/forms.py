"""Names of the figures of gyro_noise.json, written and read back in this module alone."""

import re
from typing import NamedTuple

ALLAN_DEVIATION = "allan-deviation/1"
"""Equation that the noise terms belong to."""
KINDS = ("allan", "wavelet")
PROBABILITY = "probability_of_deviation_limits"
"""Condition that holds the coverage probability of the deviations' limits."""
_DEVIATION = re.compile(rf"({'|'.join(KINDS)})_deviation_([0-9.e+-]+)_s\.(.+)")


class FigureName(NamedTuple):
    """What the name of a figure says: noise term, mean, bias stability or kind of deviation; the
    record that it is of; and the averaging time [s] of a deviation.
    """

    term: str
    record: str
    tau_s: float | None = None

    def __str__(self) -> str:
        averaged = "" if self.tau_s is None else f"_deviation_{self.tau_s:.6g}_s"
        return f"{self.term}{averaged}.{self.record}"


def read_name(name: str) -> FigureName:
    """What the name of a figure says."""
    parts = _DEVIATION.fullmatch(name)
    if parts:
        return FigureName(parts[1], parts[3], float(parts[2]))
    term, _, record = name.partition(".")
    return FigureName(term, record)
