"""The certificate as a record: everything that PDF and DCC state, made from a run, a profile, a
validation and a date.
"""

import datetime as dt
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from calibkit.certificate import checklist, conformity, uncertainty
from calibkit.certificate.accreditation import Scope
from calibkit.certificate.names import name_criterion, name_result
from calibkit.certificate.profile import Profile
from calibkit.certificate.results import Block, Result
from calibkit.certificate.run_files import AsFoundAsLeft, RunFacts, RunFiles
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.recipe import Recipe, type_b
from calibkit.records import sensitivities
from calibkit.records.new_files import RUN_FILE
from calibkit.records.run_document import Verdict

TITLE = Words("Calibration certificate")
Relationship = Literal["source", "data", "alternative", "supplement"]
JSON = "application/json"
VERDICTS: dict[Verdict, Words] = {
    "accepted": Words("accepted, the acceptance limits are met"),
    "rejected": Words("rejected, an acceptance limit is not met"),
    "no verdict": Words("no verdict, the recipe sets no acceptance limits"),
}
SENSITIVITIES = "sensitivities"
"""Key of run.json that runs of before do not have."""
VALIDATION, PROFILE = "validation.json", "profile.toml"
"""Names of two attached files."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What a certificate needs to know of an instrument: the blocks of its results, and the recipe
    of the run.
    """

    blocks: Callable[[Stated], tuple[Block, ...]]
    recipe: Recipe


LayoutOf: TypeAlias = "Callable[[Mapping[str, Any]], Layout]"
"""Layout for a run, by its run.json."""


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file inside the certificate, with its relationship to it (PDF/A-3 AFRelationship) and its
    digest.
    """

    name: str
    content: bytes
    media_type: str
    relationship: Relationship
    description: str

    @property
    def sha256(self) -> str:
        """Digest of the file's bytes."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that a certificate states, in no language and no file format."""

    title: Words
    profile: Profile
    issued: dt.date
    run: RunFacts
    blocks: tuple[Block, ...]
    statements: tuple[conformity.ConformityStatement, ...]
    as_found: AsFoundAsLeft | None
    attachments: tuple[Attachment, ...]
    unused_terms: tuple[str, ...]
    """Type B terms that entered no result."""
    missing: tuple[checklist.Missing, ...]

    @property
    def rejection(self) -> Words:
        """Statement on a run that failed its acceptance limits; empty for another."""
        if self.run.verdict != "rejected":
            return Words("")
        failed = [name_criterion(c.name) for c in self.run.criteria if not c.passed]
        limits = Words(", ").join(failed or [Words.literal("acceptance")])
        return Words("The run failed its acceptance limits: {limits}", limits=limits)

    @property
    def verdict(self) -> Words:
        """Verdict on the acceptance limits of the run's recipe, in three values."""
        return Words("Verdict on the run: {verdict}", verdict=VERDICTS[self.run.verdict])

    @property
    def without_type_b(self) -> Words:
        """Which principal results have no type B contribution, and the laboratory's reason."""
        reason = self.profile.type_b_none.reason.strip()
        result_names = [name_result(result) for result in checklist.fits_alone(self.results)]
        if not (reason and result_names):
            return Words("")
        distinct_names = {name.en: name for name in result_names}.values()
        results = Words("; ").join(distinct_names)
        return Words(
            "No type B contribution to {results}: {reason}", results=results, reason=reason
        )

    @property
    def draft(self) -> bool:
        """Whether anything is missing."""
        return bool(self.missing)

    @property
    def results(self) -> tuple[Result, ...]:
        """Every result in the order of printing."""
        return tuple(result for block in self.blocks for result in block.results)


def build(
    run: RunFiles,
    layout_of: LayoutOf,
    profile: Profile,
    profile_text: str,
    as_found: AsFoundAsLeft | None,
    issued: dt.date,
) -> Certificate:
    """Certificate of a run; RecipeError for a profile that does not fit it or the date of issue."""
    _require_order(profile, issued)
    layout = layout_of(run.document)
    terms = uncertainty.TypeBTerms.merge(
        type_b.loads(run.document.get("type_b", ())), profile.terms
    )
    basis = Stated(
        run.records,
        terms,
        tuple(sorted(set(profile.results.temperatures_degc))),
        layout.recipe.reference_temp_degc,
        sensitivities.loads(run.document.get(SENSITIVITIES, []), RUN_FILE),
        Scope(profile.cmc, bool(profile.accreditation.number.strip())),
    )
    blocks = layout.blocks(basis)
    results = [result for block in blocks for result in block.results]
    used_terms = {part.name.en for result in results for part in result.contributions}
    title, validated = profile.certificate.title, as_found is not None
    return Certificate(
        title=Words.literal(title) if title else TITLE,
        profile=profile,
        issued=issued,
        run=run.facts(),
        blocks=blocks,
        statements=conformity.judge_results(
            profile.specification, results, profile.results.decision_rule
        ),
        as_found=as_found,
        attachments=_attachments(run, as_found, profile_text),
        unused_terms=tuple(term.name for term in terms.terms if term.name not in used_terms),
        missing=checklist.list_missing(
            *(profile, results, issued), validated=validated, shifted=SENSITIVITIES in run.document
        ),
    )


def _require_order(profile: Profile, issued: dt.date) -> None:
    """Raise RecipeError for an amendment that is older than what it amends."""
    former = profile.certificate.amends_issued
    if former is not None and former > issued:
        raise RecipeError(
            f"certificate.amends_issued: {former} is later than the date of issue {issued}",
            hint="state when the amended certificate was issued, or give the right --date",
            at=("certificate", "amends_issued"),
        )


def _attachments(
    run: RunFiles, as_found: AsFoundAsLeft | None, profile_text: str
) -> tuple[Attachment, ...]:
    """The files that the certificate is made from: coefficient files, run.json, the validation, the
    profile.
    """
    files = [
        Attachment(name, run.contents[name], JSON, "data", f"coefficient file {name}")
        for name in sorted({entry["name"] for entry in run.document["files"]} & run.records.keys())
    ]
    sources = "recipe, logs and software of the run"
    files.append(Attachment(RUN_FILE, run.contents[RUN_FILE], JSON, "source", sources))
    if as_found is not None:
        description = "as-found and as-left results"
        files.append(Attachment(VALIDATION, as_found.text.encode(), JSON, "data", description))
    if profile_text:
        content, description = profile_text.encode(), "laboratory profile"
        files.append(Attachment(PROFILE, content, "application/toml", "source", description))
    return tuple(files)
