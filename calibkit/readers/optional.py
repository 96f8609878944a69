"""Libraries that only some formats need, and the exceptions that they raise on damaged files."""

import importlib
import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from calibkit.errors import CalibkitError, LogFormatError, UsageError
from calibkit.extras import install_hint


def import_library(module: str, extra: str, file: str) -> Any:  # noqa: ANN401 (a module of a library that may be absent)
    """Import a library by its module's name, or raise UsageError that says how to install
    it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise _absent(module, extra, file) from None


def require_library(module: str, extra: str, file: str) -> None:
    """Raise UsageError with how to install a library that is absent; it is not imported."""
    try:
        installed = importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        installed = False
    if not installed:
        raise _absent(module, extra, file)


def _absent(module: str, extra: str, file: str) -> UsageError:
    """The error of a library that is absent."""
    return UsageError(
        f"{file}: reading this format needs {module.partition('.')[0]}",
        hint=install_hint(extra),
    )


@contextmanager
def refuse_damaged(file: str, format_title: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into a LogFormatError that names the
    file.
    """
    try:
        yield
    except (CalibkitError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 (a parser of a foreign format raises anything on damaged bytes)
        message = " ".join(str(error).split())[:120]
        raise LogFormatError(
            f"{file}: not a whole {format_title} file: {type(error).__name__}: {message}",
            hint="the file is damaged or cut off, or has another format; copy it again",
        ) from None
