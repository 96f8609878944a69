"""A copied process whose parent sends it no task ends in silence; imported ahead, for this effect
alone, by the process that the processes of a fleet are copies of.

The parent can be interrupted or killed at any moment. The copy then finds its pipe at an end, an
EOFError, which Python would print with its traceback beside the parent's own message.
"""

import sys
from types import TracebackType


def _print_unless_abandoned(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None
) -> None:
    """Print an uncaught error as Python does, but for the end of the pipe from the parent."""
    if not issubclass(kind, EOFError):
        sys.__excepthook__(kind, error, traceback)


sys.excepthook = _print_unless_abandoned
