"""How the processes of a fleet begin: on Linux as copies of one that has imported what they need
and runs nothing.

To import what a fit needs takes seven times as long as a small fit. Elsewhere every process begins
anew: copies of a process are not safe there with the libraries that numbers and figures use.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from multiprocessing import get_context
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from multiprocessing.context import ForkServerContext, SpawnContext  # the first not on Windows

COPIES = sys.platform == "linux"
NEEDED = (
    "calibkit.fleet.handover",
    "calibkit.libraries.lean_imports",
    "pandas",
    "scipy.linalg",
    "scipy.special",
    "calibkit.report.svg_canvas",
    "matplotlib.figure",
    "xml.etree.ElementTree",
    "rich.console",
    "rich.table",
    "rfc8785",
    "calibkit.fleet.device",
)
"""How a process without a task ends, and what every fit needs, whatever its procedure."""
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
ALONE = {"JE_ARROW_MALLOC_CONF": "background_thread:false"}
"""What keeps a library from starting a thread as it is imported: of a process with threads no safe
copy can be made.
"""


def context() -> SpawnContext | ForkServerContext:
    """Context of `multiprocessing` in which the processes of a fleet begin."""
    if not COPIES:
        return get_context("spawn")
    import_ahead()
    return get_context("forkserver")


def import_ahead() -> None:
    """Start the process that others are copied from: it imports what they need while this one still
    imports what it needs itself.
    """
    if not COPIES:
        return
    from multiprocessing import forkserver, resource_tracker

    forkserver.set_forkserver_preload(list(NEEDED))
    resource_tracker.ensure_running()
    # the keyboard interrupts the one who asked, not the one that imports for it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with environment():
            forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def environment() -> Iterator[None]:
    """Environment of processes that share the machine: one thread each, sums in one order, modules
    from where ours are.
    """
    variables = (
        dict.fromkeys(THREADS, "1")
        | ALONE
        | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    )
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
