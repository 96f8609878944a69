"""The report of a run for people: names of its files, and what they are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.report.summary import Summary

TEXT, PAGE = "report.txt", "report.html"
"""Names of the reports in a run folder."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a report shows: figures, the first of which shows the verdict, and the summary in
    full.
    """

    figures: tuple[Figure, ...]
    summary: Summary
