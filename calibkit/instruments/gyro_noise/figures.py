"""Figures of sensors at rest: deviations over averaging time with the noise terms, and the
indication over time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.frame import share_unit
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page
from calibkit.units import known

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array
    from calibkit.instruments import Fitted
    from calibkit.numeric.noise.allan import DeviationCurve


@dataclass(frozen=True, slots=True)
class NoiseView:
    """One record: Allan and wavelet deviation with limits over τ [s], fitted curve, terms, means
    over time, in the printed unit given.
    """

    name: str
    unit: str
    curves: tuple[DeviationCurve, ...]
    model: Array
    terms: tuple[tuple[str, Array], ...]
    """Label and share [m] in the Allan deviation of every term that is observable."""
    hours: Array
    means: Array
    block_s: float


@dataclass(frozen=True, slots=True)
class NoiseReport:
    """All that the figures show."""

    views: tuple[NoiseView, ...]

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per averaging time of a record: Allan deviation, the
        noise terms together, in the record's unit, and how far it is from them relative to itself.
        """
        curves = [(view, view.curves[0]) for view in self.views]
        parts = {
            "record": [np.full(c.tau_s.size, view.name, dtype=object) for view, c in curves],
            "unit": [np.full(c.tau_s.size, known(view.unit), dtype=object) for view, c in curves],
            "tau_s": [curve.tau_s for _, curve in curves],
            "deviation": [curve.deviation for _, curve in curves],
            "model": [view.model for view, _ in curves],
            "residual": [curve.deviation / view.model - 1.0 for view, curve in curves],
        }
        units = share_unit(("deviation", "model"), (known(view.unit) for view in self.views))
        return {name: np.concatenate(columns) for name, columns in parts.items()} | {"units": units}


def record_page(title: str, view: NoiseView) -> Figure:
    """Deviations and terms above, the rate over time below."""
    figure, axes = page(2, 1, title=f"{title}: noise of {view.name}", height=8.5)
    _deviations(axes[0], view)
    axes[1].plot(view.hours, view.means, color=DENOISED, lw=0.8)
    axes[1].set(
        xlabel="time [h]",
        ylabel=f"indication [{view.unit}]",
        title=f"means of {view.block_s:g} s; gaps are left open",
    )
    return figure


def _deviations(ax: Axes, view: NoiseView) -> None:
    """Allan and wavelet deviation with their limits over averaging time."""
    styles = (("o", INK, INK), ("s", ALERT, "none"))
    for curve, (mark, colour, face) in zip(view.curves, styles, strict=True):
        ax.errorbar(
            curve.tau_s,
            curve.deviation,
            np.stack([curve.deviation - curve.lower, curve.upper - curve.deviation]),
            fmt=mark,
            ms=4,
            mfc=face,
            capsize=3,
            color=colour,
            label=f"{curve.estimator} deviation",
        )
    allan = view.curves[0]
    ax.plot(allan.tau_s, view.model, color=GOOD, label="noise terms together")
    for _, share in view.terms:
        ax.plot(allan.tau_s, share, color=MUTED, ls="--", lw=0.8)
    shown = ", ".join(label for label, _ in view.terms) or "none"
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(
        0.3 * min(float(np.min(curve.lower)) for curve in view.curves),
        3.0 * max(float(np.max(curve.upper)) for curve in view.curves),
    )
    ax.set(
        xlabel="averaging time τ [s]",
        ylabel=f"deviation [{view.unit}]",
        title=f"dashed: noise terms that are observable: {shown}",
    )
    ax.legend(loc="best")
    ax.grid(visible=True, which="both", color=RAW, alpha=0.3, lw=0.4)


def draw(title: str, fitted: Fitted[NoiseReport]) -> Drawn:
    """Figures and summary of a fit."""
    pages = tuple(record_page(title, view) for view in fitted.drawing.views)
    return Drawn(pages, fitted.summary)
