"""Corrections of reference instruments, from their own certificates, applied when logs are read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from calibkit.recipe.tables import Correction


def correct_references(
    frame: pd.DataFrame, corrections: Sequence[Correction], file: str
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame with each reference column corrected, and one text per column: by which certificate
    and by how much.

    Raises FrameError for an indication outside its certificate, unless the recipe extends the
    corrections of its ends.
    """
    reading = []
    for entry in corrections:
        if entry.column not in frame.columns:
            continue
        indication = frame[entry.column].to_numpy(dtype=np.float64)
        points = np.array(entry.indication)
        outside = (indication < points[0]) | (indication > points[-1])
        unit = units.column_unit(entry.column)
        if outside.any() and entry.beyond == "refuse":
            row = int(np.flatnonzero(outside)[0])
            raise FrameError(
                f"{file}:{int(frame.index[row]) + 2}: column '{entry.column}': {indication[row]:g}"
                f" {unit}, expected {points[0]:g} to {points[-1]:g}, the range of certificate"
                f" {entry.certificate} ({int(outside.sum())} rows are outside)",
                hint=(
                    'calibrate the instrument over the range that is used, or say beyond = "hold"'
                    " in [[correction]]"
                ),
            )
        added = np.interp(indication, points, np.array(entry.correction))
        frame = frame.assign(**{entry.column: indication + added})
        held = f", {int(outside.sum())} rows beyond it with the correction of its end"
        of = f" of {entry.instrument}" if entry.instrument else ""
        low, high = float(np.nanmin(added)), float(np.nanmax(added))
        reading.append(
            f"column '{entry.column}': corrected by {low:+.3g} to {high:+.3g} {unit}, certificate"
            f" {entry.certificate}{of}{held if outside.any() else ''}"
        )
    return frame, tuple(reading)
