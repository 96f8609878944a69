"""The attacks of docs/trust.md, a few of each; `python tests/attacks` writes the table there."""

import os
import re
import subprocess
import sys

import pytest

from attacks import logs
from conftest import ROOT

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs fork and kill -9")


def test_mutated_logs_are_read_or_refused_in_one_line(tmp_path):
    """200 logs of ten formats with bits, tokens and blocks changed."""
    for library in ("h5py", "nptdms", "openpyxl", "pyarrow"):
        pytest.importorskip(library)
    count, refused, bad = logs.attack(tmp_path, 200, 5)
    assert (count, bad) == (200, [])
    assert refused > 100


CODE = """
import sys, warnings
from pathlib import Path
warnings.simplefilter("ignore")
from attacks import faults
faults.quick()
counted, bad = faults.attack(Path(sys.argv[1]), ("EIO",), {"apply", "export"}, 8)
read, worse = faults.attack(Path(sys.argv[1]), ("EIO",), {"report"}, 3)
counted, bad = counted | read, bad + worse
kills, more = faults.kill(Path(sys.argv[1]), 3, 1)
sys.stderr.write(f"{sum(counted.values())} {kills} {[*bad, *more]}")
"""


@pytest.mark.slow
@POSIX
def test_calls_that_fail_and_kills_leave_the_old_state_or_the_new(tmp_path):
    """Every eighth call of apply and export, and every third of report, that touches a file of its
    own fails once; three kills of any command.
    """
    pytest.importorskip("typst")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    done = subprocess.run(
        [sys.executable, "-c", CODE, tmp_path],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ | {"PYTHONPATH": path},
    )
    last = done.stderr.splitlines()[-1]
    found = re.search(r"(\d+) (\d+) (\[.*\])$", last)
    assert found is not None, done.stderr[-2000:]
    assert int(found[1]) >= 8
    assert (found[2], found[3]) == ("3", "[]")


@POSIX
def test_what_strangers_wrote_is_refused_or_comes_to_nothing(tmp_path):
    """30 forged runs, 10 logs with names of theirs, and what never ends in the place of each file
    of a run, a plan and a delivery.
    """
    forged = pytest.importorskip("attacks.forged")
    exported, bad = forged.attack_runs(tmp_path / "runs", 30, 5)
    assert (0 < exported < 30, bad) == (True, [])
    (tmp_path / "logs").mkdir()
    assert forged.attack_names(tmp_path / "logs", 10, 5) == []
    (tmp_path / "special").mkdir()
    tried, bad = forged.attack_special_files(tmp_path / "special")
    assert (tried, bad) == (48, [])
