"""What people read of a result, as one list of blocks; a page, a PDF and the console show them.

`screen` prints blocks on the console, `page` makes HTML of them and `pdf` a PDF.
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from typing import Any, Literal

from calibkit.report.table import Table

Standing = Literal["accepted", "rejected", "open"]
"""What a page is coloured by: a verdict, or that there is none."""


_UNSHOWN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff\u202a-\u202e\u2066-\u2069]"
)
"""Characters that a page must not hold, or that turn the order of what stands around them."""


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading; that of a page is level 1."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    style: Literal["", "warn", "code"] = ""
    """A warning, or text as it was written."""


@dataclass(frozen=True, slots=True)
class Findings:
    """A list of what to know before a result is used."""

    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Values:
    """A few results by name, in large letters."""

    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Chart:
    """A drawing with its caption."""

    svg: str
    caption: str


@dataclass(frozen=True, slots=True)
class Fold:
    """Blocks behind a title, where a page can fold them up."""

    title: str
    blocks: tuple[Block, ...]


Block = Heading | Text | Findings | Values | Chart | Table | Fold


@dataclass(frozen=True, slots=True)
class Page:
    """A result as a whole: its verdict, what is seen of it first, and all the rest."""

    title: str
    verdict: str
    """The verdict in a sentence."""
    standing: Standing
    blocks: tuple[Block, ...]
    subtitle: str = ""
    lead: str = ""
    """What was found, in a sentence."""
    first: tuple[Block, ...] = ()
    """First screen: a chart stands beside the other blocks."""


def printable(text: str) -> str:
    """A text, or a page, with the code of characters that cannot be shown."""
    return _UNSHOWN.sub(lambda match: f"\\u{ord(match.group()):04x}", text.replace("\r", "\\r"))


def describe_block(block: Block) -> dict[str, Any]:
    """A block as JSON, its kind under `kind`; a table as the texts that people read."""
    kind = type(block).__name__.lower()
    if isinstance(block, Fold):
        blocks = [describe_block(part) for part in block.blocks]
        return {"kind": kind, "title": block.title, "blocks": blocks}
    if isinstance(block, Table):
        return {
            "kind": kind,
            "title": block.title,
            "heads": block.heads,
            "rows": block.texts,
            "numbers": block.numbers,
        }
    return {"kind": kind, **dataclasses.asdict(block)}
