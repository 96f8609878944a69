"""One side of a comparison, in a process and an environment of its own: JSON lines on stdin, one
answer a line on stdout.

    python worker.py ours|theirs

It needs the standard library and numpy, whatever the peer pins. A side is a function of the module
that is named: it takes arrays (from .npy files) and settings, and returns what is to be timed, a
function without arguments, and a function that makes named arrays of its result, which are compared
with the other side's. Only the first is timed.

Asked is {"do": "load", "side", "files", "settings"}, then any of {"do": "weigh"} (one call, and the
memory it took), {"do": "once", "times": n} (n calls, seconds of wall and processor a call), {"do":
"answer", "folder"} (the arrays of the last call as .npy); {"do": "versions", "packages"} at any
time. An answer with "error" says what went wrong.
"""

from __future__ import annotations

import gc
import importlib
import importlib.metadata
import json
import os
import platform
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

PEAK, NOW = "VmHWM", "VmRSS"


def resident(kind: str) -> int:
    """Resident bytes of this process, at its peak or now; 0 where the system does not tell."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith(kind):
                return int(line.split()[1]) * 1024
    return 0


def forget_peak() -> None:
    """Let the peak of the resident set begin anew, where the system can."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


class Side:
    """What is loaded, and the result of the last call."""

    def __init__(self, module: str) -> None:
        self.module = importlib.import_module(module)
        self.run: Any = None
        self.arrays: Any = None
        self.result: Any = None

    def load(self, side: str, files: dict[str, str], settings: dict[str, Any]) -> dict[str, Any]:
        """Read the arrays and let the side prepare itself."""
        self.run = self.arrays = self.result = None
        gc.collect()
        data = {name: np.load(path) for name, path in files.items()}
        self.run, self.arrays = getattr(self.module, side)(**data, **settings)
        return {}

    def weigh(self) -> dict[str, Any]:
        """Call once, as a warm-up, and say by how much the resident set grew at its peak."""
        self.result = None
        gc.collect()
        forget_peak()
        before, start = resident(NOW), time.perf_counter()
        self.result = self.run()
        return {"wall": time.perf_counter() - start, "bytes": max(resident(PEAK) - before, 0)}

    def once(self, times: int) -> dict[str, Any]:
        """Seconds of wall and processor a call, the mean of so many."""
        self.result = None
        gc.collect()
        wall, processor = time.perf_counter(), time.process_time()
        for _ in range(times):
            self.result = self.run()
        return {
            "wall": (time.perf_counter() - wall) / times,
            "cpu": (time.process_time() - processor) / times,
        }

    def answer(self, folder: str) -> dict[str, Any]:
        """Write the arrays of the last result."""
        arrays = self.arrays(self.result)
        for name, array in arrays.items():
            np.save(Path(folder) / f"{name}.npy", np.asarray(array))
        return {"names": sorted(arrays)}

    def shape(self) -> dict[str, Any]:
        """Shape of the last result, and of each column what it holds, where it is a frame."""
        schema = getattr(self.result, "schema", {})
        columns = ", ".join(f"{name} {kind}" for name, kind in schema.items())
        return {"shape": f"{self.result.shape[0]} rows, {columns}"}

    def versions(self, packages: list[str]) -> dict[str, Any]:
        """Version of Python, and of each package that is installed."""
        found = {"Python": platform.python_version()}
        for name in packages:
            with suppress(importlib.metadata.PackageNotFoundError):
                found[name] = importlib.metadata.version(name)
        return {"versions": found}


def main() -> None:
    """Answer until the questions end."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not stand among the answers
    side = Side(sys.argv[1])
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            said = getattr(side, asked.pop("do"))(**asked)
        except Exception as error:  # noqa: BLE001 (told to the one who asked, whatever it is)
            said = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(said) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
