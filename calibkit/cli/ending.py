"""How a command ends: the exit codes of the contract, one message per failure."""

import contextlib
import errno
import os
import sys
from collections.abc import Callable
from typing import Any

import click

from calibkit.cli.console import log_line, print_json, print_message
from calibkit.cli.pipe import discard
from calibkit.errors import CalibkitError, OutputError

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
        return _fail(error.exit_code, error.code, error.message, error.hint, as_json=as_json)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 2
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"see {context.command_path} --help" if context else "see calibkit --help"
        return _fail(2, "usage", error.format_message().rstrip("."), hint, as_json=as_json)
    except (KeyboardInterrupt, click.Abort):
        message = "interrupted; what was not finished was not written"
        return _fail(130, "interrupted", message, "", as_json=as_json)
    except Exception as error:  # noqa: BLE001 (the last resort: a traceback helps nobody at the bench)
        return _end_unexpected(error, as_json=as_json)
    return code if isinstance(code, int) else 0


def _end_unexpected(error: Exception, *, as_json: bool) -> int:
    """Exit code of a command that failed to print, or failed by an error of calibkit."""
    full = isinstance(error, OSError) and error.filename is None and error.errno in _FULL
    if full or isinstance(error, BrokenPipeError):
        # the interpreter would try to write again at its end what is still buffered
        with contextlib.suppress(OSError, ValueError):
            discard(sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        # of another pipe than stdout and stderr, or where the system cannot tell whose it is
        return _BROKEN_PIPE
    if isinstance(error, OSError) and full:
        message = f"stdout: cannot be written: {error.strerror}"
        hint = "free space; what was printed is not whole"
        return _fail(OutputError.exit_code, OutputError.code, message, hint, as_json=False)
    if os.environ.get("CALIBKIT_DEBUG"):
        import traceback

        traceback.print_exception(error)
    message = f"internal error: {type(error).__name__}: {error}"
    hint = "set CALIBKIT_DEBUG=1 and report what it prints"
    return _fail(70, "internal", message, hint, as_json=as_json)


def _fail(exit_code: int, code: str, message: str, hint: str, *, as_json: bool) -> int:
    """Print what went wrong, on stderr or as JSON, and return the exit code."""
    text = f"calibkit: {message}{f'; {hint}' if hint else ''}"
    if as_json:
        log_line("say", text)
        print_json({"ok": False, "error": {"code": code, "message": message, "hint": hint}})
    else:
        print_message(text)
    return exit_code
