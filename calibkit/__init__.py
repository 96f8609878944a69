"""Calibration of fibre-optic gyros, accelerometers and borehole inclinometers.

The names of `__all__` are the public interface: what the commands do, for scripts and notebooks,
and four of the numeric core's functions. They are loaded when they are asked for; everything else
may change between versions.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from calibkit.records.version import __version__ as __version__

if TYPE_CHECKING:
    from calibkit.api import (
        CalibkitError,
        Run,
        UncertaintyComponent,
        allan_deviation,
        certify,
        combine_uncertainty,
        compensate,
        denoise,
        evaluate,
        examine,
        export_firmware,
        find_run,
        fit,
        load_coefficients,
        load_recipe,
        read_log,
        regress,
        simulated,
        validate,
        verify,
    )

__all__ = [
    "CalibkitError",
    "Run",
    "UncertaintyComponent",
    "allan_deviation",
    "certify",
    "combine_uncertainty",
    "compensate",
    "denoise",
    "evaluate",
    "examine",
    "export_firmware",
    "find_run",
    "fit",
    "load_coefficients",
    "load_recipe",
    "read_log",
    "regress",
    "simulated",
    "validate",
    "verify",
]


class _Package(ModuleType):
    """The package, of which `fit` stays the function: an import of calibkit.fit would put the
    module of that name in its place.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name != "fit":
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> object:
    """Public name, loaded now."""
    if name not in __all__:
        raise AttributeError(f"module 'calibkit' has no attribute '{name}'")
    from calibkit import api

    return getattr(api, name)


def __dir__() -> list[str]:
    """Public names."""
    return [*__all__, "__version__"]
