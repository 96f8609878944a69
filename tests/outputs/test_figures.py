"""Pages of figures: what is not searched for stands where matplotlib would have put it."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from calibkit.numeric.control import Control
from calibkit.report import control_charts, figures, svg

pytestmark = pytest.mark.drawn


def two_panels(factor=1.0, *, named=True):
    """A page with titles, a legend within a panel, and values whose size decides whether their axis
    has a common factor.
    """
    figure, axes = figures.page(1, 2, title="U1 r001: bias")
    with figures.styled():
        for ax in axes:
            ax.plot([0.0, 1.0, 2.0], [0.0, 1.1 * factor, 1.9 * factor], label="bias")
            ax.set(title="gyro")
            if named:
                ax.set(xlabel="time [s]", ylabel="rate [°/h]")
        axes[0].set_title("in red", fontsize=8, color=figures.ALERT, loc="right")
        axes[1].legend(loc="best")
    return figure


@pytest.mark.parametrize(("factor", "named"), [(1.0, True), (1.0, False), (1e-7, True)])
def test_panels_stand_where_a_constrained_layout_puts_them_and_are_measured_once(
    monkeypatch, factor, named
):
    """To 2 pt, which are the hints of the fonts of a screen; each panel's words are measured
    once.
    """
    searched, placed = (two_panels(factor, named=named) for _ in range(2))
    FigureCanvasAgg(searched).draw()
    measured, measure = [], Axes.get_tightbbox

    def counted(ax, *given, **named_ones):
        measured.append(ax)
        return measure(ax, *given, **named_ones)

    monkeypatch.setattr(Axes, "get_tightbbox", counted)
    figures.settle([placed])
    svg.inline([placed])
    assert measured == placed.axes
    points = np.tile(placed.get_size_inches(), 2) * 72.0
    for one, other in zip(placed.axes, searched.axes, strict=True):
        moved = (one.get_position().extents - other.get_position().extents) * points
        assert np.all(np.abs(moved) < 2.0), moved


CHARTS = {
    "plain": (60, 1.0, 0.0, np.nan, "U{:04d}"),
    "small": (200, 1e-7, 3e-6, 4e-6, "FOG-2026-{:05d}"),
    "long": (12, 1e3, -123456.789, np.nan, "S" * 95 + "{:05d}"),
    "near": (12, 1e-9, 1.0, np.nan, "A{}"),
    "few": (3, 1.0, 0.0, np.nan, "B{}"),
}


@pytest.mark.parametrize("name", CHARTS)
def test_every_word_of_a_control_chart_is_on_its_page_and_beside_the_others(name):
    """Whatever its serials and values look like, no word of a chart with an outlier leaves the page
    or its margin.
    """
    units, scale, middle, limit, serial = CHARTS[name]
    values = middle + scale * np.random.default_rng(0).normal(size=units)
    values[units // 2] += 30.0 * scale
    chart = control_charts.ControlChart(
        name="bias.gyro_dph.p0",
        unit="deg/h",
        serials=tuple(serial.format(k) for k in range(units)),
        values=values,
        standard_uncertainties=np.full(units, 0.1 * scale),
        control=Control.chart(values),
        acceptance=limit,
        units=units,
    )
    figure = chart.draw()
    figures.settle([figure])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (ax,) = figure.axes
    low, high = ax.get_ylim()
    unseen = [label for label in ax.get_yticklabels() if not low <= label.get_position()[1] <= high]
    boxes = {
        text: text.get_window_extent()
        for text in figure.findobj(Text)
        if text.get_text() and text.get_visible() and text not in unseen
    }
    page = figure.bbox
    for text, box in boxes.items():
        # a point are the hints of the fonts of a screen
        assert page.x0 - 1.0 <= box.x0 <= box.x1 <= page.x1 + 1.0, text
        assert page.y0 - 1.0 <= box.y0 <= box.y1 <= page.y1 + 1.0, text
    labels = [boxes[label] for label in ax.get_xticklabels()]
    assert boxes[ax.xaxis.label].y1 <= min(box.y0 for box in labels)
    drawn = [boxes[label].x0 for label in ax.get_yticklabels() if label in boxes]
    assert boxes[ax.yaxis.label].x1 <= min(drawn)
    assert ax.get_position().height > 0.3
