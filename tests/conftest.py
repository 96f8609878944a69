"""Fixtures that many tests share: a simulated campaign, the command line in this process, the
reference measurements.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported; see calibkit.cli

import importlib.util
import json
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calibkit import cli
from calibkit.report import figures, svg

# a shell's background job ignores Ctrl-C, and so would every command that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
AUTHORITIES = Path(__file__).resolve().parent / "authorities"
NIST = Path(__file__).resolve().parent / "nist_strd"
"""Regression data sets of NIST with certified values; their source is in SOURCE.txt there."""
REAL = ROOT.parent / "shared" / "data"


class Ink:
    """Whether fits in this process render their reports: six sevenths of a fit's time, and most
    tests are after its numbers.

    Figures and tables are made always. Rendered they are in tests that are marked `drawn`, and in
    every process of its own.
    """

    settle = staticmethod(figures.settle)
    inline = staticmethod(svg.inline)

    @staticmethod
    def unsettled(drawings):
        """Figures that nobody lays out."""

    @staticmethod
    def unseen(drawings):
        """Drawings of a page without their ink."""
        return ["<svg></svg>"] * len(drawings), False


def use_ink(drawn):
    """Render the reports of fits in this process from now on, or not; returns what was before."""
    before = figures.settle is Ink.settle
    figures.settle = Ink.settle if drawn else Ink.unsettled
    svg.inline = Ink.inline if drawn else Ink.unseen
    return before


def pytest_runtest_setup(item):
    """Give a test, and the fixtures that are made for it, ink or none."""
    use_ink(item.get_closest_marker("drawn") is not None)


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


def slow_after(count, values):
    """Parameters of a test, of which the first `count` are in the default run, the others slow."""
    values = list(values)
    entries = [value if isinstance(value, tuple) else (value,) for value in values]
    rest = [pytest.param(*entry, marks=pytest.mark.slow) for entry in entries[count:]]
    return [*values[:count], *rest]


def called(*arguments, **options):
    """Run the command line in this process and return its exit code; an option may be a keyword,
    `out=path` for --out, which one among the arguments overrides.
    """
    words = [*arguments[:1]]
    for name, value in options.items():
        words += [f"--{name.replace('_', '-')}", value]
    words += arguments[1:]
    with pytest.raises(SystemExit) as stopped:
        cli.main([str(word) for word in words])
    return stopped.value.code


@pytest.fixture
def calibkit(capfd):
    """Run the command line in this process and return its outcome."""

    def run(*arguments, **options):
        capfd.readouterr()
        code = called(*arguments, **options)
        captured = capfd.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run


def load_script(path):
    """A script as a module, under the name of its file, which its own imports may need."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


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
def campaign():
    """Return the folder with the sample ramps of a simulated gyro, which no test may change."""
    return ROOT / "datasets" / "fog_thermal"


@pytest.fixture
def real():
    """Return the folder of real measurements, or skip where it is absent."""
    if not REAL.is_dir():
        pytest.skip("the real measurements are not beside this checkout")
    return REAL
