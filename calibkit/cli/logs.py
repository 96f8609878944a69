"""Commands on logs: fit, check, init, apply, validate, simulate."""

from pathlib import Path

import click

from calibkit.cli.console import (
    print_all_or_screen,
    print_data,
    print_detail,
    print_done,
    print_flags,
    print_guesses,
    print_json,
    print_result,
    print_screen,
)
from calibkit.cli.memory import tune_memory
from calibkit.cli.options import (
    DATA,
    DETAILS,
    DRY,
    JSON,
    KEEP,
    PATH,
    RECIPE,
    RUN,
    RUNS,
    SET,
    SINCE,
    command,
)
from calibkit.cli.progress import working
from calibkit.errors import UsageError
from calibkit.records.clock import date_or_today

VERDICT_KEYS = (
    "serial",
    "revision",
    "procedure",
    "effective_from",
    "verdict",
    "accepted",
    "acceptance",
    "uncertainty",
    "flags",
    "files",
)
"""What --json prints of a run.json."""


@command()
@RECIPE
@DATA
@click.option(
    "--serial", default="", help="serial number of the instrument (default: the recipe's)"
)
@KEEP
@SINCE
@DRY
@SET
@DETAILS
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
    calibkit fit my_recipe.toml --data logs --serial FOG-1 --set drift.order=2
    """
    tune_memory()
    date = date_or_today(date) if date else None
    from calibkit.cli.next_command import follow_fit
    from calibkit.commands import pipeline
    from calibkit.recipe import find

    source = find(recipe, overrides)
    with working("fitting, drawing the report") as progress:
        outcome = pipeline.fit(source, data, serial, out, date, progress, dry_run=dry_run)
    run, folder = outcome.run, outcome.run.folder
    for entry in run.document["inputs"]:
        print_detail(f"read {entry['name']}: {entry['rows']} rows, sha256 {entry['sha256']}")
    print_guesses(outcome.guesses)
    if outcome.overlaps:
        print_done("joined", outcome.overlaps)
    if not as_json:
        tail = () if dry_run else follow_fit(outcome, out, recipe, data, overrides)
        print_screen(outcome.summary, tail)
    document = {
        "run": run.name,
        "folder": str(folder),
        **({"dry_run": True} if dry_run else {}),
        **{key: run.document[key] for key in VERDICT_KEYS},
    }
    print_result(document, (folder,), as_json=as_json, dry_run=dry_run)
    return 1 if outcome.summary.verdict == "rejected" else 0


@command()
@RECIPE
@DATA
@click.option("--figure", default=None, type=PATH, help="PDF to write, one page per log")
@SET
@DETAILS
@JSON
def check(
    recipe: str, data: Path, figure: Path | None, overrides: tuple[str, ...], *, as_json: bool
) -> int:
    """Print what would be read, what is wrong with it, and what it would determine; nothing is
    written.

    \b
    calibkit check fog_thermal --data logs
    calibkit check my_recipe.toml --data logs --json --figure logs.pdf
    """
    tune_memory()
    from calibkit.check.report import compose_report, report_document
    from calibkit.cli.next_command import follow_check
    from calibkit.commands import inspection
    from calibkit.planning import document as plan_file
    from calibkit.recipe import find

    source = find(recipe, overrides)
    with working("fitting on trial") as progress:
        campaign = inspection.check(source, data, figure, progress, plan_file.beside(Path(recipe)))
    if as_json:
        print_json(report_document(campaign))
    else:
        refused = campaign.judgement.exit_code
        tail = () if refused else (follow_check(source, recipe, data),)
        print_all_or_screen(lambda width: compose_report(campaign, tail, width))
    return campaign.judgement.exit_code


@command()
@click.option("--from", "folder", required=True, type=PATH, help="folder with the logs")
@click.option("--sheet", default="", help="sheet of the workbooks that holds the log")
@JSON
def init(folder: Path, sheet: str, *, as_json: bool) -> int:
    """Propose a recipe for the logs of a folder, on stdout.

    \b
    calibkit init --from logs > my_recipe.toml
    calibkit init --from logs --sheet Data --json
    """
    from calibkit.commands import inspection

    with working("reading"):
        proposal = inspection.init(folder, sheet)
    if as_json:
        print_json({"ok": True, "recipe": proposal.text})
    else:
        print_data(proposal.text)
        print_guesses(filter(None, (proposal.note,)))
    return 0


@command()
@RUN
@click.option("--data", required=True, type=PATH, help="one log")
@click.option("--out", required=True, type=PATH, help="file to write")
@click.option(
    "--uncorrected",
    type=click.Choice(["empty", "keep"]),
    default="empty",
    show_default=True,
    help="corrected values of rows that cannot be corrected: none, or what was logged",
)
@SET
@RUNS
@DRY
@JSON
def apply(
    run: str,
    data: Path,
    out: Path,
    uncorrected: str,
    overrides: tuple[str, ...],
    runs: Path,
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Compensate a log with the coefficients of a run; every row and column is written.

    \b
    calibkit apply FOG-0001 --data field.csv --out compensated.csv
    calibkit apply INC-7 --data well.csv --out out.csv --set site.latitude_deg=59
    """
    tune_memory()
    from calibkit.commands import pipeline
    from calibkit.records import store

    stored_run = store.load(store.find(run, runs))
    with working("compensating"):
        compensated, flags = pipeline.apply(
            stored_run,
            data,
            out,
            overrides,
            keep=uncorrected == "keep",
            dry_run=dry_run,
        )
    if not as_json:
        print_flags(flags)
        print_done(f"{data.name} with {stored_run.name}", compensated.describe())
    document = {
        "run": stored_run.name,
        "out": str(out),
        "rows": compensated.rows,
        "uncorrected": {reason: int(rows.size) for reason, rows in compensated.uncorrected.items()},
        "flags": list(flags),
    }
    print_result(document, (out,), as_json=as_json, dry_run=dry_run)
    return 0


@command()
@RUN
@DATA
@click.option("--out", required=True, type=PATH, help="JSON file to write")
@SET
@RUNS
@DRY
@DETAILS
@JSON
def validate(
    run: str,
    data: Path,
    out: Path,
    overrides: tuple[str, ...],
    runs: Path,
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Compare frozen coefficients with logs that were not fitted: before, after, rate gain.

    \b
    calibkit validate FOG-0001 --data withheld --out validation.json
    calibkit validate FOG-0001@r002 --data withheld --out validation.json --json
    calibkit validate ACC-3 --data new --out v.json --set 'logs.files=["*.csv"]'
    """
    tune_memory()
    from calibkit.commands import pipeline
    from calibkit.records import store

    stored_run = store.load(store.find(run, runs))
    with working("validating") as progress:
        document, summary = pipeline.validate(
            stored_run, data, out, progress, overrides, dry_run=dry_run
        )
    if not as_json:
        print_screen(summary)
    print_result(document, (out,), as_json=as_json, dry_run=dry_run)
    return 1 if summary.verdict == "rejected" else 0


@command()
@click.argument("procedure", required=False)
@click.option("--plan", type=PATH, help="folder of a plan: a campaign that was run by it")
@click.option("--out", required=True, type=PATH, help="folder to write the logs into")
@click.option("--seed", required=True, type=click.IntRange(min=0), help="seed of everything random")
@DRY
@DETAILS
@JSON
def simulate(
    procedure: str | None, plan: Path | None, out: Path, seed: int, *, dry_run: bool, as_json: bool
) -> int:
    """Write realistic logs of a simulated instrument with their truth beside them.

    \b
    calibkit simulate fog_thermal --out logs --seed 1
    calibkit simulate --plan plan --out logs --seed 2
    """
    if (procedure is None) == (plan is None):
        raise UsageError(
            "simulate needs a procedure or --plan", hint="calibkit simulate --plan plan --out logs"
        )
    from calibkit.commands import pipeline, plans

    with working("simulating"):
        written = (
            plans.simulate(plan, out, seed, dry_run=dry_run)
            if plan is not None
            else pipeline.simulate(procedure or "", out, seed, dry_run=dry_run)
        )
    print_result({"files": written}, written, as_json=as_json, dry_run=dry_run)
    return 0
