"""Progress on a terminal: stage, percent and time left; nothing where nobody looks; Ctrl-C leaves
nothing behind.
"""

import os
import re
import signal
import subprocess
import sys

import pytest

from calibkit.cli.ending import run_to_exit_code
from conftest import ROOT
from written_logs import still

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


def on_terminal(*arguments, interrupt_at=None):
    """Exit code of a command on a terminal, and what it printed; SIGINT once it printed a text."""
    import pty

    controller, terminal = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "calibkit", *map(str, arguments)],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        cwd=ROOT,
        env=os.environ | {"TERM": "xterm-256color", "COLUMNS": "100", "PYTHONPATH": str(ROOT)},
    )
    os.close(terminal)
    printed = b""
    while True:
        try:
            chunk = os.read(controller, 65536)
        except OSError:
            break
        if not chunk:
            break
        printed += chunk
        if interrupt_at and interrupt_at in printed:
            process.send_signal(signal.SIGINT)
            interrupt_at = None
    os.close(controller)
    return process.wait(timeout=60), printed


@pytest.mark.parametrize("command", ["fit", "check"])
def test_a_terminal_sees_stage_percent_and_time_left(tmp_path, command):
    """Of forty logs: the stage by name, a percentage between 0 and 100, the word "left"; the lines
    are wiped away and the cursor is back.
    """
    data = still(tmp_path / "logs", 40)
    keep = ("--serial", "S", "--out", tmp_path / "runs") if command == "fit" else ()
    code, printed = on_terminal(command, "bias_temperature", "--data", data, *keep)
    assert code == 0
    text = re.sub(rb"\x1b\[[0-9;?]*[a-zA-Z]", b"", printed).decode()
    assert {"fit": "reading", "check": "checking"}[command] in text
    assert any(0 < int(found) < 100 for found in re.findall(r"(\d+)% \d:", text))
    assert " left " in text
    assert printed.rfind(b"\x1b[?25h") > printed.rfind(b"\x1b[?25l")


def test_ctrl_c_leaves_nothing_behind(tmp_path):
    """Interrupted while it reads, a fit ends with 130 and one line; no run, no lock, no temporary
    file is there, and the cursor is back.
    """
    out = tmp_path / "runs"
    data = ROOT / "datasets" / "fog_thermal"  # read and fitted for seconds
    code, printed = on_terminal(
        *("fit", "fog_thermal", "--data", data, "--serial", "S", "--out", out),
        interrupt_at=b"reading",
    )
    assert code == 130
    assert b"interrupted; what was not finished was not written" in printed
    assert b"Traceback" not in printed
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert printed.rfind(b"\x1b[?25h") > printed.rfind(b"\x1b[?25l")


def test_an_import_that_is_interrupted_is_an_interruption():
    """Though the library that was being imported ends with an error of its own."""

    def interrupt():
        raise KeyboardInterrupt

    def run():
        try:
            interrupt()
        except KeyboardInterrupt:
            raise ImportError("half of a module") from None

    assert run_to_exit_code(run, as_json=False) == 130
