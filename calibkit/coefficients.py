"""The coefficient file: what a stage found, with units, uncertainty, range of validity and a digest
of its own.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

from calibkit.errors import CoefficientError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.frame import Log
    from calibkit.plugins import Plugin

FORMAT = "calibkit-coefficients/1"
FORMATS = (FORMAT,)
"""Every coefficient format ever released; each keeps loading."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One named number with its unit and type A standard uncertainty, both in that unit."""

    name: str
    value: float
    unit: str
    standard_uncertainty: float


Figure = Coefficient
"""A result that is not a coefficient of a model: the same four facts."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that the form of a model needs but that was chosen, not fitted: an interval, a
    temperature scaling.
    """

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition under which the coefficients were found."""

    name: str
    value: float
    unit: str
    standard_uncertainty: float = 0.0


@dataclass(frozen=True, slots=True)
class Input:
    """A log that the coefficients were found from."""

    name: str
    sha256: str
    rows: int
    reading: tuple[str, ...] = ()
    """How the log was read; kept in run.json, not in coefficient files: the same numbers are the
    same coefficients.
    """
    clock: tuple[float, float] | None = None
    """Offset of a second logger's clock [s] and its standard uncertainty [s]; a condition in
    coefficient files.
    """
    plugins: tuple[Plugin, ...] = ()
    """Plugins that read the log; kept in run.json, not in coefficient files."""
    second_logger_sha256: str = ""
    """Digest of a second logger's file that was joined; kept in run.json."""
    content: frozenset[bytes] = field(default=frozenset(), compare=False, repr=False)
    """First rows of its values, by which copies are seen; run.json keeps their fingerprint."""

    @classmethod
    def of(cls, log: Log) -> Input:
        """The input that a log is."""
        return cls(
            log.file,
            log.sha256,
            log.rows,
            log.reading,
            log.clock,
            log.plugins,
            log.second_logger_sha256,
            content=log.first_rows(),
        )

    def identity(self) -> dict[str, str | int]:
        """What identifies the log in a coefficient file."""
        return {"name": self.name, "sha256": self.sha256, "rows": self.rows}


@dataclass(frozen=True, slots=True)
class Model:
    """One fitted model: its form names the equation, `valid` the ranges (column → low, high) in
    which it holds.
    """

    name: str
    form: str
    coefficients: tuple[Coefficient, ...]
    covariance: tuple[tuple[float, ...], ...]
    dof: int
    residual_rms: float
    residual_unit: str
    valid: Mapping[str, tuple[float, float]]
    parameters: tuple[Parameter, ...] = ()

    def value(self, name: str) -> float:
        """Value of the coefficient or parameter of that name, or CoefficientError."""
        values = {parameter.name: parameter.value for parameter in self.parameters}
        values |= {coefficient.name: coefficient.value for coefficient in self.coefficients}
        if name in values:
            return values[name]
        raise CoefficientError(
            f"model '{self.name}' ({self.form}) has no '{name}'",
            hint="the file is not of this form",
        )


@dataclass(frozen=True, slots=True)
class Record:
    """A coefficient file's content; complete when made."""

    stage: str
    serial: str
    revision: int
    supersedes: str
    effective_from: str
    software: str
    recipe_sha256: str
    inputs: tuple[Input, ...]
    conditions: tuple[Condition, ...] = ()
    models: tuple[Model, ...] = ()
    figures: tuple[Figure, ...] = ()
    flags: tuple[str, ...] = ()
    format: str = field(default=FORMAT)

    def model(self, name: str) -> Model:
        """Model of that name, or CoefficientError that lists the names there are."""
        for model in self.models:
            if model.name == name:
                return model
        raise CoefficientError(
            f"{self.stage}: no model '{name}'",
            hint=f"models there: {', '.join(model.name for model in self.models) or 'none'}",
        )

    def document(self) -> dict[str, Any]:
        """Content of a coefficient file without its digest: of an input only what identifies it."""
        return asdict(self) | {"inputs": [entry.identity() for entry in self.inputs]}

    def dumps(self) -> str:
        """Text of a coefficient file; the same record gives the same bytes."""
        for model in self.models:
            for entry in model.coefficients:
                if not math.isfinite(entry.value) or not math.isfinite(entry.standard_uncertainty):
                    raise CoefficientError(
                        f"{self.stage} {model.name}: {entry.name} is {entry.value}",
                        hint="this is a bug",
                    )
        return seal(self.document())


@dataclass(frozen=True, slots=True)
class StageResult:
    """What a stage found, before it is known whose it is and which revision it becomes."""

    stage: str
    models: tuple[Model, ...] = ()
    figures: tuple[Figure, ...] = ()
    flags: tuple[str, ...] = ()
    conditions: tuple[Condition, ...] = ()

    @property
    def file(self) -> str:
        """Name of the stage's coefficient file."""
        return f"{self.stage}.json"

    def as_record(self, identity: Identity, supersedes: str) -> Record:
        """Coefficient record of a stage's result; `supersedes` is the digest of the stage's file
        before, or empty.
        """
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.stage):
            raise CoefficientError(
                f"stage '{self.stage}': not the name of a coefficient file",
                hint="small letters, digits and _ make a name; tell the authors of the instrument",
            )
        return Record(
            stage=self.stage,
            serial=identity.serial,
            revision=identity.revision,
            supersedes=supersedes,
            effective_from=identity.effective_from,
            software=identity.software,
            recipe_sha256=identity.recipe_sha256,
            inputs=tuple(Input(entry.name, entry.sha256, entry.rows) for entry in identity.inputs),
            conditions=(*self.conditions, *_clocks(identity.inputs)),
            models=self.models,
            figures=self.figures,
            flags=self.flags,
        )


@dataclass(frozen=True, slots=True)
class Identity:
    """Whose coefficients these are, from when they hold, and what they were made with and from."""

    serial: str
    revision: int
    effective_from: str
    software: str
    recipe_sha256: str
    inputs: tuple[Input, ...]


def _clocks(inputs: Sequence[Input]) -> tuple[Condition, ...]:
    """Clock of the second logger of each log that has one: its uncertainty is in no covariance of
    the models.
    """
    return tuple(
        Condition(f"second_logger_clock_offset.{entry.name}", entry.clock[0], "s", entry.clock[1])
        for entry in inputs
        if entry.clock is not None
    )


def _digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON (RFC 8785) of every key but `sha256`; raises CoefficientError
    for what JSON lacks.
    """
    import rfc8785

    try:
        canonical = rfc8785.dumps(
            {key: value for key, value in document.items() if key != "sha256"}
        )
    except (rfc8785.CanonicalizationError, RecursionError, UnicodeError) as error:
        raise CoefficientError(
            f"not a JSON document: {error}", hint="a NaN or an infinity is not a coefficient"
        ) from None
    return hashlib.sha256(canonical).hexdigest()


def seal(document: Mapping[str, Any]) -> str:
    """Text of a JSON document with its own digest beside it, one line per scalar, keys in order,
    ending in a newline.
    """
    plain: dict[str, Any] = json.loads(json.dumps(document, allow_nan=True))
    body = {"format": plain.pop("format"), "sha256": "", **plain}
    body["sha256"] = _digest(body)
    return json.dumps(body, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def unseal(text: str, name: str, formats: tuple[str, ...] = FORMATS) -> dict[str, Any]:
    """Document of a sealed JSON text, or CoefficientError that states why it cannot be trusted."""
    try:
        document = json.loads(text, object_pairs_hook=_distinct)
    except (ValueError, RecursionError) as error:
        raise CoefficientError(
            f"{name}: not a whole JSON document: {error}", hint="restore it from the run's copy"
        ) from None
    if not isinstance(document, dict) or not isinstance(document.get("format"), str):
        raise CoefficientError(
            f"{name}: no 'format' key", hint=f"expected one of {', '.join(formats)}"
        )
    if document["format"] not in formats:
        raise CoefficientError(
            f"{name}: format '{document['format']}', expected one of {', '.join(formats)}",
            hint="use a newer calibkit",
        )
    expected = _digest(document)
    if document.get("sha256") != expected:
        raise CoefficientError(
            f"{name}: digest {str(document.get('sha256'))[:12]}… is not that of its content,"
            f" {expected[:12]}…",
            hint="the file was changed after it was written; do not use it",
        )
    return document


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose keys are distinct; two values for one key would make the digest
    meaningless.
    """
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice")
    return found


def loads(text: str, name: str) -> Record:
    """Record of a coefficient file's text; raises CoefficientError for a wrong digest, format or
    shape.
    """
    document = unseal(text, name)
    document.pop("sha256")
    try:
        return _typed(
            Record,
            {
                **document,
                "inputs": tuple(_typed(Input, entry) for entry in document["inputs"]),
                "conditions": tuple(_typed(Condition, entry) for entry in document["conditions"]),
                "models": tuple(_model(entry) for entry in document["models"]),
                "figures": tuple(_typed(Figure, entry) for entry in document["figures"]),
                "flags": tuple(_plain(flag, "str") for flag in document["flags"]),
            },
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise CoefficientError(
            f"{name}: not a coefficient record: {error}", hint="restore it from the run's copy"
        ) from None


def _model(entry: Mapping[str, Any]) -> Model:
    """Model of its JSON object; its covariance is square, one row a coefficient, or absent."""
    model = _typed(
        Model,
        {
            **entry,
            "coefficients": tuple(_typed(Coefficient, item) for item in entry["coefficients"]),
            "covariance": tuple(
                tuple(_plain(value, "float") for value in row) for row in entry["covariance"]
            ),
            "valid": {
                column: (_plain(low, "float"), _plain(high, "float"))
                for column, (low, high) in entry["valid"].items()
            },
            "parameters": tuple(_typed(Parameter, item) for item in entry.get("parameters", ())),
        },
    )
    size = len(model.coefficients)
    if model.covariance and [len(row) for row in model.covariance] != [size] * size:
        raise ValueError(f"model '{model.name}': a covariance that is not {size} × {size}")
    return model


_PLAIN: dict[str, tuple[tuple[type, ...], str]] = {
    "str": ((str,), "text"),
    "float": ((int, float), "number"),
    "int": ((int,), "whole number"),
}
"""Annotation of a field → types that its value may have, and their name. What is made of other
records was checked when they were made.
"""


def _plain(value: Any, annotation: str) -> Any:  # noqa: ANN401 (a value of JSON)
    """A JSON value of the type that an annotation names, or TypeError."""
    types, name = _PLAIN[annotation]
    if isinstance(value, bool) or not isinstance(value, types):
        raise TypeError(f"{value!r:.40} where a {name} is expected")
    return value


_Made = TypeVar("_Made")


def _typed(kind: type[_Made], values: Mapping[str, Any]) -> _Made:
    """A record whose plain fields hold what their annotations state; TypeError for another type, a
    key too many or too few.
    """
    kinds = {field.name: str(field.type) for field in fields(kind)}  # type: ignore[arg-type]
    for name, value in values.items():
        if kinds.get(name) in _PLAIN:
            _plain(value, kinds[name])
    return kind(**values)


@dataclass(frozen=True, slots=True)
class Criterion:
    """One acceptance limit and how a result stands against it."""

    name: str
    value: float
    limit: float
    unit: str
    passed: bool


def at_most(name: str, value: float, limit: float, unit: str) -> Criterion:
    """Criterion that a value must not exceed its limit; equality passes, NaN fails."""
    return Criterion(name, value, limit, unit, passed=bool(value <= limit))


def at_least(name: str, value: float, limit: float, unit: str) -> Criterion:
    """Criterion that a value must reach its limit; equality passes, NaN fails."""
    return Criterion(name, value, limit, unit, passed=bool(value >= limit))
