"""The run's page in a headless Chromium: nothing is asked of a network, nothing complains, figures
zoom and read.
"""

import itertools
import re

import pytest

from calibkit.report import figures
from conftest import ROOT
from outputs.browser import browser, found
from outputs.test_html import made

pytestmark = [
    pytest.mark.drawn,
    pytest.mark.skipif(found() is None, reason="no Chromium on this machine"),
]

SAMPLES = sorted((ROOT / "reports").glob("*.html"))
VIEW = "document.querySelector('.frame svg').getAttribute('viewBox').split(' ').map(Number)"
FRAME = (
    "(({left, top, width, height}) => [left, top, width, height])"
    "(document.querySelector('.frame svg').getBoundingClientRect())"
)
MARKERS = """[...document.querySelectorAll('.frame path[marker-mid]')].flatMap((path) => {
  const steps = path.getAttribute('d').match(/-?[\\d.]+/g).map(Number);
  let x = 0, y = 0;
  return steps.flatMap((step, k) => {
    if (k % 2 === 0) { x += step; return []; }
    y += step;
    const at = new DOMPoint(x, y).matrixTransform(path.getScreenCTM());
    return [[at.x, at.y]];
  });
})"""
"""Places of all marks: the corners of the paths that have one at each."""


@pytest.fixture(scope="module")
def chromium():
    """One browser for all."""
    with browser() as started:
        yield started


def spans():
    """A figure whose three panels have a linear, a logarithmic and a symmetric logarithmic axis,
    with a point in each.
    """
    with figures.styled():
        drawn, axes = figures.page(1, 3, title="spans", height=4.0)
        for ax, scale in zip(axes, ("linear", "log", "symlog"), strict=True):
            ax.plot([1.0, 40.0, 1000.0], [0.5, 7.0, 900.0], "o")
            ax.set(xlabel="x", ylabel="y")
            for side in ("x", "y"):
                getattr(ax, f"set_{side}scale")(
                    scale, **({"linthresh": 2.0} if scale == "symlog" else {})
                )
    return drawn


def opened(chromium, tmp_path, page, **options):
    """Open a page and scroll to its first figure."""
    path = tmp_path / "report.html"
    path.write_bytes(page)
    chromium.open(path, **options)
    chromium.value("document.querySelector('.frame').scrollIntoView({block: 'center'})")
    return path


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_a_sample_report_opens_without_a_word_and_without_a_network(chromium, path):
    """Wide, narrow and dark: no error, no warning, no request, every figure seen, nothing wider
    than the window.
    """
    for options in ({}, {"width": 390, "height": 844, "phone": True}, {"dark": True}):
        chromium.open(path, **options)
        assert chromium.said() == []
        assert chromium.requests() == [path.resolve().as_uri()]
        assert chromium.value("document.documentElement.scrollWidth <= innerWidth")
        sizes = chromium.value(
            "[...document.querySelectorAll('.frame svg')].map((svg) => svg.getBBox().width *"
            " svg.clientHeight)"
        )
        assert sizes
        assert min(sizes) > 1e4


@pytest.mark.slow
def test_figures_zoom_by_wheel_button_and_key_and_come_back(chromium, tmp_path):
    """The point under the pointer stays there; drag moves; double click fills a panel and gives the
    whole back.
    """
    opened(chromium, tmp_path, made("plain", drawings=(spans(),)))
    whole = chromium.value(VIEW)
    left, top, width, height = chromium.value(FRAME)
    x, y = left + 0.3 * width, top + 0.4 * height
    chromium.mouse("mouseWheel", x, y, deltaX=0, deltaY=-120)
    assert (
        chromium.value(VIEW) == whole
    )  # the wheel scrolls the page until the figure has the focus
    chromium.value("document.querySelector('.frame').focus()")
    chromium.value("document.querySelector('.frame').scrollIntoView({block: 'center'})")
    left, top, width, height = chromium.value(FRAME)
    x, y = left + 0.3 * width, top + 0.4 * height
    chromium.mouse("mouseWheel", x, y, deltaX=0, deltaY=-120)
    near = chromium.value(VIEW)
    assert near[2] < 0.8 * whole[2]
    assert near[0] + 0.3 * near[2] == pytest.approx(whole[0] + 0.3 * whole[2], abs=0.5)
    chromium.mouse("mousePressed", x, y, button="left", clickCount=1)
    for step in (20, 40):
        chromium.mouse("mouseMoved", x - step, y, button="left", buttons=1)
    chromium.mouse("mouseReleased", x - 40, y, button="left", clickCount=1)
    moved = chromium.value(VIEW)
    assert moved[0] - near[0] == pytest.approx(40.0 / width * near[2], abs=1.0)
    chromium.key("0")
    assert chromium.value(VIEW) == whole
    chromium.key("2")
    assert whole[2] / 5.0 < chromium.value(VIEW)[2] < whole[2] / 1.5
    chromium.key("Escape")
    chromium.value("document.querySelectorAll('.tools button')[1].click()")
    assert chromium.value(VIEW)[2] == pytest.approx(whole[2] / 1.6, rel=1e-3)
    for count in (1, 2):
        chromium.mouse("mousePressed", x, y, button="left", clickCount=count)
        chromium.mouse("mouseReleased", x, y, button="left", clickCount=count)
    assert chromium.value(VIEW) == whole
    assert chromium.said() == []


@pytest.mark.slow
def test_the_reading_at_the_pointer_is_that_of_the_axes(chromium, tmp_path):
    """On each point of three panels the page reads its coordinates to a pixel: 1 % of a decade, 0.3
    % of a linear axis.
    """
    opened(chromium, tmp_path, made("plain", drawings=(spans(),)))
    dots = chromium.value(MARKERS)
    assert len(dots) == 9
    for (x, y), (panel, value) in zip(
        dots, itertools.product(range(3), ((1.0, 0.5), (40.0, 7.0), (1000.0, 900.0))), strict=True
    ):
        chromium.mouse("mouseMoved", x, y)
        said = chromium.value("document.querySelector('.reading').textContent")
        read = [float(found.replace("−", "-")) for found in re.findall(r"[xy] (-?[\d.]+)", said)]
        tolerance = {"rel": 0.0, "abs": 8.0} if panel == 0 else {"rel": 0.04, "abs": 0.05}
        assert read == pytest.approx(value, **tolerance)
    chromium.mouse("mouseMoved", 2, 2)
    assert chromium.value("document.querySelector('.reading').textContent") == ""
