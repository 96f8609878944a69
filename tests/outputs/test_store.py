"""Run folders: whole or absent, never overwritten, noticed when touched."""

import json
import os
import shutil

import pytest

from calibkit.errors import OutputError, UsageError
from calibkit.records import atomic, new_files, store
from kept import keep, model


def save_run(out, serial="S-1"):
    """Commit a run with one coefficient file and one report."""
    return keep(out, model({"K": (1.0, "1/deg", 0.1)}), serial=serial, stage="drift")


def test_revisions_follow_each_other_and_supersede(tmp_path):
    """The second run is r002, leaves r001 as it was, and names the digest of the file it
    supersedes.
    """
    first = save_run(tmp_path)
    before = {path.name: path.read_bytes() for path in first.iterdir()}
    second = save_run(tmp_path)
    assert (first.name, second.name) == ("r001", "r002")
    assert {path.name: path.read_bytes() for path in first.iterdir()} == before
    digest = json.loads(before["drift.json"])["sha256"]
    assert store.load(second).records["drift.json"].supersedes == digest
    assert store.load(first).records["drift.json"].supersedes == ""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("S-1@r009", "revisions there: r001"),
        ("S-2", "neither a run folder nor a serial"),
        ("../S-1", "neither"),
    ],
)
def test_a_run_that_is_not_there_is_said(tmp_path, name, message):
    """An unknown run names what there is."""
    save_run(tmp_path)
    with pytest.raises(UsageError, match=message):
        store.find(name, tmp_path)


@pytest.mark.parametrize("serial", ["", "../x", "a/b", ".hidden", "a\\b", "x" * 101, "a ", "end."])
def test_a_serial_that_cannot_name_a_folder_is_refused(serial):
    """A serial with a path in it, or nothing in it, is refused."""
    with pytest.raises(UsageError):
        store.check_serial(serial)


def test_a_failed_write_leaves_nothing_behind(tmp_path, monkeypatch):
    """When a file of a run cannot be written there is no run folder and no temporary one."""

    def full_disk(path, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic, "write_synced", full_disk)
    with pytest.raises(OutputError, match="No space left"):
        save_run(tmp_path)
    assert list((tmp_path / "S-1").iterdir()) == []


def test_an_existing_file_is_never_overwritten(tmp_path):
    """write_new refuses a name that is taken and leaves its content."""
    path = tmp_path / "a.json"
    new_files.write_new(path, b"one")
    with pytest.raises(OutputError, match="exists already"):
        new_files.write_new(path, b"two")
    assert path.read_bytes() == b"one"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def test_files_that_belong_together_are_all_there_or_none(tmp_path, monkeypatch):
    """The disk is full at the second of three, or its name is taken meanwhile: none is there, and
    what was there stays.
    """
    paths = [tmp_path / "deep" / name for name in ("a.c", "b.h", "c.csv")]
    write, rename = atomic.write_synced, new_files._rename_new

    def full(path, content):
        if content == b"b.h":
            raise OSError(28, "No space left on device")
        write(path, content)

    def raced(temporary, path):
        if path.name == "b.h":
            path.write_bytes(b"mine")
        rename(temporary, path)

    files = {path: path.name.encode() for path in paths}
    with monkeypatch.context() as patch:
        patch.setattr(atomic, "write_synced", full)
        with pytest.raises(OutputError, match=r"b\.h: cannot be written: No space left"):
            new_files.write_all(files)
    assert list((tmp_path / "deep").iterdir()) == []
    with monkeypatch.context() as patch:
        patch.setattr(new_files, "_rename_new", raced)
        with pytest.raises(OutputError, match=r"b\.h: exists already"):
            new_files.write_all(files)
    assert {path.name: path.read_bytes() for path in (tmp_path / "deep").iterdir()} == {
        "b.h": b"mine"
    }
    paths[1].unlink()
    new_files.write_all(files)
    assert {path.name.encode() == path.read_bytes() for path in (tmp_path / "deep").iterdir()} == {
        True
    }


def test_the_number_of_a_deleted_revision_is_not_given_again(tmp_path):
    """The newest run deleted and fitted again gets the next number, and `history` misses one."""
    save_run(tmp_path)
    shutil.rmtree(save_run(tmp_path))
    third = save_run(tmp_path)
    assert third.name == "r003"
    assert store.revisions(tmp_path / "S-1") == [1, 3]
    marks = [path.name for path in (tmp_path / "S-1").iterdir() if path.name.startswith(".")]
    assert marks == [".highest-r003"]
    assert store.find("S-1", tmp_path) == third


def test_a_store_of_0_2_and_a_mark_that_is_none_give_the_next_number(tmp_path):
    """What states no highest revision, or states it otherwise, is passed over."""
    save_run(tmp_path)
    mark = tmp_path / "S-1" / ".highest-r001"
    mark.rename(tmp_path / "S-1" / ".highest-number")
    assert save_run(tmp_path).name == "r002"


@pytest.mark.skipif(os.name != "posix", reason="needs pipes and links")
@pytest.mark.parametrize("kind", ["pipe", "device", "sparse"])
@pytest.mark.parametrize("file", ["run.json", "drift.json", "report.txt"])
def test_a_listed_file_that_never_ends_is_refused_unread(tmp_path, calibkit, file, kind):
    """A pipe, a link to a device, 20 GB of nothing: `verify` ends with exit code 4 in one line."""
    run = save_run(tmp_path)
    spoil(run / file, kind)
    outcome = calibkit("verify", run)
    assert (outcome.code, outcome.err.count("\n")) == (4, 1), outcome
    words = "at most 500 MB are read" if kind == "sparse" else "a pipe or a device"
    assert f"{file}: " in outcome.err
    assert words in outcome.err


def spoil(path, kind):
    """Put a pipe, a link to a device or a sparse file of 20 GB in the place of a file."""
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as stream:
            stream.truncate(20_000_000_000)


def test_a_day_that_no_calendar_has_selects_no_run(tmp_path):
    """SERIAL@2024-31-01 was compared as text, and gave the newest run."""
    save_run(tmp_path)
    with pytest.raises(UsageError, match="2024-31-01: not a date"):
        store.find("S-1@2024-31-01", tmp_path)
