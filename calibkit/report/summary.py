"""The summary of a run: its first screen, its tables, its flags and its verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from calibkit.records import run_document
from calibkit.records.frame import Remark
from calibkit.report.overview import Overview, describe_verdict, merge_flags

if TYPE_CHECKING:
    from calibkit.records.coefficients import Criterion
    from calibkit.records.run_document import Verdict
    from calibkit.report.table import Table


@dataclass(frozen=True, slots=True)
class Summary:
    """Everything that a command prints for a person at its end."""

    title: str
    tables: tuple[Table, ...] = ()
    flags: tuple[str, ...] = ()
    criteria: tuple[Criterion, ...] = ()
    conclusion: str = ""
    """Last line instead of the verdict on acceptance limits, where there is nothing to accept."""
    overview: Overview = field(default_factory=Overview)
    """What the first screen shows."""
    logs: tuple[str, ...] = ()
    """Names of the logs that flags may be about."""

    @property
    def verdict(self) -> Verdict:
        """Verdict on the criteria."""
        return run_document.judge(self.criteria)

    @property
    def last_line(self) -> str:
        """One sentence on the verdict, with each limit that failed, or the closest of those met."""
        if self.conclusion:
            return self.conclusion
        if self.verdict == "no verdict":
            return run_document.NO_VERDICT
        return describe_verdict(self.criteria)

    @property
    def checks(self) -> list[str]:
        """What to look at before the result is used, one line per cause; remarks are not."""
        return merge_flags((flag for flag in self.flags if not isinstance(flag, Remark)), self.logs)


def number(value: float, digits: int = 4) -> str:
    """A number in a few significant digits, without an exponent where one can do without."""
    return f"{value:.{digits}g}"
