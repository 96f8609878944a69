"""What a person needs to know of a result first: a sentence, a few values, a line per log, and what
to look at before the result is used.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from calibkit import units
from calibkit.numeric import gum
from calibkit.report.table import Table  # noqa: TC001 (pydantic reads annotations)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from calibkit.records.coefficients import Criterion

_NAMED = 3
"""Flags of one cause that are named beside the first."""
_NUMBER = re.compile(r"(?<!\w)[-+−]?\d[\d.,:eE]*")


@dataclass(frozen=True, slots=True)
class KeyValue:
    """A result that the first screen shows."""

    name: str
    value: float
    unit: str
    expanded_uncertainty: float = 0.0
    """0: none is stated."""

    @classmethod
    def of(cls, name: str, value: float, unit: str, u: float, dof: float | None) -> Self:
        """With the expanded uncertainty of a standard one with so many degrees of freedom (None:
        infinite), none where they are too few.
        """
        dof = math.inf if dof is None else dof
        return cls(name, value, unit, gum.coverage_factor(dof) * u if dof >= 1.0 else 0.0)

    def __str__(self) -> str:
        space = "" if self.unit in units.ANGLE_MARKS else "\N{NO-BREAK SPACE}"
        unit = "" if self.unit == "1" else f"{space}{self.unit}"
        U = self.expanded_uncertainty
        if not 0.0 < U < math.inf or not math.isfinite(self.value):
            return f"{concise(self.value)}{unit}"
        # never on two lines
        value = "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}".join(gum.rounded(self.value, U))
        value = value.replace("-", "−")
        return f"({value}){unit}" if unit else value


@dataclass(frozen=True, slots=True)
class Overview:
    """The first screen of a result; empty where an instrument states none."""

    sentence: str = ""
    """What was found, in words and units."""
    facts: tuple[str, ...] = ()
    """What matters next, one line each."""
    values: tuple[KeyValue, ...] = ()
    """At most four."""
    table: Table | None = None
    """One line per ramp, run or record."""
    data_extent: str = ""
    """How many logs, over which range."""


def concise(value: float, u: float = 0.0) -> str:
    """A value with its standard uncertainty in units of the last digits, 7.512(13); without one in
    three significant digits.
    """
    if not 0.0 < u < math.inf or not math.isfinite(value):
        return f"{float(f'{value:.3g}'):g}".replace("-", "−")
    value_text, uncertainty = gum.rounded(value, u, digits=2)
    if "." not in value_text or not uncertainty.startswith("0."):
        return f"{value_text}({uncertainty})".replace("-", "−")
    return f"{value_text}({uncertainty.removeprefix('0.').lstrip('0')})".replace("-", "−")


def describe_span(low: float, high: float, unit: str, digits: str = ".0f") -> str:
    """From a lowest to a highest value; one value where both read the same."""
    # z: a small negative number is 0, not −0
    ends = [format(end, f"z{digits}").replace("-", "−") for end in (low, high)]
    return f"{' to '.join(dict.fromkeys(ends))} {unit}"


def describe_verdict(criteria: Sequence[Criterion]) -> str:
    """Verdict in words: each limit that failed, or the one of the recipe that is nearest to
    its limit.
    """
    failed = [_describe_limit(criterion) for criterion in criteria if not criterion.passed]
    if failed:
        return f"REJECTED: {'; '.join(failed)}"
    recipe_criteria = [criterion for criterion in criteria if criterion.set_by == "recipe"]
    nearest, count = _describe_limit(max(recipe_criteria, key=_nearness)), len(criteria)
    quantifier = "both" if count == 2 else f"all {count}"
    all_met = f" is nearest to its limit; {quantifier} limits are met"
    return f"accepted: {nearest}{all_met if count > 1 else ''}"


def _describe_limit(criterion: Criterion) -> str:
    """A result beside the limit that it was judged by: name, value, at most or at least what."""
    value, limit = criterion.value, criterion.limit
    side = "at most " if (value < limit) == criterion.passed else "at least "
    unit = "" if criterion.unit == "1" else f" {criterion.unit}"
    origin, digits = (" set by calibkit", 4) if criterion.set_by == "calibkit" else ("", 6)
    bound = f"{'' if value == limit else side}{limit:.{digits}g}{unit}"
    return f"{criterion.name} {value:.4g}{unit} (limit{origin}: {bound})"


def _nearness(criterion: Criterion) -> float:
    """Ratio of the smaller of result and limit to the larger; 1 where they are the same."""
    ends = sorted((abs(criterion.value), abs(criterion.limit)))
    return ends[0] / ends[1] if ends[1] > 0.0 else 1.0


def merge_flags(flags: Iterable[str], logs: Sequence[str]) -> list[str]:
    """One line per cause: flags that differ in nothing but their log and its figures become that of
    the first log, which names the others.

    A number within a name, and one that differs within the same log or without any, says what the
    flag is about (gyro_1 or gyro_2, at 20 or 60 °C): up to three such flags stay apart, more become
    the first, which names the numbers of the others.
    """
    names = sorted(
        {part for log in logs for part in (log, log.rpartition(".")[0]) if part}, key=len
    )
    any_log = re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, reversed(names))) or '$.'})(?!\w)")
    flags_by_cause: dict[str, list[str]] = {}
    for flag in flags:
        flags_by_cause.setdefault(_NUMBER.sub("#", any_log.sub("@", flag)), []).append(flag)
    return [
        line for same_cause in flags_by_cause.values() for line in _name_others(same_cause, any_log)
    ]


def _name_others(flags: Sequence[str], any_log: re.Pattern[str]) -> Sequence[str]:
    """The first of the flags of one cause, with what tells the others from it: their logs, or the
    first of their numbers that does; the flags as they are where they are few and of one log.
    """
    parts = [
        (*any_log.findall(flag)[:1], *_NUMBER.findall(any_log.sub("@", flag))) for flag in flags
    ]
    columns = [list(dict.fromkeys(column)) for column in zip(*parts, strict=True)]
    telling = [column for column in columns if len(column) == len(flags)]
    of_logs = any_log.search(flags[0]) is not None and columns[0] in telling
    if len(flags) == 1 or (len(flags) <= _NAMED and not of_logs):
        return flags
    other_parts = [part.rstrip(",.:") for part in telling[0][1:]] if telling else []
    mentions = [f"also {', '.join(other_parts[:_NAMED])}"] if other_parts else []
    unnamed = len(flags) - 1 - len(other_parts[:_NAMED])
    return [f"{flags[0]} [{' and '.join([*mentions, *[f'{unnamed} more'] * (unnamed > 0)])}]"]
