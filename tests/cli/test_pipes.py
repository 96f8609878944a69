"""A reader that leaves early, a stream that is closed, a current folder that is gone."""

import os
import subprocess
import sys

import pytest

from conftest import ROOT
from outputs.firmware_runs import cached
from written_logs import still

POSIX = pytest.mark.skipif(os.name != "posix", reason="closes descriptors in a shell")


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
def test_show_into_a_closed_pipe_ends_as_other_programs_do(form, tmp_path, tmp_path_factory):
    """Table, JSON and CSV: exit code 141, 128 + SIGPIPE, and stderr says nothing."""
    folder = cached("scale", tmp_path_factory).run.folder
    assert unread(("show", folder, *form), tmp_path) == (141, "")


def test_a_refusal_into_a_closed_pipe_says_nothing(tmp_path):
    """On stdout as JSON and on stderr in words."""
    assert unread(("show", "NONE", "--json"), tmp_path) == (141, "")
    assert unread(("show", "NONE"), tmp_path, both=True)[0] in (120, 141)


def in_shell(script, folder, *arguments):
    """Run a line of a shell in which `"$@"` is calibkit with these arguments."""
    return subprocess.run(
        ["sh", "-c", script, "sh", sys.executable, "-m", "calibkit", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=False,
    )


@POSIX
@pytest.mark.parametrize("closed", ["2>&-", ">&-"])
@pytest.mark.parametrize("command", ["fit", "check", "fleet"])
def test_a_closed_stream_stops_no_command(tmp_path, command, closed):
    """With stderr or stdout closed, as a service may start it, a command does what it does."""
    data = still(tmp_path / "logs" / ("S-1" if command == "fleet" else ""), 2)
    named = ("--serial", "S-1") if command == "fit" else ()
    place = () if command == "check" else ("--out", tmp_path / "runs")
    data = data.parent if command == "fleet" else data
    call = (command, "bias_temperature", "--data", data, *named, *place)
    assert in_shell(f'"$@" {closed}', tmp_path, *call).returncode == 0
    if place:
        assert list((tmp_path / "runs").rglob("run.json"))


@POSIX
@pytest.mark.parametrize("command", ["fit", "fleet"])
def test_a_current_folder_that_is_gone_is_named(tmp_path, command):
    """A relative output then has no place: exit code 4 and what to do, no internal error."""
    named = ("--serial", "S-1") if command == "fit" else ()
    call = (command, "bias_temperature", "--data", still(tmp_path / "logs", 2), *named)
    done = in_shell('mkdir g && cd g && rmdir ../g && "$@"', tmp_path, *call)
    assert done.returncode == 4
    assert done.stderr.splitlines()[-1].startswith("calibkit: the current folder is gone")
