"""Commands on what coefficients mean: evaluate, compare, open."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING
from urllib.parse import quote

import click

from calibkit.cli import completion
from calibkit.cli.console import (
    SETTINGS,
    print_data,
    print_done,
    print_flags,
    print_json,
    print_summary,
)
from calibkit.cli.options import DETAILS, JSON, PATH, RUN, RUNS, command

if TYPE_CHECKING:
    from pathlib import Path

    from calibkit.results.evaluation import RunResults


@command()
@RUN
@click.argument("inputs", nargs=-1, metavar="[name=value]...")
@click.option(
    "--range", "ranges", multiple=True, metavar="name=from:to:step", help="an input over a range"
)
@click.option("--only", default="", metavar="PATTERN", help="results of that name or key")
@click.option("--out", type=PATH, help="CSV, PDF or PNG file to write")
@RUNS
@JSON
def evaluate(
    run: str,
    inputs: tuple[str, ...],
    ranges: tuple[str, ...],
    only: str,
    out: Path | None,
    runs: Path,
    *,
    as_json: bool,
) -> int:
    """Print results of a run at a point or over a range, each with its expanded uncertainty U.

    \b
    calibkit evaluate FOG-0001 temp_case=40 temp_rate=2
    calibkit evaluate FOG-0001 --range temp_case=-40:60:5 --out drift.pdf
    calibkit evaluate ACC-0001 temp_case=104degF accel_x=980mg accel_y=0 accel_z=0

    Without inputs: which results there are, their inputs, and the ranges in which they hold. A
    value may have a unit of its own kind behind it. Rates are held until the lags of a model have
    settled. Outside the calibrated range a value is extrapolated, without U, and flagged.
    """
    from calibkit.records import store
    from calibkit.results import evaluation, figures

    if out is not None:
        figures.require_suffix(out.suffix, (".csv", *figures.SUFFIXES))
    run_results = evaluation.RunResults.read(store.load(store.find(run, runs)))
    run_results.require_any()
    if not inputs and not ranges and not only:
        _print_results(run_results, run, as_json=as_json)
        return 0
    print_flags(store.flag_rejected(run_results.run))
    values, range_inputs = evaluation.answer(run_results, inputs, ranges, only)
    if out is not None:
        _write(out, figures.write_values(run_results.run, values, range_inputs, out.suffix))
    if as_json:
        written = {} if out is None else {"out": str(out)}
        print_json({"ok": True, **evaluation.document(run_results, values), **written})
    elif out is None:
        print_summary(evaluation.summarise(run_results, values))
    else:
        print_flags(evaluation.flag_values(values))
        print_data(f"{out}\n")
    return 0


@command()
@click.argument("before", metavar="OLD", shell_complete=completion.complete_run)
@click.argument("after", metavar="NEW", shell_complete=completion.complete_run)
@click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="NAME<=VALUE UNIT",
    help="largest change of a result (default: the recipe's acceptance)",
)
@click.option("--profile", type=PATH, help="laboratory profile with specifications of results")
@click.option(
    "--same-equipment",
    "same",
    is_flag=True,
    help="type B terms that both runs state alike are one error of the same equipment",
)
@click.option("--out", type=PATH, help="PDF or PNG file to write: then and now, with U and limit")
@RUNS
@DETAILS
@JSON
def compare(
    before: str,
    after: str,
    limits: tuple[str, ...],
    profile: Path | None,
    out: Path | None,
    runs: Path,
    *,
    same: bool,
    as_json: bool,
) -> int:
    """Answer whether a device is still good, and list what changed: results against U and limit,
    coefficients, recipe, logs, files and flags.

    \b
    calibkit compare FOG-0001@r001 FOG-0001
    calibkit compare GYRO-1@2024-05-01 GYRO-1 --limit "K_x<=20 ppm" --out gyro.pdf

    Results are compared over the range that both runs were calibrated in, whatever their model
    forms. Exit codes: 0 yes, 1 no, 3 cannot tell.
    """
    from calibkit import units
    from calibkit.certificate import profile as profiles
    from calibkit.records import store
    from calibkit.results import comparison, figures, still_good

    if out is not None:
        figures.require_suffix(out.suffix)
    old, new = (store.load(store.find(run, runs)) for run in (before, after))
    certificate_profile = None if profile is None else profiles.load(profile, ())[0]
    parsed = units.parse_limits(limits, "--limit")
    result = comparison.compare(
        old, new, limits=parsed, profile=certificate_profile, same_equipment=same
    )
    if out is not None:
        _write(out, figures.render(still_good.draw(result), out.suffix))
    if as_json:
        written = {} if out is None else {"out": str(out)}
        print_json({"ok": True, **still_good.document(result), **written})
    else:
        print_summary(still_good.summarise(result, details=SETTINGS.details))
        if out is not None:
            print_data(f"{out}\n")
    return still_good.EXIT_CODES[result.answer]


@command("open")
@click.argument("serial", required=False, default="", shell_complete=completion.complete_run)
@RUNS
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="(default: a free one)")
@click.option("--no-browser", is_flag=True, help="print the address alone")
@JSON
def open_page(serial: str, runs: Path, port: int, *, no_browser: bool, as_json: bool) -> int:
    """Show all runs as local pages: devices, verdicts, reports, then and now, key values.

    \b
    calibkit open --runs /data/runs
    calibkit open FOG-0001 --port 8000 --no-browser

    The pages are for this machine alone (127.0.0.1), read and never write, and load nothing from
    elsewhere. They are there until Ctrl-C. What was read of the runs is kept in the user's cache,
    which can be deleted.
    """
    import webbrowser

    from calibkit.errors import UsageError
    from calibkit.viewer.index import read_index
    from calibkit.viewer.server import RunPages, Server

    if serial and serial not in read_index(runs):
        raise UsageError(f"serial '{serial}': no run under {runs}", hint="give --runs")
    with Server(RunPages(runs), port) as server:
        url = server.url + (f"device/{quote(serial)}" if serial else "")
        if as_json:
            print_json({"ok": True, "url": url})
        else:
            print_data(f"{url}\n")
            print_done("open", ["until Ctrl-C"])
        sys.stdout.flush()
        if not no_browser and not as_json:
            webbrowser.open_new_tab(url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return 0
    return 0


def _write(out: Path, content: bytes) -> None:
    """Write one new file."""
    from calibkit.records import new_files

    new_files.write_new(out, content)


def _print_results(run_results: RunResults, run: str, *, as_json: bool) -> None:
    """Print which results a run has, and those that depend on nothing."""
    from calibkit.report.summary import Summary
    from calibkit.results import evaluation

    listing = evaluation.list_results(run_results)
    free = [quantity for quantity in run_results.quantities if not quantity.inputs]
    values = list(evaluation.evaluate(run_results, free, [{}]))
    if as_json:
        objects = {"results": listing.to_objects()}
        print_json({"ok": True, **objects, **evaluation.document(run_results, values)})
        return
    tables = (listing, *((evaluation.tabulate(values),) if values else ()))
    input_name = next(iter(run_results.inputs), "")
    ask = f"Next: calibkit evaluate {run} {input_name}=…" if input_name else " "
    flags = evaluation.flag_values(values)
    print_summary(Summary(f"{run_results.run.name}: results", tables, flags, (), ask))
