"""The summary of a run: the same tables on the console and in report.txt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from calibkit.coefficients import Criterion
    from calibkit.report.table import Table


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
    def accepted(self) -> bool:
        """Whether no acceptance limit failed."""
        return all(criterion.passed for criterion in self.criteria)

    @property
    def verdict(self) -> str:
        """One sentence on the acceptance limits; without limits nothing is called accepted."""
        if self.conclusion:
            return self.conclusion
        if not self.criteria:
            return "no acceptance limits in the recipe: nothing was accepted or rejected"
        failed = [c for c in self.criteria if not c.passed]
        if not failed:
            return f"accepted: {len(self.criteria)} of {len(self.criteria)} limits held"
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

        console.print(Text(self.title, style="bold"))
        for table in self.tables:
            shown = Table(
                title=Text(table.title),
                title_justify="left",
                title_style="",
                box=box.SIMPLE_HEAD,
                pad_edge=False,
            )
            for at, head in enumerate(table.heads):
                shown.add_column(Text(head), justify="right" if at else "left", overflow="fold")
            for row in table.texts:
                shown.add_row(*map(Text, row))
            console.print(shown)
        for flag in self.flags:
            console.print(Text(f"! {flag}", style="yellow"))
        judged = "green" if self.accepted else "bold red"
        console.print(Text(self.verdict, style=judged if self.criteria else ""))


def number(value: float, digits: int = 4) -> str:
    """A number in a few significant digits, without an exponent where one can do without."""
    return f"{value:.{digits}g}"
