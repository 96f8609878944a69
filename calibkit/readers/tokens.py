"""Fields of a text log: how a line is cut, and what a field can be."""

import re
from collections.abc import Sequence

from calibkit.readers import times

NUMBER = {
    ".": re.compile(r"\s*[+-]? ?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*", re.ASCII),
    ",": re.compile(r"\s*[+-]? ?(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?\s*", re.ASCII),
}
"""A number, by decimal mark; a blank after the sign is allowed."""
THOUSANDS = re.compile(r"\s*[+-]? ?[1-9]\d{0,2}(?:,\d{3})+\s*", re.ASCII)
"""A number that could also be read with a comma between its thousands."""
SENTINELS = frozenset(
    {
        "nan",
        "-nan",
        "nan(ind)",
        "-nan(ind)",
        "-1.#ind",
        "1.#qnan",
        "ovld",
        "+ovld",
        "-ovld",
        "ovrld",
        "overload",
        "ol",
        "+ol",
        "-ol",
        "llll",
        "hhhh",
        "open",
        "burnout",
        "err",
        "error",
        "#n/a",
        "n/a",
        "na",
        "null",
        "none",
        "---",
        "----",
        "-----",
        "--",
        "****",
        "*****",
        "******",
        "++++",
        "inf",
        "+inf",
        "-inf",
    }
)
"""Words, in lower case, that instruments write where they have no value; a recipe can name more."""


def split_line(line: str, delimiter: str, widths: Sequence[int] = ()) -> list[str]:
    """Fields of a line without the blanks around them."""
    if delimiter == "space":
        return re.sub(r"(?<![^\s])([+-]) +(?=[\d.,])", r"\1", line.strip()).split() or [""]
    if delimiter == "fixed":
        ends = [sum(widths[: k + 1]) for k in range(len(widths))]
        return [line[end - width : end].strip() for end, width in zip(ends, widths, strict=True)]
    if '"' in line:
        import csv

        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter), [""])]
    return [field.strip() for field in line.split(delimiter)]


def is_sentinel(field: str) -> bool:
    """Whether a field is a word for a missing value."""
    return field.strip().lower() in SENTINELS


def is_measured(field: str) -> bool:
    """Whether a field is a number or a time: something that a row has and a header has not."""
    return any(pattern.fullmatch(field) for pattern in NUMBER.values()) or times.looks_like_time(
        field
    )
