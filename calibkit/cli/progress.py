"""Progress of a command on a terminal: its stage, percent and time left; nothing elsewhere."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING

from calibkit.cli.console import SETTINGS, error_console, print_detail

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from calibkit.instruments import Progress


def _announce(items: Sequence[str], activity: str) -> Iterator[str]:
    """Items, each printed with --verbose as it is reached."""
    for number, item in enumerate(items, start=1):
        print_detail(f"{activity}: {item} ({number} of {len(items)})")
        yield item


@contextlib.contextmanager
def working(activity: str) -> Iterator[Progress]:
    """Show that a command works on something, and how far it is with each list of items that goes
    through the progress that this gives; what was shown is wiped away at the end, whatever ends it.

    A stage without items shows how long it takes so far.
    """
    if SETTINGS.quiet or SETTINGS.verbose or not sys.stderr.isatty():
        yield _announce
        return
    from rich import progress as rich

    columns = (
        rich.TextColumn("{task.description}"),
        rich.BarColumn(),
        rich.TaskProgressColumn(),
        rich.TimeElapsedColumn(),
        rich.TextColumn("left"),
        rich.TimeRemainingColumn(),
    )
    with rich.Progress(*columns, console=error_console(), transient=True) as display:
        display.add_task(activity, total=None)

        def begin(name: str, total: int | None) -> rich.TaskID:
            """A stage in place of the one before."""
            for task_id in display.task_ids:
                display.remove_task(task_id)
            return display.add_task(name, total=total)

        def follow(items: Sequence[str], activity: str) -> Iterable[str]:
            """Items of a stage, which is followed by what the command is about."""
            stage = begin(activity, len(items))
            for item in items:
                yield item
                display.advance(stage)
            begin(activity, None)

        yield follow
