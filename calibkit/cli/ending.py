"""How a command ends: the exit codes of the contract, one message per failure."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from calibkit.cli.console import error_document, print_json, print_message
from calibkit.errors import CalibkitError, OutputError, StoppedError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

_BROKEN_PIPE = 141
"""Exit code of a command whose reader has left, like `calibkit show | head`, as shells count it
(128 + SIGPIPE); 1 would say that a limit failed.
"""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a write to a stream; files that calibkit writes itself have OutputError."""


def run_to_exit_code(run: Callable[[], Any], *, as_json: bool) -> int:
    """Run a command and return its exit code."""
    try:
        code = _exit_code(run, as_json=as_json)
        sys.stdout.flush()
        sys.stderr.flush()
    except SystemExit as end:  # click ends so itself: completion with 0, a closed pipe with 1
        return _BROKEN_PIPE if end.code else 0
    except BrokenPipeError:
        _discard_output()
        return _BROKEN_PIPE
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
    except BrokenPipeError:
        raise
    except (KeyboardInterrupt, click.Abort):
        return _end_interrupted(as_json=as_json)
    except Exception as error:  # noqa: BLE001 (the last resort: a traceback helps nobody at the bench)
        return _end_unexpected(error, as_json=as_json)
    return code if isinstance(code, int) else 0


def _end_interrupted(*, as_json: bool) -> int:
    """Exit code of a command that a person stopped."""
    stopped = StoppedError("interrupted; what was not finished was not written")
    return _fail(stopped, as_json=as_json)


def _end_unexpected(error: Exception, *, as_json: bool) -> int:
    """Exit code of a command that failed to print, or failed by an error of calibkit."""
    cause: BaseException | None = error
    while cause is not None:  # an import that is interrupted may end with another error
        if isinstance(cause, KeyboardInterrupt):
            return _end_interrupted(as_json=as_json)
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, OSError) and error.filename is None and error.errno in _FULL:
        _discard_output()
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
        print_json({"ok": False, "error": error_document(error)})
    else:
        print_message(f"calibkit: {error}")
    return error.exit_code


def _discard_output() -> None:
    """Send what is still to be printed on stdout nowhere; the interpreter would try at its end."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
