"""A write that is killed, runs out of disk or meets another: the old state or the new, nothing in
between.
"""

import errno
import json
import os
import subprocess
import sys
import tempfile
import time

import pytest

from calibkit.errors import OutputError
from calibkit.records import atomic, new_files, store
from conftest import ROOT, slow_after
from kept import keep, model

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs fork and kill -9")
FINISHED, REFUSED, SURVIVED, KILLED = 0, 4, 1, -9
MARK = ".highest-"


def run_child(*arguments, **options):
    """Run this Python with the checkout and the tests on its path."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        check=False,
        timeout=120,
        env=os.environ | {"PYTHONPATH": path},
        **options,
    )


def campaign(folder, what, fault):
    """What each step of a write left when it failed: rows of (step, exit code, state, litter, state
    after, litter after).
    """
    done = run_child(ROOT / "tests" / "outputs" / "fault_campaign.py", folder, what, fault)
    assert done.returncode == 0, done.stderr.decode()
    rows = [json.loads(line) for line in done.stdout.decode().splitlines()]
    assert len(rows) > 8
    assert rows[-1][1] == FINISHED
    return rows[:-1], done.stderr.decode()


@POSIX
def test_kill_9_at_any_step_of_a_fit_leaves_the_old_run_or_the_new_one(tmp_path):
    """Killed before every system call and with half-written pages: r001, or r001 and r002, each
    whole; the next fit goes on.
    """
    rows, _ = campaign(tmp_path, "run", "KILL")
    assert {code for _, code, *_ in rows} == {KILLED}
    assert {found for _, _, found, *_ in rows} == {"old", "new"}
    for _, _, found, _, again, still in rows:
        assert again == ("r002 supersedes" if found == "old" else "r003 supersedes")
        assert len(still) <= 1  # what the killed one left goes a day later


@POSIX
@pytest.mark.parametrize("fault", slow_after(1, ["ENOSPC", "EROFS", "EACCES", "EIO", "EDQUOT"]))
def test_an_error_of_the_disk_at_any_step_is_one_message_and_leaves_the_old_run_or_the_new_one(
    tmp_path, fault
):
    """Each system call fails once: the fit refuses with exit code 4 and leaves nothing, or it
    succeeded and says so.
    """
    rows, talk = campaign(tmp_path, "run", fault)
    assert talk == ""  # an exception that is not calibkit's own would be printed
    for _, code, found, left, again, still in rows:
        assert (code, found) in {(REFUSED, "old"), (SURVIVED, "new")}
        assert [name for name in left if name.startswith(".writing")] == []
        assert "supersedes" in again
        assert still == left


@POSIX
@pytest.mark.parametrize("fault", slow_after(1, ["KILL", "ENOSPC", "EACCES"]))
def test_a_file_is_there_whole_or_not_at_all(tmp_path, fault):
    """The same for a single file, certificate, export or compensated log."""
    rows, talk = campaign(tmp_path, "file", fault)
    assert talk == ""
    assert {found for _, _, found, *_ in rows} == {"old", "new"}
    if fault != "KILL":
        assert all(
            (code, found) in {(REFUSED, "old"), (SURVIVED, "new")} for _, code, found, *_ in rows
        )


@POSIX
@pytest.mark.parametrize("days", [0.9, 1.1])
def test_what_killed_writes_left_is_removed_a_day_later(tmp_path, days):
    """Files and folders that are not finished go with the next write into their folder, once they
    are a day old; younger ones may be another process's.
    """
    rows, _ = campaign(tmp_path, "file", "KILL")
    assert any(left for _, _, _, left, *_ in rows)
    begun = time.time() - days * 86_400.0
    folders = sorted(tmp_path.glob("file-KILL-*/deep"))
    for folder in folders:
        half = folder / ".writing-run"
        half.mkdir()
        (half / "drift.json").write_bytes(b"{")
        for path in folder.glob(".writing-*"):
            os.utime(path, (begun, begun))
        before = litter(folder)
        new_files.write_new(folder / "next.csv", b"whole")
        assert litter(folder) == ([] if days > 1.0 else before)


def litter(folder):
    """Names that begin with a dot."""
    return sorted(path.name for path in folder.rglob(".*") if not path.name.startswith(MARK))


@POSIX
@pytest.mark.parametrize("limit", [1000])
def test_a_disk_that_fills_up_under_a_command_is_exit_code_4(tmp_path, limit):
    """The kernel itself refuses to let a file grow: one line, exit code 4, nothing is left of the
    files.
    """
    code = (
        "import sys, resource; from calibkit import cli; "
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit})); "
        "cli.main(['simulate', 'rate_table', '--out', sys.argv[1], '--seed', '1'])"
    )
    done = run_child("-c", code, tmp_path / "logs")
    assert done.returncode == 4, done.stderr
    assert b"cannot be written: File too large" in done.stderr
    assert litter(tmp_path) == []


def test_a_file_system_that_is_read_only_is_one_message(tmp_path, calibkit, monkeypatch):
    """On a read-only file system a fit, and each unit of a fleet, end with exit code 4, not as
    internal errors.
    """
    made = tempfile.mkdtemp

    def read_only(suffix=None, prefix=None, dir=None):  # noqa: A002 (tempfile's own name)
        if prefix == atomic.UNFINISHED:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return made(suffix, prefix, dir)

    unit = tmp_path / "units" / "U1"
    unit.mkdir(parents=True)
    rows = [f"{k},{20.0 + 0.1 * k},{0.5 + 0.01 * k + 0.001 * (k * k % 7)}" for k in range(300)]
    text = "\n".join(["time_s,temp_case_degc,gyro_dph", *rows, ""])
    (unit / "warm.csv").write_text(text, encoding="utf-8")
    monkeypatch.setattr(tempfile, "mkdtemp", read_only)
    for call in (
        ("fit", "bias_temperature", "--data", unit, "--serial", "U1"),
        ("fleet", "bias_temperature", "--data", unit.parent),
    ):
        outcome = calibkit(*call, "--out", tmp_path / "runs")
        assert outcome.code == 4
        assert "U1: cannot be written: Read-only file system" in outcome.err


def test_fits_of_one_serial_at_once_take_numbers_in_turn(tmp_path):
    """Six processes commit to one serial at the same time: r001 to r006, none lost, a chain without
    a break.
    """
    code = (
        "import sys; from pathlib import Path; from kept import keep, model; "
        "keep(Path(sys.argv[1]), model({'K': (float(sys.argv[2]), '1', 0.1)}))"
    )
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    started = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path), str(k)],
            env=os.environ | {"PYTHONPATH": path},
        )
        for k in range(6)
    ]
    assert [process.wait(timeout=120) for process in started] == [0] * 6
    from calibkit.history import timeline

    found = timeline.Timeline.read("S-1", tmp_path)
    assert [run.document["revision"] for run in found.runs] == [1, 2, 3, 4, 5, 6]
    assert found.sound
    assert sorted(run.records["gyro_scale.json"].models[0].value("K") for run in found.runs) == [
        0,
        1,
        2,
        3,
        4,
        5,
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["S-1"]


def test_a_revision_that_was_taken_meanwhile_is_neither_replaced_nor_added_to(tmp_path):
    """Of two that write r002 the second gets None and leaves nothing; its fit goes on with
    r003, which supersedes r002.
    """
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    revisions = store.next_revisions(tmp_path, "S-1")
    number, superseded = next(revisions)
    second = keep(tmp_path, model({"K": (2.0, "1", 0.1)}))
    before = {path.name: path.read_bytes() for path in second.iterdir()}
    assert store.save(tmp_path, "S-1", number, {"run.json": b"{}"}) is None
    assert {path.name: path.read_bytes() for path in second.iterdir()} == before
    assert litter(tmp_path) == []
    after, later = next(revisions)
    assert (number, after) == (2, 3)
    assert later == store.load(second).stage_digests()
    assert later != superseded


def test_a_run_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """Every file and the temporary folder are synced before the rename, the folder above after
    it.
    """
    events = []
    synced, renamed = os.fsync, type(tmp_path).rename
    monkeypatch.setattr(os, "fsync", lambda handle: (events.append("sync"), synced(handle))[1])
    monkeypatch.setattr(
        type(tmp_path), "rename", lambda path, to: (events.append("rename"), renamed(path, to))[1]
    )
    (tmp_path / "S-1").mkdir()
    folder = keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    assert events == ["sync"] * (len(list(folder.iterdir())) + 1) + ["rename", "sync"]


def test_a_scanner_that_holds_a_new_folder_is_waited_for(tmp_path, monkeypatch):
    """A rename refused twice with PermissionError is tried again; refused for good it is exit code
    4.
    """
    refusals = [PermissionError(13, "Permission denied")] * 2
    own = type(tmp_path).rename

    def rename(path, target):
        if refusals:
            raise refusals.pop()
        return own(path, target)

    monkeypatch.setattr(store, "_SCANNER_PAUSES_S", (0.0, 0.0, 0.0))
    monkeypatch.setattr(type(tmp_path), "rename", rename)
    assert keep(tmp_path, model({"K": (1.0, "1", 0.1)})).name == "r001"
    refusals[:] = [PermissionError(13, "Permission denied")] * 9
    with pytest.raises(OutputError, match="Permission denied"):
        keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    names = {path.name for path in (tmp_path / "S-1").iterdir()}
    assert names == {"r001", f"{MARK}r001"}


def test_without_hard_links_a_file_is_renamed_and_still_replaces_nothing(tmp_path, monkeypatch):
    """On a FAT stick there are no hard links: the file is renamed, and a name that is taken is
    kept.
    """

    def no_links(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", no_links)
    new_files.write_new(tmp_path / "a", b"one")
    assert (tmp_path / "a").read_bytes() == b"one"
    (tmp_path / "t").write_bytes(b"two")
    with pytest.raises(FileExistsError):
        new_files._rename_new(tmp_path / "t", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"one"
