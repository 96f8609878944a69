"""A timeline as `history` prints it: tables for a person, a JSON object and CSV for a script."""

from dataclasses import asdict, fields
from typing import Any

from calibkit.frame import Remark
from calibkit.history.difference_tables import CHANGE_KEYS, TYPE_A, identify_run
from calibkit.history.timeline import Determination, FollowedNumber, NumberSeries, Timeline
from calibkit.report.summary import Summary
from calibkit.report.table import Cell, Column, Table, number_or_none, tabulate
from calibkit.store import StoredRun

OVER_TIME = (
    "change: from the first date to the last; step: largest between neighbours; a year: slope of"
    " the runs that were not rejected"
)
REVISION_HEADS = (
    "revision",
    "effective from",
    "in force before",
    "verdict",
    "procedure",
    "logs",
    "calibkit",
    "recipe",
)
SERIES_COLUMNS = (
    "quantity",
    "runs",
    Column("last", ".7g"),
    Column("change", ".3g"),
    "unit",
    Column("in u", ".3g"),
    Column("step in u", ".3g"),
    Column("a year", ".3g"),
    Column("u of it", ".2g"),
    "",
)


def summarize_timeline(
    timeline: Timeline, key_values: Table | None = None, left_out: tuple[str, ...] = ()
) -> Summary:
    """Every revision with the dates on which it is in force, the chain, and the key values (with
    what is left out of them), else the coefficients of each model over time.
    """
    revisions = tuple(_revision_row(timeline, run) for run in timeline.runs)
    blocks: dict[str, list[tuple[Cell, ...]]] = {}
    for series in timeline.series:
        q = series.quantity
        title = f"{q.stage}: {q.model or 'figures'}{f' ({q.meaning})' if q.meaning else ''}"
        blocks.setdefault(title, []).append(_series_row(series))
    tables = (
        Table("revisions", REVISION_HEADS, revisions),
        *((key_values,) if key_values is not None else ()),
        *(
            Table(title, SERIES_COLUMNS, tuple(rows))
            for title, rows in blocks.items()
            if key_values is None
        ),
    )
    flags = (
        *(f"r{entry.revision:03d} REFUSED: {entry.reason}" for entry in timeline.refused),
        *(f"chain broken: {fault}" for fault in timeline.breaks),
        *timeline.flags,
        *left_out,
        *((Remark(OVER_TIME), Remark(TYPE_A)) if timeline.series and key_values is None else ()),
    )
    verdict = (
        "each revision supersedes the one before"
        if timeline.sound
        else "THE CHAIN OF REVISIONS IS BROKEN"
    )
    count = f"{len(timeline.runs)} run{'s' if len(timeline.runs) != 1 else ''}"
    if key_values is not None:
        verdict += f"; {len(timeline.series)} coefficients over time: --only '*'"
    return Summary(f"{timeline.serial}: {count}", tables, flags, (), verdict)


def _revision_row(timeline: Timeline, run: StoredRun) -> tuple[Cell, ...]:
    """One revision, and until when it is in force."""
    document = run.document
    dates = timeline.in_force[document["revision"]]
    return (
        f"r{document['revision']:03d}",
        document["effective_from"],
        dates.until or ("open" if dates.since else "never"),
        "REJECTED" if document["verdict"] == "rejected" else document["verdict"],
        document["procedure"],
        len(document["inputs"]),
        document["software"].removeprefix("calibkit "),
        f"{document['recipe']['sha256'][:8]}…",
    )


def _series_row(series: NumberSeries) -> tuple[Cell, ...]:
    """One quantity over time."""
    trend = series.trend
    return (
        series.quantity.name,
        len(series.points),
        series.points[-1].value,
        series.overall.difference,
        series.quantity.unit,
        series.overall.in_u,
        series.largest_step,
        None if trend is None else trend.slope,
        None if trend is None else trend.standard_uncertainty,
        "moved" if series.overall.verdict == "moved" else "",
    )


def timeline_document(timeline: Timeline) -> dict[str, Any]:
    """A timeline as a JSON object."""
    return {
        "serial": timeline.serial,
        "revisions": [
            {
                **identify_run(run),
                "in_force_from": timeline.in_force[run.document["revision"]].since,
                "in_force_before": timeline.in_force[run.document["revision"]].until,
                "logs": len(run.document["inputs"]),
                "recipe_sha256": run.document["recipe"]["sha256"],
            }
            for run in timeline.runs
        ],
        "refused": [asdict(entry) for entry in timeline.refused],
        "chain": {"whole": timeline.sound, "faults": list(timeline.breaks)},
        "series": [_series_document(series) for series in timeline.series],
        "flags": list(timeline.flags),
    }


def _series_document(series: NumberSeries) -> dict[str, Any]:
    """One quantity over time as a JSON object."""
    (overall,) = tabulate("", CHANGE_KEYS, [series.overall]).to_objects()
    return {
        **asdict(series.quantity),
        "points": [asdict(point) for point in series.points],
        "overall": overall,
        "largest_step_in_u": number_or_none(series.largest_step),
        "trend_per_year": None if series.trend is None else asdict(series.trend),
    }


def list_points(timeline: Timeline) -> Table:
    """Every determination of a quantity, one row each, for CSV."""
    keys = tuple(field.name for kind in (FollowedNumber, Determination) for field in fields(kind))
    rows = tuple(
        (timeline.serial, *asdict(series.quantity).values(), *asdict(point).values())
        for series in timeline.series
        for point in series.points
    )
    return Table("", ("serial", *keys), rows)
