"""What a command prints: data on stdout, messages and progress on stderr, also on consoles of
another encoding.
"""

from __future__ import annotations

import codecs
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibkit.errors import visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rich.console import Console

    from calibkit.errors import CalibkitError
    from calibkit.report.summary import Summary

_WIDTH = 110
"""Columns of a table that is not printed on a terminal."""


class _Settings:
    """What the running command prints beside its result. No dataclass, which takes longer to make
    than a module of commands.
    """

    quiet = False
    verbose = False
    details = False
    """Whether full tables are printed in place of the first screen."""


SETTINGS = _Settings()
"""Settings of the command that is running; `main` sets them for each."""
DRY_RUN = " (dry run: not written)"


def prepare_streams() -> None:
    """Make the streams print anything: LF, UTF-8 where redirected, escapes where a console lacks a
    character. Settings are those of a new command.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who called
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (for the whole process)
        elif hasattr(stream, "reconfigure"):
            redirected = not stream.isatty() and not os.environ.get("PYTHONIOENCODING")
            encoding = "utf-8" if redirected else stream.encoding
            stream.reconfigure(encoding=encoding, errors="backslashreplace", newline="\n")
    SETTINGS.quiet, SETTINGS.verbose, SETTINGS.details = False, False, False


def print_message(text: str) -> None:
    """Print on stderr what matters in every mode: a flag, a guess, a failure."""
    click.echo(visible(text, lines=True), err=True)


def print_flags(flags: Iterable[str]) -> None:
    """Print what must be known before a result is used."""
    for flag in flags:
        print_message(f"! {visible(flag)}")


def print_guesses(guesses: Iterable[str]) -> None:
    """Print what calibkit guessed, so that it can be pinned."""
    for guess in guesses:
        print_message(f"? {visible(guess)}")


def print_done(title: str, lines: Iterable[str]) -> None:
    """Print on stderr what a command did, a line each; --quiet leaves it out."""
    for line in () if SETTINGS.quiet else (f"{title}:", *(f"  {line}" for line in lines)):
        click.echo(line, err=True)


def print_detail(text: str) -> None:
    """Print on stderr what only --verbose asks for."""
    text = visible(text, lines=True)
    if SETTINGS.verbose:
        click.echo(text, err=True)


def _console(*, err: bool = False) -> Console:
    """Rich console on stdout or stderr, without any escape sequence where NO_COLOR is set."""
    from rich.console import Console

    no_color = bool(os.environ.get("NO_COLOR"))
    wide = Console(highlight=False, stderr=err, color_system=None if no_color else "auto")
    if wide.is_terminal:
        return wide
    return Console(highlight=False, stderr=err, width=_WIDTH, color_system=None)


def error_console() -> Console:
    """Rich console on stderr."""
    return _console(err=True)


def print_summary(summary: Summary) -> None:
    """Print a summary on stdout."""
    from calibkit.report import screen

    screen.show(summary, _console())


def print_screen(
    summary: Summary, tail: Sequence[str] = (), *, lines_below: int = 1, always: bool = False
) -> None:
    """Print the first screen of a command that prints `lines_below` more lines; the full tables
    with --details, with --quiet only what is flagged or was rejected, but where it is `always`
    printed.
    """
    if SETTINGS.quiet and not always:
        print_flags(summary.checks)
        if summary.verdict == "rejected":
            print_message(summary.last_line)
        return
    if SETTINGS.details:
        print_summary(summary)
        click.echo("".join(f"{visible(line)}\n" for line in tail), nl=False)
        return
    from rich.text import Text

    from calibkit.report import screen

    console = _console()
    max_lines = screen.MOST - lines_below
    for line in screen.compose_screen(summary, tail, console.width, max_lines=max_lines):
        verdict = bool(line) and summary.last_line.startswith(line)
        style = screen.STYLES[summary.verdict] if verdict else ""
        console.print(Text(line, style=style), soft_wrap=True)


def print_all_or_screen(lines: Callable[[int], Sequence[str]]) -> None:
    """Print on stdout the lines of a screen of the console's width; with --details, of width 0, all
    there are.
    """
    screen_lines = lines(0 if SETTINGS.details else _console().width)
    click.echo("\n".join(map(visible, screen_lines)))


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout; where that is not Unicode, other characters are escaped
    and nothing is lost.
    """
    import json  # not before it is asked for

    unicode = codecs.lookup(sys.stdout.encoding or "utf-8").name.startswith("utf")
    click.echo(json.dumps(document, ensure_ascii=not unicode, indent=1))


def error_document(error: CalibkitError) -> dict[str, str]:
    """An error as --json prints it."""
    return {"code": error.code, "message": error.message, "hint": error.hint}


def print_result(
    document: Mapping[str, Any], written: Iterable[object], *, as_json: bool, dry_run: bool
) -> None:
    """Print what a command did as JSON, or what it wrote (or would have written), one name per
    line.
    """
    if as_json:
        print_json({"ok": True, **document, **({"dry_run": True} if dry_run else {})})
    else:
        from calibkit.report.screen import shorten

        end = DRY_RUN if dry_run else ""
        names = [f"{visible(str(name))}{end}" for name in written]
        click.echo("\n".join(names if SETTINGS.details else shorten(names)))


def print_data(text: str) -> None:
    """Print a text of data on stdout; a character that the console lacks is escaped."""
    encoding = sys.stdout.encoding or "utf-8"
    click.echo(text.encode(encoding, "backslashreplace").decode(encoding), nl=False)
