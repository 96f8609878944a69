"""Checks of a digital calibration certificate: its structure always, the schemas where the user has
them.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
from typing import TYPE_CHECKING

from calibkit.certificate import dcc_xml as xml
from calibkit.errors import OutputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lxml.etree import _Element

SCHEMA = "dcc.xsd"
SCHEMAS = (SCHEMA, "SI_Format.xsd", "qudt.xsd", "xmldsig-core-schema.xsd")
NEEDED = (
    "dcc:administrativeData/dcc:dccSoftware/dcc:software/dcc:release",
    "dcc:administrativeData/dcc:coreData/dcc:countryCodeISO3166_1",
    "dcc:administrativeData/dcc:coreData/dcc:uniqueIdentifier",
    "dcc:administrativeData/dcc:coreData/dcc:beginPerformanceDate",
    "dcc:administrativeData/dcc:coreData/dcc:endPerformanceDate",
    "dcc:administrativeData/dcc:coreData/dcc:performanceLocation",
    "dcc:administrativeData/dcc:items/dcc:item/dcc:identifications/dcc:identification/dcc:value",
    "dcc:administrativeData/dcc:calibrationLaboratory/dcc:contact/dcc:location",
    "dcc:administrativeData/dcc:respPersons/dcc:respPerson/dcc:person/dcc:name",
    "dcc:administrativeData/dcc:customer/dcc:location",
    "dcc:measurementResults/dcc:measurementResult/dcc:results/dcc:result/dcc:data",
)
"""What stands in every certificate, with text in it where it has no children."""
DECIMAL = re.compile(r"[-+]?(\d*\.\d+|\d+\.\d*)([Ee][-+]?\d+)?")
FACTOR = re.compile(r"[1-9]\d*\.\d*")
PROBABILITY = re.compile(r"0\.\d*|1\.0*")
UNIT = re.compile(r"(\\[a-z]+(\\tothe\{-?\d+(\.\d+)?\})?)+")
FORMATS = {
    "value": DECIMAL,
    "valueXMLList": DECIMAL,
    "valueExpandedMU": DECIMAL,
    "valueExpandedMUXMLList": DECIMAL,
    "valueStandardMU": DECIMAL,
    "intervalMin": DECIMAL,
    "intervalMax": DECIMAL,
    "coverageFactor": FACTOR,
    "coverageFactorXMLList": FACTOR,
    "coverageProbability": PROBABILITY,
    "coverageProbabilityXMLList": PROBABILITY,
    "unit": UNIT,
    "unitXMLList": UNIT,
}
"""Element of D-SI → what each of its items looks like."""


def check(document: bytes, schema_dir: Path | None = None) -> _Element:
    """Root of a document whose structure is right and which fits the schema, where a folder has it.

    Raises OutputError that lists faults, UsageError for a folder without schemas.
    """
    root = parse(document)
    faults = list(_faults(root))
    if faults:
        raise OutputError(f"dcc.xml: {'; '.join(faults[:5])}", hint="this is a bug")
    if schema_dir is not None:
        _validate(root, schema_dir)
    return root


def parse(document: bytes) -> _Element:
    """Root of an XML text without entities or network; OutputError for anything else."""
    etree = xml.etree()
    try:
        root: _Element = etree.fromstring(
            document, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
        )
    except etree.XMLSyntaxError as error:
        raise OutputError(f"dcc.xml: not XML: {error}", hint="restore the certificate") from None
    return root


def _faults(root: _Element) -> Iterator[str]:
    """Everything that is wrong with a document."""
    yield from _missing_elements(root)
    for element in root.iter(f"{{{xml.SI}}}*"):
        yield from _format_faults(element)
    for values in root.iter(f"{{{xml.SI}}}realListXMLList"):
        yield from _list_faults(values)
    for data in root.iter(f"{{{xml.DCC}}}dataBase64"):
        try:
            base64.b64decode(data.text or "", validate=True)
        except binascii.Error:
            yield "data that are no base 64"


def _missing_elements(root: _Element) -> Iterator[str]:
    """Elements that every certificate has and this one lacks."""
    if root.tag != f"{{{xml.DCC}}}digitalCalibrationCertificate" or not root.get("schemaVersion"):
        yield f"root element {root.tag!r}"
    for path in NEEDED:
        elements = root.findall(path, xml.NAMES)
        if not elements or any(
            len(element) == 0 and not (element.text or "").strip() for element in elements
        ):
            yield f"no {path}"
    for result in root.iterfind("dcc:measurementResults/dcc:measurementResult", xml.NAMES):
        if any(result.find(child, xml.NAMES) is None for child in ("dcc:name", "dcc:results")):
            yield "measurement result without name or results"


def _format_faults(element: _Element) -> Iterator[str]:
    """Items of a D-SI element that are not written as the schema asks."""
    name = str(element.tag).rpartition("}")[2]
    if name in FORMATS:
        items = (element.text or "").split() or [""]
        wrong = next((item for item in items if not FORMATS[name].fullmatch(item)), None)
        if wrong is not None:
            yield f"{name} '{wrong}'"


def _list_faults(values: _Element) -> Iterator[str]:
    """Faults of a list: parts that differ in length, a covariance of another size or not
    symmetric.
    """
    value_lists = values.findall("si:valueXMLList", xml.NAMES)
    n = len((value_lists[0].text or "").split()) if value_lists else 0
    for name in ("labelXMLList", "valueXMLList", "unitXMLList", "valueExpandedMUXMLList"):
        for part in values.iterfind(f".//si:{name}", xml.NAMES):
            inside = part.getparent()
            single = inside is not None and str(inside.tag).endswith("}covarianceXMLList")
            allowed_lengths = {1} if single else {1, n} if name == "unitXMLList" else {n}
            if len((part.text or "").split()) not in allowed_lengths:
                yield f"{name} of {n} values is not as long"
    matrix = [
        [float(entry.findtext("si:valueXMLList", "nan", xml.NAMES)) for entry in column]
        for column in values.findall(".//si:columnXMLList", xml.NAMES)
    ]
    if matrix and ([len(column) for column in matrix] != [n] * n or len(matrix) != n):
        yield f"covariance of {n} values is not {n} × {n}"
    elif not all(_alike(matrix, i, j) for i in range(len(matrix)) for j in range(i)):
        yield "covariance that is not symmetric"


def _alike(matrix: list[list[float]], i: int, j: int) -> bool:
    """Whether entries (i, j) and (j, i) are equal but for their last digits."""
    scale = math.sqrt(abs(matrix[i][i] * matrix[j][j]))
    return math.isclose(matrix[i][j], matrix[j][i], rel_tol=1e-9, abs_tol=1e-9 * scale)


def _validate(root: _Element, folder: Path) -> None:
    """Validate a document by the schemas in a folder; OutputError with the first faults, UsageError
    without schemas.
    """
    etree = xml.etree()
    absent = [name for name in SCHEMAS if not (folder / name).is_file()]
    if absent:
        raise UsageError(
            f"--schema-dir {folder}: no {', '.join(absent)}", hint=f"it holds {', '.join(SCHEMAS)}"
        )
    parser = etree.XMLParser(no_network=True)
    try:
        schema = etree.XMLSchema(etree.parse(str(folder / SCHEMA), parser))
    except (etree.XMLSchemaParseError, etree.XMLSyntaxError) as error:
        raise UsageError(
            f"--schema-dir {folder}: {error}", hint="restore the schemas of DCC 3.3.0"
        ) from None
    if not schema.validate(root):
        faults = "; ".join(
            f"line {entry.line}: {entry.message}" for entry in list(schema.error_log)[:3]
        )
        raise OutputError(
            f"dcc.xml does not fit {SCHEMA}: {faults}", hint="use the schemas of DCC 3.3.0"
        )
