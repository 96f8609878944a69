"""Summary of a finished fleet: lines for a person, a document for a script."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calibkit.fleet.run import Fleet
from calibkit.fleet.table import COPIED, FAILED, Entry

MOST = 20
"""Lines of one kind; the table has them all."""


def summary_lines(fleet: Fleet, *, dry_run: bool = False) -> list[str]:
    """Counts, then each device that failed, was rejected or stands out, then the folder with the
    table.

    A dry run names every device with what it would be fitted to.
    """
    entries = fleet.table.entries
    counts = Counter(entry.verdict for entry in entries)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    before = f"; {fleet.before} were fitted before" if fleet.before else ""
    lines = [f"{len(entries)} units: {counted}{before}"]
    lines += [_fitted_to(entry, fleet.recipe) for entry in entries if dry_run and entry.run]
    lines += _first_lines(
        [f"{entry.verdict}: {entry.serial}: {entry.error}" for entry in entries if entry.error]
    )
    lines += _first_lines(
        [
            f"rejected: {entry.serial}@{entry.run}"
            for entry in entries
            if entry.verdict == "rejected"
        ]
    )
    lines += _first_lines(
        [
            f"outlier: {outlier.serial}: {outlier.figure} = {outlier.value:.6g}, z ="
            f" {outlier.z:.1f}, limit {outlier.limit:.1f}"
            for outlier in fleet.table.outliers
        ]
    )
    flagged = [entry.flags for entry in entries if entry.flags]
    if flagged:
        lines.append(f"{sum(flagged)} flags in {len(flagged)} runs: see their reports")
    unwritten = dry_run and not fleet.folder.exists()
    return [*lines, f"{fleet.folder}{' (dry run: not written)' if unwritten else ''}"]


def _fitted_to(entry: Entry, recipe: str) -> str:
    """Run that a device would have: of which logs, with which recipe."""
    fitted = "was fitted before" if entry.before else f"would be fitted with {recipe}"
    return f"{entry.serial}@{entry.run}: {fitted} to {', '.join(entry.logs)}"


def _first_lines(found: Sequence[str]) -> list[str]:
    """The first lines of a kind, and how many more there are."""
    more = len(found) - MOST
    return [*found[:MOST], *([f"  … and {more} more: see fleet.csv or --json"] if more > 0 else [])]


def summary_document(fleet: Fleet) -> dict[str, Any]:
    """One JSON object: devices, outliers, the folder with the table; an error where one has no run
    of its own.
    """
    entries = fleet.table.entries
    without = [entry.serial for entry in entries if entry.verdict in {FAILED, COPIED}]
    error = {
        "code": "units_failed",
        "message": f"{len(without)} of {len(entries)} units have no calibration of their own",
        "hint": "see the error of each unit",
    }
    return {
        "ok": not without,
        **({"error": error} if without else {}),
        "folder": str(fleet.folder),
        "fitted_before": fleet.before,
        "units": [asdict(entry) for entry in entries],
        "outliers": [asdict(outlier) for outlier in fleet.table.outliers],
    }
