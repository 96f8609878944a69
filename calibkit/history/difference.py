"""What changed from one run to another: coefficients and figures, each in its unit and in standard
uncertainties of the difference; recipe, logs, files, flags, software and conditions.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from calibkit.check import copies
from calibkit.errors import UsageError
from calibkit.numeric import change, gum
from calibkit.numeric.change import CHANCE, SIGNIFICANT, Joint
from calibkit.records.coefficients import Coefficient, Model, Record
from calibkit.records.forms import Form, FormsOf
from calibkit.records.store import StoredRun
from calibkit.report.table import Column, Table, number_or_none, tabulate

Verdict = Literal["moved", "held", "equal", "no uncertainty", "not comparable", "appeared", "gone"]
LONGEST_CELL = 36
"""Characters of a cell on the first screen."""
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
class ChangedFact:
    """Something that the two runs do not share: what each of them has, and what that means."""

    what: str
    before: str
    after: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Difference:
    """Everything that differs between two runs."""

    before: StoredRun
    after: StoredRun
    models: tuple[ModelChange, ...]
    figures: tuple[ModelChange, ...]
    settings: tuple[ChangedFact, ...]
    """Everything but coefficients and figures."""
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
    # equal to the last bit: nothing was determined anew, or it is a setting
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
    # two determinations from different logs are independent
    covariance = np.asarray(old.covariance) + np.asarray(new.covariance)
    dof = min(model.dof_of(c) for model in (old, new) for c in model.coefficients) or math.inf
    return change.joint(np.array([entry.difference for entry in changes]), covariance, dof)


def _settings(before: StoredRun, after: StoredRun) -> Iterator[ChangedFact]:
    """Everything but numbers that differs: recipe, flags, logs, coefficient files, conditions,
    software and libraries.
    """
    a, b = before.document, after.document
    yield from _recipe_lines(a["recipe"], b["recipe"])
    for flag in [*a["flags"], *b["flags"]]:
        if flag not in b["flags"]:
            yield ChangedFact("flag", flag, "")
        elif flag not in a["flags"]:
            yield ChangedFact("flag", "", flag)
    old_logs, new_logs = (
        {log["name"]: f"{log['sha256'][:12]}…" for log in document["inputs"]} for document in (a, b)
    )
    yield from _differing("log ", old_logs, new_logs)
    old_files, new_files = (dict.fromkeys(run.records, "present") for run in (before, after))
    yield from _differing("file ", old_files, new_files)
    for file, record in before.records.items():
        if file in after.records:
            old, new = (
                {c.name: f"{c.value:.9g} {c.unit}" for c in run_record.conditions}
                for run_record in (record, after.records[file])
            )
            yield from _differing(f"{record.stage}: ", old, new)
    for key in ("serial", "software", "python"):
        if a[key] != b[key]:
            yield ChangedFact(key, a[key], b[key])
    yield from _differing("", a["libraries"], b["libraries"])


def _differing(
    prefix: str, old: Mapping[str, str], new: Mapping[str, str]
) -> Iterator[ChangedFact]:
    """Entries of two tables that differ; a dash stands for one that is missing."""
    for name in sorted({*old, *new}):
        if old.get(name) != new.get(name):
            yield ChangedFact(f"{prefix}{name}", old.get(name, "-"), new.get(name, "-"))


def _recipe_lines(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[ChangedFact]:
    """Lines of two recipes, and overrides of the command line, that are in one of them only."""
    texts = []
    for recipe in (a, b):
        lines = [line.strip() for line in recipe["text"].splitlines()]
        texts.append(lines + [f"--set {override}" for override in recipe["overrides"]])
    for line in difflib.ndiff(texts[0], texts[1]):
        text = line[2:]
        if line.startswith(("- ", "+ ")) and text and not text.startswith("#"):
            old, new = (text, "") if line[0] == "-" else ("", text)
            yield ChangedFact("recipe", old, new)


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


def tabulate_changes(difference: Difference, most: int | None = None) -> Table:
    """What changed, for people: models whose coefficients changed together by more than chance,
    every number that moved, and whatever else differs; at most `most` rows, with short texts.
    """
    facts = []
    for model in difference.models:
        label = f"{model.stage}.{model.name}"
        facts += [ChangedFact(label, "", "", note) for note in model.notes]
        if model.joint is not None and model.joint.probability < CHANCE:
            chance = model.joint.probability
            chance_text = "< 1e-9" if chance < 1e-9 else f"{chance:.2g}"
            note = f"chance of as much: {chance_text}"
            facts.append(ChangedFact(f"{label}: all {len(model.changes)} together", "", "", note))
    numbers = [
        (".".join(filter(None, (block.stage, block.name, entry.name))), entry)
        for block in (*difference.models, *difference.figures)
        for entry in block.changes
        if entry.verdict not in ("held", "equal") and (block.name or entry.verdict == "moved")
    ]
    for label, entry in sorted(numbers, key=lambda number: -abs(np.nan_to_num(number[1].in_u))):
        before, after = (
            "" if math.isnan(value) else f"{value:.9g}" for value in (entry.before, entry.after)
        )
        shift = f"{entry.difference:+.3g}, {entry.in_u:+.3g} u"
        note = shift if entry.verdict == "moved" else entry.verdict
        facts.append(ChangedFact(f"{label} [{entry.unit}]", before, after, note))
    facts += difference.settings
    judged = difference.count("moved", "held")
    title = "what changed"
    if judged:
        title += (
            f": {difference.count('moved')} of {judged} coefficients by more than"
            f" {SIGNIFICANT:g} u (type A), {CHANCE * judged:.1f} would by chance"
        )
    if most is not None and len(facts) > most:
        title += f"; {len(facts) - most} more: --details"
    columns = (
        Column("", key="what"),
        Column(difference.before.name, key="before"),
        Column(difference.after.name, key="after"),
        Column("", key="note"),
    )
    table = tabulate(title, columns, facts[:most])
    if most is None:
        return table
    short_rows = [tuple(_shorten(str(cell)) for cell in row) for row in table.rows]
    return replace(table, rows=tuple(short_rows))


def _shorten(text: str) -> str:
    """Beginning of a text that is longer than a column of the first screen."""
    return text if len(text) <= LONGEST_CELL else f"{text[: LONGEST_CELL - 1]}…"


def describe_changes(difference: Difference) -> dict[str, Any]:
    """What changed as a JSON object: every number of either run, and whatever else differs; null
    stands where there is no number.
    """
    numbers = [
        {
            "stage": block.stage,
            "model": block.name,
            "form": block.form,
            "name": entry.name,
            "unit": entry.unit,
            "before": number_or_none(entry.before),
            "after": number_or_none(entry.after),
            "u_before": number_or_none(entry.u_before),
            "u_after": number_or_none(entry.u_after),
            "difference": number_or_none(entry.difference),
            "standard_uncertainty": number_or_none(entry.standard_uncertainty),
            "in_u": number_or_none(entry.in_u),
            "verdict": entry.verdict,
        }
        for block in (*difference.models, *difference.figures)
        for entry in block.changes
    ]
    models = [
        {
            "stage": model.stage,
            "model": model.name,
            "joint": None if model.joint is None else asdict(model.joint),
            "notes": list(model.notes),
        }
        for model in difference.models
    ]
    settings = [asdict(fact) for fact in difference.settings]
    return {"numbers": numbers, "models": models, "settings": settings}
