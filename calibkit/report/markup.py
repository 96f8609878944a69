"""Pieces of HTML whose texts are escaped by the one function that makes elements."""

import html
import re
from collections.abc import Iterable
from dataclasses import dataclass

_UNSHOWN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff\u202a-\u202e\u2066-\u2069]"
)
"""Characters that a page must not hold, or that turn the order of what stands around them."""


@dataclass(frozen=True, slots=True)
class Markup:
    """A text that is HTML already."""

    text: str

    def __str__(self) -> str:
        return self.text

    def __html__(self) -> str:
        """The same for templates."""
        return self.text


Content = str | Markup


def shown(text: str) -> str:
    """A text, or a page, with the code of characters that cannot be shown."""
    return _UNSHOWN.sub(lambda match: f"\\u{ord(match.group()):04x}", text.replace("\r", "\\r"))


def escaped(content: Content) -> str:
    """HTML of a text or of a piece; characters that cannot be shown stand there as their code."""
    return content.text if isinstance(content, Markup) else html.escape(shown(content))


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
