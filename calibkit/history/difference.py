"""Two runs side by side: every coefficient and figure in its unit and in standard uncertainties of
the difference.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibkit.check import copies
from calibkit.errors import UsageError
from calibkit.numeric import change

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.coefficients import Coefficient, Model, Record
    from calibkit.forms import Form, FormsOf
    from calibkit.numeric.change import Joint
    from calibkit.store import Run

Verdict = Literal["moved", "held", "equal", "no uncertainty", "not comparable", "appeared", "gone"]
JUDGED = ("moved", "held")
MEASURED = {"gyro-scale/1": {"temp_case": 0.1}}
"""Form → parameters that say where its coefficients were measured, with the difference that is
worth saying [their unit].
"""


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

    before: Run
    after: Run
    models: tuple[ModelChange, ...]
    figures: tuple[ModelChange, ...]
    settings: tuple[_Setting, ...]
    flags: tuple[str, ...]

    def all_changes(self) -> Iterator[tuple[ModelChange, Change]]:
        """Every number with the model or stage that it belongs to."""
        for model in (*self.models, *self.figures):
            for entry in model.changes:
                yield model, entry

    def count(self, *verdicts: Verdict | str) -> int:
        """Number of coefficients (figures not counted) with one of the verdicts."""
        return sum(entry.verdict in verdicts for model in self.models for entry in model.changes)


def compare_runs(before: Run, after: Run, forms_of: FormsOf) -> Difference:
    """What changed from one run to another; raises UsageError for runs of different procedures."""
    procedures = before.document["procedure"], after.document["procedure"]
    if procedures[0] != procedures[1]:
        raise UsageError(
            f"{before.name} is a run of {procedures[0]}, {after.name} of {procedures[1]}",
            hint="compare runs of one procedure",
        )
    models: list[ModelChange] = []
    figures: list[ModelChange] = []
    for file in dict.fromkeys([*before.records, *after.records]):
        old, new = before.records.get(file), after.records.get(file)
        models += _models(old, new, forms_of(procedures[0]))
        figures += _figures(old, new)
    return Difference(
        before,
        after,
        tuple(models),
        tuple(figures),
        tuple(_settings(before, after)),
        _flags(before, after),
    )


def _models(
    old: Record | None, new: Record | None, forms: Mapping[str, Form]
) -> Iterator[ModelChange]:
    """Models of one stage, in the order of the older run; those of one run only have nothing to be
    held against.
    """
    olds = {model.name: model for model in old.models} if old else {}
    news = {model.name: model for model in new.models} if new else {}
    for name in dict.fromkeys([*olds, *news]):
        if old and name not in news:
            model = olds[name]
            yield ModelChange(
                old.stage, name, model.form, compare_numbers(model.coefficients, ()), None, ()
            )
        elif new and name not in olds:
            model = news[name]
            yield ModelChange(
                new.stage, name, model.form, compare_numbers((), model.coefficients), None, ()
            )
        elif new:
            yield _model(new.stage, olds[name], news[name], forms.get(olds[name].form))


def _model(stage: str, old: Model, new: Model, form: Form | None) -> ModelChange:
    """One model in two runs; where its equation or a chosen parameter changed nothing is judged."""
    obstacles, notes = _obstacles(old, new, form), _measured(old, new, form)
    changes = compare_numbers(old.coefficients, new.coefficients, comparable=not obstacles)
    together = None if obstacles else _joint(old, new, changes)
    return ModelChange(stage, old.name, new.form, changes, together, (*obstacles, *notes))


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
    matters = form.measured if form and form.measured else MEASURED.get(old.form, {})
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


def compare_numbers(
    old: Sequence[Coefficient], new: Sequence[Coefficient], *, comparable: bool = True
) -> tuple[Change, ...]:
    """Numbers of two lists by name, in the order of the first."""
    olds, news = {entry.name: entry for entry in old}, {entry.name: entry for entry in new}
    changes = []
    for name in dict.fromkeys([*olds, *news]):
        if name not in news:
            a = olds[name]
            changes.append(
                Change(name, a.unit, a.value, math.nan, a.standard_uncertainty, math.nan, "gone")
            )
        elif name not in olds:
            b = news[name]
            changes.append(
                Change(
                    name, b.unit, math.nan, b.value, math.nan, b.standard_uncertainty, "appeared"
                )
            )
        else:
            changes.append(_change(olds[name], news[name], comparable=comparable))
    return tuple(changes)


def _change(a: Coefficient, b: Coefficient, *, comparable: bool) -> Change:
    """One number of both runs with its verdict."""
    unit = a.unit if a.unit == b.unit else f"{a.unit}, {b.unit}"
    judged = _verdict(a, b) if comparable and a.unit == b.unit else "not comparable"
    return Change(
        a.name, unit, a.value, b.value, a.standard_uncertainty, b.standard_uncertainty, judged
    )


def _verdict(a: Coefficient, b: Coefficient) -> Verdict:
    """Whether a number moved by more than 2 standard uncertainties of the difference."""
    u = math.hypot(a.standard_uncertainty, b.standard_uncertainty)
    if a.value == b.value:
        return "held" if u > 0.0 else "equal"
    if u == 0.0:
        return "no uncertainty"
    return "moved" if abs(b.value - a.value) > change.SIGNIFICANT * u else "held"


def _joint(old: Model, new: Model, changes: Sequence[Change]) -> Joint | None:
    """The whole model's distance, where both runs have the same coefficients in the same units and
    a covariance.
    """
    names = [c.name for c in old.coefficients]
    comparable = names == [c.name for c in new.coefficients] and all(
        entry.verdict in (*JUDGED, "equal", "no uncertainty") for entry in changes
    )
    if (
        not comparable
        or len(names) < 2
        or not len(old.covariance) == len(new.covariance) == len(names)
    ):
        return None
    covariance = np.asarray(old.covariance) + np.asarray(new.covariance)
    dof = float(min(old.dof, new.dof)) if min(old.dof, new.dof) > 0 else math.inf
    return change.joint(np.array([entry.difference for entry in changes]), covariance, dof)


def _figures(old: Record | None, new: Record | None) -> Iterator[ModelChange]:
    """Figures of one stage as one block, where it has any."""
    changes = compare_numbers(old.figures if old else (), new.figures if new else ())
    if changes:
        yield ModelChange(old.stage if old else new.stage if new else "", "", "", changes, None, ())


def _settings(before: Run, after: Run) -> Iterator[_Setting]:
    """Recipe lines, overrides, conditions, software and libraries that differ."""
    a, b = before.document, after.document
    for what in ("serial", "software", "python"):
        if a[what] != b[what]:
            yield _Setting(what, a[what], b[what])
    for name in sorted({*a["libraries"], *b["libraries"]}):
        versions = a["libraries"].get(name, "-"), b["libraries"].get(name, "-")
        if versions[0] != versions[1]:
            yield _Setting(name, *versions)
    yield from _conditions(before, after)
    for what, old, new in _recipe_lines(a["recipe"], b["recipe"]):
        yield _Setting(what, old, new)


def _conditions(before: Run, after: Run) -> Iterator[_Setting]:
    """Conditions of a stage that differ."""
    for stage in before.records.keys() & after.records.keys():
        olds = {c.name: f"{c.value:.9g} {c.unit}" for c in before.records[stage].conditions}
        news = {c.name: f"{c.value:.9g} {c.unit}" for c in after.records[stage].conditions}
        for name in sorted({*olds, *news}):
            if olds.get(name) != news.get(name):
                yield _Setting(
                    f"{before.records[stage].stage}: {name}",
                    olds.get(name, "-"),
                    news.get(name, "-"),
                )


def _recipe_lines(
    a: Mapping[str, object], b: Mapping[str, object]
) -> Iterator[tuple[str, str, str]]:
    """Lines of two recipes, and overrides of the command line, that are in one of them only."""
    texts = [
        [line.strip() for line in str(recipe["text"]).splitlines()]
        + [f"--set {o}" for o in _listed(recipe["overrides"])]
        for recipe in (a, b)
    ]
    for line in difflib.ndiff(texts[0], texts[1]):
        if line.startswith(("- ", "+ ")) and (text := line[2:]) and not text.startswith("#"):
            yield ("recipe", text, "") if line[0] == "-" else ("recipe", "", text)


def _listed(value: object) -> list[str]:
    """A JSON array of texts."""
    return [str(entry) for entry in value] if isinstance(value, list) else []


def _flags(before: Run, after: Run) -> tuple[str, ...]:
    """What a reader must know before a difference is taken for a change of the instrument."""
    flags = []
    if before.document["serial"] != after.document["serial"]:
        flags.append(f"two instruments: {before.document['serial']} and {after.document['serial']}")
    old, new = (run.document["inputs"] for run in (before, after))
    shared = len(copies.shared_logs(new, old))
    every = len(old) + len(new) - shared
    if shared:
        flags.append(
            f"{shared} of {every} logs are in both runs: their errors are common, u of a difference"
            " is too large, and what moved is due to recipe, software or the other logs"
        )
    flags += [
        f"{run.name} was not accepted" for run in (before, after) if not run.document["accepted"]
    ]
    return tuple(flags)
