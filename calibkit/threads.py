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
    from collections.abc import Callable

    from threadpoolctl import ThreadpoolController


@functools.cache
def _libraries() -> ThreadpoolController:
    """Libraries of linear algebra of numpy and of scipy, each with threads of its own."""
    from threadpoolctl import ThreadpoolController

    from calibkit import lean_imports  # noqa: F401 (before scipy)

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


class _OneThread(contextlib.ContextDecorator):
    """Calls in several threads of a program share the limit: the first sets it, and the last to
    end restores what was set before.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._calls = 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._calls:
                limit = functools.partial(_libraries().limit, limits=1, user_api="blas")
                self._limit = _change(limit)
            self._calls += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._calls -= 1
            if not self._calls:
                _change(self._limit.restore_original_limits)


one_thread = _OneThread()
"""Decorator of what factorises, from the command line as from Python."""
