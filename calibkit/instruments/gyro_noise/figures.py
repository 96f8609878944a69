"""Figures of gyros at rest: deviations over averaging time with the noise terms, and the rate over
time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array


@dataclass(frozen=True, slots=True)
class NoiseView:
    """One record: Allan deviation with limits, fitted curve, wavelet deviation [°/h] over τ [s],
    terms, means over time.
    """

    name: str
    tau: Array
    deviation: Array
    lower: Array
    upper: Array
    model: Array
    wavelet: str
    wavelet_tau: Array
    wavelet_deviation: Array
    terms: tuple[tuple[str, Array], ...]
    """Label and share [m, °/h] in the deviation of every term that is observable."""
    hours: Array
    means: Array
    block_s: float


def record_page(title: str, view: NoiseView) -> Figure:
    """Deviations and terms above, the rate over time below."""
    figure, axes = page(2, 1, title=f"{title}: noise of {view.name}", height=8.5)
    _deviations(axes[0], view)
    axes[1].plot(view.hours, view.means, color=DENOISED, lw=0.8)
    axes[1].set(
        xlabel="time [h]",
        ylabel="rate [°/h]",
        title=f"means of {view.block_s:g} s; gaps are left open",
    )
    return figure


def _deviations(ax: Axes, view: NoiseView) -> None:
    """Allan and wavelet deviation over averaging time."""
    ax.errorbar(
        view.tau,
        view.deviation,
        np.stack([view.deviation - view.lower, view.upper - view.deviation]),
        fmt="o",
        ms=4,
        capsize=3,
        color=INK,
        label="overlapping Allan deviation",
    )
    ax.plot(
        view.wavelet_tau,
        view.wavelet_deviation,
        "s",
        ms=4,
        mfc="none",
        color=ALERT,
        label=f"{view.wavelet} deviation",
    )
    ax.plot(view.tau, view.model, color=GOOD, label="noise terms together")
    for _, share in view.terms:
        ax.plot(view.tau, share, color=MUTED, ls="--", lw=0.8)
    shown = ", ".join(label for label, _ in view.terms) or "none"
    ax.set_xscale("log")
    ax.set_yscale("log")
    least = float(np.min(view.lower))
    ax.set_ylim(0.3 * least, 3.0 * float(np.max(view.upper)))
    ax.set(
        xlabel="averaging time τ [s]",
        ylabel="deviation [°/h]",
        title=f"dashed: noise terms that are observable: {shown}",
    )
    ax.legend(loc="best")
    ax.grid(visible=True, which="both", color=RAW, alpha=0.3, lw=0.4)
