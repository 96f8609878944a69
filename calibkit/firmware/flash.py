"""A blob as records with addresses, as programmers of flash memory take them: Intel HEX and
Motorola S-records.
"""

from typing import Any

from calibkit import extras
from calibkit.errors import CalibkitError, CoefficientError, OutputError
from calibkit.firmware import blob

LARGEST = 1 << 32
KINDS = {"ihex": "Intel HEX", "srec": "S-records"}
"""Name of a format in bincopy → in words. S-records have 32-bit addresses."""


def place(content: bytes, address: int, kind: str) -> bytes:
    """Records of a blob at an address, `kind` being a key of KINDS; OutputError where it leaves 32
    bits.
    """
    if not 0 <= address <= LARGEST - len(content):
        raise OutputError(
            f"--address 0x{address:x}: {len(content)} bytes from there leave 32 bits",
            hint="give another",
        )
    image = _bincopy().BinFile()
    image.add_binary(content, address)
    text: str = getattr(image, f"as_{kind}")()
    return text.encode("ascii")


def _bincopy() -> Any:  # noqa: ANN401 (a module of an optional library)
    """The library of both formats."""
    return extras.load_library("bincopy", "hex", "Intel HEX and S-records need bincopy")


def verify(kind: str, name: str, content: bytes) -> str:
    """Check a file's records and the blob in them; returns what it is."""
    library, title = _bincopy(), KINDS[kind]
    image = library.BinFile()
    try:
        getattr(image, f"add_{kind}")(content.decode("ascii"))
        segments = list(image.segments)
    except (library.Error, UnicodeDecodeError, ValueError, IndexError) as error:
        raise CoefficientError(
            f"{name}: not {title} that can be read: {error}", hint="export it again"
        ) from None
    if len(segments) != 1:
        raise CoefficientError(
            f"{name}: {len(segments)} pieces, expected one", hint="records are missing"
        )
    try:
        inside = blob.verify(name, bytes(segments[0].data))
    except CalibkitError as error:
        raise CoefficientError(error.message, hint=error.hint) from None
    return f"{title} at 0x{segments[0].address:08x}: {inside}"
