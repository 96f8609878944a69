"""A write that is killed, runs out of disk or meets another: the old state or the new, nothing in
between.
"""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest

from calibkit import atomic, new_files, store
from calibkit.errors import OutputError
from conftest import ROOT
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
    done = run_child(ROOT / "tests" / "fault_campaign.py", folder, what, fault)
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
        assert still == []  # the next fit has cleared away what the killed one left


@POSIX
@pytest.mark.parametrize("fault", ["ENOSPC", "EROFS", "EACCES", "EIO", "EDQUOT"])
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
        assert still == []


@POSIX
@pytest.mark.parametrize("fault", ["KILL", "ENOSPC", "EACCES"])
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
def test_what_a_killed_apply_or_export_left_is_removed_by_the_next_into_that_folder(tmp_path):
    """Files of killed writes go with the next write; one that is still being written stays without
    a word.
    """
    rows, _ = campaign(tmp_path, "file", "KILL")
    assert any(left for _, _, _, left, *_ in rows)
    code = (
        "import sys, time; from pathlib import Path; from calibkit import new_files\n"
        "def parts():\n yield b'x'; print('begun', flush=True); time.sleep(60)\n"
        "new_files.write_new(Path(sys.argv[1]), parts())"
    )
    for folder in sorted(tmp_path.glob("file-KILL-*/deep")):
        new_files.write_new(folder / "next.csv", b"whole")
        assert litter(folder) == []
    with subprocess.Popen(
        [sys.executable, "-c", code, tmp_path / "slow.csv"], stdout=subprocess.PIPE, cwd=ROOT
    ) as writer:
        assert writer.stdout.readline() == b"begun\n"
        new_files.write_new(tmp_path / "quick.csv", b"whole")
        assert len(litter(tmp_path)) == 1
        writer.kill()
    new_files.write_new(tmp_path / "last.csv", b"whole")
    assert litter(tmp_path) == []


def litter(folder):
    """Names that begin with a dot."""
    return sorted(path.name for path in folder.rglob(".*") if not path.name.startswith(MARK))


def no_locks(handle, operation):
    """Answer as some network shares do."""
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


@POSIX
def test_without_locks_nothing_that_another_may_be_writing_is_cleared(
    tmp_path, monkeypatch, caplog
):
    """A share that answers ENOLCK, or one that gives each machine locks of its own: what lies
    unfinished there is named and stays, of runs and of files.
    """
    import fcntl

    mine, other = f"{atomic.UNFINISHED}aaa", ".writing-0badcafe-aaa"
    for name in (mine, other):
        (tmp_path / "S-1" / name).mkdir(parents=True)
        (tmp_path / "S-1" / name / "drift.json").write_bytes(b"{")
        (tmp_path / f"{name}f").write_bytes(b"half")
    with monkeypatch.context() as patch:
        patch.setattr(fcntl, "flock", no_locks)
        keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
        new_files.write_new(tmp_path / "a.csv", b"whole")
    assert len(litter(tmp_path)) == 4
    assert (tmp_path / "S-1" / mine / "drift.json").read_bytes() == b"{"
    assert len(caplog.messages) == 4
    keep(tmp_path, model({"K": (2.0, "1", 0.1)}))
    new_files.write_new(tmp_path / "b.csv", b"whole")
    assert litter(tmp_path) == sorted([other, f"{other}f"])
    assert all(other in message for message in caplog.messages[4:])


@POSIX
def test_a_run_that_has_its_name_is_never_emptied(tmp_path, monkeypatch):
    """The next fit clears what it takes for a left-over while its owner renames it: the owner is
    refused, or the run is whole.
    """
    left = tmp_path / "S-1" / f"{atomic.UNFINISHED}abc"
    left.mkdir(parents=True)
    (left / "drift.json").write_bytes(b"{}")
    own = shutil.rmtree

    def slow(folder, **options):
        with pytest.raises(FileNotFoundError):
            left.rename(tmp_path / "S-1" / "r001")
        own(folder, **options)

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", slow)
        store.clear(tmp_path, "S-1")
    assert litter(tmp_path) == []


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


@POSIX
def test_a_stdout_that_is_full_is_exit_code_4(tmp_path):
    """Data that could not be written to stdout were not delivered: exit code 4, not 0."""
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "calibkit", "show", "S-1", "--runs", str(tmp_path), "--csv"],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
            cwd=ROOT,
        )
    assert done.returncode == 4
    assert b"stdout" in done.stderr


def test_a_file_where_a_folder_should_be_is_one_message(tmp_path, calibkit):
    """`--out` below a plain file cannot be made a folder: exit code 4, for files and for runs."""
    (tmp_path / "file").write_bytes(b"")
    outcome = calibkit("simulate", "rate_table", "--out", tmp_path / "file" / "logs", "--seed", 1)
    assert outcome.code == 4
    with pytest.raises(OutputError, match="cannot be written"):
        keep(tmp_path / "file", model({"K": (1.0, "1", 0.1)}))


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_one_message(tmp_path):
    """A folder without write permission refuses a run and a file with the reason."""
    tmp_path.chmod(0o555)
    with pytest.raises(OutputError, match="Permission denied"):
        keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    with pytest.raises(OutputError, match="Permission denied"):
        new_files.write_new(tmp_path / "x.csv", b"x")


def test_a_lock_that_cannot_be_made_is_one_message(tmp_path, calibkit, monkeypatch):
    """On a read-only file system a fit, and each unit of a fleet, end with exit code 4, not as
    internal errors.
    """
    opened = os.open

    def read_only(path, flags, *arguments, **options):
        if flags & os.O_CREAT and str(path).endswith(".lock"):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return opened(path, flags, *arguments, **options)

    unit = tmp_path / "units" / "U1"
    unit.mkdir(parents=True)
    rows = [f"{k},{20.0 + 0.1 * k},{0.5 + 0.01 * k + 0.001 * (k * k % 7)}" for k in range(300)]
    text = "\n".join(["time_s,temp_case_degc,gyro_dph", *rows, ""])
    (unit / "warm.csv").write_text(text, encoding="utf-8")
    monkeypatch.setattr(os, "open", read_only)
    for call in (
        ("fit", "bias_temperature", "--data", unit, "--serial", "U1"),
        ("fleet", "bias_temperature", "--data", unit.parent),
    ):
        outcome = calibkit(*call, "--out", tmp_path / "runs")
        assert outcome.code == 4
        assert "U1: cannot be written: Read-only file system" in outcome.err


def test_a_name_longer_than_the_file_system_allows_is_one_message(tmp_path):
    """A file name of 300 characters cannot be written, and says so."""
    with pytest.raises(OutputError, match="cannot be written"):
        new_files.write_new(tmp_path / ("x" * 300), b"x")


def test_a_link_that_leads_nowhere_is_not_written_through(tmp_path):
    """A dangling symbolic link has the name taken: nothing is created where it points."""
    link = tmp_path / "out.csv"
    try:
        link.symlink_to(tmp_path / "elsewhere.csv")
    except OSError:
        pytest.skip("no symbolic links here")
    with pytest.raises(OutputError, match="exists already"):
        new_files.write_new(link, b"x")
    assert not (tmp_path / "elsewhere.csv").exists()


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


def test_threads_of_one_process_take_turns_too(tmp_path):
    """Eight threads never hold one lock together."""
    inside, most = [], []

    def work():
        with atomic.locked(tmp_path / "lock", "it"):
            inside.append(1)
            most.append(len(inside))
            time.sleep(0.002)
            inside.pop()

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 8


def test_a_lock_file_that_its_holder_has_just_removed_is_no_lock(tmp_path, monkeypatch):
    """Who waited for a lock whose holder removed the file takes a new one: the next to come must
    meet it.
    """
    own, calls = atomic.take_lock, []

    def taken(handle):
        calls.append(handle)
        if len(calls) == 1:
            (tmp_path / "lock").unlink()
        return own(handle)

    monkeypatch.setattr(atomic, "take_lock", taken)
    monkeypatch.setattr(atomic, "_PAUSE_S", 0.001)
    with atomic.locked(tmp_path / "lock", "it"):
        assert len(calls) == 2
        assert (tmp_path / "lock").exists()


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


def test_a_lock_that_stays_taken_is_refused_by_name(tmp_path, monkeypatch):
    """A serial that another process is writing is waited for, then refused with exit code 4;
    nothing is written.
    """
    monkeypatch.setattr(atomic, "_PAUSE_S", 0.001)
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    with (
        atomic.locked(tmp_path / ".S-1.lock", "S-1"),
        pytest.raises(OutputError, match=r"S-1 is being written by another calibkit; wait until"),
        atomic.locked(tmp_path / ".S-1.lock", "S-1", 0.01),
    ):
        pytest.fail("two hold one lock")
    assert store.revisions(tmp_path / "S-1") == [1]


@POSIX
def test_the_lock_of_a_killed_process_is_free(tmp_path):
    """A process that died holding the lock does not keep it: the file may stay, the lock goes."""
    code = (
        "import sys, time; from pathlib import Path; from calibkit import atomic\n"
        "with atomic.locked(Path(sys.argv[1]), 'it'):\n print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, tmp_path / "lock"], stdout=subprocess.PIPE, cwd=ROOT
    ) as holder:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(OutputError), atomic.locked(tmp_path / "lock", "it", 0.0):
            pytest.fail("it was held")
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    with atomic.locked(tmp_path / "lock", "it", 0.0):
        pass
    assert not (tmp_path / "lock").exists()


def test_on_windows_the_lock_is_that_of_msvcrt(tmp_path, monkeypatch):
    """Without fcntl the first byte is locked with msvcrt without waiting; when it is taken the
    refusal is the same.
    """
    calls = []

    def locking(handle, mode, count):
        calls.append((mode, count))
        if len(calls) > 1:
            raise PermissionError(13, "Permission denied")

    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", types.SimpleNamespace(locking=locking, LK_NBLCK=2))
    monkeypatch.setattr(atomic, "_REMOVABLE", False)
    with atomic.locked(tmp_path / "lock", "it", 0.0):
        assert calls == [(2, 1)]
        with pytest.raises(OutputError), atomic.locked(tmp_path / "lock", "it", 0.0):
            pytest.fail("it was held")
    assert (
        tmp_path / "lock"
    ).read_bytes() == b""  # an open file cannot be removed there; it stays for the next fit


@pytest.mark.parametrize("modules", [("fcntl", "msvcrt"), ("fcntl",)])
def test_where_the_system_has_no_locks_a_run_is_still_written_whole(tmp_path, monkeypatch, modules):
    """Neither fcntl nor msvcrt, or a file system that answers ENOLCK: the rename alone keeps the
    record.
    """

    def no_locks(handle, mode, count):
        raise OSError(37, "No locks available")

    monkeypatch.setitem(sys.modules, "msvcrt", types.SimpleNamespace(locking=no_locks, LK_NBLCK=2))
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    keep(tmp_path, model({"K": (2.0, "1", 0.1)}))
    assert store.load(store.find("S-1", tmp_path)).name == "S-1@r002"


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


def test_the_remains_of_a_killed_fit_are_cleared_and_other_files_stay(tmp_path):
    """The next fit removes unfinished run folders of its serial, and nothing else."""
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    serial = tmp_path / "S-1"
    left = serial / f"{atomic.UNFINISHED}abc"
    left.mkdir()
    (left / "drift.json").write_text("{", encoding="utf-8")
    (serial / "notes.txt").write_text("mine", encoding="utf-8")
    (serial / "r00x").mkdir()
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    names = sorted(path.name for path in serial.iterdir())
    assert names == [f"{MARK}r002", "notes.txt", "r001", "r002", "r00x"]
    shutil.rmtree(serial)
