"""Simulated logs with their truth beside them, and the files that hold them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

TRUTH_FILE = "truth.json"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Simulated logs and their truth."""

    logs: Mapping[str, Mapping[str, NDArray[Any]]]
    """Relative file name, to column, to values: float or int arrays of one length a log."""
    decimals: Mapping[str, int]
    """Column, to digits after the decimal point in the CSV; integer columns need none."""
    truth: Mapping[str, object]
    """What the logs were made from, JSON-able."""

    def files(self) -> dict[str, bytes]:
        """Render the logs as CSV texts and the truth as ``truth.json``: the same campaign gives the
        same bytes.

        Returns
        -------
        File name, to content: UTF-8, LF, "." decimal; a NaN is an empty field. The JSON has sorted
        keys and indent 1.

        Raises
        ------
        ValueError
            For columns of unequal length in one log, an infinite value, or a truth that is not
            finite JSON.
        KeyError
            For a float column without its decimals.

        """
        texts = {name: _csv_text(columns, self.decimals) for name, columns in self.logs.items()}
        texts[TRUTH_FILE] = (
            json.dumps(self.truth, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
            + "\n"
        )
        return {name: text.encode() for name, text in texts.items()}


def _csv_text(columns: Mapping[str, NDArray[Any]], decimals: Mapping[str, int]) -> str:
    """Columns of one length as CSV text with a header; a negative zero is written as zero, a NaN as
    an empty field.
    """
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of one log differ in length: {lengths}")
    numbers = [_printable(name, np.asarray(values), decimals) for name, values in columns.items()]
    row = ",".join(form for form, _ in numbers) + "\n"
    # one % over the whole log: a tenth of the time of formatting row by row
    body = (
        row
        * max(lengths.values(), default=0)
        % tuple(chain.from_iterable(zip(*(v for _, v in numbers), strict=True)))
    )
    return ",".join(columns) + "\n" + body.replace("nan", "")


def _printable(
    name: str, values: NDArray[Any], decimals: Mapping[str, int]
) -> tuple[str, list[float]]:
    if np.issubdtype(values.dtype, np.integer):
        return "%d", values.tolist()
    if np.isinf(values).any():
        raise ValueError(f"column {name} holds an infinite value")
    # rounded first, and zero added: the only way to a negative zero is then closed
    return f"%.{decimals[name]}f", (np.round(values, decimals[name]) + 0.0).tolist()
