"""Libraries that only some formats need, and the exceptions that they raise on damaged files."""

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from calibkit.errors import CalibkitError, LogFormatError, UsageError
from calibkit.libraries import extras


def import_library(module: str, extra: str, file: str) -> Any:  # noqa: ANN401 (a module of a library that may be absent)
    """Import a library by its module's name, or raise UsageError that says how to install
    it.
    """
    return extras.load_library(module, extra, _need(module, file), UsageError)


def require_library(module: str, extra: str, file: str) -> None:
    """Raise UsageError with how to install a library that is absent; it is not imported."""
    if importlib.util.find_spec(module) is None:
        raise UsageError(_need(module, file), hint=extras.install_hint(extra))


def _need(module: str, file: str) -> str:
    """What a file needs to be read."""
    return f"{file}: reading this format needs {module.partition('.')[0]}"


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
