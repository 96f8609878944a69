"""The command that follows, as it is typed."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from calibkit import instruments, recipe
from calibkit.commands.pipeline import FitOutcome
from calibkit.records import store
from calibkit.report.documents import PAGE


def _command_line(*words: object) -> str:
    """A call of calibkit, as it is typed."""
    return f"calibkit {shlex.join(map(str, words))}"


def _name_run(run: store.StoredRun, runs: Path) -> tuple[str, ...]:
    """Words that name a run on the command line: its serial, and the folder of runs where that is
    not the default.
    """
    return (run.name, *(() if runs == Path("runs") else ("--runs", str(runs))))


def follow_check(source: recipe.Source, name: str, data: Path) -> str:
    """Last line of a check's screen where nothing is refused: the fit of the same logs."""
    serial = () if instruments.parse_recipe(source).serial else ("--serial", "SERIAL")
    changed = (word for text in source.overrides for word in ("--set", text))
    return f"Next: {_command_line('fit', name, '--data', data, *serial, *changed)}"


def follow_fit(
    outcome: FitOutcome, runs: Path, name: str, data: Path, overrides: Sequence[str]
) -> tuple[str, str]:
    """Last lines of a fit's screen: where the report is, which files firmware takes and how, or
    what a rejected run and a procedure without firmware ask for.
    """
    run, shown = outcome.run, outcome.shown
    report = f"Report: {run.folder / PAGE}"
    if run.document["verdict"] == "rejected":
        changed = (word for text in overrides for word in ("--set", text))
        return report, f"Next: {_command_line('check', name, '--data', data, *changed)}"
    if shown.no_firmware or not shown.exported:
        why = f"No firmware: {shown.no_firmware}. " if shown.no_firmware else ""
        return report, f"{why}Next: {_command_line('show', *_name_run(run, runs))}"
    out = f"firmware/{run.document['serial']}"
    call = _command_line("export", *_name_run(run, runs), "--target", "c", "--out", out)
    return report, f"Load {', '.join(shown.exported)} into the firmware. Next: {call}"
