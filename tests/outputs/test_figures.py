"""Pages of figures: what is not searched for stands where matplotlib would have put it."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from calibkit.numeric.control import Control
from calibkit.report import control_charts, figures

pytestmark = pytest.mark.drawn


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
