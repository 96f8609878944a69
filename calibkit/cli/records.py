"""Commands on what was kept: verify, show, diff, history."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from calibkit.cli import completion
from calibkit.cli.console import (
    error_document,
    print_data,
    print_flags,
    print_json,
    print_message,
    print_screen,
    print_summary,
)
from calibkit.cli.options import CSV, DETAILS, JSON, PATH, RUN, RUNS, command
from calibkit.cli.progress import working
from calibkit.clock import date_or_today
from calibkit.errors import CalibkitError, CoefficientError, UsageError, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from calibkit.report.summary import Summary
    from calibkit.report.table import Table

_ON = click.option(
    "--date", default=None, metavar="YYYY-MM-DD", help="of a SERIAL, the run in force on that date"
)


@command()
@click.argument("files", nargs=-1, required=True, type=PATH)
@click.option(
    "--trust",
    multiple=True,
    type=PATH,
    help="certificate whose signatures are trusted",
)
@click.option(
    "--schema-dir",
    type=PATH,
    help="folder with dcc.xsd, to hold DCCs against it",
)
@JSON
def verify(
    files: tuple[Path, ...], trust: tuple[Path, ...], schema_dir: Path | None, *, as_json: bool
) -> int:
    """Check what calibkit wrote: digests, an export's vectors, a certificate's signature,
    attachments and printed numbers.

    \b
    calibkit verify certificate.pdf --trust laboratory.pem
    calibkit verify runs/FOG-0001/r001
    calibkit verify drift_rate.json validation.json firmware/gyro.c
    """
    from calibkit import pipeline

    results: list[dict[str, Any]] = []
    failed: list[CalibkitError] = []
    for path in _follow(files):
        try:
            found = pipeline.verify(path, trust, schema_dir)
            results.append(
                {
                    "file": str(path),
                    "ok": True,
                    "what": found.what,
                    "warnings": list(found.warnings),
                }
            )
        except CalibkitError as error:
            results.append({"file": str(path), "ok": False, "what": str(error), "warnings": []})
            failed.append(error)
    worst = max(failed, key=lambda error: error.exit_code, default=None)
    if as_json:
        print_json(
            {
                "ok": not failed,
                **({"error": error_document(worst)} if worst else {}),
                "files": results,
            }
        )
    else:
        for result in results:
            line = f"{'ok    ' if result['ok'] else 'FAILED'} {result['file']}: {result['what']}"
            if result["ok"]:
                click.echo(visible(line))
            else:
                print_message(line)
            print_flags(f"{result['file']}: {warning}" for warning in result["warnings"])
    return worst.exit_code if worst else 0


@command()
@RUN
@RUNS
@_ON
@CSV
@JSON
def show(run: str, runs: Path, date: str | None, *, as_csv: bool, as_json: bool) -> int:
    """Show the coefficients of a run with units and standard uncertainties.

    \b
    calibkit show FOG-0001 --date 2026-05-01
    calibkit show runs/FOG-0001/r002 --csv
    """
    from calibkit import store
    from calibkit.report.run import list_numbers, summarize_run

    _one_format(as_csv=as_csv, as_json=as_json)
    found = store.load(store.find(run, runs, date_or_today(date) if date else ""))
    _print_found(
        lambda: {
            "ok": True,
            "run": dict(found.document),
            "records": {name: record.document() for name, record in found.records.items()},
        },
        lambda: list_numbers(found.records.values()),
        lambda: summarize_run(found.name, found.document, found.records),
        as_csv=as_csv,
        as_json=as_json,
    )
    return 0


@command()
@click.argument("before", metavar="RUN", shell_complete=completion.complete_run)
@click.argument("after", metavar="RUN", shell_complete=completion.complete_run)
@RUNS
@CSV
@JSON
def diff(before: str, after: str, runs: Path, *, as_csv: bool, as_json: bool) -> int:
    """Say what changed from one run to another, in units and in standard uncertainties of the
    difference.

    \b
    calibkit diff FOG-0001@r001 FOG-0001
    calibkit diff FOG-0001@2024-05-01 FOG-0001@2026-05-01 --json

    A coefficient has moved when it differs by more than two standard uncertainties (type A) of the
    difference.
    """
    from calibkit import instruments, store
    from calibkit.history import difference_tables as tables
    from calibkit.history.difference import compare_runs

    _one_format(as_csv=as_csv, as_json=as_json)
    old, new = (store.load(store.find(run, runs)) for run in (before, after))
    found = compare_runs(old, new, instruments.model_forms)
    _print_found(
        lambda: {"ok": True, **tables.difference_document(found)},
        lambda: tables.list_changes(found),
        lambda: tables.summarize_difference(found),
        as_csv=as_csv,
        as_json=as_json,
    )
    return 0


@command()
@click.argument("serial", shell_complete=completion.complete_run)
@RUNS
@click.option(
    "--only",
    default="",
    metavar="PATTERN",
    help="coefficients and figures to follow, stage.model.name",
)
@click.option("--figure", type=PATH, help="PDF or PNG to write: each quantity over time")
@CSV
@DETAILS
@JSON
def history(
    serial: str, runs: Path, only: str, figure: Path | None, *, as_csv: bool, as_json: bool
) -> int:
    """List all runs of a serial: which holds when, whether each supersedes the one before, how its
    key values moved and when they will reach their limits.

    \b
    calibkit history FOG-0001
    calibkit history FOG-0001 --only 'gyro_scale.*.K' --figure drift.pdf

    Exit code 4 where a revision is missing, cannot be trusted, or does not supersede the one
    before.
    """
    from calibkit import instruments, new_files
    from calibkit.history import figure as drawing, timeline_tables as tables
    from calibkit.history.timeline import Timeline
    from calibkit.results import key_values

    _one_format(as_csv=as_csv, as_json=as_json)
    with working("reading runs"):
        found = Timeline.read(serial, runs, instruments.model_forms, only)
        followed, left_out = ((), ()) if only else key_values.follow(found.runs)
        if figure is not None:
            first = [key_values.draw(serial, followed)] if followed else []
            new_files.write_new(figure, drawing.render(found, figure.suffix, first))
    broken = None
    if not found.sound:
        faults = (*(entry.reason for entry in found.refused), *found.breaks)
        broken = CoefficientError(
            f"{serial}: {faults[0]}", hint="restore the run folders from a copy"
        )
    error = {"error": error_document(broken)} if broken else {}
    _print_found(
        lambda: {
            "ok": found.sound,
            **error,
            "key_values": list(key_values.documents(followed)),
            **tables.timeline_document(found),
        },
        lambda: tables.list_points(found),
        lambda: tables.summarize_timeline(found, key_values.tabulate(followed), left_out),
        screen=True,
        as_csv=as_csv,
        as_json=as_json,
    )
    return broken.exit_code if broken else 0


def _follow(files: Sequence[Path]) -> Iterator[Path]:
    """Files one after the other, with a progress bar on a terminal."""
    with working("verifying") as progress:
        for path, _ in zip(files, progress([*map(str, files)], "verifying"), strict=True):
            yield path


def _one_format(*, as_csv: bool, as_json: bool) -> None:
    """Refuse two formats at once."""
    if as_csv and as_json:
        raise UsageError("--csv and --json are two formats", hint="ask for one")


def _print_found(
    document: Callable[[], dict[str, Any]],
    numbers: Callable[[], Table],
    summary: Callable[[], Summary],
    *,
    screen: bool = False,
    as_csv: bool,
    as_json: bool,
) -> None:
    """Print what was found as one JSON document, as CSV with one line per number, as tables or as
    the first screen.
    """
    if as_json:
        print_json(document())
    elif as_csv:
        print_data(numbers().to_csv())
    elif screen:
        print_screen(summary(), below=0, always=True)
    else:
        print_summary(summary())
