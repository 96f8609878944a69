"""What the numbers of logs show before anybody says what they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd

    from calibkit.numeric.arrays import Array

_BLOCKS = 50
"""Parts of a log of which each column has a median."""
_COLDEST, _HOTTEST = -100.0, 250.0
"""Numbers that temperatures in °C stay between."""
_TURNED = 0.05
"""Change of a triad's components, of its length, from which it was turned and not only warmed."""
_NEAR_G = 0.1
"""Relative departure of the length of a triad from gravity."""
_QUARTER_DEG, _NEAR_DEG = 90.0, 1.0
_STANDING = 0.8
"""Least share of the rows of a tool in which it stands at a multiple of a quarter turn."""


@dataclass(frozen=True, slots=True)
class Glimpse:
    """Columns of logs by their own names: medians of parts of each log, [files · parts], and the
    rows of the first log; empty where logs are too large to be read for a guess.
    """

    medians: Mapping[str, Array]
    first: Mapping[str, Array]
    logs: int = 1
    """Number of logs."""

    @classmethod
    def of(cls, frame: pd.DataFrame) -> Glimpse:
        """What the numbers of one log show."""
        first = {str(name): frame[name].to_numpy(dtype=np.float64) for name in frame.columns}
        medians = {}
        for name, column in first.items():
            parts = [part[np.isfinite(part)] for part in np.array_split(column, _BLOCKS)]
            medians[name] = np.array([np.median(part) if part.size else np.nan for part in parts])
        return cls(medians, first)

    def joined_by(self, later: Glimpse) -> Glimpse:
        """What these logs and a later one show together."""
        if not self.logs:
            return later
        medians = {
            name: np.concatenate([column, later.medians[name]])
            for name, column in self.medians.items()
            if name in later.medians
        }
        return Glimpse(medians, self.first if later.first else {}, self.logs + later.logs)

    def span(self, name: str) -> float:
        """Range of a column over all logs, in its own unit; NaN where it is not known."""
        medians = self.medians.get(name, np.empty(0))
        medians = medians[np.isfinite(medians)]
        return float(np.ptp(medians)) if medians.size else float("nan")

    def swing(self, name: str) -> float:
        """The lesser of all that a column rises and all that it falls, in its own unit; NaN where
        that is not known.
        """
        medians = self.medians.get(name, np.empty(0))
        steps = np.diff(medians[np.isfinite(medians)])
        return float(min(steps[steps > 0].sum(), -steps[steps < 0].sum())) if steps.size else np.nan

    def is_like_degc(self, name: str) -> bool:
        """Whether the numbers of a column can be °C, as far as they are known."""
        medians = self.medians.get(name, np.empty(0))
        return bool(np.all((medians > _COLDEST) & (medians < _HOTTEST)))

    def is_turned(self, axes: Sequence[str]) -> bool | None:
        """Whether a triad of accelerometers was turned; None where its numbers are not known."""
        if not axes or not set(axes) <= self.medians.keys():
            return None
        parts = np.stack([self.medians[name] for name in axes])
        length = np.sqrt(np.nanmean(np.sum(parts**2, axis=0)))
        return bool(
            np.nanmax(np.nanmax(parts, axis=1) - np.nanmin(parts, axis=1)) > _TURNED * length
        )

    def is_gravity(self, axes: Sequence[str]) -> bool:
        """Whether a triad of accelerometers is that of gravity in m/s²."""
        length = np.sqrt(np.sum([self.medians[name] ** 2 for name in axes], axis=0))
        return bool(abs(np.nanmedian(length) / STANDARD_GRAVITY_MPS2 - 1.0) < _NEAR_G)

    def is_quartered(self, name: str) -> bool:
        """Whether a column of angles stands at three or more multiples of a quarter turn."""
        rows = self.first.get(name, np.empty(0))
        rows = rows[np.isfinite(rows)]
        if not rows.size:
            return False
        quarter = np.round(rows / _QUARTER_DEG)
        at_quarter_turn = np.abs(rows - quarter * _QUARTER_DEG) < _NEAR_DEG
        return bool(
            at_quarter_turn.mean() > _STANDING and np.unique(quarter[at_quarter_turn] % 4).size > 2
        )

    def is_counter(self, name: str) -> bool:
        """Whether a column numbers the rows, or stays as it is."""
        steps = np.diff(self.first.get(name, np.empty(0)))
        return bool(steps.size and (np.all(steps == 1.0) or np.all(steps == 0.0)))
