"""One row per device, for factory flashing: every number under a name of its own, its meaning, and
what the row can be verified by.
"""

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import exact, facts, layout, vectors
from calibkit.firmware.export import FirmwareRun
from calibkit.records.run_document import ACCEPTED
from calibkit.report.table import Table

FACTS = (
    "serial",
    "revision",
    "effective_from",
    "accepted",
    "run_sha256",
    "number",
    "formula",
    "fitted_over",
)
CELLS = {"1": True, "0": False, "": None}
"""What a table states under `accepted`: nothing where there is no verdict."""
PROOF = ("program", "vectors", "row_sha256")


def render(exports: Sequence[FirmwareRun]) -> bytes:
    """CSV of runs (RFC 4180, UTF-8, LF); OutputError where they would need different columns."""
    rows = [_row(export) for export in exports]
    heads = list(rows[0])
    for row, export in zip(rows, exports, strict=True):
        if list(row) != heads:
            raise OutputError(
                f"{export.identity.serial} and {exports[0].identity.serial} need different columns:"
                " their models differ in form or degree",
                hint="pin models and orders in the recipe, or export them apart",
            )
    cells = tuple((*row.values(), _digest(row)) for row in rows)
    return Table("", (*heads, PROOF[-1]), cells).to_csv().encode()


def _row(export: FirmwareRun) -> dict[str, str]:
    """Column → text of one device; a table's number k stands under table[k], index = power where it
    is a polynomial.
    """
    identity, program, structure = export.identity, export.program, export.structure
    row = {
        "serial": identity.serial,
        "revision": str(identity.revision),
        "effective_from": identity.effective_from,
        "accepted": next(
            cell for cell, value in CELLS.items() if value is ACCEPTED[identity.verdict]
        ),
        "run_sha256": identity.run_sha256,
        "number": program.format.name,
        "formula": facts.ascii_only(structure.formula),
        "fitted_over": "; ".join(export.chain.ranges),
        "made_of": "; ".join(" ".join(line.split()) for line in export.sources),
    }
    row |= {
        f"{name}_{output.name} [{output.unit}]": (
            f"{exact.round_to(bound[output.name], 2, up=True):.1e}"
        )
        for name, bound in (("bound", export.bounds), ("full_scale_bound", export.full_bounds))
        for output in structure.outputs
    }
    for name in structure.tables:
        numbers = program.tables[name]
        row |= {f"{name}[{k}]": program.format.text(x).rstrip("F") for k, x in enumerate(numbers)}
    row["program"] = "\n".join(layout.write_program(program))
    row["vectors"] = json.dumps(asdict(export.vectors), separators=(",", ":"))
    return row


def _digest(row: Mapping[str, str]) -> str:
    """SHA-256 over all names and texts of a row."""
    return hashlib.sha256(
        "\0".join(f"{name}={text}" for name, text in row.items()).encode()
    ).hexdigest()


def verify(name: str, content: bytes) -> str:
    """Check every row's digest and recompute its vectors from its own numbers; returns what the
    file is.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise CoefficientError(
            f"{name}: not a table that calibkit wrote: {error}", hint="export it again"
        ) from None
    if not rows or not {*FACTS, *PROOF} <= set(rows[0]):
        raise CoefficientError(
            f"{name}: not a table of units", hint="verify takes calibkit's own files"
        )
    for number, row in enumerate(rows, start=1):
        place = f"{name}: row {number}"
        digest = row.pop(PROOF[-1])
        if None in row or None in row.values() or _digest(row) != digest:
            raise CoefficientError(
                f"{place}: its digest is not that of its content", hint="export it again"
            )
        _recomputed(row, place)
    mark = facts.list_verdicts({row["serial"]: CELLS.get(row["accepted"]) for row in rows})
    return f"table of {len(rows)} units, {rows[0]['number']}, their vectors recomputed{mark}"


def _recomputed(row: Mapping[str, str], place: str) -> None:
    """Compare a row's vectors with what its numbers give."""
    lines = row["program"].splitlines()
    bare = layout.read_program(lines, {}, place)
    tables = {}
    for table in bare.structure.tables:
        texts = [text for column, text in row.items() if column.startswith(f"{table}[")]
        tables[table] = tuple(map(float, texts))
    program = layout.read_program(lines, tables, place)
    try:
        file_vectors = json.loads(row["vectors"])
        inputs = {name: tuple(column) for name, column in file_vectors["inputs"].items()}
        outputs = {name: tuple(column) for name, column in file_vectors["outputs"].items()}
        counts = (tuple(file_vectors.get(name, ())) for name in ("updates", "status", "elapsed_ms"))
        updates, status, elapsed = counts
        rows = vectors.Vectors(inputs, updates, outputs, status, elapsed)
        vectors.require_recomputed(program, rows, place)
    except (ValueError, KeyError, TypeError) as error:
        raise CoefficientError(
            f"{place}: its vectors cannot be read: {error}", hint="export it again"
        ) from None
