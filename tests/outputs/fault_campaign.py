"""One fault at every step of a write, each in a process of its own: what a disk, a kill -9 or a
power cut can do.

Run as a program: `fault_campaign.py FOLDER run|file KILL|ENOSPC|…`. A step is an audit event of the
interpreter (open, mkdir, rename, link, remove, …) or a call of fsync; audit hooks cannot be taken
off again, hence the child processes. Prints one JSON line a step: how the child ended, and what it
left behind.
"""

import errno
import json
import os
import signal
import stat
import sys
from pathlib import Path

import rfc8785  # noqa: F401 (imported before the steps are counted)

from calibkit.errors import CalibkitError
from calibkit.records import new_files, sealed, store
from kept import keep, model

EVENTS = (
    "open",
    "os.mkdir",
    "os.rename",
    "os.link",
    "os.remove",
    "os.rmdir",
    "os.chmod",
    "os.listdir",
)
CONTENT = bytes(range(256)) * 512
FINISHED, REFUSED, BROKEN = 0, 4, 70


class Step:
    """Counts the steps of a child and lets one of them fail."""

    def __init__(self, at, fault):
        self.left, self.fault = at, fault

    def __call__(self):
        """Take one step."""
        self.left -= 1
        if self.left == 0:
            if self.fault == "KILL":
                os.kill(os.getpid(), signal.SIGKILL)
            code = getattr(errno, self.fault)
            raise OSError(code, os.strerror(code))


def write(folder, what):
    """Write what is under test: the second revision of a serial, or one file."""
    if what == "run":
        keep(folder, model({"K": (2.0, "1", 0.1)}), date="2025-01-01")
    else:
        new_files.write_new(folder / "deep" / "out.csv", CONTENT)


def child(folder, what, at, fault):
    """Write with one fault and end with a code that says how it went."""
    step = Step(at, fault)
    own = os.fsync

    def fsync(handle):
        if fault == "KILL" and step.left == 1 and stat.S_ISREG(os.fstat(handle).st_mode):
            os.ftruncate(
                handle, os.fstat(handle).st_size // 2
            )  # a page that never reached the disk
        step()
        own(handle)

    os.fsync = fsync
    sys.addaudithook(lambda event, arguments: step() if event in EVENTS else None)
    try:
        write(folder, what)
    except CalibkitError:
        os._exit(REFUSED)
    except Exception as error:  # noqa: BLE001 (what is not calibkit's own is what the campaign looks for)
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        sys.stderr.flush()
        os._exit(BROKEN)
    os._exit(FINISHED if step.left > 0 else FINISHED + 1)


def state(folder, what):
    """What a reader finds: the whole old state, the whole new one, or something else."""
    if what == "file":
        path = folder / "deep" / "out.csv"
        return "old" if not path.exists() else "new" if path.read_bytes() == CONTENT else "torn"
    try:
        values = [
            store.load_revision(folder, "S-1", number)
            .records["gyro_scale.json"]
            .models[0]
            .value("K")
            for number in store.revisions(folder / "S-1")
        ]
    except CalibkitError as error:
        return f"torn: {error}"
    return {(1.0,): "old", (1.0, 2.0): "new"}.get(tuple(values), f"torn: {values}")


def litter(folder):
    """Names that are neither a run, its files, nor the file under test."""
    names = (path.name for path in folder.rglob(".*"))
    return sorted(name for name in names if not name.startswith(".highest-"))


def after(folder, what):
    """State after the same is written again without a fault, and what still lies about."""
    if what == "file":
        return "", litter(folder)
    keep(folder, model({"K": (3.0, "1", 0.1)}), date="2026-01-01")
    numbers = store.revisions(folder / "S-1")
    last = store.load_revision(folder, "S-1", numbers[-1])
    before = store.load_revision(folder, "S-1", numbers[-2])
    follows = last.records["gyro_scale.json"].supersedes == before.stage_digests()["gyro_scale"]
    return f"r{numbers[-1]:03d}{' supersedes' if follows else ' BROKEN CHAIN'}", litter(folder)


def main(root, what, fault):
    """Let every step fail once and print what was left."""
    sealed._digest({"a": 1})
    for at in range(1, 500):
        folder = Path(root) / f"{what}-{fault}-{at}"
        folder.mkdir()
        if what == "run":
            keep(folder, model({"K": (1.0, "1", 0.1)}))
        pid = os.fork()
        if pid == 0:
            child(folder, what, at, fault)
        _, status = os.waitpid(pid, 0)
        found = state(folder, what)
        left = litter(folder)
        again, still = after(folder, what)
        sys.stdout.write(
            json.dumps([at, os.waitstatus_to_exitcode(status), found, left, again, still]) + "\n"
        )
        sys.stdout.flush()
        if os.waitstatus_to_exitcode(status) == FINISHED:
            return
    raise SystemExit("no end")


if __name__ == "__main__":
    main(*sys.argv[1:])
