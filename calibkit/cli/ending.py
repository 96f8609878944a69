"""How a command ends: the exit codes of the contract, one message per failure; and as it would have
where the reader of a stream has left, like `calibkit show | head`.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibkit.cli.console import error_document, log_line, print_json, print_message
from calibkit.errors import CalibkitError, OutputError, StoppedError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import ReadableBuffer

_BROKEN_PIPE = 141
"""Exit code of a command that a closed pipe ended, as shells count it (128 + SIGPIPE); 1 would say
that a limit failed.
"""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a write to a stream; files that calibkit writes itself have OutputError."""


def run_to_exit_code(run: Callable[[], Any], *, as_json: bool) -> int:
    """Run a command and return its exit code, with which the log file ends."""
    code = _exit_code(run, as_json=as_json)
    log_line("ended", f"exit code {code}")
    return code


def _exit_code(run: Callable[[], Any], *, as_json: bool) -> int:
    """Exit code of a command; every failure becomes one message, and one JSON document where JSON
    was asked for.
    """
    try:
        code = run()
    except CalibkitError as error:
        return _fail(error, as_json=as_json)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return UsageError.exit_code
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"see {context.command_path if context else 'calibkit'} --help"
        return _fail(UsageError(error.format_message().rstrip("."), hint=hint), as_json=as_json)
    except (KeyboardInterrupt, click.Abort):
        return _fail(
            StoppedError("interrupted; what was not finished was not written"), as_json=as_json
        )
    except Exception as error:  # noqa: BLE001 (the last resort: a traceback helps nobody at the bench)
        return _end_unexpected(error, as_json=as_json)
    return code if isinstance(code, int) else 0


def _end_unexpected(error: Exception, *, as_json: bool) -> int:
    """Exit code of a command that failed to print, or failed by an error of calibkit."""
    full = isinstance(error, OSError) and error.filename is None and error.errno in _FULL
    if full or isinstance(error, BrokenPipeError):
        # the interpreter would try to write again at its end what is still buffered
        with contextlib.suppress(OSError, ValueError):
            _discard(sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        # of another pipe than stdout and stderr, or where the system cannot tell whose it is
        return _BROKEN_PIPE
    if isinstance(error, OSError) and full:
        unprinted = OutputError(
            f"stdout: cannot be written: {error.strerror}",
            hint="free space; what was printed is not whole",
        )
        return _fail(unprinted, as_json=False)
    if isinstance(error, FileNotFoundError) and error.filename is None:  # of the current folder
        folder_error = OutputError(
            "the current folder is gone, relative paths lead nowhere",
            hint="change to a folder that exists, or give whole paths, also to --out",
        )
        return _fail(folder_error, as_json=as_json)
    if os.environ.get("CALIBKIT_DEBUG"):
        import traceback

        traceback.print_exception(error)
    internal = CalibkitError(
        f"internal error: {type(error).__name__}: {error}",
        hint="set CALIBKIT_DEBUG=1 and report what it prints",
    )
    return _fail(internal, as_json=as_json)


def _fail(error: CalibkitError, *, as_json: bool) -> int:
    """Print what went wrong, on stderr or as JSON, and return the exit code."""
    if as_json:
        log_line("say", f"calibkit: {error}")
        print_json({"ok": False, "error": error_document(error)})
    else:
        print_message(f"calibkit: {error}")
    return error.exit_code


def _discard(descriptor: int) -> None:
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
            _discard(self.fileno())
            return super().write(data)


def tolerate_closed_pipes() -> None:
    """Put a `_Pipe` below stdout and stderr of the process where they are redirected; on a terminal
    somebody reads. What is written to one that is closed goes nowhere.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            nowhere = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 (for the whole process)
            setattr(sys, name, nowhere)
        elif (
            stream is getattr(sys, f"__{name}__")
            and isinstance(stream, io.TextIOWrapper)
            and not stream.isatty()
        ):
            stream.flush()
            raw = io.BufferedWriter(_Pipe(stream.fileno(), "wb", closefd=False))
            wrapped = io.TextIOWrapper(
                raw,
                encoding=stream.encoding,
                errors=stream.errors,
                line_buffering=stream.line_buffering,
                write_through=stream.write_through,
            )
            setattr(sys, name, wrapped)
