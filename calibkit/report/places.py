"""Where the panels of a page stand: where a constrained layout of matplotlib would put them, with
every word measured once instead of six times.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import RendererBase
    from matplotlib.figure import Figure

    from calibkit.numeric.arrays import Array, Integers

_FIRST = (0.7, 0.5, 0.1, 0.3)
"""Margins [in] of a panel, left, bottom, right and top, at which its words are first measured."""
_PAD = 0.04167
"""Least distance [in] of words from the edge, and from another panel's."""
_BETWEEN = 0.01
"""Least distance of words from the middle between two panels, over the mean room of a panel."""
_MOST_TIMES = 3
"""Times that words are measured as long as the axes' marks change with the size of the panels."""


def arrange(figure: Figure, renderer: RendererBase) -> None:
    """Place the panels of a grid, rows of equal heights and columns of equal widths, so that no
    word leaves its own room.
    """
    panels = [ax for ax in figure.axes if ax.get_visible()]
    for ax in panels:
        for spine in ax.spines.values():
            # it would find and measure all marks again, whose labels stand further out
            spine.axis = None
    size = np.tile(figure.get_size_inches(), 2)
    top = _place_title(figure, renderer, _PAD / size[1])
    margins = np.tile(np.array(_FIRST) / size, (len(panels), 1))
    before = None
    for _ in range(_MOST_TIMES):
        _place(panels, margins, _PAD / size[:2], top)
        marks = [list(axis.get_majorticklocs()) for ax in panels for axis in (ax.xaxis, ax.yaxis)]
        if marks == before:
            break
        before = marks
        margins = np.array([_margins(ax, renderer) for ax in panels])


def _place_title(figure: Figure, renderer: RendererBase, pad: float) -> float:
    """Put a page's title at its upper edge; the part of the height that it takes."""
    for text in figure.texts:
        if text.get_text() and text.get_text() == figure.get_suptitle():
            text.set_y(1.0 - pad)
            return float(text.get_window_extent(renderer).height / figure.bbox.height + 2.0 * pad)
    return 0.0


def _margins(ax: Axes, renderer: RendererBase) -> Array:
    """How far words stand out of a panel: left, bottom, right and top, over the figure's size."""
    inner, tight_box = ax.bbox, ax.get_tightbbox(renderer, for_layout_only=True)
    outer = inner if tight_box is None else tight_box
    out = (inner.p0 - outer.p0, outer.p1 - inner.p1)
    figure = ax.get_figure()
    return np.concatenate(out) / np.tile(figure.bbox.size, 2)  # type: ignore[union-attr] # a panel has one


def _place(panels: list[Axes], margins: Array, pad: Array, top: float) -> None:
    """Place panels whose words take margins [n, 4] beside each, below the title of a page."""
    cells = [ax.get_subplotspec() for ax in panels]
    grid = cells[0].get_gridspec()  # type: ignore[union-attr] # every panel is of a grid
    row_index = np.array([c.rowspan.start for c in cells])  # type: ignore[union-attr]
    column_index = np.array([c.colspan.start for c in cells])  # type: ignore[union-attr]
    # margins are left, bottom, right, top: rows are spread from the top down, so top comes first
    rows = _spread(row_index, grid.nrows, 1.0 - top, margins[:, 3::-2], pad[1])
    columns = _spread(column_index, grid.ncols, 1.0, margins[:, ::2], pad[0])
    for ax, down, left in zip(panels, rows[0], columns[0], strict=True):
        ax.set_position((left, 1.0 - top - down - rows[1], columns[1], rows[1]))


def _spread(
    index: Integers, count: int, extent: float, words: Array, pad: float
) -> tuple[Array, float]:
    """Where equal panels begin in a row of `count` of them that fills the whole, and their size:
    for panels [n] by index and what their words take before and behind [n, 2].
    """
    gap = max(pad, _BETWEEN / count)
    margins = np.zeros((count, 2))
    np.maximum.at(margins, index, words)
    margins += gap
    margins[0, 0] += pad - gap
    margins[-1, 1] += pad - gap
    size = float(extent - margins.sum()) / count
    begin = np.cumsum(margins.sum(axis=1) + size) - margins[:, 1] - size
    return begin[index], size
