"""The command for many units at once."""

from __future__ import annotations

from pathlib import Path

import click

from calibkit.cli.clock import day_of
from calibkit.cli.console import print_json, progress, say
from calibkit.cli.options import DRY, JSON, RECIPE, SET, command, rehearsed
from calibkit.errors import UsageError


@command()
@RECIPE
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    help="folder with one sub-folder a unit",
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
@click.option(
    "--jobs",
    default=None,
    type=click.IntRange(min=1),
    help="processes here (default: one a processor)",
)
@click.option(
    "--cluster",
    default="",
    metavar="tcp://HOST:PORT",
    help="Dask scheduler whose workers fit the units",
)
@click.option(
    "--keep-going", is_flag=True, help="one unit that cannot be fitted does not stop the others"
)
@DRY
@SET
@JSON
def fleet(
    recipe: str,
    data: Path,
    out: Path,
    date: str | None,
    jobs: int | None,
    cluster: str,
    overrides: tuple[str, ...],
    *,
    keep_going: bool,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Fit a recipe to every unit of a folder, one sub-folder a unit named by its serial, and write
    a table of them.

    \b
    calibkit fleet rate_table --data units --jobs 4 --date 2026-11-21
    calibkit fleet my_recipe.toml --data units --cluster tcp://10.0.0.5:8786 --keep-going --json
    """
    if jobs and cluster:
        raise UsageError(
            "--jobs and --cluster: one or the other", hint="a cluster has as many workers as it has"
        )
    day = day_of(date)
    if jobs != 1 and not cluster and data.is_dir():
        from calibkit.fleet import server

        server.ahead()
    from calibkit.fleet import run, summary
    from calibkit.recipe import find

    done = run.run(
        find(recipe, overrides),
        data,
        out,
        day,
        progress,
        jobs=jobs or 0,
        address=cluster,
        keep_going=keep_going,
        dry_run=dry_run,
    )
    for guess in done.guesses:
        say(f"? {guess}")
    if as_json:
        print_json(summary.summary_document(done) | rehearsed(dry_run=dry_run))
    else:
        click.echo("\n".join(summary.summary_lines(done, dry_run=dry_run)))
    return done.exit_code
