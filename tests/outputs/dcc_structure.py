"""Structure of a digital calibration certificate, where the schemas are not there: what stands in
every one, how numbers are spelled, how long lists are.
"""

import base64
import binascii
import math
import re

from calibkit.certificate import dcc_xml as xml

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


def find_faults(root):
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


def _missing_elements(root):
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


def _format_faults(element):
    """Items of a D-SI element that are not written as the schema asks."""
    name = str(element.tag).rpartition("}")[2]
    if name in FORMATS:
        items = (element.text or "").split() or [""]
        wrong = next((item for item in items if not FORMATS[name].fullmatch(item)), None)
        if wrong is not None:
            yield f"{name} '{wrong}'"


def _list_faults(values):
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


def _alike(matrix, i, j):
    """Whether entries (i, j) and (j, i) are equal but for their last digits."""
    scale = math.sqrt(abs(matrix[i][i] * matrix[j][j]))
    return math.isclose(matrix[i][j], matrix[j][i], rel_tol=1e-9, abs_tol=1e-9 * scale)
