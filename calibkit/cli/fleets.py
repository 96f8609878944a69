"""The command for many devices at once."""

from pathlib import Path

import click

from calibkit.cli.console import print_all_or_screen, print_guesses, print_json
from calibkit.cli.options import DETAILS, DRY, JSON, KEEP, PATH, RECIPE, SET, SINCE, command
from calibkit.cli.progress import working
from calibkit.errors import UsageError
from calibkit.records.clock import date_or_today


@command()
@RECIPE
@click.option(
    "--data",
    required=True,
    type=PATH,
    help="folder with one sub-folder per device",
)
@KEEP
@SINCE
@click.option(
    "--jobs",
    default=None,
    type=click.IntRange(min=1),
    help="processes here (default: one per processor)",
)
@click.option(
    "--cluster",
    default="",
    metavar="tcp://HOST:PORT",
    help="Dask scheduler whose workers fit the devices",
)
@click.option(
    "--keep-going", is_flag=True, help="one device that cannot be fitted does not stop the others"
)
@DRY
@SET
@DETAILS
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
    """Fit a recipe to every device of a folder, one sub-folder per device named by its serial, and
    write a table and a page of them.

    \b
    calibkit fleet rate_table --data units --jobs 4 --date 2026-11-21
    calibkit fleet my_recipe.toml --data units --cluster tcp://10.0.0.5:8786
    """
    if jobs and cluster:
        raise UsageError("--jobs and --cluster: one or the other", hint="give one of them")
    if jobs != 1 and not cluster and data.is_dir():
        from calibkit.fleet.server import import_ahead

        import_ahead()
    from calibkit.fleet import run, summary
    from calibkit.recipe import find

    with working("writing the table") as progress:
        fleet_result = run.run(
            find(recipe, overrides),
            data,
            out,
            date_or_today(date) if date else "",
            progress,
            jobs=jobs or 0,
            address=cluster,
            keep_going=keep_going,
            dry_run=dry_run,
        )
    print_guesses(fleet_result.guesses)
    if as_json:
        print_json(summary.summary_document(fleet_result) | ({"dry_run": True} if dry_run else {}))
    else:
        print_all_or_screen(
            lambda width: summary.compose_fleet(fleet_result, width, dry_run=dry_run)
        )
    return fleet_result.exit_code
