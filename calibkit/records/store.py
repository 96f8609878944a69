"""Run folders: written once and whole, found again by serial and revision, checked against their
digests.
"""

import contextlib
import errno
import hashlib
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibkit.errors import CoefficientError, OutputError, UsageError
from calibkit.records import atomic, coefficients, names, run_document, sealed
from calibkit.records.clock import date_or_today
from calibkit.records.new_files import RUN_FILE, output_errors, refuse_run_folder

FLEET_FORMAT = "calibkit-fleet/2"
FLEET_FILE = "fleet.json"
FLEETS = "_fleet"
"""Folder of the tables of fleets, beside the serials' folders; no serial begins like it."""
LARGEST_BYTES = 500_000_000
"""Largest file of calibkit's own that is read back: the largest report of the samples is a
hundredth of it.
"""
_HIGHEST = ".highest-"
"""Beginning of the name of an empty file that states the highest revision ever given."""
_REVISION = re.compile(r"r(\d{3}|[1-9]\d{3,})")
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
_TAKEN = (errno.EEXIST, errno.ENOTEMPTY)
"""Errors of a rename onto a folder that is there."""
_SCANNER_PAUSES_S = (0.05, 0.1, 0.2, 0.4)
"""Pauses before a rename is tried again: on Windows a virus scanner may hold a file that was just
written.
"""


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run folder that was read whole and whose digests are right."""

    folder: Path
    document: Mapping[str, Any]
    records: Mapping[str, coefficients.Record]

    @property
    def name(self) -> str:
        """SERIAL@rNNN."""
        return f"{self.document['serial']}@r{self.document['revision']:03d}"

    def identity(self) -> dict[str, Any]:
        """What identifies the run in a JSON document."""
        facts = ("serial", "revision", "procedure", "effective_from", "verdict", "accepted")
        return {
            "name": self.name,
            **{key: self.document[key] for key in (*facts, "software", "sha256")},
        }

    def content(self, name: str) -> bytes:
        """Content of one of the run's files."""
        return read_bytes(self.folder / name)

    def stage_digests(self) -> dict[str, str]:
        """Stage → digest that its coefficient file states of itself."""
        return {
            record.stage: str(
                sealed.unseal(self.content(name).decode(), name, coefficients.FORMAT)["sha256"]
            )
            for name, record in self.records.items()
        }


def check_serial(serial: str) -> str:
    """Return a serial that can name a folder on every system, or raise UsageError."""
    if not serial:
        raise UsageError("no serial number", hint='give --serial, or serial = "…" in the recipe')
    if names.is_serial(serial):
        return serial
    fault = "" if names.is_device(serial) else names.find_fault(serial, words=False)
    if fault and names.looks_plain(serial):
        raise UsageError(
            f"serial '{serial}' {fault}",
            hint="type it anew in one alphabet: letters that look alike would be two devices",
        )
    raise UsageError(
        f"serial '{serial}' cannot name a folder",
        hint="use letters, digits, '-', '_', '+' and '.', starting with a letter or digit",
    )


def revisions(serial_folder: Path) -> list[int]:
    """Revision numbers that a serial's folder holds, ascending."""
    if not serial_folder.is_dir():
        return []
    matches = (_REVISION.fullmatch(path.name) for path in _entries(serial_folder) if path.is_dir())
    return sorted(int(match.group(1)) for match in matches if match)


def _entries(folder: Path) -> list[Path]:
    """Entries of a folder, or CoefficientError."""
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise CoefficientError(
            f"{folder}: cannot be read: {error.strerror}", hint="check the permissions"
        ) from None


def save(
    out: Path, serial: str, revision: int, files: Mapping[str, bytes], *, dry_run: bool = False
) -> Path | None:
    """Write a run folder whole: a temporary folder, every file synced, then one rename, which fails
    where another process has just taken the name: then nothing is written, and None is returned. A
    dry run only names the folder.
    """
    target = _folder(out, serial, revision)
    refuse_run_folder(target)
    if dry_run:
        return target
    with output_errors(target.parent, "give another --out"):
        atomic.make_folder(target.parent)
        # in the same folder: only within one file system is a rename one step
        temporary = Path(tempfile.mkdtemp(prefix=atomic.UNFINISHED, dir=target.parent))
    try:
        atomic.remove_abandoned(temporary)
        with output_errors(target, "free space or give another --out"):
            # mkdtemp makes folders that only their owner can read
            temporary.chmod(0o755)
            for name, content in files.items():
                atomic.write_synced(temporary / name, content)
            atomic.sync_folder(temporary)
            try:
                _rename_folder(temporary, target)
            except OSError as error:
                # the other fit was first: the number is its own, and this run is sealed anew with
                # the next
                if error.errno in _TAKEN:
                    return None
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    # the number is not given again once the folder is deleted: a mark is made and the one before
    # removed, each in one step. The run is there already: a full disk costs this protection only
    with contextlib.suppress(OSError):
        (target.parent / f"{_HIGHEST}r{revision:03d}").touch()
        for number, path in _highest_marks(target.parent).items():
            if number < revision:
                path.unlink()
    # the entry of the renamed folder is on the disk only after that
    atomic.sync_folder(target.parent)
    return target


def _highest_marks(serial_folder: Path) -> dict[int, Path]:
    """Revision → file that states it as the highest ever given; stores of 0.2 have none."""
    marks = {}
    for path in serial_folder.glob(f"{_HIGHEST}*"):
        match = _REVISION.fullmatch(path.name.removeprefix(_HIGHEST))
        if match:
            marks[int(match.group(1))] = path
    return marks


def _rename_folder(temporary: Path, target: Path) -> None:
    """Rename a folder to a name that nothing has; raises OSError. A scanner that holds it is waited
    for.
    """
    for pause in _SCANNER_PAUSES_S:
        try:
            temporary.rename(target)
        except PermissionError:
            time.sleep(pause)
        else:
            return
    temporary.rename(target)


def find(name: str, runs: Path) -> Path:
    """Folder of RUN under runs; UsageError when there is none, CoefficientError for a run that is
    another's.

    RUN is a run folder, SERIAL (its newest revision), SERIAL@r003, or SERIAL@2026-05-01 (the one in
    force on that date).
    """
    serial, _, selector = name.partition("@")
    with contextlib.suppress(OSError):
        if (Path(name) / RUN_FILE).is_file():
            return Path(name)
    numbers = revisions(runs / serial) if names.is_serial(serial) else []
    if not numbers:
        raise UsageError(
            f"run '{name}' is neither a run folder nor a serial under {runs}",
            hint="give --runs, or the folder that holds run.json",
        )
    if _DATE.fullmatch(selector):
        return _in_force_on(runs, serial, numbers, date_or_today(selector, f"run '{name}':"))
    match = _REVISION.fullmatch(selector or f"r{numbers[-1]:03d}")
    if not match or int(match.group(1)) not in numbers:
        raise UsageError(
            f"run '{name}': {serial} has no {selector}",
            hint=f"revisions there: {', '.join(f'r{number:03d}' for number in numbers)}",
        )
    own_document(runs, serial, int(match.group(1)))
    return _folder(runs, serial, int(match.group(1)))


def _folder(runs: Path, serial: str, revision: int) -> Path:
    """Folder of a revision."""
    return runs / serial / f"r{revision:03d}"


def _in_force_on(runs: Path, serial: str, numbers: Sequence[int], date: str) -> Path:
    """Folder of the revision in force on a date; UsageError where none is."""
    winners = in_force([own_document(runs, serial, number) for number in numbers])
    dates = [since for since in winners if since <= date]
    if not dates:
        raise UsageError(
            f"{serial} has no run in force on {date}",
            hint=f"the first is from {min(winners)}" if winners else "every run was rejected",
        )
    return _folder(runs, serial, winners[max(dates)])


def in_force(documents: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Effective date → revision that holds from then on: of one date the newest, never a rejected
    one.
    """
    return {
        document["effective_from"]: document["revision"]
        for document in sorted(documents, key=lambda document: int(document["revision"]))
        if document["verdict"] != "rejected"
    }


def own_document(runs: Path, serial: str, revision: int) -> dict[str, Any]:
    """run.json of a revision that is found by serial; CoefficientError where it is the run of
    another.
    """
    path = _folder(runs, serial, revision) / RUN_FILE
    document = run_document.loads(read_utf8(path), f"{path}")
    if (document.get("serial"), document.get("revision")) != (serial, revision):
        raise CoefficientError(
            f"{path}: says {document.get('serial')} r{document.get('revision')}, expected {serial}"
            f" r{revision:03d}",
            hint="the folder was moved or renamed; do not use it as a run of this serial",
        )
    return document


def load_revision(runs: Path, serial: str, revision: int) -> StoredRun:
    """Read a revision of a serial whole, or raise CoefficientError."""
    own_document(runs, serial, revision)
    return load(_folder(runs, serial, revision))


def load(folder: Path) -> StoredRun:
    """Read a run folder whole, or raise CoefficientError that names the first file that cannot be
    trusted.
    """
    document = run_document.loads(read_utf8(folder / RUN_FILE), f"{folder / RUN_FILE}")
    records = {
        path.name: own_record(document, path.name, read_utf8(path), str(path))
        for path in _listed(folder, document, RUN_FILE)
        if path.suffix == ".json"
    }
    return StoredRun(folder, document, records)


def flag_rejected(run: StoredRun) -> tuple[str, ...]:
    """Flag on what a rejected run gives; none for any other."""
    if run.document["verdict"] != "rejected":
        return ()
    failed = [entry["name"] for entry in run.document["acceptance"] if not entry["passed"]]
    return (f"{run.name} was rejected: {', '.join(failed)}",)


def load_fleet(folder: Path) -> Mapping[str, Any]:
    """Read the record of a fleet whose files are whole and as it lists them, or raise
    CoefficientError.
    """
    name = f"{folder / FLEET_FILE}"
    document = sealed.unseal(read_utf8(folder / FLEET_FILE), name, FLEET_FORMAT)
    sealed.read_as(run_document.FleetFacts, document, name, "a fleet's record")
    _listed(folder, document, FLEET_FILE)
    return document


def list_files(files: Mapping[str, bytes]) -> list[dict[str, str]]:
    """Files with their digests, in order of their names, as run.json, fleet.json and the manifest
    of an export list them.
    """
    return [
        {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in sorted(files.items())
    ]


def _listed(folder: Path, document: Mapping[str, Any], listing: str) -> list[Path]:
    """Paths of the files that a folder's record lists; CoefficientError unless each is there as
    listed, and no other.
    """
    paths = []
    for entry in document["files"]:
        path = folder / entry["name"]
        if hashlib.sha256(read_bytes(path)).hexdigest() != entry["sha256"]:
            raise CoefficientError(
                f"{path}: not the file that {listing} lists",
                hint="the file was changed; do not use it",
            )
        paths.append(path)
    extra = sorted(
        {path.name for path in _entries(folder)} - {listing, *(path.name for path in paths)}
    )
    if extra:
        raise CoefficientError(
            f"{folder}: holds files that {listing} does not list: {', '.join(extra)}",
            hint="move them out",
        )
    return paths


def own_record(
    document: Mapping[str, Any], name: str, text: str, place: str
) -> coefficients.Record:
    """Coefficient record of a run's file, which messages call by its place; CoefficientError where
    it is of another unit, revision or date.
    """
    record = coefficients.loads(text, place)
    expected = {key: document[key] for key in ("serial", "revision", "effective_from")}
    for key, value in ({"stage": name.removesuffix(".json")} | expected).items():
        if getattr(record, key) != value:
            source = "the file's name" if key == "stage" else RUN_FILE
            raise CoefficientError(
                f"{place}: {key} '{getattr(record, key)}', but {source} says '{value}'",
                hint="the file is of another run; do not use it",
            )
    return record


def read_bytes(path: Path) -> bytes:
    """Content of a file that calibkit may have written, or CoefficientError: what never ends, or
    is larger than anything that it writes, is not opened.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise CoefficientError(
                f"{path}: a folder, a pipe or a device, expected a file",
                hint="calibkit did not write it; do not use it",
            )
        if status.st_size > LARGEST_BYTES:
            raise CoefficientError(
                f"{path}: {status.st_size / 1e6:.0f} MB, at most {LARGEST_BYTES / 1e6:g} MB are"
                " read",
                hint="calibkit did not write it; do not use it",
            )
        return path.read_bytes()
    except OSError as error:
        raise CoefficientError(
            f"{path}: cannot be read: {error.strerror}",
            hint="name or restore what calibkit wrote",
        ) from None


def read_utf8(path: Path) -> str:
    """Text of a file that calibkit wrote, or CoefficientError."""
    return decode(read_bytes(path), str(path))


def decode(content: bytes, name: str) -> str:
    """Text of the bytes of a file that calibkit wrote, or CoefficientError."""
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise CoefficientError(
            f"{name}: not a text that calibkit wrote", hint="restore the file as it was written"
        ) from None


def next_revisions(out: Path, serial: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Number of the next revision of a serial, and the digests of the coefficient files that it
    supersedes, by stage; anew each time, until a fit has saved its run: another process may have
    taken the number meanwhile.
    """
    refuse_run_folder(out / serial)
    if (out / serial).is_symlink():
        raise OutputError(
            f"{out / serial}: a link, expected a folder: the run would lie outside of {out}",
            hint="give the folder that it leads to as --out, or put it in the link's place",
        )
    while True:
        number = next_number(out, serial)
        newest = max((n for n in revisions(out / serial) if n < number), default=0)
        before = load_revision(out, serial, newest).stage_digests() if newest else {}
        yield number, before


def next_number(out: Path, serial: str) -> int:
    """Number of the next revision of a serial: higher than any that was given, deleted ones
    included.
    """
    # marks first: a run is marked once it is there, so no run is left out between the two
    numbers = (0, *_highest_marks(out / serial), *revisions(out / serial))
    return max(numbers) + 1
