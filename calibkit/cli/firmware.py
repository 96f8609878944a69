"""Commands that leave calibkit for a target: export."""

from __future__ import annotations

from pathlib import Path

import click

from calibkit.cli.console import print_json
from calibkit.cli.options import JSON, RUN, RUNS, command


@command()
@RUN
@click.option("--target", required=True, help="c")
@click.option("--number", default="f32", show_default=True, help="f32, f64, q31 or q15")
@click.option("--prefix", default="cal", show_default=True, help="what every generated name starts with")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="folder to write into")
@click.option("--allow-rejected", is_flag=True, help="export a run that failed its limits, marked as rejected")
@RUNS
@JSON
def export(
    run: str, target: str, number: str, prefix: str, out: Path, runs: Path, *, allow_rejected: bool, as_json: bool
) -> int:
    """Write the correction chain of a run as firmware that can prove itself.

    \b
    calibkit export FOG-0001 --target c --prefix gyro --out firmware
    calibkit export runs/ACC-7/r002 --target c --number q31 --prefix accel --out firmware
    """
    from calibkit import pipeline, store

    found = store.load(store.find(run, runs))
    files = pipeline.export(found, target, number, prefix, out, allow_rejected=allow_rejected)
    if as_json:
        print_json({"ok": True, "run": found.name, "files": list(map(str, files))})
    else:
        click.echo("\n".join(map(str, files)))
    return 0
