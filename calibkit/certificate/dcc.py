"""The certificate as a digital calibration certificate: DCC 3.3.0 of the PTB with quantities of
D-SI 2.2.1.

What it holds is what the PDF holds, besides every parameter with its covariance and the coefficient
files themselves. What the schema wants and nobody has stated stands there as "not stated", a
country as ZZ, a date of work as 0001-01-01, and the certificate is a DRAFT.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit import coefficients
from calibkit.certificate import dcc_check, dcc_results
from calibkit.certificate import dcc_xml as xml
from calibkit.certificate.content import Attachment, Relationship
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import add
from calibkit.certificate.words import Words, unit_mark
from calibkit.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from lxml.etree import _Element

    from calibkit.certificate.as_found import BeforeAfter
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
    """The DCC as a file of the certificate, its structure checked, and held against the schema
    where a folder has it.
    """
    made = render(certificate, lang)
    dcc_check.structure(made)
    if schema_dir is not None:
        dcc_check.schema(made, schema_dir)
    return Attachment(FILE, made, *DESCRIBED)


def render(certificate: Certificate, lang: Lang) -> bytes:
    """XML of a certificate, the same bytes for the same certificate."""
    etree = xml.etree()
    root = etree.Element(
        f"{{{xml.DCC}}}digitalCalibrationCertificate", nsmap=xml.NAMES, schemaVersion=VERSION
    )
    root.set(f"{{{xml.XSI}}}schemaLocation", f"{xml.DCC} {xml.DCC}/v{VERSION}/dcc.xsd")
    _administrative(add(root, "dcc:administrativeData"), certificate, lang)
    _measurements(add(root, "dcc:measurementResults"), certificate, lang)
    made: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return made


def local_gravity(certificate: Certificate) -> float | None:
    """Local gravity [m/s²] that the run was computed with, else as the profile states it."""
    found = (c.value for c in certificate.run.conditions if c.name == "local_gravity")
    return next(found, certificate.profile.conditions.local_gravity_mps2)


def _administrative(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """Software, dates and numbers, item, laboratory, person, customer, statements."""
    profile = certificate.profile
    software = add(add(parent, "dcc:dccSoftware"), "dcc:software")
    xml.text(software, "dcc:name", "calibkit", lang)
    add(software, "dcc:release", RELEASE)
    add(software, "dcc:type", "application")
    _core(add(parent, "dcc:coreData"), certificate, lang)
    _items(add(parent, "dcc:items"), certificate, lang)
    laboratory = add(parent, "dcc:calibrationLaboratory")
    _party(add(laboratory, "dcc:contact"), profile.laboratory, lang)
    person = add(add(parent, "dcc:respPersons"), "dcc:respPerson")
    who = add(person, "dcc:person")
    xml.text(who, "dcc:name", profile.authorised_by.name, lang)
    if profile.authorised_by.email.strip():
        add(who, "dcc:eMail", xml.line(profile.authorised_by.email))
    if profile.authorised_by.role.strip():
        add(person, "dcc:role", xml.line(profile.authorised_by.role))
    add(person, "dcc:mainSigner", "true")
    _party(add(parent, "dcc:customer"), profile.customer, lang)
    _statements(add(parent, "dcc:statements"), certificate, lang)


def _core(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """Number, dates, place, the certificate that this one replaces."""
    profile, dates = certificate.profile, certificate.profile.dates
    add(parent, "dcc:countryCodeISO3166_1", profile.laboratory.country or NO_COUNTRY)
    for name in ("dcc:usedLangCodeISO639_1", "dcc:mandatoryLangCodeISO639_1"):
        for code in xml.LANGUAGES[lang]:
            add(parent, name, code)
    add(parent, "dcc:uniqueIdentifier", xml.line(profile.certificate.number))
    if dates.received is not None:
        add(parent, "dcc:receiptDate", dates.received.isoformat())
    performed = NO_DATE if dates.performed is None else dates.performed.isoformat()
    add(parent, "dcc:beginPerformanceDate", performed)
    add(
        parent,
        "dcc:endPerformanceDate",
        performed if dates.performed_until is None else dates.performed_until.isoformat(),
    )
    place = profile.laboratory.place_of_work.strip()
    add(parent, "dcc:performanceLocation", place if place in PLACES else "laboratory")
    add(parent, "dcc:issueDate", certificate.issued.isoformat())
    if profile.certificate.amends.strip():
        amended = add(parent, "dcc:reportAmendedSubstituted")
        add(amended, "dcc:typeOfChange", "substituted")
        add(amended, "dcc:replacedUniqueIdentifier", xml.line(profile.certificate.amends))


def _items(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """The calibrated item."""
    item = certificate.profile.item
    made = add(parent, "dcc:item")
    xml.text(made, "dcc:name", item.type, lang)
    xml.rich(made, "dcc:description", [item.condition], lang)
    if item.maker.strip():
        xml.text(add(made, "dcc:manufacturer"), "dcc:name", item.maker, lang)
    if item.model.strip():
        add(made, "dcc:model", xml.line(item.model))
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


def _party(parent: _Element, party: Party, lang: Lang) -> None:
    """Name and location of a laboratory or a customer."""
    xml.text(parent, "dcc:name", party.name, lang)
    if party.email.strip():
        add(parent, "dcc:eMail", xml.line(party.email))
    if party.phone.strip():
        add(parent, "dcc:phone", xml.line(party.phone))
    location = add(parent, "dcc:location")
    if party.country:
        add(location, "dcc:countryCode", party.country)
    lines = [part for part in party.address.splitlines() if part.strip()]
    xml.rich(location, "dcc:further", lines or [xml.NOT_STATED], lang)


def _statements(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """What holds for the whole certificate: validity, draft, adjustment, amendment, remarks,
    conformity.
    """
    profile = certificate.profile
    only = Words(
        "The results relate only to the item calibrated, as it was when it was calibrated.",
        "结果仅与被校件及其校准时的状态有关。",
    )
    said: list[tuple[Words, list[Words | str]]] = [(Words("Validity", "有效范围"), [only])]
    if certificate.draft:
        listed: list[Words | str] = [Words(f"{m.key}: ") + m.what for m in certificate.missing]
        said.append(
            (
                Words(
                    "DRAFT: not a calibration certificate; missing", "草稿：非正式校准证书；尚缺"
                ),
                listed,
            )
        )
    said.append((Words("Place of work", "校准地点"), [profile.laboratory.place_of_work]))
    said.append((Words("Adjustment", "调整"), [profile.adjustment.statement]))
    said.append((Words("Amendment", "修改说明"), list(profile.certificate.changes)))
    said.append((Words("Remarks", "备注"), list(profile.remarks)))
    said.append(
        (
            Words("Left out", "剔除数据"),
            [f"{w}: {why} ({who})" for w, why, who in certificate.run.excluded],
        )
    )
    said.append((Words("Flags of the evaluation", "数据处理提示"), list(certificate.run.flags)))
    for name, texts in said:
        shown = [
            words for words in texts if (words if isinstance(words, str) else words.en).strip()
        ]
        if shown:
            made = add(parent, "dcc:statement")
            xml.text(made, "dcc:name", name, lang)
            xml.rich(made, "dcc:declaration", shown, lang)
    for statement in certificate.statements:
        _conformity(add(parent, "dcc:statement", refType="basic_conformity"), statement, lang)


def _conformity(parent: _Element, statement: Statement, lang: Lang) -> None:
    """A statement of conformity: which result, which limits, which rule, what follows."""
    unit = unit_mark(statement.result.unit)
    limits = [
        f"{word} {value!r} {unit}".strip()
        for word, value in (("lower limit", statement.lower), ("upper limit", statement.upper))
        if value is not None
    ]
    xml.text(
        parent,
        "dcc:name",
        " ".join(filter(None, (statement.name, statement.source))) or "specification",
        lang,
    )
    add(parent, "dcc:norm", f"decision rule: {statement.rule}")
    add(parent, "dcc:reference", xml.line(statement.result.key))
    verdict = Words(f"{'; '.join(limits)}: {statement.verdict}") + (
        Words(": ") + statement.reason if statement.reason.en else Words("")
    )
    xml.rich(parent, "dcc:declaration", [verdict], lang)
    if statement.verdict in CONFORMITY:
        add(parent, "dcc:conformity", CONFORMITY[statement.verdict])


def _measurements(parent: _Element, certificate: Certificate, lang: Lang) -> None:
    """One measurement result a coefficient file, then as found and as left."""
    standards = certificate.profile.standard
    if standards:
        into = add(parent, "dcc:measuringEquipments")
        for standard in standards:
            _equipment(add(into, "dcc:measuringEquipment"), standard, lang)
    gravity = local_gravity(certificate)
    files = {a.name: a for a in certificate.attachments}
    for block in certificate.blocks:
        made = add(parent, "dcc:measurementResult")
        xml.text(made, "dcc:name", block.title, lang)
        xml.rich(made, "dcc:description", block.notes, lang)
        _methods(made, certificate, block, lang)
        _influences(made, certificate, gravity, lang)
        results = add(made, "dcc:results")
        for table in block.tables:
            dcc_results.table(results, table, gravity, lang)
        if block.file in files:
            _file(results, files[block.file], gravity, lang)
    if not certificate.blocks or certificate.as_found is not None:
        _as_found(add(parent, "dcc:measurementResult"), certificate, gravity, lang)


def _equipment(parent: _Element, standard: Standard, lang: Lang) -> None:
    """A standard with the certificate that makes it traceable."""
    xml.text(parent, "dcc:name", standard.name, lang)
    facts = [
        f"{word} {value}"
        for word, value in (
            ("calibrated by", standard.laboratory),
            ("on", standard.date),
            ("valid until", standard.valid_until),
        )
        if value
    ]
    xml.rich(parent, "dcc:description", [", ".join(facts)], lang)
    numbers = [
        (Words("serial number", "编号"), standard.serial, "manufacturer"),
        (Words("calibration certificate", "校准证书"), standard.certificate, "other"),
    ]
    if any(value.strip() for _, value, _ in numbers):
        known = add(parent, "dcc:identifications")
        for name, value, issuer in numbers:
            if value.strip():
                _identification(known, issuer, value, name, lang)


def _methods(parent: _Element, certificate: Certificate, block: Block, lang: Lang) -> None:
    """The laboratory's procedure, and how calibkit evaluated it, with the equations."""
    method, run = certificate.profile.method, certificate.run
    methods = add(parent, "dcc:usedMethods")
    made = add(methods, "dcc:usedMethod")
    xml.text(made, "dcc:name", method.name, lang)
    facts = [
        Words("Revision: ", "版本：") + Words(method.revision),
        Words("Deviations from the method: ", "对方法的偏离：") + Words(method.deviations),
        Words("From external providers: ", "外部提供的部分：") + Words(method.external_providers),
    ]
    given = (method.revision, method.deviations, method.external_providers)
    xml.rich(
        made, "dcc:description", [w for w, v in zip(facts, given, strict=True) if v.strip()], lang
    )
    made = add(methods, "dcc:usedMethod")
    xml.text(made, "dcc:name", f"{run.software}: {run.procedure}, {block.stage}", lang)
    where = [equation.where for equation in block.equations]
    recipe = Words(
        f"Recipe {run.recipe}, digest of its text and of what --set changed (field recipe.sha256 of"
        " run.json): ",
        f"配方 {run.recipe}，文本及 --set 修改的摘要（run.json 的 recipe.sha256 字段）：",
    ) + Words(run.recipe_sha256)
    xml.rich(
        made,
        "dcc:description",
        [recipe, run.content_digest, *where],
        lang,
        [equation.latex for equation in block.equations],
    )


def _influences(
    parent: _Element, certificate: Certificate, gravity: float | None, lang: Lang
) -> None:
    """Conditions of the laboratory in words, and those of the computation as numbers."""
    from calibkit.certificate.sheet import CONDITIONS

    stated = certificate.profile.conditions
    texts = [(words, str(getattr(stated, key))) for key, words in CONDITIONS]
    texts += [(Words("Further conditions", "其他条件"), text) for text in stated.others]
    shown = [(words, text) for words, text in texts if text.strip()]
    if not shown and not certificate.run.conditions:
        shown = [(Words("Conditions", "校准条件"), xml.NOT_STATED)]
    into = add(parent, "dcc:influenceConditions")
    for words, text in shown:
        made = add(into, "dcc:influenceCondition")
        xml.text(made, "dcc:name", words, lang)
        xml.content(add(add(made, "dcc:data"), "dcc:text"), text, lang)
    for c in certificate.run.conditions:
        dcc_results.influence(into, c.name, c.value, c.unit, gravity, lang, c.standard_uncertainty)


def _file(parent: _Element, attached: Attachment, gravity: float | None, lang: Lang) -> None:
    """Parameters with covariance of every model of a coefficient file, and the file itself."""
    record = coefficients.loads(attached.content.decode("utf-8"), attached.name)
    for model in record.models:
        if model.coefficients:
            dcc_results.parameters(parent, record.stage, model, gravity, lang)
    made = add(parent, "dcc:result")
    xml.text(
        made,
        "dcc:name",
        Words(f"Coefficient file {attached.name}", f"系数文件 {attached.name}"),
        lang,
    )
    xml.rich(made, "dcc:description", [f"SHA-256 {attached.sha256}"], lang)
    xml.file(add(made, "dcc:data"), attached)


def _as_found(
    parent: _Element, certificate: Certificate, gravity: float | None, lang: Lang
) -> None:
    """As-found and as-left results of a validation, descriptors but for those that state an
    uncertainty.
    """
    xml.text(parent, "dcc:name", Words("As found and as left", "调整前与调整后"), lang)
    results = add(parent, "dcc:results")
    found = certificate.as_found
    rows = () if found is None else (*found.rows, *found.check_points)
    before = [(row, row.found, None) for row in rows]
    after = [(row, row.left, row.left_u) for row in rows]
    for head, stated in (
        (Words("as found", "调整前"), before),
        (Words("as left", "调整后"), after),
    ):
        made = add(results, "dcc:result")
        xml.text(made, "dcc:name", head, lang)
        data = add(made, "dcc:data")
        if all(value is None for _, value, _ in stated):
            xml.content(add(data, "dcc:text"), xml.NOT_STATED, lang)
        for row, value, U in stated:
            if value is not None:
                _descriptor(data, row, (value, U), gravity, lang)


def _descriptor(
    parent: _Element,
    row: BeforeAfter,
    stated: tuple[float, float | None],
    gravity: float | None,
    lang: Lang,
) -> None:
    """One figure of a validation, with U (k = 2) where it states one."""
    value, U = stated
    unit = dsi(row.unit).at(gravity)
    quantity = add(parent, "dcc:quantity", refType=dcc_results.MEASURED)
    log = Words(f"{row.log}: ") if row.log else Words("")
    xml.text(quantity, "dcc:name", log + row.what, lang)
    made = add(quantity, "si:real")
    add(made, "si:value", xml.number(value * unit.factor))
    add(made, "si:unit", unit.text)
    if U:
        expanded = add(add(made, "si:measurementUncertaintyUnivariate"), "si:expandedMU")
        add(expanded, "si:valueExpandedMU", xml.number(U * unit.factor))
        add(expanded, "si:coverageFactor", "2.0")
        add(expanded, "si:coverageProbability", "0.9545")
