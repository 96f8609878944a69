"""Figures of a certificate: drawn by matplotlib as those of a report, with the words beside them,
which the PDF's template sets in the certificate's own fonts.
"""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibkit.certificate.results import CertificateFigure
    from calibkit.certificate.words import Lang

COLOURS = ("#1d3c5e", "#cc3311", "#228833", "#aa3377", "#996600", "#0077aa")
MARKS = (("●", "o"), ("■", "s"), ("▲", "^"), ("◆", "D"))
"""Mark of a curve in a legend, and what matplotlib calls it."""
ALONE_MM, BESIDE_MM = (120.0, 52.0), (84.0, 46.0)
"""Width and height of a block's only figure, and of one of several."""
FONT = "Libertinus Serif"
"""Font of the numbers at the axes, which is that of the pages."""
INCH_MM = 25.4


def lay_out_figure(figure: CertificateFigure, lang: Lang) -> dict[str, Any]:
    """JSON object of the words of a figure: title, axes, and a legend of several curves."""
    looks = zip(figure.series, cycle(COLOURS), cycle(MARKS), strict=False)
    legend = [[mark, colour, curve.label.of(lang)] for curve, colour, (mark, _) in looks]
    return {
        "title": figure.title.of(lang),
        "x_label": figure.x_label.of(lang),
        "y_label": figure.y_label.of(lang),
        "legend": legend if len(legend) > 1 else [],
    }


def draw(figure: CertificateFigure, size_mm: tuple[float, float]) -> str:
    """SVG of a figure without its words: the same for the same figure."""
    from matplotlib.figure import Figure

    from calibkit.report import figures, svg

    width_mm, height_mm = size_mm
    with figures.styled():
        drawing = Figure(figsize=(width_mm / INCH_MM, height_mm / INCH_MM), layout="constrained")
        ax = drawing.subplots()
        if figure.log:
            ax.set(xscale="log", yscale="log")
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_formatter("{x:g}")
        else:
            ax.ticklabel_format(useOffset=False)
        ax.tick_params(labelsize=7.5)
        for curve, colour, (_, mark) in zip(
            figure.series, cycle(COLOURS), cycle(MARKS), strict=False
        ):
            ax.plot(curve.x, curve.y, color=colour, marker=mark, markersize=3.0, linewidth=0.9)
            ax.vlines(curve.x, curve.low, curve.high, color=colour, linewidth=0.6)
            if len(curve.x) > 1:
                ax.fill_between(
                    curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0.0
                )
    figures.settle([drawing])
    (image,), _ = svg.inline([drawing])
    head = f'<svg xmlns="http://www.w3.org/2000/svg" font-family="{FONT}"'
    return image.replace("<svg", head, 1)
