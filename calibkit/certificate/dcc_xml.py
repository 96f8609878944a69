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


@dataclass(frozen=True, slots=True)
class Notation:
    """How a document writes texts and values: its languages, and the local gravity [m/s²] that
    values in g are converted with, where it is known.
    """

    lang: Lang
    gravity: float | None

    def unit(self, unit: str) -> Unit:
        """D-SI unit of a unit."""
        return dsi(unit).at(self.gravity)


def etree() -> Any:  # noqa: ANN401 (a module of an optional library)
    """lxml.etree, or OutputError that names the command that installs it."""
    return extras.load_library("lxml.etree", "dcc", "digital calibration certificates need lxml")


def line(text: str) -> str:
    """Text on one line with single spaces, which is what the schema calls a string that is not
    empty; a character that XML cannot hold is given by its number.
    """
    clean = _ILLEGAL.sub(lambda match: character_code(match.group()), text)
    return " ".join(clean.split()) or NOT_STATED


def add(parent: _Element, name: str, text: str | None = None, **attributes: str) -> _Element:
    """Child `dcc:name` or `si:name` of an element."""
    prefix, _, local = name.partition(":")
    child: _Element = etree().SubElement(parent, f"{{{NAMES[prefix]}}}{local}", attributes)
    if text is not None:
        child.text = text
    return child


def _content(parent: _Element, words: Words | str, lang: Lang) -> None:
    """`dcc:content` in each language of the certificate; a user's text has no language of its
    own.
    """
    if isinstance(words, str):
        add(parent, "dcc:content", line(words))
        return
    for code in LANGUAGES[lang]:
        text = words.zh if code == "zh" and words.zh else words.en
        add(parent, "dcc:content", line(text), lang=code)


def text(parent: _Element, name: str, words: Words | str, lang: Lang) -> _Element:
    """Element of the schema's text type."""
    made = add(parent, name)
    _content(made, words, lang)
    return made


def named(
    parent: _Element, name: str, words: Words | str, lang: Lang, **attributes: str
) -> _Element:
    """Element that begins with a `dcc:name`."""
    made = add(parent, name, **attributes)
    text(made, "dcc:name", words, lang)
    return made


def optional(parent: _Element, name: str, value: str) -> None:
    """Element with a text on one line, or no element where the text is empty."""
    if value.strip():
        add(parent, name, line(value))


def given(texts: Iterable[Words | str]) -> list[Words | str]:
    """Texts that are not empty."""
    return [words for words in texts if (words if isinstance(words, str) else words.en).strip()]


def rich(
    parent: _Element, name: str, texts: Iterable[Words | str], lang: Lang, latex: Sequence[str] = ()
) -> None:
    """Element of the schema's rich content type with texts and formulas, or no element where there
    are none.
    """
    shown = given(texts)
    if not shown and not latex:
        return
    made = add(parent, name)
    for words in shown:
        _content(made, words, lang)
    for formula in latex:
        add(add(made, "dcc:formula"), "dcc:latex", formula)


def file(parent: _Element, attachment: Attachment) -> None:
    """`dcc:byteData` of a file."""
    made = add(parent, "dcc:byteData")
    add(made, "dcc:fileName", line(attachment.name))
    add(made, "dcc:mimeType", attachment.media_type)
    add(made, "dcc:dataBase64", base64.b64encode(attachment.content).decode())


def number(value: float) -> str:
    """A decimal number with all its digits and a decimal point."""
    if not math.isfinite(value):
        raise OutputError(
            f"{value} is no number that a certificate can state", hint="this is a bug"
        )
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"


def factor(value: float) -> str:
    """A coverage factor: at least 1, without an exponent."""
    return f"{max(value, 1.0):.12f}".rstrip("0").ljust(3, "0")


def probability(value: float) -> str:
    """A coverage probability: 0 to 1, without an exponent."""
    return f"{value:.12f}".rstrip("0").ljust(3, "0")


def _label(key: str) -> str:
    """A key as an item of an XML list, which blanks would split."""
    return line(key).replace(" ", "_")


def real(parent: _Element, value: float, unit: Unit, key: str = "") -> _Element:
    """`si:real` of a value, converted to its D-SI unit."""
    made = add(parent, "si:real")
    if key:
        add(made, "si:label", line(key))
    add(made, "si:value", number(value * unit.factor))
    add(made, "si:unit", unit.text)
    return made


def real_list(
    parent: _Element, values: Sequence[float], units: Sequence[Unit], keys: Sequence[str] = ()
) -> _Element:
    """`si:realListXMLList` of values, each converted to its D-SI unit."""
    made = add(parent, "si:realListXMLList")
    if keys:
        add(made, "si:labelXMLList", " ".join(map(_label, keys)))
    scaled = [number(value * unit.factor) for value, unit in zip(values, units, strict=True)]
    add(made, "si:valueXMLList", " ".join(scaled))
    add(made, "si:unitXMLList", " ".join(unit.text for unit in units))
    return made


def expanded(parent: _Element, U: float, coverage_factor: float, coverage: float) -> None:
    """Expanded uncertainty of one value with its coverage factor and probability."""
    made = add(add(parent, "si:measurementUncertaintyUnivariate"), "si:expandedMU")
    add(made, "si:valueExpandedMU", number(U))
    add(made, "si:coverageFactor", factor(coverage_factor))
    add(made, "si:coverageProbability", probability(coverage))


def interval(
    parent: _Element, uncertainty: Uncertainty, ends: tuple[float, float], scale: float
) -> None:
    """Coverage interval of one value."""
    made = add(add(parent, "si:measurementUncertaintyUnivariate"), "si:coverageIntervalMU")
    add(made, "si:valueStandardMU", number(uncertainty.standard_uncertainty * scale))
    add(made, "si:intervalMin", number(ends[0] * scale))
    add(made, "si:intervalMax", number(ends[1] * scale))
    add(made, "si:coverageProbability", probability(uncertainty.probability))


def expanded_list(parent: _Element, uncertainties: Sequence[Uncertainty], scale: float) -> None:
    """Expanded uncertainties of a list of values."""
    made = add(add(parent, "si:measurementUncertaintyUnivariateXMLList"), "si:expandedMUXMLList")
    add(
        made,
        "si:valueExpandedMUXMLList",
        " ".join(number(u.expanded_uncertainty * scale) for u in uncertainties),
    )
    add(
        made, "si:coverageFactorXMLList", " ".join(factor(u.coverage_factor) for u in uncertainties)
    )
    add(
        made,
        "si:coverageProbabilityXMLList",
        " ".join(probability(u.probability) for u in uncertainties),
    )
