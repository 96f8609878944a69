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
GROUPED = {
    decimal: re.compile(
        rf"\s*[+-]? ?[1-9]\d{{0,2}}(?:(?:{mark}\d{{3}})+|(?:['’]\d{{3}})+"
        rf"|(?:[ \u00a0\u202f]\d{{3}})+)"
        rf"(?:{re.escape(decimal)}\d*)?(?:[eE][+-]?\d+)?\s*",
        re.ASCII,
    )
    for decimal, mark in ((".", ","), (",", r"\."))
}
"""A number with a mark between its thousands, by decimal mark."""
COMMENT = re.compile(
    r"\s*(?:#+(?!(?:N/A|DIV/0|NUM!|VALUE!|REF!|NAME\?|NULL!)|\s*[,;\t|])|%+|//+)[ \t]*",
    re.IGNORECASE,
)
"""What a comment begins with; an error of a spreadsheet does so too, and a column called #."""
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


def is_comment(line: str) -> bool:
    """Whether a line is a comment: one that begins with #, % or //."""
    return COMMENT.match(line) is not None


def is_number(field: str, decimal: str) -> bool:
    """Whether a field is a number with this decimal mark, with or without a mark between its
    thousands.
    """
    return bool(NUMBER[decimal].fullmatch(field) or GROUPED[decimal].fullmatch(field))


def is_sentinel(field: str) -> bool:
    """Whether a field is a word for a missing value."""
    return field.strip().lower() in SENTINELS


def is_measured(field: str) -> bool:
    """Whether a field is a number or a time: something that a row has and a header has not."""
    return any(is_number(field, mark) for mark in NUMBER) or times.looks_like_time(field)
