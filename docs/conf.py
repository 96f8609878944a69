"""Sphinx configuration: `sphinx-build -W -n docs build/docs`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from docutils import nodes
from latex2mathml.converter import convert

from calibkit import __version__

sys.path.insert(0, str(Path(__file__).parent))
from reference import insert_parts

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

project = "calibkit"
author = "The calibkit developers"
copyright = author  # noqa: A001 (the name that Sphinx reads)
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
html_static_path = ["static"]
html_css_files = ["equations.css"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes = False  # keys and options are copied as they stand
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"calibkit {release}"
html_last_updated_fmt = None  # no clock in what is generated
exclude_patterns = ["schemas/*"]
html_extra_path = ["schemas"]
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False


def inline_math(translator: HTML5Translator, node: nodes.math) -> None:
    """An equation within a line."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def display_math(translator: HTML5Translator, node: nodes.math_block) -> None:
    """An equation of its own."""
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Equations become MathML, which browsers draw without a script: the pages are whole on a
    machine without a network. What the code states is put into the pages.
    """
    app.connect("source-read", insert_parts)
    app.add_html_math_renderer(
        "mathml", inline_renderers=(inline_math, None), block_renderers=(display_math, None)
    )
