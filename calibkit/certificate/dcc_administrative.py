"""The administrative part of a digital calibration certificate: software, dates and numbers, item,
laboratory, persons, customer, statements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from calibkit.certificate import circumstances, dcc_results, dcc_xml as xml, tables
from calibkit.certificate.dcc_xml import node
from calibkit.certificate.words import SENTENCES, Words
from calibkit.new_files import RUN_FILE
from calibkit.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml.etree import _Element

    from calibkit.certificate.conformity import ConformityStatement
    from calibkit.certificate.content import Certificate
    from calibkit.certificate.dcc_xml import Notation
    from calibkit.certificate.profile import Party

    _Stated: TypeAlias = tuple[Words, Sequence[Words | str], str]

RELEASE = f"v{__version__}"
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
ITEM = "item1"
"""Identifier of the calibrated item."""
REF_TYPES = {
    "calibkit_toleranceLimit": "limit of a specification that a result is judged by",
    "calibkit_acceptanceLimit": "limit that the decision rule derives from a tolerance limit",
    "calibkit_asFound": "result before the correction that the certificate states",
    "calibkit_asLeft": "result after the correction that the certificate states",
    "calibkit_expandedUncertainty": "largest expanded uncertainty of a standard",
    "calibkit_range": "range of a standard",
}
"""Types that the published databases lack."""
REF_TYPE_PAGE = "https://calibkit.readthedocs.io/certificate.html"


def write(certificate: Certificate, notation: Notation) -> _Element:
    """Software, types, dates and numbers, item, laboratory, persons, customer, statements."""
    profile = certificate.profile
    software = (node("dcc:release", RELEASE), node("dcc:type", "application"))
    return node(
        "dcc:administrativeData",
        node("dcc:dccSoftware", notation.named("dcc:software", "calibkit", *software)),
        node("dcc:refTypeDefinitions", *_ref_types(notation)),
        _core(certificate, notation),
        _item(certificate, notation),
        node(
            "dcc:calibrationLaboratory",
            optional("dcc:calibrationLaboratoryCode", profile.laboratory.code),
            _party("dcc:contact", profile.laboratory, notation),
        ),
        _persons(certificate, notation),
        _party("dcc:customer", profile.customer, notation),
        _statements(certificate, notation),
    )


def _ref_types(notation: Notation) -> list[_Element]:
    """Definitions of the types that no published database has."""
    return [
        notation.named(
            "dcc:refTypeDefinition",
            Words(meaning),
            node("dcc:namespace", "calibkit"),
            node("dcc:link", REF_TYPE_PAGE),
            node("dcc:release", RELEASE),
            refType=name,
        )
        for name, meaning in REF_TYPES.items()
    ]


def _core(certificate: Certificate, notation: Notation) -> _Element:
    """Number, order, dates, place, the certificate that this one replaces, the one before it."""
    profile, dates = certificate.profile, certificate.profile.dates
    numbering = profile.certificate
    performed = str(dates.performed or NO_DATE)
    place = profile.laboratory.place_of_work.strip()
    languages = xml.LANGUAGES[notation.lang]
    order = identification(
        "customer",
        numbering.order,
        Words("order", "委托单号"),
        notation,
        refType="basic_orderNumber",
    )
    amended = previous = None
    if numbering.amends.strip():
        amended = node(
            "dcc:reportAmendedSubstituted",
            node("dcc:typeOfChange", "substituted"),
            node("dcc:replacedUniqueIdentifier", xml.one_line(numbering.amends)),
        )
    if numbering.previous.strip():
        name = Words("calibration certificate before this one", "上一份校准证书")
        previous = digest(
            "dcc:previousReport", name, numbering.previous, numbering.previous_sha256, notation
        )
    return node(
        "dcc:coreData",
        node("dcc:countryCodeISO3166_1", profile.laboratory.country or NO_COUNTRY),
        *(node("dcc:usedLangCodeISO639_1", code) for code in languages),
        *(node("dcc:mandatoryLangCodeISO639_1", code) for code in languages),
        node("dcc:uniqueIdentifier", xml.one_line(numbering.number)),
        None if order is None else node("dcc:identifications", order),
        optional("dcc:receiptDate", str(dates.received or "")),
        node("dcc:beginPerformanceDate", performed),
        node("dcc:endPerformanceDate", str(dates.performed_until or performed)),
        node("dcc:performanceLocation", place if place in PLACES else "laboratory"),
        node("dcc:issueDate", certificate.issued.isoformat()),
        amended,
        previous,
    )


def digest(
    tag: str, name: Words, number: str, sha256: str, notation: Notation, *facts: _Element | None
) -> _Element:
    """A certificate by its number and the digest of its file, and facts of it."""
    return node(
        tag,
        notation.text("dcc:referral", name),
        node("dcc:referralID", xml.one_line(number)),
        node("dcc:procedure", "SHA-256"),
        node("dcc:value", sha256),
        *facts,
    )


def _item(certificate: Certificate, notation: Notation) -> _Element:
    """The calibrated item."""
    item = certificate.profile.item
    serial = identification(
        "manufacturer",
        certificate.run.serial,
        SERIAL_NUMBER,
        notation,
        refType="basic_serialNumber",
    )
    other = identification("other", item.identification, Words("identification", "标识"), notation)
    return node(
        "dcc:items",
        notation.named(
            "dcc:item",
            item.type,
            notation.rich("dcc:description", [item.condition]),
            notation.named("dcc:manufacturer", item.maker) if item.maker.strip() else None,
            optional("dcc:model", item.model),
            node("dcc:identifications", serial, other),
            id=ITEM,
        ),
    )


def identification(
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


def _persons(certificate: Certificate, notation: Notation) -> _Element:
    """Who calibrated, checked and authorised; the last is the main signer."""
    profile = certificate.profile
    people = (
        (profile.calibrated_by, "calibrated by", "false"),
        (profile.checked_by, "checked by", "false"),
        (profile.authorised_by, "", "true"),
    )
    return node(
        "dcc:respPersons",
        *(
            node(
                "dcc:respPerson",
                notation.named("dcc:person", person.name, optional("dcc:eMail", person.email)),
                optional("dcc:role", person.role or usual),
                node("dcc:mainSigner", main),
            )
            for person, usual, main in people
            if person.name.strip() or main == "true"
        ),
    )


def _party(tag: str, party: Party, notation: Notation) -> _Element:
    """Name and location of a laboratory or a customer."""
    lines = [part for part in party.address.splitlines() if part.strip()]
    return notation.named(
        tag,
        party.name,
        optional("dcc:eMail", party.email),
        optional("dcc:phone", party.phone),
        node(
            "dcc:location",
            optional("dcc:countryCode", party.country),
            notation.rich("dcc:further", lines or [xml.NOT_STATED]),
        ),
    )


def _list_statements(certificate: Certificate) -> list[_Stated]:
    """Statements on the whole certificate: what they are called, their texts, their refType."""
    profile, run = certificate.profile, certificate.run
    numbering = profile.certificate
    missing = Words("DRAFT: not a calibration certificate; missing", "草稿：非正式校准证书；尚缺")
    accredited = circumstances.describe_accreditation(certificate)
    remarks = circumstances.describe_remarks(len(run.flags), RUN_FILE)
    outside = any(result.outside_scope for result in certificate.results)
    return [
        (Words("Validity", "有效范围"), [SENTENCES["only_item"]], ""),
        (missing, [Words(f"{m.key}: ") + m.description for m in certificate.missing], ""),
        (
            Words("Traceability", "溯源性"),
            [numbering.traceability or SENTENCES["traceability"]] if profile.standard else [],
            "basic_metrologicallyTraceableToSI",
        ),
        (
            Words("Accreditation", "认可"),
            [accredited, *([tables.OUTSIDE] if outside else [])] if accredited.en else [],
            "basic_isInCMC",
        ),
        (
            Words("Reproduction", "复制"),
            [numbering.reproduction or SENTENCES["reproduction"]],
            "",
        ),
        (Words("Place of work", "校准地点"), [profile.laboratory.place_of_work], ""),
        (Words("Adjustment", "调整"), [profile.adjustment.statement], ""),
        (Words("Amendment", "修改说明"), numbering.changes, "basic_revision"),
        (Words("Remarks", "备注"), profile.remarks, ""),
        (
            Words("Left out", "剔除数据"),
            [
                *(f"{item}: {reason} ({person})" for item, reason, person in run.excluded),
                *map(circumstances.describe_left_out, run.left_out),
            ],
            "",
        ),
        (Words("Remarks of the evaluation", "数据处理备注"), [remarks], ""),
    ]


def _statements(certificate: Certificate, notation: Notation) -> _Element:
    """Statements on the whole certificate: validity, draft, traceability, accreditation,
    adjustment, amendment, remarks, conformity.
    """
    return node(
        "dcc:statements",
        *(
            notation.named(
                "dcc:statement",
                name,
                notation.rich("dcc:declaration", texts),
                **({"refType": kind} if kind else {}),
            )
            for name, texts, kind in _list_statements(certificate)
            if xml.non_empty(texts)
        ),
        *(_conformity(statement, notation) for statement in certificate.statements),
    )


def _conformity(statement: ConformityStatement, notation: Notation) -> _Element:
    """A statement of conformity: which result, which limits, which rule, what follows."""
    verdict = Words(statement.verdict)
    if statement.reason.en:
        verdict += Words(": ") + statement.reason
    unit, limits = statement.result.unit, []
    for kind, pair in (
        ("toleranceLimit", (statement.lower, statement.upper)),
        ("acceptanceLimit", statement.acceptance),
    ):
        for end, value in zip(("minimum", "maximum"), pair, strict=True):
            if value is not None:
                types = f"math_{end} calibkit_{kind}"
                limits.append(dcc_results.typed("dcc:quantity", value, unit, notation, types))
    return notation.named(
        "dcc:statement",
        " ".join(filter(None, (statement.name, statement.source))) or "specification",
        node("dcc:norm", f"decision rule: {statement.rule}"),
        node("dcc:reference", xml.one_line(statement.result.key)),
        notation.rich("dcc:declaration", [verdict]),
        optional("dcc:conformity", CONFORMITY.get(statement.verdict, "")),
        node("dcc:data", *limits),
        refType="basic_conformity",
        refId=statement.result.key,
    )


def optional(name: str, value: str) -> _Element | None:
    """Element with a text on one line; None where the text is empty."""
    return node(name, xml.one_line(value)) if value.strip() else None
