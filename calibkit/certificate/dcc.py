"""The certificate as a digital calibration certificate: DCC 3.3.0 of the PTB with quantities of
D-SI 2.2.1, as the templates dcc.xml.j2 and dcc_results.xml.j2 read.

It holds what the PDF holds, and besides every parameter with its covariance and the coefficient
files themselves. What the schema requires and nobody has stated is given as "not stated", a country
as ZZ, a date of work as 0001-01-01, and the certificate is a DRAFT.
"""

from __future__ import annotations

import base64
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from calibkit.certificate import circumstances, dcc_results, dcc_xml, names
from calibkit.certificate.content import Attachment, Relationship
from calibkit.certificate.dcc_results import Notation
from calibkit.certificate.words import HEADINGS, SENTENCES, Words
from calibkit.libraries.templates import read_templates
from calibkit.numeric import gum
from calibkit.records import coefficients
from calibkit.records.new_files import RUN_FILE
from calibkit.records.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    import jinja2

    from calibkit.certificate.conformity import ConformityStatement
    from calibkit.certificate.content import Certificate
    from calibkit.certificate.profile import Standard
    from calibkit.certificate.words import Lang

    _Stated: TypeAlias = tuple[Words, Sequence[Words | str], str]

FILE = "dcc.xml"
RELEASE = f"v{__version__}"
CERTIFICATE = Words("calibration certificate")
DESCRIBED: tuple[str, Relationship, str] = (
    "application/xml",
    "alternative",
    f"digital calibration certificate, DCC {dcc_xml.VERSION}",
)
"""Media type, what the file is to the PDF, and what it is called there."""
VERDICTS = {
    "pass": "pass",
    "fail": "fail",
    "conditional pass": "conditionalPass",
    "conditional fail": "conditionalFail",
}
"""Verdict → its name in the schema, which has none for a statement that is not possible."""
PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Places of work that the schema knows; any other text stands in a statement."""
REF_TYPES = {
    "calibkit_toleranceLimit": Words.literal("limit of a specification that a result is judged by"),
    "calibkit_acceptanceLimit": Words.literal(
        "limit that the decision rule derives from a tolerance limit"
    ),
    "calibkit_asFound": Words.literal("result before the correction that the certificate states"),
    "calibkit_asLeft": Words.literal("result after the correction that the certificate states"),
    "calibkit_expandedUncertainty": Words.literal("largest expanded uncertainty of a standard"),
    "calibkit_range": Words.literal("range of a standard"),
}
"""Types that the published databases lack."""


def attach_dcc(certificate: Certificate, lang: Lang, schema_dir: Path | None = None) -> Attachment:
    """The DCC as a file of the certificate, validated against the schema where a folder has it."""
    document = render(certificate, lang)
    if schema_dir is not None:
        dcc_xml.read(document, schema_dir)
    return Attachment(FILE, document, *DESCRIBED)


def render(certificate: Certificate, lang: Lang) -> bytes:
    """XML of a certificate, the same bytes for the same certificate."""
    run, profile = certificate.run, certificate.profile
    dates, place = profile.dates, profile.laboratory.place_of_work.strip()
    gravity = (c.value for c in run.conditions if c.name == "local_gravity")
    notation = Notation(
        lang,
        next(gravity, profile.conditions.local_gravity_mps2),
        bool(profile.accreditation.number.strip()),
    )
    equipment = (f"measuringEquipment{k + 1}" for k in range(len(profile.standard)))
    text = (
        templates()
        .get_template("dcc.xml.j2")
        .render(
            **wording(notation),
            certificate=certificate,
            run=run,
            profile=profile,
            languages=dcc_results.LANGUAGES[lang],
            place=place if place in PLACES else "laboratory",
            used=dates.performed_until or dates.performed,
            refers_to=" ".join(["item1", *equipment]),
            attachments={a.name: a for a in certificate.attachments},
            statements=_list_statements(certificate),
            condition_texts=_list_conditions(certificate),
            method_facts=[
                label + Words(": ") + Words.literal(text)
                for label, text in circumstances.list_method(profile)
                if text.strip()
            ],
            recipe=Words(
                "Recipe {recipe}, digest of its text and of what --set changed (field"
                " recipe.sha256 of run.json): {sha256}",
                recipe=run.recipe,
                sha256=run.recipe_sha256,
            ),
        )
    )
    return dcc_xml.finish(text)


def wording(notation: Notation) -> dict[str, Any]:
    """What the template needs of every certificate."""
    return {
        "notation": notation,
        "version": dcc_xml.VERSION,
        "release": RELEASE,
        "ref_types": REF_TYPES,
        "verdicts": VERDICTS,
        "headings": HEADINGS,
        "region": dcc_results.REGION,
        "two_sigma": gum.TWO_SIGMA,
        "not_stated": dcc_xml.NOT_STATED,
        # user-assigned code of ISO 3166-1 that stands for an unknown country
        "no_country": "ZZ",
        "no_date": "0001-01-01",
        "certificate_name": CERTIFICATE,
        "previous_name": Words("calibration certificate before this one"),
        "serial_number": Words("serial number"),
        "order_name": Words("order"),
        "identification_name": Words("identification"),
    }


@cache
def templates() -> jinja2.Environment:
    """Templates of a certificate and of its results, with their filters."""
    environment = read_templates(Path(__file__).parent, escaped=True)
    environment.filters.update(
        {
            "base64": lambda content: base64.b64encode(content).decode(),
            "columns": dcc_results.split_columns,
            "condition_name": names.name_condition,
            "covariance_columns": dcc_results.covariance_columns,
            "dsi_unit": lambda unit, notation: notation.unit(unit),
            "share": dcc_results.spell_share,
            "file_name": lambda a: Words("Coefficient file {name}", name=a.name),
            "label": dcc_results.spell_label,
            "model_name": dcc_results.name_model,
            "model_notes": dcc_results.model_notes,
            "notes": dcc_results.table_notes,
            "number": dcc_results.spell_number,
            "one_line": dcc_xml.one_line,
            "own_unit": lambda standard: f"{standard.expanded_uncertainty!r} {standard.unit}",
            "parameter_key": dcc_results.parameter_key,
            "record": lambda a: coefficients.loads(a.content.decode("utf-8"), a.name),
            "region_factor": dcc_results.region_factor,
            "result_name": dcc_results.name_result,
            "row_name": dcc_results.name_row,
            "standard_facts": _describe_standard,
            "stated": dcc_results.stated,
            "states": dcc_results.split_states,
            "verdict": _state_verdict,
        }
    )
    return environment


def _describe_standard(standard: Standard) -> str:
    """Who calibrated a standard, when, and how long that holds."""
    facts = (
        ("calibrated by", standard.laboratory),
        ("on", standard.date),
        ("valid until", standard.valid_until),
    )
    return ", ".join(f"{word} {value}" for word, value in facts if value)


def _list_conditions(certificate: Certificate) -> list[tuple[Words, str]]:
    """Conditions of the laboratory in words; "not stated" where there are none of any kind."""
    others = certificate.profile.conditions.others
    texts = circumstances.list_conditions(certificate.profile)
    texts += [(Words("Further conditions"), text) for text in others]
    stated = [(words, text) for words, text in texts if text.strip()]
    if not stated and not certificate.run.conditions:
        return [(HEADINGS["conditions"], dcc_xml.NOT_STATED)]
    return stated


def _list_statements(certificate: Certificate) -> list[_Stated]:
    """Statements on the whole certificate: what they are called, their texts, their refType."""
    profile, run = certificate.profile, certificate.run
    numbering = profile.certificate
    missing = Words("DRAFT: not a calibration certificate; missing")
    remarks = circumstances.describe_remarks(len(run.flags), RUN_FILE)
    return [
        (Words("Validity"), [SENTENCES["only_item"]], ""),
        (missing, [Words.literal(f"{m.key}: ") + m.description for m in certificate.missing], ""),
        (
            Words("Traceability"),
            [numbering.traceability or SENTENCES["traceability"]] if profile.standard else [],
            "basic_metrologicallyTraceableToSI",
        ),
        (
            Words("Accreditation"),
            circumstances.describe_accreditation(certificate),
            "basic_isInCMC",
        ),
        (
            Words("Reproduction"),
            [numbering.reproduction or SENTENCES["reproduction"]],
            "",
        ),
        (Words("Place of work"), [profile.laboratory.place_of_work], ""),
        (Words("Adjustment"), [profile.adjustment.statement], ""),
        (Words("Amendment"), numbering.changes, "basic_revision"),
        (Words("Remarks"), profile.remarks, ""),
        (
            Words("Left out"),
            [
                *(f"{item}: {reason} ({person})" for item, reason, person in run.excluded),
                *map(circumstances.describe_left_out, run.left_out),
            ],
            "",
        ),
        (Words("Remarks of the evaluation"), [remarks], ""),
    ]


def _state_verdict(statement: ConformityStatement) -> Words:
    """Verdict of a statement of conformity, with its reason."""
    verdict = Words.literal(statement.verdict)
    return verdict + Words.literal(": ") + statement.reason if statement.reason.en else verdict
