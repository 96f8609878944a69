"""What a run.json holds: the verdict in its three values, the keys that every format ever released
has, and their types.
"""

import datetime as dt
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from calibkit.records import names, sealed
from calibkit.records.coefficients import Criterion
from calibkit.records.frame import KEPT_DIGITS

FORMAT = "calibkit-run/2"
VALIDATION_FORMAT = "calibkit-validation/2"
Verdict = Literal["accepted", "rejected", "no verdict"]
ACCEPTED: Mapping[str, bool | None] = {"accepted": True, "rejected": False, "no verdict": None}
"""Verdict → `accepted` of a JSON document."""
NO_VERDICT = "No verdict: the recipe sets no [acceptance] limits"
_HEX = re.compile(r"[0-9a-f]+")
_FILE_NAME = re.compile(r"[^\W_][\w.+-]*", re.UNICODE)


@dataclass(frozen=True, slots=True)
class ListedFile:
    """A file in the folder of the document that lists it, and its digest."""

    name: str
    sha256: str

    def __post_init__(self) -> None:
        if not _FILE_NAME.fullmatch(self.name):
            raise ValueError(f"file name '{self.name}' leaves the folder")


@dataclass(frozen=True, slots=True)
class _InputFacts:
    """What run.json holds of each log."""

    name: str
    sha256: str
    rows: int
    fingerprint: str | None = None
    sample: str | None = None

    def __post_init__(self) -> None:
        for text in (self.fingerprint, self.sample):  # digests of rows behind each other
            if text is not None and (len(text) % KEPT_DIGITS or not _HEX.fullmatch(text)):
                raise ValueError(f"{text!r:.40} is no fingerprint of rows")


@dataclass(frozen=True, slots=True)
class _RecipeFacts:
    """What run.json holds of the recipe."""

    name: str
    sha256: str
    text: str
    overrides: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _RunFacts:
    """What every run.json holds; a format may add keys."""

    serial: str
    revision: int
    procedure: str
    effective_from: str
    software: str
    python: str
    libraries: dict[str, Any]
    recipe: _RecipeFacts
    inputs: tuple[_InputFacts, ...]
    excluded: tuple[Any, ...]
    accepted: bool | None
    verdict: Verdict
    acceptance: tuple[Criterion, ...]
    flags: tuple[str, ...]
    files: tuple[ListedFile, ...]

    def __post_init__(self) -> None:
        if ACCEPTED[self.verdict] is not self.accepted:
            raise ValueError(f"verdict: {self.verdict!r:.40}, accepted: {self.accepted}")
        if not _is_date(self.effective_from):
            raise ValueError(f"effective_from: {self.effective_from!r:.40}")
        if self.revision <= 0:
            raise ValueError(f"revision: {self.revision}")
        if not names.is_serial(self.serial):
            raise ValueError(f"serial: {self.serial!r:.40} is none that fit takes")


@dataclass(frozen=True, slots=True)
class FleetFacts:
    """What every fleet.json holds."""

    software: str
    effective_from: str
    units: tuple[Any, ...]
    figures: tuple[Any, ...]
    files: tuple[ListedFile, ...]


@dataclass(frozen=True, slots=True)
class DeliveredUnit:
    """What a manifest holds of each device."""

    serial: str
    revision: int
    accepted: bool | None
    files: tuple[ListedFile, ...]


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a manifest of exported files holds."""

    software: str
    files: tuple[ListedFile, ...]
    units: tuple[DeliveredUnit, ...]


def judge(criteria: Iterable[Criterion]) -> Verdict:
    """Rejected where a criterion failed, accepted where limits of the recipe are met, else no
    verdict.
    """
    tested = tuple(criteria)
    if not all(criterion.passed for criterion in tested):
        return "rejected"
    return "accepted" if any(criterion.set_by == "recipe" for criterion in tested) else "no verdict"


def loads(text: str, name: str) -> dict[str, Any]:
    """run.json of its text; CoefficientError for a wrong digest, format or shape, and for a file
    that would not be in the folder.
    """
    document = sealed.unseal(text, name, FORMAT)
    sealed.read_as(_RunFacts, document, name, "a run document")
    return document


def _is_date(text: str) -> bool:
    """Whether a text is a date as calibkit writes it."""
    try:
        return dt.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False
