"""The run's page in a headless Chromium: nothing is asked of a network, nothing complains, figures
zoom and read.
"""

import itertools
import re
import shutil

import numpy as np
import pytest

from calibkit.report import figures
from conftest import ROOT
from outputs.browser import browser, found
from outputs.test_html import figure, made

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


def test_texts_that_are_scripts_are_not_run(chromium, tmp_path):
    """A page whose every text is a script and a broken image runs neither and asks for no image."""
    path = opened(chromium, tmp_path, made(drawings=(figure(),)))
    assert chromium.said() == []
    assert chromium.requests() == [path.resolve().as_uri()]
    assert chromium.value("document.images.length") == 0


@pytest.mark.slow
def test_the_policy_of_the_page_stops_what_was_put_into_it(chromium, tmp_path):
    """A script, a style, a handler and an image that someone adds to a page do nothing, and the
    browser says why.
    """
    added = (
        '<script>window.mine=1</script><p style="color:red" onclick="1">x</p><img'
        ' src="http://192.0.2.1/x.png">'
    )
    opened(
        chromium,
        tmp_path,
        made("plain", drawings=(figure("a"),)).replace(b"</main>", f"</main>{added}".encode()),
    )
    assert chromium.value("window.mine === undefined")
    assert len(chromium.said()) >= 3
    assert not any(
        "finished" in str(event) for event in chromium.events if "192.0.2.1" in str(event)
    )


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
def test_the_strongest_zoom_has_an_end_and_stays_inside(chromium, tmp_path):
    """A hundred times + and every arrow: a fortieth of the figure is shown, and no more than the
    figure.
    """
    opened(chromium, tmp_path, made("plain", drawings=(figure("a"),)))
    whole = chromium.value(VIEW)
    chromium.value("document.querySelector('.frame').focus()")
    keys = (
        "[...Array(20).fill('+'), ...Array(200).fill('ArrowRight'),"
        " ...Array(200).fill('ArrowDown')]"
    )
    chromium.value(
        f"{keys}.forEach((key) => document.activeElement.dispatchEvent(new KeyboardEvent('keydown',"
        " {key})))"
    )
    x, y, width, height = chromium.value(VIEW)
    assert width == pytest.approx(whole[2] / 40.0, rel=1e-3)
    assert x + width == pytest.approx(whole[2], rel=0.02)
    assert y + height == pytest.approx(whole[3], rel=0.02)


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


@pytest.mark.slow
def test_two_fingers_zoom_and_one_moves_on_a_touch_screen(chromium, tmp_path):
    """Two fingers twice as far apart show half of the figure."""
    opened(
        chromium, tmp_path, made("plain", drawings=(spans(),)), width=390, height=844, phone=True
    )
    whole = chromium.value(VIEW)
    left, top, width, height = chromium.value(FRAME)
    x, y = left + width / 2, top + height / 2

    def touch(kind, *spots):
        chromium.call(
            "Input.dispatchTouchEvent",
            type=kind,
            touchPoints=[{"x": a, "y": b, "id": k} for k, (a, b) in enumerate(spots)],
        )

    touch("touchStart", (x - 40, y))
    touch("touchStart", (x - 40, y), (x + 40, y))
    for half in (50, 60, 70, 80):
        touch("touchMove", (x - half, y), (x + half, y))
    touch("touchEnd")
    assert chromium.value(VIEW)[2] == pytest.approx(whole[2] / 2.0, rel=0.1)
    assert chromium.said() == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext on this machine")
def test_a_rejected_run_says_so_on_every_printed_sheet(chromium, tmp_path):
    """The print holds everything, what is folded up too, and each sheet begins with REJECTED."""
    import subprocess

    text = "\n".join(f"line {k} of a long recipe" for k in range(200))
    opened(
        chromium,
        tmp_path,
        made("plain", accepted=False, drawings=(figure("a"),)).replace(
            b"<pre>plain", f"<pre>{text}".encode()
        ),
    )
    printed = tmp_path / "page.pdf"
    printed.write_bytes(chromium.pdf())
    sheets = (
        subprocess.run(["pdftotext", "-layout", printed, "-"], capture_output=True, check=True)
        .stdout.decode()
        .split("\f")[:-1]
    )
    assert len(sheets) > 3
    assert all(sheet.strip().startswith("REJECTED") for sheet in sheets)
    assert "line 199 of a long recipe" in sheets[-1]


@pytest.mark.slow
def test_dark_and_light_letters_can_be_read(chromium, tmp_path):
    """Text has a contrast of at least 4.5 to its ground, in both themes, in tables, bands and
    figures.
    """
    from_page = (
        "[...document.querySelectorAll('p, td, th, h1, h2, a, li, caption, figcaption, button, svg"
        " text')].map((e) => {let g = e; while (g && /rgba\\(0, 0, 0,"
        " 0\\)/.test(getComputedStyle(g).backgroundColor)) g = g.parentElement;const s ="
        " getComputedStyle(e);return [e.tagName === 'text' ? s.fill : s.color, getComputedStyle(g"
        " || document.body).backgroundColor, e.tagName]})"
    )
    for dark, accepted in itertools.product((False, True), (False, True)):
        opened(
            chromium, tmp_path, made("plain", accepted=accepted, drawings=(figure("a"),)), dark=dark
        )
        for ink, ground, tag in chromium.value(from_page):
            first, second = sorted((luminance(ink), luminance(ground)))
            assert (second + 0.05) / (first + 0.05) >= 4.5, (tag, ink, ground, dark)


def luminance(colour):
    """Relative luminance of rgb(…) after WCAG."""
    parts = np.array([float(part) for part in re.findall(r"[\d.]+", colour)[:3]]) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.slow
@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_the_first_screen_holds_verdict_picture_values_and_what_to_check(chromium, path):
    """In a window of 1280 × 900 all of it is seen without a scroll, one picture, everything else
    folded; on a telephone the verdict and the picture come first; on paper nothing is folded.
    """
    top = "document.querySelector('{}').getBoundingClientRect().top"
    bottom = "document.querySelector('{}').getBoundingClientRect().bottom"
    chromium.open(path)
    assert chromium.value(bottom.format("#band")) < 200
    assert chromium.value(bottom.format("#first .lead")) < 260
    assert chromium.value(bottom.format("#first svg")) < 900
    assert chromium.value(bottom.format("#first dl")) < 900
    assert chromium.value(top.format("#first .beside > :last-child")) < 900
    assert chromium.value("document.querySelectorAll('#first svg').length") == 1
    assert chromium.value("document.querySelectorAll('details[open]').length") == 0
    chromium.open(path, width=390, height=844, phone=True)
    assert chromium.value(top.format("#first svg")) < 500
    assert chromium.value(top.format("#first svg")) < chromium.value(top.format("#first dl"))


def test_every_sample_has_the_picture_of_its_first_screen():
    """`reports/screens.py` kept one per sample, of 1280 × 900 pixels."""
    names = {path.stem for path in (ROOT / "reports").glob("*.txt")}
    pictures = {path.stem: path.read_bytes() for path in (ROOT / "reports/screens").glob("*.png")}
    assert set(pictures) == names
    for content in pictures.values():
        size = [int.from_bytes(content[at : at + 4], "big") for at in (16, 20)]
        assert size == [1280, 900]
