"""The certificate as a digital calibration certificate: DCC 3.3.0 of the PTB with quantities of
D-SI 2.2.1.

It holds what the PDF holds, and besides every parameter with its covariance and the coefficient
files themselves. What the schema requires and nobody has stated is given as "not stated", a country
as ZZ, a date of work as 0001-01-01, and the certificate is a DRAFT.
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

from calibkit import coefficients
from calibkit.certificate import dcc_administrative, dcc_check, dcc_results, dcc_xml as xml, names
from calibkit.certificate.content import Attachment, Relationship
from calibkit.certificate.dcc_administrative import ITEM, SERIAL_NUMBER, digest, identification
from calibkit.certificate.dcc_xml import Notation, node, one_line
from calibkit.certificate.words import CONDITIONS, HEADINGS, Words
from calibkit.errors import OutputError

if TYPE_CHECKING:
    import datetime as dt
    from pathlib import Path

    from lxml.etree import _Element

    from calibkit.certificate.content import Certificate
    from calibkit.certificate.profile import Standard
    from calibkit.certificate.results import Block
    from calibkit.certificate.words import Lang

FILE = "dcc.xml"
RELEASE = dcc_administrative.RELEASE
CERTIFICATE = Words("calibration certificate", "校准证书")
VERSION = xml.SCHEMA.version
DESCRIBED: tuple[str, Relationship, str] = (
    "application/xml",
    "alternative",
    f"digital calibration certificate, DCC {VERSION}",
)
"""Media type, what the file is to the PDF, and what it is called there."""


def attach_dcc(certificate: Certificate, lang: Lang, schema_dir: Path | None = None) -> Attachment:
    """The DCC as a file of the certificate, its structure checked, and validated against the schema
    where a folder has it.
    """
    document = render(certificate, lang)
    dcc_check.check(document, schema_dir)
    return Attachment(FILE, document, *DESCRIBED)


def render(certificate: Certificate, lang: Lang) -> bytes:
    """XML of a certificate, the same bytes for the same certificate."""
    gravity = (c.value for c in certificate.run.conditions if c.name == "local_gravity")
    notation = Notation(
        lang,
        next(gravity, certificate.profile.conditions.local_gravity_mps2),
        bool(certificate.profile.accreditation.number.strip()),
    )
    root = node(
        "dcc:digitalCalibrationCertificate",
        dcc_administrative.write(certificate, notation),
        _measurements(certificate, notation),
        schemaVersion=VERSION,
    )
    root.set(f"{{{xml.XSI}}}schemaLocation", xml.SCHEMA.location)
    xml.identify(root)
    document: bytes = xml.etree().tostring(
        root, xml_declaration=True, encoding="UTF-8", pretty_print=True
    )
    return document


def _measurements(certificate: Certificate, notation: Notation) -> _Element:
    """One measurement result per coefficient file, then as found and as left."""
    dates = certificate.profile.dates
    used = dates.performed_until or dates.performed
    equipment = [_equipment(standard, used, notation) for standard in certificate.profile.standard]
    refers = " ".join([ITEM, *(f"measuringEquipment{k + 1}" for k in range(len(equipment)))])
    files = {a.name: a for a in certificate.attachments}
    results = [
        notation.named(
            "dcc:measurementResult",
            block.title,
            notation.rich("dcc:description", block.notes),
            _methods(certificate, block, notation),
            _influences(certificate, notation),
            node(
                "dcc:results",
                *(dcc_results.tabulate_results(table, notation) for table in block.tables),
                *(_file(files[block.file], notation) if block.file in files else ()),
            ),
            refId=refers,
        )
        for block in certificate.blocks
    ]
    if not certificate.blocks or certificate.as_found is not None:
        results.append(dcc_results.as_found_as_left(certificate.as_found, notation))
    return node(
        "dcc:measurementResults",
        node("dcc:measuringEquipments", *equipment) if equipment else None,
        *results,
    )


def _equipment(standard: Standard, used: dt.date | None, notation: Notation) -> _Element:
    """A standard with the certificate that makes it traceable, its range and uncertainty."""
    facts = [
        f"{word} {value}"
        for word, value in (
            ("calibrated by", standard.laboratory),
            ("on", standard.date),
            ("valid until", standard.valid_until),
        )
        if value
    ]
    identifications = [
        identification(
            "manufacturer", standard.serial, SERIAL_NUMBER, notation, refType="basic_serialNumber"
        ),
        identification("other", standard.certificate, CERTIFICATE, notation),
    ]
    certificate = None
    if standard.sha256:
        until = standard.valid_until
        validity = None
        if until is not None and used is not None:
            validity = node("dcc:inValidityRange", str(used <= until).lower())
        certificate = digest(
            *("dcc:certificate", CERTIFICATE, standard.certificate, standard.sha256),
            notation,
            validity,
        )
    quantities = _quantities(standard, notation)
    return notation.named(
        "dcc:measuringEquipment",
        standard.name,
        notation.rich("dcc:description", [", ".join(facts)]),
        certificate,
        None if identifications == [None, None] else node("dcc:identifications", *identifications),
        node("dcc:measuringEquipmentQuantities", *quantities) if quantities else None,
    )


def _measured_range(name: str, low: float, high: float, notation: Notation) -> _Element:
    """An influence condition that the logs measured: its lowest and its highest value."""
    ends = (("math_minimum", low), ("math_maximum", high))
    quantities = (
        dcc_results.typed("dcc:quantity", value, "degC", notation, kind) for kind, value in ends
    )
    return notation.named(
        "dcc:influenceCondition", names.name_condition(name), node("dcc:data", *quantities)
    )


def _quantities(standard: Standard, notation: Notation) -> list[_Element]:
    """Range and expanded uncertainty of a standard, as far as it states them."""
    tag, elements = "dcc:measuringEquipmentQuantity", []
    if standard.range.strip():
        text_element = notation.rich("dcc:noQuantity", [standard.range])
        elements.append(node(tag, text_element, refType="calibkit_range"))
    U, kind = standard.expanded_uncertainty, "calibkit_expandedUncertainty"
    if U is not None:
        try:
            elements.append(dcc_results.typed(tag, U, standard.unit, notation, kind))
        except OutputError:  # a unit of the laboratory's own
            text_element = notation.rich("dcc:noQuantity", [f"{U!r} {standard.unit}"])
            elements.append(node(tag, text_element, refType=kind))
    return elements


def _methods(certificate: Certificate, block: Block, notation: Notation) -> _Element:
    """The laboratory's procedure, and how calibkit evaluated it, with the equations."""
    method, run = certificate.profile.method, certificate.run
    facts = [
        (Words("Revision: ", "版本："), method.revision),
        (Words("Deviations from the method: ", "对方法的偏离："), method.deviations),
        (Words("From external providers: ", "外部提供的部分："), method.external_providers),
    ]
    description = [label + Words(text) for label, text in facts if text.strip()]
    recipe = Words(
        f"Recipe {run.recipe}, digest of its text and of what --set changed (field recipe.sha256 of"
        " run.json): ",
        f"配方 {run.recipe}，文本及 --set 修改的摘要（run.json 的 recipe.sha256 字段）：",
    ) + Words(run.recipe_sha256)
    letter_meanings = [equation.where for equation in block.equations]
    latex = [equation.latex for equation in block.equations]
    return node(
        "dcc:usedMethods",
        notation.named(
            "dcc:usedMethod", method.name, notation.rich("dcc:description", description)
        ),
        notation.named(
            "dcc:usedMethod",
            f"{run.software}: {run.procedure}, {block.stage}",
            notation.rich("dcc:description", [recipe, run.content_digest, *letter_meanings], latex),
        ),
    )


def _influences(certificate: Certificate, notation: Notation) -> _Element:
    """Conditions of the laboratory in words, and those of the computation as numbers."""
    lab_conditions = certificate.profile.conditions
    texts = [(words, str(getattr(lab_conditions, key))) for key, words in CONDITIONS]
    texts += [(Words("Further conditions", "其他条件"), text) for text in lab_conditions.others]
    condition_texts = [(words, text) for words, text in texts if text.strip()]
    if not condition_texts and not certificate.run.conditions:
        condition_texts = [(HEADINGS["conditions"], xml.NOT_STATED)]
    return node(
        "dcc:influenceConditions",
        *(
            notation.named(
                "dcc:influenceCondition", words, node("dcc:data", notation.text("dcc:text", text))
            )
            for words, text in condition_texts
        ),
        *(_measured_range(*measured, notation) for measured in certificate.run.measured),
        *(
            dcc_results.influence(c.name, c.value, c.unit, notation, c.standard_uncertainty)
            for c in certificate.run.conditions
        ),
    )


def _file(attached: Attachment, notation: Notation) -> list[_Element]:
    """Parameters with covariance of every model of a coefficient file, and the file itself."""
    record = coefficients.loads(attached.content.decode("utf-8"), attached.name)
    return [
        *(
            dcc_results.parameters(record.stage, model, notation)
            for model in record.models
            if model.coefficients
        ),
        notation.named(
            "dcc:result",
            Words(f"Coefficient file {attached.name}", f"系数文件 {attached.name}"),
            notation.rich("dcc:description", [f"SHA-256 {attached.sha256}"]),
            node("dcc:data", _file_data(attached)),
        ),
    ]


def _file_data(attachment: Attachment) -> _Element:
    """`dcc:byteData` of a file."""
    return node(
        "dcc:byteData",
        node("dcc:fileName", one_line(attachment.name)),
        node("dcc:mimeType", attachment.media_type),
        node("dcc:dataBase64", base64.b64encode(attachment.content).decode()),
    )
