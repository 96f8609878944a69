"""A timeline as `history` prints it: tables for a person, a JSON object for a script."""

from typing import Any

from calibkit.history.timeline import Timeline
from calibkit.records.store import StoredRun
from calibkit.report.summary import Summary
from calibkit.report.table import Cell, Table

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


def summarize_timeline(
    timeline: Timeline, key_values: Table | None = None, left_out: tuple[str, ...] = ()
) -> Summary:
    """Every revision with the dates on which it is in force, the chain, and the key values with
    what is left out of them.
    """
    revisions = tuple(_revision_row(timeline, run) for run in timeline.runs)
    tables = (
        Table("revisions", REVISION_HEADS, revisions),
        *((key_values,) if key_values is not None else ()),
    )
    flags = (
        *(f"r{number:03d} REFUSED: {reason}" for number, reason in timeline.refused.items()),
        *(f"chain broken: {fault}" for fault in timeline.breaks),
        *timeline.flags,
        *left_out,
    )
    verdict = (
        "each revision supersedes the one before"
        if timeline.sound
        else "THE CHAIN OF REVISIONS IS BROKEN"
    )
    count = f"{len(timeline.runs)} run{'s' if len(timeline.runs) != 1 else ''}"
    return Summary(f"{timeline.serial}: {count}", tables, flags, (), verdict)


def _revision_row(timeline: Timeline, run: StoredRun) -> tuple[Cell, ...]:
    """One revision, and until when it is in force."""
    document = run.document
    since, until = timeline.in_force[document["revision"]]
    return (
        f"r{document['revision']:03d}",
        document["effective_from"],
        until or ("open" if since else "never"),
        "REJECTED" if document["verdict"] == "rejected" else document["verdict"],
        document["procedure"],
        len(document["inputs"]),
        document["software"].removeprefix("calibkit "),
        f"{document['recipe']['sha256'][:8]}…",
    )


def timeline_document(timeline: Timeline) -> dict[str, Any]:
    """A timeline as a JSON object."""
    return {
        "serial": timeline.serial,
        "revisions": [
            {
                **run.identity(),
                "in_force_from": timeline.in_force[run.document["revision"]][0],
                "in_force_before": timeline.in_force[run.document["revision"]][1],
                "logs": len(run.document["inputs"]),
                "recipe_sha256": run.document["recipe"]["sha256"],
            }
            for run in timeline.runs
        ],
        "refused": [
            {"revision": number, "reason": reason} for number, reason in timeline.refused.items()
        ],
        "chain": {"whole": timeline.sound, "faults": list(timeline.breaks)},
        "flags": list(timeline.flags),
    }
