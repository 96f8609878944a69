"""The formats that calibkit reads: name → reader, and what tells a format from its first bytes."""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, cast

from calibkit.errors import LogFormatError
from calibkit.readers import clean, delimited
from calibkit.recipe.logs import TextSpec

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from calibkit.readers.table import Table
    from calibkit.recipe.logs import Logs


@dataclass(frozen=True, slots=True)
class Format:
    """A format: what it is, the module that reads it, and the bytes that its files begin with where
    they do.
    """

    what: str
    module: str
    signatures: tuple[bytes, ...] = ()


FORMATS: dict[str, Format] = {
    "csv": Format("comma-separated UTF-8 with one header line", "delimited"),
    "text": Format("delimited text in any dialect", "text"),
    "keysight": Format("Keysight 34970A/34972A/DAQ970A scan, BenchLink Data Logger", "keysight"),
    "lvm": Format("LabVIEW measurement file", "lvm", (b"LabVIEW Measurement",)),
    "tdms": Format("NI TDMS", "tdms", (b"TDSm",)),
    "excel": Format(
        "Excel workbook", "excel", (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")
    ),
    "matlab": Format(
        "MATLAB MAT-file v5 or v7.3", "matlab", (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
    ),
    "hdf5": Format("HDF5", "hdf5", (b"\x89HDF\r\n\x1a\n",)),
    "parquet": Format("Apache Parquet", "parquet", (b"PAR1",)),
    "ulog": Format("PX4 ULog", "ulog", (b"ULog\x01\x12\x35",)),
    "json": Format("JSON arrays or records", "json_arrays"),
    "chamber": Format("Vötsch/Weiss chamber replies ($01I)", "chamber"),
    "binary": Format("raw binary records described in the recipe", "binary"),
}


def read(path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """Read a log in the format that the recipe names, or, where it names none, in the one that the
    file shows.

    Columns in `needed` hold numbers, or times as text; others may hold anything. Raises
    LogFormatError.
    """
    if logs.format == "auto":
        return _recognised(path, file, logs, needed)
    if logs.format == "csv":
        return clean.read(path, file) or delimited.read(path, file, needed)
    return _reader(logs.format).read(path, file, logs, needed)


class Reader(Protocol):
    """What the module of a format offers."""

    def read(self, path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
        """Read a log whole, or raise LogFormatError."""


def _reader(name: str) -> Reader:
    """Module that reads a format; imported only when a log of it is read."""
    return cast("Reader", importlib.import_module(f"calibkit.readers.{FORMATS[name].module}"))


def signature(head: bytes) -> str:
    """Format whose files begin with these bytes, or "" where none is known to."""
    for name, known in FORMATS.items():
        if any(head.startswith(mark) for mark in known.signatures):
            return name
    return ""


def _recognised(path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """Read a log whose format the recipe leaves open: clean CSV strictly, anything else as what it
    shows itself to be.
    """
    described = bool(logs.names) or logs.text != TextSpec()
    if not described and (table := clean.read(path, file)) is not None:
        return table
    data = delimited.load(path, file)
    found = signature(data[:32]) or shown(data)
    if found:
        table = _reader(found).read(path, file, logs, needed)
        return replace(table, reading=(f"format = '{found}' (guessed)", *table.reading))
    return _text(data, file, logs, needed, described=described)


def shown(data: bytes) -> str:
    """A text format that shows in the first lines of a log."""
    head = data[:4096].replace(b"\0", b"")  # UTF-16 too
    first = head.splitlines()[0] if head.splitlines() else b""
    if b"$01I" in first:
        return "chamber"
    return "keysight" if re.search(rb"(?m)^(Sweep #|Scan)[,;\t]Time[,;\t]", head) else ""


def _text(data: bytes, file: str, logs: Logs, needed: Collection[str], *, described: bool) -> Table:
    """Read text: strictly where it is clean CSV but for a fault, in its dialect where it is
    another.
    """
    from calibkit.readers import text

    if not described and delimited.looks_clean(data):
        try:
            return delimited.parse(data, file, needed)
        except LogFormatError as strict:
            try:
                table = text.parse(data, file, logs, needed)
            except LogFormatError:
                raise strict from None
    else:
        table = text.parse(data, file, logs, needed)
    return replace(table, reading=("format = 'text' (guessed)", *table.reading))
