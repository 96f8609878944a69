"""A blob as records with addresses, as programmers of flash memory take them: Intel HEX and
Motorola S-records.
"""

from typing import Any

from calibkit import extras
from calibkit.errors import CalibkitError, CoefficientError, OutputError
from calibkit.firmware import blob

LARGEST = 1 << 32


def _bincopy() -> Any:  # noqa: ANN401 (a module of an optional library)
    """The library of both formats."""
    return extras.load_library("bincopy", "hex", "Intel HEX and S-records need bincopy")


def intel_hex(content: bytes, address: int) -> bytes:
    """Intel HEX of a blob at an address; OutputError where it leaves 32 bits."""
    return _placed(content, address, "as_ihex")


def s_records(content: bytes, address: int) -> bytes:
    """Motorola S-records with 32-bit addresses of a blob at an address; OutputError where it leaves
    32 bits.
    """
    return _placed(content, address, "as_srec")


def _placed(content: bytes, address: int, how: str) -> bytes:
    """Text of the records."""
    if not 0 <= address <= LARGEST - len(content):
        raise OutputError(
            f"--address 0x{address:x}: {len(content)} bytes from there leave 32 bits",
            hint="give another",
        )
    image = _bincopy().BinFile()
    image.add_binary(content, address)
    text: str = getattr(image, how)()
    return text.encode("ascii")


def verify_hex(name: str, content: bytes) -> str:
    """Check an Intel HEX file's records and the blob in it; returns what it is."""
    return _verified(name, content, "add_ihex", "Intel HEX")


def verify_srec(name: str, content: bytes) -> str:
    """Check an S-record file's records and the blob in it; returns what it is."""
    return _verified(name, content, "add_srec", "S-records")


def _verified(name: str, content: bytes, how: str, kind: str) -> str:
    """Blob of the records, verified."""
    library = _bincopy()
    image = library.BinFile()
    try:
        getattr(image, how)(content.decode("ascii"))
        segments = list(image.segments)
    except (library.Error, UnicodeDecodeError, ValueError, IndexError) as error:
        raise CoefficientError(
            f"{name}: not {kind} that can be read: {error}", hint="export it again"
        ) from None
    if len(segments) != 1:
        raise CoefficientError(
            f"{name}: {len(segments)} pieces, expected one", hint="records are missing"
        )
    try:
        inside = blob.verify(name, bytes(segments[0].data))
    except CalibkitError as error:
        raise CoefficientError(error.message, hint=error.hint) from None
    return f"{kind} at 0x{segments[0].address:08x}: {inside}"
