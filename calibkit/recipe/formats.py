"""The log formats that calibkit reads by itself: the one list, for recipes and readers."""

from dataclasses import dataclass

from calibkit import plugins

AUTO = "auto"
"""Value of [logs] format that leaves the format to be recognised from the file."""


@dataclass(frozen=True, slots=True)
class _LogFormat:
    """A log format: the module of `calibkit.readers` that reads it, the bytes that its files begin
    with where they always do, and the keys of [logs] that can describe it further.
    """

    module: str
    signatures: tuple[bytes, ...] = ()
    keys: tuple[str, ...] = ()


FORMATS: dict[str, _LogFormat] = {
    "csv": _LogFormat("delimited"),
    "text": _LogFormat("text", keys=("text", "names")),
    "keysight": _LogFormat("keysight", keys=("text",)),
    "lvm": _LogFormat("lvm", (b"LabVIEW Measurement",), ("text", "names")),
    "tdms": _LogFormat("tdms", (b"TDSm",), ("table",)),
    "excel": _LogFormat(
        "excel", (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"), ("text", "table", "names")
    ),
    "matlab": _LogFormat(
        "matlab", (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"), ("table", "names")
    ),
    "hdf5": _LogFormat("hdf5", (b"\x89HDF\r\n\x1a\n",), ("table", "names")),
    "parquet": _LogFormat("parquet", (b"PAR1",)),
    "ulog": _LogFormat("ulog", (b"ULog\x01\x12\x35",), ("table",)),
    "json": _LogFormat("json_arrays", keys=("table", "names")),
    "chamber": _LogFormat("chamber", keys=("text", "names")),
    "binary": _LogFormat("binary"),
}
"""Value of [logs] format → format."""


def format_names() -> tuple[str, ...]:
    """Values that [logs] format can have: calibkit's own, then those of installed plugins."""
    return tuple(dict.fromkeys((AUTO, *FORMATS, *plugins.installed(plugins.READERS))))


def describes(key: str, name: str) -> bool:
    """Whether a key of [logs] means something to a format; a plugin decides that itself."""
    return name not in FORMATS or key in FORMATS[name].keys
