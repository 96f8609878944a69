"""Which reader reads a log: that of the format that the recipe names, or of the one that the file
shows; calibkit's own, then those of plugins.
"""

import hashlib
import importlib
import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from calibkit import units
from calibkit.errors import LogFormatError, UsageError
from calibkit.libraries import plugins
from calibkit.readers import (
    clean,
    delimited,
    encoding as encodings,
    in_memory,
    limited,
    sniff,
    text,
)
from calibkit.readers.table import Guess, Table
from calibkit.recipe.logs import AUTO, FORMATS, Logs, TextSpec

_REPLY = re.compile(rb" (?:[-+0]\d{3}\.\d ){12,14}[01]{16,32}\s*$")
"""End of a chamber's reply without its echo: fields of six characters, then digital channels."""


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read a log in the format that the recipe names, or, where it names none, in the one that the
    file shows.

    Columns in `required_columns` hold numbers, or times as text; others may hold anything. Raises
    LogFormatError.
    """
    table = in_memory.find(path)
    if table is not None:
        return table
    try:
        if logs.format in (AUTO, "csv") and not logs.names and logs.text == TextSpec():
            table = clean.read(path, file)
        if table is None and logs.format == AUTO:
            table = _read_recognised(path, file, logs, required_columns)
        elif table is None and logs.format == "csv":
            table = text.parse_csv(*delimited.read_bytes(path, file), file, logs, required_columns)
        elif table is None:
            table = _read_as(logs.format, path, file, logs, required_columns)
    except MemoryError:
        raise LogFormatError(
            f"{file}: needs more memory than there is", hint="cut the log into several"
        ) from None
    return table


class Reader(Protocol):
    """What the module of a format offers; a plugin's may have the bytes that its files begin with
    as `SIGNATURES`.
    """

    def read(self, path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
        """Read a log whole, or raise LogFormatError."""


def _read_as(
    name: str, path: Path, file: str, logs: Logs, required_columns: Collection[str]
) -> Table:
    """Read a log in a format by name; the module of the format is imported now."""
    if name in FORMATS:
        limited.require_library(name, file)
        module: Any = importlib.import_module(f"calibkit.readers.{FORMATS[name].module}")
        format_reader: Reader = module
        return format_reader.read(path, file, logs, required_columns)
    return _read_by_plugin(name, path, file, logs, required_columns)


def _read_by_plugin(
    name: str, path: Path, file: str, logs: Logs, required_columns: Collection[str]
) -> Table:
    """Read a log by the plugin of a format, and check what it gives; raises UsageError where it
    cannot be used.
    """
    entry = plugins.installed(plugins.READERS).get(name)
    if entry is None:
        raise UsageError(
            f"{file}: no plugin that reads format '{name}' is installed",
            hint="install the package that reads it; run.json of a fit with it names the package",
        )
    reader: Reader = plugins.load(entry)
    origin = plugins.identify(entry)
    title = f"'{name}' ({origin.distribution} {origin.version})"
    with limited.refuse_damaged(file, title):
        table = reader.read(path, file, logs, required_columns)
        with path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        column_units = {
            column: units.ALIASES.get(unit, unit) for column, unit in table.units.items()
        }
        faulty = table.sha256 != sha256 or not set(column_units.values()) <= set(units.TABLE)
    if faulty:
        raise LogFormatError(
            f"{file}: the reader of format {title} gave a digest of other bytes, or units that"
            " calibkit does not know",
            hint="tell the authors of that package",
        )
    return replace(table, units=column_units, plugins=(origin,))


def recognise_format(head: bytes) -> str:
    """Format of calibkit's own that a file with these first bytes has, or "" for text without a
    mark of its own.
    """
    for name, log_format in FORMATS.items():
        if head.startswith(log_format.signatures):
            return name
    without_nuls = head[:4096].replace(b"\0", b"")  # UTF-16 too
    if re.match(rb'\s*(\{\s*"|\[\s*[\[{])', without_nuls):
        return "json"
    first = without_nuls.partition(b"\n")[0].partition(b"\r")[0]
    if b"$01I" in first or _REPLY.search(first):
        return "chamber"
    return "keysight" if re.search(rb"(?m)^(Sweep #|Scan)[,;\t]Time[,;\t]", without_nuls) else ""


def recognise_plugin(head: bytes) -> str:
    """Format of an installed plugin with a signature that a file begins with, or ""."""
    for name, module in plugins.usable(plugins.READERS).items():
        signatures = getattr(module, "SIGNATURES", ())
        marks = [signatures] if isinstance(signatures, bytes) else signatures
        if any(isinstance(mark, bytes) and mark and head.startswith(mark) for mark in marks):
            return name
    return ""


def _read_recognised(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read a log that is no clean CSV and whose format the recipe leaves open: in the format that
    its first bytes show, as text, or by a plugin, in this order.
    """
    described = bool(logs.names) or logs.text != TextSpec()
    data, sha256 = delimited.read_bytes(path, file)
    format_name = recognise_format(data)
    if not format_name:
        try:
            return _read_text(data, sha256, file, logs, required_columns, described=described)
        except LogFormatError:
            format_name = "" if described else recognise_plugin(data)
            if not format_name:
                raise
    if ignored := logs.ignored_keys(format_name):
        raise LogFormatError(
            f"{file}: [logs.text] states {', '.join(ignored)}, the file is of format"
            f" '{format_name}'",
            hint="that format says it itself: take these keys out, or pin format in [logs]",
        )
    table = _read_as(format_name, path, file, logs, required_columns)
    return replace(table, reading=(Guess(f"format = '{format_name}' (guessed)"), *table.reading))


def _read_text(
    data: bytes,
    sha256: str,
    file: str,
    logs: Logs,
    required_columns: Collection[str],
    *,
    described: bool,
) -> Table:
    """Read text in the dialect that it shows. Where it is too short or too odd to show one, it is
    read as comma-separated text, or refused as that, if it begins like it.
    """
    first = data.partition(b"\n")[0]
    try:
        content, encoding = encodings.decode(data, file, logs.text.encoding)
        dialect = sniff.Dialect.recognise(content, encoding, file, logs.text, logs.names)
    except LogFormatError:
        if described or b"," not in first or b"\0" in first:
            raise
        return text.parse_csv(data, sha256, file, logs, required_columns)
    table = text.parse_text(content, sha256, file, dialect, logs, required_columns)
    # of comma-separated text with one line of names only the form of its times is a guess
    if dialect.clean and not described:
        return replace(table, reading=dialect.time_guesses)
    return replace(table, reading=(Guess("format = 'text' (guessed)"), *table.reading))
