"""Sphinx configuration: `sphinx-build -W docs build/docs`."""

from calibkit import __version__

project = "calibkit"
author = "The calibkit developers"
copyright = author  # noqa: A001 (the name that Sphinx reads)
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"calibkit {release}"
html_last_updated_fmt = None  # no clock in what is generated
exclude_patterns = ["schemas/*"]
html_extra_path = ["schemas"]
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
# JSON schemas and sources that pages link to are files beside them, not pages
suppress_warnings = ["myst.xref_missing"]
