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
from functools import partial
from typing import TYPE_CHECKING

from calibkit.errors import LogFormatError
from calibkit.readers import delimited, encoding as encodings, sniff, tokens
from calibkit.readers.table import FIRST_ROW, Table

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    import pandas as pd

    from calibkit.readers.sniff import Dialect
    from calibkit.recipe.logs import Logs

_SEPARATOR = "\x1f"
"""ASCII unit separator between the fields of a log that was cut; no instrument writes it."""


def read(path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """Read a log in any dialect; columns that nobody needs may hold text. Raises LogFormatError."""
    return parse(*delimited.read_bytes(path, file), file, logs, needed)


def parse(data: bytes, sha256: str, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """The table of a log's bytes; raises LogFormatError that names line and column of what cannot
    be read.
    """
    text, encoding = encodings.decode(data, file, logs.text.encoding)
    found = sniff.Dialect.recognise(text, encoding, file, logs.text, logs.names)
    return parse_text(text, sha256, file, found, logs, needed)


def parse_text(
    text: str, sha256: str, file: str, found: Dialect, logs: Logs, needed: Collection[str]
) -> Table:
    """The table of a log's characters in a known dialect."""
    rows, accounts = _find_rows(text, file, found, logs.text.footer_lines)
    body, separator = _separate_fields(rows, found)
    body += b"" if text.endswith(rows) else b"\n"  # whether the last row has a line end of its own
    first = found.first_line
    delimited.require_fields(body, len(found.columns), file, separator.encode(), first)
    kinds = {
        number: "float64"
        if delimited.is_needed(column.name, needed) and column.kind != "time"
        else "str"
        for number, column in enumerate(found.columns)
    }
    missing = tokens.SENTINELS | {
        word.strip().lower() for word in logs.sentinels if isinstance(word, str)
    }
    frame, notes = _parse_numbers(body, kinds, found, file, separator, missing)
    frame.columns = list(found.names)
    frame.index = frame.index + first - FIRST_ROW
    lines = rows.count("\n") + 1
    if len(frame) != lines:
        raise LogFormatError(
            f"{file}: {lines} lines gave {len(frame)} rows", hint="report this log as a fault"
        )
    return Table(
        file,
        sha256,
        frame,
        notes=(
            *notes,
            *delimited.check_last_line(body, file, separator, found.decimal, first),
        ),
        reading=(*found.describe(), *accounts),
        units={column.name: column.unit for column in found.columns if column.unit},
        decimal=found.decimal,
    )


def _find_rows(text: str, file: str, found: Dialect, footer: int) -> tuple[str, tuple[str, ...]]:
    """Text of the rows, and texts on how many lines are rows, header and anything else."""
    start = 0
    for _ in range(found.first_line - 1):
        start = text.find("\n", start) + 1
    filled = len(text.rstrip())
    end = text.find("\n", filled) if "\n" in text[filled:] else len(text)
    blank = text.count("\n", end) - 1 + (not text.endswith("\n"))
    for _ in range(footer):
        end = text.rfind("\n", 0, max(end, 0))
    if end <= start:
        raise LogFormatError(
            f"{file}: a header but no rows",
            hint="expected one row an instant; remove it or copy it again",
        )
    body = text[start:end]
    rows, total = body.count("\n") + 1, text.count("\n") + (not text.endswith("\n"))
    accounts = (
        (
            f"{total} lines: {found.skip_lines} above the header, {found.header_lines} of header,"
            f" {rows} rows"
        ),
        f"{blank} blank lines at the end" if blank > 0 else "",
        f"{footer} lines of footer (from the recipe)" if footer else "",
    )
    return body, tuple(filter(None, accounts))


def _separate_fields(body: str, found: Dialect) -> tuple[bytes, str]:
    """Rows as bytes with a single separator between fields, and that separator."""
    if found.delimiter == "fixed" or ('"' in body and found.delimiter != "space"):
        cut = (tokens.split_line(line, found.delimiter, found.widths) for line in body.split("\n"))
        return "\n".join(_SEPARATOR.join(fields) for fields in cut).encode(), _SEPARATOR
    data = body.encode()
    signs = b"+ " in data or b"- " in data
    if found.delimiter == "space":
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
        mark = re.escape(found.delimiter).encode()
        data = re.sub(rb"(?m)(^|" + mark + rb")([ ]*[+-]) +(?=[\d.,])", rb"\1\2", data)
    return data, found.delimiter


def _parse_numbers(
    body: bytes,
    kinds: dict[int, str],
    found: Dialect,
    file: str,
    separator: str,
    words: Collection[str],
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Numbers and texts of the rows, and one note per column in which words for missing values
    stand among numbers.
    """
    parse_rows = partial(
        delimited.parse_rows, body, sep=separator, decimal=found.decimal, skipinitialspace=True
    )
    try:
        return parse_rows(kinds), ()
    except (ValueError, OverflowError):
        frame = parse_rows(dict.fromkeys(kinds, "str"))
    notes: tuple[str, ...] = ()
    for number in (number for number, kind in kinds.items() if kind == "float64"):
        frame[number], noted = _parse_column(frame[number], found, number, file, words)
        notes += noted
    return frame, notes


def _parse_column(
    texts: pd.Series, found: Dialect, number: int, file: str, words: Collection[str]
) -> tuple[pd.Series, tuple[str, ...]]:
    """Numbers of a column in which words stand, and a note on the words: how many, the first one,
    its line; a word that is none of those for missing values refuses the file.
    """
    import numpy as np
    import pandas as pd

    plain = texts.fillna("").str.strip()
    empty, word = plain == "", plain.str.lower().isin(words)
    numeric = plain.str.fullmatch(tokens.NUMBER[found.decimal].pattern, flags=re.ASCII).astype(bool)
    name = found.columns[number].name
    wrong = np.flatnonzero((~empty & ~word & ~numeric).to_numpy())
    if wrong.size:
        row = int(wrong[0])
        raise LogFormatError(
            f"{file}:{found.first_line + row}: column '{name}': found '{plain.iloc[row][:40]}',"
            " expected a number",
            hint="repair the row, or leave the range out with [[exclude]]",
        )
    values = (
        plain.where(~empty & ~word, "nan")
        .str.replace(" ", "")
        .str.replace(found.decimal, ".", regex=False)
    )
    hits = np.flatnonzero((word & ~empty).to_numpy())
    notes = tuple(
        f"column '{name}': {hits.size} × no value, the first '{plain.iloc[row]}' in line"
        f" {found.first_line + row}"
        for row in hits[:1]
    )
    return pd.Series(np.array([float(value) for value in values]), index=texts.index), notes
