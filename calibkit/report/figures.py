"""Pages of figures as one PDF, the same bytes for the same figures."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, RAW, DENOISED, GOOD, ALERT = "#1b1b1e", "#6b7280", "#b8bec9", "#4477aa", "#228833", "#cc3311"
"""Colours that stay apart for colour-blind readers and in grey print (after Tol, bright scheme)."""
SIDES = {"heating": "#cc3311", "cooling": "#4477aa", "both": "#228833"}

STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "axes.grid": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
    "pdf.fonttype": 3,  # outlines: cutting a TrueType font down takes longer than a small fit; the text stays text
    "svg.hashsalt": "calibkit",
    "figure.constrained_layout.use": True,
}


def page(rows: int, columns: int, *, title: str, height: float = 8.0) -> tuple[Figure, list[Axes]]:
    """Figure of rows × columns panels with a title line, and its axes in reading order."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold", color=INK)
    return figure, list(axes.flat)


def pdf(figures: Sequence[Figure]) -> bytes:
    """Figures as the pages of one PDF without a clock in it."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    buffer = io.BytesIO()
    quiet = {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": "calibkit"}
    with mpl.rc_context(STYLE), PdfPages(buffer, metadata=quiet) as pages:
        for figure in figures:
            pages.savefig(figure)
    return buffer.getvalue()


def png(figure: Figure, dpi: int = 110) -> bytes:
    """One figure as PNG without a clock or a version in it."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()
