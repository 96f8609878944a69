"""What a calibration certificate must state (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), and which of
that is missing.
"""

import datetime as dt
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from calibkit.certificate.profile import Profile
from calibkit.certificate.results import Result
from calibkit.certificate.words import Words

# where it is stated → what it is called
FIELDS: dict[str, Words] = {
    "certificate.number": Words("certificate number"),
    "laboratory.name": Words("laboratory name"),
    "laboratory.address": Words("laboratory address"),
    "laboratory.place_of_work": Words("place of work"),
    "customer.name": Words("customer"),
    "customer.address": Words("customer address"),
    "item.type": Words("item"),
    "item.maker": Words("maker"),
    "item.model": Words("model"),
    "item.condition": Words("condition of the item"),
    "dates.performed": Words("date of calibration"),
    "method.name": Words("method"),
    "method.revision": Words("revision of the method"),
    "method.deviations": Words("deviations from the method"),
    "method.external_providers": Words("parts from external providers"),
    "conditions.chamber": Words("chamber set points and holds"),
    "conditions.laboratory_temperature": Words("laboratory temperature"),
    "conditions.local_gravity": Words("local gravity"),
    "conditions.latitude": Words("latitude"),
    "conditions.earth_rate": Words("handling of the earth's rate"),
    "conditions.supply": Words("supply"),
    "conditions.warm_up": Words("warm-up"),
    "authorised_by.name": Words("authorised by"),
    "authorised_by.role": Words("role"),
}


STATED_OF_STANDARDS = {
    "range": Words("range"),
    "expanded_uncertainty": Words("expanded uncertainty"),
}
"""Keys of a standard that an accredited laboratory states."""
MOST_LISTED = 4
"""Results that one missing item names."""


@dataclass(frozen=True, slots=True)
class Missing:
    """One item that the certificate lacks: the key that would state it, and what it is."""

    key: str
    description: Words


NO_SENSITIVITIES = Missing(
    "sensitivities",
    Words("run.json knows no sensitivities to errors of the inputs: fit again with this calibkit"),
)
"""What is missing of a run that was fitted before sensitivities were computed."""


def list_missing(
    profile: Profile,
    results: Sequence[Result],
    issued: dt.date,
    *,
    validated: bool,
    shifted: bool = True,
) -> tuple[Missing, ...]:
    """Every item that keeps a certificate a DRAFT; `shifted` is whether the run knows what errors
    of the inputs do to its results.
    """
    return (
        *_fields(profile),
        *_traceability(profile),
        *_influences(profile, results),
        *_accreditation(profile, results),
        *(() if shifted else (NO_SENSITIVITIES,)),
        *_consistency(profile, issued, validated=validated),
    )


def fits_alone(results: Iterable[Result]) -> list[Result]:
    """Principal results whose uncertainty is that of the fit alone: no type B contribution."""
    return [
        result
        for result in results
        if result.principal
        and not result.by_definition
        and (
            result.uncertainty is None
            or all(part.kind != "B" for part in result.uncertainty.contributions)
        )
    ]


def _influences(profile: Profile, results: Sequence[Result]) -> Iterator[Missing]:
    """Principal results without a type B contribution, unless the profile states why."""
    if profile.type_b_none.reason.strip():
        return
    kinds = dict.fromkeys(result.quantity for result in fits_alone(results))
    if kinds:
        names = ", ".join(list(kinds)[:MOST_LISTED])
        unlisted_count = len(kinds) - MOST_LISTED
        names += f" and {unlisted_count} more" if unlisted_count > 0 else ""
        description = Words(
            "type B contribution ([[type_b]]), or type_b_none.reason, of {names}", names=names
        )
        yield Missing("type_b", description)


def _accreditation(profile: Profile, results: Sequence[Result]) -> Iterator[Missing]:
    """What an accredited laboratory states besides: who accredited it, a result in its scope, range
    and U of each standard.
    """
    if not profile.accreditation.number.strip():
        return
    if not profile.accreditation.body.strip():
        yield Missing("accreditation.body", Words("accreditation body"))
    if all(result.outside_scope for result in results):
        description = Words("a result in the scope of the accreditation ([[cmc]])")
        yield Missing("cmc", description)
    for standard in profile.standard:
        for name, words in STATED_OF_STANDARDS.items():
            if not getattr(standard, name):
                description = words + Words(" of the standard '{name}'", name=standard.name)
                yield Missing(f"standard.{name}", description)


def _fields(profile: Profile) -> Iterator[Missing]:
    """Plain fields that are empty."""
    for key, description in FIELDS.items():
        table, _, name = key.partition(".")
        value = getattr(getattr(profile, table), name)
        if value is None or not str(value).strip():
            yield Missing(key, description)


def _traceability(profile: Profile) -> Iterator[Missing]:
    """Standards, each with certificate, date and laboratory, and valid when they were used."""
    if not profile.standard:
        yield Missing("standard", Words("traceability: reference standards"))
    used = profile.dates.performed_until or profile.dates.performed
    for standard in profile.standard:
        for name in ("certificate", "date", "laboratory"):
            if not getattr(standard, name):
                description = Words("{key} of the standard '{name}'", key=name, name=standard.name)
                yield Missing(f"standard.{name}", description)
        if standard.valid_until is not None and used is not None and standard.valid_until < used:
            description = Words(
                "the standard '{name}' was valid until {valid_until}",
                name=standard.name,
                valid_until=standard.valid_until,
            )
            yield Missing("standard.valid_until", description)
        if standard.date is not None and used is not None and standard.date > used:
            description = Words(
                "the standard '{name}' was calibrated on {date}, after the work",
                name=standard.name,
                date=standard.date,
            )
            yield Missing("standard.date", description)


def _consistency(profile: Profile, issued: dt.date, *, validated: bool) -> Iterator[Missing]:
    """A certificate is not issued before the work is done; an amendment states what it changes; as
    found and as left are stated, or why they are not.
    """
    performed = profile.dates.performed_until or profile.dates.performed
    if performed is not None and performed > issued:
        description = Words(
            "the work of {performed} is later than the date of issue {issued}",
            performed=performed,
            issued=issued,
        )
        yield Missing("dates.performed", description)
    if profile.certificate.amends and not any(
        change.strip() for change in profile.certificate.changes
    ):
        yield Missing("certificate.changes", Words("what the amendment changes"))
    if not validated and not profile.adjustment.statement.strip():
        description = Words("as-found and as-left results (--validation), or adjustment.statement")
        yield Missing("adjustment.statement", description)
