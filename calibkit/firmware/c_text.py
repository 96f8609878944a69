"""The facts that stand at the top of every generated file, and the digest at its end."""

from __future__ import annotations

import hashlib
import re
import textwrap
from typing import TYPE_CHECKING

from calibkit.errors import CoefficientError
from calibkit.firmware.export import SCHEMA

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibkit.firmware.export import Export

NUMBERS = {
    "f32": "IEEE 754 single precision",
    "f64": "IEEE 754 double precision",
    "q31": "fixed point in words of 32 bits",
    "q15": "fixed point in words of 16 bits",
}
WIDTH = 100
CONTENT = "content digest (field sha256)"
"""A sealed file's digest of its other keys, which the file states itself; that of its bytes is
another.
"""
REJECTED = "REJECTED"
DIGEST = re.compile(r"/\* sha256 of all lines above: ([0-9a-f]{64}) \*/\n\Z")


def facts(export: Export) -> list[str]:
    """What a reader must know, one fact a line: device, form, digests, number format, formula,
    ranges, bounds.
    """
    identity, structure = export.identity, export.chain.structure
    number = export.program.format.name
    lines = [
        (
            f"device        {identity.serial} revision {identity.revision}, effective from"
            f" {identity.effective_from}"
        ),
        f"forms         {', '.join(structure.forms)}",
        *(f"coefficients  {name} {CONTENT} {digest}" for name, digest in identity.files.items()),
        f"run           run.json {CONTENT} {identity.run_sha256}",
        f"schema        {SCHEMA}, made by {identity.software}",
        f"number        {number}: {NUMBERS[number]}",
        f"formula       {structure.formula}",
        *export.sources,
        *(f"fitted over   {text}" for text in export.chain.ranges),
    ]
    if structure.interval_s is not None:
        lines.append(f"interval      update every {structure.interval_s:g} s, with means over it")
    if not identity.accepted:
        lines.insert(
            0, f"{REJECTED}      this run failed its acceptance limits: not for use in a product"
        )
    return [ascii_only(line) for line in lines + _bounds(export)]


def _bounds(export: Export) -> list[str]:
    """Worst-case evaluation error of each output."""
    lines = []
    for output in export.chain.structure.outputs:
        bound = f"{export.bounds[output.name]:.1e}"
        unit = "" if output.unit == "1" else f" {output.unit}"
        lines.append(f"error bound   {output.name}: {bound}{unit}{_each(export)}")
    if export.chain.condition:
        lines.append(f"              (worst case of evaluation, while {export.chain.condition})")
    else:
        lines.append(
            "              (worst case of evaluation against the exact chain, over all inputs in"
            " range)"
        )
    return lines


def _each(export: Export) -> str:
    """What the bound of a sum is per."""
    return " for each update" if export.chain.structure.summing else ""


def mark(lines: Iterable[str]) -> str:
    """What verify appends for a file whose facts, one a line, say that its run was rejected."""
    return f", {REJECTED}" if any(line.startswith(f"{REJECTED} ") for line in lines) else ""


def ascii_only(text: str) -> str:
    """Text that every compiler reads."""
    return text.encode("ascii", "backslashreplace").decode()


def comment(lines: Iterable[str]) -> str:
    """Block comment, long lines broken."""
    broken = []
    for line in lines:
        broken += textwrap.wrap(
            line, WIDTH, subsequent_indent=" " * 14, break_on_hyphens=False
        ) or [""]
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in broken), " */"]) + "\n"


def sealed(text: str) -> str:
    """Text with its digest as its last line."""
    return f"{text}/* sha256 of all lines above: {hashlib.sha256(text.encode()).hexdigest()} */\n"


def unsealed(text: str, name: str) -> str:
    """Text without its digest, or CoefficientError where that is not its own."""
    found = DIGEST.search(text)
    if found is None:
        raise CoefficientError(
            f"{name}: no digest in its last line", hint="it is not an export, or its end is missing"
        )
    body = text[: found.start()]
    if hashlib.sha256(body.encode()).hexdigest() != found.group(1):
        raise CoefficientError(
            f"{name}: its digest is not that of its content", hint="it was changed after the export"
        )
    return body


def named(text: str, prefix: str) -> str:
    """Template with its prefix: @p and @P in lower and upper case."""
    return text.replace("@p_", f"{prefix}_").replace("@P_", f"{prefix.upper()}_")
