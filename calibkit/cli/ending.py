"""How a command ends: the contract's exit codes, one message a failure."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from calibkit.cli.console import note, print_json, say
from calibkit.errors import CalibkitError, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable


BROKEN_PIPE = 141
"""Exit code of a command that a closed pipe ended, as shells count it (128 + SIGPIPE); 1 would say
that a limit failed.
"""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a write to a stream; files that calibkit writes itself have OutputError."""


def _silence_stdout() -> None:
    """Send what is still buffered for stdout nowhere: the interpreter would try to write it again
    at the end.
    """
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    """Exit code of a command, which the log file ends with."""
    code = _outcome(run, as_json=as_json)
    note("ended", f"exit code {code}")
    return code


def _outcome(run: Callable[[], Any], *, as_json: bool) -> int:  # noqa: PLR0911 (one return a kind of ending)
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
        return _fail(
            130,
            "interrupted",
            "interrupted; what was not finished was not written",
            "",
            as_json=as_json,
        )
    except (
        BrokenPipeError
    ):  # of another pipe than stdout and stderr, or where the system cannot tell whose it is
        _silence_stdout()
        return BROKEN_PIPE
    except Exception as error:  # noqa: BLE001 (the last resort: a traceback helps nobody at the bench)
        if isinstance(error, OSError) and error.filename is None and error.errno in FULL:
            _silence_stdout()
            message, hint = (
                f"stdout: cannot be written: {error.strerror}",
                "free space; what was printed is not whole",
            )
            return _fail(OutputError.exit_code, OutputError.code, message, hint, as_json=False)
        import traceback

        if os.environ.get("CALIBKIT_DEBUG"):
            traceback.print_exc()
        message = f"internal error: {type(error).__name__}: {error}"
        return _fail(
            70,
            "internal",
            message,
            "set CALIBKIT_DEBUG=1 and report what it prints",
            as_json=as_json,
        )
    return code if isinstance(code, int) else 0


def _fail(exit_code: int, code: str, message: str, hint: str, *, as_json: bool) -> int:
    """Say what went wrong, on stderr or as JSON, and return the exit code."""
    if as_json:
        note("say", f"calibkit: {message}{f'; {hint}' if hint else ''}")
        print_json({"ok": False, "error": {"code": code, "message": message, "hint": hint}})
    else:
        say(f"calibkit: {message}{f'; {hint}' if hint else ''}")
    return exit_code
