"""Elements of a digital calibration certificate: names of the two schemas, texts in their
languages, values with units and uncertainties.
"""

from __future__ import annotations

import base64
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from calibkit import extras
from calibkit.certificate.checklist import character_code
from calibkit.certificate.dcc_units import dsi
from calibkit.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lxml.etree import _Element

    from calibkit.certificate.content import Attachment
    from calibkit.certificate.dcc_units import Unit
    from calibkit.certificate.results import Uncertainty
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


def optional_node(name: str, value: str) -> _Element | None:
    """Element with a text on one line; None where the text is empty."""
    return node(name, one_line(value)) if value.strip() else None


def non_empty(texts: Iterable[Words | str]) -> list[Words | str]:
    """Texts that are not empty."""
    return [words for words in texts if (words if isinstance(words, str) else words.en).strip()]


def file_data(attachment: Attachment) -> _Element:
    """`dcc:byteData` of a file."""
    return node(
        "dcc:byteData",
        node("dcc:fileName", one_line(attachment.name)),
        node("dcc:mimeType", attachment.media_type),
        node("dcc:dataBase64", base64.b64encode(attachment.content).decode()),
    )


def format_number(value: float) -> str:
    """A decimal number with all its digits and a decimal point."""
    if not math.isfinite(value):
        raise OutputError(
            f"{value} is no number that a certificate can state", hint="this is a bug"
        )
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"


def format_factor(value: float) -> str:
    """A coverage factor: at least 1, without an exponent."""
    return f"{max(value, 1.0):.12f}".rstrip("0").ljust(3, "0")


def format_probability(value: float) -> str:
    """A coverage probability: 0 to 1, without an exponent."""
    return f"{value:.12f}".rstrip("0").ljust(3, "0")


def _label(key: str) -> str:
    """A key as an item of an XML list, which blanks would split."""
    return one_line(key).replace(" ", "_")


def real(value: float, unit: Unit, key: str = "", uncertainty: _Element | None = None) -> _Element:
    """`si:real` of a value, converted to its D-SI unit, with its uncertainty."""
    return node(
        "si:real",
        node("si:label", one_line(key)) if key else None,
        node("si:value", format_number(value * unit.factor)),
        node("si:unit", unit.text),
        uncertainty,
    )


def real_list(
    values: Iterable[float],
    units: Sequence[Unit],
    keys: Sequence[str] = (),
    uncertainty: _Element | None = None,
) -> _Element:
    """`si:realListXMLList` of values, each converted to its D-SI unit, with their uncertainty."""
    scaled = [format_number(value * unit.factor) for value, unit in zip(values, units, strict=True)]
    return node(
        "si:realListXMLList",
        node("si:labelXMLList", " ".join(map(_label, keys))) if keys else None,
        node("si:valueXMLList", " ".join(scaled)),
        node("si:unitXMLList", " ".join(unit.text for unit in units)),
        uncertainty,
    )


def expanded_uncertainty(U: float, coverage_factor: float, coverage: float) -> _Element:
    """Expanded uncertainty of one value with its coverage factor and probability."""
    return node(
        "si:measurementUncertaintyUnivariate",
        node(
            "si:expandedMU",
            node("si:valueExpandedMU", format_number(U)),
            node("si:coverageFactor", format_factor(coverage_factor)),
            node("si:coverageProbability", format_probability(coverage)),
        ),
    )


def coverage_interval(
    uncertainty: Uncertainty, ends: tuple[float, float], scale: float
) -> _Element:
    """Coverage interval of one value."""
    return node(
        "si:measurementUncertaintyUnivariate",
        node(
            "si:coverageIntervalMU",
            node("si:valueStandardMU", format_number(uncertainty.standard_uncertainty * scale)),
            node("si:intervalMin", format_number(ends[0] * scale)),
            node("si:intervalMax", format_number(ends[1] * scale)),
            node("si:coverageProbability", format_probability(uncertainty.probability)),
        ),
    )


def expanded_uncertainties(uncertainties: Sequence[Uncertainty], scale: float) -> _Element:
    """Expanded uncertainties of a list of values."""
    columns = {
        "si:valueExpandedMUXMLList": [
            format_number(u.expanded_uncertainty * scale) for u in uncertainties
        ],
        "si:coverageFactorXMLList": [format_factor(u.coverage_factor) for u in uncertainties],
        "si:coverageProbabilityXMLList": [format_probability(u.probability) for u in uncertainties],
    }
    return node(
        "si:measurementUncertaintyUnivariateXMLList",
        node(
            "si:expandedMUXMLList",
            *(node(name, " ".join(column)) for name, column in columns.items()),
        ),
    )
