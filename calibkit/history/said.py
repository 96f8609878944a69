"""What `show`, `diff` and `history` say: tables for a person, JSON objects and CSV rows for a
script.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from calibkit.numeric.change import CHANCE, SIGNIFICANT
from calibkit.report.summary import Summary, SummaryTable, number

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from calibkit.history.difference import Change, Difference, ModelChange
    from calibkit.history.timeline import Series, Timeline
    from calibkit.store import Run

MOST_SETTINGS = 24
TYPE_A = "u is type A of both runs as if independent; what the equipment adds is not in it"
OVER_TIME = (
    "change: from the first date to the last; step: largest between neighbours; a year: slope of"
    " the accepted runs"
)


def number_or_dash(value: float, digits: int = 4) -> str:
    """A number, or a dash where there is none."""
    return number(value, digits) if math.isfinite(value) else "-"


def difference_summary(found: Difference) -> Summary:
    """Both runs, a table a model, the figures that moved, and what else differs."""
    tables = [_change_table(model) for model in found.models if model.changes]
    tables += [_change_table(block) for block in map(_moved, found.figures) if block.changes]
    if found.settings:
        rows = tuple((s.what, s.before, s.after) for s in found.settings[:MOST_SETTINGS])
        more = len(found.settings) - len(rows)
        title = f"what else differs{f' ({more} more with --json)' if more else ''}"
        tables.append(SummaryTable(title, ("what", found.before.name, found.after.name), rows))
    return Summary(_title(found), tuple(tables), (*found.flags, TYPE_A), (), verdict(found))


def _title(found: Difference) -> str:
    """Both runs with the dates from which they hold."""
    old, new = (
        f"{run.name} (effective from {run.document['effective_from']})"
        for run in (found.before, found.after)
    )
    return f"{old} → {new}"


def verdict(found: Difference) -> str:
    """How many coefficients moved, against how many would by chance."""
    judged, unpaired = found.count("moved", "held"), _unpaired(found)
    if not judged:
        return f"{unpaired}no coefficient could be compared with an uncertainty"
    return (
        f"{unpaired}{found.count('moved')} of {judged} coefficients moved by more than"
        f" {SIGNIFICANT:g} u; {CHANCE * judged:.1f} would by chance if none had changed"
    )


def _unpaired(found: Difference) -> str:
    """Models of one run alone, and coefficients of one run alone in models of both: no uncertainty
    judges those.
    """
    said = []
    for verdict, where in (("gone", found.before.name), ("appeared", found.after.name)):
        whole = [
            m.name
            for m in found.models
            if m.changes and all(entry.verdict == verdict for entry in m.changes)
        ]
        single = found.count(verdict) - sum(len(m.changes) for m in found.models if m.name in whole)
        if whole:
            said.append(f"model{'s' if len(whole) > 1 else ''} {', '.join(whole)} only in {where}")
        if single:
            said.append(f"{single} coefficient{'s' if single > 1 else ''} more only in {where}")
    return "; ".join([*said, ""]) if said else ""


def _moved(block: ModelChange) -> ModelChange:
    """Figures of a stage that moved; the others are in JSON and CSV."""
    return replace(
        block, changes=tuple(entry for entry in block.changes if entry.verdict == "moved")
    )


def _change_table(model: ModelChange) -> SummaryTable:
    """One model's changes; what moved is marked."""
    rows = tuple(
        (
            entry.name,
            number_or_dash(entry.before, 9),
            number_or_dash(entry.after, 9),
            number_or_dash(entry.difference, 3),
            number_or_dash(entry.standard_uncertainty, 2),
            entry.unit,
            number_or_dash(entry.in_u, 3),
            "" if entry.verdict in ("held", "equal") else entry.verdict,
        )
        for entry in model.changes
    )
    columns = (
        "coefficient" if model.name else "figure",
        "before",
        "after",
        "difference",
        "u",
        "unit",
        "in u",
        "",
    )
    together = ""
    if model.joint is not None:
        chance = model.joint.probability
        together = (
            "chance that all together differ as much:"
            f" {f'{chance:.2g}' if chance > 1e-9 else 'below 1e-9'}"
        )
    title = (
        f"{model.stage}: {f'{model.name} ({model.form})' if model.name else 'figures that moved'}"
    )
    return SummaryTable("; ".join(filter(None, (title, together, *model.notes))), columns, rows)


def difference_document(found: Difference) -> dict[str, Any]:
    """A difference as a JSON object; null stands where there is no number."""
    return {
        "before": run_document(found.before),
        "after": run_document(found.after),
        "moved": [
            {"stage": model.stage, "model": model.name, "name": entry.name}
            for model, entry in found.all_changes()
            if entry.verdict == "moved"
        ],
        "judged": found.count("moved", "held"),
        "expected_by_chance": CHANCE * found.count("moved", "held"),
        "models": [_model_document(model) for model in found.models],
        "figures": [_model_document(block) for block in found.figures],
        "settings": [asdict(setting) for setting in found.settings],
        "flags": [*found.flags, TYPE_A],
    }


def run_document(run: Run) -> dict[str, Any]:
    """What identifies a run."""
    keys = ("serial", "revision", "procedure", "effective_from", "accepted", "software", "sha256")
    return {"name": run.name, **{key: run.document[key] for key in keys}}


def _model_document(model: ModelChange) -> dict[str, Any]:
    """One model's changes as a JSON object."""
    return {
        "stage": model.stage,
        "model": model.name,
        "form": model.form,
        "joint": None if model.joint is None else asdict(model.joint),
        "notes": list(model.notes),
        "changes": [_change_document(entry) for entry in model.changes],
    }


def _change_document(entry: Change) -> dict[str, Any]:
    """One number's change as a JSON object."""
    return {
        "name": entry.name,
        "unit": entry.unit,
        "before": finite(entry.before),
        "after": finite(entry.after),
        "u_before": finite(entry.u_before),
        "u_after": finite(entry.u_after),
        "difference": finite(entry.difference),
        "standard_uncertainty": finite(entry.standard_uncertainty),
        "in_u": finite(entry.in_u),
        "verdict": entry.verdict,
    }


def finite(value: float) -> float | None:
    """A number, or None where there is none: JSON has no NaN."""
    return value if math.isfinite(value) else None


CHANGE_COLUMNS = (
    "stage",
    "model",
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


def difference_csv(found: Difference) -> str:
    """A difference as CSV, one line a coefficient or figure."""
    return table_csv(
        CHANGE_COLUMNS,
        ((model.stage, model.name, *_change_cells(entry)) for model, entry in found.all_changes()),
    )


def _change_cells(entry: Change) -> list[Any]:
    """Cells of one change behind stage and model."""
    document = _change_document(entry)
    return [document[column] for column in CHANGE_COLUMNS[2:]]


def table_csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV text with LF endings; numbers read back to the same float64, None is an empty field."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([["" if cell is None else cell for cell in row] for row in rows])
    return buffer.getvalue()


RUN_COLUMNS = (
    "serial",
    "revision",
    "effective_from",
    "stage",
    "kind",
    "model",
    "form",
    "name",
    "value",
    "unit",
    "standard_uncertainty",
    "dof",
)


def run_csv(run: Run) -> str:
    """Coefficients, parameters and figures of a run as CSV, one line each."""
    return table_csv(RUN_COLUMNS, _run_rows(run))


def _run_rows(run: Run) -> Iterable[tuple[Any, ...]]:
    """Rows of `run_csv`."""
    head = (run.document["serial"], run.document["revision"], run.document["effective_from"])
    for record in run.records.values():
        for model in record.models:
            place = (model.name, model.form)
            for c in model.coefficients:
                number_cells = (c.value, c.unit, c.standard_uncertainty, model.dof)
                yield (*head, record.stage, "coefficient", *place, c.name, *number_cells)
            for p in model.parameters:
                yield (
                    *head,
                    record.stage,
                    "parameter",
                    *place,
                    p.name,
                    p.value,
                    p.unit,
                    None,
                    None,
                )
        for f in record.figures:
            stated = f.standard_uncertainty or None
            yield (*head, record.stage, "figure", "", "", f.name, f.value, f.unit, stated, None)


def timeline_summary(found: Timeline) -> Summary:
    """Every revision with the dates on which it holds, the chain, and the coefficients of each
    model over time.
    """
    columns = (
        "revision",
        "effective from",
        "in force before",
        "accepted",
        "procedure",
        "logs",
        "calibkit",
        "recipe",
    )
    tables = [
        SummaryTable("revisions", columns, tuple(_revision_row(found, run) for run in found.runs))
    ]
    blocks: dict[str, list[Series]] = {}
    for series in found.series:
        q = series.quantity
        blocks.setdefault(
            f"{q.stage}: {q.model or 'figures'}{f' ({q.meaning})' if q.meaning else ''}", []
        ).append(series)
    header = (
        "quantity",
        "runs",
        "last",
        "change",
        "unit",
        "in u",
        "step in u",
        "a year",
        "u of it",
        "",
    )
    tables += [
        SummaryTable(title, header, tuple(map(_series_row, block)))
        for title, block in blocks.items()
    ]
    flags = (
        *(f"r{entry.revision:03d} REFUSED: {entry.reason}" for entry in found.refused),
        *(f"chain broken: {fault}" for fault in found.breaks),
        *found.flags,
        *((OVER_TIME, TYPE_A) if found.series else ()),
    )
    said = (
        "each revision supersedes the one before"
        if found.sound
        else "THE CHAIN OF REVISIONS IS BROKEN"
    )
    count = f"{len(found.runs)} run{'s' if len(found.runs) != 1 else ''}"
    return Summary(f"{found.serial}: {count}", tuple(tables), flags, (), said)


def _revision_row(found: Timeline, run: Run) -> tuple[str, ...]:
    """One revision as texts."""
    document = run.document
    holds = found.holds[document["revision"]]
    span = holds.until or ("open" if holds.since else "never")
    return (
        f"r{document['revision']:03d}",
        document["effective_from"],
        span,
        "yes" if document["accepted"] else "NO",
        document["procedure"],
        f"{len(document['inputs'])}",
        document["software"].removeprefix("calibkit "),
        f"{document['recipe']['sha256'][:8]}…",
    )


def _series_row(series: Series) -> tuple[str, ...]:
    """One quantity over time as texts."""
    trend = series.trend
    return (
        series.quantity.name,
        f"{len(series.points)}",
        number(series.points[-1].value, 7),
        number(series.overall.difference, 3),
        series.quantity.unit,
        number_or_dash(series.overall.in_u, 3),
        number_or_dash(series.largest_step, 3),
        "-" if trend is None else number(trend.slope, 3),
        "-" if trend is None else number(trend.standard_uncertainty, 2),
        "moved" if series.overall.verdict == "moved" else "",
    )


def timeline_document(found: Timeline) -> dict[str, Any]:
    """A timeline as a JSON object."""
    revisions = [
        {
            **run_document(run),
            "in_force_from": found.holds[run.document["revision"]].since,
            "in_force_before": found.holds[run.document["revision"]].until,
            "logs": len(run.document["inputs"]),
            "recipe_sha256": run.document["recipe"]["sha256"],
        }
        for run in found.runs
    ]
    return {
        "serial": found.serial,
        "revisions": revisions,
        "refused": [asdict(entry) for entry in found.refused],
        "chain": {"whole": found.sound, "faults": list(found.breaks)},
        "series": [_series_document(series) for series in found.series],
        "flags": list(found.flags),
    }


def _series_document(series: Series) -> dict[str, Any]:
    """One quantity over time as a JSON object."""
    return {
        **asdict(series.quantity),
        "points": [asdict(point) for point in series.points],
        "overall": _change_document(series.overall),
        "largest_step_in_u": finite(series.largest_step),
        "trend_per_year": None if series.trend is None else asdict(series.trend),
    }


SERIES_COLUMNS = (
    "serial",
    "stage",
    "model",
    "form",
    "meaning",
    "name",
    "unit",
    "revision",
    "effective_from",
    "value",
    "standard_uncertainty",
    "accepted",
)


def timeline_csv(found: Timeline) -> str:
    """A timeline as CSV, one line a determination of a quantity."""
    return table_csv(
        SERIES_COLUMNS,
        (
            (
                found.serial,
                q.stage,
                q.model,
                q.form,
                q.meaning,
                q.name,
                q.unit,
                *asdict(point).values(),
            )
            for series in found.series
            for q in (series.quantity,)
            for point in series.points
        ),
    )
