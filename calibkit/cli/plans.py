"""The command that plans a campaign."""

from pathlib import Path

import click

from calibkit.cli import completion
from calibkit.cli.console import print_data, print_json, print_result, print_screen
from calibkit.cli.options import DETAILS, DRY, JSON, PATH, RUNS, SET, command
from calibkit.cli.progress import working
from calibkit.errors import UsageError


def _hours(_: click.Context, __: click.Parameter, value: str | None) -> float | None:
    """Hours of a text such as 8h."""
    if value is None:
        return None
    try:
        hours = float(value.removesuffix("h"))
    except ValueError:
        hours = 0.0
    if not 0.0 < hours < float("inf"):
        raise UsageError(f"--within {value}: expected hours, as 8h", hint="give a number above 0")
    return hours


@command()
@click.argument("recipe", required=False, shell_complete=completion.complete_recipe)
@click.option("--out", type=PATH, help="folder to write the plan into")
@click.option(
    "--range",
    "range_degc",
    nargs=2,
    type=float,
    default=None,
    metavar="LOW HIGH",
    help="temperatures of use [°C]",
)
@click.option(
    "--want",
    "wishes",
    multiple=True,
    metavar='"NAME<=VALUE UNIT"',
    help="largest expanded uncertainty (k = 2) of a result over the range",
)
@click.option("--within", callback=_hours, metavar="HOURSh", help="hours of the chamber at most")
@click.option("--equipment", type=PATH, help="equipment file (default: the sample bench)")
@click.option(
    "--attitudes",
    default="",
    metavar="NAME",
    help="fixture of the equipment: two-axis (default), dividing-head, faces, or one of your own",
)
@click.option("--from", "earlier", default="", metavar="RUN", help="run whose errors are assumed")
@click.option("--have", type=PATH, help="folder with logs that are measured already")
@click.option("--print-equipment", is_flag=True, help="print the sample bench and stop")
@RUNS
@SET
@DRY
@DETAILS
@JSON
def plan(
    recipe: str | None,
    out: Path | None,
    range_degc: tuple[float, float] | None,
    wishes: tuple[str, ...],
    within: float | None,
    equipment: Path | None,
    attitudes: str,
    earlier: str,
    have: Path | None,
    runs: Path,
    overrides: tuple[str, ...],
    *,
    print_equipment: bool,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Plan the campaign that reaches an uncertainty in the fewest hours, or the least uncertainty
    within hours.

    \b
    calibkit plan accelerometer --want "inclination<=0.01 deg" --out plan
    calibkit plan my_recipe.toml --within 12h --equipment bench.toml --out plan
    """
    if print_equipment:
        return _print_equipment(as_json=as_json)
    if recipe is None or out is None:
        raise UsageError(
            "a plan needs a recipe and --out", hint="calibkit plan accelerometer --out plan"
        )
    from calibkit.commands import plans
    from calibkit.recipe import find

    with working("planning"):
        outcome = plans.plan(
            find(recipe, overrides),
            out,
            wishes=wishes,
            within_h=within,
            range_degc=range_degc,
            equipment=equipment,
            attitudes=attitudes,
            earlier=earlier,
            runs=runs,
            have=have,
            dry_run=dry_run,
        )
    if not as_json:
        print_screen(outcome.summary, (), lines_below=len(outcome.files))
    print_result(outcome.document, outcome.files, as_json=as_json, dry_run=dry_run)
    return 1 if outcome.summary.verdict == "rejected" else 0


def _print_equipment(*, as_json: bool) -> int:
    """Print the sample bench."""
    from calibkit.planning.equipment import sample_text

    text = sample_text()
    if as_json:
        print_json({"ok": True, "equipment": text})
    else:
        print_data(text)
    return 0
