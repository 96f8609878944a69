"""The coefficient file: what a stage found, with units, uncertainty, range of validity and a digest
of its own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping  # noqa: TC003 (pydantic reads annotations)
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from calibkit.errors import CoefficientError
from calibkit.libraries.plugins import Plugin  # noqa: TC001 (as above)
from calibkit.records import names
from calibkit.records.left_out import LeftOut  # noqa: TC001 (as above)
from calibkit.records.sealed import read_as, seal, unseal

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibkit.records.frame import Log

FORMAT = "calibkit-coefficients/2"
_FORM = re.compile(r"[a-z][a-z0-9-]*/[1-9][0-9]*")
"""Name of a model form, which exports state: "fog-drift-bank/1"."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One named number with its unit and type A standard uncertainty, both in that unit."""

    name: str
    value: float
    unit: str
    standard_uncertainty: float
    effective_dof: float | None = None
    """Effective degrees of freedom of the standard uncertainty; None: those of the model."""

    def __post_init__(self) -> None:
        if self.effective_dof is not None and not self.effective_dof > 0.0:
            raise ValueError(f"{self.name}: {self.effective_dof!r} effective degrees of freedom")


Figure = Coefficient
"""A result that is not a coefficient of a model: the same facts."""


@dataclass(frozen=True, slots=True)
class Component:
    """Standard deviation of an error that all observations of a group share: the zero of a soak,
    the scale of a session.
    """

    group: str
    effect: str
    value: float
    unit: str
    standard_uncertainty: float
    groups: int
    """Number of groups that it was estimated from."""

    @property
    def name(self) -> str:
        """Its name in messages: "soak-to-soak zero", "tilt of the table"."""
        if self.groups == 1:
            return f"{self.effect} of the {self.group}"
        return f"{self.group}-to-{self.group} {self.effect}"


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
    """How it was read; in run.json alone: the same numbers are the same coefficients."""
    clock: tuple[float, float] | None = None
    """Offset of a second logger's clock and its standard uncertainty [s]: a condition in files."""
    plugins: tuple[Plugin, ...] = ()
    """Plugins that read the log; kept in run.json, not in coefficient files."""
    second_logger_sha256: str = ""
    """Digest of a second logger's file that was joined; kept in run.json."""
    last_date: str = field(default="", compare=False)
    """Date of the last row, where the log has dates: coefficients hold from it by default."""
    overlap: str = field(default="", compare=False)
    """Where it and a second logger's file overlap, and how their clocks differ, in words."""
    content: frozenset[bytes] = field(default=frozenset(), compare=False, repr=False)
    """First rows of its values, by which copies are seen; run.json keeps their fingerprint."""
    sample: frozenset[int] = field(default=frozenset(), compare=False, repr=False)
    """Sample of its rows without time, for the same."""
    measured: tuple[tuple[str, float, float], ...] = field(default=(), compare=False)
    """Column, lowest and highest reading of its thermometers."""
    left_out: tuple[LeftOut, ...] = field(default=(), compare=False)

    @classmethod
    def of(cls, log: Log) -> Input:
        """The input that a log is."""
        return cls(
            *(log.file, log.sha256, log.rows, log.reading, log.clock, log.plugins),
            *(log.second_logger_sha256, log.last_date, log.overlap, log.first_rows()),
            *(log.sample_without_time(), log.measured_conditions(), log.list_left_out()),
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
    components: tuple[Component, ...] = ()

    def __post_init__(self) -> None:
        if not _FORM.fullmatch(self.form):
            raise ValueError(f"model form {self.form!r:.40} is no name with a version")
        size = len(self.coefficients)
        if self.covariance and [len(row) for row in self.covariance] != [size] * size:
            raise ValueError(f"model '{self.name}': a covariance that is not {size} × {size}")

    def dof_of(self, coefficient: Coefficient) -> float:
        """Effective degrees of freedom of a coefficient's standard uncertainty: its own, else those
        of the model.
        """
        return coefficient.effective_dof or self.dof

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

    __pydantic_config__ = {"extra": "forbid"}

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
        """Content of a coefficient file without its digest: of an input only what identifies it,
        and no key for what is absent.
        """
        inputs = [entry.identity() for entry in self.inputs]
        return asdict(self, dict_factory=_without_absent) | {"inputs": inputs}

    def dumps(self) -> str:
        """Text of a coefficient file; the same record gives the same bytes."""
        for model in self.models:
            entries: list[Coefficient | Component] = [*model.coefficients, *model.components]
            for entry in entries:
                if not math.isfinite(entry.value) or not math.isfinite(entry.standard_uncertainty):
                    raise CoefficientError(
                        f"{self.stage} {model.name}: {entry.name} is {entry.value}, standard"
                        f" uncertainty {entry.standard_uncertainty}",
                        hint="this is a bug",
                    )
        return seal(self.document())


def _without_absent(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Keys and values of a record in a coefficient file."""
    return {
        key: value for key, value in pairs if value is not None and (value or key != "components")
    }


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
        """Record of a stage's result; `supersedes` is the digest of the file before, or empty."""
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
            # the uncertainty of a second logger's clock is in no covariance of the models
            conditions=(
                *self.conditions,
                *(
                    Condition(
                        f"second_logger_clock_offset.{log.name}", log.clock[0], "s", log.clock[1]
                    )
                    for log in identity.inputs
                    if log.clock is not None
                ),
            ),
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


def loads(text: str, name: str) -> Record:
    """Record of a coefficient file's text; raises CoefficientError for a wrong digest, format or
    shape.
    """
    document = unseal(text, name, FORMAT)
    document.pop("sha256")
    record = read_as(Record, document, name, "a coefficient record")
    if not names.is_serial(record.serial):
        raise CoefficientError(
            f"{name}: serial {record.serial!r:.40} is none that fit takes",
            hint="do not use it",
        )
    return record


SetBy = Literal["recipe", "calibkit"]


@dataclass(frozen=True, slots=True)
class Criterion:
    """One acceptance limit and how a result stands against it."""

    name: str
    value: float
    limit: float
    unit: str
    passed: bool
    set_by: SetBy = "recipe"
    """Whose limit it is: one of calibkit rejects, and meeting it alone accepts nothing."""


def at_most(
    name: str, value: float, limit: float, unit: str, set_by: SetBy = "recipe"
) -> Criterion:
    """Criterion that a value must not exceed its limit; equality passes, NaN fails."""
    return Criterion(name, value, limit, unit, bool(value <= limit), set_by)


def over_u(subject: str, entry: Mapping[str, Any]) -> Criterion:
    """Criterion that errors of what was not fitted are as large as their uncertainty states, as
    `Unseen.to_object` and entries of a validation.json hold it.
    """
    ratio = entry["rms_error_over_uncertainty"]
    limit = entry["largest_rms_error_over_uncertainty"]
    return at_most(f"{subject} over its u", ratio, limit, "1", "calibkit")


def over_stated_u(entries: Iterable[tuple[str, Mapping[str, Any]]]) -> list[Criterion]:
    """The same of those entries of a validation.json, each after its name, that are judged."""
    return [
        over_u(subject, entry)
        for subject, entry in entries
        if "rms_error_over_uncertainty" in entry
    ]


def at_least(name: str, value: float, limit: float, unit: str) -> Criterion:
    """Criterion that a value must reach its limit; equality passes, NaN fails."""
    return Criterion(name, value, limit, unit, passed=bool(value >= limit))
