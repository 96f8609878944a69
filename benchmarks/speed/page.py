"""The table as Markdown, and the page of the documentation that holds it."""

from __future__ import annotations

import os
import platform
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from speed.goals import Goal, Line
    from speed.pairs import Spread

BEGIN, END = (
    "<!-- measured: benchmarks/run.py writes what stands below -->",
    "<!-- end of what is measured -->",
)
MEBI = 1 << 20


def machine() -> str:
    """Processors, memory and Python of this machine, without its name."""
    model = ""
    if Path("/proc/cpuinfo").is_file():
        found = re.search(
            r"^model name\s*:\s*(.+)$",
            Path("/proc/cpuinfo").read_text(encoding="utf-8"),
            re.MULTILINE,
        )
        model = f" ({found[1]})" if found else ""
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = (
            f", {os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB of"
            " memory"
        )
    return (
        f"{os.cpu_count()} processors{model}{memory}, {platform.system()}, Python"
        f" {platform.python_version()}"
    )


def load() -> str:
    """How busy the machine is, in words; nothing where the system does not tell."""
    return (
        f"load average {os.getloadavg()[0]:.1f} before the first row"
        if hasattr(os, "getloadavg")
        else ""
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [
        head,
        ["---"] * len(head),
        *([cell.replace("|", "\\|") for cell in row] for row in rows),
    ]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def summary(goals: Sequence[Goal], lines: Sequence[Line]) -> str:
    """One row a goal: the target, what was measured at the rows it holds at, and whether that meets
    it.
    """
    rows = []
    for goal in goals:
        found = _at_target(goal, lines)
        if found is None:
            rows.append([goal.title, goal.peer, _wanted(goal), "not measured", "", ""])
            continue
        at = f"{_count(found.rows)} {goal.rows_are}" if found.rows > 1 else f"a {goal.rows_are}"
        if not found.ratios:
            rows.append([goal.title, goal.peer, _wanted(goal), f"{found.said} at {at}", "", "no"])
            continue
        ratio = found.ratios[goal.clock]
        measured = (
            f"**{_times(ratio.median)}** ({_times(ratio.least)} to {_times(ratio.largest)}) at {at}"
        )
        rows.append(
            [
                goal.title,
                goal.peer,
                _wanted(goal),
                measured,
                _digits(found.digits),
                _verdict(goal, found),
            ]
        )
    return table(("part", "beside", "target", "measured", "digits that agree", "reached"), rows)


def notes(goals: Sequence[Goal]) -> str:
    """What both sides of a goal do, where its title does not say it."""
    return "".join(f"- {goal.title}: {goal.note}.\n" for goal in goals if goal.note)


def growth(goals: Sequence[Goal], lines: Sequence[Line]) -> str:
    """One row a goal and size: ratios by both clocks, memory, and how the time of both sides grew
    from the size before.
    """
    rows = []
    for goal in (
        goal for goal in goals if goal.clock != "peak"
    ):  # the same commands stand there with their time
        before: Line | None = None
        for line in [line for line in lines if line.name == goal.name]:
            clocks = [
                _spread(line.ratios[clock]) if clock in line.ratios else line.said
                for clock in ("cpu", "wall")
            ]
            rows.append(
                [
                    goal.title,
                    _count(line.rows),
                    *clocks,
                    _pair(line.peaks, _mebibytes),
                    _grown(line, before),
                ]
            )
            before = line
    head = (
        "part",
        "rows",
        "ratio, processor time",
        "ratio, wall time",
        "memory [MiB], both",
        "time grew, both",
    )
    return table(head, rows)


def _grown(line: Line, before: Line | None) -> str:
    """How the time of both sides grew from the size before."""
    if before is None or before.rows >= line.rows or not before.seconds[0] or not line.seconds[0]:
        return ""
    shares = tuple(
        now / then if then else 0.0 for now, then in zip(line.seconds, before.seconds, strict=True)
    )
    return f"{_pair(shares, _times)} for {line.rows / before.rows:.3g} ×"


def _mebibytes(size: float) -> str:
    return f"{size / MEBI:.0f}"


def _pair(values: tuple[float, float], said: Callable[[float], str]) -> str:
    """Of calibkit and of the peer; a dash where nothing was measured."""
    return " / ".join(said(value) if value else "–" for value in values) if any(values) else ""


def measured(
    goals: Sequence[Goal], lines: Sequence[Line], versions: Mapping[str, str], conditions: str
) -> str:
    """What stands between the markers of the page; `conditions` say under which it was measured."""
    packages = ", ".join(
        f"{name} {number}" for name, number in sorted(versions.items()) if name != "Python"
    )
    return (
        f"{summary(goals, lines)}\nMeasured on {machine()}; {conditions}. Versions: {packages}.\n"
    )


def replaced(page: str, begin: str, end: str, text: str) -> str:
    """The page with what is between two marks replaced; raises ValueError where it has none."""
    start, stop = page.find(begin), page.find(end)
    if start < 0 or stop < start:
        raise ValueError(f"the page has no lines {begin!r} and {end!r}")
    return f"{page[: start + len(begin)]}\n\n{text}\n{page[stop:]}"


def _at_target(goal: Goal, lines: Sequence[Line]) -> Line | None:
    """The line of the rows that the target holds at, else the largest one measured."""
    own = [line for line in lines if line.name == goal.name]
    own = [line for line in own if line.ratios] or own
    exact = [line for line in own if abs(line.rows - goal.at_rows) <= 0.01 * goal.at_rows]
    return (exact or own or [None])[-1]


def _wanted(goal: Goal) -> str:
    """Target in words, with the reach."""
    if goal.target is None:
        return "–"
    sign = "≥" if goal.faster else "≤"
    reach = f" (aim {goal.reach:g} ×)" if goal.reach is not None else ""
    return f"{sign} {goal.target:g} ×{reach}"


def _verdict(goal: Goal, line: Line) -> str:
    """Whether the target is met by the median, and the digits too."""
    if goal.digits is not None and (line.digits is None or line.digits < goal.digits):
        return f"no: {goal.digits:g} digits wanted"
    if goal.target is None:
        return "–"
    if abs(line.rows - goal.at_rows) > 0.01 * goal.at_rows:
        return "not measured at its rows"
    return "yes" if goal.reached(line.ratios[goal.clock].median) else "no"


def _digits(digits: float | None) -> str:
    """Agreeing digits in words."""
    if digits is None:
        return "–"
    return "all" if digits >= 17.0 else f"{digits:.1f}"


def _spread(ratio: Spread) -> str:
    return f"{_times(ratio.median)} ({_times(ratio.least)} to {_times(ratio.largest)})"


def _times(ratio: float) -> str:
    """A ratio in three figures at most."""
    return f"{ratio:.0f} ×" if ratio >= 100.0 else f"{ratio:.3g} ×"


def _count(rows: int) -> str:
    """Rows with thousands apart."""
    return f"{rows:,}"
