"""Options and arguments that commands share, and the group that they belong to."""

import functools
from pathlib import Path
from typing import Any

import click

from calibkit.cli import completion, console
from calibkit.errors import UsageError

_EXAMPLE = "calibkit "
"""Start of an example's line in the help of a command."""

PATH = click.Path(path_type=Path)
RECIPE = click.argument("recipe", shell_complete=completion.complete_recipe)
RUN = click.argument("run", shell_complete=completion.complete_run)
DATA = click.option("--data", required=True, type=PATH, help="folder with the logs")
KEEP = click.option(
    *("--runs", "--out", "out"),
    default="runs",
    show_default=True,
    type=PATH,
    help="where runs are kept",
)
SINCE = click.option(
    "--date",
    default=None,
    metavar="YYYY-MM-DD",
    help="date from which the coefficients hold (default: of the logs' last row, else today)",
)
RUNS = click.option(
    "--runs",
    default="runs",
    show_default=True,
    type=PATH,
    help="where runs are",
)
JSON = click.option(
    "--json", "as_json", is_flag=True, help="one JSON document on stdout, also on failure"
)
CSV = click.option("--csv", "as_csv", is_flag=True, help="CSV on stdout, one line per number")
DRY = click.option("--dry-run", is_flag=True, help="do it all but write nothing")
SET = click.option(
    "--set", "overrides", multiple=True, metavar="table.key=value", help="override a recipe key"
)


def _quiet(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: ARG001, FBT001 (click's signature)
    """Set --quiet."""
    console.SETTINGS.quiet = value


def _verbose(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: ARG001, FBT001 (click's signature)
    """Set --verbose; it contradicts --quiet."""
    if value and console.SETTINGS.quiet:
        raise UsageError("--quiet and --verbose contradict each other", hint="give one of them")
    console.SETTINGS.verbose = value


def _details(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: ARG001, FBT001 (click's signature)
    """Set --details."""
    console.SETTINGS.details = value


DETAILS = click.option(
    "--details",
    is_flag=True,
    expose_value=False,
    callback=_details,
    help="full tables and lists in place of the first screen",
)


class _Explained(click.Command):
    """A command or group whose help starts with its examples: the lines of its docstring that call
    calibkit.
    """

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Examples, then usage, text and options."""
        with formatter.section("Examples"):
            formatter.write("".join(f"  {line}\n" for line in _examples(self.help or "")))
        formatter.write_paragraph()
        super().format_help(ctx, formatter)

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The text without its examples, which stand above."""
        full_help = self.help
        self.help = "\n\n".join(
            paragraph for paragraph in (full_help or "").split("\n\n") if not _examples(paragraph)
        )
        try:
            super().format_help_text(ctx, formatter)
        finally:
            self.help = full_help


def _examples(text: str) -> list[str]:
    """Lines of a help text that are examples."""
    return [line.strip() for line in text.splitlines() if line.strip().startswith(_EXAMPLE)]


class _Command(_Explained):
    """A command that can be quiet and verbose."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:  # noqa: ANN401 (click's own parameters)
        super().__init__(*arguments, **settings)
        self.params += [
            click.Option(
                ["-q", "--quiet"],
                is_flag=True,
                expose_value=False,
                callback=_quiet,
                is_eager=True,
                help="print only what matters",
            ),
            click.Option(
                ["-v", "--verbose"],
                is_flag=True,
                expose_value=False,
                callback=_verbose,
                help="print what is done as it is done",
            ),
        ]


command = functools.partial(click.command, cls=_Command)
"""Decorator of a command."""


class CommandGroup(_Explained, click.Group):
    """Commands in the order of the work, not of the alphabet."""

    command_class = _Command

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's signature)
        """Names of the commands as they were added."""
        return list(self.commands)
