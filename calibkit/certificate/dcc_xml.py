"""The XML of a digital calibration certificate: namespaces of the two schemas, texts that XML can
hold, identifiers of elements, validation by the schemas where the user has them.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from calibkit.certificate.words import character_code
from calibkit.errors import OutputError, UsageError
from calibkit.libraries import extras

if TYPE_CHECKING:
    from pathlib import Path

    from lxml.etree import _Element

VERSION = "3.3.0"
"""Version of the DCC that is written, with quantities of D-SI 2.2.1."""
DCC = "https://ptb.de/dcc"
SI = "https://ptb.de/si"
NAMES = {"dcc": DCC, "si": SI}
IDENTIFIED = (
    *("respPerson", "statement", "usedMethod", "measuringEquipment", "influenceCondition"),
    *("measurementResult", "result", "list", "quantity"),
)
"""Elements that get an identifier: their name and a number."""
SCHEMA = "dcc.xsd"
SCHEMAS = (SCHEMA, "SI_Format.xsd", "qudt.xsd", "xmldsig-core-schema.xsd")
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


def read(document: bytes, schema_dir: Path | None = None) -> _Element:
    """Root of a certificate, read without entities or network, which fits the schemas where a
    folder has them; OutputError for anything else, UsageError for a folder without schemas.
    """
    root = _parse(document)
    is_certificate = root.tag == f"{{{DCC}}}digitalCalibrationCertificate"
    if not is_certificate or not root.findtext(".//dcc:uniqueIdentifier", "", NAMES).strip():
        raise OutputError(
            f"dcc.xml: root element {root.tag}, expected a digitalCalibrationCertificate with a"
            " uniqueIdentifier",
            hint="restore the certificate",
        )
    if schema_dir is not None:
        _validate(root, schema_dir)
    return root


def _parse(document: bytes) -> _Element:
    """Root of an XML text without entities or network; OutputError for anything else."""
    parser = etree().XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    try:
        root: _Element = etree().fromstring(document, parser)
    except etree().XMLSyntaxError as error:
        reason = str(error).partition(" (<string>")[0]
        raise OutputError(f"dcc.xml: not XML: {reason}", hint="restore the certificate") from None
    return root


def finish(text: str) -> bytes:
    """A filled template as it is written: elements with identifiers, each on its own line."""
    root = _parse(text.encode())
    for element in root.iter():
        element.tail = None
        if element.text is not None and not element.text.strip():
            element.text = None
    _identify(root)
    document: bytes = etree().tostring(
        root, xml_declaration=True, encoding="UTF-8", pretty_print=True
    )
    return document


def _identify(root: _Element) -> None:
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


def _validate(root: _Element, folder: Path) -> None:
    """Validate a document by the schemas in a folder; OutputError with the first faults, UsageError
    without schemas.
    """
    absent = [name for name in SCHEMAS if not (folder / name).is_file()]
    if absent:
        raise UsageError(
            f"--schema-dir {folder}: no {', '.join(absent)}", hint=f"it holds {', '.join(SCHEMAS)}"
        )
    parser = etree().XMLParser(no_network=True)
    try:
        schema = etree().XMLSchema(etree().parse(str(folder / SCHEMA), parser))
    except (etree().XMLSchemaParseError, etree().XMLSyntaxError) as error:
        raise UsageError(
            f"--schema-dir {folder}: {error}", hint=f"restore the schemas of DCC {VERSION}"
        ) from None
    if not schema.validate(root):
        faults = "; ".join(
            f"line {entry.line}: {entry.message}" for entry in list(schema.error_log)[:3]
        )
        raise OutputError(
            f"dcc.xml does not fit {SCHEMA}: {faults}", hint=f"use the schemas of DCC {VERSION}"
        )
