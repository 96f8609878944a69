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

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers import damage, delimited, encoding as encodings, sniff, tokens
from calibkit.readers.table import FIRST_ROW, Table

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Integers, Mask
    from calibkit.readers.sniff import Dialect
    from calibkit.recipe.logs import Logs

_MARKS = {".": r"[,'’ \u00a0\u202f]", ",": r"[.'’ \u00a0\u202f]"}
"""Marks between thousands, by decimal mark."""
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
    body, accounts = _find_rows(text, file, dialect, logs.text.footer_lines)
    open_end = text.endswith(body)
    # an empty line is a missing value of an only column, and tabs alone are a row of empty fields
    blank = "[ ]*" if dialect.delimiter == "\t" else "[ \t]*"
    if len(dialect.columns) == 1:
        blank = "(?!)"
    rows = damage.TextRows.among(body, blank, dialect.first_line, file, logs)
    if open_end and logs.text.last_line == "drop":
        rows.drop_last()
        open_end = False
    kinds = {
        number: "float64"
        if delimited.is_needed(column.name, required_columns) and column.kind != "time"
        else "str"
        for number, column in enumerate(dialect.columns)
    }
    missing = tokens.SENTINELS | {
        word.strip().lower() for word in logs.sentinels if isinstance(word, str)
    }
    frame, notes = _parse_rows(rows, kinds, dialect, missing, open_end=open_end)
    frame.columns = list(dialect.names)
    frame.index = _index_lines(rows.lines)
    return Table(
        file,
        sha256,
        frame,
        notes=(
            *rows.torn.notes,
            *notes,
            *_check_last_line(rows, dialect, open_end=open_end),
        ),
        reading=(*dialect.describe(), *accounts),
        units={column.name: column.unit for column in dialect.columns if column.unit},
        decimal=dialect.decimal,
        left_out=tuple(rows.torn.left_out),
        numbers=rows.numbers if rows.torn.any else None,
    )


def _find_rows(text: str, file: str, dialect: Dialect, footer: int) -> tuple[str, tuple[str, ...]]:
    """Text of the rows, and texts on how many lines are rows, header and anything else."""
    start = 0
    for _ in range(dialect.first_line - 1):
        start = text.find("\n", start) + 1
    filled = len(text.rstrip())
    end = text.find("\n", filled) if "\n" in text[filled:] else len(text)
    blank = text.count("\n", end) - 1 + (not text.endswith("\n"))
    for _ in range(footer):
        end = text.rfind("\n", 0, max(end, 0))
    if end <= start:
        raise damage.no_rows(file)
    body = text[start:end]
    rows, total = body.count("\n") + 1, text.count("\n") + (not text.endswith("\n"))
    accounts = (
        (
            f"{total} lines: {dialect.skip_lines} above the header, {dialect.header_lines} of"
            f" header, {rows} rows"
        ),
        f"{blank} blank lines at the end" if blank > 0 else "",
        f"{footer} lines of footer (from the recipe)" if footer else "",
    )
    return body, tuple(filter(None, accounts))


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
    rows: damage.TextRows,
    kinds: dict[int, str],
    dialect: Dialect,
    words: Collection[str],
    *,
    open_end: bool,
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Numbers and texts of the rows without those that are torn, where these may be left out, and
    one note per column in which words for missing values stand among numbers.
    """
    body, separator = _separate_fields(rows.body, dialect)
    counts = delimited.count_fields(body, separator.encode())
    torn = np.flatnonzero(counts != len(kinds))
    if torn.size:
        rows.drop_torn(
            torn, delimited.wrong_fields(counts, int(torn[0]), _advise(rows, dialect, open_end))
        )
        return _parse_rows(rows, kinds, dialect, words, open_end=open_end)
    csv_options = {"sep": separator, "decimal": dialect.decimal, "skipinitialspace": True}
    dropping = rows.torn.spec.torn_lines == "drop"
    stamps = [k for k, column in enumerate(dialect.columns) if dropping and column.kind == "time"]
    if not stamps:
        with suppress(ValueError, OverflowError):
            return delimited.parse_rows(body, kinds, **csv_options), ()
    frame = delimited.parse_rows(body, dict.fromkeys(kinds, "str"), **csv_options)
    columns = {
        number: _TextColumn.sort(frame[number], dialect.decimal, words)
        for number, kind in kinds.items()
        if kind == "float64"
    } | {number: _TextColumn.stamps(frame[number]) for number in stamps}
    wrong = np.any([column.wrong for column in columns.values()], axis=0)
    if wrong.any():
        rows.drop_torn(np.flatnonzero(wrong), _wrong_token(rows, columns, dialect, open_end))
        return _parse_rows(rows, kinds, dialect, words, open_end=open_end)
    notes = []
    for number, column in columns.items():
        if number not in stamps:
            frame[number] = column.parse(rows, dialect, number)
        notes += column.describe_words(rows.lines, dialect.names[number])
    return frame, tuple(notes)


def _wrong_token(
    rows: damage.TextRows,
    columns: Mapping[int, _TextColumn],
    dialect: Dialect,
    open_end: bool,  # noqa: FBT001
) -> LogFormatError:
    """The error of the first field of the first column that is not a number."""
    number = next(number for number, column in columns.items() if column.wrong.any())
    row = int(np.argmax(columns[number].wrong))
    token = str(columns[number].stripped.iloc[row])
    return LogFormatError(
        f"{rows.file}:{int(rows.lines[row])}: column '{dialect.names[number]}': found"
        f" '{token[:40]}', expected a number",
        hint=_advise(rows, dialect, open_end).of_token(row, token),
    )


def _advise(rows: damage.TextRows, dialect: Dialect, open_end: bool) -> damage.Advice:  # noqa: FBT001
    """What to do about a row that is none."""
    return damage.Advice(
        rows.file,
        rows.texts,
        rows.lines,
        len(dialect.columns),
        dialect.delimiter,
        dialect.decimal,
        open_end,
        dialect.widths,
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

    def parse(self, rows: damage.TextRows, dialect: Dialect, number: int) -> pd.Series:
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
                    f"{rows.file}:{int(rows.lines[with_mark])}: column '{dialect.names[number]}':"
                    f" '{self.stripped.iloc[with_mark]}' has a mark between its thousands,"
                    f" '{self.stripped.iloc[without_mark]}' in line"
                    f" {int(rows.lines[without_mark])} has none",
                    hint="pin decimal in [logs.text], or repair the log",
                )
            values = values.where(
                ~self.grouped, values.str.replace(_MARKS[dialect.decimal], "", regex=True)
            )
        values = values.str.replace(" ", "").str.replace(dialect.decimal, ".", regex=False)
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


def _index_lines(lines: Integers) -> pd.Index:
    """Index of a frame whose rows stand in these lines."""
    import pandas as pd

    first = int(lines[0]) - FIRST_ROW
    contiguous = int(lines[-1]) - int(lines[0]) + 1 == lines.size
    return pd.RangeIndex(first, first + lines.size) if contiguous else pd.Index(lines - FIRST_ROW)


def _check_last_line(rows: damage.TextRows, dialect: Dialect, *, open_end: bool) -> tuple[str, ...]:
    """Note on a last line without a line end."""
    if not open_end:
        return ()
    body, separator = _separate_fields(rows.body[-20_000:], dialect)
    return delimited.check_last_line(
        body, rows.file, int(rows.lines[-1]), separator, dialect.decimal
    )
