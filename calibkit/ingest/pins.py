"""Held conditions that the recipe states, as rows of a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FrameError
from calibkit.frame import values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Integers
    from calibkit.frame import Log
    from calibkit.recipe import Recipe


def rows(log: Log, spec: Recipe, kinds: Sequence[str]) -> Integers | None:
    """Rows [m, 2] of the segments of some kinds that the recipe pins in a log, ascending; none
    where it pins nothing.

    Raises FrameError for a segment of another kind, or one that holds fewer than two rows.
    """
    pins = sorted(
        (pin for pin in spec.segment if pin.log in (log.file, log.name)), key=lambda pin: pin.from_s
    )
    if not pins:
        return None
    time = values(log.frame, "time_s")
    found = []
    for pin in pins:
        place = f"{log.file}: [[segment]] from {pin.from_s:g} s to {pin.to_s:g} s"
        if pin.kind not in kinds:
            expected = " or ".join(f"'{kind}'" for kind in kinds)
            raise FrameError(
                f"{place}: kind = '{pin.kind}', expected {expected}", hint="change the recipe"
            )
        start = int(np.searchsorted(time, pin.from_s, side="left"))
        stop = int(np.searchsorted(time, pin.to_s, side="right"))
        if stop - start < 2:
            ends = f"{time[0]:g} s to {time[-1]:g} s"
            raise FrameError(
                f"{place}: {stop - start} rows, expected at least 2",
                hint=f"the log goes from {ends}",
            )
        found.append((start, stop))
    return np.array(found, dtype=np.int64)


def kinds(log: Log, spec: Recipe) -> list[str]:
    """Kinds of the pinned segments of a log, in the order of `rows`."""
    pins = sorted(
        (pin for pin in spec.segment if pin.log in (log.file, log.name)), key=lambda pin: pin.from_s
    )
    return [pin.kind for pin in pins]
