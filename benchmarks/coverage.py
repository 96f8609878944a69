"""Do 95 % intervals cover the truth where observations share errors, and are they no wider than
they must be? Writes docs/coverage.csv and the summary in docs/coverage.md.

    PYTHONPATH=. python benchmarks/coverage.py [--only TEXT] [--sets N] [--first N] [--jobs N]
        [--results FILE] [--python OTHER/bin/python]

Every row simulates 1,000 campaigns where one takes less than 0.2 s, else 200, by a physical
instrument with one shared error of 0, 0.5, 1 or 3 times the noise of a dwell and 5, 7 or 9 groups.
Of a row is printed which share of the intervals covers the truth, with its binomial 99 % interval,
and the mean half-width over that of generalised least squares with known standard deviations. A
row fails whose binomial interval lies outside 92 to 99.9 %, or which is wider than 1.6 times
(component given: 92 to 98 %, 1.15 times).

Rows of `intervals.physics` are of devices with a fault that their logs do not name, and of the same
campaigns without it. Printed are the share of truths within U, the share of campaigns in which a
flag names the cause, of those in which only a remark does, of either coverage or a name, and mean
U. A row fails below 95 % of either or 88 % of coverage where nothing names the cause; without the
fault where more than 1 % have any flag that their design does not earn, or any is refused or
rejected.

With --results rows are kept in a file of JSON lines, and
those that are there are not simulated again; --sets 0 simulates none and writes what the file
holds. --first draws the campaigns
N … N + sets − 1 in place of 0 … sets − 1: seeds that a row has not been seen with. --python fits
the same logs with the calibkit that another interpreter has installed. The page is written where
all cases were asked for, or --page names it. Exit code 1 where a row fails, 2 for no such page.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from intervals.physics.rows import FaultRow  # noqa: E402 the folder is found first
from intervals.rows import Case, Row, judge  # noqa: E402
from speed.page import machine, replaced, table  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Sequence

AnyRow = Row | FaultRow
PAGE = ROOT / "docs" / "coverage.md"
BEGIN, END = (
    "<!-- measured: benchmarks/coverage.py writes what stands below -->",
    "<!-- end of what is measured -->",
)
FAULTS = "physics.rows"
"""Module of devices with a fault, whose rows have a table of their own."""
INSTRUMENTS = (
    "accelerometer",
    "rate_table",
    "gyro_pair",
    "gyro_triad",
    "bias_temperature",
    "inclinometer",
)
"""Modules of `intervals`; each has `list_cases()`, `simulate(case, number)` and `judge`."""
FAST_S, MANY, FEWER, CHUNK = 0.2, 1000, 200, 20


def simulate(case: Case, numbers: range) -> list[Any]:
    """Some campaigns of a case."""
    module = importlib.import_module(f"intervals.{case.instrument}")
    return [module.simulate(case, number) for number in numbers]


def run(case: Case, sets: int | None, first: int, pool: ProcessPoolExecutor | None) -> list[AnyRow]:
    """All campaigns of a case, judged."""
    outcomes = simulate(case, range(first, first + 1))
    if sets is None:
        begin = time.perf_counter()
        outcomes += simulate(case, range(first + 1, first + 5))
        sets = MANY if (time.perf_counter() - begin) / 4 < FAST_S else FEWER
    numbers = range(first, first + sets)[len(outcomes) :]
    chunks = [numbers[k : k + CHUNK] for k in range(0, len(numbers), CHUNK)]
    mapped = pool.map if pool else map
    for chunk in mapped(simulate, [case] * len(chunks), chunks):
        outcomes += chunk
    module = importlib.import_module(f"intervals.{case.instrument}")
    return getattr(module, "judge", judge)(case, outcomes)


def run_elsewhere(arguments: Sequence[str]) -> int:
    """Run this script with the interpreter that --python names."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--python")
    asked, others = parser.parse_known_args(arguments)
    # PYTHONPATH would put this tree before the calibkit that is installed there.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [asked.python, __file__, *others]
    return subprocess.run(command, env=environment, check=False).returncode


def summarise(rows: Sequence[AnyRow]) -> str:
    """Tables in Markdown: a line per procedure and quantity with shared errors, and a line per
    procedure with faults.
    """
    campaigns = [row.campaigns for row in rows]
    text = (
        f"{len(rows)} rows of {min(campaigns)} to {max(campaigns)} campaigns. Measured on"
        f" {machine()}.\n\n"
    )
    lines = []
    errors = [row for row in rows if isinstance(row, Row)]
    for procedure, quantity in dict.fromkeys((row.procedure, row.quantity) for row in errors):
        alike = [r for r in errors if (r.procedure, r.quantity) == (procedure, quantity)]
        covered = [100.0 * row.covered for row in alike]
        widths = [row.width for row in alike]
        faults = sorted({fault for row in alike for fault in row.faults})
        failed = sum(bool(row.faults) for row in alike)
        lines.append(
            [
                procedure,
                quantity,
                f"{len(alike)}",
                f"{np.mean(covered):.1f} ({min(covered):.0f} to {max(covered):.0f})",
                f"{np.median(widths):.2f} ({max(widths):.2f})",
                f"{failed}: {', '.join(faults)}" if failed else "none",
            ]
        )
    if lines:
        head = ["procedure", "interval of", "rows", "covered, mean (range) [%]"]
        text += table([*head, "width, median (largest)", "fail"], lines) + "\n"
    lines = []
    faulty = [row for row in rows if isinstance(row, FaultRow)]
    for procedure in dict.fromkeys(row.procedure for row in faulty):
        present = [row for row in faulty if row.procedure == procedure and row.present]
        absent = [row for row in faulty if row.procedure == procedure and not row.present]
        failed = [row.fault for row in (*present, *absent) if row.faults]
        lines.append(
            [
                procedure,
                f"{len({row.fault for row in present})}",
                f"{100.0 * min(row.covered_or_named for row in present):.0f}",
                f"{100.0 * max((row.flagged for row in absent), default=0.0):.0f}",
                ", ".join(dict.fromkeys(failed)) or "none",
            ]
        )
    if lines:
        head = ["procedure", "faults", "covered or named, least [%]"]
        text += table([*head, "flagged without a fault, most [%]", "fail"], lines)
    return text


def write_rows(file: Path, rows: Sequence[AnyRow]) -> None:
    """Write rows as CSV, and which limits each misses."""
    objects = [{**row.to_object(), "fails": "; ".join(row.faults)} for row in rows]
    for row in objects:
        row.pop("reasons", None)
    columns = list(dict.fromkeys(name for row in objects for name in row))
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        for row in objects:
            shown = {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()}
            writer.writerow(shown)


def kept(file: Path | None) -> dict[str, list[AnyRow]]:
    """Rows of an earlier call, by their case."""
    found: dict[str, list[AnyRow]] = {}
    if file is not None and file.is_file():
        for line in file.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            found[entry["case"]] = [
                FaultRow(**row) if "fault" in row else Row(**row) for row in entry["rows"]
            ]
    return found


def main(given: Sequence[str] | None = None) -> int:
    """Simulate, print, write the page where all cases were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--only", action="append", help="text that a case contains; all must")
    parser.add_argument("--sets", type=int, help="campaigns of a row")
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--python", help="interpreter with another calibkit")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--results", type=Path, help="rows that are kept between calls")
    parser.add_argument("--page", type=Path, help="page that is written anew")
    asked = parser.parse_args(given)
    if asked.page is not None and not asked.page.is_file():
        print(f"--page {asked.page}: no such file; copy docs/coverage.md to it", file=sys.stderr)
        return 2
    if asked.python:
        return run_elsewhere(sys.argv[1:] if given is None else given)
    modules = [importlib.import_module(f"intervals.{name}") for name in (*INSTRUMENTS, FAULTS)]
    cases = [case for module in modules for case in module.list_cases()]
    if asked.only:
        cases = [case for case in cases if all(text in str(case) for text in asked.only)]
    before, rows = kept(asked.results), list[AnyRow]()
    context = get_context("fork")
    pool = ProcessPoolExecutor(asked.jobs, context) if asked.jobs > 1 else None
    if asked.sets == 0:
        cases, rows = [], [row for found in before.values() for row in found]
        for row in rows:
            print(f"{row.label}: {row.cell}")
    for case in cases:
        begin = time.perf_counter()
        key = f"{case} from {asked.first}" if asked.first else str(case)
        found = before.get(key) or run(case, asked.sets, asked.first, pool)
        rows += found
        for row in found:
            print(f"{row.label}: {row.cell}", flush=True)
        if key not in before and asked.results is not None:
            entry = {"case": key, "rows": [row.to_object() for row in found]}
            with asked.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
            print(f"    {time.perf_counter() - begin:.1f} s", flush=True)
    if pool:
        pool.shutdown()
    page = asked.page or (None if asked.only else PAGE)
    if page is not None:
        text = page.read_text(encoding="utf-8")
        page.write_text(replaced(text, BEGIN, END, summarise(rows)), encoding="utf-8")
        write_rows(page.with_suffix(".csv"), rows)
    failed = [row for row in rows if row.faults]
    print(f"{len(rows)} rows, {len(failed)} fail")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
