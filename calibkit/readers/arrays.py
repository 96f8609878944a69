"""Named arrays of a container file (MATLAB, HDF5, JSON) → columns of one log."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError, NamelessColumnsError, SeveralTablesError
from calibkit.readers import delimited
from calibkit.readers.table import FIRST_ROW, Guess

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    import pandas as pd
    from numpy.typing import NDArray

    from calibkit.recipe.logs import Logs

SIDE_BY_SIDE = "*"
"""[logs] table of all groups, one beside the other."""
_TIME = re.compile(r"(^|/)(t|[Tt]ime|timestamp)([_ ].*)?$")


def select_columns(
    arrays: Mapping[str, NDArray[np.generic]],
    file: str,
    logs: Logs,
    required_columns: Collection[str],
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Columns of the log that the recipe's `table` names, or of the only one there is, and texts on
    how they were found.

    Arrays are named by their path (`group/name`). A matrix needs the recipe's `names`, one per
    column; vectors are columns under their own names. Raises LogFormatError where several logs are
    possible, or none.
    """
    if logs.tables:
        return _stack_tables(arrays, file, logs, required_columns)
    if logs.table == SIDE_BY_SIDE:
        return join_vectors(_name_by_path(arrays, file), file, required_columns), ()
    inside, how = _find_group(arrays, file, logs.table)
    matrices = {
        name: array for name, array in inside.items() if array.ndim == 2 and min(array.shape) > 1
    }
    flat = {
        name: array.ravel()
        for name, array in inside.items()
        if name not in matrices and array.ndim <= 2
    }
    if len(inside) == 1 and matrices:
        ((name, matrix),) = matrices.items()
        if len(logs.names) not in matrix.shape:
            raise NamelessColumnsError(
                f"{file}: '{name or logs.table}' is a matrix of {matrix.shape[0]} ×"
                f" {matrix.shape[1]}, the recipe names {len(logs.names)} columns",
                hint="list its columns in [logs] names of the recipe, in order",
                columns=min(matrix.shape),
            )
        upright = matrix if matrix.shape[1] == len(logs.names) else matrix.T
        return make_frame({column: upright[:, k] for k, column in enumerate(logs.names)}), how
    if matrices and not flat:
        raise SeveralTablesError(
            f"{file}: {len(matrices)} matrices: {_list_names(matrices)}",
            hint="name one in [logs] table of the recipe",
            tables=list(matrices),
        )
    return join_vectors(flat, file, required_columns), how


def _stack_tables(
    arrays: Mapping[str, NDArray[np.generic]],
    file: str,
    logs: Logs,
    required_columns: Collection[str],
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Rows of several tables of the same columns, one table behind the other."""
    import pandas as pd

    frames = [
        select_columns(
            arrays, file, logs.model_copy(update={"table": table, "tables": ()}), required_columns
        )[0]
        for table in logs.tables
    ]
    for table, frame in zip(logs.tables, frames, strict=True):
        if list(frame.columns) != list(frames[0].columns):
            raise LogFormatError(
                f"{file}: table '{table}' has columns {', '.join(frame.columns)},"
                f" '{logs.tables[0]}' has {', '.join(frames[0].columns)}",
                hint="[logs] tables are parts of one log: name those with the same columns",
            )
    stacked = pd.concat(frames, ignore_index=True)
    stacked.index = stacked.index + 1 - FIRST_ROW
    return stacked, ()


def _name_by_path(
    arrays: Mapping[str, NDArray[np.generic]], file: str
) -> dict[str, NDArray[np.generic]]:
    """Vectors of all groups under their paths, one beside the other; raises LogFormatError where
    their times differ.
    """
    vectors = {
        name: array.ravel()
        for name, array in arrays.items()
        if array.dtype.kind in "fiu" and array.size > 1 and array.size == max(array.shape)
    }
    times = {name: array for name, array in vectors.items() if _TIME.search(name)}
    first = next(iter(times), "")
    for name, array in times.items():
        if not np.array_equal(array, times[first]):
            raise LogFormatError(
                f"{file}: '{name}' and '{first}' are different times, expected one clock",
                hint="name one group in [logs] table of the recipe",
            )
    return {name: array for name, array in vectors.items() if name == first or name not in times}


def _find_group(
    arrays: Mapping[str, NDArray[np.generic]], file: str, table: str
) -> tuple[dict[str, NDArray[np.generic]], tuple[str, ...]]:
    """Numeric arrays of the group that the recipe names, or of the only one, by the last part of
    their paths, and texts on which group was taken.
    """
    numeric = {
        name: array
        for name, array in arrays.items()
        if array.dtype.kind in "fiu" and array.size > 1
    }
    if table:
        named_arrays = {
            name: array
            for name, array in numeric.items()
            if name == table or name.startswith(f"{table}/")
        }
        if not named_arrays:
            raise LogFormatError(
                f"{file}: no numeric array '{table}'", hint=f"there are: {_list_names(numeric)}"
            )
        return {
            name.removeprefix(table).lstrip("/"): array for name, array in named_arrays.items()
        }, ()
    groups = {name.rpartition("/")[0] for name in numeric}
    if len(groups) > 1:
        matrices = [n for n, a in numeric.items() if a.ndim == 2 and min(a.shape) > 1]
        vectors = [name for name in numeric if name not in matrices]
        of_vectors = dict.fromkeys(name.rpartition("/")[0] for name in vectors)
        raise SeveralTablesError(
            f"{file}: arrays in {len(groups)} groups: {_list_names(numeric)}",
            hint=(
                "name one in [logs] table of the recipe; table = '*' reads groups of one clock side"
                " by side"
            ),
            tables=[*filter(None, of_vectors), *matrices],
        )
    if not numeric:
        raise LogFormatError(f"{file}: no numeric arrays", hint=f"there are: {_list_names(arrays)}")
    (group,) = groups
    inside = {name.removeprefix(group).lstrip("/"): array for name, array in numeric.items()}
    return inside, ((Guess(f"table = '{group}' (guessed)"),) if group else ())


def join_vectors(
    columns: Mapping[str, NDArray[np.generic]], file: str, required_columns: Collection[str]
) -> pd.DataFrame:
    """Frame of the vectors that are as long as the required ones; LogFormatError where those have
    several lengths.
    """
    required_lengths = {
        name: len(column)
        for name, column in columns.items()
        if delimited.is_needed(name, required_columns)
    }
    lengths = set(required_lengths.values()) or {len(column) for column in columns.values()}
    if len(lengths) > 1:
        listing = ", ".join(f"{name} {n}" for name, n in sorted(required_lengths.items())[:8])
        raise LogFormatError(
            f"{file}: columns of several lengths: {listing}",
            hint="they were logged at several rates; name the group of one in [logs] table",
        )
    if not lengths:
        raise LogFormatError(f"{file}: no columns of numbers", hint="check the file")
    return make_frame({name: column for name, column in columns.items() if len(column) in lengths})


def make_frame(columns: Mapping[str, NDArray[np.generic]]) -> pd.DataFrame:
    """Frame of columns of one length, whose index counts records: messages call record 1 line 1."""
    import pandas as pd

    frame = pd.DataFrame(
        {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    )
    frame.index = frame.index + 1 - FIRST_ROW
    return frame


def _list_names(names: Collection[str]) -> str:
    """The first twelve names, as one text."""
    return ", ".join(sorted(names)[:12]) + (" …" if len(names) > 12 else "") or "none"
