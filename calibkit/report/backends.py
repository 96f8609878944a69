"""What matplotlib makes PDF and SVG with, imported without what it never uses for them."""

import contextlib
import importlib.util
import sys


def _only_when_used(package: str, name: str) -> None:
    """Have a module of a package that others import at their head executed when something of it is
    asked for.
    """
    whole = f"{package}.{name}"
    spec = None
    with contextlib.suppress(ModuleNotFoundError):  # a matplotlib that does without it
        spec = None if whole in sys.modules else importlib.util.find_spec(whole)
    if spec is None or spec.loader is None:
        return
    spec.loader = importlib.util.LazyLoader(spec.loader)
    sys.modules[whole] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[whole])
    # `from package import name` takes what the package has by that name; to look it up among the
    # modules would execute it
    setattr(sys.modules[package], name, sys.modules[whole])


# it cuts TrueType fonts down, which `pdf.fonttype` 3 does not ask for, and is a seventh of what a
# report's libraries take
_only_when_used("fontTools", "subset")

from matplotlib.backends.backend_pdf import (  # noqa: E402
    FigureCanvasPdf,
    PdfPages,
)
from matplotlib.backends.backend_svg import FigureCanvasSVG  # noqa: E402

__all__ = ["FigureCanvasPdf", "FigureCanvasSVG", "PdfPages"]
