"""Names that are the same to every reader and on every system: of devices, files and C symbols."""

import re
import unicodedata

from calibkit.errors import visible

_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)
"""Names that Windows keeps for devices, with any suffix."""
_SERIAL = re.compile(r"[^\W_][\w.+-]*", re.UNICODE)
_ALIKE = {"LATIN", "GREEK", "CYRILLIC", "ARMENIAN", "CHEROKEE", "FULLWIDTH", "MATHEMATICAL"}
"""Alphabets that have letters of one shape (Unicode Technical Standard 39)."""


def is_device(name: str) -> bool:
    """Whether Windows keeps a name for a device."""
    return _DEVICE.match(name) is not None


def is_serial(text: str) -> bool:
    """Whether a text can name a device's folder on every system: what `fit` takes as a serial."""
    return looks_plain(text) and not is_device(text) and not find_fault(text, words=False)


def looks_plain(text: str) -> bool:
    """Whether a text is of the characters and the length that a serial may have."""
    return _SERIAL.fullmatch(text) is not None and not text.endswith(".") and len(text) <= 100


def find_fault(name: str, *, words: bool = True) -> str:
    """What makes a name another one to some reader or system, "" where nothing does; letters of
    several alphabets may stand in different `words` of a file's name.
    """
    if is_device(name):
        return "is a device's name on Windows"
    if name.encode("utf-8", "ignore").decode() != name:
        return "is not UTF-8"
    if visible(name) != name:
        return "has characters that are not shown"
    if unicodedata.normalize("NFC", name) != name:
        return "is not in NFC"
    for word in re.findall(r"[^\W_\d]+", name) if words else (name,):
        alphabets = {unicodedata.name(c, "").split(" ")[0] for c in word if c.isalpha()} & _ALIKE
        if len(alphabets) > 1:
            return f"has letters of {' and '.join(map(str.capitalize, sorted(alphabets)))}"
    return ""
