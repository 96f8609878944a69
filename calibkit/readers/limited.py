"""Parsers of binary formats in a process of their own, with limits of memory and time: a few bytes
can ask for terabytes, and a library that breaks must not take the command with it.

The process begins with the first binary log, imports what its parsers need once, and ends with the
one that began it. It is sent a function's name and a log's bytes, and sends arrays and JSON back:
what it sends is data, also where a parser was broken. Memory is limited where the system can limit
it (Linux: RLIMIT_DATA), time everywhere.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import CalibkitError, LogFormatError, SeveralTablesError, UsageError
from calibkit.libraries import extras
from calibkit.recipe.logs import FORMATS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

SETTING = "CALIBKIT_READER_MB"
"""Environment variable: megabytes that the parser of a binary log may take."""
MEGABYTES, PER_BYTE = 1000.0, 30.0
"""Megabytes for any file, and bytes for each byte of it: a zipped workbook takes about 20."""
SECONDS, PER_MEGABYTE = 60.0, 3.0
"""Seconds for any file, and for each megabyte of it: a workbook takes about one."""
MOST_COLUMNS = 10_000
_REFUSALS = {kind.__name__: kind for kind in (LogFormatError, SeveralTablesError, UsageError)}
"""Refusals of a parser, which are those of the command."""


@dataclass(frozen=True, slots=True)
class Parsed:
    """What a parser finds in a log: arrays by name, and facts that JSON can hold."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


@contextlib.contextmanager
def refuse_damaged(file: str, format_title: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into a LogFormatError that names the
    file.
    """
    try:
        yield
    except (CalibkitError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 (a parser of a foreign format raises anything on damaged bytes)
        message = " ".join(str(error).split())[:120]
        raise LogFormatError(
            f"{file}: not a whole {format_title} file: {type(error).__name__}: {message}",
            hint="the file is damaged or cut off, or has another format; copy it again",
        ) from None


def require_library(format_name: str, file: str) -> None:
    """Raise UsageError with how to install the library of a format where it is absent; it is not
    imported.
    """
    library = FORMATS[format_name].library
    if library and importlib.util.find_spec(library) is None:
        raise UsageError(
            f"{file}: reading this format needs {library}", hint=extras.install_hint(format_name)
        )


def require_columns(count: int, file: str) -> None:
    """Raise LogFormatError for a log of more columns than any logger has."""
    if count > MOST_COLUMNS:
        raise LogFormatError(
            f"{file}: {count} columns, expected at most {MOST_COLUMNS}",
            hint="the file is damaged, or rows and columns are exchanged",
        )


class _Process:
    """The process that parses, begun when it is first asked."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.process: subprocess.Popen[bytes] | None = None
        self.owner = 0

    def parse(self, request: dict[str, Any], data: bytes, seconds: float) -> Parsed | None:
        """The answer to a request; None where the process ended or took too long. Raises what the
        parser refuses.
        """
        with self.lock:
            parsed = None
            try:
                with contextlib.suppress(OSError, ValueError):
                    parsed = self._answer(self._begun(), request, data, seconds)
            except CalibkitError:
                raise
            except BaseException:
                self.end()
                raise
            if parsed is None:  # the pipes may hold half an answer
                self.end()
            return parsed

    def _begun(self) -> subprocess.Popen[bytes]:
        """The process; a new one where there is none, or it is that of a process that was
        copied.
        """
        if self.process is None or self.process.poll() is not None or self.owner != os.getpid():
            self.end()
            package_root = str(Path(__file__).resolve().parents[2])
            path = os.pathsep.join(dict.fromkeys([*filter(None, sys.path), package_root]))
            self.process = subprocess.Popen(  # noqa: S603 (this interpreter and a module of calibkit's own)
                [sys.executable, "-P", "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
            )
            self.owner = os.getpid()
        return self.process

    @staticmethod
    def _answer(
        process: subprocess.Popen[bytes], request: dict[str, Any], data: bytes, seconds: float
    ) -> Parsed | None:
        """What the process sends back; raises OSError or ValueError where it ends meanwhile."""
        send, receive = process.stdin, process.stdout
        assert send is not None and receive is not None  # noqa: S101, PT018 (both are pipes)
        clock = threading.Timer(seconds, process.kill)
        clock.start()
        try:
            send.write(json.dumps(request | {"bytes": len(data)}).encode() + b"\n")
            send.write(data)
            send.flush()
            answer = json.loads(receive.readline())
            arrays, complete = {}, True
            for name, kind, shape in answer.get("arrays", ()):
                arrays[name] = np.empty(shape, np.dtype(kind))
                room = arrays[name].reshape(-1).view(np.uint8).data
                complete &= receive.readinto(room) == len(room)  # type: ignore[attr-defined] # a buffered reader
        finally:
            clock.cancel()
        if not complete:
            return None
        if "error" in answer:
            raise _REFUSALS[answer.pop("error")](**answer)
        return None if "memory" in answer else Parsed(arrays, answer["facts"])

    def end(self) -> None:
        """End the process."""
        if self.process is not None:
            if self.owner == os.getpid():
                self.process.kill()
                self.process.wait()
            for stream in (self.process.stdin, self.process.stdout):
                with contextlib.suppress(OSError):
                    stream.close()  # type: ignore[union-attr]
        self.process = None


_PROCESS = _Process()
atexit.register(_PROCESS.end)


def parse(function: Callable[..., Parsed], file: str, data: bytes, *arguments: str) -> Parsed:
    """What a function (bytes, file, *arguments) of a module of readers finds in a log's bytes.

    Raises what it refuses, or LogFormatError where it takes more memory or time than a log of this
    size could, or breaks.
    """
    setting = os.environ.get(SETTING, "")
    if setting and not setting.isdecimal():
        raise UsageError(f"{SETTING}={setting}: expected megabytes", hint="unset it")
    megabytes = float(setting) if setting else MEGABYTES + PER_BYTE * len(data) / 1e6
    seconds = SECONDS + PER_MEGABYTE * len(data) / 1e6
    request = {
        "module": function.__module__,
        "function": function.__name__,
        "file": file,
        "arguments": arguments,
        "megabytes": megabytes,
    }
    parsed = _PROCESS.parse(request, data, seconds)
    if parsed is None:
        raise LogFormatError(
            f"{file}: {len(data)} bytes that its parser broke on, or that need more than"
            f" {megabytes:.0f} MB or {seconds:.0f} s",
            hint=f"the file is damaged or meant to harm; {SETTING} allows more where it is neither",
        )
    return parsed


def _serve() -> None:
    """Answer requests until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        data = sys.stdin.buffer.read(request["bytes"])
        arrays: dict[str, NDArray[Any]] = {}
        answer: dict[str, Any]
        _limit_memory(request["megabytes"])
        try:
            function = getattr(importlib.import_module(request["module"]), request["function"])
            parsed = function(data, request["file"], *request["arguments"])
            for name, array in parsed.arrays.items():  # those without numbers are sent empty
                numbers = array if array.dtype.kind in "fiu" else np.zeros(0)
                arrays[name] = np.ascontiguousarray(numbers)
            headers = [(name, array.dtype.str, array.shape) for name, array in arrays.items()]
            answer = {"arrays": headers, "facts": parsed.facts}
        except MemoryError:
            answer, arrays = {"memory": True}, {}
        except CalibkitError as error:
            answer = {"error": type(error).__name__, "message": error.message, "hint": error.hint}
            if isinstance(error, SeveralTablesError):
                answer["tables"] = error.tables
        answers.write(json.dumps(answer).encode() + b"\n")
        for array in arrays.values():
            answers.write(array.reshape(-1).view(np.uint8).data)
        answers.flush()


def _limit_memory(megabytes: float) -> None:
    """Let this process take so much memory beside what it has, where the system can."""
    pages = Path("/proc/self/statm")
    try:
        import resource

        used_bytes = int(pages.read_text(encoding="ascii").split()[5]) * resource.getpagesize()
        _, hard_limit = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (int(megabytes * 1e6) + used_bytes, hard_limit))
    except ImportError:  # Windows: the limit of time is left
        return
    except (OSError, ValueError):  # no /proc, or a limit that may not be lowered
        return


if __name__ == "__main__":
    _serve()
