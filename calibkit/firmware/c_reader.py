"""A generated C source read again: its digest, its numbers and its steps; its vectors are computed
again.
"""

import re
from fractions import Fraction

from calibkit.errors import CoefficientError
from calibkit.firmware import c_text, layout, vectors
from calibkit.firmware.formats import Format
from calibkit.firmware.program import Program

CONSTANT = re.compile(r"static const \w+ (\w+)(?:\[\w+\])? = ([^;]*);")
NUMBER = re.compile(r"(?<![\w.])-?(?:0x[0-9a-f]+|\d+(?:\.\d*)?(?:e[-+]?\d+)?)(?=[UF]?\b)")
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
LINE = re.compile(r"^ \* (\{.*\})$", re.MULTILINE)
DEVICE = re.compile(r"^ \* device +(.*), effective", re.MULTILINE)
LOADER = "loader of blobs"
"""What the first line of a loader states; it has no numbers of its own."""
INCLUDE = re.compile(r'^#include "(\w+)\.h"$', re.MULTILINE)


def verify_header(name: str, content: bytes) -> str:
    """Check a header's digest; returns what it is."""
    text = c_text.unseal(content, name)
    if LOADER in text[:200]:
        return "C header of a loader of blobs"
    return f"C header of {_search(DEVICE, text, name)}{_mark(text)}"


def verify_source(name: str, content: bytes) -> str:
    """Check a source's digest and recompute its vectors from its own numbers; returns what it
    is.
    """
    text = c_text.unseal(content, name)
    if LOADER in text[:200]:
        return "C source of a loader of blobs"
    program, file_vectors = _read(text, name)
    vectors.require_recomputed(program, file_vectors, name, source="coefficients")
    count, number = len(file_vectors.status), program.format.name
    return (
        f"C source of {_search(DEVICE, text, name)}, {number}, {count} vectors"
        f" recomputed{_mark(text)}"
    )


def _read(text: str, name: str) -> tuple[Program, vectors.Vectors]:
    """Program and vectors of a source's text, every number as the compiler reads it."""
    prefix, lines = _search(INCLUDE, text, name), LINE.findall(text)
    bare = layout.read_program(lines, {}, name)
    tables = {}
    for constant in CONSTANT.finditer(COMMENT.sub("", text)):
        table = constant.group(1).removeprefix(f"{prefix}_")
        numbers = tuple(
            _number(digits, bare.format) for digits in NUMBER.findall(constant.group(2))
        )
        tables[table] = numbers
    try:
        inputs, outputs, status = (tables.pop(f"test_{side}") for side in ("in", "out", "status"))
        updates = tables.pop("test_updates", (1,) * len(status))
        elapsed = tables.pop("test_elapsed", ())
    except KeyError as error:
        raise CoefficientError(f"{name}: no table {error}", hint="export it again") from None
    file_vectors = vectors.Vectors(
        _columns([entry.name for entry in bare.structure.inputs], inputs),
        tuple(map(int, updates)),
        _columns([output.name for output in bare.structure.outputs], outputs),
        tuple(map(int, status)),
        tuple(map(int, elapsed)),
    )
    return layout.read_program(lines, tables, name), file_vectors


def _mark(text: str) -> str:
    """Verdict on the run, by the facts in the comment at the top."""
    return c_text.verdict_mark(
        line.removeprefix(" * ") for line in text.partition("*/")[0].splitlines()
    )


def _number(digits: str, number: Format) -> float:
    """Number of a literal in the format of the program."""
    if digits.startswith("0x"):
        return int(digits, 16)
    return number.nearest(Fraction(digits))


def _columns(names: list[str], flat: tuple[float, ...]) -> dict[str, tuple[float, ...]]:
    """Columns of a table of structs."""
    return {name: flat[k :: len(names)] for k, name in enumerate(names)}


def _search(pattern: re.Pattern[str], text: str, name: str) -> str:
    """First group of a pattern, or CoefficientError."""
    match = pattern.search(text)
    if match is None:
        raise CoefficientError(
            f"{name}: not a source that calibkit wrote", hint="verify takes calibkit's own files"
        )
    return match.group(1)
