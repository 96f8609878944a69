"""The log formats that calibkit reads by itself, and the recipe tables on how logs are written:
format, text dialect, binary records, missing values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, field_validator, model_validator
from pydantic_core import PydanticCustomError

from calibkit import units
from calibkit.libraries import plugins
from calibkit.recipe.strict import Positive, Table

AUTO = "auto"
"""Value of [logs] format that leaves the format to be recognised from the file."""


@dataclass(frozen=True, slots=True)
class _LogFormat:
    """A log format: the module of `calibkit.readers` that reads it, the bytes that its files begin
    with where they always do, the keys of [logs] that can describe it further, those of [logs.text]
    that it says itself, and the optional library that reads it, which the extra of its name has.
    """

    module: str
    signatures: tuple[bytes, ...] = ()
    keys: tuple[str, ...] = ()
    fixed_text_keys: tuple[str, ...] = ()
    library: str = ""


_LAYOUT = ("delimiter", "widths", "skip_lines", "header_lines")
_MARKED = ("decimal", *_LAYOUT)
_CELLS = ("encoding", "delimiter", "widths", "decimal")
FORMATS: dict[str, _LogFormat] = {
    "csv": _LogFormat("delimited"),
    "text": _LogFormat("text", keys=("text", "names")),
    "keysight": _LogFormat("keysight", keys=("text",), fixed_text_keys=_LAYOUT),
    "lvm": _LogFormat("lvm", (b"LabVIEW Measurement",), ("text",), _MARKED),
    "tdms": _LogFormat("tdms", (b"TDSm",), ("table",), library="nptdms"),
    "excel": _LogFormat(
        "excel",
        (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
        ("text", "table", "names"),
        _CELLS,
        "python_calamine",
    ),
    "matlab": _LogFormat(
        "matlab", (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"), ("table", "names")
    ),
    "hdf5": _LogFormat("hdf5", (b"\x89HDF\r\n\x1a\n",), ("table", "names"), library="h5py"),
    "parquet": _LogFormat("parquet", (b"PAR1",), library="pyarrow"),
    "ulog": _LogFormat("ulog", (b"ULog\x01\x12\x35",), ("table",), library="pyulog"),
    "json": _LogFormat("json_arrays", keys=("table", "names")),
    "chamber": _LogFormat("chamber", keys=("text", "names"), fixed_text_keys=_MARKED),
    "binary": _LogFormat("binary"),
}
"""Value of [logs] format → format."""

ARRAYS = ("matlab", "hdf5", "json")
"""Formats of named arrays, several of which can be the tables of one log."""
_ENDS = ("footer_lines", "last_line", "torn_lines", "torn_limit")
"""Keys of [logs.text] that clean CSV can have too."""
Count = Annotated[int, Field(ge=0)]
Auto = Literal["auto"]


class TextSpec(Table):
    """Dialect of delimited text; what is left at "auto" is guessed from the log, printed, and
    recorded in run.json.
    """

    #: Encoding of the characters.
    encoding: Literal["auto", "utf-8", "utf-16", "utf-16-le", "utf-16-be", "gb18030", "cp1252"] = (
        "auto"
    )
    #: Mark between fields; "space": any number of blanks, "fixed": columns of `widths`.
    delimiter: Literal["auto", ",", ";", "\t", "|", "space", "fixed"] = "auto"
    #: Decimal mark.
    decimal: Literal["auto", ".", ","] = "auto"
    #: Lines above the header; of single logs { "run1.txt" = 5 }.
    skip_lines: Count | Auto | dict[str, Count] = "auto"
    #: 0, 1 (names), or 2 (names, and units below them).
    header_lines: Annotated[int, Field(ge=0, le=2)] | Auto = "auto"
    #: Lines below the rows, of every format that has lines.
    footer_lines: Count = 0
    #: "drop" leaves out a last line without a line end: it was still being written.
    last_line: Literal["refuse", "drop"] = "refuse"
    #: "drop" leaves out lines with another number of fields or a torn number.
    torn_lines: Literal["refuse", "drop"] = "refuse"
    #: Largest number of torn lines; more are refused.
    torn_limit: Annotated[int, Field(ge=1)] = 10
    #: Characters of each column of fixed width.
    widths: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _consistent(self) -> TextSpec:
        if (self.delimiter == "fixed") != bool(self.widths):
            raise ValueError("delimiter = 'fixed' and widths = [...] go together")
        if self.delimiter == "," and self.decimal == ",":
            raise ValueError("a comma cannot be both delimiter and decimal mark")
        return self

    def of_log(self, file: str) -> TextSpec:
        """Dialect of one log, whose number of lines above the header may be stated for it alone."""
        if not isinstance(self.skip_lines, dict):
            return self
        skip_lines = self.skip_lines.get(file, self.skip_lines.get(file.rsplit(".", 1)[0], AUTO))
        return self.model_copy(update={"skip_lines": skip_lines})


class _FieldSpec(Table):
    """One field of a binary record: canonical meaning comes from [columns]; value = scale · stored
    + offset.
    """

    #: Name of the field, which `[columns]` maps.
    name: Annotated[str, Field(min_length=1)]
    #: Integer or float of so many bytes; "skip" leaves bytes out.
    type: Literal["i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8", "skip"]
    #: Number of bytes that "skip" leaves out.
    bytes: Annotated[int, Field(ge=1)] = 1
    #: Factor on the stored number.
    scale: float = 1.0
    #: Added behind the factor.
    offset: float = 0.0
    #: Unit of the number after factor and offset.
    unit: str = ""
    #: Byte order of this field where it is not that of the record.
    byte_order: Literal["record", "little", "big"] = "record"


class BinarySpec(Table):
    """Raw binary records of one length: a header that is skipped, then records of the listed fields
    without gaps.
    """

    #: Order of the bytes of a number.
    byte_order: Literal["little", "big"]
    #: Bytes before the first record.
    header_bytes: Count = 0
    fields: Annotated[tuple[_FieldSpec, ...], Field(min_length=1, strict=False)]
    #: Hexadecimal bytes that each record begins with.
    sync: str = ""

    @field_validator("fields")
    @classmethod
    def _known_units(cls, fields: tuple[_FieldSpec, ...]) -> tuple[_FieldSpec, ...]:
        for field in fields:
            if field.unit and not units.parse_unit(field.unit):
                raise ValueError(f"field '{field.name}': unknown unit '{field.unit}'")
        return fields

    @field_validator("sync")
    @classmethod
    def _hex(cls, sync: str) -> str:
        try:
            bytes.fromhex(sync)
        except ValueError:
            raise ValueError(
                f"sync = '{sync}': expected hexadecimal bytes, for example 'AA55'"
            ) from None
        return sync

    @model_validator(mode="after")
    def _distinct(self) -> BinarySpec:
        names = [field.name for field in self.fields if field.type != "skip"]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"field '{twice[0]}' stands twice")
        if not names:
            raise ValueError("every field is skipped")
        return self


class Logs(Table):
    """Which files of the data folder are logs, and how they are written."""

    #: Patterns of file names below the data folder.
    files: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    #: Format of the files; "auto" recognises it. Plugins add their own names.
    format: str = AUTO
    #: Names of the columns, in order, of a log without a header or of a matrix.
    names: Annotated[tuple[str, ...], Field(strict=False)] = ()
    #: Sheet, group, struct, topic or member that is the table; "*": all groups of one clock side
    #: by side.
    table: str = ""
    #: Tables of the same columns that follow each other as one log.
    tables: Annotated[tuple[str, ...], Field(strict=False)] = ()
    #: Files that differ in the number behind their name are parts of one log.
    split: bool = False
    #: Sampling rate of a log without a time column.
    rate_hz: Positive | None = None
    #: "drop" leaves out rows that lack a needed value, and lists them.
    missing: Literal["refuse", "drop"] = "refuse"
    #: Further numbers and words that mean "no value".
    sentinels: Annotated[tuple[float | str, ...], Field(strict=False)] = ()
    text: TextSpec = TextSpec()
    _excluded_lines: dict[str, frozenset[int]] = PrivateAttr(default_factory=dict)
    binary: BinarySpec | None = None

    def excluded_lines(self, file: str) -> frozenset[int]:
        """Lines of a log that the recipe leaves out, whether they are rows or not."""
        names = {file, file.rsplit(".", 1)[0]}
        return frozenset().union(*(self._excluded_lines.get(name, ()) for name in names))

    def without_lines(self, lines: dict[str, frozenset[int]]) -> Logs:
        """The tables for logs of which some lines are left out."""
        logs = self.model_copy()
        logs._excluded_lines = lines  # noqa: SLF001 (of its own class)
        return logs

    def ignored_keys(self, name: str) -> list[str]:
        """Stated keys of [logs.text] that the reader of a format has no use for; a plugin decides
        itself.
        """
        log_format = FORMATS.get(name)
        if name == AUTO or log_format is None:
            return []
        unstated = TextSpec()
        useless = set(
            log_format.fixed_text_keys if "text" in log_format.keys else TextSpec.model_fields
        )
        useless -= set(_ENDS) if name == "csv" else set()
        return [
            key
            for key in TextSpec.model_fields
            if key in useless and getattr(self.text, key) != getattr(unstated, key)
        ]

    @field_validator("files")
    @classmethod
    def _inside(cls, files: tuple[str, ...]) -> tuple[str, ...]:
        for pattern in files:
            if (
                pattern.startswith(("/", "\\"))
                or ".." in pattern.replace("\\", "/").split("/")
                or ":" in pattern
            ):
                raise ValueError(f"'{pattern}' leaves the data folder")
        return files

    @field_validator("tables")
    @classmethod
    def _several(cls, tables: tuple[str, ...]) -> tuple[str, ...]:
        if len(tables) == 1 or len(set(tables)) < len(tables):
            raise ValueError("tables = [...]: two or more, each once; of one say table = '…'")
        return tables

    @field_validator("names")
    @classmethod
    def _named_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"'{twice[0]}' stands twice")
        if not all(name.strip() for name in names):
            raise ValueError("a column without a name")
        return names

    @field_validator("format", mode="before")
    @classmethod
    def _known_format(cls, name: object) -> object:
        if name == AUTO or (isinstance(name, str) and name in FORMATS):
            return name
        format_names = dict.fromkeys((AUTO, *FORMATS, *plugins.installed(plugins.READERS)))
        if isinstance(name, str) and name in format_names:
            return name
        *first_names, last_name = map(repr, format_names)
        raise PydanticCustomError(
            "literal_error",
            "Input should be {expected}",
            {"expected": f"{', '.join(first_names)} or {last_name}"},
        )

    @model_validator(mode="after")
    def _of_the_format(self) -> Logs:
        if (self.format == "binary") != (self.binary is not None):
            raise ValueError("format = 'binary' and a table [logs.binary] go together")
        # a plugin decides itself which keys mean something to its format
        means = FORMATS[self.format].keys if self.format in FORMATS else ("text", "table", "names")
        if ignored := self.ignored_keys(self.format):
            raise ValueError(
                f"{', '.join(ignored)} in [logs.text] says nothing about format = '{self.format}'"
            )
        if self.table and "table" not in means:
            raise ValueError(f"table = '{self.table}' says nothing about format = '{self.format}'")
        if self.tables and (self.table or self.format not in (AUTO, *ARRAYS)):
            raise ValueError(
                f"tables = [...] is of formats {', '.join(ARRAYS)}, and goes without table"
            )
        if self.names and "names" not in means:
            raise ValueError(
                f"names = [...] says nothing about format = '{self.format}': its columns have names"
            )
        return self
