"""Compilation of the kernels: by whatever C compiler there is, into one library, or not at all."""

import hashlib
import os
import sys
from pathlib import Path

LIBRARY = "_kernels.so"
FLAGS = ("-O3", "-std=c11", "-fPIC", "-shared", "-ffp-contract=off")
"""No option that lets a compiler reorder or fuse floating-point operations: the bits are those of
numpy.
"""
TIMEOUT_S = 120.0
_BEGUN = ".compiling-"
"""How the folders begin in which a library is made; no wheel and no commit takes them."""


def made_of(folder: Path) -> int:
    """First 64 bits of the digest of the sources [in order of name] in a folder: the mark of a
    library made of them.
    """
    digest = hashlib.sha256()
    for source in sorted(folder.glob("*.c")):
        digest.update(source.read_bytes() + b"\0")
    return int.from_bytes(digest.digest()[:8], "big")


def compile_kernels(folder: Path) -> str | None:
    """Compile the sources in a folder into a library beside them; what went wrong where there is
    none then.

    A library that is in use is replaced, never written to. Only compilers of the GNU command line
    are asked.
    """
    import subprocess  # these two cost start-up, and most starts compile nothing
    import tempfile

    compiler = _compiler()
    if compiler is None:
        return "no C compiler was found"
    _remove_stale(folder)
    try:
        with tempfile.TemporaryDirectory(prefix=_BEGUN, dir=folder) as name:
            new_library, mark = Path(name) / LIBRARY, Path(name) / "mark.c"
            mark.write_text(
                f"unsigned long long calibkit_made_of = 0x{made_of(folder):016x}ULL;\n",
                encoding="ascii",
                newline="\n",
            )
            sources = [str(source) for source in (*sorted(folder.glob("*.c")), mark)]
            compilation = subprocess.run(  # noqa: S603 (the machine's own compiler)
                [*compiler, *FLAGS, "-o", str(new_library), *sources, "-lm"],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=TIMEOUT_S,
                check=False,
            )
            if compilation.returncode:
                return f"{compiler[0]}: {compilation.stderr.strip()}"
            new_library.replace(folder / LIBRARY)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return None


def _remove_stale(folder: Path) -> None:
    """Remove what killed compilations left, and nothing that one may still need."""
    import contextlib
    import shutil
    import time

    for left in folder.glob(f"{_BEGUN}*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > TIMEOUT_S:
                shutil.rmtree(left)


def _compiler() -> list[str] | None:
    """Command of the C compiler: that of the environment, or the machine's."""
    import shlex
    import shutil

    if sys.platform == "win32":
        return None
    command = shlex.split(os.environ.get("CC", ""))
    if command:
        return command if shutil.which(command[0]) else None
    return next(([name] for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
