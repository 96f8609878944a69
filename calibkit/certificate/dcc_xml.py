"""Elements of a digital calibration certificate: names of the two schemas, texts in their
languages, numbers in their formats.
"""

from __future__ import annotations

import base64
import math
import re
from typing import TYPE_CHECKING

from calibkit.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from types import ModuleType

    from lxml.etree import _Element

    from calibkit.certificate.content import Attachment
    from calibkit.certificate.results import Uncertainty
    from calibkit.certificate.words import Lang, Words

DCC = "https://ptb.de/dcc"
SI = "https://ptb.de/si"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
NAMES = {"dcc": DCC, "si": SI, "xsi": XSI}
LANGUAGES: dict[Lang, tuple[str, ...]] = {"en": ("en",), "zh": ("zh",), "both": ("en", "zh")}
NOT_STATED = "not stated"
_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def etree() -> ModuleType:
    """lxml.etree, or OutputError that names the command that installs it."""
    try:
        from lxml import etree as module
    except ImportError:
        raise OutputError(
            "digital calibration certificates need lxml", hint="pip install 'calibkit[dcc]'"
        ) from None
    found: ModuleType = module
    return found


def clean(text: str) -> str:
    """Text without what XML cannot hold: such a character stands there by its number."""
    return _ILLEGAL.sub(lambda match: f"[U+{ord(match.group()):04X}]", text)


def line(text: str, absent: str = NOT_STATED) -> str:
    """Text on one line with single spaces, which is what the schema calls a string that is not
    empty.
    """
    return " ".join(clean(text).split()) or absent


def add(parent: _Element, name: str, text: str | None = None, **attributes: str) -> _Element:
    """Child `dcc:name` or `si:name` of an element."""
    prefix, _, local = name.partition(":")
    child: _Element = etree().SubElement(parent, f"{{{NAMES[prefix]}}}{local}", attributes)
    if text is not None:
        child.text = text
    return child


def content(parent: _Element, words: Words | str, lang: Lang) -> None:
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
    content(made, words, lang)
    return made


def rich(
    parent: _Element, name: str, said: Iterable[Words | str], lang: Lang, latex: Sequence[str] = ()
) -> _Element | None:
    """Element of the schema's rich content type with texts and formulas, or nothing where nothing
    is said.
    """
    shown = [words for words in said if (words if isinstance(words, str) else words.en).strip()]
    if not shown and not latex:
        return None
    made = add(parent, name)
    for words in shown:
        content(made, words, lang)
    for formula in latex:
        add(add(made, "dcc:formula"), "dcc:latex", formula)
    return made


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


def label(key: str) -> str:
    """A key as an item of an XML list, which blanks would split."""
    return line(key).replace(" ", "_")


def expanded(parent: _Element, uncertainty: Uncertainty, scale: float) -> None:
    """Expanded uncertainty of one value."""
    made = add(add(parent, "si:measurementUncertaintyUnivariate"), "si:expandedMU")
    add(made, "si:valueExpandedMU", number(uncertainty.expanded_uncertainty * scale))
    add(made, "si:coverageFactor", factor(uncertainty.coverage_factor))
    add(made, "si:coverageProbability", probability(uncertainty.probability))


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
