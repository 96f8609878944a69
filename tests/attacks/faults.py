"""Every call of a command that touches a file of its own failed once, or the process killed there:
the old state or the new, nothing in between.

A step is an audit event of the interpreter (open, mkdir, rename, link, remove, …) on a path
in the campaign's folder, or a call of fsync. Each attack is a process of its own, a copy of one
that has imported everything.
"""

import errno
import os
import random
import shutil
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from attacks import campaigns
from calibkit import cli
from calibkit.cli import console

EVENTS = {
    "open", "os.mkdir", "os.rename", "os.link", "os.remove", "os.rmdir", "os.chmod", "os.listdir",
    "os.scandir", "os.truncate", "tempfile.mkstemp", "tempfile.mkdtemp",
}  # fmt: skip
FAULTS = ("ENOSPC", "EIO", "EINTR")
MOST_STEPS = 60
PLAN = (
    *("plan", "accelerometer", "--range", "-40", "85", "--want", "inclination<=0.05 deg"),
    *("--attitudes", "faces", "--restarts", "1"),
)
ENDS = {0, 1, 2, 3, 4}
"""Exit codes of commands that ended as they should."""


@dataclass(frozen=True)
class Command:
    """A command on a folder that holds logs and a run, and what it writes there."""

    name: str
    arguments: tuple[str, ...]
    out: str


def commands(folder):
    """Commands of the attack, in a folder that `prepare` made."""
    run = ("--runs", f"{folder}/runs")
    fit = ("fit", "bias_temperature", "--data", f"{folder}/logs", "--date", "2026-01-02")
    dated = ("--date", "2026-01-02")
    return (
        Command("fit", (*fit, "--serial", "S-1", "--out", f"{folder}/runs"), "runs"),
        Command(
            "apply",
            (
                "apply",
                "S-1",
                "--data",
                f"{folder}/logs/log_0.csv",
                *run,
                "--out",
                f"{folder}/a/b.csv",
            ),
            "a",
        ),
        Command("certify", ("certify", "S-1", *run, "--out", f"{folder}/c/c.pdf", *dated), "c"),
        Command("export", ("export", "S-1", *run, "--target", "c", "--out", f"{folder}/e"), "e"),
        Command("report", ("report", "S-1", *run, "--out", f"{folder}/r/r.pdf"), "r"),
        Command("plan", (*PLAN, "--out", f"{folder}/p"), "p"),
        Command(
            "fleet",
            (
                "fleet",
                "bias_temperature",
                "--data",
                f"{folder}/units",
                "--jobs",
                "1",
                "--out",
                f"{folder}/f",
                *dated,
            ),
            "f",
        ),
    )


def prepare(folder):
    """Write logs of a device and of a fleet, and fit the first run."""
    for seed, place in enumerate(("logs", "units/U1", "units/U2"), start=1):
        (folder / place).mkdir(parents=True, exist_ok=True)
        for name, log in campaigns.bias_logs(seed, rows=400).items():
            (folder / place / name).write_text(log.format(), encoding="utf-8")
    if call(commands(folder)[0].arguments) != 0:
        raise RuntimeError("the campaign cannot be fitted")
    call((*PLAN, "--dry-run", "--out", f"{folder}/p"))  # once for all copies, see `quick`


def call(arguments):
    """Run a command in this process and return its exit code."""
    try:
        cli.main(list(arguments))
    except SystemExit as stopped:
        return stopped.code or 0
    return 0


def contents(folder):
    """Name → bytes of the files below a folder, but what is not finished."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part.startswith(".") for part in path.parts)
    }


class Step:
    """Counts the steps of a command on its folder and lets one of them fail."""

    def __init__(self, at, fault, folder):
        self.left, self.fault, self.folder = at, fault, str(folder)
        self.taken = 0

    def hook(self, event, arguments):
        """Take a step for an audit event on a path in the folder."""
        if event not in EVENTS:
            return
        path = arguments[0] if arguments else ""
        own = isinstance(path, (str, Path)) and str(path).startswith(self.folder)
        if own or event in {"tempfile.mkdtemp", "tempfile.mkstemp"}:
            self.take(str(path))

    def take(self, path=""):
        """Take one step."""
        self.taken += 1
        if self.taken == self.left:
            if self.fault == "KILL":
                os.kill(os.getpid(), signal.SIGKILL)
            code = getattr(errno, self.fault)
            raise OSError(code, os.strerror(code), path)


def run_child(command, at, fault, folder):
    """Run a command with one fault in a copy of this process; return its exit code, and whether
    the fault was reached.
    """
    pid = os.fork()
    if pid == 0:
        silence = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(silence, stream)
        step = Step(at, fault, folder)
        own = os.fsync

        def fsync(handle):
            step.take()
            own(handle)

        os.fsync = fsync
        sys.addaudithook(step.hook)
        code = call(command.arguments)
        os._exit(code if step.taken >= at else 100 + code)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return (code - 100, False) if code >= 100 else (code, True)


def attack(root, faults=FAULTS, only=None, every=1):
    """Return (command, fault) → attacks, and what was not survived."""
    whole = root / "whole"
    prepare(whole)
    counted, bad = {}, []
    for number, command in enumerate(commands(whole)):
        if only is not None and command.name not in only:
            continue
        expected = _expected(whole, root / "expected", number)
        for fault in faults:
            at, reached = 0, True
            while reached:
                at += every
                reached, found = _attack_once(whole, root / "attacked", number, at, fault, expected)
                counted[command.name, fault] = counted.get((command.name, fault), 0) + reached
                bad += [f"{command.name}, step {at}, {fault}: {one}" for one in found]
    return counted, bad


def _expected(whole, folder, number):
    """What a command leaves without a fault: before and after."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(whole, folder)
    command = commands(folder)[number]
    before = contents(folder / command.out)
    run_child(command, 10**9, "KILL", folder)  # threads of a library do not survive a copy
    return before, contents(folder / command.out)


def _attack_once(whole, folder, number, at, fault, expected):
    """Whether a fault was reached, and what is wrong with what it left."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(whole, folder)
    command, bad = commands(folder)[number], []
    code, reached = run_child(command, at, fault, folder)
    if not reached:
        return False, []
    if code not in ENDS and not (fault == "KILL" and code == -signal.SIGKILL):
        bad.append(f"exit code {code}")
    before, after = expected
    found = contents(folder / command.out)
    states = {"old": set(before), "new": set(after)}
    torn = [name for name, content in found.items() if content != after.get(name, b"")]
    partly = set(found) not in states.values() and command.name != "fleet"
    killed = fault == "KILL"  # between two names of files that belong together
    if torn or (partly and not killed):
        bad.append(f"torn: {torn or sorted(set(found) ^ states['new'])}")
    if code == 0 and not killed and set(found) != states["new"]:
        bad.append("exit code 0, but not all was written")
    litter = [path.name for path in (folder / command.out).rglob(".writing-*")]
    if litter or killed:
        bad += _still_there(folder, number)
    return True, bad


def _still_there(folder, number):
    """Left-overs of two days ago after the next command into the same place."""
    command = commands(folder)[number]
    begun = time.time() - 2.0 * 86_400.0
    for path in (folder / command.out).rglob(".writing-*"):
        os.utime(path, (begun, begun))
    if command.name not in {"fit", "fleet"}:
        for path in (folder / command.out).glob("[!.]*"):
            path.unlink()
    code = run_child(command, 10**9, "KILL", folder)[0]
    left = [path.name for path in (folder / command.out).rglob(".writing-*")]
    return ([f"left after the next command: {left}"] if left else []) + (
        [] if code in {0, 1} else [f"the next command ends with {code}"]
    )


def kill(root, count, seed):
    """Kill commands at random steps; return number of kills and what was not survived."""
    whole = root / "whole"
    if not whole.exists():
        prepare(whole)
    generator, bad, kills = random.Random(seed), [], 0  # noqa: S311 (a fixed seed, not a secret)
    expected = {n: _expected(whole, root / "expected", n) for n in range(len(commands(whole)))}
    while kills < count:
        number = generator.randrange(len(expected))
        at = generator.randrange(1, MOST_STEPS)  # past the last step nothing is killed
        reached, found = _attack_once(
            whole, root / "attacked", number, at, "KILL", expected[number]
        )
        kills += reached
        bad += [f"{commands(whole)[number].name}, step {at}, KILL: {one}" for one in found]
    return kills, bad


def quick():
    """Let fits of this process and its copies draw nothing, six sevenths of their time, and search
    once for a plan.
    """
    from calibkit.planning import search
    from calibkit.report import documents, svg

    propose, proposals = search.propose, []

    def propose_once(bench):
        proposals.extend(() if proposals else [propose(bench)])
        return proposals[0]

    search.propose = propose_once

    documents.printed = lambda drawn: {"report.txt": b"not drawn\n"}
    svg.inline = lambda figures: (["<svg></svg>"] * len(figures), False)
    console.prepare_streams()
