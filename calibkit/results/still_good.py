"""The answer on two runs as people and scripts read it: one sentence, a table, JSON, a figure."""

from __future__ import annotations

import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.history.difference import describe_changes, tabulate_changes
from calibkit.report.figures import ALERT, GOOD, MUTED, page, styled
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table, number_or_none
from calibkit.results.evaluation import state_expanded
from calibkit.results.figures import COLOURS, draw_band
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Result
    from calibkit.results.comparison import Answer, ComparedResult, ResultChange, StillGood

PPM = 1e6
SENTENCES: Mapping[Answer, str] = {
    "yes": "Still good",
    "no": "No longer good",
    "cannot tell": "Cannot tell",
}
EXIT_CODES: Mapping[Answer, int] = {"yes": 0, "no": 1, "cannot tell": 3}
MOST_ROWS = 12
"""Results that the console shows."""
MOST_CHANGES = 4
"""Rows of what changed that the console shows without --details."""
MOST_PANELS = 4
"""Results that a figure shows, those nearest to their limits."""


def _scale(quantity: Quantity, reference: float) -> tuple[float, str]:
    """Factor and unit in which a change is printed: ppm of the value of a sensitivity."""
    if quantity.relative and reference:
        return PPM / abs(reference), "ppm"
    return 1.0, quantity.unit


def _state_change(change: ResultChange, quantity: Quantity) -> str:
    """A change ± U with its unit."""
    factor, unit = _scale(quantity, change.then.value)
    expanded = None if change.expanded is None else change.expanded * factor
    return state_expanded(change.difference * factor, expanded, unit, 3)


def _state_limit(compared: ComparedResult) -> str:
    """Limit of a result with its unit; empty where there is none."""
    limit = compared.limit
    if limit is None:
        return ""
    if limit.change is not None and compared.worst is not None:
        factor, unit = _scale(compared.quantity, compared.worst.then.value)
        return state_expanded(limit.change * factor, None, unit, 3)
    ends = [number(end) for end in (limit.lower, limit.upper) if end is not None]
    sign = "≤" if limit.lower is None else "≥"
    words = " … ".join(ends) if len(ends) == 2 else f"{sign} {ends[0]}"
    return f"{words} {unit_mark(compared.quantity.unit)}".strip()


def state_place(result: Result) -> str:
    """Where a result holds; inputs at rest are left out."""
    parts = []
    for k, (name, value, unit) in enumerate(result.at):
        stem = name.removesuffix("_min").rpartition("_")[0] or name
        value_text = f"{value:.4g} {unit_mark(unit)}".strip()
        if k == 0:
            parts.append(value_text)
        elif value:
            parts.append(f"{stem} {value_text}")
    return ", ".join(parts)


def sentence(answered: StillGood) -> str:
    """The answer in one sentence, with the result that decides."""
    before, after = answered.before.name, answered.after.name
    answer_text = SENTENCES[answered.answer]
    if answered.repeated:
        return f"Cannot tell: {before} and {after} use the same logs, nothing new was measured"
    if answered.rejected:
        criterion_names = ", ".join(criterion.name for criterion in answered.rejected)
        return f"{answer_text}: {after} itself failed its limits: {criterion_names}"
    deciding = answered.deciding
    if deciding is None:
        return f"{answer_text}: the two runs have no result in common"
    quantity, worst, limit = deciding.quantity, deciding.worst, deciding.limit
    if worst is None or worst.expanded is None:
        return f"{answer_text}: {quantity.words.en}: {deciding.reason}"
    place = state_place(worst.now)
    changed = f"{answer_text}: {quantity.words.en} changed by {_state_change(worst, quantity)}"
    changed += f" at {place}" if place else ""
    if limit is None:
        return f"{changed}; {deciding.reason}"
    if limit.change is None:
        now = state_expanded(worst.now.value, worst.now.U, quantity.unit)
        changed += f" to {now}" if worst.now.uncertainty is not None else ""
    return f"{changed}, limit {_state_limit(deciding)} ({limit.key})"


def summarise(answered: StillGood, *, details: bool = False) -> Summary:
    """The sentence, a row for each result, what changed (all of it with details), and what must be
    known.
    """
    rows = []
    for compared in answered.compared[:MOST_ROWS]:
        quantity, worst = compared.quantity, compared.worst
        change, place = "-", ""
        if worst is not None:
            change, place = _state_change(worst, quantity), state_place(worst.now)
        limit = _state_limit(compared) or "none"
        rows.append((quantity.words.en, change, place, limit, compared.answer))
    undisplayed = len(answered.compared) - MOST_ROWS
    heads = ("result", "largest change ± U", "at", "limit", "still good")
    tables = [Table(f"{undisplayed} more: --json" if undisplayed > 0 else "", heads, tuple(rows))]
    changes = tabulate_changes(answered.changed, None if details else MOST_CHANGES)
    if changes.rows:
        tables.append(changes)
    both_runs = (answered.before, answered.after)
    dates = " → ".join(f"{run.name} ({run.document['effective_from']})" for run in both_runs)
    reasons = dict.fromkeys(
        f"{compared.quantity.words.en}: {compared.reason}"
        for compared in answered.compared
        if compared.answer == "cannot tell"
    )
    return Summary(sentence(answered), tuple(tables), (*reasons, *answered.flags), (), dates)


def document(answered: StillGood) -> dict[str, Any]:
    """The answer as a JSON object."""

    def change_document(change: ResultChange) -> dict[str, Any]:
        return {
            "at": dict(change.point),
            "before": change.then.value,
            "after": change.now.value,
            "change": change.difference,
            "standard_uncertainty": change.u,
            "expanded_uncertainty": change.expanded,
        }

    results = []
    for compared in answered.compared:
        limit, worst = compared.limit, compared.worst
        results.append(
            {
                "quantity": compared.quantity.key,
                "unit": compared.quantity.unit,
                "answer": compared.answer,
                "reason": compared.reason,
                "limit": None if limit is None else asdict(limit),
                "largest": None if worst is None else change_document(worst),
                "factor_of_the_largest": number_or_none(compared.factor),
                "changes": [change_document(change) for change in compared.changes],
            }
        )
    return {
        "still_good": {"yes": True, "no": False, "cannot tell": None}[answered.answer],
        "answer": answered.answer,
        "sentence": sentence(answered),
        "before": answered.before.identity(),
        "after": answered.after.identity(),
        "results": results,
        "changed": describe_changes(answered.changed),
        "flags": list(answered.flags),
    }


def draw(answered: StillGood) -> Figure:
    """Each result then and now over its range, and beside it the change with U; limits in green
    where the result is within them, in red where it is not.
    """
    drawable = [compared for compared in answered.compared if compared.changes]
    drawable.sort(key=lambda compared: -compared.nearness)
    panel_results = drawable[:MOST_PANELS]
    rows = max(len(panel_results), 1)
    left_out = len(drawable) - len(panel_results)
    left_out_text = f" ({left_out} more results in --json)" * (left_out > 0)
    with styled():
        title = "\n".join(textwrap.wrap(sentence(answered) + left_out_text, 105))
        figure, axes = page(rows, 2, title=title, height=1.1 + 3.0 * rows)
        for k, compared in enumerate(panel_results):
            left, right = axes[2 * k], axes[2 * k + 1]
            quantity, limit = compared.quantity, compared.limit
            cases: dict[str, list[ResultChange]] = {}
            for change in compared.changes:
                other_inputs = [entry for entry in change.now.at[1:] if entry[1]]
                settings = [f"{value:+g} {unit_mark(unit)}" for _, value, unit in other_inputs]
                case = ", ".join(settings) or "at rest"
                cases.setdefault(case if any(quantity.inputs[1:]) else "", []).append(change)
            middle = compared.changes[len(compared.changes) // 2].then.value
            factor, unit = _scale(quantity, middle)
            origin = middle if unit == "ppm" else 0.0
            for colour, (case, changes) in zip(COLOURS, cases.items(), strict=False):
                x = np.array([next(iter(change.point.values()), 0.0) for change in changes])
                for run_age, style in (("then", "--"), ("now", "-")):
                    results: list[Result] = [getattr(change, run_age) for change in changes]
                    y = factor * (np.array([result.value for result in results]) - origin)
                    U = factor * np.array(
                        [result.U if result.uncertainty else np.nan for result in results]
                    )
                    label = f"{run_age}{f', {case}' if case else ''}"
                    shade = colour if run_age == "now" or len(cases) > 1 else MUTED
                    draw_band(left, x, y, U, shade, style, label)
                difference = factor * np.array([change.difference for change in changes])
                U = factor * np.array([change.expanded for change in changes], dtype=np.float64)
                draw_band(right, x, difference, U, colour, "-", case)
            right.axhline(0.0, color=MUTED, lw=0.8)
            if limit is not None:
                ax, middle = (left, origin) if limit.change is None else (right, 0.0)
                for end in limit.bounds(0.0):
                    if np.isfinite(end):
                        colour = GOOD if compared.answer == "yes" else ALERT
                        ax.axhline(factor * (end - middle), color=colour, lw=1.2, ls=":")
            for ax, panel_title in ((left, quantity.words.en), (right, "change, now − then, ± U")):
                ax.set_title(panel_title, fontsize=9)
                ax.set_ylabel(f"[{unit_mark(unit) or 1}]")
                if quantity.inputs:
                    column = quantity.inputs[0]
                    ax.set_xlabel(f"{column.column} [{unit_mark(column.unit) or 1}]")
                else:
                    ax.set_xticks([])
            left.legend(fontsize=7)
        for ax in axes[2 * len(panel_results) :]:
            ax.set_visible(False)
    return figure
