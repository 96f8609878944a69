"""Do 95 % intervals cover the truth where observations share errors, and are they no wider than
they must be? Writes docs/coverage.md.

    PYTHONPATH=. python benchmarks/coverage.py [--only TEXT] [--sets N] [--jobs N] [--results FILE]

Every row simulates 1,000 campaigns where one takes less than 0.2 s, else 200, by a physical
instrument with one shared error of 0, 0.5, 1 or 3 times the noise of a dwell and 5, 7 or 9 groups.
Of a row is printed which share of the intervals covers the truth, with its binomial 99 % interval,
and the mean half-width over that of generalised least squares with known standard deviations. A
row fails whose binomial interval lies outside 92 to 99.9 %, or which is wider than 1.6 times
(component given: 92 to 98 %, 1.15 times). With --results rows are kept in a file of JSON lines, and
those that are there are not simulated again; --sets 0 simulates none. The page is written where all
cases were asked for, or --page names it. Exit code 1 where a row fails.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from intervals.rows import Case, Outcome, Row, judge  # noqa: E402 the folder is found first
from speed.page import machine, replaced, table  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Sequence

PAGE = ROOT / "docs" / "coverage.md"
BEGIN, END = (
    "<!-- measured: benchmarks/coverage.py writes what stands below -->",
    "<!-- end of what is measured -->",
)
INSTRUMENTS = (
    "accelerometer",
    "rate_table",
    "gyro_pair",
    "gyro_triad",
    "bias_temperature",
    "inclinometer",
)
"""Modules of `intervals`; each has `list_cases()` and `simulate(case, number)`."""
FAST_S, MANY, FEWER, CHUNK = 0.2, 1000, 200, 20


def simulate(case: Case, numbers: range) -> list[Outcome]:
    """Some campaigns of a case."""
    module = importlib.import_module(f"intervals.{case.instrument}")
    return [module.simulate(case, number) for number in numbers]


def run(case: Case, sets: int | None, pool: ProcessPoolExecutor | None) -> list[Row]:
    """All campaigns of a case, judged."""
    found = simulate(case, range(1))
    if sets is None:
        begin = time.perf_counter()
        found += simulate(case, range(1, 5))
        sets = MANY if (time.perf_counter() - begin) / 4 < FAST_S else FEWER
    chunks = [range(a, min(a + CHUNK, sets)) for a in range(len(found), sets, CHUNK)]
    made = (
        pool.map(simulate, [case] * len(chunks), chunks)
        if pool
        else (simulate(case, chunk) for chunk in chunks)
    )
    return judge(case, [*found, *(one for chunk in made for one in chunk)])


def label(row: Row) -> str:
    """What a row is of, in words."""
    given = ", given" if row.given else ""
    return f"{row.procedure}: {row.quantity}; {row.error}{given} {row.ratio:g} ×, {row.groups}"


def page_of(rows: Sequence[Row]) -> str:
    """Tables in Markdown: a line per quantity, error and size, a column per number of groups."""
    texts = []
    failed = [row for row in rows if row.faults]
    campaigns = [row.campaigns + row.refused for row in rows]
    texts.append(
        f"{len(rows)} rows of {min(campaigns)} to {max(campaigns)} campaigns,"
        f" {len(rows) - len(failed)} pass, {len(failed)} fail. Measured on {machine()}.\n"
    )
    for title in dict.fromkeys(f"{row.instrument}: {row.procedure}" for row in rows):
        own = [row for row in rows if f"{row.instrument}: {row.procedure}" == title]
        groups = sorted({row.groups for row in own})
        lines: dict[tuple[str, str, str], dict[int, str]] = {}
        for row in own:
            error = f"{row.error}, given" if row.given else row.error
            key = (row.quantity, error, f"{row.ratio:g}")
            lines.setdefault(key, {})[row.groups] = row.cell
        cells = [[*key, *(line.get(n, "") for n in groups)] for key, line in lines.items()]
        head = ["of", "shared error", "size", *(f"{n} groups" for n in groups)]
        texts.append(f"## {title}\n\n{table(head, cells)}")
    return "\n".join(texts)


def kept(file: Path | None) -> dict[str, list[Row]]:
    """Rows of an earlier call, by their case."""
    found: dict[str, list[Row]] = {}
    if file is not None and file.is_file():
        for line in file.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            found[entry["case"]] = [Row(**row) for row in entry["rows"]]
    return found


def main(given: Sequence[str] | None = None) -> int:
    """Simulate, print, write the page where all cases were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", help="text that a case contains; all must")
    parser.add_argument("--sets", type=int, help="campaigns of a row")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--results", type=Path, help="rows that are kept between calls")
    parser.add_argument("--page", type=Path, help="page that is written anew")
    asked = parser.parse_args(given)
    modules = [importlib.import_module(f"intervals.{name}") for name in INSTRUMENTS]
    cases = [case for module in modules for case in module.list_cases()]
    if asked.only:
        cases = [case for case in cases if all(text in str(case) for text in asked.only)]
    before, rows = kept(asked.results), list[Row]()
    context = get_context("fork")
    pool = ProcessPoolExecutor(asked.jobs, context) if asked.jobs > 1 else None
    for case in cases if asked.sets != 0 else [case for case in cases if str(case) in before]:
        begin = time.perf_counter()
        found = before.get(str(case)) or run(case, asked.sets, pool)
        rows += found
        for row in found:
            print(f"{label(row)}: {row.cell}", flush=True)
        if str(case) not in before and asked.results is not None:
            entry = {"case": str(case), "rows": [row.to_object() for row in found]}
            with asked.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
            print(f"    {time.perf_counter() - begin:.1f} s", flush=True)
    if pool:
        pool.shutdown()
    page = asked.page or (None if asked.only else PAGE)
    if page is not None:
        text = page.read_text(encoding="utf-8")
        page.write_text(replaced(text, BEGIN, END, page_of(rows)), encoding="utf-8")
    failed = [row for row in rows if row.faults]
    print(f"{len(rows)} rows, {len(failed)} fail")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
