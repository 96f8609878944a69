"""Reader of JSON logs: named lists of numbers, or a list of records.

Format: UTF-8 JSON (RFC 8259), an object whose members are lists of numbers or lists of lists of
numbers (a matrix, whose columns the recipe's [logs] names lists), nested in objects or not; or a
list of objects with the same keys, one per row; or an object with a list of names and a list of
rows. [logs] table names the member. A name that stands
twice is refused; text is no number. Uncertainty: numbers are converted to the nearest float64,
beyond its range to infinity; null has no value.
"""

import json
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.numeric.arrays import Array
from calibkit.readers import arrays, delimited, encoding as encodings
from calibkit.readers.table import Table
from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one member of a JSON log, or raise LogFormatError that names the line."""
    data, sha256 = delimited.read_bytes(path, file)
    text, _ = encodings.decode(data, file, "utf-8")
    try:
        # whole numbers of any length as float64 too
        document = json.loads(
            text,
            parse_int=float,
            object_pairs_hook=lambda pairs: _require_unique_names(pairs, file),
        )
    except (json.JSONDecodeError, RecursionError) as error:
        place = f"{file}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else file
        raise LogFormatError(
            f"{place}: not JSON: {error}", hint="the file is cut off or damaged"
        ) from None
    frame, how = arrays.select_columns(
        _collect_arrays(document, "", file), file, logs, required_columns
    )
    return Table(file, sha256, frame, reading=(f"JSON, {len(frame)} rows", *how))


def _require_unique_names(pairs: list[tuple[str, Any]], file: str) -> dict[str, Any]:
    """Members of an object; LogFormatError where two have one name."""
    members = dict(pairs)
    if len(members) < len(pairs):
        names = [name for name, _ in pairs]
        raise _repeated_name(file, next(name for name in names if names.count(name) > 1))
    return members


def _repeated_name(file: str, name: str) -> LogFormatError:
    """The error of two members of one name."""
    return LogFormatError(f"{file}: '{name}' stands twice", hint="give each member its own name")


def _collect_arrays(value: Any, path: str, file: str) -> dict[str, Array]:  # noqa: ANN401 (any JSON value)
    """Arrays of a JSON value by their paths."""
    if isinstance(value, dict):
        table = _name_matrix(value, path, file)
        return table or _collect_members(value.items(), path, file)
    if not isinstance(value, list) or not value:
        return {}
    if isinstance(value[0], dict):
        for number, row in enumerate(value, start=1):
            if not isinstance(row, dict) or row.keys() != value[0].keys():
                raise LogFormatError(
                    f"{file}: record {number} has other keys than the first", hint="repair the log"
                )
        columns = ((key, [row[key] for row in value]) for key in value[0])
        return _collect_members(columns, path, file)
    try:
        array = np.array(value)
        if array.dtype.kind in "fiO":
            _require_no_truth(value, path, file)
        if array.dtype.kind in "Ub" or (
            array.dtype.kind == "O" and any(isinstance(e, str) for e in array.flat)
        ):
            return {}  # text or truth values: no numbers
        return {path or "rows": array.astype(np.float64)}
    except (ValueError, TypeError):
        return {}  # rows of several lengths: no numbers that could be meant as columns


def _require_no_truth(values: list[Any], path: str, file: str) -> None:
    """Raise LogFormatError for `true` or `false` among numbers, which would read as 1 or 0."""
    for number, value in enumerate(values, start=1):
        if isinstance(value, bool):
            raise LogFormatError(
                f"{file}: value {number} of '{path or 'rows'}': found '{str(value).lower()}',"
                " expected a number",
                hint="repair the log; null stands for a value that is missing",
            )
        if isinstance(value, list):
            _require_no_truth(value, path, file)


def _name_matrix(value: dict[str, Any], path: str, file: str) -> dict[str, Array]:
    """Columns of an object that holds a list of names beside a list of rows of as many numbers;
    nothing of any other object.
    """
    lists = [member for member in value.values() if isinstance(member, list) and member]
    names = [member for member in lists if all(isinstance(name, str) for name in member)]
    if len(lists) != 2 or len(names) != 1:
        return {}
    (rows,) = (member for member in lists if member is not names[0])
    matrix = _collect_arrays(rows, path, file).get(path or "rows")
    if matrix is None or matrix.ndim != 2 or matrix.shape[1] != len(names[0]):
        return {}
    if len(set(names[0])) < len(names[0]):
        raise _repeated_name(file, next(name for name in names[0] if names[0].count(name) > 1))
    return {f"{path}/{name}".lstrip("/"): matrix[:, k] for k, name in enumerate(names[0])}


def _collect_members(members: Iterable[tuple[str, Any]], path: str, file: str) -> dict[str, Array]:
    """Arrays of several members by their paths."""
    merged: dict[str, Array] = {}
    for name, member in members:
        member_arrays = _collect_arrays(member, f"{path}/{name}".lstrip("/"), file)
        if shared_paths := merged.keys() & member_arrays.keys():
            raise _repeated_name(file, min(shared_paths))
        merged |= member_arrays
    return merged
