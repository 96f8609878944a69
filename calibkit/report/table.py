"""One record for every table that a person or a script reads: typed cells, and their texts, CSV and
JSON.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

_NUMBER = re.compile(r"[-−+±<≤≥]? ?\d[\d.,]*+(?!/)")
"""How a text that states a number begins; 1/deg is a unit."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number with digits of its own, in a column of other digits: value and, where `u_digits`
    asks for it, ± standard uncertainty (format specifications).
    """

    value: float
    digits: str = ".4g"
    standard_uncertainty: float = 0.0
    u_digits: str = ""

    def __str__(self) -> str:
        value_text = format(self.value, self.digits)
        if not self.u_digits:
            return value_text
        return f"{value_text} ± {format(self.standard_uncertainty, self.u_digits)}"


Cell = str | int | float | Number | None


@dataclass(frozen=True, slots=True)
class Column:
    """What people read above the cells of a column, and how they read its numbers.

    `digits` is a format specification (empty: every digit), `key` the name in JSON and CSV (empty:
    the head); `missing` stands where there is no number, `zero` for 0 where that means that nothing
    is stated.
    """

    head: str
    digits: str = ""
    key: str = ""
    unit: str = ""
    missing: str = "-"
    zero: str = ""

    def text(self, cell: Cell) -> str:
        """A cell of this column as people read it."""
        if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
            return self.missing
        if isinstance(cell, float):
            return self.zero if self.zero and not cell else format(cell, self.digits)
        return str(cell)


@dataclass(frozen=True, slots=True)
class Table:
    """A titled table; a column of texts may be given by its head alone."""

    title: str
    columns: tuple[Column | str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    failed: tuple[int, ...] = ()
    """Rows, from 0, that tell of a limit that failed."""

    @property
    def formats(self) -> tuple[Column, ...]:
        """Every column in full."""
        return tuple(
            column if isinstance(column, Column) else Column(column) for column in self.columns
        )

    @property
    def heads(self) -> tuple[str, ...]:
        """What people read above the columns."""
        return tuple(column.head for column in self.formats)

    @property
    def texts(self) -> tuple[tuple[str, ...], ...]:
        """The rows as people read them."""
        texts = []
        for row in self.rows:
            cells = (*row, *("",) * (len(self.columns) - len(row)))
            columns = zip(self.formats, cells, strict=True)
            texts.append(tuple(column.text(cell) for column, cell in columns))
        return tuple(texts)

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Whether a column holds numbers, which are set to the right; the first one names rows."""
        rows = self.texts
        holds_numbers = [False]
        for k, column in enumerate(self.formats[1:], start=1):
            unstated = ("", "-", "–", "—", column.missing, column.zero)
            stated = [row[k] for row in rows if row[k] not in unstated]
            holds_numbers.append(all(_NUMBER.match(text) for text in stated))
        return tuple(holds_numbers)

    def to_objects(self) -> list[dict[str, Any]]:
        """One JSON object per row; null stands where there is no number."""
        keys = self._keys()
        return [dict(zip(keys, map(_plain, row), strict=True)) for row in self.rows]

    def to_csv(self) -> str:
        """CSV with LF endings; numbers read back to the same float64, an empty field stands where
        there is none.
        """
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self._keys())
        writer.writerows(map(_plain, row) for row in self.rows)
        return buffer.getvalue()

    def _keys(self) -> list[str]:
        """Names of the columns in JSON and CSV."""
        return [column.key or column.head for column in self.formats]


def tabulate(title: str, columns: Sequence[Column | str], records: Iterable[object]) -> Table:
    """Table of records, one row each: a column holds the attribute that its key names."""
    full = tuple(column if isinstance(column, Column) else Column(column) for column in columns)
    return Table(
        title,
        full,
        tuple(
            tuple(getattr(record, column.key or column.head) for column in full)
            for record in records
        ),
    )


def number_or_none(value: float | None) -> float | None:
    """A finite number, or None: JSON has no NaN and no infinity."""
    return value if value is not None and math.isfinite(value) else None


def _plain(cell: Cell) -> str | float | None:
    """A cell as JSON and CSV hold it."""
    value = cell.value if isinstance(cell, Number) else cell
    return number_or_none(value) if isinstance(value, float) else value
