"""Summary of a finished fleet: lines for a person, a document for a script."""

from dataclasses import asdict
from typing import Any

from calibkit.fleet.device import Row
from calibkit.fleet.page import PAGE
from calibkit.fleet.run import Fleet
from calibkit.fleet.table import COPIED, FAILED
from calibkit.report.screen import MOST, shorten, wrap
from calibkit.report.table import tabulate

DEVICE_KEYS = (
    "serial",
    "run",
    "run_sha256",
    "verdict",
    "error",
    "flags",
    "logs",
    "before",
    "effective_from",
)
"""What --json states of each device."""
_MOST_FAILED, _MOST_REJECTED, _MOST_REHEARSED = 5, 4, 5
"""Devices of a kind that a screen names; the table has them all."""


def compose_fleet(fleet: Fleet, width: int, *, dry_run: bool = False) -> list[str]:
    """Totals, then devices that failed, were rejected or stand out, then the page and the folder
    with the table: a screen of a width, or, without one, every device in full.

    A dry run names devices with what they would be fitted to.
    """
    entries = fleet.table.entries
    before = f"; {fleet.before} fitted before" if fleet.before else ""
    lines = [f"{fleet.table.totals}{before}"]
    rehearsed = [_fitted_to(entry, fleet.recipe) for entry in entries if dry_run and entry.run]
    failed = [
        f"{entry.verdict}: {entry.serial}: {' '.join(entry.error.split())}"
        for entry in entries
        if entry.error
    ]
    rejected = [
        f"rejected: {entry.serial}@{entry.run}" for entry in entries if entry.verdict == "rejected"
    ]
    outlying = fleet.table.list_outlying()
    flagged = [entry.flags for entry in entries if entry.flags]
    unwritten = dry_run and not fleet.folder.exists()
    tail = (
        [f"{sum(flagged)} flags and remarks in {len(flagged)} runs: see the notes of their reports"]
        if flagged
        else []
    )
    tail += [] if unwritten else [f"Report: {fleet.folder / PAGE}"]
    tail.append(f"{fleet.folder}{' (dry run: not written)' if unwritten else ''}")
    if not width:
        return [*lines, *rehearsed, *failed, *rejected, *outlying, *tail]
    lines += shorten(rehearsed, _MOST_REHEARSED)
    lines += shorten([line for text in failed for line in wrap(text, width, 1)], _MOST_FAILED)
    lines += shorten(rejected, _MOST_REJECTED)
    return [*lines, *shorten(outlying, MOST - len(lines) - len(tail)), *tail]


def _fitted_to(entry: Row, recipe: str) -> str:
    """Run that a device would have: of which logs, with which recipe."""
    fitted = "was fitted before" if entry.before else f"would be fitted with {recipe}"
    return f"{entry.serial}@{entry.run}: {fitted} to {', '.join(entry.logs)}"


def summary_document(fleet: Fleet) -> dict[str, Any]:
    """One JSON object: devices, outliers, the folder with the table; an error where one has no run
    of its own.
    """
    entries = fleet.table.entries
    failed_serials = [entry.serial for entry in entries if entry.verdict in {FAILED, COPIED}]
    error = {
        "code": "units_failed",
        "message": (
            f"{len(failed_serials)} of {len(entries)} devices have no calibration of their own"
        ),
        "hint": "see the error of each device",
    }
    return {
        "ok": not failed_serials,
        **({"error": error} if failed_serials else {}),
        "folder": str(fleet.folder),
        "fitted_before": fleet.before,
        "units": tabulate("", DEVICE_KEYS, entries).to_objects(),
        "outliers": [asdict(outlier) for outlier in fleet.table.outliers],
    }
