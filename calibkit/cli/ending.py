"""How a command ends: the contract's exit codes, one message a failure."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import click

from calibkit.cli.console import print_json
from calibkit.errors import CalibkitError

if TYPE_CHECKING:
    from collections.abc import Callable


def guarded(run: Callable[[], Any], *, as_json: bool) -> int:  # noqa: PLR0911 (one return a kind of ending)
    """Exit code of a command; every failure becomes one message, and one JSON document where JSON was asked for."""
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
        return _fail(130, "interrupted", "interrupted; nothing was written", "", as_json=as_json)
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except Exception as error:  # noqa: BLE001 (the last resort: a traceback helps nobody at the bench)
        import traceback

        if os.environ.get("CALIBKIT_DEBUG"):
            traceback.print_exc()
        message = f"internal error: {type(error).__name__}: {error}"
        return _fail(70, "internal", message, "set CALIBKIT_DEBUG=1 and report what it prints", as_json=as_json)
    return code if isinstance(code, int) else 0


def _fail(exit_code: int, code: str, message: str, hint: str, *, as_json: bool) -> int:
    """Say what went wrong, on stderr or as JSON, and return the exit code."""
    if as_json:
        print_json({"ok": False, "error": {"code": code, "message": message, "hint": hint}})
    else:
        click.echo(f"calibkit: {message}{f'; {hint}' if hint else ''}", err=True)
    return exit_code
