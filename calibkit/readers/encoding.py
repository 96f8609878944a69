"""Bytes of a text log → characters: the encoding that the recipe pins, or the first that the bytes
allow.

Order of trial: byte-order mark, UTF-8, UTF-16 (recognised by its NUL bytes), GB18030, Windows-1252.
Uncertainty: GB18030 and Windows-1252 cannot be told apart with certainty; bytes that read as degree
signs, micro signs, powers and the letters of western European languages, each by itself, are taken
for Windows-1252. Nothing is ever replaced or ignored: a byte that does not fit refuses the file
with its line.
"""

import codecs
import re

from calibkit.errors import LogFormatError

WESTERN = frozenset("°µ²³±·äöüÄÖÜßéèàâçñΩ".encode("cp1252", errors="ignore"))
"""Bytes that western instruments write, in Windows-1252."""
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
"""Characters that no log is written in."""
MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def decode(data: bytes, file: str, pinned: str = "auto") -> tuple[str, str]:
    """Characters of a log and the name of their encoding; raises LogFormatError where a byte does
    not fit.
    """
    if not data.strip():
        raise LogFormatError(
            f"{file}: the file is empty",
            hint="expected a header line and rows below it; remove it or copy it again",
        )
    marked = next(((mark, name) for mark, name in MARKS if data.startswith(mark)), None)
    mark_encoding = marked[1] if marked else ""
    if pinned == "auto":
        encoding = mark_encoding or _guess_encoding(data, file)
    else:
        encoding = (mark_encoding or "utf-16-le") if pinned == "utf-16" else pinned
        if mark_encoding and mark_encoding != encoding:
            raise LogFormatError(
                f"{file}:1: the byte-order mark says {mark_encoding}, the recipe says {pinned}",
                hint="correct [logs.text] encoding, or leave it out",
            )
    body = data.removeprefix(marked[0]) if marked and marked[1] == encoding else data
    try:
        text = body.decode(encoding)
    except UnicodeDecodeError as error:
        line = body[: error.start].decode(encoding, errors="replace").count("\n") + 1
        raise LogFormatError(
            f"{file}:{line}: byte 0x{body[error.start]:02x} is not {encoding.upper()} text",
            hint="the file is damaged or cut off, or has another encoding: pin it in [logs.text]",
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise LogFormatError(
            f"{file}:{line}: a NUL byte in text", hint="the copy is damaged; copy the log again"
        )
    if control := CONTROL.search(text):
        line = text.count("\n", 0, control.start()) + 1
        raise LogFormatError(
            f"{file}:{line}: a control character (0x{ord(control.group()):02x}) in text",
            hint="the copy is damaged; copy the log again",
        )
    return text.replace("\r\n", "\n").replace("\r", "\n"), encoding


def _guess_encoding(data: bytes, file: str) -> str:
    """The first encoding that fits bytes without a byte-order mark."""
    head = data[:4096]
    for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if (
            len(head) >= 8
            and head[offset::2].count(0) > 0.8 * len(head[offset::2])
            and not head[1 - offset :: 2].count(0)
        ):
            return name
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        _refuse_damaged(data, error, file)
    else:
        return "utf-8"
    runs = re.findall(rb"[\x80-\xff]+", data)
    if all(set(run) <= WESTERN and (len(run) == 1 or min(run) >= 0xC4) for run in runs):
        return "cp1252"  # what western instruments write, in pairs only of letters
    try:
        data.decode("gb18030")
    except UnicodeDecodeError:
        return "cp1252"
    return "gb18030"


def _refuse_damaged(data: bytes, error: UnicodeDecodeError, file: str) -> None:
    """Raise LogFormatError for UTF-8 text with single wrong bytes: read in another encoding it
    would turn into other characters.
    """
    pairs = len(re.findall(rb"[\xc2-\xdf][\x80-\xbf]", data))
    # three bytes that make a character in UTF-8 hardly ever do so by chance in another encoding,
    # two may
    longer = len(re.findall(rb"[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}", data))
    intact = len(re.sub(rb"[\x00-\x7f]+", b"", data.decode("utf-8", errors="ignore").encode()))
    wrong = len(re.sub(rb"[\x00-\x7f]+", b"", data)) - intact
    # whether every run of bytes above 0x80 reads as whole GB18030 characters of two bytes
    in_pairs = all(len(run) % 2 == 0 for run in re.findall(rb"[\x81-\xfe]+", data))
    if 3 * longer > wrong or (pairs and 3 * pairs > wrong and not in_pairs):
        line = data.count(b"\n", 0, error.start) + 1
        raise LogFormatError(
            f"{file}:{line}: byte 0x{data[error.start]:02x} is not UTF-8 text, the rest of the"
            " file is",
            hint=(
                "the copy is damaged or cut off; copy the log again, or pin the encoding in"
                " [logs.text]"
            ),
        )
