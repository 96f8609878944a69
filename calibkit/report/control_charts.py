"""Control charts of a fleet: one figure per key figure, one point per device, centre line, limits
and named outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.control import FEWEST
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.numeric.arrays import Array
    from calibkit.numeric.control import Control


MOST_NAMES = 40
"""Devices up to which each has its serial below the axis."""
MOST_NAMED = 12
"""Outliers up to which each has its serial beside its point."""
WINDOW = 2.0
"""Half of the drawn range, in distances of the limits from the centre line."""
LONGEST = 32
"""Letters of a serial that stand in a chart: the table has the whole."""


@dataclass(frozen=True, slots=True)
class ControlChart:
    """One key figure of the devices that have it, in the order of their serials."""

    name: str
    unit: str
    serials: tuple[str, ...]
    values: Array
    standard_uncertainties: Array
    """[n], in the unit of the values; 0 where none is stated."""
    control: Control
    acceptance: float
    """Acceptance limit that all these devices share; NaN where there is none."""
    units: int
    """Devices of the fleet, with this figure or without."""

    @property
    def explanation(self) -> str:
        """What σ is, or why no limits are drawn."""
        count = f"{len(self.serials)} of {self.units} devices"
        if self.control.sigma == 0.0:
            return f"{count}; more than half of the values are equal: none can be judged"
        if not math.isfinite(self.control.limit):
            return f"{count}; fewer than {FEWEST}: none can be judged"
        sigma = f"σ = {self.control.sigma:.4g} by median absolute deviation"
        if self.standard_uncertainties.any():
            return f"{count}; {sigma}; limits of a device of usual uncertainty"
        return f"{count}; {sigma}"

    def draw(self) -> Figure:
        """The chart; what stands far outside is drawn at the edge, so that others keep their
        spread.
        """
        figure, (ax,) = page(1, 1, title=self.name, height=4.5)
        control, count = self.control, len(self.serials)
        positions = np.arange(1, count + 1)
        low, high = (control.centre + WINDOW * (end - control.centre) for end in control.ends)
        drawn = np.clip(self.values, low, high)
        bars = np.where(drawn == self.values, 2.0 * self.standard_uncertainties, 0.0)
        ax.errorbar(positions, drawn, bars, fmt=".", ms=5, color=DENOISED, ecolor=MUTED, lw=0.8)
        outliers = list(control.outliers)
        ax.plot(positions[outliers], drawn[outliers], "o", ms=6, mfc="none", color=ALERT)
        for k in outliers[:MOST_NAMED]:
            left = k <= count // 2
            ax.annotate(
                f"{self._short(k)}: {self.values[k]:.6g}, z = {control.z[k]:.1f}",
                (k + 1, drawn[k]),
                xytext=(8 if left else -8, 0),
                textcoords="offset points",
                ha="left" if left else "right",
                va="center",
                color=ALERT,
            )
        ax.axhline(control.centre, color=GOOD, label=f"median {control.centre:.6g}")
        if math.isfinite(control.limit):
            for sign, end in zip("−+", control.ends, strict=True):
                label = f"z = {sign}{control.limit:.2f}: {end:.6g}"
                ax.axhline(end, color=ALERT, ls="--", label=label)
        if math.isfinite(self.acceptance):
            label = f"acceptance limit {self.acceptance:.6g}"
            ax.axhline(self.acceptance, color=INK, ls=":", label=label)
        labelled = range(0, count, -(-count // MOST_NAMES))
        names = [self._short(k) for k in labelled]
        ax.set_xticks([k + 1 for k in labelled], names, rotation=90, fontsize=7)
        ax.set_xlim(0.0, count + 1.0)
        ax.grid(visible=False, axis="x")
        ax.set(ylabel=self.unit, xlabel=self.explanation)
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return figure

    def _short(self, k: int) -> str:
        """Serial of a device as it stands in a chart."""
        serial = self.serials[k]
        return serial if len(serial) <= LONGEST else f"{serial[: LONGEST - 1]}…"
