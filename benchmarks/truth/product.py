"""calibkit as its users run it."""

from __future__ import annotations

import os
import subprocess
import sys

from speed.pairs import ONE_THREAD, ROOT

DATE = ("--date", "2026-11-21")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command of calibkit, whatever its exit code."""
    command = [sys.executable, "-m", "calibkit", *map(str, arguments)]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def calibkit(*arguments: object) -> None:
    """Run a command that must end with 0 or 1; raises RuntimeError with what it said."""
    done = run(*arguments)
    if done.returncode not in {0, 1}:
        raise RuntimeError(f"calibkit {arguments[0]}: {done.stderr}")
