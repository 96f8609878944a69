"""One device's numbers as bytes: header, tables, self-test vectors, the facts in words, CRC-32; and
their reading.

Little-endian. Header of 112 bytes: magic "CALB", schema major and minor (u16), length of the whole
(u32), bits of a number (u16), flags (u16, bit 0: not rejected,
bit 1: no verdict), layout (8 bytes: which program the
numbers are for), revision (u32), serial (32 bytes of UTF-8, zeros behind), digest of run.json (32
bytes), effective date (10 characters and 2 zeros), numbers (u32), vectors (u32). Then the numbers
of every table in the order of the layout; a tolerance an output; the vectors, each inputs, outputs
and, as numbers, updates and status; the facts and the layout as text; CRC-32 (IEEE 802.3) of
everything before it.
"""

import hashlib
import itertools
import json
import struct
import zlib
from dataclasses import dataclass
from fractions import Fraction

from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import facts, layout, vectors
from calibkit.firmware.chain import Program, Structure
from calibkit.firmware.export import FirmwareRun

MAGIC, MAJOR, MINOR = b"CALB", 1, 2
HEADER = struct.Struct("<4sHHIHH8sI32s32s12sII")
SERIAL_BYTES = 32
FLAGS = {"rejected": 0, "accepted": 1, "no verdict": 3}
CODES = {32: "f", 64: "d"}
"""Bits of a number → its letter in `struct`."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What one loader takes: the tables in order with their lengths, and the digest that its blobs
    carry.
    """

    tables: tuple[tuple[str, int], ...]
    lines: tuple[str, ...]
    digest: bytes

    @property
    def numbers(self) -> int:
        """Numbers of all tables."""
        return sum(length for _, length in self.tables)


def shape(program: Program) -> Shape:
    """Shape of a program."""
    tables = tuple((name, len(program.tables[name])) for name in program.structure.tables)
    lines = (*layout.write_program(program), json.dumps({"tables": tables}, separators=(",", ":")))
    return Shape(tables, lines, hashlib.sha256("\n".join(lines).encode()).digest()[:8])


def updates_at(structure: Structure) -> int:
    """Place of the updates in a vector: behind inputs and outputs."""
    return len(structure.inputs) + len(structure.outputs)


def width(structure: Structure) -> int:
    """Numbers of a vector: inputs, outputs, updates, milliseconds where the chain keeps time,
    status.
    """
    return updates_at(structure) + (3 if structure.pace else 2)


def render(export: FirmwareRun) -> bytes:
    """Bytes of a run's blob."""
    program, identity, blob_shape = export.program, export.identity, shape(export.program)
    serial, rows = identity.serial.encode(), export.vectors
    if len(serial) > SERIAL_BYTES:
        raise OutputError(
            f"serial '{identity.serial}' has {len(serial)} bytes, a blob holds {SERIAL_BYTES}",
            hint="use --target c",
        )
    numbers = [x for name, _ in blob_shape.tables for x in program.tables[name]]
    tolerances = vectors.tolerances(export.chain, export.bounds, rows.updates)
    numbers += [
        program.format.nearest(Fraction(tolerances[output.name]))
        for output in program.structure.outputs
    ]
    for k, status in enumerate(rows.status):
        numbers += [rows.inputs[entry.name][k] for entry in program.structure.inputs]
        numbers += [rows.outputs[output.name][k] for output in program.structure.outputs]
        elapsed = [float(rows.elapsed_ms[k])] if rows.elapsed_ms else []
        numbers += [float(rows.updates[k]), *elapsed, float(status)]
    text = "\n".join([*facts.list_facts(export), "", *blob_shape.lines]) + "\n"
    size = program.format.size
    content = struct.pack(f"<{len(numbers)}{CODES[8 * size]}", *numbers) + text.encode("ascii")
    head = HEADER.pack(
        MAGIC,
        MAJOR,
        MINOR,
        HEADER.size + len(content) + 4,
        8 * size,
        FLAGS[identity.verdict],
        blob_shape.digest,
        identity.revision,
        serial,
        bytes.fromhex(identity.run_sha256),
        identity.effective_from.encode("ascii"),
        blob_shape.numbers,
        len(rows.status),
    )
    return head + content + struct.pack("<I", zlib.crc32(head + content))


def verify(name: str, content: bytes) -> str:
    """Check a blob's CRC and recompute its vectors from its own numbers; returns what it is."""
    if len(content) < HEADER.size + 4 or content[:4] != MAGIC:
        raise CoefficientError(
            f"{name}: not a blob that calibkit wrote", hint="verify takes calibkit's own files"
        )
    head = HEADER.unpack_from(content)
    _, major, _, length, bits, flags, digest, revision, serial, _, day, count, rows = head
    if major != MAJOR:
        raise CoefficientError(
            f"{name}: blob of schema {major}, expected {MAJOR}", hint="use a newer calibkit"
        )
    if length != len(content) or zlib.crc32(content[:-4]) != struct.unpack("<I", content[-4:])[0]:
        raise CoefficientError(
            f"{name}: its length or CRC is not that of its content", hint="export it again"
        )
    program, file_vectors = _read(content, bits, digest, count, rows, name)
    vectors.require_recomputed(program, file_vectors, name)
    device = serial.rstrip(b"\0").decode()
    mark = facts.MARKS[next((name for name, bits in FLAGS.items() if bits == flags), "rejected")]
    kind = f"{program.format.name}, {count} numbers, {rows} vectors recomputed{mark}"
    return (
        f"blob of {device} revision {revision}, effective from {day.rstrip(bytes(1)).decode()},"
        f" {kind}"
    )


def _read(
    content: bytes, bits: int, digest: bytes, count: int, rows: int, name: str
) -> tuple[Program, vectors.Vectors]:
    """Program and vectors of a blob whose CRC is right."""
    start = content.rfind(b'\n\n{"program"')
    text = content[start + 2 : -4] if start > 0 else b""
    lines = text.decode("ascii", "replace").splitlines() or [""]
    if bits not in CODES or hashlib.sha256("\n".join(lines).encode()).digest()[:8] != digest:
        raise CoefficientError(
            f"{name}: its layout is not the one it states", hint="export it again"
        )
    try:
        lengths: dict[str, int] = dict(json.loads(lines[-1])["tables"])
        structure = layout.read_program(lines[:-1], {}, name).structure
        inputs = [entry.name for entry in structure.inputs]
        outputs = [output.name for output in structure.outputs]
        row = width(structure)
        total = count + len(outputs) + rows * row
        numbers = struct.unpack_from(f"<{total}{CODES[bits]}", content, HEADER.size)
    except (ValueError, KeyError, TypeError, struct.error) as error:
        raise CoefficientError(
            f"{name}: its layout cannot be read: {error}", hint="export it again"
        ) from None
    ends = list(itertools.accumulate(lengths.values(), initial=0))
    tables = {
        table: numbers[start:end]
        for table, (start, end) in zip(lengths, itertools.pairwise(ends), strict=True)
    }
    flat = numbers[count + len(outputs) :]
    columns = [flat[k::row] for k in range(row)]
    status = tuple(map(int, columns[-1]))
    updates = tuple(map(int, columns[updates_at(structure)]))
    elapsed = tuple(map(int, columns[-2])) if structure.pace else ()
    file_vectors = vectors.Vectors(
        dict(zip(inputs, columns, strict=False)),  # a result may have the name of an input
        updates,
        dict(zip(outputs, columns[len(inputs) :], strict=False)),
        status,
        elapsed,
    )
    return layout.read_program(lines[:-1], tables, name), file_vectors
