"""Fixtures that many tests share: a simulated campaign, the command line in this process, the reference measurements."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported; see calibkit.cli

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calibkit import cli

ROOT = Path(__file__).resolve().parents[1]
AUTHORITIES = Path(__file__).resolve().parent / "authorities"
REAL = ROOT.parent / "shared" / "data"


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit code, stdout, stderr."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        """The document on stdout."""
        return json.loads(self.out)


@pytest.fixture
def calibkit(capfd):
    """Run the command line in this process and return its outcome."""

    def run(*arguments):
        capfd.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        return Outcome(stopped.value.code, captured.out, captured.err)

    return run


def write_log(path, **columns):
    """Write columns as a canonical CSV log with full precision."""
    rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def log_writer():
    """Return the function that writes columns as a log."""
    return write_log


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """Return a folder with a simulated gyro whose drift the published model improves (seed 7)."""
    from calibkit.simulate import fog_thermal

    folder = tmp_path_factory.mktemp("campaign")
    for name, content in fog_thermal.campaign(7).files().items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    return folder


@pytest.fixture
def real():
    """Return the folder of real measurements, or skip where it is absent."""
    if not REAL.is_dir():
        pytest.skip("the real measurements are not beside this checkout")
    return REAL
