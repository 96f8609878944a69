"""Lines of a text log that are no rows: torn lines, a footer, a last line that was still being
written; which are left out, and what to do about one that is refused.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from calibkit.errors import LogFormatError, advise_exclude, format_ranges
from calibkit.recipe.logs import Logs, TextSpec

Line = TypeVar("Line")
Parsed = TypeVar("Parsed")


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
