"""The summary of a run: the same tables on the console and in report.txt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit import run_document
from calibkit.errors import visible

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from calibkit.coefficients import Criterion
    from calibkit.report.table import Table
    from calibkit.run_document import Verdict

STYLES: Mapping[str, str] = {"accepted": "green", "rejected": "bold red", "no verdict": ""}


@dataclass(frozen=True, slots=True)
class Summary:
    """Everything that a command prints for a person at its end."""

    title: str
    tables: tuple[Table, ...]
    flags: tuple[str, ...]
    criteria: tuple[Criterion, ...]
    conclusion: str = ""
    """Last line instead of the verdict on acceptance limits, where there is nothing to accept."""

    @property
    def verdict(self) -> Verdict:
        """Verdict on the criteria."""
        return run_document.judge(self.criteria)

    @property
    def last_line(self) -> str:
        """One sentence on the verdict, with each limit that failed."""
        if self.conclusion:
            return self.conclusion
        if self.verdict == "no verdict":
            return run_document.NO_VERDICT
        failed = [c for c in self.criteria if not c.passed]
        if not failed:
            return f"accepted: {len(self.criteria)} of {len(self.criteria)} limits met"
        return "REJECTED: " + "; ".join(
            f"{c.name} {c.value:.6g} against {c.limit:.6g}{f' {c.unit}' if c.unit != '1' else ''}"
            for c in failed
        )

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
        for table in self.tables:
            shown = Table(
                title=Text(visible(table.title)),
                title_justify="left",
                title_style="",
                box=box.SIMPLE_HEAD,
                pad_edge=False,
            )
            for at, head in enumerate(table.heads):
                shown.add_column(
                    Text(visible(head)), justify="right" if at else "left", overflow="fold"
                )
            for row in table.texts:
                shown.add_row(*(Text(visible(cell, lines=True)) for cell in row))
            console.print(shown)
        for flag in self.flags:
            console.print(Text(f"! {visible(flag)}", style="yellow"))
        console.print(
            Text(visible(self.last_line), style="" if self.conclusion else STYLES[self.verdict])
        )


def number(value: float, digits: int = 4) -> str:
    """A number in a few significant digits, without an exponent where one can do without."""
    return f"{value:.{digits}g}"
