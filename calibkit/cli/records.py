"""Commands on what was kept: verify, show, history."""

from __future__ import annotations

import datetime as dt
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
from calibkit.errors import (
    CalibkitError,
    CoefficientError,
    NotCheckedError,
    UsageError,
    visible,
)
from calibkit.records.clock import date_or_today

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from calibkit.certificate.signature_trust import Demands
    from calibkit.certificate.verify import Verified
    from calibkit.report.summary import Summary
    from calibkit.report.table import Table

_STATES = {(True, True): "ok    ", (False, True): "FAILED", (False, False): "-     "}
"""What stands before a file: whether it is sound, whether it was checked."""


@command()
@click.argument("files", nargs=-1, required=True, type=PATH)
@click.option(
    "--trust",
    multiple=True,
    type=PATH,
    help="signer's certificate, or its authority's: no other signature is accepted",
)
@click.option(
    "--trust-timestamp",
    multiple=True,
    type=PATH,
    help="certificate of an authority that is trusted for time stamps alone",
)
@click.option("--require-signature", is_flag=True, help="refuse what is not signed")
@click.option(
    "--at",
    metavar="YYYY-MM-DD",
    help="date of signing, where no time stamp states it: the signer is judged for that date",
)
@click.option(
    "--schema-dir",
    type=PATH,
    help="folder with dcc.xsd, to check DCCs by it",
)
@JSON
def verify(
    files: tuple[Path, ...],
    trust: tuple[Path, ...],
    trust_timestamp: tuple[Path, ...],
    at: str | None,
    schema_dir: Path | None,
    *,
    require_signature: bool,
    as_json: bool,
) -> int:
    """Check what calibkit wrote: digests, an export's vectors, a certificate's signature,
    attachments and printed numbers.

    \b
    calibkit verify certificate.pdf certificate.xml --trust laboratory.pem
    calibkit verify certificate.pdf --trust laboratory.pem --at 2026-11-21
    calibkit verify runs/FOG-0001/r001
    calibkit verify drift_rate.json validation.json firmware/gyro.c

    A DCC is compared with the PDFs that are named with it. Exit code 4 where anything is wrong, 5
    where a library that checks is missing.
    """
    from calibkit.certificate.signature_trust import Demands

    signing_date = date_or_today(at, "--at") if at else None
    demands = Demands(
        trust=trust,
        trust_timestamp=trust_timestamp,
        required=require_signature,
        at=dt.date.fromisoformat(signing_date) if signing_date else None,
    )
    results, failed = _verify_all(files, demands, schema_dir)
    worst = max(failed, key=_weigh, default=None)
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
            line = f"{_STATES[result['ok'], result['checked']]} {result['file']}: {result['what']}"
            if result["ok"]:
                click.echo(visible(line))
            else:
                print_message(visible(line))
            print_flags(visible(f"{result['file']}: {warning}") for warning in result["warnings"])
    return worst.exit_code if worst else 0


def _weigh(error: CalibkitError) -> float:
    """Which of several errors a command ends with: what is wrong stands over what was not
    checked.
    """
    return 3.5 if isinstance(error, NotCheckedError) else error.exit_code


def _verify_all(
    files: Sequence[Path], demands: Demands, schema_dir: Path | None
) -> tuple[list[dict[str, Any]], list[CalibkitError]]:
    """What each file was found to be, in their order, and every error; PDFs are read first, as DCCs
    are compared with them.
    """
    from calibkit.commands import pipeline

    results: dict[Path, dict[str, Any]] = {}
    failed: list[CalibkitError] = []
    verified_pdfs: dict[Path, Verified] = {}
    for path in _follow(sorted(files, key=lambda path: path.suffix.lower() != ".pdf")):
        base_result = {
            "file": str(path),
            "ok": True,
            "checked": True,
            "warnings": [],
            "signatures": [],
        }
        try:
            verified = pipeline.verify(path, demands, schema_dir, verified_pdfs)
        except CalibkitError as error:
            checked = not isinstance(error, NotCheckedError)
            what = str(error).removeprefix(f"{path}: ")
            results[path] = base_result | {"ok": False, "checked": checked, "what": what}
            failed.append(error)
            continue
        if path.suffix.lower() == ".pdf":
            verified_pdfs[path] = verified
        results[path] = base_result | {
            "what": verified.what,
            "warnings": list(verified.warnings),
            "signatures": [signature.document() for signature in verified.signatures],
        }
    return [results[path] for path in files], failed


@command()
@RUN
@RUNS
@CSV
@JSON
def show(run: str, runs: Path, *, as_csv: bool, as_json: bool) -> int:
    """Show the coefficients of a run with units and standard uncertainties.

    \b
    calibkit show FOG-0001@2026-05-01
    calibkit show runs/FOG-0001/r002 --csv
    """
    from calibkit.records import store
    from calibkit.report.run import list_numbers, summarize_run

    _one_format(as_csv=as_csv, as_json=as_json)
    stored_run = store.load(store.find(run, runs))
    _print_found(
        lambda: {
            "ok": True,
            "run": dict(stored_run.document),
            "records": {name: record.document() for name, record in stored_run.records.items()},
        },
        lambda: list_numbers(stored_run.records.values()),
        lambda: summarize_run(stored_run.name, stored_run.document, stored_run.records),
        as_csv=as_csv,
        as_json=as_json,
    )
    return 0


@command()
@click.argument("serial", shell_complete=completion.complete_run)
@RUNS
@click.option("--figure", type=PATH, help="PDF or PNG to write: each key value over time")
@CSV
@DETAILS
@JSON
def history(serial: str, runs: Path, figure: Path | None, *, as_csv: bool, as_json: bool) -> int:
    """List all runs of a serial: which holds when, whether each supersedes the one before, how its
    key values moved and when they will reach their limits.

    \b
    calibkit history FOG-0001
    calibkit history FOG-0001 --figure drift.pdf

    Exit code 4 where a revision is missing, cannot be trusted, or does not supersede the one
    before.
    """
    from calibkit.history import timeline_tables as tables
    from calibkit.history.timeline import Timeline
    from calibkit.records import new_files
    from calibkit.results import figures, key_values

    _one_format(as_csv=as_csv, as_json=as_json)
    if figure is not None:
        figures.require_suffix(figure.suffix)
    with working("reading runs"):
        timeline = Timeline.read(serial, runs)
        followed, left_out = key_values.follow(timeline.runs)
        if figure is not None:
            picture = key_values.draw(serial, followed)
            new_files.write_new(figure, figures.render(picture, figure.suffix))
    broken = None
    if not timeline.sound:
        faults = (*timeline.refused.values(), *timeline.breaks)
        broken = CoefficientError(
            f"{serial}: {faults[0]}", hint="restore the run folders from a copy"
        )
    error = {"error": error_document(broken)} if broken else {}
    _print_found(
        lambda: {
            "ok": timeline.sound,
            **error,
            "key_values": list(key_values.documents(followed)),
            **tables.timeline_document(timeline),
        },
        lambda: key_values.list_values(followed),
        lambda: tables.summarize_timeline(timeline, key_values.tabulate(followed), left_out),
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
        print_screen(summary(), lines_below=0, always=True)
    else:
        print_summary(summary())
