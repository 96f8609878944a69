"""What a calibration certificate must state (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), and which of
that is missing.
"""

import datetime as dt
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from calibkit.certificate.profile import Profile, Standard
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


MOST_LISTED = 4
"""Results that one missing item names."""


@dataclass(frozen=True, slots=True)
class Missing:
    """One item that the certificate lacks: the key that would state it, and what it is."""

    key: str
    description: Words


Check: TypeAlias = tuple[bool, str, Words]
"""Whether something is missing, the key that would state it, and what it is."""


def list_missing(
    profile: Profile,
    results: Sequence[Result],
    issued: dt.date,
    *,
    validated: bool,
    shifted: bool = True,
) -> tuple[Missing, ...]:
    """Every item that keeps a certificate a DRAFT; `shifted` is whether the run knows what errors
    of the inputs do to its results, which runs that were fitted before do not.
    """
    checks: list[Check] = []
    for key, description in FIELDS.items():
        table, _, name = key.partition(".")
        value = getattr(getattr(profile, table), name)
        checks.append((value is None or not str(value).strip(), key, description))
    performed = profile.dates.performed_until or profile.dates.performed
    checks.append((not profile.standard, "standard", Words("traceability: reference standards")))
    for standard in profile.standard:
        checks += _check_standard(standard, performed)
    kinds = [*dict.fromkeys(result.quantity for result in fits_alone(results))]
    more = f" and {len(kinds) - MOST_LISTED} more" if len(kinds) > MOST_LISTED else ""
    is_accredited = bool(profile.accreditation.number.strip())
    is_outside = all(result.outside_scope for result in results)
    amends, changes = profile.certificate.amends, profile.certificate.changes
    checks += [
        (
            bool(kinds) and not profile.type_b_none.reason.strip(),
            "type_b",
            Words(
                "type B contribution ([[type_b]]), or type_b_none.reason, of {names}",
                names=", ".join(kinds[:MOST_LISTED]) + more,
            ),
        ),
        (
            is_accredited and not profile.accreditation.body.strip(),
            "accreditation.body",
            Words("accreditation body"),
        ),
        (
            is_accredited and is_outside,
            "cmc",
            Words("a result in the scope of the accreditation ([[cmc]])"),
        ),
    ]
    for standard in profile.standard if is_accredited else ():
        of_standard = Words(" of the standard '{name}'", name=standard.name)
        checks += [
            (not standard.range, "standard.range", Words("range") + of_standard),
            (
                not standard.expanded_uncertainty,
                "standard.expanded_uncertainty",
                Words("expanded uncertainty") + of_standard,
            ),
        ]
    checks += [
        (
            not shifted,
            "sensitivities",
            Words(
                "run.json knows no sensitivities to errors of the inputs: fit again with this"
                " calibkit"
            ),
        ),
        (
            performed is not None and performed > issued,
            "dates.performed",
            Words(
                "the work of {performed} is later than the date of issue {issued}",
                performed=performed,
                issued=issued,
            ),
        ),
        (
            bool(amends) and not any(change.strip() for change in changes),
            "certificate.changes",
            Words("what the amendment changes"),
        ),
        (
            not validated and not profile.adjustment.statement.strip(),
            "adjustment.statement",
            Words("as-found and as-left results (--validation), or adjustment.statement"),
        ),
    ]
    return tuple(Missing(key, description) for missing, key, description in checks if missing)


def _check_standard(standard: Standard, performed: dt.date | None) -> list[Check]:
    """Certificate, date and laboratory of a standard, which was valid when it was used."""
    name, calibrated, valid_until = standard.name, standard.date, standard.valid_until
    checks = [
        (
            not getattr(standard, key),
            f"standard.{key}",
            Words("{key} of the standard '{name}'", key=key, name=name),
        )
        for key in ("certificate", "date", "laboratory")
    ]
    return [
        *checks,
        (
            valid_until is not None and performed is not None and valid_until < performed,
            "standard.valid_until",
            Words(
                "the standard '{name}' was valid until {valid_until}",
                name=name,
                valid_until=valid_until,
            ),
        ),
        (
            calibrated is not None and performed is not None and calibrated > performed,
            "standard.date",
            Words(
                "the standard '{name}' was calibrated on {date}, after the work",
                name=name,
                date=calibrated,
            ),
        ),
    ]


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
