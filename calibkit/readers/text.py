"""Reader of delimited text in any dialect.

Format: text in UTF-8, UTF-16, GB18030 or Windows-1252; lines above the header; a line of names,
with or without a line of units below it, or none where the recipe lists the columns; then one row a
line, fields between commas, semicolons, tabs, bars, blanks, or of fixed widths; decimal points or
commas; quotes around fields; a blank after a sign; words for missing values (`OVLD`, `LLLL`,
`----`, `#N/A`). What the recipe's [logs.text] does not pin is guessed from the first lines
(`sniff`) and recorded; the whole file is then compared with it. Every line is accounted for:
header, preamble, blank lines at the end and footer are counted, all others are rows with as many
fields as the header or the file is refused. Uncertainty of reading: numbers are converted to the
nearest float64; nothing is rounded, resampled or dropped.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError, advise_exclude, format_ranges
from calibkit.readers import damage, delimited, encoding as encodings, sniff, tokens
from calibkit.readers.table import FIRST_ROW, Table

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Integers, Mask
    from calibkit.readers.sniff import Dialect
    from calibkit.recipe.logs import Logs

_MARKS = {".": r"[,'’ \u00a0\u202f]", ",": r"[.'’ \u00a0\u202f]"}
"""Marks between thousands, by decimal mark."""
_NO_ROW = {
    blank: re.compile(rf"(?m)^(?:{blank}|{tokens.COMMENT.pattern}.*)$", re.IGNORECASE)
    for blank in ("[ \t]*", "[ ]*", "(?!)")
}
"""A blank line, or a comment, by what is blank: a tab may part two empty fields, and an empty line
be the one empty field of a row.
"""
_MOST_FOOTER = 20
"""Largest number of lines that are taken for a footer."""
_BLOCK = 1 << 24
"""Bytes whose fields are counted at once."""
_SEPARATOR = "\x1f"
"""ASCII unit separator between the fields of a log that was cut; no instrument writes it."""


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read a log in any dialect; columns that nobody needs may hold text. Raises LogFormatError."""
    return parse(*delimited.read_bytes(path, file), file, logs, required_columns)


def parse(
    data: bytes, sha256: str, file: str, logs: Logs, required_columns: Collection[str]
) -> Table:
    """The table of a log's bytes; raises LogFormatError that names line and column of what cannot
    be read.
    """
    text, encoding = encodings.decode(data, file, logs.text.encoding)
    dialect = sniff.Dialect.recognise(text, encoding, file, logs.text, logs.names)
    return parse_text(text, sha256, file, dialect, logs, required_columns)


def parse_csv(
    data: bytes, sha256: str, file: str, logs: Logs, required_columns: Collection[str]
) -> Table:
    """The table of comma-separated UTF-8 with decimal points and one line of names, in which no
    more than the form of its times is guessed; raises LogFormatError for what is none.
    """
    text, _ = encodings.decode(data, file, "utf-8")
    names = delimited.split_names(data.partition(b"\n")[0], file)
    if (found := re.search(rb"\r(?!\n)", data)) is not None:
        line = data.count(b"\n", 0, found.start()) + 1
        raise LogFormatError(
            f"{file}:{line}: a carriage return inside the line",
            hint="the copy is damaged; copy the log again",
        )
    dialect = sniff.Dialect.of_csv(text, names)
    table = parse_text(text, sha256, file, dialect, logs, required_columns)
    return replace(table, reading=dialect.time_guesses)


def parse_text(
    text: str,
    sha256: str,
    file: str,
    dialect: Dialect,
    logs: Logs,
    required_columns: Collection[str],
) -> Table:
    """The table of a log's characters in a known dialect."""
    import pandas as pd

    rows, accounts = _Rows.find(text, file, dialect, logs)
    kinds = {
        number: "float64"
        if delimited.is_needed(column.name, required_columns) and column.kind != "time"
        else "str"
        for number, column in enumerate(dialect.columns)
    }
    missing = tokens.SENTINELS | {
        word.strip().lower() for word in logs.sentinels if isinstance(word, str)
    }
    frame, notes = _parse_rows(rows, kinds, missing)
    frame.columns = list(dialect.names)
    frame.index = pd.Index(rows.lines - FIRST_ROW)
    first = int(frame.index[0])
    if int(frame.index[-1]) - first + 1 == len(frame):
        frame.index = pd.RangeIndex(first, first + len(frame))
    return Table(
        file,
        sha256,
        frame,
        notes=(*rows.torn.notes, *notes, *_check_last_line(rows)),
        reading=(*dialect.describe(), *accounts),
        units={column.name: column.unit for column in dialect.columns if column.unit},
        decimal=dialect.decimal,
        left_out=tuple(rows.torn.left_out),
        numbers=rows.numbers if rows.torn.any else None,
    )


@dataclass(slots=True)
class _Rows:
    """Lines of a text log that hold its rows: their text, and the line of each; those that were
    left out, and notes on them.
    """

    body: str
    lines: Integers
    numbers: Integers
    """Number of each row among the rows of the log, from 0, torn ones counted."""
    torn: damage.Torn
    dialect: Dialect
    open_end: bool
    """Whether the last line has no line end."""

    @classmethod
    def find(
        cls, text: str, file: str, dialect: Dialect, logs: Logs
    ) -> tuple[_Rows, tuple[str, ...]]:
        """Rows of a log, without comments, blank lines and footer, and texts on how many of its
        lines are rows, header and anything else.
        """
        start = 0
        for _ in range(dialect.first_line - 1):
            start = text.find("\n", start) + 1
        filled = len(text.rstrip())
        end = text.find("\n", filled) if "\n" in text[filled:] else len(text)
        blank = text.count("\n", end) - 1 + (not text.endswith("\n"))
        footer = logs.text.footer_lines
        for _ in range(footer):
            end = text.rfind("\n", 0, max(end, 0))
        if end <= start:
            raise damage.no_rows(file)
        body, first = text[start:end], dialect.first_line
        count, total = body.count("\n") + 1, text.count("\n") + (not text.endswith("\n"))
        accounts = (
            (
                f"{total} lines: {dialect.skip_lines} above the header, {dialect.header_lines} of"
                f" header, {count} rows"
            ),
            f"{blank} blank lines at the end" if blank > 0 else "",
            f"{footer} lines of footer (from the recipe)" if footer else "",
        )
        lines = np.arange(first, first + count)
        torn = damage.Torn.of(file, logs)
        rows = cls(body, lines, lines, torn, dialect, text.endswith(body))
        # an empty line is a missing value of an only column, and tabs alone are a row of empty
        # fields
        no_row = _NO_ROW["[ ]*" if dialect.delimiter == "\t" else "[ \t]*"]
        if len(dialect.columns) == 1:
            no_row = _NO_ROW["(?!)"]
        if no_row.search(body):
            texts = rows.texts
            odd = [k for k, line in enumerate(texts) if no_row.fullmatch(line)]
            rows._remove(np.array(odd, dtype=np.int64))
            rows.numbers = np.arange(rows.lines.size)
            for kind, commented in (("comment(s) among the rows", True), ("blank line(s)", False)):
                left_out = [first + k for k in odd if tokens.is_comment(texts[k]) == commented]
                if left_out:
                    torn.notes.append(
                        f"{len(left_out)} {kind} left out, line {format_ranges(left_out)}"
                    )
        else:
            rows.numbers = np.arange(rows.lines.size)
        if rows.open_end and logs.text.last_line == "drop":
            torn.drop_last(int(rows.lines[-1]))
            rows._remove(np.array([rows.lines.size - 1]))
            rows.open_end = False
        return rows, tuple(filter(None, accounts))

    @property
    def texts(self) -> list[str]:
        """Text of each row."""
        return self.body.split("\n")

    def split(self, row: int) -> list[str]:
        """Fields of a row."""
        return tokens.split_line(self.texts[row], self.dialect.delimiter, self.dialect.widths)

    def _remove(self, rows: Integers) -> None:
        """Take rows out; raises LogFormatError where none is left."""
        remaining = np.ones(self.lines.size, dtype=bool)
        remaining[rows] = False
        self.body = "\n".join(itertools.compress(self.texts, remaining))
        self.lines, self.numbers = self.lines[remaining], self.numbers[remaining]
        if not self.lines.size:
            raise damage.no_rows(self.torn.file)

    def drop_torn(self, torn: Integers, error: LogFormatError) -> None:
        """Leave out torn rows, where the recipe excludes them or allows as many; else raise the
        error.
        """
        self.torn.drop([int(line) for line in self.lines[torn]], error)
        self._remove(torn)

    def wrong_fields(self, row: int, count: int) -> LogFormatError:
        """The error of a row with another number of fields than the header, with what to do."""
        expected, delimiter = len(self.dialect.columns), self.dialect.delimiter
        hint = damage.advise_torn(self.torn.file, int(self.lines[row]))
        written = len(self.split(row))
        counts = [
            len(tokens.split_line(text, delimiter, self.dialect.widths))
            for text in self.texts[:200]
        ]
        if delimiter == "," and written > expected and 2 * counts.count(written) > len(counts):
            hint = (
                "decimal commas between commas? Export with semicolons or tabs between the columns"
                " and set decimal = ',' in [logs.text]"
            )
        elif footer := self._advise_footer(row):
            hint = footer
        elif self.open_end and row == self.lines.size - 1:
            hint = (
                'the last line is incomplete: copy the log again, or set last_line = "drop" in'
                " [logs.text]"
            )
        return LogFormatError(
            f"{self.torn.file}:{int(self.lines[row])}: {count} fields, expected {expected} as in"
            " the header",
            hint=hint,
        )

    def wrong_token(self, row: int, name: str, token: str) -> LogFormatError:
        """The error of a field that is not a number, with what to do."""
        file, line, decimal = self.torn.file, int(self.lines[row]), self.dialect.decimal
        other, word = (",", "comma") if decimal == "." else (".", "point")
        hint = (
            'repair the row, or leave it out: torn_lines = "drop" in [logs.text], or'
            f" {advise_exclude(file, lines=[line])}"
        )
        if tokens.is_number(token, other):
            hint = f"decimal {word}? Set decimal = '{other}' in [logs.text]"
            if self.dialect.delimiter == "," == other:
                hint = (
                    "decimal comma? Set decimal = ',' in [logs.text]; thousands? Set decimal = '.'"
                )
        elif footer := self._advise_footer(row):
            hint = footer
        return LogFormatError(
            f"{file}:{line}: column '{name}': found '{token[:40]}', expected a number", hint=hint
        )

    def _advise_footer(self, row: int) -> str:
        """Advice on a footer, where a row and all behind it are one; else ""."""
        start = max(0, self.lines.size - _MOST_FOOTER)
        rows = []
        for k in range(start, self.lines.size):
            first = self.split(k)[0]
            if tokens.is_measured(first) or tokens.is_sentinel(first):
                rows.append(k)
        if self.open_end or not rows or rows[-1] >= row:
            return ""
        lines = int(self.lines[-1]) - int(self.lines[rows[-1] + 1]) + 1
        return f"a footer? Set footer_lines = {lines} in [logs.text]"


def _separate_fields(body: str, dialect: Dialect) -> tuple[bytes, str]:
    """Rows as bytes with a single separator between fields, and that separator."""
    if dialect.delimiter == "fixed" or ('"' in body and dialect.delimiter != "space"):
        cut = (
            tokens.split_line(line, dialect.delimiter, dialect.widths) for line in body.split("\n")
        )
        return "\n".join(_SEPARATOR.join(fields) for fields in cut).encode(), _SEPARATOR
    data = body.encode()
    signs = b"+ " in data or b"- " in data
    if dialect.delimiter == "space":
        data = re.sub(rb"(?m)(?<![^\s])([+-]) +(?=[\d.,])", rb"\1", data) if signs else data
        if (
            data[:1] in b" \t"
            or b"\t" in data
            or any(odd in data for odd in (b"  ", b"\n ", b" \n"))
            or data[-1:] == b" "
        ):
            data = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", data)
            return re.sub(rb"[ \t]+", _SEPARATOR.encode(), data), _SEPARATOR
        return data, " "
    if signs:
        # `+ 0.081`: a blank after the sign is the instrument's, not the number's
        mark = re.escape(dialect.delimiter).encode()
        data = re.sub(rb"(?m)(^|" + mark + rb")([ ]*[+-]) +(?=[\d.,])", rb"\1\2", data)
    return data, dialect.delimiter


def _parse_rows(
    rows: _Rows, kinds: dict[int, str], words: Collection[str]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Numbers and texts of the rows without those that are torn, where these may be left out, and
    one note per column in which words for missing values stand among numbers.
    """
    dialect = rows.dialect
    body, separator = _separate_fields(rows.body, dialect)
    counts = _count_fields(body, separator.encode())
    torn = np.flatnonzero(counts != len(kinds))
    if torn.size:
        rows.drop_torn(torn, rows.wrong_fields(int(torn[0]), int(counts[torn[0]])))
        return _parse_rows(rows, kinds, words)
    dropping = rows.torn.spec.torn_lines == "drop"
    stamps = [k for k, column in enumerate(dialect.columns) if dropping and column.kind == "time"]
    if not stamps:
        with suppress(ValueError, OverflowError):
            return _parse_fields(body, kinds, separator, dialect.decimal), ()
    frame = _parse_fields(body, dict.fromkeys(kinds, "str"), separator, dialect.decimal)
    columns = {
        number: _TextColumn.sort(frame[number], dialect.decimal, words)
        for number, kind in kinds.items()
        if kind == "float64"
    } | {number: _TextColumn.stamps(frame[number]) for number in stamps}
    wrong = np.any([column.wrong for column in columns.values()], axis=0)
    if wrong.any():
        number = next(number for number, column in columns.items() if column.wrong.any())
        row = int(np.argmax(columns[number].wrong))
        token = str(columns[number].stripped.iloc[row])
        error = rows.wrong_token(row, dialect.names[number], token)
        rows.drop_torn(np.flatnonzero(wrong), error)
        return _parse_rows(rows, kinds, words)
    notes = []
    for number, column in columns.items():
        if number not in stamps:
            frame[number] = column.parse(rows, dialect.names[number])
        notes += column.describe_words(rows.lines, dialect.names[number])
    return frame, tuple(notes)


def _count_fields(body: bytes, delimiter: bytes) -> Integers:
    """Number of fields of every line [n]."""
    field_counts, carried = [], 0
    for start in range(0, len(body), _BLOCK):
        block = np.frombuffer(body, np.uint8, min(_BLOCK, len(body) - start), start)
        ends = np.flatnonzero(block == ord("\n"))
        commas = np.cumsum(block == ord(delimiter))
        upto = np.concatenate([[0], commas[ends]]) if ends.size else np.zeros(1, dtype=np.int64)
        counts = np.diff(upto)
        if counts.size:
            counts[0] += carried
            carried = 0
        field_counts.append(counts + 1)
        carried += int(commas[-1] - upto[-1])
    if not body.endswith(b"\n"):
        field_counts.append(np.array([carried + 1]))
    return np.concatenate(field_counts) if field_counts else np.zeros(0, dtype=np.int64)


def _parse_fields(body: bytes, kinds: dict[int, str], separator: str, decimal: str) -> pd.DataFrame:
    """Numbers and texts of the rows, with one kind per column, numbered from 0."""
    import pandas as pd

    return pd.read_csv(
        io.BytesIO(body),
        sep=separator,
        decimal=decimal,
        skipinitialspace=True,
        header=None,
        names=list(kinds),
        dtype=kinds,
        quoting=csv.QUOTE_NONE,
        keep_default_na=False,
        na_values=sorted(delimited.MISSING),
        skip_blank_lines=False,
    )


@dataclass(frozen=True, slots=True)
class _TextColumn:
    """Fields of a column in which words stand: which of them are words for missing values, which
    have a mark between their thousands, and which are none of this.
    """

    stripped: pd.Series
    word: Mask
    grouped: Mask
    wrong: Mask

    @classmethod
    def sort(cls, texts: pd.Series, decimal: str, words: Collection[str]) -> _TextColumn:
        """Sort the fields of a column."""
        stripped = texts.fillna("").str.strip()
        numeric, grouped = (
            stripped.str.fullmatch(kind[decimal].pattern, flags=re.ASCII).to_numpy(dtype=bool)
            for kind in (tokens.NUMBER, tokens.GROUPED)
        )
        word = stripped.str.lower().isin(words).to_numpy()
        empty = (stripped == "").to_numpy()
        return cls(stripped, word & ~empty, grouped & ~numeric, ~(empty | word | numeric | grouped))

    @classmethod
    def stamps(cls, texts: pd.Series) -> _TextColumn:
        """Sort the stamps of a column of times: those that are torn are wrong."""
        stripped = texts.fillna("").str.strip()
        torn = np.array(
            [bool(text) and not tokens.is_measured(text) for text in stripped], dtype=bool
        )
        return cls(stripped, np.zeros_like(torn), np.zeros_like(torn), torn)

    def parse(self, rows: _Rows, name: str) -> pd.Series:
        """Numbers of the column. Raises LogFormatError where some thousands have a mark between
        them and others have none.
        """
        import pandas as pd

        values = self.stripped.where(~self.word & (self.stripped != ""), "nan")
        if self.grouped.any():
            ungrouped = values.str.match(r"[+-]? ?\d{4}").to_numpy(dtype=bool)
            if ungrouped.any():
                with_mark, without_mark = int(np.argmax(self.grouped)), int(np.argmax(ungrouped))
                raise LogFormatError(
                    f"{rows.torn.file}:{int(rows.lines[with_mark])}: column '{name}':"
                    f" '{self.stripped.iloc[with_mark]}' has a mark between its thousands,"
                    f" '{self.stripped.iloc[without_mark]}' in line"
                    f" {int(rows.lines[without_mark])} has none",
                    hint="pin decimal in [logs.text], or repair the log",
                )
            values = values.where(
                ~self.grouped, values.str.replace(_MARKS[rows.dialect.decimal], "", regex=True)
            )
        values = values.str.replace(" ", "").str.replace(rows.dialect.decimal, ".", regex=False)
        return pd.Series(np.array([float(value) for value in values]), index=values.index)

    def describe_words(self, lines: Integers, name: str) -> list[str]:
        """Notes on words for missing values and on thousands: how many, the first one, its line."""
        notes = []
        if (count := int(self.word.sum())) > 0:
            row = int(np.argmax(self.word))
            notes.append(
                f"column '{name}': {count} × no value, the first '{self.stripped.iloc[row]}' in"
                f" line {int(lines[row])}"
            )
        if (count := int(self.grouped.sum())) > 0:
            row = int(np.argmax(self.grouped))
            notes.append(
                f"column '{name}': {count} numbers with a mark between their thousands, the first"
                f" '{self.stripped.iloc[row]}' in line {int(lines[row])}"
            )
        return notes


def _check_last_line(rows: _Rows) -> tuple[str, ...]:
    """Note on a last line without a line end; LogFormatError where its last number is cut."""
    if not rows.open_end:
        return ()
    body, separator = _separate_fields(rows.body[-20_000:], rows.dialect)
    if body.endswith(b"\n"):
        return ()
    lines = body.split(b"\n")[len(body) > 20_000 :]
    last_rows = [line.decode().split(separator) for line in lines][-50:]
    decimals = [len(row[-1].partition(rows.dialect.decimal)[2]) for row in last_rows]
    if len(decimals) > 2 and len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]:
        raise LogFormatError(
            f"{rows.torn.file}:{int(rows.lines[-1])}: the last number '{last_rows[-1][-1]}' has"
            f" {decimals[-1]} decimals and no line end, expected {decimals[0]}",
            hint='the file is cut off: copy it again, or set last_line = "drop" in [logs.text]',
        )
    return ("the last line has no line end; its row was kept",)
