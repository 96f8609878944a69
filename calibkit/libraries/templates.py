"""Templates of what is written for people: C, XML and HTML that read as what they make."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import jinja2


def read_templates(folder: Path, *, escaped: bool) -> jinja2.Environment:
    """Templates of a folder, in which a name without a value is an error; texts are escaped for
    XML and HTML, not for C.
    """
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=escaped,  # noqa: S701 (C is no HTML)
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
