"""Reader of Excel workbooks (.xlsx, .xlsm, .xlsb, .xls, .ods), by python-calamine.

Format: one sheet is one log ([logs] table, needed where several sheets hold cells): lines above the
header, a row of names, with or without a row of units below it, then one row per instant; found as
in delimited text, and pinned by [logs.text] skip_lines and header_lines. Rows are counted as the
sheet numbers them; rows without cells are left out, merged cells filled down. Uncertainty: numbers
as stored (float64); cells formatted as dates are instants to the microsecond, which is what their
float64 resolves; formulas give their saved values; error cells (`#N/A`) have no value.
"""

from __future__ import annotations

import datetime as dt
import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import LogFormatError, SeveralTablesError
from calibkit.readers import limited, tokens
from calibkit.readers.table import Guess, Table

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from pathlib import Path

    from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one sheet of a workbook, or raise LogFormatError."""
    from calibkit.readers import delimited, sniff, text

    data, sha256 = delimited.read_bytes(path, file)
    parsed = limited.parse(parse, file, data, logs.table)
    name, content = parsed.facts["sheet"], parsed.arrays["content"].tobytes().decode()
    how = () if logs.table else (Guess(f"table = '{name}' (guessed)"),)
    spec = logs.text.model_copy(update={"delimiter": "\t", "decimal": "."})
    dialect = sniff.Dialect.recognise(content, "utf-8", file, spec, logs.names)
    table = text.parse_text(
        content,
        sha256,
        file,
        dialect,
        logs.model_copy(update={"text": spec}),
        required_columns,
    )
    described = dialect.describe(("skip_lines", "header_lines"))
    return replace(
        table,
        notes=(*parsed.facts["filled"], *table.notes),
        reading=(f"sheet '{name}'", *how, *described),
    )


def parse(data: bytes, file: str, table: str) -> limited.Parsed:
    """One sheet as lines of text, its name, and notes on merged cells."""
    import python_calamine

    with limited.refuse_damaged(file, "Excel"):
        book = python_calamine.CalamineWorkbook.from_filelike(io.BytesIO(data))
        sheets = {name: book.get_sheet_by_name(name) for name in book.sheet_names}
        cells = {name: sheet.to_python(skip_empty_area=False) for name, sheet in sheets.items()}
        with_cells = [
            name for name, rows in cells.items() if any(cell != "" for row in rows for cell in row)
        ]
        name = _choose_sheet(with_cells, file, table)
        filled = _fill_merged(cells[name], sheets[name].merged_cell_ranges or ())
    lines = []
    for row in cells[name]:
        fields = list(map(_format_cell, row))
        # a row without cells is a blank line
        lines.append("\t".join(fields) + "\n" if any(fields) else "\n")
    arrays = {"content": np.frombuffer("".join(lines).encode(), np.uint8)}
    return limited.Parsed(arrays, {"sheet": name, "filled": filled})


def _fill_merged(cells: list[list[Any]], merged: Sequence[Any]) -> tuple[str, ...]:
    """Fill merged cells that hold a number or an instant down, in place: what was typed once holds
    for all rows beside it. A note on which.
    """
    filled = []
    for (top, left), (bottom, _) in sorted(merged):
        value = cells[top][left] if top < len(cells) and left < len(cells[top]) else ""
        if bottom > top and value != "" and tokens.is_measured(_format_cell(value)):
            for row in cells[top + 1 : bottom + 1]:
                row[left] = value
            filled.append(f"rows {top + 1}-{bottom + 1} of column {left + 1}")
    overflow_text = f" and {len(filled) - 8} more" if len(filled) > 8 else ""
    cells_filled = (
        f"{len(filled)} merged cell(s) filled down: {', '.join(filled[:8])}{overflow_text}"
    )
    return (cells_filled,) if filled else ()


def _choose_sheet(filled: Sequence[str], file: str, table: str) -> str:
    """Name of the sheet that the recipe names, or of the only one that holds cells."""
    if table and table not in filled:
        raise LogFormatError(
            f"{file}: no sheet '{table}' with cells", hint=f"there are: {', '.join(filled)}"
        )
    if not filled:
        raise LogFormatError(f"{file}: no sheet holds cells", hint="check the workbook")
    if len(filled) > 1 and not table:
        raise SeveralTablesError(
            f"{file}: {len(filled)} sheets hold cells: {', '.join(filled)}",
            hint="name one in [logs] table of the recipe",
            tables=filled,
        )
    return table or filled[0]


def _format_cell(cell: Any) -> str:  # noqa: ANN401 (a cell holds a number, a text, an instant or nothing)
    """A cell as the characters that read back to it."""
    if isinstance(cell, bool):
        return str(cell).upper()  # as the sheet shows it: no number
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, dt.date):  # an instant at midnight comes as a date
        return cell.strftime("%Y-%m-%d %H:%M:%S.%f")
    if isinstance(cell, dt.time):
        return cell.strftime("%H:%M:%S.%f")
    if isinstance(cell, dt.timedelta):
        seconds = cell / dt.timedelta(microseconds=1)
        return (
            f"{int(seconds // 3600e6)}:{int(seconds // 60e6) % 60:02d}:{seconds % 60e6 / 1e6:09.6f}"
        )
    return " ".join(str(cell).replace('"', "").split())
