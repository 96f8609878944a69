"""What was left out of a fit, as facts: how many of how many of what, and why.

The names of the fields are keys of run.json.
"""

from dataclasses import dataclass
from typing import Literal

from calibkit.records.sealed import read_as

Kind = Literal["rows", "samples", "positions", "stations"]
Cause = Literal["excluded", "incomplete", "missing", "outlier", "unsolved"]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """`count` of `of` rows, samples, positions or stations that a fit did not use, where, and why:
    a person excluded them, a needed value is missing, they are not in the log, they are outliers,
    or they give no result.
    """

    what: Kind
    count: int
    of: int
    cause: Cause
    where: str = ""
    """Log or sensor; empty for all."""


def loads(entries: object, name: str) -> tuple[LeftOut, ...]:
    """Facts of a run.json; CoefficientError for what is none."""
    return read_as(tuple[LeftOut, ...], entries, name, "a list of what was left out")
