"""Elements of a digital calibration certificate: names of the two schemas, and texts in their
languages.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from calibkit import extras
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.words import character_code

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lxml.etree import _Element

    from calibkit.certificate.dcc_units import DccUnit
    from calibkit.certificate.words import Lang, Words

DCC = "https://ptb.de/dcc"
SI = "https://ptb.de/si"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
NAMES = {"dcc": DCC, "si": SI, "xsi": XSI}
IDENTIFIED = (
    *("respPerson", "statement", "usedMethod", "measuringEquipment", "influenceCondition"),
    *("measurementResult", "result", "list", "quantity"),
)
"""Elements that get an identifier: their name and a number."""


@dataclass(frozen=True, slots=True)
class Schema:
    """A version of the schema with that of its quantities (D-SI)."""

    version: str
    quantities: str

    @property
    def location(self) -> str:
        """Namespace and address of the schema."""
        return f"{DCC} {DCC}/v{self.version}/dcc.xsd"


SCHEMAS = {schema.version: schema for schema in (Schema("3.3.0", "2.2.1"),)}
"""Versions that calibkit writes."""
SCHEMA = SCHEMAS["3.3.0"]
"""Version that is written."""
LANGUAGES: dict[Lang, tuple[str, ...]] = {"en": ("en",), "zh": ("zh",), "both": ("en", "zh")}
NOT_STATED = "not stated"
_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def etree() -> Any:  # noqa: ANN401 (a module of an optional library)
    """lxml.etree, or OutputError that says how to install it."""
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
    element: _Element = etree().Element(f"{{{NAMES[prefix]}}}{local}", attributes, nsmap=NAMES)
    for part in content:
        if isinstance(part, str):
            element.text = part
        elif part is not None:
            element.append(part)
    return element


def identify(root: _Element) -> None:
    """Give elements their identifiers in the order of the document, and put those of quantities in
    place of the keys that statements refer to.
    """
    counts = dict.fromkeys(IDENTIFIED, 0)
    identifiers: dict[str, str] = {}
    for element in root.iter(f"{{{DCC}}}*"):
        name = str(element.tag).rpartition("}")[2]
        if name in counts and element.get("id") is None:
            counts[name] += 1
            element.set("id", f"{name}{counts[name]}")
        if name == "quantity":
            for path in ("si:real/si:label", "si:realListXMLList/si:labelXMLList"):
                labels = element.findtext(path, "", NAMES)
                split = labels.split() if path.endswith("List") else [labels]
                identifiers |= {
                    label: element.get("id", "") for label in split if label not in identifiers
                }
    for statement in root.iterfind(".//dcc:statement[@refId]", NAMES):
        key = statement.get("refId", "")
        statement.set("refId", identifiers.get(key) or identifiers[key.replace(" ", "_")])


@dataclass(frozen=True, slots=True)
class Notation:
    """How a document writes texts and values: its languages, the local gravity [m/s²] that values
    in g are converted with, where it is known, and whether results state that they are in the scope
    of an accreditation.
    """

    lang: Lang
    gravity: float | None
    accredited: bool = False

    def unit(self, unit: str) -> DccUnit:
        """D-SI unit of a unit."""
        return dsi(unit).with_gravity(self.gravity)

    def _contents(self, words: Words | str) -> list[_Element]:
        """`dcc:content` in each language of the certificate; a user's text has no language of its
        own.
        """
        if isinstance(words, str):
            return [node("dcc:content", one_line(words))]
        if not words.zh and self.lang != "en":  # the same in both, a symbol or a name
            return [node("dcc:content", one_line(words.en))]
        texts = {code: words.zh if code == "zh" else words.en for code in LANGUAGES[self.lang]}
        return [node("dcc:content", one_line(text), lang=code) for code, text in texts.items()]

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
