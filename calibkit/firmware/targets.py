"""Targets of `calibkit export`: what each writes, and how a written file is verified again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.errors import UsageError
from calibkit.firmware import blob, c_header, c_loader, c_reader, c_source

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from calibkit.firmware.export import Export


@dataclass(frozen=True, slots=True)
class Target:
    """A kind of export: its number formats and the files that it makes of one run."""

    numbers: tuple[str, ...]
    render: Callable[[Export], dict[str, bytes]]


def _c(export: Export) -> dict[str, bytes]:
    """C99 header and source."""
    return {
        f"{export.prefix}.h": c_header.render(export).encode("ascii"),
        f"{export.prefix}.c": c_source.render(export).encode("ascii"),
    }


def _blob(export: Export) -> dict[str, bytes]:
    """Numbers of one unit, and the C99 that takes them."""
    return {
        f"{export.prefix}.bin": blob.render(export),
        f"{export.prefix}.h": c_loader.header(export),
        f"{export.prefix}.c": c_loader.source(export),
    }


FLOATS = ("f32", "f64")

TARGETS: Mapping[str, Target] = {
    "c": Target((*FLOATS, "q31", "q15"), _c),
    "blob": Target(FLOATS, _blob),
}

READERS: Mapping[str, Callable[[str, bytes], str]] = {
    ".c": c_reader.verify_source,
    ".h": c_reader.verify_header,
    ".bin": blob.verify,
}
"""Suffix → function that checks a file's content and says what it is, or raises CoefficientError."""


def of(name: str, number: str) -> Target:
    """Target of that name, or UsageError where there is none or it has no such number format."""
    if name not in TARGETS:
        raise UsageError(f"--target {name}: no such target", hint=f"the targets are {', '.join(TARGETS)}")
    target = TARGETS[name]
    if number not in target.numbers:
        raise UsageError(
            f"--target {name} with --number {number}", hint=f"its number formats are {', '.join(target.numbers)}"
        )
    return target
