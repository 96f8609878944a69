"""Two runs side by side: every coefficient and figure in its unit and in standard uncertainties of
the difference.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from calibkit.check import copies
from calibkit.coefficients import Coefficient, Model, Record
from calibkit.errors import UsageError
from calibkit.forms import Form, FormsOf
from calibkit.numeric import change, gum
from calibkit.numeric.change import Joint
from calibkit.store import StoredRun

Verdict = Literal["moved", "held", "equal", "no uncertainty", "not comparable", "appeared", "gone"]
ABSENT = Coefficient("", math.nan, "", math.nan)
"""Stands for a number that a run does not have."""


@dataclass(frozen=True, slots=True)
class Change:
    """One number in two runs; NaN stands where a run has none."""

    name: str
    unit: str
    before: float
    after: float
    u_before: float
    u_after: float
    verdict: Verdict

    @property
    def difference(self) -> float:
        """After minus before, in the unit."""
        return self.after - self.before

    @property
    def standard_uncertainty(self) -> float:
        """Standard uncertainty of the difference of two independent determinations, in the unit."""
        return math.hypot(self.u_before, self.u_after)

    @property
    def in_u(self) -> float:
        """Difference in its standard uncertainties; NaN where there is none."""
        return (
            self.difference / self.standard_uncertainty
            if self.standard_uncertainty > 0.0
            else math.nan
        )

    @property
    def mark(self) -> str:
        """Verdict where a person has to look, else empty."""
        return "" if self.verdict in ("held", "equal") else self.verdict


@dataclass(frozen=True, slots=True)
class ModelChange:
    """One model (or the figures of one stage, without form and name) in two runs."""

    stage: str
    name: str
    form: str
    changes: tuple[Change, ...]
    joint: Joint | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Setting:
    """Something beside the coefficients that the two runs do not share."""

    what: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class Difference:
    """Everything that differs between two runs."""

    before: StoredRun
    after: StoredRun
    models: tuple[ModelChange, ...]
    figures: tuple[ModelChange, ...]
    settings: tuple[_Setting, ...]
    flags: tuple[str, ...]

    def count(self, *verdicts: Verdict | str) -> int:
        """Number of coefficients (figures not counted) with one of the verdicts."""
        return sum(entry.verdict in verdicts for model in self.models for entry in model.changes)


def compare_runs(before: StoredRun, after: StoredRun, forms_of: FormsOf) -> Difference:
    """What changed from one run to another; raises UsageError for runs of different procedures."""
    procedures = before.document["procedure"], after.document["procedure"]
    if procedures[0] != procedures[1]:
        raise UsageError(
            f"{before.name} is a run of {procedures[0]}, {after.name} of {procedures[1]}",
            hint="compare runs of one procedure",
        )
    forms = forms_of(procedures[0])
    models: list[ModelChange] = []
    figures: list[ModelChange] = []
    for file, record in {**before.records, **after.records}.items():
        old, new = before.records.get(file), after.records.get(file)
        models += _models(record.stage, old, new, forms)
        changes = compare_numbers(old.figures if old else (), new.figures if new else ())
        if changes:
            figures.append(ModelChange(record.stage, "", "", changes, None, ()))
    return Difference(
        before,
        after,
        tuple(models),
        tuple(figures),
        tuple(_settings(before, after)),
        _flags(before, after),
    )


def _models(
    stage: str, old: Record | None, new: Record | None, forms: Mapping[str, Form]
) -> Iterator[ModelChange]:
    """Models of one stage, in the order of the older run; those of one run only cannot be
    compared.
    """
    olds, news = ({m.name: m for m in record.models} if record else {} for record in (old, new))
    for name, model in {**olds, **news}.items():
        if name in olds and name in news:
            yield _model(stage, olds[name], model, forms.get(olds[name].form))
        else:
            pair = (with_dof(models[name]) if name in models else () for models in (olds, news))
            yield ModelChange(stage, name, model.form, compare_numbers(*pair), None, ())


def _model(stage: str, old: Model, new: Model, form: Form | None) -> ModelChange:
    """One model in two runs; where its equation or a chosen parameter changed nothing is judged."""
    obstacles, notes = _obstacles(old, new, form), _measured(old, new, form)
    changes = compare_numbers(with_dof(old), with_dof(new), comparable=not obstacles)
    joint = None if obstacles else _joint(old, new, changes)
    return ModelChange(stage, old.name, new.form, changes, joint, (*obstacles, *notes))


def _obstacles(old: Model, new: Model, form: Form | None) -> tuple[str, ...]:
    """Reasons why the coefficients of two models are different quantities."""
    if old.form != new.form:
        return (f"form {old.form} became {new.form}: the coefficients are other quantities",)
    return tuple(
        f"{name} {a:g} became {b:g}: the coefficients are other quantities"
        for name, a, b in _parameters(old, new, form.meaning if form else ())
        if a != b
    )


def _measured(old: Model, new: Model, form: Form | None) -> tuple[str, ...]:
    """Where the two were measured, when that differs."""
    matters = form.measured if form else {}
    return tuple(
        f"measured at {name} {a:.4g} and {b:.4g}: part of a difference may be that"
        for name, a, b in _parameters(old, new, matters)
        if not abs(a - b) <= matters[name]
    )


def _parameters(old: Model, new: Model, names: Iterable[str]) -> Iterator[tuple[str, float, float]]:
    """Name and both values of parameters that one of two models has; NaN where the other has
    none.
    """
    olds = {parameter.name: parameter.value for parameter in old.parameters}
    news = {parameter.name: parameter.value for parameter in new.parameters}
    for name in names:
        if name in olds or name in news:
            yield name, olds.get(name, math.nan), news.get(name, math.nan)


def with_dof(model: Model) -> tuple[Coefficient, ...]:
    """Coefficients of a model, each with its degrees of freedom; None where the model has none."""
    return tuple(replace(c, effective_dof=model.dof_of(c) or None) for c in model.coefficients)


def compare_numbers(
    old: Sequence[Coefficient], new: Sequence[Coefficient], *, comparable: bool = True
) -> tuple[Change, ...]:
    """Numbers of two lists by name, in the order of the first."""
    olds, news = ({entry.name: entry for entry in numbers} for numbers in (old, new))
    changes = []
    for name in {**olds, **news}:
        a, b = olds.get(name, ABSENT), news.get(name, ABSENT)
        changes.append(
            Change(
                name,
                ", ".join(dict.fromkeys(filter(None, (a.unit, b.unit)))),
                a.value,
                b.value,
                a.standard_uncertainty,
                b.standard_uncertainty,
                _verdict(a, b, comparable=comparable),
            )
        )
    return tuple(changes)


def _verdict(a: Coefficient, b: Coefficient, *, comparable: bool) -> Verdict:
    """Whether a number moved by more than the expanded uncertainty of the difference: 2 u, or
    Student's quantile where degrees of freedom are few.
    """
    u = math.hypot(a.standard_uncertainty, b.standard_uncertainty)
    if ABSENT in (a, b):
        return "gone" if b is ABSENT else "appeared"
    if not comparable or a.unit != b.unit:
        return "not comparable"
    if a.value == b.value:
        return "held" if u > 0.0 else "equal"
    if u == 0.0:
        return "no uncertainty"
    parts = [
        gum.UncertaintyComponent(
            name, c.value, c.standard_uncertainty, "A", dof=max(c.effective_dof or math.inf, 1.0)
        )
        for name, c in (("before", a), ("after", b))
    ]
    return "moved" if abs(b.value - a.value) > gum.combine(parts).expanded_uncertainty else "held"


def _joint(old: Model, new: Model, changes: Sequence[Change]) -> Joint | None:
    """The whole model's distance, where both runs have the same coefficients in the same units and
    a covariance.
    """
    names = [c.name for c in old.coefficients]
    comparable = names == [c.name for c in new.coefficients] and all(
        entry.verdict in ("moved", "held", "equal", "no uncertainty") for entry in changes
    )
    if (
        not comparable
        or len(names) < 2
        or not len(old.covariance) == len(new.covariance) == len(names)
    ):
        return None
    covariance = np.asarray(old.covariance) + np.asarray(new.covariance)
    dof = min(model.dof_of(c) for model in (old, new) for c in model.coefficients) or math.inf
    return change.joint(np.array([entry.difference for entry in changes]), covariance, dof)


def _settings(before: StoredRun, after: StoredRun) -> Iterator[_Setting]:
    """Recipe lines, overrides, conditions, software and libraries that differ."""
    a, b = before.document, after.document
    for key in ("serial", "software", "python"):
        if a[key] != b[key]:
            yield _Setting(key, a[key], b[key])
    yield from _differing("", a["libraries"], b["libraries"])
    for file, record in before.records.items():
        if file in after.records:
            old, new = (
                {c.name: f"{c.value:.9g} {c.unit}" for c in run_record.conditions}
                for run_record in (record, after.records[file])
            )
            yield from _differing(f"{record.stage}: ", old, new)
    yield from _recipe_lines(a["recipe"], b["recipe"])


def _differing(prefix: str, old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[_Setting]:
    """Entries of two tables that differ; a dash stands for one that is missing."""
    for name in sorted({*old, *new}):
        if old.get(name) != new.get(name):
            yield _Setting(f"{prefix}{name}", old.get(name, "-"), new.get(name, "-"))


def _recipe_lines(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[_Setting]:
    """Lines of two recipes, and overrides of the command line, that are in one of them only."""
    texts = []
    for recipe in (a, b):
        lines = [line.strip() for line in recipe["text"].splitlines()]
        texts.append(lines + [f"--set {override}" for override in recipe["overrides"]])
    for line in difflib.ndiff(texts[0], texts[1]):
        text = line[2:]
        if line.startswith(("- ", "+ ")) and text and not text.startswith("#"):
            old, new = (text, "") if line[0] == "-" else ("", text)
            yield _Setting("recipe", old, new)


def _flags(before: StoredRun, after: StoredRun) -> tuple[str, ...]:
    """What a reader must know before a difference is taken for a change of the instrument."""
    flags = []
    if before.document["serial"] != after.document["serial"]:
        flags.append(f"two instruments: {before.document['serial']} and {after.document['serial']}")
    old, new = (run.document["inputs"] for run in (before, after))
    shared = len(copies.shared_logs(new, old))
    log_count = len(old) + len(new) - shared
    if shared:
        flags.append(
            f"{shared} of {log_count} logs are in both runs: their errors are common, u of a"
            " difference is too large, and what moved is due to recipe, software or the other logs"
        )
    flags += [
        f"{run.name} was rejected"
        for run in (before, after)
        if run.document["verdict"] == "rejected"
    ]
    return tuple(flags)
