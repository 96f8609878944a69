"""What matplotlib makes SVG with, imported without what it never uses for it. To be imported before
`matplotlib.figure`.
"""

import sys

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

__all__ = ["RendererSVG"]
