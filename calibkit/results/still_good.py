"""The answer on two runs as people and scripts read it: one sentence, a table, JSON, a figure."""

from __future__ import annotations

import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.results import print_expanded
from calibkit.certificate.words import unit_mark
from calibkit.history.difference_tables import identify_run
from calibkit.report.figures import ALERT, GOOD, MUTED, page, styled
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table, number_or_none
from calibkit.results.comparison import nearness
from calibkit.results.figures import COLOURS, draw_band

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Result
    from calibkit.results.comparison import Answer, Change, Compared, StillGood

PPM = 1e6
SENTENCES: Mapping[Answer, str] = {
    "yes": "Still good",
    "no": "No longer good",
    "cannot tell": "Cannot tell",
}
EXIT_CODES: Mapping[Answer, int] = {"yes": 0, "no": 1, "cannot tell": 3}
MOST_ROWS = 12
"""Results that the console shows."""
MOST_JOINTS = 3
MOST_PANELS = 4
"""Results that a figure shows, those nearest to their limits."""


def _scale(quantity: Quantity, reference: float) -> tuple[float, str]:
    """Factor and unit in which a change is printed: ppm of the value of a sensitivity."""
    if quantity.relative and reference:
        return PPM / abs(reference), "ppm"
    return 1.0, unit_mark(quantity.unit)


def _state_change(one: Change, quantity: Quantity) -> str:
    """A change ± U with its unit."""
    factor, unit = _scale(quantity, one.then.value)
    if not one.expanded:
        return f"{one.difference * factor:.3g} {unit}".strip()
    shown = " ± ".join(print_expanded(one.difference * factor, one.expanded * factor))
    return f"{shown} {unit}".strip()


def _state_limit(one: Compared) -> str:
    """Limit of a result with its unit; empty where there is none."""
    limit = one.limit
    if limit is None:
        return ""
    if limit.change is not None and one.worst is not None:
        factor, unit = _scale(one.quantity, one.worst.then.value)
        return f"{number(limit.change * factor, 3)} {unit}".strip()
    unit = unit_mark(one.quantity.unit)
    ends = [number(end) for end in (limit.lower, limit.upper) if end is not None]
    words = (
        " … ".join(ends) if len(ends) == 2 else f"{'≤' if limit.lower is None else '≥'} {ends[0]}"
    )
    return f"{words} {unit}".strip()


def state_place(found: Result) -> str:
    """Where a result holds; inputs at rest are left out."""
    parts = []
    for k, (name, value, unit) in enumerate(found.at):
        stem = name.removesuffix("_min").rpartition("_")[0] or name
        shown = f"{value:.4g} {unit_mark(unit)}".strip()
        parts += [shown if k == 0 else f"{stem} {shown}"] if k == 0 or value else []
    return ", ".join(parts)


def sentence(found: StillGood) -> str:
    """The answer in one sentence, with the result that decides."""
    if found.repeated:
        return f"Cannot tell: {found.after.name} was fitted to logs of {found.before.name} alone"
    if found.rejected:
        listed = ", ".join(one.name for one in found.rejected)
        return f"{SENTENCES[found.answer]}: {found.after.name} itself failed its limits: {listed}"
    one = found.deciding
    if one is None:
        return f"{SENTENCES[found.answer]}: the two runs have no result in common"
    worst, name = one.worst, one.quantity.words.en
    if worst is None or worst.expanded is None:
        return f"{SENTENCES[found.answer]}: {name}: {one.reason}"
    place = state_place(worst.now)
    where = f" at {place}" if place else ""
    changed = f"{name} changed by {_state_change(worst, one.quantity)}{where}"
    if one.limit is None:
        return f"{SENTENCES[found.answer]}: {changed}; {one.reason}"
    if one.limit.change is None:
        now = ""
        if worst.now.uncertainty is not None:
            now = f" to {' ± '.join(print_expanded(worst.now.value, worst.now.U))}"
        changed += f"{now} {unit_mark(one.quantity.unit)}".rstrip()
    return f"{SENTENCES[found.answer]}: {changed}, limit {_state_limit(one)} ({one.limit.key})"


def summarise(found: StillGood) -> Summary:
    """The sentence, a row for each result, the joint test, and what must be known."""
    rows = []
    for one in found.compared[:MOST_ROWS]:
        worst = one.worst
        cells = (
            ("-", "")
            if worst is None
            else (_state_change(worst, one.quantity), state_place(worst.now))
        )
        rows.append((one.quantity.words.en, *cells, _state_limit(one) or "none", one.answer))
    more = len(found.compared) - MOST_ROWS
    heads = ("result", "largest change ± U", "at", "limit", "still good")
    table = Table(f"{more} more: --json" if more > 0 else "", heads, tuple(rows))
    chances = tuple(
        (name, count, "< 1e-9" if joint.probability < 1e-9 else f"{joint.probability:.2g}")
        for name, count, joint in found.joints[:MOST_JOINTS]
    )
    names = ("all coefficients together", "of them", "chance of as much by type A alone")
    title = ""
    joint = (Table(title, names, chances),) if chances else ()
    dates = " → ".join(
        f"{run.name} ({run.document['effective_from']})" for run in (found.before, found.after)
    )
    reasons = dict.fromkeys(
        f"{one.quantity.words.en}: {one.reason}"
        for one in found.compared
        if one.answer == "cannot tell"
    )
    flags = (*reasons, *found.flags)
    return Summary(sentence(found), (table, *joint), flags, (), dates)


def document(found: StillGood) -> dict[str, Any]:
    """The answer as a JSON object."""
    return {
        "still_good": {"yes": True, "no": False, "cannot tell": None}[found.answer],
        "answer": found.answer,
        "sentence": sentence(found),
        "before": identify_run(found.before),
        "after": identify_run(found.after),
        "results": [
            {
                "quantity": one.quantity.key,
                "unit": one.quantity.unit,
                "answer": one.answer,
                "reason": one.reason,
                "limit": None if one.limit is None else asdict(one.limit),
                "largest": None if one.worst is None else _change_document(one.worst),
                "factor_of_the_largest": number_or_none(one.factor),
                "changes": [_change_document(change) for change in one.changes],
            }
            for one in found.compared
        ],
        "joint": [
            {"model": name, "coefficients": count, **asdict(joint)}
            for name, count, joint in found.joints
        ],
        "flags": list(found.flags),
    }


def _change_document(one: Change) -> dict[str, Any]:
    """A change as a JSON object."""
    return {
        "at": dict(one.at),
        "before": one.then.value,
        "after": one.now.value,
        "change": one.difference,
        "standard_uncertainty": one.u,
        "expanded_uncertainty": one.expanded,
    }


def draw(found: StillGood) -> Figure:
    """Each result then and now over its range, and beside it the change with U and limit."""
    drawable = [one for one in found.compared if one.changes]
    drawable.sort(key=lambda one: -nearness(one))
    shown = drawable[:MOST_PANELS]
    rows = max(len(shown), 1)
    left_out = len(drawable) - len(shown)
    more = f" ({left_out} more results in --json)" * (left_out > 0)
    with styled():
        title = "\n".join(textwrap.wrap(sentence(found) + more, 105))
        figure, axes = page(rows, 2, title=title, height=1.1 + 3.0 * rows)
        for one, (left, right) in zip(shown, zip(axes[::2], axes[1::2], strict=True), strict=False):
            _draw_result(one, left, right)
        if not shown:
            for ax in axes:
                ax.set_visible(False)
    return figure


def _draw_result(one: Compared, left: Axes, right: Axes) -> None:
    """Panels of one result."""
    cases: dict[str, list[Change]] = {}
    for change in one.changes:
        others = [entry for entry in change.now.at[1:] if entry[1]]
        case = ", ".join(f"{value:+g} {unit_mark(unit)}" for _, value, unit in others) or "at rest"
        cases.setdefault(case if any(one.quantity.inputs[1:]) else "", []).append(change)
    middle = one.changes[len(one.changes) // 2].then.value
    factor, unit = _scale(one.quantity, middle)
    origin = middle if unit == "ppm" else 0.0
    for colour, (case, changes) in zip(COLOURS, cases.items(), strict=False):
        x = np.array([next(iter(c.at.values()), 0.0) for c in changes])
        for ends, style, when in (("then", "--", "then"), ("now", "-", "now")):
            results = [getattr(c, ends) for c in changes]
            y = factor * (np.array([r.value for r in results]) - origin)
            U = factor * np.array(
                [r.uncertainty.expanded_uncertainty if r.uncertainty else np.nan for r in results]
            )
            label = f"{when}{f', {case}' if case else ''}"
            draw_band(
                left, x, y, U, colour if when == "now" or len(cases) > 1 else MUTED, style, label
            )
        moved = factor * np.array([c.difference for c in changes])
        U = factor * np.array([np.nan if c.expanded is None else c.expanded for c in changes])
        draw_band(right, x, moved, U, colour, "-", case)
    _draw_limits(one, left, right, factor, origin)
    column = one.quantity.inputs[0] if one.quantity.inputs else None
    for ax, what in ((left, one.quantity.words.en), (right, "change, now − then, ± U")):
        ax.set_title(what, fontsize=9)
        ax.set_ylabel(f"[{unit or 1}]")
        if column is None:
            ax.set_xticks([])
        else:
            ax.set_xlabel(f"{column.column} [{unit_mark(column.unit) or 1}]")
    left.legend(fontsize=7)


def _draw_limits(one: Compared, left: Axes, right: Axes, factor: float, origin: float) -> None:
    """Lines of the limits, in green where the result is within them, in red where it is not."""
    right.axhline(0.0, color=MUTED, lw=0.8)
    if one.limit is None:
        return
    colour = GOOD if one.answer == "yes" else ALERT
    if one.limit.change is not None:
        for way in (1.0, -1.0):
            right.axhline(way * factor * one.limit.change, color=colour, lw=1.2, ls=":")
        return
    for end in (one.limit.lower, one.limit.upper):
        if end is not None:
            left.axhline(factor * (end - origin), color=colour, lw=1.2, ls=":")
