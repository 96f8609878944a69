"""Commands on what coefficients mean: evaluate, compare, open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from calibkit.cli.console import print_data, print_flags, print_json, print_summary
from calibkit.cli.options import JSON, PATH, RUN, RUNS, command

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
    from calibkit import store
    from calibkit.results import evaluation, figures

    if out is not None:
        figures.require_suffix(out.suffix, (".csv", *figures.SUFFIXES))
    found = evaluation.RunResults.read(store.load(store.find(run, runs)))
    if not inputs and not ranges and not only:
        _print_results(found, run, as_json=as_json)
        return 0
    values, over = evaluation.answer(found, inputs, ranges, only)
    if out is not None:
        _write(out, figures.write_values(found.run, values, over, out.suffix))
    if as_json:
        written = {} if out is None else {"out": str(out)}
        print_json({"ok": True, **evaluation.document(found, values), **written})
    elif out is None:
        print_summary(evaluation.summarise(found, values))
    else:
        print_flags(evaluation.flag_values(values))
        print_data(f"{out}\n")
    return 0


def _write(out: Path, content: bytes) -> None:
    """Write one new file."""
    from calibkit import new_files

    new_files.write_new(out, content)


def _print_results(found: RunResults, run: str, *, as_json: bool) -> None:
    """Print which results a run has, and those that depend on nothing."""
    from calibkit.report.summary import Summary
    from calibkit.results import evaluation

    listing = evaluation.list_results(found)
    free = [one for one in found.quantities if not one.inputs]
    values = list(evaluation.evaluate(found, free, [{}]))
    if as_json:
        objects = {"results": listing.to_objects()}
        print_json({"ok": True, **objects, **evaluation.document(found, values)})
        return
    tables = (listing, *((evaluation.tabulate(values),) if values else ()))
    one = next(iter(found.names.inputs), "")
    ask = f"Next: calibkit evaluate {run} {one}=…" if one else " "
    flags = evaluation.flag_values(values)
    print_summary(Summary(f"{found.run.name}: results", tables, flags, (), ask))
