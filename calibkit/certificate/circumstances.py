"""What surrounds the results of a certificate: conditions, standards, accreditation, persons."""

from collections.abc import Iterable
from typing import Any

from calibkit.certificate import names, tables
from calibkit.certificate.content import Certificate
from calibkit.certificate.profile import Profile, Standard
from calibkit.certificate.words import CONDITIONS, SENTENCES, Lang, Words
from calibkit.records.left_out import Cause, Kind, LeftOut
from calibkit.units import unit_mark, with_unit

Rows = list[list[str]]


def in_words(rows: Iterable[tuple[Words, str]], lang: Lang) -> Rows:
    """Rows of a label and a text."""
    return [[label.of(lang), text] for label, text in rows]


def list_given(*rows: tuple[Words, str]) -> list[tuple[Words, str]]:
    """The rows that have a text."""
    return [(label, text) for label, text in rows if text.strip()]


def lay_out_conditions(certificate: Certificate, lang: Lang) -> Rows:
    """Conditions that the profile states, those that the logs measured, and those that the
    coefficient files hold.
    """
    profile, run = certificate.profile, certificate.run
    rows = list_conditions(profile)
    rows += list_given(*((Words(""), text) for text in profile.conditions.others))
    for column, *ends in run.measured:
        label = Words("Measured in the logs: {condition}", condition=names.name_condition(column))
        low, high = (f"{end:.1f} °C".replace("-", "−") for end in ends)
        rows.append((label, f"{low} … {high}"))
    for condition in run.conditions:
        label = Words(
            "In the computation: {condition}", condition=names.name_condition(condition.name)
        )
        unit = unit_mark(condition.unit)
        text = with_unit(tables.format_plain(condition.value, 8), unit)
        if condition.standard_uncertainty > 0.0:
            words = Words("standard uncertainty").of(lang)
            u = with_unit(tables.format_plain(condition.standard_uncertainty, 2), unit)
            text += f" ({words} {u})"
        rows.append((label, text))
    return in_words(rows, lang)


_COUNTED: dict[Kind, Words] = {
    "rows": Words("rows|of a log"),
    "samples": Words("samples"),
    "positions": Words("positions"),
    "stations": Words("stations"),
}
_CAUSES: dict[Cause, Words] = {
    "excluded": Words("excluded for the reason that is stated"),
    "incomplete": Words("excluded because a value that is needed is missing"),
    "missing": Words("not in the log"),
    "outlier": Words("excluded because they differ from the others by far more than noise"),
    "unsolved": Words("excluded because their readings give no result"),
}


def describe_left_out(fact: LeftOut) -> Words:
    """What a fit did not use, in a customer's words."""
    counted, cause = _COUNTED[fact.what], _CAUSES[fact.cause]
    place = names.name_channel(fact.where) if fact.what == "stations" else Words.literal(fact.where)
    return Words(
        "{count} of {total} {counted}{place} {were} {cause}.",
        count=fact.count,
        total=fact.of,
        counted=counted,
        place=Words(" of {place}", place=place) if fact.where else "",
        were="was" if fact.count == 1 else "were",
        cause=cause,
    )


def list_method(profile: Profile) -> list[tuple[Words, str]]:
    """Revision, deviations and external providers of the laboratory's procedure."""
    method = profile.method
    return [
        (Words("Revision"), method.revision),
        (Words("Deviations from the method"), method.deviations),
        (Words("From external providers"), method.external_providers),
    ]


def list_conditions(profile: Profile) -> list[tuple[Words, str]]:
    """Conditions that the profile states, empty ones included."""
    return [(words, getattr(profile.conditions, key)) for key, words in CONDITIONS]


def describe_remarks(count: int, file: str) -> Words:
    """How many remarks of an evaluation there are, and where; empty for none."""
    if not count:
        return Words("")
    return Words(
        "Remarks of the evaluation for the laboratory: {count}, in {file}.", count=count, file=file
    )


def lay_out_traceability(profile: Profile, lang: Lang) -> dict[str, Any]:
    """Standards with their certificates, ranges and expanded uncertainties."""
    heads = [
        Words("Standard"),
        Words("Serial"),
        Words("Range"),
        Words.literal("U"),
        Words("Certificate"),
        Words("Date"),
        Words("Laboratory|of a standard"),
    ]
    valid_until = Words(" (valid until ").of(lang)
    close = Words(")").of(lang)
    rows = []
    for s in profile.standard:
        until = f"{valid_until}{s.valid_until}{close}" if s.valid_until else ""
        date = f"{s.date or ''}{until}"
        rows.append([s.name, s.serial, s.range, _uncertainty(s), s.certificate, date, s.laboratory])
    table = tables.text_table(heads, "lllllll", rows, lang)
    return table | {"text": profile.certificate.traceability or SENTENCES["traceability"].of(lang)}


def _uncertainty(standard: Standard) -> str:
    """Expanded uncertainty of a standard with its coverage factor; empty where none is stated."""
    U = standard.expanded_uncertainty
    if U is None:
        return ""
    number = with_unit(tables.format_exact(U), unit_mark(standard.unit))
    return f"{number} (k = {standard.coverage_factor:g})"


def describe_accreditation(certificate: Certificate) -> list[Words]:
    """By whom the laboratory is accredited, and whether results are not in the scope; nothing where
    it is not accredited.
    """
    accreditation = certificate.profile.accreditation
    if not accreditation.number.strip():
        return []
    accredited = Words(
        "Accredited by {body}, {number}.", body=accreditation.body, number=accreditation.number
    )
    is_outside = any(result.outside_scope for result in certificate.results)
    return [accredited, tables.OUTSIDE] if is_outside else [accredited]


def list_signatories(certificate: Certificate, lang: Lang) -> list[Rows]:
    """Who calibrated, checked and authorised it, as what; the last with the date of issue."""
    profile = certificate.profile
    first_signatories = [
        in_words([(label, person.name), *list_given((Words("Role"), person.role))], lang)
        for label, person in (
            (Words("Calibrated by"), profile.calibrated_by),
            (Words("Checked by"), profile.checked_by),
        )
        if person.name.strip()
    ]
    authorised = profile.authorised_by
    last = [
        (Words("Authorised by"), authorised.name),
        (Words("Role"), authorised.role),
        (Words("Date of issue"), str(certificate.issued)),
    ]
    return [*first_signatories, in_words(last, lang)]
