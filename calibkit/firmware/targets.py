"""Targets of `calibkit export`: what each writes of one run or of several, and how a written file
is verified again.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibkit.errors import CoefficientError, OutputError, UsageError
from calibkit.firmware import (
    blob,
    c_code,
    facts,
    flash,
    parameters,
    table,
)
from calibkit.firmware.export import FirmwareRun
from calibkit.records import run_document, sealed, store
from calibkit.records.run_document import ACCEPTED

MANIFEST = "calibkit-manifest/2"
FLOATS = ("f32", "f64")


@dataclass(frozen=True, slots=True)
class _Target:
    """A kind of export: its number formats, the files of one device, the files of all devices."""

    numbers: tuple[str, ...]
    device_files: Callable[[FirmwareRun, int], dict[str, bytes]]
    """Export and address → ending of a file's name and its content."""
    shared: Callable[[Sequence[FirmwareRun]], dict[str, bytes]]
    """Exports → name of a file and its content."""
    takes_several: bool = True
    placed: bool = False
    """Whether its records state where in memory they go."""


def _none(*_: object) -> dict[str, bytes]:
    """No files."""
    return {}


def _loader(exports: Sequence[FirmwareRun]) -> dict[str, bytes]:
    """The C99 that takes every device's numbers; OutputError where they need different ones."""
    first = exports[0]
    for other in exports[1:]:
        if blob.shape(other.program).digest != blob.shape(first.program).digest:
            raise OutputError(
                f"{other.identity.serial} and {first.identity.serial} need different loaders: their"
                " models differ in form or degree",
                hint="pin models and orders in the recipe, or export them apart",
            )
    return {
        f"{first.prefix}.h": c_code.loader_header(first),
        f"{first.prefix}.c": c_code.loader_source(first),
    }


TARGETS: Mapping[str, _Target] = {
    "c": _Target(
        FLOATS,
        lambda export, _: {
            ".h": c_code.header(export),
            ".c": c_code.source(export),
        },
        _none,
        takes_several=False,
    ),
    "blob": _Target(FLOATS, lambda export, _: {".bin": blob.render(export)}, _loader),
    "hex": _Target(
        FLOATS,
        lambda export, address: {".hex": flash.place(blob.render(export), address)},
        _loader,
        placed=True,
    ),
    "px4": _Target(
        ("f32",), lambda export, _: {".params": parameters.render(export, parameters.PX4)}, _none
    ),
    "ardupilot": _Target(
        ("f32",),
        lambda export, _: {".param": parameters.render(export, parameters.ARDUPILOT)},
        _none,
    ),
    "csv": _Target(
        FLOATS,
        _none,
        lambda exports: {f"{exports[0].prefix}.csv": table.render(exports)},
    ),
}

READERS: Mapping[str, Callable[[str, bytes], str]] = {
    ".c": facts.verify,
    ".h": facts.verify,
    ".bin": blob.verify,
    ".hex": flash.verify,
    ".csv": table.verify,
    ".params": parameters.verify,
    ".param": parameters.verify,
}
"""Suffix → function that checks a file's content and returns what it is, or raises
CoefficientError.
"""


def find_target(name: str, number: str, address: int | None) -> _Target:
    """Target of that name, or UsageError where there is none, it has no such number format, or an
    address is missing or needless.
    """
    if name not in TARGETS:
        raise UsageError(
            f"--target {name}: no such target", hint=f"the targets are {', '.join(TARGETS)}"
        )
    target = TARGETS[name]
    if number not in target.numbers:
        raise UsageError(
            f"--target {name} with --number {number}",
            hint=f"its number formats are {', '.join(target.numbers)}",
        )
    if target.placed and address is None:
        raise UsageError(
            f"--target {name} without --address",
            hint="say where in memory the blob goes, for example --address 0x08040000",
        )
    if address is not None and not target.placed:
        raise UsageError(
            f"--target {name} with --address", hint="only hex states an address: leave it out"
        )
    return target


def require_layout(exports: Sequence[FirmwareRun], pinned: FirmwareRun) -> None:
    """OutputError for a run whose steps or tables are not those of another run."""
    shape, forms = blob.shape(pinned.program), ", ".join(pinned.structure.forms)
    for export in exports:
        if blob.shape(export.program) != shape:
            raise OutputError(
                f"{export.identity.serial} ({', '.join(export.structure.forms)}) is not laid out as"
                f" {pinned.identity.serial} revision {pinned.identity.revision} ({forms})",
                hint="fit it with the model of that run, or export a loader of its own",
            )


def files(target: _Target, exports: Sequence[FirmwareRun], address: int) -> dict[str, bytes]:
    """Files of one run, or of several with a manifest; OutputError for runs that one set of files
    cannot hold.
    """
    if len(exports) > 1 and not target.takes_several:
        raise OutputError(
            f"{len(exports)} runs: this target takes one",
            hint="export them one by one, or as a blob",
        )
    serials = [export.identity.serial for export in exports]
    if twice := next((serial for serial in serials if serials.count(serial) > 1), None):
        raise OutputError(
            f"{twice} stands twice among the runs", hint="name one revision of each device"
        )
    prefix, shared = exports[0].prefix, target.shared(exports)
    stems = [prefix] if len(exports) == 1 else [f"{prefix}_{serial}" for serial in serials]
    device_files = [
        {
            f"{stem}{ending}": content
            for ending, content in target.device_files(export, address).items()
        }
        for stem, export in zip(stems, exports, strict=True)
    ]
    files = shared | {name: content for part in device_files for name, content in part.items()}
    if len(exports) > 1:
        files[f"{prefix}_manifest.json"] = _manifest(exports, device_files, shared)
    return files


def _manifest(
    exports: Sequence[FirmwareRun],
    device_files: Sequence[Mapping[str, bytes]],
    shared: Mapping[str, bytes],
) -> bytes:
    """What was delivered: every device with its run and its files, every file with its digest."""
    document: dict[str, Any] = {
        "format": MANIFEST,
        "software": exports[0].identity.software,
        "files": store.list_files(shared),
        "units": [
            {
                "serial": export.identity.serial,
                "revision": export.identity.revision,
                "effective_from": export.identity.effective_from,
                "run_sha256": export.identity.run_sha256,
                "verdict": export.identity.verdict,
                "accepted": ACCEPTED[export.identity.verdict],
                "files": store.list_files(files),
            }
            for export, files in zip(exports, device_files, strict=True)
        ],
    }
    return sealed.seal(document).encode()


def verify_manifest(path: Path) -> str:
    """Check a manifest and the digest of every file that it lists beside it; returns what it is."""
    document = sealed.unseal(store.read_utf8(path), str(path), MANIFEST)
    manifest = sealed.read_as(run_document.Manifest, document, str(path), "a manifest")
    entries = [*manifest.files, *(entry for unit in manifest.units for entry in unit.files)]
    for entry in entries:
        file = path.parent / entry.name
        if hashlib.sha256(store.read_bytes(file)).hexdigest() != entry.sha256:
            raise CoefficientError(
                f"{file}: not the file that the manifest lists", hint="export it again"
            )
    mark = facts.list_verdicts({unit.serial: unit.accepted for unit in manifest.units})
    return f"manifest of {len(manifest.units)} devices, {len(entries)} files{mark}"
