"""The certificate as a digital calibration certificate: DCC 3.3.0 of the PTB with quantities of
D-SI 2.2.1.

It holds what the PDF holds, and besides every parameter with its covariance and the coefficient
files themselves. What the schema requires and nobody has stated is given as "not stated", a country
as ZZ, a date of work as 0001-01-01, and the certificate is a DRAFT.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit import coefficients
from calibkit.certificate import dcc_check, dcc_results, dcc_xml as xml
from calibkit.certificate.content import Attachment, Relationship
from calibkit.certificate.dcc_xml import Notation, add
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
PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Places of work that the schema knows; any other text stands in a statement."""


def attachment(certificate: Certificate, lang: Lang, schema_dir: Path | None = None) -> Attachment:
    """The DCC as a file of the certificate, its structure checked, and validated against the schema
    where a folder has it.
    """
    made = render(certificate, lang)
    dcc_check.check(made, schema_dir)
    return Attachment(FILE, made, *DESCRIBED)


def render(certificate: Certificate, lang: Lang) -> bytes:
    """XML of a certificate, the same bytes for the same certificate."""
    etree = xml.etree()
    root = etree.Element(
        f"{{{xml.DCC}}}digitalCalibrationCertificate", nsmap=xml.NAMES, schemaVersion=VERSION
    )
    root.set(f"{{{xml.XSI}}}schemaLocation", f"{xml.DCC} {xml.DCC}/v{VERSION}/dcc.xsd")
    _administrative(add(root, "dcc:administrativeData"), certificate, lang)
    gravity = (c.value for c in certificate.run.conditions if c.name == "local_gravity")
    known = next(gravity, certificate.profile.conditions.local_gravity_mps2)
    _measurements(add(root, "dcc:measurementResults"), certificate, Notation(lang, known))
    made: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return made


def _administrative(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """Software, dates and numbers, item, laboratory, person, customer, statements."""
    profile, person = certificate.profile, certificate.profile.authorised_by
    software = xml.named(add(parent, "dcc:dccSoftware"), "dcc:software", "calibkit", lang)
    add(software, "dcc:release", RELEASE)
    add(software, "dcc:type", "application")
    _core(add(parent, "dcc:coreData"), certificate, lang)
    _item(add(parent, "dcc:items"), certificate, lang)
    _party(add(parent, "dcc:calibrationLaboratory"), "dcc:contact", profile.laboratory, lang)
    responsible = add(add(parent, "dcc:respPersons"), "dcc:respPerson")
    xml.optional(xml.named(responsible, "dcc:person", person.name, lang), "dcc:eMail", person.email)
    xml.optional(responsible, "dcc:role", person.role)
    add(responsible, "dcc:mainSigner", "true")
    _party(parent, "dcc:customer", profile.customer, lang)
    _statements(add(parent, "dcc:statements"), certificate, lang)


def _core(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """Number, dates, place, the certificate that this one replaces."""
    profile, dates = certificate.profile, certificate.profile.dates
    add(parent, "dcc:countryCodeISO3166_1", profile.laboratory.country or NO_COUNTRY)
    for name in ("dcc:usedLangCodeISO639_1", "dcc:mandatoryLangCodeISO639_1"):
        for code in xml.LANGUAGES[lang]:
            add(parent, name, code)
    add(parent, "dcc:uniqueIdentifier", xml.line(profile.certificate.number))
    xml.optional(parent, "dcc:receiptDate", str(dates.received or ""))
    performed = str(dates.performed or NO_DATE)
    add(parent, "dcc:beginPerformanceDate", performed)
    add(parent, "dcc:endPerformanceDate", str(dates.performed_until or performed))
    place = profile.laboratory.place_of_work.strip()
    add(parent, "dcc:performanceLocation", place if place in PLACES else "laboratory")
    add(parent, "dcc:issueDate", certificate.issued.isoformat())
    if profile.certificate.amends.strip():
        amended = add(parent, "dcc:reportAmendedSubstituted")
        add(amended, "dcc:typeOfChange", "substituted")
        add(amended, "dcc:replacedUniqueIdentifier", xml.line(profile.certificate.amends))


def _item(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """The calibrated item."""
    item = certificate.profile.item
    made = xml.named(parent, "dcc:item", item.type, lang)
    xml.rich(made, "dcc:description", [item.condition], lang)
    if item.maker.strip():
        xml.named(made, "dcc:manufacturer", item.maker, lang)
    xml.optional(made, "dcc:model", item.model)
    known = add(made, "dcc:identifications")
    serial = Words("serial number", "编号")
    _identification(
        known, "manufacturer", certificate.run.serial, serial, lang, refType="basic_serialNumber"
    )
    if item.identification.strip():
        _identification(known, "other", item.identification, Words("identification", "标识"), lang)


def _identification(
    parent: _Element, issuer: str, value: str, name: Words, lang: Lang, **attributes: str
) -> None:
    """One identification with who gave it."""
    made = add(parent, "dcc:identification", **attributes)
    add(made, "dcc:issuer", issuer)
    add(made, "dcc:value", xml.line(value))
    xml.text(made, "dcc:name", name, lang)


def _party(parent: _Element, tag: str, party: Party, lang: Lang) -> None:
    """Name and location of a laboratory or a customer."""
    made = xml.named(parent, tag, party.name, lang)
    xml.optional(made, "dcc:eMail", party.email)
    xml.optional(made, "dcc:phone", party.phone)
    location = add(made, "dcc:location")
    xml.optional(location, "dcc:countryCode", party.country)
    lines = [part for part in party.address.splitlines() if part.strip()]
    xml.rich(location, "dcc:further", lines or [xml.NOT_STATED], lang)


def _statements(parent: _Element, certificate: Certificate, lang: Lang) -> None:
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
    for name, texts in statements:
        if xml.given(texts):
            xml.rich(xml.named(parent, "dcc:statement", name, lang), "dcc:declaration", texts, lang)
    for statement in certificate.statements:
        _conformity(parent, statement, lang)


def _conformity(parent: _Element, statement: Statement, lang: Lang) -> None:
    """A statement of conformity: which result, which limits, which rule, what follows."""
    unit = unit_mark(statement.result.unit)
    limits = [
        f"{word} {value!r} {unit}".strip()
        for word, value in (("lower limit", statement.lower), ("upper limit", statement.upper))
        if value is not None
    ]
    name = " ".join(filter(None, (statement.name, statement.source))) or "specification"
    made = xml.named(parent, "dcc:statement", name, lang, refType="basic_conformity")
    add(made, "dcc:norm", f"decision rule: {statement.rule}")
    add(made, "dcc:reference", xml.line(statement.result.key))
    verdict = Words(f"{'; '.join(limits)}: {statement.verdict}")
    if statement.reason.en:
        verdict += Words(": ") + statement.reason
    xml.rich(made, "dcc:declaration", [verdict], lang)
    if statement.verdict in CONFORMITY:
        add(made, "dcc:conformity", CONFORMITY[statement.verdict])


def _measurements(parent: _Element, certificate: Certificate, notation: Notation) -> None:
    """One measurement result per coefficient file, then as found and as left."""
    lang = notation.lang
    if certificate.profile.standard:
        into = add(parent, "dcc:measuringEquipments")
        for standard in certificate.profile.standard:
            _equipment(into, standard, lang)
    files = {a.name: a for a in certificate.attachments}
    for block in certificate.blocks:
        made = xml.named(parent, "dcc:measurementResult", block.title, lang)
        xml.rich(made, "dcc:description", block.notes, lang)
        _methods(add(made, "dcc:usedMethods"), certificate, block, lang)
        _influences(add(made, "dcc:influenceConditions"), certificate, notation)
        results = add(made, "dcc:results")
        for table in block.tables:
            dcc_results.table(results, table, notation)
        if block.file in files:
            _file(results, files[block.file], notation)
    if not certificate.blocks or certificate.as_found is not None:
        dcc_results.as_found(parent, certificate.as_found, notation)


def _equipment(parent: _Element, standard: Standard, lang: Lang) -> None:
    """A standard with the certificate that makes it traceable."""
    made = xml.named(parent, "dcc:measuringEquipment", standard.name, lang)
    facts = [
        f"{word} {value}"
        for word, value in (
            ("calibrated by", standard.laboratory),
            ("on", standard.date),
            ("valid until", standard.valid_until),
        )
        if value
    ]
    xml.rich(made, "dcc:description", [", ".join(facts)], lang)
    numbers = [
        (Words("serial number", "编号"), standard.serial, "manufacturer"),
        (Words("calibration certificate", "校准证书"), standard.certificate, "other"),
    ]
    if any(value.strip() for _, value, _ in numbers):
        known = add(made, "dcc:identifications")
        for name, value, issuer in numbers:
            if value.strip():
                _identification(known, issuer, value, name, lang)


def _methods(parent: _Element, certificate: Certificate, block: Block, lang: Lang) -> None:
    """The laboratory's procedure, and how calibkit evaluated it, with the equations."""
    method, run = certificate.profile.method, certificate.run
    facts = [
        (Words("Revision: ", "版本："), method.revision),
        (Words("Deviations from the method: ", "对方法的偏离："), method.deviations),
        (Words("From external providers: ", "外部提供的部分："), method.external_providers),
    ]
    made = xml.named(parent, "dcc:usedMethod", method.name, lang)
    given = [label + Words(text) for label, text in facts if text.strip()]
    xml.rich(made, "dcc:description", given, lang)
    evaluation = f"{run.software}: {run.procedure}, {block.stage}"
    made = xml.named(parent, "dcc:usedMethod", evaluation, lang)
    recipe = Words(
        f"Recipe {run.recipe}, digest of its text and of what --set changed (field recipe.sha256 of"
        " run.json): ",
        f"配方 {run.recipe}，文本及 --set 修改的摘要（run.json 的 recipe.sha256 字段）：",
    ) + Words(run.recipe_sha256)
    where = [equation.where for equation in block.equations]
    latex = [equation.latex for equation in block.equations]
    xml.rich(made, "dcc:description", [recipe, run.content_digest, *where], lang, latex)


def _influences(parent: _Element, certificate: Certificate, notation: Notation) -> None:
    """Conditions of the laboratory in words, and those of the computation as numbers."""
    stated = certificate.profile.conditions
    texts = [(words, str(getattr(stated, key))) for key, words in CONDITIONS]
    texts += [(Words("Further conditions", "其他条件"), text) for text in stated.others]
    shown = [(words, text) for words, text in texts if text.strip()]
    if not shown and not certificate.run.conditions:
        shown = [(HEADINGS["conditions"], xml.NOT_STATED)]
    for words, text in shown:
        made = xml.named(parent, "dcc:influenceCondition", words, notation.lang)
        xml.text(add(made, "dcc:data"), "dcc:text", text, notation.lang)
    for c in certificate.run.conditions:
        dcc_results.influence(parent, c.name, c.value, c.unit, notation, c.standard_uncertainty)


def _file(parent: _Element, attached: Attachment, notation: Notation) -> None:
    """Parameters with covariance of every model of a coefficient file, and the file itself."""
    record = coefficients.loads(attached.content.decode("utf-8"), attached.name)
    for model in record.models:
        if model.coefficients:
            dcc_results.parameters(parent, record.stage, model, notation)
    name = Words(f"Coefficient file {attached.name}", f"系数文件 {attached.name}")
    made = xml.named(parent, "dcc:result", name, notation.lang)
    xml.rich(made, "dcc:description", [f"SHA-256 {attached.sha256}"], notation.lang)
    xml.file(add(made, "dcc:data"), attached)
