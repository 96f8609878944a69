"""A blob as Intel HEX: records with addresses, as programmers of flash memory take them."""

from typing import Any

from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import blob
from calibkit.libraries import extras

LARGEST = 1 << 32


def place(content: bytes, address: int) -> bytes:
    """Records of a blob at an address; OutputError where it leaves 32 bits."""
    if not 0 <= address <= LARGEST - len(content):
        raise OutputError(
            f"--address 0x{address:x}: {len(content)} bytes from there leave 32 bits",
            hint="give another",
        )
    image = _bincopy().BinFile()
    image.add_binary(content, address)
    text: str = image.as_ihex()
    return text.encode("ascii")


def _bincopy() -> Any:  # noqa: ANN401 (a module of an optional library)
    """The library of the format."""
    return extras.load_library("bincopy", "hex", "Intel HEX needs bincopy")


def verify(name: str, content: bytes) -> str:
    """Check a file's records and the blob in them; returns what it is."""
    library = _bincopy()
    image = library.BinFile()
    try:
        image.add_ihex(content.decode("ascii"))
        segments = list(image.segments)
    except (library.Error, UnicodeDecodeError, ValueError, IndexError) as error:
        raise CoefficientError(
            f"{name}: not Intel HEX that can be read: {error}", hint="export it again"
        ) from None
    if len(segments) != 1:
        raise CoefficientError(
            f"{name}: {len(segments)} pieces, expected one", hint="records are missing"
        )
    inside = blob.verify(name, bytes(segments[0].data))
    return f"Intel HEX at 0x{segments[0].address:08x}: {inside}"
