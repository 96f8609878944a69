"""Devices fitted by processes of this machine; a process that is killed costs no more than the time
of its device.

The pools of the standard library give up when a process dies, and do not report which task it had.
Here every process has a pipe of its own, whose end shows that the process is gone and which device
has to be fitted again.
"""

from __future__ import annotations

import contextlib
import gc
import signal
import sys
from collections import Counter, deque
from dataclasses import dataclass
from multiprocessing import connection as pipes
from typing import TYPE_CHECKING, NoReturn

from calibkit.fleet import server
from calibkit.fleet.device import DeviceTask, Failure, Outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkServerProcess, SpawnProcess

    Task = Callable[[DeviceTask, str], Outcome]
    Process = SpawnProcess | ForkServerProcess

TRIES = 3
"""Processes that may die with a device before it is given up: its data may be what kills them."""
PATIENCE_S = 10.0
"""How long to wait for a process to end [s]."""


@dataclass(slots=True)
class _Worker:
    """A process, this end of its pipe, and the device that it fits."""

    process: Process
    pipe: Connection
    serial: str


def fit_devices(
    task: Task, plan: DeviceTask, serials: Sequence[str], jobs: int
) -> Generator[Outcome]:
    """Outcome of each device as it is finished, in any order."""
    waiting, tries = deque(serials), Counter[str]()
    crew: list[_Worker] = []
    try:
        while waiting or crew:
            while waiting and len(crew) < jobs:
                crew.append(_Worker(*_start(_serve, task, plan), waiting.popleft()))
                _send(crew[-1])
            for ready in pipes.wait([worker.pipe for worker in crew]):
                worker = next(worker for worker in crew if worker.pipe is ready)
                try:
                    outcome: Outcome = worker.pipe.recv()
                except (EOFError, OSError):  # the process is gone
                    crew.remove(worker)
                    _dismiss(worker)
                    tries[worker.serial] += 1
                    if tries[worker.serial] < TRIES:
                        waiting.appendleft(worker.serial)
                    else:
                        yield Failure.lost(worker.serial)
                    continue
                if waiting:
                    worker.serial = waiting.popleft()
                    _send(worker)
                else:
                    crew.remove(worker)
                    _dismiss(worker)
                yield outcome
    finally:
        for worker in crew:
            worker.process.terminate()
        for worker in crew:
            _dismiss(worker)


def _start(target: Callable[..., None], *arguments: object) -> tuple[Process, Connection]:
    """A new process of a function, and this end of the pipe whose other end is the function's first
    argument.
    """
    context = server.context()
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(theirs, *arguments), daemon=True)
    with server.environment():
        process.start()
    theirs.close()
    return process, ours


def _send(worker: _Worker) -> None:
    """Send a process its device; where it is gone already, the end of its pipe will show it."""
    with contextlib.suppress(OSError):
        worker.pipe.send(worker.serial)


def _dismiss(worker: _Worker) -> None:
    """Close the pipe, on which the process ends, and wait until it has ended."""
    worker.pipe.close()
    worker.process.join(PATIENCE_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()


def _serve(pipe: Connection, task: Task, plan: DeviceTask) -> None:
    """What a process does: fit devices until the pipe ends, which it also does when the process at
    its other end is killed.
    """
    # the keyboard interrupts the process that started this one, which then ends it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end_process)
    with contextlib.suppress(EOFError, OSError):
        pipe.send(task(plan, pipe.recv()))
        # what the first device had imported stays to the end: not to be looked through for garbage
        # with every figure
        gc.collect()
        gc.freeze()
        while True:
            pipe.send(task(plan, pipe.recv()))


def _end_process(*_: object) -> NoReturn:
    """End by way of every `finally`, so that nothing unfinished stays on the disk."""
    # raised in a callback of the garbage collector it is lost, silently: the pipe's end comes next
    sys.unraisablehook = lambda _: None
    raise SystemExit(143)
