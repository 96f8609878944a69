"""Libraries that are installed with one of the package's extras: `pip install 'calibkit[pdf]'`."""

import importlib
from typing import Any

from calibkit.errors import NotCheckedError, OutputError


def load_library(module: str, extra: str, purpose: str) -> Any:  # noqa: ANN401 (a module without types)
    """Module of an optional library; OutputError with the command that installs it where it is
    absent.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise OutputError(purpose, hint=f"pip install 'calibkit[{extra}]'") from None


def load_checker(module: str) -> Any:  # noqa: ANN401 (a module without types)
    """Module of an optional library that checks certificates; NotCheckedError where it is
    absent.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise NotCheckedError(
            "NOT CHECKED: install calibkit[verify]", hint="pip install 'calibkit[verify]'"
        ) from None
