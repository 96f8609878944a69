"""The laboratory profile: what a certificate states that no log contains. Strict TOML; what is
absent makes a DRAFT.

The same file may serve many certificates: what changes from one to the next is given with --set
table.key=value.
"""

import datetime as dt
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from calibkit.errors import RecipeError
from calibkit.recipe import TypeB, loader, toml_text
from calibkit.recipe.strict import Positive, Table

Rule = Literal["guarded", "simple", "four_way"]
Many = Field(strict=False)
SHA256 = r"^([0-9a-f]{64})?$"
OVERRIDE = "# --set "
"""What a line of an attached text begins with that states an override."""


def _as_date(value: object) -> object:
    """A date that was written as text."""
    if isinstance(value, str):
        try:
            return dt.date.fromisoformat(value)
        except ValueError:
            raise ValueError(f"'{value}' is not a date; write 2026-11-21") from None
    return value


class Party(Table):
    """A laboratory or a customer: who, where, how to reach; the country is a code of two letters
    (ISO 3166-1).
    """

    #: Name.
    name: str = ""
    #: Street and town.
    address: str = ""
    #: Code of two letters (ISO 3166-1).
    country: Annotated[str, Field(pattern=r"^([A-Z]{2})?$")] = ""
    #: Address for electronic mail.
    email: str = ""
    #: Telephone number.
    phone: str = ""


class Laboratory(Party):
    """The laboratory, the place where the work was done, and its code at the accreditation body."""

    #: Code at the accreditation body or in the house.
    code: str = ""
    #: Where the work was done.
    place_of_work: str = ""


class _Accreditation(Table):
    """Who accredited the laboratory under which number, and its mark: an SVG or PNG file, relative
    to the profile. What is in the scope is stated by [[cmc]].
    """

    #: Accreditation body.
    body: str = ""
    #: Number of the accreditation.
    number: str = ""
    #: Mark as an SVG or PNG file, relative to the profile.
    mark: str = ""

    @model_validator(mode="after")
    def _numbered(self) -> Self:
        if (self.body or self.mark) and not self.number.strip():
            raise ValueError("a body or a mark of accreditation needs the number")
        return self


class Capability(Table):
    """Smallest expanded uncertainty (CMC) that the laboratory is accredited for, of results by
    their keys, with * for any part of them; in the unit of the result, or a share of it.
    """

    #: Key of the results, with * for any part of it.
    result: Annotated[str, Field(min_length=1)]
    #: Unit of the result, or ppm or % of it.
    unit: Annotated[str, Field(min_length=1)]
    #: Smallest expanded uncertainty of the scope.
    expanded_uncertainty: Positive


class _Numbering(Table):
    """The certificate's own number; of an amendment, which certificate it replaces and what
    changed.
    """

    #: Number of the certificate.
    number: str = ""
    #: Title in place of the usual one.
    title: str = ""
    #: Number of the customer's order.
    order: str = ""
    #: Sentence in place of the usual one on traceability.
    traceability: str = ""
    #: Clause in place of the usual one on reproduction.
    reproduction: str = ""
    #: The item's certificate before this one.
    previous: str = ""
    #: Digest of the file of that certificate.
    previous_sha256: Annotated[str, Field(pattern=SHA256)] = ""
    #: Certificate that this one replaces.
    amends: str = ""
    #: Date of issue of that certificate.
    amends_issued: dt.date | None = None
    #: What changed against it.
    changes: Annotated[tuple[str, ...], Many] = ()
    #: Font files for scripts that the built-in fonts lack, relative to the profile.
    fonts: Annotated[tuple[str, ...], Many] = ()

    _dates = field_validator("amends_issued", mode="before")(_as_date)

    @model_validator(mode="after")
    def _another_number(self) -> Self:
        if self.amends and self.amends == self.number:
            raise ValueError(f"an amendment of {self.amends} needs a number of its own")
        if bool(self.previous.strip()) != bool(self.previous_sha256):
            raise ValueError("previous and previous_sha256, the digest of its file, go together")
        if self.amends_issued is not None and not self.amends.strip():
            raise ValueError(
                f"amends_issued = {self.amends_issued}, but amends names no certificate"
            )
        return self


class _Item(Table):
    """The calibrated item; its serial number is the run's."""

    #: Kind of instrument.
    type: str = ""
    #: Manufacturer.
    maker: str = ""
    #: Model.
    model: str = ""
    #: Further identification.
    identification: str = ""
    #: Condition on receipt.
    condition: str = ""


class _Dates(Table):
    """When the item came, and when the work was done."""

    #: Date of receipt.
    received: dt.date | None = None
    #: First day of the work.
    performed: dt.date | None = None
    #: Last day of the work.
    performed_until: dt.date | None = None

    _dates = field_validator("received", "performed", "performed_until", mode="before")(_as_date)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        dates = [
            date
            for date in (self.received, self.performed, self.performed_until)
            if date is not None
        ]
        if dates != sorted(dates):
            raise ValueError("received, performed and performed_until are out of order")
        return self


class _Method(Table):
    """The procedure with its revision; deviations and external providers have to be stated, if
    only as "none".
    """

    #: Procedure.
    name: str = ""
    #: Its revision.
    revision: str = ""
    #: Deviations from it; "none" is an answer.
    deviations: str = ""
    #: Work of others; "none" is an answer.
    external_providers: str = ""


class _LabConditions(Table):
    """What may have influenced the results."""

    #: Temperatures and times of the chamber.
    chamber: str = ""
    #: Temperature of the laboratory.
    laboratory_temperature: str = ""
    #: Local gravity, in words.
    local_gravity: str = ""
    #: Local gravity as a number, by which the DCC states values in g.
    local_gravity_mps2: Annotated[float, Field(gt=9.7, lt=9.9)] | None = None
    #: Latitude, in words.
    latitude: str = ""
    #: What was done with the earth's rate.
    earth_rate: str = ""
    #: Supply of the instrument.
    supply: str = ""
    #: Warm-up time.
    warm_up: str = ""
    #: Further conditions.
    others: Annotated[tuple[str, ...], Many] = ()


class Standard(Table):
    """A reference standard or measuring equipment that makes the results traceable."""

    #: Name of the standard.
    name: str = ""
    #: Refused; only in attached profiles of 0.2.
    dcc: str = ""
    #: Refused; only in attached profiles of 0.2.
    result: str = ""
    #: Serial number.
    serial: str = ""
    #: Number of its certificate.
    certificate: str = ""
    #: Digest of the certificate's file.
    sha256: Annotated[str, Field(pattern=SHA256)] = ""
    #: Date of the certificate.
    date: dt.date | None = None
    #: End of its validity.
    valid_until: dt.date | None = None
    #: Who issued it.
    laboratory: str = ""
    #: Range it was calibrated in.
    range: str = ""
    #: Expanded uncertainty of the standard.
    expanded_uncertainty: Positive | None = None
    #: Coverage factor of that.
    coverage_factor: Annotated[float, Field(ge=1.0)] = 2.0
    #: Unit of that.
    unit: str = ""
    #: Input whose error it is: U is then a type B term.
    quantity: str = ""

    _dates = field_validator("date", "valid_until", mode="before")(_as_date)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.dcc and self.expanded_uncertainty is None:
            return self  # `load` refuses it, whatever else is missing
        if not self.name.strip():
            raise ValueError("a standard needs a name")
        if self.expanded_uncertainty is not None and not self.unit.strip():
            raise ValueError(f"'{self.name}': an expanded_uncertainty needs its unit")
        if self.quantity and self.expanded_uncertainty is None:
            raise ValueError(f"'{self.name}': its quantity needs an expanded_uncertainty")
        _ = self.terms
        return self

    @property
    def terms(self) -> tuple[TypeB, ...]:
        """What it contributes to the uncertainty of results; ValueError for a unit that its
        quantity cannot have.
        """
        if not self.quantity:
            return ()
        term_fields = {
            "name": ", ".join(filter(None, (self.name, self.certificate))),
            "quantity": self.quantity,
            "unit": self.unit,
            "expanded_uncertainty": self.expanded_uncertainty,
            "coverage_factor": self.coverage_factor,
        }
        try:
            return (TypeB.model_validate(term_fields),)
        except ValidationError as error:
            raise ValueError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None


class _Person(Table):
    """Who calibrated, checked or authorised."""

    #: Name.
    name: str = ""
    #: Function.
    role: str = ""
    #: Address for electronic mail.
    email: str = ""


class _Adjustment(Table):
    """Statement on adjustments, where no validation gives as-found and as-left results."""

    #: Sentence on adjustments, where there is no validation.
    statement: str = ""


class _TypeBNone(Table):
    """Why principal results have no type B contribution, where there is none to state."""

    #: Why principal results have no type B contribution.
    reason: str = ""


class _Results(Table):
    """At which temperatures values are stated, and the decision rule where a specification names
    none.
    """

    #: Temperatures at which values are stated; without them round ones of the range.
    temperatures_degc: Annotated[tuple[float, ...], Many] = ()
    #: Decision rule where a specification names none.
    decision_rule: Rule = "guarded"


class Specification(Table):
    """A limit that results are judged by; `result` is a result's key, with * for any part of
    it.
    """

    #: Key of the results, with * for any part of it.
    result: Annotated[str, Field(min_length=1)]
    #: Unit of the limits.
    unit: Annotated[str, Field(min_length=1)]
    #: Name of the specification.
    name: str = ""
    #: Where it stands.
    source: str = ""
    #: Lower limit.
    lower: float | None = None
    #: Upper limit.
    upper: float | None = None
    #: Decision rule of this one.
    rule: Rule | None = None

    @model_validator(mode="after")
    def _has_limits(self) -> Self:
        if self.lower is None and self.upper is None:
            raise ValueError(f"'{self.result}' has neither a lower nor an upper limit")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(
                f"'{self.result}': lower = {self.lower:g} is not below upper = {self.upper:g}"
            )
        return self


class Profile(Table):
    """Everything that a laboratory states on a certificate; a key that is absent is empty."""

    certificate: _Numbering = _Numbering()
    laboratory: Laboratory = Laboratory()
    accreditation: _Accreditation = _Accreditation()
    cmc: Annotated[tuple[Capability, ...], Many] = ()
    customer: Party = Party()
    item: _Item = _Item()
    dates: _Dates = _Dates()
    method: _Method = _Method()
    conditions: _LabConditions = _LabConditions()
    standard: Annotated[tuple[Standard, ...], Many] = ()
    calibrated_by: _Person = _Person()
    checked_by: _Person = _Person()
    authorised_by: _Person = _Person()
    adjustment: _Adjustment = _Adjustment()
    results: _Results = _Results()
    specification: Annotated[tuple[Specification, ...], Many] = ()
    type_b: Annotated[tuple[TypeB, ...], Many] = ()
    type_b_none: _TypeBNone = _TypeBNone()
    #: Sentences at the end of the certificate.
    remarks: Annotated[tuple[str, ...], Many] = ()

    @property
    def terms(self) -> tuple[TypeB, ...]:
        """Type B terms: those of [[type_b]], and those of standards that state their quantity."""
        return (*self.type_b, *(term for standard in self.standard for term in standard.terms))


def read_source(path: Path | None, overrides: tuple[str, ...] = ()) -> loader.Source:
    """Text of a profile with its overrides, empty for none; RecipeError where it cannot be read."""
    if path is None:
        return loader.Source("profile", "", overrides)
    return loader.Source(path.name, loader.read_utf8(path, "name a profile"), overrides)


def load(path: Path | None, overrides: tuple[str, ...] = ()) -> tuple[Profile, str]:
    """Profile and what is attached of it, its keys with the overrides and without comments, or an
    empty one; RecipeError with every fault, one per line.
    """
    source = read_source(path, overrides)
    profile = source.table(Profile)
    with source.placing():
        for number, standard in enumerate(profile.standard):
            if standard.dcc or standard.result:
                raise RecipeError(
                    "[[standard]] dcc: the certificate of a standard is not read",
                    hint="state its certificate (number), date, expanded_uncertainty, unit and"
                    " coverage_factor here, and leave out dcc and result",
                    at=("standard", number, "dcc" if standard.dcc else "result"),
                )
    return profile, "" if path is None and not overrides else dumps(profile)


def dumps(profile: Profile) -> str:
    """TOML of what a profile states, without comments; `parse` gives the same profile."""
    return toml_text.from_tables(profile.model_dump(exclude_defaults=True)).text


def parse(text: str, name: str) -> Profile:
    """Profile of an attached text, of releases before with comments and overrides; RecipeError with
    every fault, one per line.
    """
    lines = text.splitlines(keepends=True)
    first = len(lines)
    while first and lines[first - 1].startswith(OVERRIDE):
        first -= 1
    overrides = tuple(line.removeprefix(OVERRIDE).rstrip("\n") for line in lines[first:])
    return loader.Source(name, "".join(lines[:first]), overrides).table(Profile)
