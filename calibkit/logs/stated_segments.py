"""Held conditions that the recipe states, as rows of a log."""

from collections.abc import Sequence

import numpy as np

from calibkit.errors import FrameError
from calibkit.numeric.arrays import Integers
from calibkit.recipe import Recipe
from calibkit.recipe.tables import Pin
from calibkit.records.frame import Log, values


def stated_kinds(log: Log, spec: Recipe) -> list[str]:
    """Kinds of the segments that the recipe states of a log, in the order of `stated_rows`."""
    return [segment.kind for segment in _segments_of_log(log, spec)]


def stated_rows(log: Log, spec: Recipe, kinds: Sequence[str]) -> Integers | None:
    """Rows [m, 2] of the segments of some kinds that the recipe states of a log, ascending; None
    where it states none.

    Raises FrameError for a segment of another kind, or one that holds fewer than two rows.
    """
    segments = _segments_of_log(log, spec)
    if not segments:
        return None
    time = values(log.frame, "time_s")
    row_ranges = []
    for segment in segments:
        place = f"{log.file}: [[segment]] from {segment.from_s:.12g} s to {segment.to_s:.12g} s"
        if segment.kind not in kinds:
            expected = " or ".join(f"'{kind}'" for kind in kinds)
            raise FrameError(
                f"{place}: kind = '{segment.kind}', expected {expected}", hint="change the recipe"
            )
        start = int(np.searchsorted(time, segment.from_s, side="left"))
        stop = int(np.searchsorted(time, segment.to_s, side="right"))
        if stop - start < 2:
            raise FrameError(
                f"{place}: {stop - start} rows, expected at least 2",
                hint=f"the log goes from {time[0]:.12g} s to {time[-1]:.12g} s",
            )
        row_ranges.append((start, stop))
    return np.array(row_ranges, dtype=np.int64)


def _segments_of_log(log: Log, spec: Recipe) -> list[Pin]:
    """Segments that the recipe states of a log, in order of time."""
    segments = (segment for segment in spec.segment if segment.log in (log.file, log.name))
    return sorted(segments, key=lambda segment: segment.from_s)
