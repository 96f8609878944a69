"""The dialect of a text log, guessed from its first lines: encoding, delimiter, decimal mark,
preamble, header, units and kinds of its columns.

The reader then compares the whole file with the guess and refuses the first line that contradicts
it. Where two dialects are possible that would give different numbers, nothing is guessed: the log
is refused with the key of the recipe that decides it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibkit.errors import LogFormatError
from calibkit.readers import (
    delimited,
    encoding as encodings,
    header as headers,
    limited,
    times,
    tokens,
)
from calibkit.readers.table import Guess
from calibkit.recipe.logs import AUTO, TextSpec

_HEAD_LINES = 400
"""Lines from which a dialect is guessed."""
_HEAD_BYTES = 1 << 20
"""Bytes that are read of a log whose dialect is guessed and that is not read."""
_MOST_PREAMBLE = 120
"""Largest number of lines above the first row."""
_DELIMITERS = ("\t", ";", ",", "|", "space")


@dataclass(frozen=True, slots=True)
class _SniffedColumn:
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
    columns: tuple[_SniffedColumn, ...]
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
        """Whether it is comma-separated UTF-8 with decimal points and one line of names."""
        return tuple(self.recipe_keys().values()) == ("utf-8", ",", ".", 0, 1)

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

    def describe(self, keys: Sequence[str] = ()) -> tuple[str, ...]:
        """How the log is written, one fact per text, each guess a `Guess`; with `keys`, these alone
        and the times.
        """
        pins = self.recipe_keys()
        texts = [
            Guess(f"{key} = {pins[key]!r} (guessed)")
            if key in self.guessed
            else f"{key} = {pins[key]!r} (from the recipe)"
            for key in keys or pins
        ]
        if self.renamed and not keys:
            texts.append("the recipe's names stand in place of the header's")
        return (*texts, *self.time_guesses)

    @property
    def time_guesses(self) -> tuple[str, ...]:
        """Form of each column of times, as it was guessed."""
        return tuple(
            Guess(f"column '{column.name}': time_format = '{column.time_format}' (guessed)")
            for column in self.columns
            if column.kind == "time"
        )

    @staticmethod
    def guess(
        path: Path, file: str, spec: TextSpec | None = None, names: Sequence[str] = ()
    ) -> "Dialect":
        """Guess the dialect of a text log from its first bytes; raises LogFormatError where there
        is none that explains it.
        """
        with delimited.open_log(path, file) as stream:
            data = stream.read(_HEAD_BYTES + 1)
        if len(data) > _HEAD_BYTES:
            # a whole number of lines, and of characters: no line end is part of another character
            # in any encoding here
            cut = data.rfind(b"\n", 0, _HEAD_BYTES) + 1
            data = data[: cut + (cut % 2 if data[:2] == b"\xff\xfe" else 0)] if cut else data
        spec = spec or TextSpec()
        text, encoding = encodings.decode(data, file, spec.encoding)
        return Dialect.recognise(text, encoding, file, spec, names)

    @staticmethod
    def of_csv(text: str, names: Sequence[str]) -> "Dialect":
        """Dialect of comma-separated text whose first line is these names; the kinds of its columns
        are those of its first rows.
        """
        rows = [line.split(",") for line in text.split("\n", _HEAD_LINES)[1:_HEAD_LINES]]
        columns = []
        for k, name in enumerate(names):
            fields = [row[k] for row in rows if len(row) == len(names)]
            columns.append(_SniffedColumn(name, "", *_classify_column(fields, ".")))
        return Dialect("utf-8", ",", ".", 0, 1, tuple(columns))

    @staticmethod
    def recognise(
        text: str, encoding: str, file: str, spec: TextSpec, names: Sequence[str] = ()
    ) -> "Dialect":
        """Dialect of a decoded log: what the recipe pins is taken, the rest is guessed."""
        spec = spec.of_log(file)
        lines = text.split("\n", _HEAD_LINES + _MOST_PREAMBLE)[: _HEAD_LINES + _MOST_PREAMBLE]
        while lines and not lines[-1].strip():
            lines.pop()
        if spec.footer_lines:
            lines = lines[: -spec.footer_lines] if len(lines) < _HEAD_LINES else lines
        delimiter_count = max((line.count(mark) for line in lines for mark in ",;\t|"), default=0)
        limited.require_columns(delimiter_count + 1, file)
        delimiters = _DELIMITERS if spec.delimiter == "auto" else (spec.delimiter,)
        layouts = (_cut_at(lines, delimiter, spec, names) for delimiter in delimiters if lines)
        best = max(filter(None, layouts), key=lambda layout: layout.score, default=None)
        if best is None:
            raise LogFormatError(
                f"{file}: no rows of numbers found in the first {len(lines)} lines",
                hint=(
                    "describe the log in [logs.text] of the recipe: delimiter, decimal, skip_lines,"
                    " header_lines"
                ),
            )
        return _build_dialect(best, _guess_decimal(best, spec, file), encoding, file, spec, names)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Head of a log cut at one delimiter: line of the first row (from 0), the fields of the rows,
    the lines above, and how well the delimiter explains the log (larger is better).
    """

    delimiter: str
    widths: tuple[int, ...]
    first: int
    rows: tuple[tuple[str, ...], ...]
    lines_above: tuple[str, ...]
    score: tuple[float, ...]


def _cut_at(
    lines: Sequence[str], delimiter: str, spec: TextSpec, names: Sequence[str]
) -> _Layout | None:
    """Cut the head of a log at a delimiter; None where that gives no rows of numbers."""
    cut = [
        tuple(tokens.split_line("" if tokens.is_comment(line) else line, delimiter, spec.widths))
        for line in lines
    ]
    sample = [fields for fields in cut[len(cut) // 3 :] if len(fields) > 1] or cut[-1:]
    width = _usual_width(sample)
    start = spec.skip_lines if isinstance(spec.skip_lines, int) else 0
    if isinstance(spec.skip_lines, int) and spec.header_lines != "auto":
        first: int | None = start + spec.header_lines
    else:
        first = _find_first_row(cut, width, start)
    rows = tuple(fields for fields in cut[first:] if fields != ("",))
    if first is None or not rows:
        return None
    full_rows = [fields for fields in rows if len(fields) == width]
    recognised = [
        not field or tokens.is_measured(field) or tokens.is_sentinel(field)
        for fields in full_rows[:100]
        for field in fields
    ]
    names_above, _ = headers.split_header(lines[:first], delimiter, spec.widths, width)
    named = bool(names_above) and len(names_above[-1]) == width
    score = (
        float(width > 1),
        round(len(full_rows) / len(rows), 3),
        float(named or (len(names) == width and first == 0)),
        sum(recognised) / max(len(recognised), 1),
        -float(_DELIMITERS.index(delimiter)) if delimiter in _DELIMITERS else 0.0,
    )
    return _Layout(delimiter, tuple(spec.widths), first, rows, tuple(lines[:first]), score)


def _usual_width(rows: Sequence[Sequence[str]]) -> int:
    """The commonest number of fields of a row."""
    counts = [len(fields) for fields in rows]
    return max(set(counts), key=counts.count)


def _find_first_row(cut: Sequence[Sequence[str]], width: int, start: int) -> int | None:
    """Line, from 0, of the first row from line `start` on: one of `width` fields, with numbers,
    times or words for missing values in most of the columns that hold numbers or times in the last
    rows.
    """
    rows = [fields for fields in cut if len(fields) == width]
    last = rows[(len(rows) + 1) // 2 :][-50:] or rows
    numeric = [
        k
        for k in range(width)
        if 2 * sum(tokens.is_measured(fields[k]) for fields in last) > len(last)
    ]
    for line, fields in enumerate(cut[start : start + _MOST_PREAMBLE], start):
        if len(fields) != width:
            continue
        measured = sum(tokens.is_measured(fields[k]) for k in numeric)
        if measured and 2 * (measured + sum(tokens.is_sentinel(fields[k]) for k in numeric)) > len(
            numeric
        ):
            return line
    return None


def _guess_decimal(layout: _Layout, spec: TextSpec, file: str) -> str:
    """Decimal mark of the rows; LogFormatError where a comma could also part thousands."""
    if spec.decimal != "auto":
        return spec.decimal
    if layout.delimiter == ",":
        return "."
    fields = [field for row in layout.rows for field in row]
    for mark, grouped in tokens.GROUPED.items():
        if any(mark in field and grouped.fullmatch(field) for field in fields):
            return mark  # both marks in a number: the last one is the decimal mark
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


def _build_dialect(
    layout: _Layout, decimal: str, encoding: str, file: str, spec: TextSpec, names: Sequence[str]
) -> Dialect:
    """Dialect of a layout: its header lines, and name, unit and kind of each column."""
    width = _usual_width(layout.rows)
    skip, header, names_and_units = _find_header(layout, width, file, spec, names)
    rows = [row for row in layout.rows if len(row) == width]
    columns = []
    for k, (name, unit) in enumerate(names_and_units):
        fields = [row[k] for row in rows]
        columns.append(_SniffedColumn(name, unit, *_classify_column(fields, decimal)))
    return Dialect(
        encoding,
        layout.delimiter,
        decimal,
        skip,
        header,
        columns=tuple(columns),
        guessed=tuple(key for key, value in spec if value == AUTO),
        widths=layout.widths,
        renamed=bool(names) and header > 0,
    )


def _find_header(
    layout: _Layout, width: int, file: str, spec: TextSpec, names: Sequence[str]
) -> tuple[int, int, list[tuple[str, str]]]:
    """Lines above the header, lines of header, and name and unit of every column. Blank lines and
    comments may lie between header and rows; without a header they are above it.
    """
    delimiter, widths = layout.delimiter, layout.widths
    pinned = isinstance(spec.skip_lines, int) and spec.header_lines != AUTO
    fields_above, skipped_below = headers.split_header(
        layout.lines_above, delimiter, widths, width, pinned=pinned
    )
    last = layout.first - skipped_below
    header, names_and_units = headers.read_header(fields_above, last, width, file, spec, names)
    skip = last - header if header else layout.first
    filled = [
        k
        for k, line in enumerate(layout.lines_above[:skip])
        if line.strip() and not tokens.is_comment(line)
    ]
    if not isinstance(spec.skip_lines, int):
        headers.refuse_rows_above(layout.lines_above[:skip], delimiter, widths, width, file)
        if header or not filled:
            return skip, header, names_and_units
        if spec.torn_lines == "drop":
            return 0, 0, names_and_units  # they are torn rows, which are counted
        fields = len(tokens.split_line(layout.lines_above[filled[0]], delimiter, widths))
        raise LogFormatError(
            f"{file}:{filled[0] + 1}: {fields} fields, expected {width} as in the rows below",
            hint=(
                f'a line above the rows? Pin skip_lines = {{ "{file}" = {filled[-1] + 1} }} in'
                ' [logs.text]; a torn row? Set torn_lines = "drop" there'
            ),
        )
    if any(k >= spec.skip_lines for k in filled):
        raise LogFormatError(
            f"{file}:{spec.skip_lines + 1}: found '{layout.lines_above[spec.skip_lines][:40]}',"
            f" expected the header or the first row below skip_lines = {spec.skip_lines}",
            hint=f"correct skip_lines in [logs.text]: the header stands in line {skip + 1}",
        )
    return skip, header, names_and_units


def _classify_column(fields: Sequence[str], decimal: str) -> tuple[str, str]:
    """Kind of most of a column's fields (see `_TextColumn`), and the format of its times."""
    filled = [field for field in fields if field.strip()]
    if not filled:
        return "empty", ""
    numbers = sum(tokens.is_number(field, decimal) or tokens.is_sentinel(field) for field in filled)
    if 2 * numbers > len(filled):
        return "number", ""
    form = times.recognise_format(filled)
    return ("time", form) if form else ("text", "")
