"""The facts that stand at the top of every generated file, and the digest at its end."""

import hashlib
import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

from calibkit.errors import CoefficientError, visible
from calibkit.firmware import exact
from calibkit.firmware.export import SCHEMA, FirmwareRun
from calibkit.records.run_document import ACCEPTED

NUMBERS = {
    "f32": "IEEE 754 single precision",
    "f64": "IEEE 754 double precision",
}
WIDTH = 100
LICENCE = "SPDX-License-Identifier: MIT"
"""That of calibkit, for the code that it writes."""
CONTENT = "content digest (field sha256)"
"""A sealed file's digest of its other keys, which the file states itself; that of its bytes is
another.
"""
REJECTED = "REJECTED"
VERDICTS = {
    "rejected": f"{REJECTED}      this run failed its acceptance limits: not for use in a product",
    "no verdict": "no verdict    the recipe of this run sets no acceptance limits",
    "accepted": "accepted      this run met its acceptance limits",
}
"""Verdict → what every export states of it."""
MARKS = {"rejected": f", {REJECTED}", "no verdict": ", no verdict", "accepted": ""}
"""Verdict → what verify appends."""
PLAIN = re.compile(r"[A-Za-z0-9_.+ -]")
"""Characters that mean themselves in a C string, beside any other."""
LOADER = "loader of blobs"
"""What the first line of a loader states; it has no numbers of its own."""
DEVICE = re.compile(r"^ \* device +(.*), effective", re.MULTILINE)
EXPORT = re.compile(r"^ \* (?:device|coefficients|run|number) .*", re.MULTILINE)
"""Facts that a header and a source of one export share."""
SEALED = re.compile(r"(?:/\*|#) sha256 of all lines above: ([0-9a-f]{64})(?: \*/)?\n\Z")


def list_facts(export: FirmwareRun, *, bounds: bool = True) -> list[str]:
    """What a reader must know, one fact per line: device, form, digests, number format, formula,
    ranges, and unless left out the error bounds.
    """
    identity, structure = export.identity, export.structure
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
    if structure.has_memory:
        lines.append(f"interval      update every {structure.interval_s:g} s, with means over it")
        lines += export.chain.timing
    lines.insert(0, VERDICTS[identity.verdict])
    return [ascii_only(line) for line in (*lines, *(_bounds(export) if bounds else []))]


def _bounds(export: FirmwareRun) -> list[str]:
    """Worst-case evaluation error of each output, one per line."""
    per_update = " for each update" if export.structure.summing else ""
    lines = []
    for output in export.structure.outputs:
        unit = "" if output.unit == "1" else f" {output.unit}"
        bound, full = (
            exact.round_to(output_bounds[output.name], 2, up=True)
            for output_bounds in (export.bounds, export.full_bounds)
        )
        line = f"error bound   {output.name}: {bound:.1e}{unit}{per_update}"
        if any(entry.beyond for entry in export.structure.inputs):
            line += f"; up to the full scale {full:.1e}{unit}"
        lines.append(line)
    case = "evaluation against the exact chain, over all inputs in range"
    if export.chain.condition:
        case = f"evaluation, while {export.chain.condition}"
    return [*lines, f"              (worst case of {case})"]


def verdict_mark(lines: Iterable[str]) -> str:
    """What verify appends for a file whose facts, one per line, state the verdict on its run."""
    facts = set(lines)
    return next((mark for verdict, mark in MARKS.items() if VERDICTS[verdict] in facts), "")


def list_verdicts(accepted: Mapping[str, bool | None]) -> str:
    """What verify appends for a file of several devices (serial → accepted, None: no verdict)."""
    text = ""
    for verdict, mark in MARKS.items():
        serials = [serial for serial, value in accepted.items() if value is ACCEPTED[verdict]]
        if mark and serials:
            text += f"{mark}: {', '.join(serials)}"
    return text


def ascii_only(text: str) -> str:
    """Text that every compiler reads, in one line."""
    return visible(text).encode("ascii", "backslashreplace").decode()


def string(text: str) -> str:
    """C string that holds a text's bytes in UTF-8, whatever they are: all but plain characters of
    serials as octal escapes, which end after three digits.
    """
    escaped = (
        chr(byte) if PLAIN.fullmatch(chr(byte)) else f"\\{byte:03o}" for byte in text.encode()
    )
    return f'"{"".join(escaped)}"'


def within_comment(text: str) -> str:
    """Text that neither ends a comment nor begins another."""
    return ascii_only(text).replace("*/", "* /").replace("/*", "/ *")


def comment(lines: Iterable[str]) -> str:
    """Block comment, long lines broken; nothing in them ends it or begins another."""
    broken = []
    for line in map(within_comment, lines):
        broken += textwrap.wrap(
            line, WIDTH, subsequent_indent=" " * 14, break_on_hyphens=False
        ) or [""]
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in broken), " */"]) + "\n"


def seal(text: str, *, comment: str = "/* {} */") -> str:
    """Text with its digest as its last line, a comment."""
    digest = hashlib.sha256(text.encode()).hexdigest()
    return f"{text}{comment.format(f'sha256 of all lines above: {digest}')}\n"


def unseal(content: bytes, name: str) -> str:
    """Text of a generated file without its digest; CoefficientError where it is not ASCII or the
    digest is not its own. Line ends that an editor or git changed are not accepted.
    """
    try:
        text = content.decode("ascii")
    except UnicodeDecodeError:
        raise CoefficientError(
            f"{name}: not a text that calibkit wrote", hint="verify takes calibkit's own files"
        ) from None
    seal_line = SEALED.search(text)
    if seal_line is None:
        raise CoefficientError(
            f"{name}: no digest in its last line", hint="it is not an export, or its end is missing"
        )
    body = text[: seal_line.start()]
    if hashlib.sha256(body.encode()).hexdigest() != seal_line.group(1):
        raise CoefficientError(
            f"{name}: its digest is not that of its content", hint="it was changed after the export"
        )
    return body


def verify(name: str, content: bytes) -> str:
    """Check the digest of a header or source; returns what it is. Its numbers are proven by the
    self-test that it holds.
    """
    text, kind = unseal(content, name), "header" if name.endswith(".h") else "source"
    if LOADER in text[:200]:
        return f"C {kind} of a {LOADER}"
    device = DEVICE.search(text)
    if device is None:
        raise CoefficientError(
            f"{name}: not a file that calibkit wrote", hint="verify takes calibkit's own files"
        )
    facts = text.partition("*/")[0].splitlines()
    return (
        f"C {kind} of {device.group(1)}{verdict_mark(fact.removeprefix(' * ') for fact in facts)}"
    )


def require_same_export(source: Path, header: Path) -> None:
    """CoefficientError where a header is not of the export that a source is of."""
    of_source, of_header = (
        EXPORT.findall(path.read_text(encoding="ascii", errors="replace").partition("*/")[0])
        for path in (source, header)
    )
    if of_source != of_header:
        raise CoefficientError(
            f"{source}: {header.name} beside it is of another export",
            hint="export both again, and keep them together",
        )
