"""The dialect of a text log, as the recipe pins it or as it was guessed."""

from dataclasses import dataclass

from calibkit.readers.table import Guess


@dataclass(frozen=True, slots=True)
class TextColumn:
    """One column of a text log: name and unit as the log writes them (unit "" where it states
    none), and what its fields are.
    """

    name: str
    unit: str
    kind: str
    """number, time, text or empty"""
    time_format: str = ""


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text log is written; `guessed` names the keys of [logs.text] that were not pinned by
    the recipe.
    """

    encoding: str
    delimiter: str
    decimal: str
    skip_lines: int
    header_lines: int
    columns: tuple[TextColumn, ...]
    guessed: tuple[str, ...] = ()
    widths: tuple[int, ...] = ()
    renamed: bool = False
    """Whether the recipe's names stand in place of a header's."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def first_line(self) -> int:
        """Line of the first row."""
        return self.skip_lines + self.header_lines + 1

    @property
    def clean(self) -> bool:
        """Whether the strict reader of comma-separated UTF-8 reads it."""
        plain = (self.encoding, self.delimiter, self.decimal, self.skip_lines, self.header_lines)
        return plain == ("utf-8", ",", ".", 0, 1)

    def recipe_keys(self) -> dict[str, str | int | list[int]]:
        """Keys of [logs.text] that pin this dialect, with their values."""
        pinned: dict[str, str | int | list[int]] = {
            "encoding": self.encoding,
            "delimiter": self.delimiter,
            "decimal": self.decimal,
            "skip_lines": self.skip_lines,
            "header_lines": self.header_lines,
        }
        return pinned | ({"widths": list(self.widths)} if self.widths else {})

    def describe(self) -> tuple[str, ...]:
        """How the log is written, one fact per text, each guess a `Guess`."""
        pinned = (
            Guess(f"{key} = {value!r} (guessed)")
            if key in self.guessed
            else f"{key} = {value!r} (from the recipe)"
            for key, value in self.recipe_keys().items()
        )
        renamed = ["the recipe's names stand in place of the header's"] if self.renamed else []
        times = (
            Guess(f"column '{column.name}': time_format = '{column.time_format}' (guessed)")
            for column in self.columns
            if column.kind == "time"
        )
        return (*pinned, *renamed, *times)
