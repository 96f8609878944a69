"""What matplotlib makes SVG with, imported without what it never uses for it. To be imported before
`matplotlib.figure`.
"""

import functools
import sys
from typing import Literal, TextIO

from calibkit.libraries.lean_imports import only_when_used

# pages that TeX has set, and controls in windows
only_when_used("matplotlib", "dviread")
only_when_used("matplotlib", "widgets")
if "calibkit.cli" in sys.modules:
    from matplotlib import artist

    # a command shows nobody matplotlib's own help, whose tables of properties are a fifth of what
    # it takes to import
    artist.kwdoc = lambda artist: ""  # noqa: ARG005 (its name is that of the replaced one)

from matplotlib.backends.backend_svg import RendererSVG  # noqa: E402
from matplotlib.font_manager import FontProperties  # noqa: E402
from matplotlib.textpath import text_to_path  # noqa: E402


@functools.lru_cache(4096)
def _measured(
    text: str,
    font: FontProperties,
    ismath: bool | Literal["TeX"],  # noqa: FBT001 (matplotlib calls it so)
) -> tuple[float, float, float]:
    """Width, height and descent of a text in a font [pt]; the caller does not change the font."""
    return text_to_path.get_text_width_height_descent(text, font, ismath)


class Renderer(RendererSVG):
    """Draws SVG whose unit is a point; a text is measured once for all figures."""

    get_text_width_height_descent = staticmethod(_measured)

    def __init__(self, width: float, height: float, out: TextIO) -> None:
        without_clock = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        super().__init__(width, height, out, metadata=without_clock)  # type: ignore[no-untyped-call]
