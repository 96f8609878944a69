"""A difference of two runs as `diff` prints it: tables for a person, a JSON object and CSV for a
script.
"""

from dataclasses import asdict
from typing import Any

from calibkit.history.difference import Difference, ModelChange
from calibkit.numeric.change import CHANCE, SIGNIFICANT
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table, tabulate
from calibkit.store import StoredRun

MOST_SETTINGS = 24
"""Settings that the console shows."""
TYPE_A = "u is type A of both runs as if independent; what the equipment adds is not in it"
CHANGE_KEYS = (
    "name",
    "unit",
    "before",
    "after",
    "u_before",
    "u_after",
    "difference",
    "standard_uncertainty",
    "in_u",
    "verdict",
)
"""Attributes of a change in JSON and CSV."""
CHANGE_COLUMNS = (
    Column("before", ".9g"),
    Column("after", ".9g"),
    Column("difference", ".3g"),
    Column("u", ".2g", "standard_uncertainty"),
    "unit",
    Column("in u", ".3g", "in_u"),
    Column("", key="mark"),
)
"""What the console shows of a change behind its name."""


def summarize_difference(difference: Difference) -> Summary:
    """Both runs, a table per model, the figures that moved, and what else differs."""
    tables = [_change_table(model) for model in difference.models if model.changes]
    tables += [
        _change_table(block, moved_alone=True)
        for block in difference.figures
        if any(entry.verdict == "moved" for entry in block.changes)
    ]
    if difference.settings:
        hidden_count = len(difference.settings) - MOST_SETTINGS
        title = (
            f"what else differs{f' ({hidden_count} more with --json)' if hidden_count > 0 else ''}"
        )
        columns = (
            "what",
            Column(difference.before.name, key="before"),
            Column(difference.after.name, key="after"),
        )
        tables.append(tabulate(title, columns, difference.settings[:MOST_SETTINGS]))
    old, new = (
        f"{run.name} (effective from {run.document['effective_from']})"
        for run in (difference.before, difference.after)
    )
    flags = (*difference.flags, TYPE_A)
    return Summary(f"{old} → {new}", tuple(tables), flags, (), _state_verdict(difference))


def _state_verdict(difference: Difference) -> str:
    """How many coefficients moved, against how many would by chance."""
    compared_count, unpaired = difference.count("moved", "held"), _unpaired(difference)
    if not compared_count:
        return f"{unpaired}no coefficient could be compared with an uncertainty"
    return (
        f"{unpaired}{difference.count('moved')} of {compared_count} coefficients moved by more than"
        f" {SIGNIFICANT:g} u; {CHANCE * compared_count:.1f} would by chance if none had changed"
    )


def _unpaired(difference: Difference) -> str:
    """Models of one run alone, and coefficients of one run alone in models of both: no uncertainty
    judges those.
    """
    parts = []
    for verdict, run_name in (
        ("gone", difference.before.name),
        ("appeared", difference.after.name),
    ):
        whole_models = [
            m.name
            for m in difference.models
            if m.changes and all(entry.verdict == verdict for entry in m.changes)
        ]
        single = difference.count(verdict) - sum(
            len(m.changes) for m in difference.models if m.name in whole_models
        )
        if whole_models:
            parts.append(
                f"model{'s' if len(whole_models) > 1 else ''} {', '.join(whole_models)}"
                f" only in {run_name}"
            )
        if single:
            parts.append(f"{single} coefficient{'s' if single > 1 else ''} more only in {run_name}")
    return "; ".join([*parts, ""]) if parts else ""


def _change_table(model: ModelChange, *, moved_alone: bool = False) -> Table:
    """One model's changes, what moved marked, or the figures of a stage that moved."""
    title = (
        f"{model.stage}: {f'{model.name} ({model.form})' if model.name else 'figures that moved'}"
    )
    joint_note = ""
    if model.joint is not None:
        chance = model.joint.probability
        joint_note = (
            "chance that all together differ as much:"
            f" {f'{chance:.2g}' if chance > 1e-9 else 'below 1e-9'}"
        )
    return tabulate(
        "; ".join(filter(None, (title, joint_note, *model.notes))),
        (Column("coefficient" if model.name else "figure", key="name"), *CHANGE_COLUMNS),
        [entry for entry in model.changes if entry.verdict == "moved" or not moved_alone],
    )


def difference_document(difference: Difference) -> dict[str, Any]:
    """A difference as a JSON object; null stands where there is no number."""
    compared_count = difference.count("moved", "held")
    return {
        "before": identify_run(difference.before),
        "after": identify_run(difference.after),
        "moved": [
            {"stage": model.stage, "model": model.name, "name": entry.name}
            for model in (*difference.models, *difference.figures)
            for entry in model.changes
            if entry.verdict == "moved"
        ],
        "judged": compared_count,
        "expected_by_chance": CHANCE * compared_count,
        "models": [_model_document(model) for model in difference.models],
        "figures": [_model_document(block) for block in difference.figures],
        "settings": [asdict(setting) for setting in difference.settings],
        "flags": [*difference.flags, TYPE_A],
    }


def identify_run(run: StoredRun) -> dict[str, Any]:
    """What identifies a run."""
    facts = ("serial", "revision", "procedure", "effective_from", "verdict", "accepted")
    return {"name": run.name, **{key: run.document[key] for key in (*facts, "software", "sha256")}}


def _model_document(model: ModelChange) -> dict[str, Any]:
    """One model's changes as a JSON object."""
    return {
        "stage": model.stage,
        "model": model.name,
        "form": model.form,
        "joint": None if model.joint is None else asdict(model.joint),
        "notes": list(model.notes),
        "changes": tabulate("", CHANGE_KEYS, model.changes).to_objects(),
    }


def list_changes(difference: Difference) -> Table:
    """Every coefficient and figure of a difference, one row each, for CSV."""
    rows = tuple(
        (model.stage, model.name, *cells)
        for model in (*difference.models, *difference.figures)
        for cells in tabulate("", CHANGE_KEYS, model.changes).rows
    )
    return Table("", ("stage", "model", *CHANGE_KEYS), rows)
