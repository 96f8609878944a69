"""Names of the figures of gyro_noise.json, written and read back in this module alone."""

import re
from typing import NamedTuple

ALLAN_DEVIATION = "allan-deviation/1"
"""Equation that the noise terms belong to."""
KINDS = ("allan", "wavelet")
PROBABILITY = "probability_of_deviation_limits"
"""Condition that holds the coverage probability of the deviations' limits."""
_DEVIATION = re.compile(rf"({'|'.join(KINDS)})_deviation_([0-9.e+-]+)_s\.(.+)")


class Deviation(NamedTuple):
    """One point of a deviation curve: its kind, averaging time [s] and record."""

    kind: str
    tau_s: float
    record: str

    @property
    def name(self) -> str:
        """Name of the figure."""
        return f"{self.kind}_deviation_{self.tau_s:.6g}_s.{self.record}"


def read_deviation(name: str) -> Deviation | None:
    """Deviation that a figure's name states; None for other figures."""
    parts = _DEVIATION.fullmatch(name)
    return Deviation(parts[1], float(parts[2]), parts[3]) if parts else None


def term_name(term: str, record: str) -> str:
    """Name of the figure of a noise term, or of the bias stability, of one record."""
    return f"{term}.{record}"


def read_term(name: str) -> tuple[str, str]:
    """Noise term (or bias stability) and record that a figure's name states."""
    term, _, record = name.partition(".")
    return term, record
