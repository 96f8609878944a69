"""Lines of a text log that are no rows: comments and blank lines among the rows, torn lines, a
footer, a last line that was still being written; which are left out, and what to do about one that
is refused.
"""

import itertools
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from calibkit.errors import LogFormatError, advise_exclude, format_ranges
from calibkit.numeric.arrays import Integers
from calibkit.readers import tokens
from calibkit.recipe.logs import Logs, TextSpec

Line = TypeVar("Line")
Parsed = TypeVar("Parsed")
_MOST_FOOTER = 20
"""Largest number of lines that are taken for a footer."""
_NO_ROW = {
    blank: re.compile(rf"(?m)^(?:{blank}|{tokens.COMMENT.pattern}.*)$", re.IGNORECASE)
    for blank in ("[ \t]*", "[ ]*", "(?!)")
}
"""A blank line, or a comment, by what is blank: a tab may part two empty fields, and an empty line
be the one empty field of a row.
"""


@dataclass(slots=True)
class Torn:
    """Torn lines of a log: how many there are, notes on them, and which the recipe excludes."""

    file: str
    spec: TextSpec
    excluded: Collection[int]
    """Lines that the recipe leaves out."""
    notes: list[str] = field(default_factory=list)
    left_out: list[int] = field(default_factory=list)
    """Excluded lines that were no rows."""
    count: int = 0
    cut: bool = False
    """Whether a last line that was still being written is left out."""

    @classmethod
    def of(cls, file: str, logs: Logs) -> "Torn":
        """The account of a log in which nothing was found yet."""
        return cls(file, logs.text, logs.excluded_lines(file))

    @property
    def any(self) -> bool:
        """Whether a line is left out."""
        return bool(self.count or self.left_out)

    def cut_lines(self, content: str) -> list[str]:
        """Lines of a text without its footer and, where the recipe says so, a last line without a
        line end; raises LogFormatError where none is left.
        """
        lines = content.rstrip("\n").split("\n")
        lines = lines[: len(lines) - self.spec.footer_lines]
        ended = content.endswith("\n") or self.spec.footer_lines
        if self.spec.last_line == "drop" and not ended:
            self.drop_last(len(lines))
            lines.pop()
        if not lines:
            raise no_rows(self.file)
        return lines

    def drop_last(self, line: int) -> None:
        """Note a last line without a line end, which is left out."""
        self.cut = True
        self.notes.append(
            f'line {line}, the last, has no line end and was left out: last_line = "drop"'
        )

    def drop(self, lines: Sequence[int], error: LogFormatError) -> None:
        """Note torn lines, where the recipe excludes them or allows as many; else raise the
        error.
        """
        torn_lines = [line for line in lines if line not in self.excluded]
        self.count += len(torn_lines)
        if torn_lines and self.spec.torn_lines == "refuse":
            raise error
        numbers = format_ranges(torn_lines)
        if self.count > self.spec.torn_limit:
            raise LogFormatError(
                f"{self.file}: {self.count} torn lines ({numbers}), expected at most"
                f" torn_limit = {self.spec.torn_limit}",
                hint="look at them; raise torn_limit in [logs.text], or repair the log",
            )
        if torn_lines:
            self.notes.append(
                f'{len(torn_lines)} torn line(s) left out, line {numbers}: torn_lines = "drop"'
            )
        self.left_out += [line for line in lines if line in self.excluded]

    def parse(
        self, numbered: Iterable[tuple[int, Line]], parse: Callable[[int, Line], Parsed]
    ) -> dict[int, Parsed]:
        """Line → what a parser makes of it; lines at which it raises LogFormatError are torn."""
        parsed, errors = {}, {}
        for number, line in numbered:
            try:
                parsed[number] = parse(number, line)
            except LogFormatError as error:
                errors[number] = error
        if errors:
            self.drop(list(errors), next(iter(errors.values())))
        return parsed


@dataclass(slots=True)
class TextRows:
    """Lines of a text log that hold its rows: their text, and the line of each; those that were
    left out, and notes on them.
    """

    file: str
    body: str
    lines: Integers
    numbers: Integers
    """Number of each row among the rows of the log, from 0, torn ones counted."""
    torn: Torn

    @classmethod
    def among(cls, body: str, blank: str, first: int, file: str, logs: Logs) -> "TextRows":
        """Rows of a text that begins in line `first`, without comments and, of what is `blank`,
        blank lines.
        """
        texts, odd = body.split("\n") if _NO_ROW[blank].search(body) else [], []
        if texts:
            odd = [k for k, text in enumerate(texts) if _NO_ROW[blank].fullmatch(text)]
        lines = np.arange(first, first + body.count("\n") + 1)
        rows = cls(file, body, lines, lines, Torn.of(file, logs))
        rows._remove(np.array(odd, dtype=np.int64))
        rows.numbers = np.arange(rows.lines.size)
        for line_kind, commented in (("comment(s) among the rows", True), ("blank line(s)", False)):
            left_out = [first + k for k in odd if tokens.is_comment(texts[k]) == commented]
            if left_out:
                rows.torn.notes.append(
                    f"{len(left_out)} {line_kind} left out, line {format_ranges(left_out)}"
                )
        return rows

    @property
    def texts(self) -> list[str]:
        """Text of each row."""
        return self.body.split("\n")

    def _remove(self, rows: Integers) -> None:
        """Take rows out; raises LogFormatError where none is left."""
        if not rows.size:
            return
        remaining = np.ones(self.lines.size, dtype=bool)
        remaining[rows] = False
        self.body = "\n".join(itertools.compress(self.texts, remaining))
        self.lines, self.numbers = self.lines[remaining], self.numbers[remaining]
        if not self.lines.size:
            raise no_rows(self.file)

    def drop_last(self) -> None:
        """Leave out the last line, which has no line end."""
        self.torn.drop_last(int(self.lines[-1]))
        self._remove(np.array([self.lines.size - 1]))

    def drop_torn(self, torn: Integers, error: LogFormatError) -> None:
        """Leave out torn rows, where the recipe excludes them or allows as many; else raise the
        error.
        """
        self.torn.drop([int(line) for line in self.lines[torn]], error)
        self._remove(torn)


def no_rows(file: str) -> LogFormatError:
    """The error of a log without a row."""
    return LogFormatError(
        f"{file}: a header but no rows",
        hint="expected one row per instant; remove it or copy it again",
    )


def advise_torn(file: str, line: int) -> str:
    """What to do about a line with another number of fields than the rows."""
    return (
        "the row is cut short, torn or holds an extra separator: repair it, or leave such rows out:"
        f' torn_lines = "drop" in [logs.text], or {advise_exclude(file, lines=[line])}'
    )


@dataclass(frozen=True, slots=True)
class Advice:
    """What to do about a line that is no row, from the lines and the layout of the rows around
    it.
    """

    file: str
    texts: Sequence[str]
    lines: Sequence[int] | Integers
    fields: int
    delimiter: str
    decimal: str
    open_end: bool
    """Whether the last line has no line end."""
    widths: Sequence[int] = ()

    def of_fields(self, row: int) -> str:
        """Advice on a row with another number of fields than the header."""
        field_count = len(tokens.split_line(self.texts[row], self.delimiter, self.widths))
        if self.delimiter == "," and field_count > self.fields and self._all_have(field_count):
            return (
                "decimal commas between commas? Export with semicolons or tabs between the columns"
                " and set decimal = ',' in [logs.text]"
            )
        if not self.open_end and (footer := self._count_footer(row)):
            return self._advise_footer(footer)
        if self.open_end and row == len(self.texts) - 1:
            return (
                'the last line is incomplete: copy the log again, or set last_line = "drop" in'
                " [logs.text]"
            )
        return advise_torn(self.file, int(self.lines[row]))

    def of_token(self, row: int, token: str) -> str:
        """Advice on a field that is not a number."""
        other = "," if self.decimal == "." else "."
        if tokens.is_number(token, other):
            if self.delimiter == "," == other:
                return (
                    "decimal comma? Set decimal = ',' in [logs.text]; thousands? Set decimal = '.'"
                )
            mark = "comma" if other == "," else "point"
            return f"decimal {mark}? Set decimal = '{other}' in [logs.text]"
        if not self.open_end and (footer := self._count_footer(row)):
            return self._advise_footer(footer)
        return (
            'repair the row, or leave it out: torn_lines = "drop" in [logs.text], or'
            f" {self._exclude(row)}"
        )

    def _exclude(self, row: int) -> str:
        """An exclusion of the line of a row."""
        return advise_exclude(self.file, lines=[int(self.lines[row])])

    def _all_have(self, fields: int) -> bool:
        """Whether most rows have so many fields."""
        counts = [
            len(tokens.split_line(text, self.delimiter, self.widths)) for text in self.texts[:200]
        ]
        return 2 * counts.count(fields) > len(counts)

    def _count_footer(self, row: int) -> int:
        """Lines from the first line of a footer to the end, if a row and all behind it are a
        footer's; else 0.
        """
        start = max(0, len(self.texts) - _MOST_FOOTER)
        firsts = [
            tokens.split_line(text, self.delimiter, self.widths)[0] for text in self.texts[start:]
        ]
        rows = [
            k
            for k, first in enumerate(firsts, start)
            if tokens.is_measured(first) or tokens.is_sentinel(first)
        ]
        if not rows or rows[-1] >= row:
            return 0
        return int(self.lines[-1]) - int(self.lines[rows[-1] + 1]) + 1

    @staticmethod
    def _advise_footer(lines: int) -> str:
        """Advice on a footer."""
        return f"a footer? Set footer_lines = {lines} in [logs.text]"
