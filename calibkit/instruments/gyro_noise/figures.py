"""Figures of sensors at rest: deviations over averaging time with the noise terms, and the
indication over time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.words import unit_mark
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.frame import share_unit
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page
from calibkit.units import known

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calibkit.instruments import Fitted
    from calibkit.instruments.gyro_noise.deviations import NoiseFigures


@dataclass(frozen=True, slots=True)
class NoiseReport:
    """All that the figures show."""

    records: tuple[NoiseFigures, ...]

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per averaging time of a record: Allan deviation, the
        noise terms together, in the record's unit, and how far it is from them relative to them.
        """
        parts: dict[str, list[Any]] = {}
        units = [known(unit_mark(noise.sensor.unit)) for noise in self.records]
        for noise, unit in zip(self.records, units, strict=True):
            curve, model = noise.curve, noise.terms.model
            columns = {
                "record": np.full(curve.tau_s.size, noise.name, dtype=object),
                "unit": np.full(curve.tau_s.size, unit, dtype=object),
                "tau_s": curve.tau_s,
                "deviation": curve.deviation,
                "model": model,
                "residual": curve.deviation / model - 1.0,
            }
            for name, column in columns.items():
                parts.setdefault(name, []).append(column)
        shared = share_unit(("deviation", "model"), units)
        return {name: np.concatenate(columns) for name, columns in parts.items()} | {
            "units": shared
        }


def _deviations(ax: Axes, noise: NoiseFigures, unit: str) -> None:
    """Allan and wavelet deviation with their limits over averaging time, and what each noise term
    makes alone.
    """
    curves = ((noise.curve, "o", INK, INK), (noise.wavelet, "s", ALERT, "none"))
    for curve, mark, colour, face in curves:
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
    tau, labels = noise.curve.tau_s, []
    ax.plot(tau, noise.terms.model, color=GOOD, label="noise terms together")
    laws = {law.name: law for law in noise.sensor.laws}
    for term in noise.terms.terms:
        law = laws[term.name]
        of_term = term.value / law.scale * tau ** (law.exponent / 2.0)
        ax.plot(tau, of_term, color=MUTED, ls="--", lw=0.8)
        labels.append(f"{term.symbol} {term.value:.3g} {unit_mark(term.unit)}")
    ax.set_xscale("log")
    ax.set_yscale("log")
    lowest_limit = min(float(np.min(curve.lower)) for curve, *_ in curves)
    highest_limit = max(float(np.max(curve.upper)) for curve, *_ in curves)
    ax.set_ylim(0.3 * lowest_limit, 3.0 * highest_limit)
    ax.set(
        xlabel="averaging time τ [s]",
        ylabel=f"deviation [{unit}]",
        title=f"dashed: noise terms that are observable: {', '.join(labels) or 'none'}",
    )
    ax.legend(loc="best")
    ax.grid(visible=True, which="both", color=RAW, alpha=0.3, lw=0.4)


def draw(title: str, fitted: Fitted[NoiseReport]) -> Drawn:
    """Figures and summary of a fit: of each record deviations and terms above, the rate over time
    below.
    """
    pages = []
    for noise in fitted.drawing.records:
        unit = unit_mark(noise.sensor.unit)
        figure, axes = page(2, 1, title=f"{title}: noise of {noise.name}", height=8.5)
        _deviations(axes[0], noise, unit)
        block_s = noise.block * noise.curve.interval_s
        hours = (np.arange(noise.block_means.size) + 0.5) * (block_s / SECONDS_PER_HOUR)
        axes[1].plot(hours, noise.block_means, color=DENOISED, lw=0.8)
        axes[1].set(
            xlabel="time [h]",
            ylabel=f"indication [{unit}]",
            title=f"means of {block_s:g} s; gaps are left open",
        )
        pages.append(figure)
    return Drawn(tuple(pages), fitted.summary)
