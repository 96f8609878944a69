"""Options and arguments that commands share, and the group that they belong to."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import click

from calibkit.errors import UsageError

RECIPE = click.argument("recipe")
RUN = click.argument("run")
DATA = click.option("--data", required=True, type=click.Path(path_type=Path), help="folder with the logs")
RUNS = click.option("--runs", default="runs", show_default=True, type=click.Path(path_type=Path), help="where runs are")
JSON = click.option("--json", "as_json", is_flag=True, help="one JSON document on stdout, also on failure")
CSV = click.option("--csv", "as_csv", is_flag=True, help="CSV on stdout, one line a number")
SET = click.option("--set", "overrides", multiple=True, metavar="table.key=value", help="override a recipe key")


class Group(click.Group):
    """Commands in the order of the work, not of the alphabet."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's signature)
        """Names of the commands as they were added."""
        return list(self.commands)


def day_of(text: str | None) -> str:
    """Date as given, or today's, the only clock that calibkit reads; UsageError for what is not a date."""
    if text is None:
        return dt.datetime.now().astimezone().date().isoformat()
    try:
        return dt.date.fromisoformat(text).isoformat()
    except ValueError:
        raise UsageError(f"--date {text}: not a date", hint="write YYYY-MM-DD") from None


def now() -> dt.datetime:
    """The time that a signature claims; nothing else depends on it."""
    return dt.datetime.now(dt.UTC).replace(microsecond=0)
