"""Elements of a digital calibration certificate: names of the two schemas, and texts in their
languages.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from calibkit import extras
from calibkit.certificate.checklist import character_code
from calibkit.certificate.dcc_units import dsi

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lxml.etree import _Element

    from calibkit.certificate.dcc_units import Unit
    from calibkit.certificate.words import Lang, Words

DCC = "https://ptb.de/dcc"
SI = "https://ptb.de/si"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
NAMES = {"dcc": DCC, "si": SI, "xsi": XSI}
LANGUAGES: dict[Lang, tuple[str, ...]] = {"en": ("en",), "zh": ("zh",), "both": ("en", "zh")}
NOT_STATED = "not stated"
_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def etree() -> Any:  # noqa: ANN401 (a module of an optional library)
    """lxml.etree, or OutputError that names the command that installs it."""
    return extras.load_library("lxml.etree", "dcc", "digital calibration certificates need lxml")


def one_line(text: str) -> str:
    """Text on one line with single spaces, which is what the schema calls a string that is not
    empty; a character that XML cannot hold is given by its number.
    """
    clean = _ILLEGAL.sub(lambda match: character_code(match.group()), text)
    return " ".join(clean.split()) or NOT_STATED


def node(name: str, *content: _Element | str | None, **attributes: str) -> _Element:
    """Element `dcc:name` or `si:name` with a text or with elements; None is left out."""
    prefix, _, local = name.partition(":")
    made: _Element = etree().Element(f"{{{NAMES[prefix]}}}{local}", attributes, nsmap=NAMES)
    for part in content:
        if isinstance(part, str):
            made.text = part
        elif part is not None:
            made.append(part)
    return made


@dataclass(frozen=True, slots=True)
class Notation:
    """How a document writes texts and values: its languages, and the local gravity [m/s²] that
    values in g are converted with, where it is known.
    """

    lang: Lang
    gravity: float | None

    def unit(self, unit: str) -> Unit:
        """D-SI unit of a unit."""
        return dsi(unit).with_gravity(self.gravity)

    def _contents(self, words: Words | str) -> list[_Element]:
        """`dcc:content` in each language of the certificate; a user's text has no language of its
        own.
        """
        if isinstance(words, str):
            return [node("dcc:content", one_line(words))]
        texts = {code: words.zh if code == "zh" else words.en for code in LANGUAGES[self.lang]}
        return [
            node("dcc:content", one_line(text or words.en), lang=code)
            for code, text in texts.items()
        ]

    def text(self, name: str, words: Words | str) -> _Element:
        """Element of the schema's text type."""
        return node(name, *self._contents(words))

    def named(
        self, name: str, words: Words | str, *content: _Element | None, **attributes: str
    ) -> _Element:
        """Element that begins with a `dcc:name`."""
        return node(name, self.text("dcc:name", words), *content, **attributes)

    def rich(
        self, name: str, texts: Iterable[Words | str], latex: Iterable[str] = ()
    ) -> _Element | None:
        """Element of the schema's rich content type with texts and formulas; None where there are
        none.
        """
        parts = [part for words in non_empty(texts) for part in self._contents(words)]
        parts += [node("dcc:formula", node("dcc:latex", formula)) for formula in latex]
        return node(name, *parts) if parts else None


def non_empty(texts: Iterable[Words | str]) -> list[Words | str]:
    """Texts that are not empty."""
    return [words for words in texts if (words if isinstance(words, str) else words.en).strip()]
