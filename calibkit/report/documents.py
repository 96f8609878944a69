"""The report of a run for people: PDF and text of the same figures and tables; the page is made of
them too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.report import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.report.summary import Summary

PDF, TEXT, PAGE = "report.pdf", "report.txt", "report.html"
"""Names of the reports in a run folder."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a report shows: figures, the summary in full, and pages of the PDF whose tables the
    summary holds.
    """

    figures: tuple[Figure, ...]
    summary: Summary
    table_pages: tuple[Figure, ...] = ()


def printed(drawn: Drawn) -> dict[str, bytes]:
    """report.pdf, where there is something to draw, and report.txt."""
    pages = (*drawn.figures, *drawn.table_pages)
    return ({PDF: figures.pdf(pages)} if pages else {}) | {TEXT: drawn.summary.text().encode()}
