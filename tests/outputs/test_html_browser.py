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
    for options in ({}, {"width": 390, "height": 844}, {"dark": True}):
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
