"""Commands that leave calibkit for a target: export."""

from __future__ import annotations

from pathlib import Path

import click

from calibkit.cli.console import print_json, print_written
from calibkit.cli.options import DRY, JSON, RUNS, command, rehearsed


def _address(context: click.Context, parameter: click.Parameter, value: str) -> int:
    """An address, in hexadecimal with 0x or decimal."""
    del context, parameter
    try:
        return int(value, 0)
    except ValueError:
        raise click.BadParameter(
            f"'{value}' is no address; write 0x08040000 or 134479872"
        ) from None


@command()
@click.argument("run", nargs=-1, required=True)
@click.option("--target", required=True, help="c, blob, hex, srec, px4, ardupilot or csv")
@click.option("--number", default="f32", show_default=True, help="f32, f64, q31 or q15")
@click.option(
    "--prefix", default="cal", show_default=True, help="what every generated name starts with"
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="folder to write into")
@click.option(
    "--address",
    default="0",
    callback=_address,
    help="where hex and srec place the blob: 0x08040000",
)
@click.option(
    "--allow-rejected", is_flag=True, help="export a run that failed its limits, marked as rejected"
)
@RUNS
@DRY
@JSON
def export(
    run: tuple[str, ...],
    target: str,
    number: str,
    prefix: str,
    out: Path,
    address: int,
    runs: Path,
    *,
    allow_rejected: bool,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Write the correction chain of a run as firmware that can prove itself.

    \b
    calibkit export FOG-0001 --target c --prefix gyro --out firmware
    calibkit export GYRO-7 GYRO-8 GYRO-9 --target hex --address 0x08040000 --out delivery

    Several runs make one row or one blob a unit, and a manifest with the digests of all files.
    """
    from calibkit import pipeline, store

    found = [store.load(store.find(name, runs)) for name in run]
    files = pipeline.export(
        found,
        target,
        number,
        prefix,
        out,
        address=address,
        allow_rejected=allow_rejected,
        dry_run=dry_run,
    )
    if as_json:
        named = {"runs": [one.name for one in found], "files": list(map(str, files))}
        print_json({"ok": True, **named, **rehearsed(dry_run=dry_run)})
    else:
        print_written(files, dry_run=dry_run)
    return 0
