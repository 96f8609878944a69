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
from calibkit.numeric import gum
from calibkit.records.coefficients import Coefficient, Model
from calibkit.records.forms import Form, FormsOf
from calibkit.records.store import StoredRun
from calibkit.report.table import Column, Table, number_or_none, tabulate

Verdict = Literal["moved", "held", "equal", "no uncertainty", "not comparable", "appeared", "gone"]
LONGEST_CELL = 36
"""Characters of a cell on the first screen."""
SIGNIFICANT = 2.0
"""Standard uncertainties of a difference beyond which a number has moved."""
CHANCE = math.erfc(SIGNIFICANT / math.sqrt(2.0))
"""Share of normal differences beyond SIGNIFICANT when nothing has moved: 4.6 %."""
ABSENT = Coefficient("", math.nan, "", math.nan)
"""Stands for a number that a run does not have."""


@dataclass(frozen=True, slots=True)
class Change:
    """One coefficient, or figure (without model and form), in two runs; NaN stands where a run has
    none.
    """

    stage: str
    model: str
    form: str
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
        u = self.standard_uncertainty
        return self.difference / u if u > 0.0 else math.nan


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
    numbers: tuple[Change, ...]
    """Coefficients, then figures."""
    notes: tuple[ChangedFact, ...]
    """Models of another form, or measured elsewhere."""
    settings: tuple[ChangedFact, ...]
    """Recipe, logs, files, flags, conditions, software."""
    flags: tuple[str, ...]

    def count(self, *verdicts: Verdict) -> int:
        """Number of coefficients (figures not counted) with one of the verdicts."""
        return sum(change.verdict in verdicts for change in self.numbers if change.model)


def compare_runs(before: StoredRun, after: StoredRun, forms_of: FormsOf) -> Difference:
    """What changed from one run to another; raises UsageError for runs of different procedures."""
    procedures = before.document["procedure"], after.document["procedure"]
    if procedures[0] != procedures[1]:
        raise UsageError(
            f"{before.name} is a run of {procedures[0]}, {after.name} of {procedures[1]}",
            hint="compare runs of one procedure",
        )
    forms = forms_of(procedures[0])
    coefficients: list[Change] = []
    figures: list[Change] = []
    notes: list[ChangedFact] = []
    for file, record in {**before.records, **after.records}.items():
        both_records = before.records.get(file), after.records.get(file)
        olds, news = ({m.name: m for m in r.models} if r else {} for r in both_records)
        for name, model in {**olds, **news}.items():
            old, new = olds.get(name), news.get(name)
            obstacles: list[str] = []
            if old and new:
                obstacles = list(_obstacles(old, new, forms.get(old.form)))
                remarks = [*obstacles, *_measured(old, new, forms.get(old.form))]
                label = f"{record.stage}.{name}"
                notes += [ChangedFact(label, "", "", remark) for remark in remarks]
            place = record.stage, name, (new or model).form
            numbers = [_with_dof(m) if m else () for m in (old, new)]
            coefficients += _compare_numbers(place, *numbers, comparable=not obstacles)
        numbers = [r.figures if r else () for r in both_records]
        figures += _compare_numbers((record.stage, "", ""), *numbers)
    return Difference(
        before,
        after,
        (*coefficients, *figures),
        tuple(notes),
        tuple(_settings(before, after)),
        _flags(before, after),
    )


def _obstacles(old: Model, new: Model, form: Form | None) -> Iterator[str]:
    """Reasons why the coefficients of two models are different quantities."""
    if old.form != new.form:
        yield f"form {old.form} became {new.form}: the coefficients are other quantities"
        return
    for name, a, b in _parameters(old, new, form.meaning if form else ()):
        if a != b:
            yield f"{name} {a:g} became {b:g}: the coefficients are other quantities"


def _measured(old: Model, new: Model, form: Form | None) -> Iterator[str]:
    """Where the two were measured, when that differs."""
    matters = form.measured if form else {}
    for name, a, b in _parameters(old, new, matters):
        if not abs(a - b) <= matters[name]:
            yield f"measured at {name} {a:.4g} and {b:.4g}: part of a difference may be that"


def _parameters(old: Model, new: Model, names: Iterable[str]) -> Iterator[tuple[str, float, float]]:
    """Name and both values of parameters that one of two models has; NaN where the other has
    none.
    """
    olds = {parameter.name: parameter.value for parameter in old.parameters}
    news = {parameter.name: parameter.value for parameter in new.parameters}
    for name in names:
        if name in olds or name in news:
            yield name, olds.get(name, math.nan), news.get(name, math.nan)


def _with_dof(model: Model) -> tuple[Coefficient, ...]:
    """Coefficients of a model, each with its degrees of freedom; None where the model has none."""
    return tuple(replace(c, effective_dof=model.dof_of(c) or None) for c in model.coefficients)


def _compare_numbers(
    place: tuple[str, str, str],
    old: Sequence[Coefficient],
    new: Sequence[Coefficient],
    *,
    comparable: bool = True,
) -> Iterator[Change]:
    """Numbers of two lists by name, in the order of the first; `place` is stage, model and form."""
    olds, news = ({entry.name: entry for entry in numbers} for numbers in (old, new))
    for name in {**olds, **news}:
        a, b = olds.get(name, ABSENT), news.get(name, ABSENT)
        unit = ", ".join(dict.fromkeys(filter(None, (a.unit, b.unit))))
        sizes = a.value, b.value, a.standard_uncertainty, b.standard_uncertainty
        yield Change(*place, name, unit, *sizes, _verdict(a, b, comparable=comparable))


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
    """What changed, for people: models of another form, every number that moved, and whatever else
    differs; at most `most` rows, with short texts.
    """
    facts = [*difference.notes]
    changed = [
        change
        for change in difference.numbers
        if change.verdict not in ("held", "equal") and (change.model or change.verdict == "moved")
    ]
    for change in sorted(changed, key=lambda change: -abs(np.nan_to_num(change.in_u))):
        label = ".".join(filter(None, (change.stage, change.model, change.name)))
        before, after = (
            "" if math.isnan(value) else f"{value:.9g}" for value in (change.before, change.after)
        )
        shift = f"{change.difference:+.3g}, {change.in_u:+.3g} u"
        note = shift if change.verdict == "moved" else change.verdict
        facts.append(ChangedFact(f"{label} [{change.unit}]", before, after, note))
    facts += difference.settings
    judged = difference.count("moved", "held")
    title = "what changed"
    if judged:
        title += (
            f": {difference.count('moved')} of {judged} coefficients by more than"
            f" {SIGNIFICANT:g} u (type A), {CHANCE * judged:.1f} would by chance"
        )
    if most is not None:
        title += f"; {len(facts) - most} more: --details" * (len(facts) > most)
        cells = [[_shorten(text) for text in asdict(fact).values()] for fact in facts[:most]]
        facts = [ChangedFact(*texts) for texts in cells]
    columns = (
        Column("", key="what"),
        Column(difference.before.name, key="before"),
        Column(difference.after.name, key="after"),
        Column("", key="note"),
    )
    return tabulate(title, columns, facts)


def _shorten(text: str) -> str:
    """Beginning of a text that is longer than a column of the first screen."""
    return text if len(text) <= LONGEST_CELL else f"{text[: LONGEST_CELL - 1]}…"


def describe_changes(difference: Difference) -> dict[str, Any]:
    """What changed as a JSON object: every number of either run, and whatever else differs; null
    stands where there is no number.
    """
    numbers = []
    for change in difference.numbers:
        derived = {
            key: getattr(change, key) for key in ("difference", "standard_uncertainty", "in_u")
        }
        entry = asdict(change) | derived
        numbers.append(
            {
                key: number_or_none(value) if isinstance(value, float) else value
                for key, value in entry.items()
            }
        )
    return {
        "numbers": numbers,
        "notes": [asdict(fact) for fact in difference.notes],
        "settings": [asdict(fact) for fact in difference.settings],
    }
