"""Local gravity that somebody typed into a log, above its rows or on another sheet."""

import re
from pathlib import Path

from calibkit.errors import LogFormatError
from calibkit.readers import delimited, encoding as encodings, excel, limited, registry

_TYPED = re.compile(
    r"(?<![a-z])(?:g|gravity|schwere|重力)\b[^\n\d]{0,40}?(9[.,][78]\d{0,6})", re.IGNORECASE
)
_HEAD_BYTES = 8192
_TEXTS = ("", "keysight", "lvm", "chamber")
"""Formats, as they are recognised, that are text."""


def find_gravity(path: Path) -> str:
    """Gravity [m/s²] that a log states beside a word for it, as TOML, or ""."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    try:
        format_name = registry.recognise_format(head)
        if format_name == "excel":
            text = _read_cells(path)
        elif format_name in _TEXTS:
            complete_lines = head[: head.rfind(b"\n") + 1] or head
            # UTF-16 has two bytes per character: the cut behind b"\n" may have left half of one
            whole_characters = complete_lines[: len(complete_lines) // 2 * 2]
            text = encodings.decode(whole_characters, path.name, "auto")[0]
        else:
            return ""
    except LogFormatError:
        return ""
    gravity_match = _TYPED.search(text)
    return gravity_match.group(1).replace(",", ".") if gravity_match else ""


def _read_cells(path: Path) -> str:
    """Cells of every sheet of a workbook as text, a row a line."""
    data, _ = delimited.read_bytes(path, path.name)
    sheets = [
        limited.parse(excel.parse, path.name, data, name).arrays["content"]
        for name in excel.list_sheets(path, path.name)
    ]
    return "\n".join(sheet.tobytes().decode() for sheet in sheets)
