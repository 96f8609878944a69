"""What a text log looks like: encoding, delimiter, decimal mark, preamble, header, units and kinds
of its columns.

A guess is a record that can be printed (`lines`) and turned into a recipe (`table`). Only the first
lines are looked at; the reader then holds the whole file against the guess and refuses the first
line that contradicts it. Where two readings are both possible and would give different numbers
nothing is guessed: the log is refused with what to pin.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import encoding as encodings
from calibkit.readers import times, tokens
from calibkit.recipe.logs import TextSpec

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

HEAD_LINES = 400
"""Lines that are looked at."""
HEAD_BYTES = 1 << 20
"""Bytes that are looked at when a log is only guessed at, not read."""
MOST_PREAMBLE = 120
"""Lines above the first row beyond which a log is not understood."""
DELIMITERS = ("\t", ";", ",", "|", "space")


@dataclass(frozen=True, slots=True)
class ColumnGuess:
    """One column: its name and unit as the log writes them (unit "" where it states none), and what
    its fields are.
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
    columns: tuple[ColumnGuess, ...]
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

    def table(self) -> dict[str, str | int | list[int]]:
        """Keys of [logs.text] that pin this dialect."""
        pinned: dict[str, str | int | list[int]] = {
            "encoding": self.encoding,
            "delimiter": self.delimiter,
            "decimal": self.decimal,
            "skip_lines": self.skip_lines,
            "header_lines": self.header_lines,
        }
        return pinned | ({"widths": list(self.widths)} if self.widths else {})

    def lines(self) -> tuple[str, ...]:
        """What to tell: one sentence a fact, guesses named as such."""
        said = []
        for key, value in self.table().items():
            how = "guessed" if key in self.guessed else "from the recipe"
            said.append(f"{key} = {value!r} ({how})")
        said += ["the recipe's names stand in place of the header's"] if self.renamed else []
        said += [
            f"column '{column.name}': time_format = '{column.time_format}' (guessed)"
            for column in self.columns
            if column.kind == "time"
        ]
        return tuple(said)


def guess(
    path: Path, file: str, spec: TextSpec | None = None, names: Sequence[str] = ()
) -> Dialect:
    """Dialect of a text log from its first bytes; raises LogFormatError where it is not
    understood.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(HEAD_BYTES + 1)
    except OSError as error:
        raise LogFormatError(
            f"{file}: cannot be read: {error.strerror}", hint="check the file"
        ) from None
    if len(data) > HEAD_BYTES:
        # a whole number of lines, and of characters: no line end is part of another character in
        # any encoding here
        cut = data.rfind(b"\n", 0, HEAD_BYTES) + 1
        data = data[: cut + (cut % 2 if data[:2] == b"\xff\xfe" else 0)] if cut else data
    spec = spec or TextSpec()
    text, encoding = encodings.decode(data, file, spec.encoding)
    return dialect(text, encoding, file, spec, names)


def dialect(
    text: str, encoding: str, file: str, spec: TextSpec, names: Sequence[str] = ()
) -> Dialect:
    """Dialect of a decoded log, what the recipe pins taken from it and the rest guessed."""
    lines = text.split("\n", HEAD_LINES + MOST_PREAMBLE)[: HEAD_LINES + MOST_PREAMBLE]
    while lines and not lines[-1].strip():
        lines.pop()
    if spec.footer_lines:
        lines = lines[: -spec.footer_lines] if len(lines) < HEAD_LINES else lines
    found = [_read_as(lines, delimiter, spec, names) for delimiter in _delimiters(spec)]
    best = max(
        (layout for layout in found if layout is not None),
        key=lambda layout: layout.score,
        default=None,
    )
    if best is None:
        raise LogFormatError(
            f"{file}: no rows of numbers found in the first {len(lines)} lines",
            hint=(
                "describe the log in [logs.text] of the recipe: delimiter, decimal, skip_lines,"
                " header_lines"
            ),
        )
    decimal = _decimal(best, spec, file)
    return _dialect(best, decimal, encoding, file, spec, names)


def _delimiters(spec: TextSpec) -> tuple[str, ...]:
    """Delimiters to try."""
    return DELIMITERS if spec.delimiter == "auto" else (spec.delimiter,)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Head of a log cut at one delimiter: line of the first row, the fields of the rows, the lines
    above.
    """

    delimiter: str
    widths: tuple[int, ...]
    first: int
    rows: tuple[tuple[str, ...], ...]
    above: tuple[str, ...]
    score: tuple[float, ...]


def _read_as(
    lines: Sequence[str], delimiter: str, spec: TextSpec, names: Sequence[str]
) -> _Layout | None:
    """The head of a log cut at a delimiter, with how well that explains it; None where it explains
    nothing.
    """
    cut = [tuple(tokens.split(line, delimiter, spec.widths)) for line in lines]
    sample = [fields for fields in cut[len(cut) // 3 :] if len(fields) > 1] or cut[-1:]
    width = _usual([len(fields) for fields in sample])
    pinned = None
    if spec.skip_lines != "auto" and spec.header_lines != "auto":
        pinned = spec.skip_lines + spec.header_lines
    numeric = _numeric_columns([fields for fields in cut if len(fields) == width], width)
    if not numeric and pinned is None:
        return None
    first = pinned if pinned is not None else _first_row(cut, width, numeric)
    if first is None or first >= len(cut):
        return None
    rows = tuple(fields for fields in cut[first:] if fields != ("",))
    if not rows:
        return None
    whole = [fields for fields in rows if len(fields) == width]
    known = [tokens.recognised(field) for fields in whole[:100] for field in fields]
    fits = len(whole) / len(rows)
    header = _header_fits(cut, first, width, delimiter, lines) or (
        len(names) == width and first == 0
    )
    enough = width > 1 or len(lines) - first > 1
    score = (
        float(enough and width > 1),
        round(fits, 3),
        float(header),
        sum(known) / max(len(known), 1),
    )
    preference = -float(DELIMITERS.index(delimiter)) if delimiter in DELIMITERS else 0.0
    return _Layout(
        delimiter, tuple(spec.widths), first, rows, tuple(lines[:first]), (*score, preference)
    )


def _usual(counts: Sequence[int]) -> int:
    """The commonest number of fields."""
    return max(set(counts), key=counts.count)


def _numeric_columns(rows: Sequence[Sequence[str]], width: int) -> list[int]:
    """Columns in which the last rows hold numbers or times."""
    last = rows[(len(rows) + 1) // 2 :][-50:] or rows
    return [
        k
        for k in range(width)
        if 2 * sum(tokens.measured(fields[k]) for fields in last) > len(last)
    ]


def _first_row(cut: Sequence[Sequence[str]], width: int, numeric: Sequence[int]) -> int | None:
    """Line, from 0, of the first row: as many fields as usual, and most of its numeric columns
    measured or overloaded.
    """
    for line, fields in enumerate(cut[:MOST_PREAMBLE]):
        if len(fields) != width:
            continue
        measured = sum(tokens.measured(fields[k]) for k in numeric)
        if measured and 2 * (measured + sum(tokens.is_sentinel(fields[k]) for k in numeric)) > len(
            numeric
        ):
            return line
    return None


def _header_fits(
    cut: Sequence[Sequence[str]], first: int, width: int, delimiter: str, lines: Sequence[str]
) -> bool:
    """Whether the line above the first row names as many columns as the rows have."""
    above = first - 1
    while above >= 0 and not lines[above].strip():
        above -= 1
    return above >= 0 and len(_names_of(lines[above], delimiter, width, cut[above])) == width


def _names_of(line: str, delimiter: str, width: int, fields: Sequence[str]) -> tuple[str, ...]:
    """Fields of a header line; blanks inside names are told from blanks between them by their
    number.
    """
    if delimiter == "space" and len(fields) != width:
        wide = tuple(part.strip() for part in re.split(r"\t+|\s{2,}", line.strip()))
        return wide if len(wide) == width else tuple(fields)
    if len(fields) == width - 1:
        return (*fields, "")  # every row ends with a delimiter, the header does not
    return tuple(fields)


def _decimal(layout: _Layout, spec: TextSpec, file: str) -> str:
    """Decimal mark of the rows; refused where a comma could part thousands."""
    if spec.decimal != "auto":
        return spec.decimal
    if layout.delimiter == ",":
        return "."
    fields = [field for row in layout.rows for field in row]
    commas = [field for field in fields if tokens.NUMBER[","].fullmatch(field) and "," in field]
    points = [field for field in fields if tokens.NUMBER["."].fullmatch(field) and "." in field]
    if commas and points and not any(times.looks_like_time(field) for field in points):
        raise LogFormatError(
            f"{file}:{layout.first + 1}: numbers with a decimal comma ('{commas[0]}') and with a"
            f" point ('{points[0]}')",
            hint="pin decimal in [logs.text] of the recipe",
        )
    if commas and all(tokens.THOUSANDS.fullmatch(field) for field in commas):
        raise LogFormatError(
            f"{file}:{layout.first + 1}: '{commas[0]}' is a decimal comma or parts thousands",
            hint="pin decimal in [logs.text] of the recipe: ',' or '.'",
        )
    return "," if commas else "."


def _dialect(
    layout: _Layout, decimal: str, encoding: str, file: str, spec: TextSpec, names: Sequence[str]
) -> Dialect:
    """The dialect of a layout: header lines, names and units, kinds of the columns."""
    width = _usual([len(row) for row in layout.rows])
    header, stated = _header(layout, width, file, spec, names)
    skip = layout.first - header
    _refuse_rows_above(layout.above[:skip], layout.delimiter, layout.widths, width, file)
    if not header and skip and spec.skip_lines == "auto":
        fields = len(tokens.split(layout.above[0], layout.delimiter, layout.widths))
        raise LogFormatError(
            f"{file}:1: {fields} fields, expected {width} as in the rows below",
            hint="repair the row, or pin skip_lines in [logs.text] where rows begin further down",
        )
    kinds = [
        _kind([row[k] for row in layout.rows if len(row) == width], decimal) for k in range(width)
    ]
    columns = tuple(
        ColumnGuess(name, unit, kind, form)
        for (name, unit), (kind, form) in zip(stated, kinds, strict=True)
    )
    pins = {"encoding", "delimiter", "decimal", "skip_lines", "header_lines"}
    guessed = tuple(key for key in sorted(pins) if getattr(spec, key) == "auto")
    renamed = bool(names) and header > 0
    return Dialect(
        encoding, layout.delimiter, decimal, skip, header, columns, guessed, layout.widths, renamed
    )


def _header(
    layout: _Layout, width: int, file: str, spec: TextSpec, names: Sequence[str]
) -> tuple[int, list[tuple[str, str]]]:
    """Number of header lines, blank lines below them included in none, and name and unit of every
    column.
    """
    above = [
        _names_of(
            line,
            layout.delimiter,
            width,
            tuple(tokens.split(line, layout.delimiter, layout.widths)),
        )
        for line in layout.above[-2:]
    ]
    lines = spec.header_lines
    if lines == "auto":
        lines = _header_lines(above, width)
    if lines and (len(above) < lines or len(above[-lines]) != width):
        found = len(above[-lines]) if len(above) >= lines else 0
        raise LogFormatError(
            f"{file}:{layout.first - lines + 1}: {found} column names, expected {width} as in the"
            " rows",
            hint=(
                "pin skip_lines and header_lines in [logs.text], or list the columns in [logs]"
                " names"
            ),
        )
    if names and len(names) != width:
        raise LogFormatError(
            f"{file}:{layout.first + 1}: {width} fields, the recipe names {len(names)} columns",
            hint="correct [logs] names, or the delimiter",
        )
    words = [field for field in above[-1] if field and not tokens.measured(field)] if above else []
    if not lines and not names and len(words) == len(above[-1] if above else ()) > 1:
        raise LogFormatError(
            f"{file}:{layout.first}: {len(words)} column names, expected {width} as in the rows",
            hint=(
                "pin skip_lines and header_lines in [logs.text], or list the columns in [logs]"
                " names"
            ),
        )
    if not lines and not names:
        raise LogFormatError(
            f"{file}:{layout.first + 1}: {width} columns without names",
            hint="list the columns in [logs] names of the recipe, in order",
        )
    return lines, _stated(above, lines, names)


def _header_lines(above: Sequence[Sequence[str]], width: int) -> int:
    """0, 1 or 2 header lines: names, or names with a line of units below."""
    if (
        not above
        or len(above[-1]) != width
        or any(tokens.NUMBER["."].fullmatch(field) for field in above[-1])
    ):
        return 0
    unit_row = sum(units.of_text(field) != "" for field in above[-1])
    filled = sum(bool(field.strip(" -[]()")) for field in above[-1])
    if len(above) == 2 and len(above[-2]) == width and unit_row and 2 * unit_row >= filled:
        return 2
    return 1


def _stated(
    above: Sequence[Sequence[str]], lines: int, names: Sequence[str]
) -> list[tuple[str, str]]:
    """Name and unit of every column, as the log states them or as the recipe names them."""
    if not lines:
        return [(name, units.of_header(name)) for name in names]
    header = [field.strip() for field in above[-lines]]
    stated = (
        [units.of_text(field) for field in above[-1]]
        if lines == 2
        else [units.of_header(name) for name in header]
    )
    return list(zip(names or _distinct(header), stated, strict=True))


def _distinct(header: Sequence[str]) -> list[str]:
    """Names made distinct: an empty one is called after its number, a repeated one after its
    occurrence.
    """
    made: list[str] = []
    for number, name in enumerate(header, start=1):
        called = name or f"column {number}"
        again = sum(other == name for other in header[: number - 1]) if name else 0
        made.append(f"{called} #{again + 1}" if again else called)
    return made


def _refuse_rows_above(
    above: Sequence[str], delimiter: str, widths: Sequence[int], width: int, file: str
) -> None:
    """Refuse a preamble in which a row stands: it would be lost."""
    for number, line in enumerate(above, start=1):
        fields = tokens.split(line, delimiter, widths)
        if width > 2 and len(fields) == width and sum(map(tokens.measured, fields)) > 1:
            raise LogFormatError(
                f"{file}:{number}: a row of numbers above the header",
                hint="repair the log, or pin skip_lines and header_lines in [logs.text]",
            )


def _kind(fields: Sequence[str], decimal: str) -> tuple[str, str]:
    """What most of a column's fields are, and the format of its times."""
    filled = [field for field in fields if field.strip()]
    if not filled:
        return "empty", ""
    numbers = sum(
        bool(tokens.NUMBER[decimal].fullmatch(field)) or tokens.is_sentinel(field)
        for field in filled
    )
    if 2 * numbers > len(filled):
        return "number", ""
    form = times.form_of(filled)
    return ("time", form) if form else ("text", "")
