"""Units of a fleet without their report, whose drawing takes ten times as long as the fit, and
units that die on purpose.

A module of its own: the processes of a fleet import it by name.
"""

import os
import signal
import sys
from pathlib import Path

from calibkit.fleet import device
from calibkit.instruments.bias import figures
from calibkit.records import atomic, store
from calibkit.report.documents import Drawn


def outcome(plan, serial):
    """Fit one unit and print nothing but one line."""
    figures.draw = lambda title, fitted: Drawn((), fitted.summary)
    return device.fit_device(plan, serial)


def killed_while_writing(plan, serial):
    """Fit one unit; U003 is killed between the files of its run and the rename, the first time it
    is taken up.
    """
    mark = Path(plan.data) / "U003.killed"
    if serial == "U003" and not mark.exists():
        mark.touch()
        store._rename_folder = lambda temporary, target: os.kill(os.getpid(), signal.SIGKILL)
    return outcome(plan, serial)


def poisonous(plan, serial):
    """Fit one unit; U002 kills whoever takes it up."""
    if serial == "U002":
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome(plan, serial)


def threads(plan, serial):
    """Say how many threads numpy was told to take."""
    return device.Failure(serial, "said", 0, os.environ.get("OPENBLAS_NUM_THREADS", ""), "")


def imported(plan, serial):
    """Say whether this process began with what units need, where its calibkit is, and the threads
    of what it is a copy of.
    """
    threads = len(list(Path(f"/proc/{os.getppid()}/task").iterdir()))
    return device.Failure(
        serial, "said", 0, f"{'matplotlib.figure' in sys.modules} {atomic.__file__} {threads}", ""
    )
