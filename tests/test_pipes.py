"""A reader that leaves early does not change how a command ends."""

import subprocess
import sys

import pytest

from conftest import ROOT
from firmware_runs import cached


def unread(arguments, folder, *, both=False):
    """Exit code and stderr of a command whose stdout (or both streams) nobody reads."""
    with subprocess.Popen(
        [sys.executable, "-m", "calibkit", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT if both else subprocess.PIPE,
        cwd=folder,
        env={"PATH": "", "PYTHONPATH": str(ROOT)},
    ) as process:
        process.stdout.close()
        said = "" if both else process.stderr.read().decode()
    return process.returncode, said


@pytest.mark.parametrize("form", [(), ("--json",), ("--csv",)])
def test_show_into_a_closed_pipe_ends_as_show(form, tmp_path, tmp_path_factory):
    """Table, JSON and CSV: exit code 0, and stderr says nothing."""
    folder = cached("scale", tmp_path_factory).run.folder
    assert unread(("show", folder, *form), tmp_path) == (0, "")


def test_a_refusal_into_a_closed_pipe_keeps_its_own_code(tmp_path):
    """A run that is not there is 2, on stdout as JSON and on stderr in words, read or not."""
    assert unread(("show", "NONE", "--json"), tmp_path) == (2, "")
    assert unread(("show", "NONE"), tmp_path, both=True) == (2, "")


def test_help_into_a_closed_pipe_is_no_failure(tmp_path):
    """`calibkit --help | true`."""
    assert unread(("--help",), tmp_path) == (0, "")
