"""Pages of figures as one PDF, the same bytes for the same figures."""

from __future__ import annotations

import contextlib
import io
import threading
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

INK, MUTED, RAW, DENOISED, GOOD, ALERT = (
    "#1b1b1e",
    "#6b7280",
    "#b8bec9",
    "#4477aa",
    "#228833",
    "#cc3311",
)
"""Colours that stay apart for colour-blind readers and in grey print (after Tol, bright scheme)."""
SIDES = {"heating": "#cc3311", "cooling": "#4477aa", "both": "#228833"}

WIDE_FONTS = (
    "Noto Sans CJK SC",
    "WenQuanYi Zen Hei",
    "Microsoft YaHei",
    "SimHei",
    "PingFang SC",
    "Source Han Sans SC",
)
"""Fonts with Chinese letters, one of which most systems that need them have."""
WIDE_FILES = ("notosanscjk", "wqy-zenhei", "msyh", "simhei", "pingfang", "sourcehansanssc")
"""How their files are called."""
WIDE = "\u2e80"
"""From here on letters are not in the font that matplotlib brings."""

POINTS = 72.0
"""Units of an SVG in an inch."""
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
    "pdf.fonttype": (
        3
    ),  # outlines: cutting a TrueType font down takes longer than a small fit; the text stays text
    "svg.hashsalt": "calibkit",
}


# matplotlib's settings are one for all threads: two that draw at once would leave STYLE behind
_DRAWING = threading.RLock()


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Titles, legends and ticks that are made within look as STYLE says, not only the axes that
    `page` makes; one thread draws at a time.
    """
    import matplotlib as mpl

    with _DRAWING, mpl.rc_context(STYLE):
        yield


def page(rows: int, columns: int, *, title: str, height: float = 8.0) -> tuple[Figure, list[Axes]]:
    """Figure of rows × columns panels with a title line, and its axes in reading order."""
    from matplotlib.figure import Figure

    with styled():
        figure = Figure(figsize=(11.0, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold", color=INK)
    return figure, list(axes.flat)


def literal(figure: Figure) -> None:
    """Print a '$' in names of logs and columns as it is, and Chinese letters in a font that has
    them.

    Formulas stand in tick labels alone.
    """
    for text in _texts(figure):
        text.set_parse_math(False)
        if max(text.get_text(), default="") >= WIDE:
            text.set_fontfamily(["DejaVu Sans", *_wide_fonts()])


def _wide_fonts() -> list[str]:
    """Fonts with Chinese letters that this machine has, those too that came after matplotlib made
    its list of fonts.
    """
    from matplotlib import font_manager

    manager = font_manager.fontManager
    if not {font.name for font in manager.ttflist} & set(WIDE_FONTS):
        for path in sorted(font_manager.findSystemFonts()):
            if Path(path).name.lower().startswith(WIDE_FILES):
                manager.addfont(path)
    font_names = {font.name for font in manager.ttflist}
    return [name for name in WIDE_FONTS if name in font_names]


@contextlib.contextmanager
def drawing() -> Iterator[None]:
    """Styled, and a letter that no font has is a box, not a warning on the console."""
    with styled(), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=r"Glyph \d+ .* missing from", category=UserWarning
        )
        yield


def _texts(artist: Artist) -> Iterator[Text]:
    """Texts of a figure or a part of it but for tick labels."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for child in artist.get_children():
        if isinstance(child, Axis):
            yield child.label
        elif isinstance(child, Text):
            yield child
        else:
            yield from _texts(child)


def pdf(figures: Sequence[Figure]) -> bytes:
    """Figures as the pages of one PDF without a clock in it."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages

    settle(figures)
    buffer = io.BytesIO()
    quiet = {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": "calibkit"}
    with drawing(), PdfPages(buffer, metadata=quiet) as pages:
        for figure in figures:
            # savefig would lay the figure out and draw it twice
            FigureCanvasPdf(figure).print_pdf(pages)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def settle(figures: Sequence[Figure]) -> None:
    """Lay figures out: what is drawn of them later stands at these places."""
    from calibkit.report import places, svg_canvas

    with drawing():
        for figure in figures:
            literal(figure)
            if figure.get_layout_engine() is not None:
                figure.set_layout_engine("none")
                figure.dpi = POINTS
                places.arrange(figure, svg_canvas.Renderer(*figure.bbox.size, io.StringIO()))


def png(figure: Figure, dpi: int = 110) -> bytes:
    """One figure as PNG without a clock or a version in it."""
    buffer = io.BytesIO()
    literal(figure)
    with drawing():
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()
