"""What can go wrong, one class a kind, each with the exit code that a script can rely on."""

import unicodedata
from collections.abc import Iterable, Sequence

_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories that a terminal obeys instead of showing them: control characters, marks of
direction, separators of lines.
"""


def visible(text: str, *, lines: bool = False) -> str:
    """Text whose control characters, marks of direction and, unless `lines`, line breaks are shown
    as escapes: names in it come from files that anybody may have written.
    """
    if text.isprintable():
        return text
    return "".join(
        character.encode("unicode_escape").decode("ascii")
        if unicodedata.category(character) in _UNSEEN and not (lines and character == "\n")
        else character
        for character in text
    )


class CalibkitError(Exception):
    """Anything calibkit refuses to do, with one line that says where, what was found, what was
    expected, what to do.
    """

    exit_code = 70
    code = "internal"
    many_lines = False
    """Whether a message may state several faults, each on its own line."""

    def __init__(self, message: str, *, hint: str = "") -> None:
        self.message = visible(message, lines=self.many_lines)
        self.hint = visible(hint)
        super().__init__(self.message)

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message


class UsageError(CalibkitError):
    """The command was called with something that cannot be meant."""

    exit_code = 2
    code = "usage"


class RecipeError(CalibkitError):
    """A recipe has an unknown, missing or ill-typed key; every fault is a line of the message.

    `at` is the table and key that is at fault, for the loader to name its line.
    """

    exit_code = 2
    code = "recipe"
    many_lines = True

    def __init__(self, message: str, *, hint: str = "", at: tuple[str | int, ...] = ()) -> None:
        super().__init__(message, hint=hint)
        self.at = at


class LogFormatError(CalibkitError):
    """A log cannot be read whole."""

    exit_code = 3
    code = "log_format"


class SeveralTablesError(LogFormatError):
    """A file of several tables, of which the recipe names none."""

    def __init__(self, message: str, *, hint: str, tables: Sequence[str]) -> None:
        super().__init__(message, hint=hint)
        self.tables = tuple(tables)


class NamelessColumnsError(LogFormatError):
    """A log has no line of names and the recipe lists none; `columns` is their number."""

    def __init__(self, message: str, *, hint: str = "", columns: int = 0) -> None:
        super().__init__(message, hint=hint)
        self.columns = columns


class FrameError(CalibkitError):
    """A log was read but its content is unusable."""

    exit_code = 3
    code = "frame"
    many_lines = True


class MissingColumnError(FrameError):
    """A log lacks columns; `columns` are the canonical ones that have to be mapped."""

    def __init__(self, message: str, *, hint: str = "", columns: tuple[str, ...] = ()) -> None:
        super().__init__(message, hint=hint)
        self.columns = columns


class FitError(CalibkitError):
    """The data cannot determine what the recipe asks for."""

    exit_code = 3
    code = "fit"


class CoefficientError(CalibkitError):
    """A coefficient file, a run or its digest is not what it claims to be."""

    exit_code = 4
    code = "coefficients"


class OutputError(CalibkitError):
    """Something could not be written, or would have been overwritten."""

    exit_code = 4
    code = "output"


class TakenError(OutputError):
    """Another process has written the revision that was to be written."""


class NotCheckedError(CalibkitError):
    """Something was not checked, because an optional library is missing: neither good nor bad."""

    exit_code = 5
    code = "not_checked"


class StoppedError(CalibkitError):
    """Someone stopped the command; the message states what it had finished."""

    exit_code = 130
    code = "interrupted"


def list_ranges(numbers: Iterable[int]) -> list[int | str]:
    """Ascending numbers as ranges, as `rows` and `lines` of a recipe take them: [3, "7-12", 40]."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return [a if a == b else f"{a}-{b}" for a, b in runs]


def format_ranges(numbers: Iterable[int], max_ranges: int = 8) -> str:
    """Ascending numbers as ranges: 3, 7-12, 40."""
    ranges = list_ranges(numbers)
    omission = f" and {len(ranges) - max_ranges} more ranges" if len(ranges) > max_ranges else ""
    return ", ".join(map(str, ranges[:max_ranges])) + omission


def advise_exclude(log: str, **part: object) -> str:
    """An [[exclude]] of a log or a part of it on one line, for the head of a recipe or `--set`."""
    import json  # not before a command needs it

    keys = {"log": log, **part, "reason": "…", "person": "…"}
    written = ", ".join(
        f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in keys.items()
    )
    return f"[[exclude]], above the first table of the recipe: exclude = [{{ {written} }}]"


def did_you_mean(name: str, known_words: Iterable[str], otherwise: str) -> str:
    """Advice that names the known word closest to one that is not known; `otherwise` where none is
    close.
    """
    import difflib  # not before a name is wrong

    close = difflib.get_close_matches(name, known_words, n=1)
    return f"did you mean '{close[0]}'?" if close else otherwise
