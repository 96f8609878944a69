"""The certificate as a record: everything that PDF and DCC state, made from a run, a profile, a
validation and a date.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from calibkit.certificate import checklist, conformity, uncertainty
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.new_files import RUN_FILE
from calibkit.recipe import type_b

if TYPE_CHECKING:
    import datetime as dt
    from collections.abc import Callable, Iterable, Mapping

    from calibkit.certificate.as_found import AsFoundAsLeft
    from calibkit.certificate.profile import Profile
    from calibkit.certificate.results import Block, Result
    from calibkit.coefficients import Condition
    from calibkit.recipe import Recipe
    from calibkit.store import Run

TITLE = Words("Calibration certificate", "校准证书")
Relationship = Literal["source", "data", "alternative", "supplement"]


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
    """A file inside the certificate, with what it is to it (PDF/A-3 AFRelationship) and its
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
class RunFacts:
    """What the run folder says of itself."""

    name: str
    serial: str
    revision: int
    procedure: str
    title: str
    sha256: str
    software: str
    effective_from: str
    recipe: str
    recipe_sha256: str
    inputs: tuple[tuple[str, str, int], ...]
    """Name, digest and rows of every log."""
    excluded: tuple[tuple[str, str, str], ...]
    """What was left out, why, by whom."""
    criteria: tuple[tuple[str, float, float, str, bool], ...]
    """Acceptance limits of the recipe: name, value, limit, unit, whether it held."""
    flags: tuple[str, ...]
    conditions: tuple[Condition, ...]
    accepted: bool
    """Whether the run held its acceptance limits."""

    @property
    def content_digest(self) -> Words:
        """The run with the digest of its content, which is not that of its file: with what to
        compare it.
        """
        label = Words(
            f"Run {self.name}, digest of its content (field sha256 of run.json; the SHA-256 of the"
            " file is another): ",
            f"处理记录 {self.name}，内容摘要（run.json 的 sha256 字段，并非文件的 SHA-256）：",
        )
        return label + Words(self.sha256)


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that a certificate states, in no language and no file format."""

    title: Words
    profile: Profile
    profile_text: str
    issued: dt.date
    run: RunFacts
    blocks: tuple[Block, ...]
    statements: tuple[conformity.Statement, ...]
    as_found: AsFoundAsLeft | None
    attachments: tuple[Attachment, ...]
    unused_terms: tuple[str, ...]
    """Type B terms that entered no result."""
    missing: tuple[checklist.Missing, ...]
    unshown: str = ""
    """Characters that no font has: printed by their numbers."""

    @property
    def rejection(self) -> Words:
        """What is to be known of a run that failed its acceptance limits; nothing of one that held
        them.
        """
        if self.run.accepted:
            return Words("")
        failed = (
            ", ".join(name for name, *_, passed in self.run.criteria if not passed) or "acceptance"
        )
        return Words(
            f"The run failed its acceptance limits: {failed}", f"本次处理未满足接受限：{failed}"
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
    run: Run,
    layout_of: LayoutOf,
    profile: Profile,
    profile_text: str,
    as_found: AsFoundAsLeft | None,
    issued: dt.date,
) -> Certificate:
    """Certificate of a run; RecipeError for a profile that does not fit it or the date of issue."""
    _amended_before(profile, issued)
    layout = layout_of(run.document)
    terms = uncertainty.Source.of(type_b.loads(run.document.get("type_b", ())), profile.type_b)
    temperatures = tuple(sorted(set(profile.results.temperatures_degc)))
    blocks = layout.blocks(
        Stated(run.records, terms, temperatures, layout.recipe.reference_temp_degc)
    )
    results = [result for block in blocks for result in block.results]
    used = [result.uncertainty for result in results if result.uncertainty is not None]
    title = profile.certificate.title
    return Certificate(
        title=Words(title) if title else TITLE,
        profile=profile,
        profile_text=profile_text,
        issued=issued,
        run=_facts(run, layout.recipe.title),
        blocks=blocks,
        statements=conformity.statements(
            profile.specification, results, profile.results.decision_rule
        ),
        as_found=as_found,
        attachments=_attachments(run, as_found, profile_text),
        unused_terms=uncertainty.unused(terms.terms, used),
        missing=checklist.missing(profile, issued, validated=as_found is not None),
    )


def _amended_before(profile: Profile, issued: dt.date) -> None:
    """RecipeError for an amendment of a certificate that is issued later than it."""
    former = profile.certificate.amends_issued
    if former is not None and former > issued:
        raise RecipeError(
            f"certificate.amends_issued: {former} is later than the date of issue {issued}",
            hint="state when the amended certificate was issued, or give the right --date",
            at=("certificate", "amends_issued"),
        )


def without_glyphs(certificate: Certificate, characters: Iterable[str]) -> Certificate:
    """The certificate with characters that no font has: they are printed by their numbers and make
    it a DRAFT.
    """
    unshown = "".join(sorted({*certificate.unshown, *characters}))
    if not unshown:
        return certificate
    kept = tuple(item for item in certificate.missing if item.key != checklist.FONTS)
    return replace(certificate, missing=(*kept, checklist.glyphs(unshown)), unshown=unshown)


def _facts(run: Run, title: str) -> RunFacts:
    """What run.json says."""
    document: Mapping[str, object] = run.document
    conditions = {c.name: c for record in run.records.values() for c in record.conditions}
    get = run.document.__getitem__
    return RunFacts(
        name=run.name,
        serial=str(document["serial"]),
        revision=int(get("revision")),
        procedure=str(document["procedure"]),
        title=title,
        sha256=str(document["sha256"]),
        software=str(document["software"]),
        effective_from=str(document["effective_from"]),
        recipe=str(get("recipe")["name"]),
        recipe_sha256=str(get("recipe")["sha256"]),
        inputs=tuple((e["name"], e["sha256"], e["rows"]) for e in get("inputs")),
        excluded=tuple((_range(e), e["reason"], e["person"]) for e in get("excluded")),
        criteria=tuple(
            (c["name"], c["value"], c["limit"], c["unit"], c["passed"]) for c in get("acceptance")
        ),
        flags=tuple(get("flags")),
        conditions=tuple(conditions.values()),
        accepted=bool(document["accepted"]),
    )


def _range(entry: Mapping[str, object]) -> str:
    """A log, or the range of it, that was left out."""
    ends = [
        f"{word} {entry[key]:g} s"
        for word, key in (("from", "from_s"), ("to", "to_s"))
        if entry.get(key) is not None
    ]
    return " ".join((str(entry["log"]), *ends))


def _attachments(
    run: Run, as_found: AsFoundAsLeft | None, profile_text: str
) -> tuple[Attachment, ...]:
    """The coefficient files, the run's own record, the validation, the profile: all that the
    certificate is made from.
    """
    names = [entry["name"] for entry in run.document["files"] if entry["name"] in run.records]
    files = [
        Attachment(
            name,
            (run.folder / name).read_bytes(),
            "application/json",
            "data",
            f"coefficient file {name}",
        )
        for name in sorted(names)
    ]
    content = (run.folder / RUN_FILE).read_bytes()
    files.append(
        Attachment(
            RUN_FILE, content, "application/json", "source", "recipe, logs and software of the run"
        )
    )
    if as_found is not None:
        text = as_found.text.encode()
        files.append(
            Attachment(
                "validation.json", text, "application/json", "data", "as-found and as-left results"
            )
        )
    if profile_text:
        text = profile_text.encode()
        files.append(
            Attachment("profile.toml", text, "application/toml", "source", "laboratory profile")
        )
    return tuple(files)
