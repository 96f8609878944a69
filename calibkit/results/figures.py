"""Figures of results: values ± U over a range of one input, a panel per result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import UsageError
from calibkit.report.figures import MUTED, SIDES, page, pdf, png, styled
from calibkit.results.evaluation import list_values
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.numeric.arrays import Array
    from calibkit.records.store import StoredRun
    from calibkit.results.evaluation import PointResult

SUFFIXES = (".pdf", ".png")
COLOURS = (SIDES["cooling"], SIDES["heating"], SIDES["both"], "#aa7700", "#7744aa", MUTED)
COLUMNS = 2


def require_suffix(suffix: str, suffixes: Sequence[str] = SUFFIXES) -> None:
    """Raise UsageError for a file of a kind that is not written."""
    if suffix.lower() not in suffixes:
        raise UsageError(
            f"a file ending in '{suffix}' is not written here",
            hint=f"name one ending in {' or '.join(suffixes)}",
        )


def render(figure: Figure, suffix: str) -> bytes:
    """A figure as PDF or PNG."""
    require_suffix(suffix)
    return png(figure) if suffix.lower() == ".png" else pdf([figure])


def write_values(
    run: StoredRun, values: Sequence[PointResult], ranges: Mapping[str, Array], suffix: str
) -> bytes:
    """Values as CSV, or as a figure: each result over the range of most points, a curve for each
    value of the other inputs, with a band ± U; outside the calibrated range dashed and without a
    band.
    """
    if suffix.lower() == ".csv":
        return list_values(values).to_csv().encode()
    if not ranges:
        raise UsageError("--out: one point is no figure", hint="give a --range, or a .csv file")
    abscissa = max(ranges, key=lambda column: ranges[column].size)
    panels: dict[str, list[PointResult]] = {}
    for value in values:
        panels.setdefault(value.quantity.key, []).append(value)
    with styled():
        figure, axes = page(
            -(-len(panels) // COLUMNS),
            min(COLUMNS, len(panels)),
            title=f"{run.name}, effective from {run.document['effective_from']}",
            height=0.8 + 3.6 * -(-len(panels) // COLUMNS),
        )
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        for ax, panel_values in zip(axes, panels.values(), strict=False):
            curves: dict[str, list[PointResult]] = {}
            for value in panel_values:
                other_inputs = {name: x for name, x in value.point.items() if name != abscissa}
                label = ", ".join(f"{name} {x:g}" for name, x in other_inputs.items())
                curves.setdefault(label, []).append(value)
            for colour, (label, curve) in zip(COLOURS * 2, curves.items(), strict=False):
                x = np.array([value.point[abscissa] for value in curve])
                y = np.array([value.result.value for value in curve])
                U = np.array([value.expanded for value in curve], dtype=np.float64)
                inside = np.where([bool(value.outside) for value in curve], np.nan, y)
                ax.plot(x, y, color=colour, lw=1.0, ls=":")
                draw_band(ax, x, inside, U, colour, "-", label)
            quantity = panel_values[0].quantity
            truncated = f" (first {len(COLOURS) * 2} of {len(curves)})" * (
                len(curves) > 2 * len(COLOURS)
            )
            ax.set_title(f"{quantity.key}: {quantity.words.en}, ± U{truncated}")
            unit = next((i.unit for i in quantity.inputs if i.column == abscissa), "1")
            ax.set_xlabel(f"{abscissa} [{unit_mark(unit) or 1}]")
            ax.set_ylabel(f"{quantity.name} [{unit_mark(quantity.unit) or 1}]")
            if any(curves) and len(curves) > 1:
                ax.legend()
        return render(figure, suffix)


def draw_band(ax: Axes, x: Array, y: Array, U: Array, colour: str, style: str, label: str) -> None:
    """A curve [n] with a band ± U [n], a single point with a bar."""
    if len(x) == 1:
        ax.errorbar(x, y, U, fmt="o" if style == "-" else "s", capsize=4, color=colour, label=label)
        return
    ax.plot(x, y, style, color=colour, lw=1.4, label=label)
    ax.fill_between(x, y - U, y + U, color=colour, alpha=0.18, lw=0.0)
