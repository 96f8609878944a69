"""A stream whose reader may leave: `calibkit show | head` has seen enough, and the command ends as
it would have.
"""

from __future__ import annotations

import io
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def discard(descriptor: int) -> None:
    """Send what is written to a file descriptor from now on nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


class _Pipe(io.FileIO):
    """A file descriptor; once nobody reads it any more, what is written to it goes nowhere."""

    def write(self, data: ReadableBuffer, /) -> int:
        """Write bytes; a broken pipe takes them all, these and what follows."""
        try:
            return super().write(data)
        except BrokenPipeError:
            discard(self.fileno())
            return super().write(data)


def tolerate_closed_pipes() -> None:
    """Put a `_Pipe` below stdout and stderr of the process where they are redirected; on a terminal
    somebody reads.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if (
            stream is getattr(sys, f"__{name}__")
            and isinstance(stream, io.TextIOWrapper)
            and not stream.isatty()
        ):
            stream.flush()
            raw = io.BufferedWriter(_Pipe(stream.fileno(), "wb", closefd=False))
            wrapped = io.TextIOWrapper(raw, encoding=stream.encoding, errors=stream.errors)
            wrapped.reconfigure(
                line_buffering=stream.line_buffering, write_through=stream.write_through
            )
            setattr(sys, name, wrapped)
