"""What a command prints: data on stdout, talk and progress on stderr, both also on consoles of
another encoding.
"""

from __future__ import annotations

import codecs
import json
import os
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from calibkit.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from rich.console import Console

    from calibkit.errors import CalibkitError
    from calibkit.report.summary import Summary

WIDTH = 110
"""Columns of a table that is not printed on a terminal."""
READABLE = {
    "°": "deg",
    "µ": "u",
    "μ": "u",
    "²": "^2",
    "³": "^3",
    "×": "x",
    "·": "*",
    "−": "-",
    "–": "-",
    "—": "-",
    "±": "+-",
    "…": "...",
    "→": "->",
    "≤": "<=",
    "≥": ">=",
    "√": "sqrt ",
    "α": "alpha",
    "γ": "gamma",
    "ε": "epsilon",
    "σ": "sigma",
    "τ": "tau",
    "θ": "theta",
    "ψ": "psi",
    "Δ": "Delta",
    "₀": "0",
    "₇": "7",
    "₈": "8",
    "₉": "9",
    "₁": "1",
    "₂": "2",
}
"""What stands for a character that a console cannot print; any other becomes a question mark."""


@dataclass(slots=True)
class Talk:
    """How much a command says, and the log file that keeps it."""

    quiet: bool = False
    verbose: bool = False
    log: list[Path] = field(default_factory=list)
    """The log file, if there is one."""
    called: list[str] = field(default_factory=list)
    """Arguments of the command line."""


TALK = Talk()
"""Of the command that is running; `main` starts each with a new one."""


def prepare(arguments: Sequence[str]) -> None:
    """Make the streams print anything: LF, UTF-8 where redirected, stand-ins where a console lacks
    a character.
    """
    codecs.register_error("calibkit", _readable)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            redirected = not stream.isatty() and not os.environ.get("PYTHONIOENCODING")
            encoding = "utf-8" if redirected else stream.encoding
            stream.reconfigure(encoding=encoding, errors="calibkit", newline="\n")
    TALK.quiet, TALK.verbose = False, False
    TALK.log.clear()
    TALK.called[:] = arguments


def _readable(error: UnicodeError) -> tuple[str, int]:
    """Stand-ins for the characters that an encoding lacks (an error handler of `codecs`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return (
        "".join(
            READABLE.get(character, "?") for character in error.object[error.start : error.end]
        ),
        error.end,
    )


def note(level: str, text: str) -> None:
    """Write lines into the log file, if there is one."""
    if TALK.log:
        from calibkit.cli.log import write

        try:
            write(TALK.log[0], level, text)
        except OutputError as error:  # the command itself has not failed
            TALK.log.clear()
            click.echo(f"! no more is logged: {error}", err=True)


def log_to(path: Path, command_line: str) -> None:
    """Begin to log into a file; raises OutputError where that is not possible."""
    from calibkit.cli.log import write

    write(path, "called", command_line)
    TALK.log[:] = [path]


def say(text: str) -> None:
    """Say something that matters whatever was asked for: a flag, a guess, a failure."""
    note("say", text)
    click.echo(text, err=True)


def tell(text: str) -> None:
    """Say on stderr what only --verbose asks for."""
    note("verbose", text)
    if TALK.verbose:
        click.echo(text, err=True)


def console(*, err: bool = False) -> Console:
    """Rich console on stdout or stderr, without any escape sequence where NO_COLOR is set."""
    from rich.console import Console

    plain = bool(os.environ.get("NO_COLOR"))
    wide = Console(highlight=False, stderr=err, color_system=None if plain else "auto")
    return (
        wide
        if wide.is_terminal
        else Console(highlight=False, stderr=err, width=WIDTH, color_system=None)
    )


def progress(items: Sequence[str], what: str) -> Iterable[str]:
    """Items, each said with --verbose, otherwise with a progress bar on stderr on a terminal."""
    if TALK.quiet or TALK.verbose or TALK.log or not sys.stderr.isatty():
        return _told(items, what)
    from rich.progress import track

    return track(items, description=what, console=console(err=True), transient=True)


def _told(items: Sequence[str], what: str) -> Iterator[str]:
    """Items, each said as it is reached."""
    for number, item in enumerate(items, start=1):
        tell(f"{what}: {item} ({number} of {len(items)})")
        yield item


def print_summary(summary: Summary) -> None:
    """Print a summary on stdout."""
    from calibkit.report.summary import show, text

    if TALK.log:
        note("summary", text(summary))
    show(summary, console())


def print_verdict(summary: Summary) -> None:
    """Print the summary of a command that writes something else; --quiet leaves only what is
    flagged or was rejected.
    """
    if not TALK.quiet:
        print_summary(summary)
        return
    for flag in summary.flags:
        say(f"! {flag}")
    if not summary.accepted:
        say(summary.verdict)


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout; where that is not Unicode, other characters are escaped
    and nothing is lost.
    """
    unicode = codecs.lookup(sys.stdout.encoding or "utf-8").name.startswith("utf")
    click.echo(json.dumps(document, ensure_ascii=not unicode, indent=1))


def as_document(error: CalibkitError) -> dict[str, str]:
    """An error as --json says it."""
    return {"code": error.code, "message": error.message, "hint": error.hint}


def print_written(names: Iterable[object], *, dry_run: bool) -> None:
    """Print what was written, one name a line, or would have been."""
    click.echo("\n".join(f"{name}{' (dry run: not written)' if dry_run else ''}" for name in names))


def print_data(text: str) -> None:
    """Print a text of data on stdout; a character that the console lacks is escaped as \\uXXXX, not
    replaced.
    """
    encoding = sys.stdout.encoding or "utf-8"
    click.echo(text.encode(encoding, "backslashreplace").decode(encoding), nl=False)
