"""Summaries on a console: in full, and as the first screen of a command, which has at most 25
lines, the verdict among the first three, one line per cause of doubt, and what to do next.
"""

from __future__ import annotations

import io
import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from calibkit.errors import visible
from calibkit.records.frame import Remark

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.report.summary import Summary
    from calibkit.report.table import Table

MOST = 25
"""Lines that a command prints at most."""
_FEWEST_ROWS = 6
"""Lines of the table that long findings leave, its heads among them."""
_LONGEST = 3
"""Lines of one finding."""
MORE = "more: --details"
STYLES: Mapping[str, str] = {"accepted": "green", "rejected": "bold red", "no verdict": ""}


def plain_text(summary: Summary) -> str:
    """A summary in full as plain text of 110 columns, the same bytes on every machine."""
    console = _text_console(110)
    show(summary, console)
    return "\n".join(_lines(console)) + "\n"


def show(summary: Summary, console: Console) -> None:
    """Print a summary in full."""
    console.print(Text(visible(summary.title), style="bold"))
    overview = summary.overview
    for line in filter(None, (overview.data_extent, overview.sentence, *overview.facts)):
        console.print(Text(visible(line)))
    for table in summary.tables:
        console.print(_draw_table(table, titled=True))
    for flag in summary.flags:
        remark = isinstance(flag, Remark)
        text = visible(flag) if remark else f"! {visible(flag)}"
        console.print(Text(text, style="" if remark else "yellow"))
    style = "" if summary.conclusion else STYLES[summary.verdict]
    console.print(Text(visible(summary.last_line), style=style))


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
    rows = []
    for table in tables:
        rows += [table.title] if len(tables) > 1 else []
        rows += _table_lines(table, width)
    wrapped_findings = [wrap(f"- {text}", width, _LONGEST) for text in findings]
    doubts = sum(map(len, wrapped_findings)) + bool(wrapped_findings)
    room = max_lines - len(head) - len(tail)
    rows = shorten(rows, max(room - doubts, min(len(rows), _FEWEST_ROWS)))
    blocks = [head, rows, _list_findings(wrapped_findings, room - len(rows)), [*tail]]
    blocks = [block for block in blocks if block]
    has_gaps = sum(map(len, blocks)) + len(blocks) - 1 <= max_lines
    lines: list[str] = []
    for block in blocks:
        lines += ["", *block] if has_gaps and lines else block
    return lines


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


def _table_lines(table: Table, width: int) -> list[str]:
    """Heads and rows of a table, a line each, with as many of its columns as fit."""
    console = _text_console(10_000)
    console.print(_draw_table(table, titled=False))
    lines = _lines(console)
    if len(table.columns) > 1 and max(map(len, lines)) > width:
        fewer = tuple(row[: len(table.columns) - 1] for row in table.rows)
        return _table_lines(replace(table, columns=table.columns[:-1], rows=fewer), width)
    return lines


def _draw_table(table: Table, *, titled: bool) -> RichTable:
    """A table for a console, its first column to the left: with title and rules, or rows alone."""
    drawn = RichTable(
        title=Text(visible(table.title)) if titled else None,
        title_justify="left",
        title_style="",
        box=box.SIMPLE_HEAD if titled else None,
        padding=(0, 1) if titled else (0, 2, 0, 0),
        pad_edge=False,
    )
    for column, head in enumerate(table.heads):
        drawn.add_column(
            Text(visible(head)), justify="right" if column else "left", overflow="fold"
        )
    for row in table.texts:
        drawn.add_row(*(Text(visible(cell, lines=titled)) for cell in row))
    return drawn


def _text_console(width: int) -> Console:
    """A console that keeps plain text, the same on every machine."""
    return Console(
        file=io.StringIO(),
        width=width,
        color_system=None,
        force_terminal=False,
        force_jupyter=False,  # a notebook would show the text, and there would be none here
        legacy_windows=False,
        _environ={},
    )


def _lines(console: Console) -> list[str]:
    """Lines that were printed on a console of text, without spaces at their ends."""
    assert isinstance(console.file, io.StringIO)  # noqa: S101 (`_text_console` made it)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]
