"""The first screen of a command: at most 25 lines, the verdict among the first three, one line per
cause of doubt, and what to do next.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from calibkit.errors import visible

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.report.summary import Summary
    from calibkit.report.table import Table

MOST = 25
"""Lines that a command prints at most."""
_FEWEST_ROWS = 6
"""Lines of the table that long findings leave, its heads among them."""
_LONGEST = 3
"""Lines of one finding."""
MORE = "more: --details"


def compose_screen(
    summary: Summary, tail: Sequence[str], width: int, *, max_lines: int = MOST
) -> list[str]:
    """Lines of a screen: whose result, the verdict, what was found, a line per ramp or run, what to
    check, and the tail, as it is.
    """
    overview = summary.overview
    title_line = f"{summary.title}{f' · {overview.data_extent}' if overview.data_extent else ''}"
    texts = (title_line, summary.last_line, overview.sentence, *overview.facts)
    tables = summary.tables if overview.table is None else (overview.table,)
    return arrange(texts, tables, summary.checks, tail, width, max_lines=max_lines)


def arrange(
    texts: Sequence[str],
    tables: Sequence[Table],
    findings: Sequence[str],
    tail: Sequence[str],
    width: int,
    *,
    max_lines: int = MOST,
) -> list[str]:
    """Lines of a screen of its parts; of rows and findings as many as there is room for, and how
    many more there are.
    """
    head = [line for text in texts for line in wrap(text, width, 2)]
    rows = [
        line
        for table in tables
        for line in ([table.title] if len(tables) > 1 else []) + _align(table, width)
    ]
    wrapped_findings = [wrap(f"- {text}", width, _LONGEST) for text in findings]
    doubts = sum(map(len, wrapped_findings)) + bool(wrapped_findings)
    room = max_lines - len(head) - len(tail)
    rows = shorten(rows, max(room - doubts, min(len(rows), _FEWEST_ROWS)))
    blocks = [[*head], rows, _list_findings(wrapped_findings, room - len(rows)), [*tail]]
    blocks = [block for block in blocks if block]
    has_gaps = sum(map(len, blocks)) + len(blocks) - 1 <= max_lines
    return [
        line
        for number, block in enumerate(blocks)
        for line in (["", *block] if has_gaps and number else block)
    ]


def shorten(lines: Sequence[str], max_lines: int = MOST) -> list[str]:
    """The first lines, and how many more there are where that is not all."""
    if len(lines) <= max_lines:
        return [*lines]
    kept_count = max(max_lines - 1, 0)
    return [*lines[:kept_count], f"{len(lines) - kept_count} {MORE}"][:max_lines]


def _list_findings(wrapped_findings: Sequence[Sequence[str]], max_lines: int) -> list[str]:
    """Findings under their heading as far as there is room, and how many more there are."""
    if not wrapped_findings:
        return []
    lines = [f"Please check ({len(wrapped_findings)})"]
    for number, finding in enumerate(wrapped_findings):
        last = number == len(wrapped_findings) - 1
        if len(lines) + len(finding) > max_lines - (not last):
            return [*lines, f"{len(wrapped_findings) - number} {MORE}"]
        lines += finding
    return lines


def wrap(text: str, width: int, max_lines: int) -> list[str]:
    """A text in lines of a width, at most so many; words and paths are not broken."""
    return textwrap.wrap(
        visible(text),
        width,
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
        max_lines=max_lines,
        placeholder=" … (--details)",
    )


def _align(table: Table, width: int) -> list[str]:
    """Heads and rows of a table as lines, numbers to the right, with as many columns as fit."""
    rows = [table.heads, *table.texts]
    count = max(map(len, rows))
    cells = [[visible(cell) for cell in (*row, *[""] * (count - len(row)))] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    while len(widths) > 1 and sum(widths) + 2 * len(widths) > width:
        widths.pop()
    return [
        "  ".join(
            cell.rjust(size) if position else cell.ljust(size)
            for position, (cell, size) in enumerate(zip(row, widths, strict=False))
        ).rstrip()
        for row in cells
    ]
