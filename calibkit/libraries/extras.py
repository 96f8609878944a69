"""Libraries that are installed with one of the package's extras, like `calibkit[pdf]`."""

import importlib.util
import sys
from typing import Any

from calibkit.errors import CalibkitError, NotCheckedError, OutputError


def install_hint(extra: str) -> str:
    """How an extra gets into the environment that runs: by its own pip, which not every one has."""
    if importlib.util.find_spec("pip") is None:
        return f"install calibkit[{extra}] in place of calibkit (docs/installation.md)"
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    return f"{python} -m pip install 'calibkit[{extra}]'"


def load_library(
    module: str, extra: str, message: str, kind: type[CalibkitError] = OutputError
) -> Any:  # noqa: ANN401 (a module without types)
    """Module of an optional library; an error of a kind, which says how to install it, where it is
    absent.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise kind(message, hint=install_hint(extra)) from None


def load_checker(module: str) -> Any:  # noqa: ANN401 (a module without types)
    """Module of an optional library that checks certificates; NotCheckedError where it is
    absent.
    """
    return load_library(module, "verify", "NOT CHECKED: install calibkit[verify]", NotCheckedError)
