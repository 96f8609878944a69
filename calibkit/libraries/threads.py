"""Linear algebra on one thread: what fits factorise is tall and narrow, so that threads only wait
for each other, and on one the sums keep their order.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from threadpoolctl import ThreadpoolController

_LOCK = threading.Lock()
_LIMITS: list[Any] = []
"""The limit, once for each call under way: calls in several threads of a program share it."""


@functools.cache
def _libraries() -> ThreadpoolController:
    """Libraries of linear algebra of numpy and of scipy, each with threads of its own."""
    from threadpoolctl import ThreadpoolController

    from calibkit.libraries import lean_imports  # noqa: F401 (before scipy)

    # a library is found only once it is loaded
    importlib.import_module("scipy.linalg")
    return ThreadpoolController()


def _change(setting: Callable[[], Any]) -> Any:  # noqa: ANN401 (threadpoolctl is not typed)
    """Result of a change of the number of threads, which holds for the whole process: threadpoolctl
    ignores every thread but the one that changed it first, until that one is released.
    """
    from threadpoolctl import OpenBLASController

    OpenBLASController.clear_controlling_thread(force=True)
    try:
        return setting()
    finally:
        OpenBLASController.clear_controlling_thread(force=True)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra to one thread during a call, from the command line as from Python; the
    last of several calls to end restores what was set before the first.
    """
    with _LOCK:
        _LIMITS.append(
            _LIMITS[0]
            if _LIMITS
            else _change(lambda: _libraries().limit(limits=1, user_api="blas"))
        )
    try:
        yield
    finally:
        with _LOCK:
            shared = _LIMITS.pop()
            if not _LIMITS:
                _change(shared.restore_original_limits)
