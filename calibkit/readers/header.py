"""The lines above the rows of a text log: preamble, names of the columns, their units."""

import re
from collections.abc import Sequence

from calibkit import units
from calibkit.errors import LogFormatError, NamelessColumnsError
from calibkit.readers import tokens
from calibkit.recipe.logs import TextSpec

_PIN = "pin skip_lines and header_lines in [logs.text], or list the columns in [logs] names"


def split_header(
    lines_above: Sequence[str],
    delimiter: str,
    widths: Sequence[int],
    width: int,
    *,
    pinned: bool = False,
) -> tuple[list[tuple[str, ...]], int]:
    """Fields of the last two lines above the rows that can name columns or units, and the number of
    blank lines and comments below them, 0 where the recipe pins the header. A comment can name
    columns too, where it has as many fields as the rows.
    """
    fields = [_split_names(line, delimiter, widths, width) for line in lines_above]
    full_width = [
        bool(line.strip()) and not tokens.is_comment(line) and len(row) == width
        for line, row in zip(lines_above, fields, strict=True)
    ]
    last = len(lines_above)
    while last and not pinned:
        line, names = lines_above[last - 1], fields[last - 1]
        is_comment = tokens.is_comment(line)
        if is_comment and len(names) == width and not any(map(tokens.is_measured, names)):
            # a comment names columns, or, below a line of names, their units
            is_comment = any(full_width[: last - 1]) and not _is_unit_row(names)
        if line.strip() and not is_comment:
            break
        last -= 1
    return fields[max(last - 2, 0) : last], len(lines_above) - last


def _is_unit_row(fields: Sequence[str]) -> bool:
    """Whether most of the filled fields of a line are units."""
    unit_count = sum(units.parse_unit(field) != "" for field in fields)
    return bool(unit_count) and 2 * unit_count >= sum(
        bool(field.strip(" -[]()")) for field in fields
    )


def _split_names(line: str, delimiter: str, widths: Sequence[int], width: int) -> tuple[str, ...]:
    """Fields of a header line, without the mark of a comment in front. Where blanks separate
    columns, a single blank may stand inside a name where two or more part the names.
    """
    fields = tuple(tokens.split_line(line, delimiter, widths))
    if tokens.is_comment(line) and (delimiter != "space" or len(fields) != width):
        line = tokens.COMMENT.sub("", line, count=1)
        fields = tuple(tokens.split_line(line, delimiter, widths))
    if delimiter == "space" and len(fields) != width:
        wide = tuple(part.strip() for part in re.split(r"\t+|\s{2,}", line.strip()))
        return wide if len(wide) == width else fields
    if len(fields) == width - 1:
        return (*fields, "")  # every row ends with a delimiter, the header does not
    return fields


def read_header(
    fields_above: Sequence[Sequence[str]],
    first: int,
    width: int,
    file: str,
    spec: TextSpec,
    names: Sequence[str],
) -> tuple[int, list[tuple[str, str]]]:
    """Number of header lines among the fields of the lines above line `first` (from 0) of the rows
    or of what separates them, and name and unit of every column.
    """
    if spec.header_lines != "auto":
        lines = spec.header_lines
    elif (
        not fields_above
        or len(fields_above[-1]) != width
        or any(tokens.NUMBER["."].fullmatch(field) for field in fields_above[-1])
    ):
        lines = 0
    else:  # names, or names with a line of units below
        names_fit = len(fields_above) == 2 and len(fields_above[-2]) == width
        lines = 2 if names_fit and _is_unit_row(fields_above[-1]) else 1
    header_width = len(fields_above[-lines]) if lines and len(fields_above) >= lines else 0
    if lines and header_width != width:
        raise LogFormatError(
            f"{file}:{first - lines + 1}: {header_width} column names, expected {width} as in the"
            " rows",
            hint=_PIN,
        )
    if names and len(names) != width:
        raise LogFormatError(
            f"{file}:{first + 1}: {width} fields, the recipe names {len(names)} columns",
            hint="correct [logs] names, or the delimiter",
        )
    if not lines and not names:
        last = fields_above[-1] if fields_above else ()
        if len(last) > 1 and all(field and not tokens.is_measured(field) for field in last):
            raise LogFormatError(
                f"{file}:{first}: {len(last)} column names, expected {width} as in the rows",
                hint=_PIN,
            )
        raise NamelessColumnsError(
            f"{file}:{first + 1}: {width} columns without names",
            hint="list the columns in [logs] names of the recipe, in order",
            columns=width,
        )
    if not lines:
        return lines, [(name, units.unit_in_header(name)) for name in names]
    header = [field.strip() for field in fields_above[-lines]]
    if lines == 2:
        column_units = [units.as_stated(field.strip(" -[]()<>{}")) for field in fields_above[-1]]
    else:
        column_units = [units.unit_in_header(field) for field in header]
    # an empty name and the second of a name are made unique
    unique = []
    for number, name in enumerate(header, start=1):
        before = header[: number - 1].count(name) if name else 0
        unique.append((name or f"column {number}") + (f" #{before + 1}" if before else ""))
    return lines, list(zip(names or unique, column_units, strict=True))


def refuse_rows_above(
    lines_above: Sequence[str], delimiter: str, widths: Sequence[int], width: int, file: str
) -> None:
    """Raise LogFormatError for a row of numbers above the header: it would be lost."""
    for number, line in enumerate(lines_above, start=1):
        fields = [] if tokens.is_comment(line) else tokens.split_line(line, delimiter, widths)
        measured = [tokens.is_measured(field) for field in fields]
        like_a_row = sum(measured) > 1 and (measured[0] or 2 * sum(measured) >= width)
        if width > 2 and len(fields) == width and like_a_row:
            raise LogFormatError(
                f"{file}:{number}: a row of numbers above the header",
                hint="repair the log, or pin skip_lines and header_lines in [logs.text]",
            )
