"""Pieces of HTML whose texts are escaped by the one function that makes elements."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from calibkit.report import page
from calibkit.report.blocks import printable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibkit.report.table import Table


@dataclass(frozen=True, slots=True)
class Markup:
    """A text that is HTML already."""

    text: str


Content: TypeAlias = "str | Markup"


def escaped(content: Content) -> str:
    """HTML of a text or of a piece; characters that cannot be shown stand there as their code."""
    return content.text if isinstance(content, Markup) else html.escape(printable(content))


def element(tag: str, *parts: Content, **attributes: str) -> Markup:
    """An element around texts and pieces; a trailing underscore of an attribute's name goes, others
    become hyphens.
    """
    attribute_text = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escaped(value)}"'
        for name, value in attributes.items()
        if value
    )
    return Markup(f"<{tag}{attribute_text}>{''.join(map(escaped, parts))}</{tag}>")


def join_markup(parts: Iterable[Markup], separator: str = "\n") -> Markup:
    """Pieces one after the other."""
    return Markup(separator.join(part.text for part in parts))


def summary_table(table: Table) -> Markup:
    """A table as a report shows it."""
    return Markup(page.summary_table(table))
