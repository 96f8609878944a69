"""Targets of `calibkit export`: what each writes, and how a written file is verified again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.errors import UsageError
from calibkit.firmware import c_header, c_reader, c_source

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


TARGETS: Mapping[str, Target] = {
    "c": Target(("f32", "f64", "q31", "q15"), _c),
}

READERS: Mapping[str, Callable[[str, bytes], str]] = {
    ".c": c_reader.verify_source,
    ".h": c_reader.verify_header,
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
