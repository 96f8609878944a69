"""Command line: parse, call, print, exit status; nothing else. Heavy libraries are imported inside
the commands.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from calibkit.cli import completion, firmware, fleets, records
from calibkit.cli.clock import day_of, now
from calibkit.cli.console import (
    note,
    prepare,
    print_data,
    print_json,
    print_verdict,
    print_written,
    progress,
    say,
    tell,
)
from calibkit.cli.ending import guarded
from calibkit.cli.memory import settle
from calibkit.cli.options import (
    DATA,
    DRY,
    JSON,
    RECIPE,
    RUN,
    RUNS,
    SET,
    Group,
    rehearsed,
)
from calibkit.cli.pipe import forgive
from calibkit.errors import FrameError
from calibkit.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.certificate.certify import Issued
    from calibkit.certificate.words import Lang


@click.group(
    cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(__version__, prog_name="calibkit", message="%(prog)s %(version)s")
def cli() -> None:
    """From laboratory logs to versioned coefficient files of gyros, accelerometers and
    inclinometers.

    \b
    calibkit fit fog_thermal --data logs --serial FOG-0001
    calibkit apply FOG-0001 --data field.csv --out compensated.csv

    Exit codes: 0 accepted, 1 an acceptance limit failed, 2 usage or recipe, 3 data unreadable or
    unusable, 4 output or verification, 70 internal error, 130 interrupted.
    """


@cli.command()
@RECIPE
@DATA
@click.option(
    "--serial", default="", help="serial number of the instrument (default: the recipe's)"
)
@click.option(
    "--out",
    default="runs",
    show_default=True,
    type=click.Path(path_type=Path),
    help="where runs are kept",
)
@click.option(
    "--date",
    default=None,
    metavar="YYYY-MM-DD",
    help="date from which the coefficients hold (default: today)",
)
@DRY
@SET
@JSON
def fit(
    recipe: str,
    data: Path,
    serial: str,
    out: Path,
    date: str | None,
    overrides: tuple[str, ...],
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Fit a recipe to the logs of a folder and write a run folder.

    \b
    calibkit fit fog_thermal --data logs --serial FOG-0001
    calibkit fit my_recipe.toml --data logs --serial FOG-0001 --set drift.order=2 --json
    """
    settle()
    day = day_of(date)
    from calibkit import pipeline
    from calibkit.recipe import find

    outcome = pipeline.fit(
        find(recipe, overrides), data, serial, out, day, progress, dry_run=dry_run
    )
    for entry in outcome.document["inputs"]:
        tell(f"read {entry['name']}: {entry['rows']} rows, sha256 {entry['sha256']}")
    for guess in outcome.guesses:
        say(f"? {guess}")
    if as_json:
        where = {"run": outcome.name, "folder": str(outcome.folder), **rehearsed(dry_run=dry_run)}
        print_json({"ok": True, **where, **_verdict(outcome.document)})
    else:
        print_verdict(outcome.summary)
        print_written((outcome.folder,), dry_run=dry_run)
        note("wrote", f"{outcome.folder}{' (dry run: not written)' if dry_run else ''}")
    return 0 if outcome.summary.accepted else 1


@cli.command()
@RECIPE
@DATA
@click.option(
    "--figure", default=None, type=click.Path(path_type=Path), help="PDF to write, one page a log"
)
@SET
@JSON
def check(
    recipe: str, data: Path, figure: Path | None, overrides: tuple[str, ...], *, as_json: bool
) -> int:
    """Say what would be read and what is wrong with it; nothing is fitted.

    \b
    calibkit check fog_thermal --data logs
    calibkit check my_recipe.toml --data logs --json --figure logs.pdf
    """
    settle()
    from calibkit import pipeline
    from calibkit.check.report import document, lines
    from calibkit.recipe import find

    reports = pipeline.check(find(recipe, overrides), data, figure)
    if as_json:
        print_json(document(reports))
    else:
        click.echo("\n".join(line for report in reports for line in lines(report)))
    return FrameError.exit_code if any(report.refused for report in reports) else 0


@cli.command()
@click.option(
    "--from", "folder", required=True, type=click.Path(path_type=Path), help="folder with the logs"
)
@JSON
def init(folder: Path, *, as_json: bool) -> int:
    """Propose a recipe for the logs of a folder, on stdout.

    \b
    calibkit init --from logs > my_recipe.toml
    calibkit init --from logs --json
    """
    from calibkit import pipeline

    proposal = pipeline.init(folder)
    if as_json:
        print_json({"ok": True, "recipe": proposal.text})
    else:
        print_data(proposal.text)
        if proposal.note:
            say(f"? {proposal.note}")
    return 0


@cli.command()
@RUN
@click.option("--data", required=True, type=click.Path(path_type=Path), help="one log")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="file to write")
@click.option(
    "--as-firmware",
    default=None,
    metavar="NUMBER",
    help="as the export in f32, f64, q31 or q15 will do it",
)
@SET
@RUNS
@DRY
@JSON
def apply(
    run: str,
    data: Path,
    out: Path,
    as_firmware: str | None,
    overrides: tuple[str, ...],
    runs: Path,
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Compensate a log with the coefficients of a run; every row and column is written.

    \b
    calibkit apply FOG-0001 --data field.csv --out compensated.csv
    calibkit apply runs/INC-7/r002 --data well.csv --out corrected.csv --set site.latitude_deg=58.9
    """
    settle()
    from calibkit import pipeline, store

    found = store.load(store.find(run, runs))
    flags = pipeline.apply(found, data, out, overrides, as_firmware=as_firmware, dry_run=dry_run)
    if as_json:
        print_json(
            {
                "ok": True,
                "run": found.name,
                "out": str(out),
                "flags": list(flags),
                **rehearsed(dry_run=dry_run),
            }
        )
    else:
        for flag in flags:
            say(f"! {flag}")
        print_written((out,), dry_run=dry_run)
    return 0


@cli.command()
@RUN
@DATA
@click.option("--out", required=True, type=click.Path(path_type=Path), help="JSON file to write")
@RUNS
@DRY
@JSON
def validate(run: str, data: Path, out: Path, runs: Path, *, dry_run: bool, as_json: bool) -> int:
    """Hold frozen coefficients against logs they have not seen: before, after, rate gain.

    \b
    calibkit validate FOG-0001 --data withheld --out validation.json
    calibkit validate FOG-0001@r002 --data withheld --out validation.json --json
    """
    settle()
    from calibkit import pipeline, store

    document, summary = pipeline.validate(
        store.load(store.find(run, runs)), data, out, progress, dry_run=dry_run
    )
    if as_json:
        print_json({"ok": True, **document, **rehearsed(dry_run=dry_run)})
    else:
        print_verdict(summary)
        print_written((out,), dry_run=dry_run)
    return 0 if summary.accepted else 1


@cli.command()
@RUN
@click.option("--out", required=True, type=click.Path(path_type=Path), help="PDF file to write")
@click.option(
    "--profile", type=click.Path(path_type=Path), help="laboratory profile; without one: a DRAFT"
)
@click.option(
    "--validation",
    type=click.Path(path_type=Path),
    help="as found and as left, from calibkit validate",
)
@click.option("--date", default=None, metavar="YYYY-MM-DD", help="date of issue (default: today)")
@click.option("--lang", type=click.Choice(["en", "zh", "both"]), default="en", show_default=True)
@click.option(
    "--sign",
    "key",
    type=click.Path(path_type=Path),
    help="PKCS#12 key; CALIBKIT_SIGN_PASSPHRASE opens it",
)
@click.option(
    "--schema-dir",
    type=click.Path(path_type=Path),
    help="folder with dcc.xsd, to hold the DCC against it",
)
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="table.key=value",
    help="override a key of the profile",
)
@RUNS
@DRY
@JSON
def certify(
    run: str,
    out: Path,
    profile: Path | None,
    validation: Path | None,
    date: str | None,
    lang: Lang,
    key: Path | None,
    schema_dir: Path | None,
    overrides: tuple[str, ...],
    runs: Path,
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Write the calibration certificate of a run as PDF/A-3 with its DCC; what is missing makes it
    a DRAFT.

    \b
    calibkit certify FOG-0001 --profile lab.toml --out certificate.pdf
    calibkit certify FOG-0001 --profile lab.toml --validation v.json --lang both --out c.pdf
    calibkit certify FOG-0001 --profile lab.toml --sign key.p12 --out certificate.pdf
    """
    day = day_of(date)
    from calibkit import store
    from calibkit.certificate import certify as certificates
    from calibkit.certificate import sign
    from calibkit.instruments import certificate_layout

    issued = certificates.certify(
        store.find(run, runs),
        out,
        certificate_layout,
        date=day,
        profile_path=profile,
        validation=validation,
        lang=lang,
        overrides=overrides,
        schema_dir=schema_dir,
        key=None if key is None else sign.Key(key, os.environ.get(sign.PASSPHRASE, ""), now()),
        dry_run=dry_run,
    )
    if rejection := issued.certificate.rejection.en:
        say(f"! {rejection}")
    if as_json:
        print_json({"ok": True, **certificates.said(issued), **rehearsed(dry_run=dry_run)})
    else:
        _tell_missing(issued)
        print_written(issued.files, dry_run=dry_run)
    return 0


for kept in (
    fleets.fleet,
    firmware.export,
    records.verify,
    records.show,
    records.diff,
    records.history,
):
    cli.add_command(kept)


@cli.command()
@click.argument("procedure")
@click.option(
    "--out", required=True, type=click.Path(path_type=Path), help="folder to write the logs into"
)
@click.option("--seed", required=True, type=click.IntRange(min=0), help="seed of everything random")
@DRY
@JSON
def simulate(procedure: str, out: Path, seed: int, *, dry_run: bool, as_json: bool) -> int:
    """Write realistic logs of a simulated instrument with their truth beside them.

    \b
    calibkit simulate fog_thermal --out logs --seed 1
    calibkit simulate fog_thermal --out logs --seed 2 --json
    """
    from calibkit import pipeline

    written = pipeline.simulate(procedure, out, seed, dry_run=dry_run)
    if as_json:
        print_json({"ok": True, "files": written, **rehearsed(dry_run=dry_run)})
    else:
        print_written(written, dry_run=dry_run)
    return 0


@cli.command("completion")
@click.argument("shell", type=click.Choice(completion.SHELLS))
@JSON
def complete(shell: str, *, as_json: bool) -> int:
    """Print the script that lets a shell complete commands, options, recipes, serials and
    revisions.

    \b
    calibkit completion bash >> ~/.bashrc
    calibkit completion fish > ~/.config/fish/completions/calibkit.fish
    """
    text = completion.script(shell, cli)
    if as_json:
        print_json({"ok": True, "shell": shell, "script": text})
    else:
        print_data(text)
    return 0


def _tell_missing(issued: Issued) -> None:
    """Say what makes a certificate a DRAFT."""
    if issued.missing:
        say("DRAFT: not a calibration certificate; missing:")
    for item in issued.missing:
        say(f"  {item.key}: {item.what.en}")


def _verdict(document: Any) -> dict[str, Any]:  # noqa: ANN401 (a JSON object)
    """What --json says of a run."""
    keys = (
        "serial",
        "revision",
        "procedure",
        "effective_from",
        "accepted",
        "acceptance",
        "uncertainty",
        "flags",
        "files",
    )
    return {key: document[key] for key in keys}


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with the contract's codes."""
    # one thread a factorisation: these are tall and narrow, threads only wait for each other, and
    # the sums keep their order
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    argv = list(sys.argv[1:] if arguments is None else arguments)
    forgive()
    prepare(argv)
    sys.exit(
        guarded(
            lambda: cli.main(argv, prog_name="calibkit", standalone_mode=False),
            as_json="--json" in argv,
        )
    )
