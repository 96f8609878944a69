"""The packaged peers, each with what it pins, and the environments that they are installed into."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Peer:
    """A package, and what is installed beside it."""

    package: str
    beside: tuple[str, ...] = ()


NUMPY = "numpy==2.4.6"
PEERS = {
    "numpy": Peer(NUMPY),
    "polars": Peer("polars==2.1.0", (NUMPY,)),
    "PyWavelets": Peer("PyWavelets==1.9.0", (NUMPY,)),
    "lmfit": Peer("lmfit==1.3.4", (NUMPY, "scipy==1.17.1")),
    "allantools": Peer("allantools==2024.6", (NUMPY, "scipy==1.17.1")),
    "imucal": Peer("imucal==2.6.0", (NUMPY, "pandas==3.1.1")),
}
DONE = "installed.txt"
"""Written last into an environment: what is in it."""


def cache() -> Path:
    """Where environments are kept unless told otherwise: the user's cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "calibkit-benchmarks"


def wanted(peer: Peer) -> str:
    """What an environment holds, a line a requirement."""
    return "".join(f"{line}\n" for line in (peer.package, *peer.beside))


def python_in(folder: Path) -> Path:
    """Interpreter of an environment."""
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def environment(name: str, folder: Path) -> Path:
    """Interpreter of an environment with the peer installed, made where there is none with these
    versions yet.
    """
    peer, place = PEERS[name], folder / name
    if (place / DONE).is_file() and (place / DONE).read_text(encoding="utf-8") == wanted(peer):
        return python_in(place)
    print(f"installing {peer.package} into an environment of its own", file=sys.stderr, flush=True)
    venv.create(place, with_pip=True, clear=True)
    install = [
        str(python_in(place)),
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
    ]
    done = subprocess.run(
        [*install, peer.package, *peer.beside], check=False, capture_output=True, text=True
    )
    if done.returncode:
        raise RuntimeError(f"{peer.package} could not be installed:\n{done.stderr[-2000:]}")
    (place / DONE).write_text(wanted(peer), encoding="utf-8")
    return python_in(place)
