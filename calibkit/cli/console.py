"""What a command prints: data on stdout, talk and progress on stderr."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from calibkit.report.summary import Summary


def progress(items: Sequence[str], what: str) -> Iterable[str]:
    """Items with a progress bar on stderr, on a terminal only."""
    if not sys.stderr.isatty():
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, description=what, console=Console(stderr=True), transient=True)


def print_summary(summary: Summary) -> None:
    """Print a summary on stdout."""
    from rich.console import Console

    from calibkit.report.summary import show as print_on

    console = Console(highlight=False)
    print_on(summary, console if console.is_terminal else Console(highlight=False, width=110))


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document on stdout."""
    click.echo(json.dumps(document, ensure_ascii=False, indent=1))
