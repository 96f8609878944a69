"""Which runs lie under a folder: read once, kept in the user's cache, read again where they
changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import sys
import tempfile
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit.errors import CalibkitError, UsageError
from calibkit.records.new_files import RUN_FILE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

VERSION = 1
"""Of the index; one of another version is made anew."""
SERIAL = re.compile(r"[^\W_][\w.+-]{0,99}", re.UNICODE)
REVISION = re.compile(r"r\d{3,}")
REPORTS = ("report.html", "report.pdf", "report.txt")
"""Reports of a run, the best first."""
_TEXTS = ("procedure", "type", "effective_from", "software", "verdict", "sha256")
"""Keys of run.json that an entry holds as they are."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What a list shows of a run; `fault` states why a run cannot be read, and `stamp` is the time
    of change and size of run.json.
    """

    serial: str
    revision: str
    stamp: str
    procedure: str = ""
    type: str = ""
    effective_from: str = ""
    software: str = ""
    verdict: str = ""
    sha256: str = ""
    logs: int = 0
    failed: str = ""
    report: str = ""
    """Name of its report."""
    fault: str = ""


def cache_folder() -> Path:
    """Folder of the user's caches; one that cannot be where the user has no home."""
    environment_folder = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        home = Path.home()
    except RuntimeError:
        home = Path(os.devnull)
    home_cache = home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache"
    return (Path(environment_folder) if environment_folder else home_cache) / "calibkit"


def read_index(runs: Path, cache: Path | None = None) -> dict[str, list[Entry]]:
    """Serial → its runs, oldest revision first; UsageError where there is no such folder.

    What the cache holds of an unchanged run.json is not read again; a cache that is missing,
    damaged or cannot be written changes nothing but the time that it takes.
    """
    if not runs.is_dir():
        raise UsageError(f"--runs {runs}: no such folder", hint="give the folder of the runs")
    name = hashlib.sha256(str(runs.resolve()).encode()).hexdigest()[:16]
    file = (cache or cache_folder()) / f"runs-{name}.json"
    cached_entries, entries_by_serial = _kept(file), dict[str, list[Entry]]()
    for serial, revision, path, stamp in _runs(runs):
        cached_entry = cached_entries.get((serial, revision))
        if cached_entry is not None and cached_entry.stamp == stamp:
            entry = cached_entry
        else:
            entry = _read(serial, revision, path, stamp)
        entries_by_serial.setdefault(serial, []).append(entry)
    for entries in entries_by_serial.values():
        entries.sort(key=lambda entry: int(entry.revision[1:]))
    all_entries = {
        (entry.serial, entry.revision): entry
        for device_entries in entries_by_serial.values()
        for entry in device_entries
    }
    if all_entries != cached_entries:
        _keep(file, list(all_entries.values()))
    return dict(sorted(entries_by_serial.items()))


def _runs(runs: Path) -> Iterator[tuple[str, str, Path, str]]:
    """Serial, revision, run.json and its stamp; links lead elsewhere and are left out."""
    with os.scandir(runs) as folders:
        devices = [entry for entry in folders if _is_folder(entry, SERIAL)]
    for device in devices:
        with contextlib.suppress(OSError), os.scandir(device.path) as folders:
            for run in [entry for entry in folders if _is_folder(entry, REVISION)]:
                path = Path(run.path) / RUN_FILE
                with contextlib.suppress(OSError):
                    status = path.lstat()
                    yield device.name, run.name, path, f"{status.st_mtime_ns} {status.st_size}"


def _is_folder(entry: os.DirEntry[str], pattern: re.Pattern[str]) -> bool:
    """Whether an entry is a folder of such a name, and no link."""
    return pattern.fullmatch(entry.name) is not None and entry.is_dir(follow_symlinks=False)


def _read(serial: str, revision: str, path: Path, stamp: str) -> Entry:
    """Entry of a run.json as it states itself; its digest is checked where the run is opened."""
    try:
        if path.is_symlink():
            return Entry(serial, revision, stamp, fault="run.json is a link")
        from calibkit.records import store

        document = json.loads(store.read_bytes(path))
        if "verdict" not in document:  # an older format states less
            from calibkit.records import run_document

            document = run_document.loads(path.read_text(encoding="utf-8"), RUN_FILE)
        if document["serial"] != serial or f"r{document['revision']:03d}" != revision:
            fault = f"says {document['serial']} r{document['revision']}: moved or renamed"
            return Entry(serial, revision, stamp, fault=fault)
        texts = {key: str(document.get(key, "")) for key in _TEXTS}
        files = [entry["name"] for entry in document["files"]]
        failed = [
            str(criterion["name"])
            for criterion in document["acceptance"]
            if not criterion["passed"]
        ]
        return Entry(
            serial,
            revision,
            stamp,
            **texts,
            logs=len(document["inputs"]),
            failed=", ".join(failed),
            report=next((name for name in REPORTS if name in files), ""),
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError, CalibkitError) as error:
        return Entry(serial, revision, stamp, fault=f"run.json cannot be read: {error}"[:200])


def _kept(file: Path) -> dict[tuple[str, str], Entry]:
    """Entries of the cache; none where it is missing, damaged or of another version."""
    try:
        document = json.loads(file.read_bytes())
        entries = document["entries"] if document["version"] == VERSION else []
        cached_entries = [Entry(**_typed(entry)) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}
    return {(entry.serial, entry.revision): entry for entry in cached_entries}


def _typed(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of an entry, or TypeError where one is of another type."""
    for field in fields(Entry):
        if not isinstance(entry[field.name], int if field.name == "logs" else str):
            raise TypeError(field.name)
    return dict(entry)


def _keep(file: Path, entries: list[Entry]) -> None:
    """Write the cache at once, for this user alone; where that is not possible, nothing is kept."""
    document = {"version": VERSION, "entries": [asdict(entry) for entry in entries]}
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=".index-")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                json.dump(document, stream)
            Path(name).replace(file)
        except OSError:
            Path(name).unlink(missing_ok=True)
            raise
