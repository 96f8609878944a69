"""Every row of the table of speed, calibkit beside its packaged peer: one command.

    python benchmarks/run.py                all at 1e5, 1e6 and 1e7 rows; writes docs/performance.md
    python benchmarks/run.py --only denoise --rows 1e6
    python benchmarks/run.py --quick        all on little data, to see that everything runs

Both sides run on the same data in turn, A B A B, each in a process of its own, after a warm-up;
printed are the medians and the range of the ratios of the turns, and to how many digits both gave
the same numbers. Each peer is installed by pip into an environment of its own (--environments),
because they pin old libraries; versions are in speed/peers.py. Exit code 1 where a target is missed
or the numbers differ. What a busy machine adds to wall times it adds to both sides, but not evenly:
targets are held against processor times where a side uses one thread.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from speed import commands, page, pairs, peers, release  # noqa: E402 the repository is found first
from speed.goals import Goal, Line  # noqa: E402
from speed.page import replaced  # noqa: E402
from speed.rows import ROWS, Row  # noqa: E402

from calibkit import native  # noqa: E402 the repository is found first

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

COMMANDS = (*commands.COMMANDS, *release.COMMANDS)
PAGE = ROOT / "docs" / "performance.md"
SIZES = "1e5,1e6,1e7"
QUICK = "2560"


def goals() -> list[Goal]:
    """Every row's goal, in the order of the table."""
    first = [row.goal for row in ROWS]
    return first + [goal for command in COMMANDS for goal in command.goals]


def arguments(given: Sequence[str] | None) -> argparse.Namespace:
    """What is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--rows", default=None, help=f"sizes with commas between them; {SIZES} unless given"
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=[goal.name for goal in goals()],
        help="a row; may be repeated",
    )
    parser.add_argument(
        "--quick", action="store_true", help=f"{QUICK} rows, two turns, nothing is written"
    )
    parser.add_argument("--turns", type=int, default=7, help="turns of both sides at most")
    parser.add_argument(
        "--budget", type=float, default=40.0, help="seconds after which a row takes no further turn"
    )
    parser.add_argument(
        "--environments",
        type=Path,
        default=peers.cache(),
        help="where the peers' environments are kept",
    )
    parser.add_argument(
        "--here",
        action="store_true",
        help="peers of this environment instead; those absent are left out",
    )
    parser.add_argument(
        "--results",
        type=Path,
        help="a JSON file of what was measured: rows measured now replace theirs",
    )
    parser.add_argument(
        "--page", type=Path, help="write this page; docs/performance.md after a run of every row"
    )
    asked = parser.parse_args(given)
    # said before hours of measuring, not after them
    if asked.page is not None and not writable(asked.page):
        parser.error(
            f"--page {asked.page}: expected a page with the lines {page.BEGIN} and {page.END}"
        )
    return asked


def writable(place: Path) -> bool:
    """Whether a page is there and has the two lines between which what is measured is written."""
    text = place.read_text(encoding="utf-8") if place.is_file() else ""
    return -1 < text.find(page.BEGIN) < text.find(page.END)


def measured_row(
    row: Row, rows: int, sides: tuple[pairs.Worker, pairs.Worker], turns: int, budget_s: float
) -> Line:
    """One row at one size, of calibkit alone where the peer is not given so many rows."""
    goal, (ours, theirs) = row.goal, sides
    data = row.data(rows)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {key: str(folder / f"{key}.npy") for key in data.arrays}
        for key, path in files.items():
            np.save(path, data.arrays[key])
        data.arrays.clear()
        settings = data.settings
        if row.side == "read_log":
            settings = {"path": str(folder / "log.csv")}
            theirs.ask("load", side="write_log", files=files, settings=settings)
            theirs.ask("once", times=1)
            files = {}
        ours.ask("load", side=row.side, files=files, settings=settings)
        if rows > row.peer_rows:
            said = f"{goal.peer} stopped at {row.peer_rows:,}: too slow"
            peak, taken = ours.ask("weigh")["bytes"], ours.ask("once", times=1)
            return Line(goal.name, data.rows, {}, (taken[goal.clock], 0.0), (peak, 0), None, said)
        theirs.ask("load", side=row.side, files=files, settings=settings)
        found = pairs.measure(ours, theirs, turns=turns, budget_s=budget_s)
    ratios = {clock: found.ratio(clock, faster=goal.faster) for clock in ("cpu", "wall")}
    seconds = (found.seconds("ours", goal.clock), found.seconds("theirs", goal.clock))
    return Line(
        goal.name, data.rows, ratios, seconds, (found.ours_bytes, found.theirs_bytes), found.digits
    )


def measure(
    asked: argparse.Namespace, said: Callable[[Line], None]
) -> tuple[list[Line], dict[str, str]]:
    """Measure the rows asked for; also the versions of what took part."""
    sizes = [
        round(float(size)) for size in (asked.rows or (QUICK if asked.quick else SIZES)).split(",")
    ]
    turns = 2 if asked.quick else asked.turns
    chosen = set(asked.only or [goal.name for goal in goals()])
    versions: dict[str, str] = {}

    @functools.cache
    def python(peer: str) -> Path:
        return Path(sys.executable) if asked.here else peers.environment(peer, asked.environments)

    lines: list[Line] = []

    def add(line: Line) -> None:
        lines.append(line)
        said(line)

    with pairs.Worker(sys.executable, "ours") as ours:
        versions |= ours.ask("versions", packages=["calibkit", "numpy", "scipy", "pandas"])[
            "versions"
        ]
        for row in (row for row in ROWS if row.goal.name in chosen):
            with pairs.Worker(python(row.goal.peer), "theirs") as theirs:
                versions |= theirs.ask("versions", packages=[row.goal.peer])["versions"]
                for rows in sizes:
                    add(measured_row(row, rows, (ours, theirs), turns, asked.budget))
    for command in COMMANDS:
        if named := [goal for goal in command.goals if goal.name in chosen]:
            for rows in command.sizes(sizes):
                for line in command.run(named, rows, min(turns, 3), python):
                    add(line)
    return lines, versions


def merged(
    asked: argparse.Namespace, lines: list[Line], versions: dict[str, str]
) -> tuple[list[Line], dict[str, str]]:
    """With the rows of an earlier run that were not measured now, where a file of results is named;
    it is written anew.
    """
    if asked.results is None:
        return lines, versions
    if asked.results.is_file():
        before = json.loads(asked.results.read_text(encoding="utf-8"))
        fresh = {line.name for line in lines}
        lines = [
            *(Line.of_json(entry) for entry in before["lines"] if entry["name"] not in fresh),
            *lines,
        ]
        versions = before["versions"] | versions
    kept = {"lines": [line.as_json() for line in lines], "versions": versions}
    asked.results.parent.mkdir(parents=True, exist_ok=True)
    asked.results.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return lines, versions


def tell(line: Line) -> None:
    """One line on the terminal as soon as it is known."""
    ratios = ", ".join(f"{clock} {spread}" for clock, spread in line.ratios.items())
    digits = "" if line.digits is None else f", {line.digits:.1f} digits"
    print(
        f"{time.strftime('%H:%M:%S')} {line.name} {line.rows:,}: {ratios}{digits}{line.said}",
        file=sys.stderr,
        flush=True,
    )


def main(given: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the page."""
    asked = arguments(given)
    conditions = f"{page.load()}, compiled kernels {native.state()}"
    lines, versions = merged(asked, *measure(asked, tell))
    shown = [goal for goal in goals() if any(line.name == goal.name for line in lines)]
    print(page.summary(shown, lines))
    print(page.notes(shown))
    print(page.growth(shown, lines))
    whole = not (asked.only or asked.quick or asked.rows or asked.here)
    if place := asked.page or (PAGE if whole else None):
        text = replaced(
            place.read_text(encoding="utf-8"),
            page.BEGIN,
            page.END,
            page.measured(goals(), lines, versions, conditions),
        )
        place.write_text(text, encoding="utf-8")
    return int(any(missed(goal, lines) for goal in shown))


def missed(goal: Goal, lines: Sequence[Line]) -> bool:
    """Whether the numbers differ at any size, or the target is missed at the rows it holds at."""
    own = [line for line in lines if line.name == goal.name and line.ratios]
    differ = any(goal.digits is not None and (line.digits or 0.0) < goal.digits for line in own)
    return differ or any(
        not goal.reached(line.ratios[goal.clock].median)
        for line in own
        if abs(line.rows - goal.at_rows) <= 0.01 * goal.at_rows
    )


if __name__ == "__main__":
    sys.exit(main())
