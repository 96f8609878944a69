"""What matplotlib makes PDF with, imported without what it never uses for it."""

from calibkit.libraries.lean_imports import only_when_used

# it cuts TrueType fonts down, which `pdf.fonttype` 3 does not ask for
only_when_used("fontTools", "subset")

from matplotlib.backends.backend_pdf import (  # noqa: E402
    FigureCanvasPdf,
    PdfPages,
)

__all__ = ["FigureCanvasPdf", "PdfPages"]
