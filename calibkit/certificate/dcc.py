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
from calibkit.certificate import dcc_check, dcc_results, dcc_xml as xml
from calibkit.certificate.content import Attachment, Relationship
from calibkit.certificate.dcc_xml import Notation, node, one_line
from calibkit.certificate.words import CONDITIONS, HEADINGS, SENTENCES, Words, unit_mark
from calibkit.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from lxml.etree import _Element

    from calibkit.certificate.conformity import Statement
    from calibkit.certificate.content import Certificate
    from calibkit.certificate.profile import Party, Standard
    from calibkit.certificate.results import Block
    from calibkit.certificate.words import Lang

FILE = "dcc.xml"
VERSION = "3.3.0"
RELEASE = f"v{__version__}"
DESCRIBED: tuple[str, Relationship, str] = (
    "application/xml",
    "alternative",
    f"digital calibration certificate, DCC {VERSION}",
)
"""Media type, what the file is to the PDF, and what it is called there."""
NO_COUNTRY = "ZZ"
"""User-assigned code of ISO 3166-1 that stands for an unknown country."""
NO_DATE = "0001-01-01"
CONFORMITY = {
    "pass": "pass",
    "fail": "fail",
    "conditional pass": "conditionalPass",
    "conditional fail": "conditionalFail",
}
"""Verdict → its name in the schema, which has none for a statement that is not possible."""
SERIAL_NUMBER = Words("serial number", "编号")
PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Places of work that the schema knows; any other text stands in a statement."""


def attach_dcc(certificate: Certificate, lang: Lang, schema_dir: Path | None = None) -> Attachment:
    """The DCC as a file of the certificate, its structure checked, and validated against the schema
    where a folder has it.
    """
    made = render(certificate, lang)
    dcc_check.check(made, schema_dir)
    return Attachment(FILE, made, *DESCRIBED)


def render(certificate: Certificate, lang: Lang) -> bytes:
    """XML of a certificate, the same bytes for the same certificate."""
    gravity = (c.value for c in certificate.run.conditions if c.name == "local_gravity")
    notation = Notation(lang, next(gravity, certificate.profile.conditions.local_gravity_mps2))
    root = node(
        "dcc:digitalCalibrationCertificate",
        _administrative(certificate, notation),
        _measurements(certificate, notation),
        schemaVersion=VERSION,
    )
    root.set(f"{{{xml.XSI}}}schemaLocation", f"{xml.DCC} {xml.DCC}/v{VERSION}/dcc.xsd")
    made: bytes = xml.etree().tostring(
        root, xml_declaration=True, encoding="UTF-8", pretty_print=True
    )
    return made


def _administrative(certificate: Certificate, notation: Notation) -> _Element:
    """Software, dates and numbers, item, laboratory, person, customer, statements."""
    profile, person = certificate.profile, certificate.profile.authorised_by
    software = (node("dcc:release", RELEASE), node("dcc:type", "application"))
    return node(
        "dcc:administrativeData",
        node("dcc:dccSoftware", notation.named("dcc:software", "calibkit", *software)),
        _core(certificate, notation.lang),
        _item(certificate, notation),
        node("dcc:calibrationLaboratory", _party("dcc:contact", profile.laboratory, notation)),
        node(
            "dcc:respPersons",
            node(
                "dcc:respPerson",
                notation.named(
                    "dcc:person", person.name, _optional_node("dcc:eMail", person.email)
                ),
                _optional_node("dcc:role", person.role),
                node("dcc:mainSigner", "true"),
            ),
        ),
        _party("dcc:customer", profile.customer, notation),
        _statements(certificate, notation),
    )


def _core(certificate: Certificate, lang: Lang) -> _Element:
    """Number, dates, place, the certificate that this one replaces."""
    profile, dates = certificate.profile, certificate.profile.dates
    performed = str(dates.performed or NO_DATE)
    place = profile.laboratory.place_of_work.strip()
    amended = None
    if profile.certificate.amends.strip():
        amended = node(
            "dcc:reportAmendedSubstituted",
            node("dcc:typeOfChange", "substituted"),
            node("dcc:replacedUniqueIdentifier", xml.one_line(profile.certificate.amends)),
        )
    return node(
        "dcc:coreData",
        node("dcc:countryCodeISO3166_1", profile.laboratory.country or NO_COUNTRY),
        *(node("dcc:usedLangCodeISO639_1", code) for code in xml.LANGUAGES[lang]),
        *(node("dcc:mandatoryLangCodeISO639_1", code) for code in xml.LANGUAGES[lang]),
        node("dcc:uniqueIdentifier", xml.one_line(profile.certificate.number)),
        _optional_node("dcc:receiptDate", str(dates.received or "")),
        node("dcc:beginPerformanceDate", performed),
        node("dcc:endPerformanceDate", str(dates.performed_until or performed)),
        node("dcc:performanceLocation", place if place in PLACES else "laboratory"),
        node("dcc:issueDate", certificate.issued.isoformat()),
        amended,
    )


def _item(certificate: Certificate, notation: Notation) -> _Element:
    """The calibrated item."""
    item = certificate.profile.item
    serial = _identification(
        "manufacturer",
        certificate.run.serial,
        SERIAL_NUMBER,
        notation,
        refType="basic_serialNumber",
    )
    other = _identification("other", item.identification, Words("identification", "标识"), notation)
    return node(
        "dcc:items",
        notation.named(
            "dcc:item",
            item.type,
            notation.rich("dcc:description", [item.condition]),
            notation.named("dcc:manufacturer", item.maker) if item.maker.strip() else None,
            _optional_node("dcc:model", item.model),
            node("dcc:identifications", serial, other),
        ),
    )


def _identification(
    issuer: str, value: str, name: Words, notation: Notation, **attributes: str
) -> _Element | None:
    """One identification with who gave it; None where there is none."""
    if not value.strip():
        return None
    return node(
        "dcc:identification",
        node("dcc:issuer", issuer),
        node("dcc:value", xml.one_line(value)),
        notation.text("dcc:name", name),
        **attributes,
    )


def _party(tag: str, party: Party, notation: Notation) -> _Element:
    """Name and location of a laboratory or a customer."""
    lines = [part for part in party.address.splitlines() if part.strip()]
    return notation.named(
        tag,
        party.name,
        _optional_node("dcc:eMail", party.email),
        _optional_node("dcc:phone", party.phone),
        node(
            "dcc:location",
            _optional_node("dcc:countryCode", party.country),
            notation.rich("dcc:further", lines or [xml.NOT_STATED]),
        ),
    )


def _statements(certificate: Certificate, notation: Notation) -> _Element:
    """Statements on the whole certificate: validity, draft, adjustment, amendment, remarks,
    conformity.
    """
    profile, run = certificate.profile, certificate.run
    missing = Words("DRAFT: not a calibration certificate; missing", "草稿：非正式校准证书；尚缺")
    statements: list[tuple[Words, Sequence[Words | str]]] = [
        (Words("Validity", "有效范围"), [SENTENCES["only_item"]]),
        (missing, [Words(f"{m.key}: ") + m.what for m in certificate.missing]),
        (Words("Place of work", "校准地点"), [profile.laboratory.place_of_work]),
        (Words("Adjustment", "调整"), [profile.adjustment.statement]),
        (Words("Amendment", "修改说明"), profile.certificate.changes),
        (Words("Remarks", "备注"), profile.remarks),
        (Words("Left out", "剔除数据"), [f"{w}: {why} ({who})" for w, why, who in run.excluded]),
        (Words("Flags of the evaluation", "数据处理提示"), run.flags),
    ]
    return node(
        "dcc:statements",
        *(
            notation.named("dcc:statement", name, notation.rich("dcc:declaration", texts))
            for name, texts in statements
            if xml.non_empty(texts)
        ),
        *(_conformity(statement, notation) for statement in certificate.statements),
    )


def _conformity(statement: Statement, notation: Notation) -> _Element:
    """A statement of conformity: which result, which limits, which rule, what follows."""
    unit = unit_mark(statement.result.unit)
    limits = [
        f"{word} {value!r} {unit}".strip()
        for word, value in (("lower limit", statement.lower), ("upper limit", statement.upper))
        if value is not None
    ]
    verdict = Words(f"{'; '.join(limits)}: {statement.verdict}")
    if statement.reason.en:
        verdict += Words(": ") + statement.reason
    return notation.named(
        "dcc:statement",
        " ".join(filter(None, (statement.name, statement.source))) or "specification",
        node("dcc:norm", f"decision rule: {statement.rule}"),
        node("dcc:reference", xml.one_line(statement.result.key)),
        notation.rich("dcc:declaration", [verdict]),
        _optional_node("dcc:conformity", CONFORMITY.get(statement.verdict, "")),
        refType="basic_conformity",
    )


def _measurements(certificate: Certificate, notation: Notation) -> _Element:
    """One measurement result per coefficient file, then as found and as left."""
    equipment = [_equipment(standard, notation) for standard in certificate.profile.standard]
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


def _equipment(standard: Standard, notation: Notation) -> _Element:
    """A standard with the certificate that makes it traceable."""
    facts = [
        f"{word} {value}"
        for word, value in (
            ("calibrated by", standard.laboratory),
            ("on", standard.date),
            ("valid until", standard.valid_until),
        )
        if value
    ]
    known = [
        _identification("manufacturer", standard.serial, SERIAL_NUMBER, notation),
        _identification(
            "other", standard.certificate, Words("calibration certificate", "校准证书"), notation
        ),
    ]
    return notation.named(
        "dcc:measuringEquipment",
        standard.name,
        notation.rich("dcc:description", [", ".join(facts)]),
        None if known == [None, None] else node("dcc:identifications", *known),
    )


def _methods(certificate: Certificate, block: Block, notation: Notation) -> _Element:
    """The laboratory's procedure, and how calibkit evaluated it, with the equations."""
    method, run = certificate.profile.method, certificate.run
    facts = [
        (Words("Revision: ", "版本："), method.revision),
        (Words("Deviations from the method: ", "对方法的偏离："), method.deviations),
        (Words("From external providers: ", "外部提供的部分："), method.external_providers),
    ]
    given = [label + Words(text) for label, text in facts if text.strip()]
    recipe = Words(
        f"Recipe {run.recipe}, digest of its text and of what --set changed (field recipe.sha256 of"
        " run.json): ",
        f"配方 {run.recipe}，文本及 --set 修改的摘要（run.json 的 recipe.sha256 字段）：",
    ) + Words(run.recipe_sha256)
    where = [equation.where for equation in block.equations]
    latex = [equation.latex for equation in block.equations]
    return node(
        "dcc:usedMethods",
        notation.named("dcc:usedMethod", method.name, notation.rich("dcc:description", given)),
        notation.named(
            "dcc:usedMethod",
            f"{run.software}: {run.procedure}, {block.stage}",
            notation.rich("dcc:description", [recipe, run.content_digest, *where], latex),
        ),
    )


def _influences(certificate: Certificate, notation: Notation) -> _Element:
    """Conditions of the laboratory in words, and those of the computation as numbers."""
    stated = certificate.profile.conditions
    texts = [(words, str(getattr(stated, key))) for key, words in CONDITIONS]
    texts += [(Words("Further conditions", "其他条件"), text) for text in stated.others]
    shown = [(words, text) for words, text in texts if text.strip()]
    if not shown and not certificate.run.conditions:
        shown = [(HEADINGS["conditions"], xml.NOT_STATED)]
    return node(
        "dcc:influenceConditions",
        *(
            notation.named(
                "dcc:influenceCondition", words, node("dcc:data", notation.text("dcc:text", text))
            )
            for words, text in shown
        ),
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


def _optional_node(name: str, value: str) -> _Element | None:
    """Element with a text on one line; None where the text is empty."""
    return node(name, one_line(value)) if value.strip() else None


def _file_data(attachment: Attachment) -> _Element:
    """`dcc:byteData` of a file."""
    return node(
        "dcc:byteData",
        node("dcc:fileName", one_line(attachment.name)),
        node("dcc:mimeType", attachment.media_type),
        node("dcc:dataBase64", base64.b64encode(attachment.content).decode()),
    )
