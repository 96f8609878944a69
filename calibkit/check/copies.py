"""Logs that came in twice under two names: one would vouch for the other when it is left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

SHARED = 0.9
"""Share of the shorter log's rows from which two logs are copies; noise makes the rows of two measurements differ."""
FEWEST = 3
"""Different rows below which nothing tells a copy from a log that stands still."""


def of(logs: Iterable[tuple[str, str, frozenset[bytes]]]) -> list[tuple[str, str]]:
    """Copies among logs of (file, SHA-256, first rows as `frame.first_rows`): each with what it is a copy of.

    The same bytes are a copy, and so are the same values written otherwise: other line ends, other separators, a row less.
    """
    seen: list[tuple[str, str, frozenset[bytes]]] = []
    found = []
    for file, sha256, content in logs:
        if not sha256:  # it could not be read
            continue
        said = next((said for other in seen if (said := _same((file, sha256, content), other))), "")
        if said:
            found.append((file, said))
        seen.append((file, sha256, content))
    return found


def _same(one: tuple[str, str, frozenset[bytes]], other: tuple[str, str, frozenset[bytes]]) -> str:
    """What one log shares with another, or nothing."""
    if one[1] == other[1]:
        return f"the same bytes as {other[0]}"
    fewer = min(len(one[2]), len(other[2]))
    shared = len(one[2] & other[2])
    if fewer < FEWEST or shared < SHARED * fewer:
        return ""
    return f"the same values as {other[0]}: {shared} of the first {fewer} different rows"
