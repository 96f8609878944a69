"""Flags on a new run that earlier revisions ask for: one that cannot be read, and one that takes
effect later, so that selection by date may not find the new run.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from calibkit.errors import CoefficientError
from calibkit.records import store
from calibkit.report.summary import Summary


def flag_earlier_runs(
    summary: Summary, runs: Path, serial: str, revision: int, date: str
) -> Summary:
    """The summary of a revision about to be saved, with a flag for each earlier one that cannot be
    read, and where it takes effect before the one before it.

    Only the dates of the revisions are compared; no clock is read.
    """
    earlier: list[dict[str, Any]] = []
    flags = []
    for number in store.revisions(runs / serial):
        if number >= revision:
            break
        try:
            earlier.append(store.own_document(runs, serial, number))
        except CoefficientError as error:
            flags.append(f"{serial}@r{number:03d} cannot be read: {error.message}")
    if earlier and date < earlier[-1]["effective_from"]:
        newest = earlier[-1]
        new_revision = {"revision": revision, "effective_from": date, "verdict": summary.verdict}
        flags.append(
            f"effective from {date}, before r{newest['revision']:03d}'s {newest['effective_from']}:"
            f" {_by_date(new_revision, earlier)}; without a date {serial} is r{revision:03d}, the"
            " newest revision"
        )
    return replace(summary, flags=(*summary.flags, *flags))


def _by_date(new_revision: dict[str, Any], earlier: list[dict[str, Any]]) -> str:
    """Between which dates a revision is the one in force."""
    name, date = f"r{new_revision['revision']:03d}", new_revision["effective_from"]
    if new_revision["verdict"] == "rejected":
        return f"rejected, {name} is in force on no date"
    winners = store.in_force([*earlier, new_revision])
    after = min((since for since in winners if since > date), default="")
    in_force = f"by date {name} is in force from {date}"
    if not after:
        return f"{in_force} on"
    return f"{in_force} until {after}, from then on r{winners[after]:03d} again"
