"""Flag on a new run that takes effect before an earlier revision, so that selection by date may not
find it.
"""

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibkit.errors import CoefficientError
from calibkit.records import store
from calibkit.report.summary import Summary


def flag_date_order(summary: Summary, runs: Path, serial: str, revision: int, date: str) -> Summary:
    """The summary of a revision about to be saved, with a flag where it takes effect before the
    revision before it.

    Only the dates of the revisions are compared; no clock is read.
    """
    earlier: list[dict[str, Any]] = []
    for number in reversed(
        [number for number in store.revisions(runs / serial) if number < revision]
    ):
        with contextlib.suppress(
            CoefficientError
        ):  # a damaged old revision does not stop the new one
            earlier.append(store.own_document(runs, serial, number))
        if earlier and earlier[0]["effective_from"] <= date:
            return summary
    if not earlier:
        return summary
    new_revision = {"revision": revision, "effective_from": date, "verdict": summary.verdict}
    before = (
        f"effective from {date}, before r{earlier[0]['revision']:03d}'s"
        f" {earlier[0]['effective_from']}"
    )
    newest = f"without a date {serial} is r{revision:03d}, the newest revision"
    return replace(
        summary, flags=(*summary.flags, f"{before}: {_by_date(new_revision, earlier)}; {newest}")
    )


def _by_date(new_revision: dict[str, Any], earlier: list[dict[str, Any]]) -> str:
    """Between which dates a revision is the one in force."""
    name, date = f"r{new_revision['revision']:03d}", new_revision["effective_from"]
    if new_revision["verdict"] == "rejected":
        return f"rejected, {name} is in force on no date"
    winners = store.in_force([*earlier, new_revision])
    after = min((since for since in winners if since > date), default="")
    if not after:
        return f"by date {name} is in force from {date} on"
    return (
        f"by date {name} is in force from {date} until {after}, from then on r{winners[after]:03d}"
        " again"
    )
