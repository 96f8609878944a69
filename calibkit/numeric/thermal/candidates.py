"""Models of a bias that are held against each other on ramps that were left out of the fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from calibkit.errors import FitError
from calibkit.numeric.thermal.lagged import LagSearch
from calibkit.numeric.thermal.level import Basis
from calibkit.numeric.thermal.pooled_fit import Solution

CLEARLY = 0.95
"""Largest ratio of the error on left-out ramps to that without a model with which one may be
exported.
"""
STATIC = ("b0", "b1", "b2", "b3")


@dataclass(frozen=True, slots=True)
class Candidate:
    """Candidate model: its name, form and terms."""

    name: str
    form: Literal["level", "lagged", "bank"]
    terms: tuple[str, ...]


def solve(
    candidates: Sequence[Candidate], basis: Basis
) -> tuple[list[tuple[Candidate, Solution]], list[str]]:
    """Fits of the candidates of level and lagged form to all ramps, and why others have none."""
    solved: list[tuple[Candidate, Solution]] = []
    refused: list[str] = []
    search = LagSearch.of_rows(basis.rows)
    lagged = any(candidate.form == "lagged" for candidate in candidates)
    grid = search.on_grid() if lagged else None
    for candidate in candidates:
        try:
            if candidate.form == "lagged" and grid is not None:
                solved.append((candidate, search.solve(candidate.terms, grid)))
            elif candidate.form == "level":
                solved.append((candidate, basis.solve(candidate.terms)))
        except FitError as error:
            refused.append(f"{candidate.name}: {error.message}")
    return solved, refused
