"""The kernel in C that reads the numbers of CSV files; without a compiler at installation there is
none, and Python reads them.

What it reads is to the last bit what is read without it: whether it is there decides how long
calibkit takes, and nothing else. `CALIBKIT_NATIVE=off` leaves it out, `python -m calibkit.native`
compiles it again.
"""

import os
from ctypes import CDLL
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent


def kernels() -> CDLL | None:
    """The compiled kernels; None where there are none. Calls into them run beside other threads."""
    return _loaded()[0]


def state() -> str:
    """In a few words whether the kernels are used, and why not where they are not."""
    return _loaded()[1]


@cache
def _loaded() -> tuple[CDLL | None, str]:
    """The kernels of just these sources, and whether they are used."""
    import ctypes

    from calibkit.native import compiling

    if os.environ.get("CALIBKIT_NATIVE", "on") == "off":
        return None, "turned off by CALIBKIT_NATIVE"
    library_path = FOLDER / compiling.LIBRARY
    remedy = "install calibkit again, or run python -m calibkit.native"
    try:
        _refuse_cut_off(library_path.read_bytes())
        library = ctypes.CDLL(str(library_path))
        made_of = ctypes.c_uint64.in_dll(library, "calibkit_made_of").value
    except FileNotFoundError:
        reason = "no kernels were installed (a pure wheel, or no C compiler at installation)"
        return None, f"not compiled: {reason}"
    except (OSError, ValueError):
        return None, f"not in use: {library_path.name} is damaged or of another machine: {remedy}"
    if made_of != compiling.made_of(FOLDER):
        return None, f"compiled from other sources: {remedy}"
    _declare(library)
    return library, "in use"


def _refuse_cut_off(library: bytes) -> None:
    """Raise ValueError for an ELF library that ends before its table of sections does: to load it
    might end the process.
    """
    if library[:6] == b"\x7fELF\2\1":  # of 64 bits, little-endian
        start = int.from_bytes(library[40:48], "little")
        size, number = (
            int.from_bytes(library[offset : offset + 2], "little") for offset in (58, 60)
        )
        if len(library) < max(64, start + size * number):
            raise ValueError


def _declare(library: CDLL) -> None:
    """Argument and result types of the kernel."""
    from ctypes import POINTER, c_double, c_int64, c_void_p

    library.calibkit_numbers.restype = c_int64
    library.calibkit_numbers.argtypes = (
        *(c_void_p, c_int64, c_int64, c_int64),
        POINTER(POINTER(c_double)),
    )
