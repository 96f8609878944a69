"""The summary of a run: its first screen, and the same tables on the console and in report.txt."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from calibkit.errors import visible
from calibkit.records import run_document
from calibkit.records.frame import Remark
from calibkit.report.overview import Overview, describe_verdict, merge_flags

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from calibkit.records.coefficients import Criterion
    from calibkit.records.run_document import Verdict
    from calibkit.report.table import Table

STYLES: Mapping[str, str] = {"accepted": "green", "rejected": "bold red", "no verdict": ""}


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

    def text(self) -> str:
        """Summary as plain text of 110 columns, the same bytes on every machine."""
        import io

        from rich.console import Console

        buffer = io.StringIO()
        console = Console(
            file=buffer,
            width=110,
            color_system=None,
            force_terminal=False,
            force_jupyter=False,  # a notebook would show the text, and the file would be empty
            legacy_windows=False,
            _environ={},
        )
        self.show(console)
        return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"

    def show(self, console: Console) -> None:
        """Print a summary on a console; the first column of a table is left-aligned."""
        from rich import box
        from rich.table import Table
        from rich.text import Text

        console.print(Text(visible(self.title), style="bold"))
        overview = self.overview
        for line in filter(None, (overview.data_extent, overview.sentence, *overview.facts)):
            console.print(Text(visible(line)))
        for table in self.tables:
            drawn = Table(
                title=Text(visible(table.title)),
                title_justify="left",
                title_style="",
                box=box.SIMPLE_HEAD,
                pad_edge=False,
            )
            for column, head in enumerate(table.heads):
                drawn.add_column(
                    Text(visible(head)), justify="right" if column else "left", overflow="fold"
                )
            for row in table.texts:
                drawn.add_row(*(Text(visible(cell, lines=True)) for cell in row))
            console.print(drawn)
        for flag in self.flags:
            remark = isinstance(flag, Remark)
            text = visible(flag) if remark else f"! {visible(flag)}"
            console.print(Text(text, style="" if remark else "yellow"))
        console.print(
            Text(visible(self.last_line), style="" if self.conclusion else STYLES[self.verdict])
        )


def number(value: float, digits: int = 4) -> str:
    """A number in a few significant digits, without an exponent where one can do without."""
    return f"{value:.{digits}g}"
