"""The run's page: whole HTML that loads nothing, with every text escaped and every number the
coefficient file's.
"""

import base64
import dataclasses
import hashlib
import itertools
import json
import re

import html5lib
import numpy as np
import pytest
from matplotlib.lines import Line2D

from calibkit.records import store
from calibkit.records.coefficients import (
    Coefficient,
    Condition,
    Criterion,
    Identity,
    Input,
    StageResult,
)
from calibkit.report import figures, page as pages, svg
from calibkit.report.run import EXACT, Shown, compose_page, quantity_table
from calibkit.report.summary import Summary
from calibkit.report.table import Table
from conftest import ROOT
from kept import model

pytestmark = pytest.mark.drawn

HOSTILE = (
    "<script>alert(1)</script> & \"x\" 'y' ]]> --> </style><img src=x onerror=alert(2)> $_$ 温"
    " \u202e\x00\x1b\ud800"
)
"""What a log, a flag or a recipe may hold and a page must only show."""
SHOWN = (
    HOSTILE.replace("\u202e", "\\u202e")
    .replace("\x00", "\\u0000")
    .replace("\x1b", "\\u001b")
    .replace("\ud800", "\\ud800")
)

NAME = "".join(letter for letter in HOSTILE if letter.isprintable() and letter.isascii())
"""As much of it as a font has letters for."""


def figure(title=NAME):
    """A figure of one curve with hostile names."""
    with figures.styled():
        made, (ax,) = figures.page(1, 1, title=title)
        ax.plot([0.0, 1.0, 2.0], [1.0, 3.0, 2.0], label=title)
        ax.set(title=title, xlabel=title, ylabel="rate [°/h]")
        ax.legend()
    return made


def composed(text=HOSTILE, *, accepted=True, drawings=(), excluded=()):
    """Report of a made-up run whose every text is the same, and what its page keeps."""
    found = model(
        {text: (0.1 + 0.2, text, 1.0 / 3.0), "K1": (-1e-300, "1", 0.0)},
        name=text,
        parameters=[(text, 5.0, text)],
    )
    result = StageResult(
        "gyro_scale",
        (found,),
        (Coefficient(text, 2.0 / 3.0, text, 0.0),),
        (text,),
        (Condition(text, 1.5, text),),
    )
    inputs = (Input(text, "ab" * 32, 7, (text,)),)
    records = {
        "gyro_scale.json": result.as_record(
            Identity("S-1", 1, "2026-11-21", text, "00", inputs), text
        )
    }
    document = {
        "serial": "S-1",
        "revision": 1,
        "procedure": text,
        "effective_from": "2026-11-21",
        "software": text,
        "python": "3",
        "libraries": {text: text},
        "recipe": {"name": text, "sha256": "00", "overrides": [text], "text": text},
        "inputs": [{"name": text, "sha256": "ab" * 32, "rows": 7, "reading": [text]}],
        "excluded": [{"log": text, "reason": text, "person": text}] if excluded else [],
        "corrections": [{"certificate": text}],
        "type_b": [{"name": text}],
        "verdict": "accepted" if accepted else "rejected",
        "accepted": accepted,
        "acceptance": [
            {"name": text, "value": 2.0, "limit": 1.0, "unit": text, "passed": accepted}
        ],
        "uncertainty": [
            {"result": text, "unit": text, "value": 1.0, "components": [], "effective_dof": None}
        ],
        "flags": [text],
        "files": [{"name": "gyro_scale.json", "sha256": "cd" * 32}],
    }
    criteria = (Criterion(text, 2.0, 1.0, text, accepted),)
    summary = Summary(text, (Table(text, (text, text, "u"), ((text, text),)),), (text,), criteria)
    figures.settle(drawings)
    drawn, thinned = svg.inline(drawings)
    shown = Shown(
        text,
        summary.last_line,
        tables=summary.tables,
        checks=tuple(summary.checks),
        captions=tuple(drawing.get_suptitle() for drawing in drawings),
        thinned=thinned,
        exported=("gyro_scale.json",),
        measured=text,
    )
    return compose_page(document, records, shown, drawn), shown


def made(text=HOSTILE, **options):
    """Page of a made-up run whose every text is the same."""
    return pages.render(*composed(text, **options))


def tree(page):
    """Parsed page; the strict parser raises for anything that is not HTML as it should be."""
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page.decode())


def words(element):
    """Text of an element."""
    return "".join(element.itertext())


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Fit the sample record of noise twice, under a hostile name and with a limit that fails;
    return both run folders.
    """
    from calibkit import recipe
    from calibkit.commands import pipeline
    from calibkit.instruments import silent

    folder = tmp_path_factory.mktemp("noise")
    name = "<b>$_$ & 'x'.csv"
    content = (ROOT / "datasets" / "gyro_noise" / "static.csv").read_bytes()
    (folder / name).write_bytes(content)
    source = recipe.find("gyro_noise", ("acceptance.max_angle_random_walk=1e-5",))
    return [
        pipeline.fit(source, folder, "S-1", folder / runs, "2026-11-21", silent).run.folder
        for runs in ("first", "second")
    ]


@pytest.mark.parametrize("accepted", [True, False])
def test_a_page_of_hostile_texts_is_whole_html_and_runs_nothing_but_its_own_script(accepted):
    """Every text of a run is a script, a closing tag, a control character: all are shown, none is a
    tag.
    """
    drawn = figure()
    page = tree(made(accepted=accepted, drawings=(drawn,), excluded=True))
    scripts = [script.attrib for script in page.findall(".//script")]
    assert scripts == [{"type": "application/json"}, {}]
    assert len(page.findall(".//style")) == 1
    assert page.findall(".//img") == page.findall(".//iframe") == page.findall(".//link") == []
    assert words(page.find(".//pre")) == SHOWN
    assert words(page).count(SHOWN) > 30
    assert [
        name
        for element in page.iter()
        for name in element.attrib
        if name.startswith("on") or name == "style"
    ] == []


def test_a_page_asks_nothing_of_any_network():
    """The policy allows the page's own style and script by their digests and nothing else; no
    address stands in it.
    """
    text = made("plain", drawings=(figure("plain"),)).decode()
    page = tree(text.encode())
    policy = page.find(".//meta[@http-equiv='Content-Security-Policy']").attrib["content"]
    for tag in ("style", "script"):
        content = words(page.findall(f".//{tag}")[-1])
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}';" in policy
    assert policy.startswith("default-src 'none';")
    assert re.findall(r"https?:|//[a-z]|@import|javascript:|data:[a-z]", text) == []
    links = [
        value
        for element in page.iter()
        for name, value in element.attrib.items()
        if name.endswith(("href", "src"))
    ]
    assert links
    assert all(link.startswith("#") for link in links)


def test_every_reference_of_a_page_has_its_one_target():
    """Ids of several figures do not meet, and each link and clip path finds what it names."""
    drawn = (figure("one"), figure("two"))
    page = tree(made("plain", drawings=drawn))
    ids = [element.attrib["id"] for element in page.iter() if "id" in element.attrib]
    assert len(ids) == len(set(ids))
    text = made("plain", drawings=(figure("one"), figure("two"))).decode()
    named = set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)|labelledby="([^"]+)"', text))
    assert {part for parts in named for part in parts if part} <= set(ids)
    assert any("f2-" in key for key in ids)


def test_the_page_is_made_for_those_who_do_not_see_it():
    """Headings go down by one, tables have captions and scoped heads, figures have names, sections
    have headings.
    """
    page = tree(made("plain", drawings=(figure("a curve"),)))
    levels = [
        int(element.tag[1]) for element in page.iter() if re.fullmatch("h[1-6]", str(element.tag))
    ]
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    for table in page.findall(".//table"):
        assert words(table.find("caption")).strip()
        assert {element.attrib.get("scope") for element in table.findall(".//th")} <= {
            "col",
            "row",
            "rowgroup",
        }
        rows = [
            sum(int(cell.attrib.get("colspan", 1)) for cell in row)
            for row in table.findall(".//tr")
        ]
        assert len(set(rows)) == 1
    frame = page.find(".//div[@class='frame']")
    assert "a curve" in frame.attrib["aria-label"]
    assert frame.attrib["tabindex"] == "0"
    assert page.attrib["lang"] == "en"


def test_a_rejected_run_says_so_first_and_everywhere():
    """Title, band, limit, coefficients and every printed sheet; an accepted one nowhere."""
    rejected = made("plain", accepted=False, drawings=(figure("a"),)).decode()
    page = tree(rejected.encode())
    assert words(page.find(".//title")).startswith("REJECTED: ")
    assert words(page.find(".//p[@id='band']")).startswith("REJECTED: plain 2 plain (limit: ")
    assert "No firmware: the run is rejected" in rejected
    assert "Firmware takes" not in rejected
    assert page.find(".//p[@id='band']").attrib["class"] == "band rejected"
    assert words(page.find(".//tr[@class='failed']")).endswith("FAILED")
    assert words(page.find(".//figcaption")).startswith("REJECTED. ")
    assert 'content:"REJECTED"' in words(page.find(".//style"))
    assert "REJECTED" not in made("plain", drawings=(figure("a"),)).decode()


def numbers(page, caption):
    """Exact numbers of the rows of tables whose captions begin so: name, value, u, unit."""
    rows = [
        row
        for table in page.findall(".//table")
        if words(table.find("caption")).startswith(caption)
        for row in table.findall("./tbody/tr")
    ]

    def exact(cell):
        rounded = cell.find("data")
        return float(words(cell) if rounded is None else rounded.attrib["value"])

    return [(words(row[0]), exact(row[1]), exact(row[2]), words(row[3])) for row in rows]


def test_every_number_of_the_tables_is_that_of_the_coefficient_file(fitted):
    """Coefficients, figures and conditions to the last bit, in the file's units; values are printed
    with every digit.
    """
    run = store.load(fitted[0])
    page = tree((fitted[0] / "report.html").read_bytes())
    assert run.records
    for name, found in run.records.items():
        tables = {f"{found.stage}: {each.name} (": each.coefficients for each in found.models}
        for caption, entries in (tables | {f"Figures of {name}": found.figures}).items():
            assert numbers(page, caption) == [
                (*dataclasses.astuple(entry)[:2], entry.standard_uncertainty, entry.unit)
                for entry in entries
            ]
    for value in page.findall(
        ".//section[@aria-labelledby='coefficients']//td[@class='number']/data"
    ):
        shown, exact = words(value), float(value.attrib["value"])
        assert (
            float(shown) == pytest.approx(exact, rel=5e-3)
            if shown != "not stated"
            else exact == 0.0
        )
    digests = words(page.find(".//section[@aria-labelledby='logs']"))
    assert run.document["inputs"][0]["sha256"] in digests
    assert str(run.document["inputs"][0]["rows"]) in digests


def test_a_made_up_coefficient_keeps_its_last_bit():
    """0.1 + 0.2 is printed 0.30000000000000004, with its uncertainty's every bit beside the three
    digits.
    """
    found = numbers(tree(made("plain")), "gyro_scale: plain (")
    assert found == [("plain", 0.1 + 0.2, 1.0 / 3.0, "plain"), ("K1", -1e-300, 0.0, "1")]
    assert ">0.30000000000000004</td>" in made("plain").decode()


def test_a_number_of_numpy_stands_on_the_page_as_every_other_number():
    """A figure that a fit left as numpy's float64 was printed as "np.float64(0.3)"."""
    one = np.float64(0.1) + np.float64(0.2)
    quantity = Coefficient("drift_rms", one, "deg/h", 0.0)
    table = quantity_table("figures", [quantity], head="figure", digits=EXACT)
    assert ">0.30000000000000004</td>" in str(pages.summary_table(table))


def test_the_same_logs_give_the_same_page_and_verify_covers_it(fitted, calibkit):
    """Two fits write the same bytes; run.json lists the page, and a changed
    page is no run any more.
    """
    first, second = (folder / "report.html" for folder in fitted)
    assert first.read_bytes() == second.read_bytes()
    assert str(fitted[0].parents[2]).encode() not in first.read_bytes()
    listed = {
        entry["name"]
        for entry in json.loads((fitted[1] / "run.json").read_text(encoding="utf-8"))["files"]
    }
    assert {"report.html", "report.txt"} < listed
    assert calibkit("verify", fitted[1]).code == 0
    second.write_bytes(second.read_bytes().replace(b"REJECTED", b"accepted"))
    outcome = calibkit("verify", fitted[1])
    assert (outcome.code, "report.html" in outcome.err) == (4, True)


def test_a_log_name_with_two_dollars_is_no_formula(fitted):
    """The record was called <b>$_$ & 'x': its name is in the figure as it is."""
    page = tree((fitted[0] / "report.html").read_bytes())
    assert "S-1 r001: noise of <b>$_$ & 'x'" in words(page.find(".//figure"))


def test_a_chinese_name_is_drawn_without_a_word_on_the_console(capfd):
    """Page and PDF of a log called 温度: no warning about letters, fonts or weights; the page holds
    the name as text.
    """
    drawn = figure("温度 ±5")
    figures.settle((drawn,))
    assert "温度 ±5" in svg.inline((drawn,))[0][0]
    assert capfd.readouterr() == ("", "")


def test_long_curves_keep_their_extremes_and_their_gaps():
    """A spike of one point in a million, the ends, and a gap are there after thinning; a short
    curve is drawn whole.
    """
    rng = np.random.default_rng(1)
    x, y = np.arange(1e6), rng.normal(size=1_000_000)
    y[123_456], y[777_777] = 60.0, -50.0
    y[500_000:500_010] = np.nan
    kept = svg._extremes(x, y, 4000)
    assert kept.size < 4100
    assert {0, 123_456, 777_777, 999_999} <= set(kept.tolist())
    assert np.isnan(y[kept]).any()
    loop = svg._extremes(np.cos(x / 1e5), np.sin(x / 1e5), 4000)
    assert loop.size < 4100
    assert np.cos(x / 1e5)[loop].max() == np.cos(x / 1e5).max()
    assert not svg._thin(Line2D([0.0, 1.0], [0.0, 1.0]), 400)


def test_a_report_of_long_records_stays_below_three_megabytes():
    """24 curves of 20,000 points and 4 clouds of 20,000: the page says that it was thinned, and how
    large it may get.
    """
    rng = np.random.default_rng(2)
    drawings = []
    for _ in range(4):
        made_figure, axes = figures.page(2, 2, title="long")
        for k, ax in enumerate(axes):
            x = np.arange(20_000.0)
            for _ in range(2 if k else 0):
                ax.plot(x, rng.normal(size=x.size))
            if not k:
                ax.plot(rng.normal(size=20_000), rng.normal(size=20_000), ".")
        drawings.append(made_figure)
    page = made("plain", drawings=drawings)
    assert len(page) < 3_000_000
    assert b"extremes of short pieces" in page
    assert b"extremes of short pieces" not in made("plain", drawings=(figure("a"),))


def test_what_a_panel_spans_stands_beside_it():
    """Linear, log and symlog axes carry scale and limits; an axis that counts names carries
    none.
    """
    made_figure, axes = figures.page(1, 3, title="spans")
    axes[0].plot([1.0, 2.0], [3.0, 4.0])
    axes[1].loglog([1.0, 10.0], [1.0, 100.0])
    axes[2].barh(["a", "b"], [1.0, 2.0])
    axes[2].set_xscale("symlog", linthresh=0.5)
    figures.settle((made_figure,))
    drawn, _ = svg.inline((made_figure,))
    spans = re.findall(r'data-x="(\w*)[^"]*" data-y="(\w*)', drawn[0])
    assert spans == [("linear", "linear"), ("log", "log"), ("symlog", "")]
    boxes = re.findall(r'data-box="([^"]+)"', drawn[0])
    width, height = (72.0 * size for size in made_figure.get_size_inches())
    for box in boxes:
        left, top, wide, high = map(float, box.split())
        assert 0.0 < left < left + wide < width
        assert 0.0 < top < top + high < height


def test_every_style_of_the_figures_is_said_by_attributes_or_by_the_page():
    """What matplotlib says in styles and the page drops is only what the page's own style sheet
    says.
    """
    dropped = set()
    given = svg._styled
    said = re.compile(r"([\w-]+):")

    def watched(style):
        kept = given(style)
        dropped.update(set(said.findall(style)) - set(kept))
        return kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(svg, "_styled", watched)
        svg.inline((figure(),))
    assert dropped <= {"font-family"}


MARKED = r'<path d="(m[^"]*)"[^>]*marker-mid='
NUMBER = r"-?[\d.]+(?:e-?\d+)?"


def test_a_small_device_of_a_fleet_has_a_small_report(tmp_path, calibkit, log_writer):
    """Run folder of one channel over temperature: at most 40 kB, of which a third is style and
    script that every page needs; its figure keeps every label and every point.
    """
    seconds = np.arange(2000.0)
    case = 60.0 - 80.0 * np.exp(-3.0 * seconds / 2000.0)
    gyro = 0.02 * case + np.random.default_rng(0).normal(0.0, 0.05, 2000)
    log_writer(tmp_path / "U1" / "w.csv", time_s=seconds, temp_case_degc=case, gyro_dph=gyro)
    (tmp_path / "r.toml").write_text(
        'procedure = "bias_temperature"\n[logs]\nfiles = ["*.csv"]\n[polynomials]\n'
        'abscissa = "temp_case_degc"\nbias = [{ indication = "gyro_dph", order = 3 }]\n',
        encoding="utf-8",
    )
    where = ("--data", tmp_path / "U1", "--serial", "U1", "--out", tmp_path / "runs")
    calibkit("fit", tmp_path / "r.toml", *where, "--date", "2026-11-21")
    folder = tmp_path / "runs" / "U1" / "r001"
    assert sum(file.stat().st_size for file in folder.iterdir()) <= 40_000
    page = (folder / "report.html").read_bytes()
    drawing = re.search(r"<svg.*</svg>", page.decode(), re.DOTALL).group()
    assert re.findall(r"<text[^>]*>(−?\d+)</text>", drawing)[:3] == ["−20", "−10", "0"]
    marks = [len(re.findall(NUMBER, way)) // 2 for way in re.findall(MARKED, drawing)]
    assert max(marks) > 140


def test_equal_marks_are_one_path_with_a_mark_at_every_corner():
    """Places, look and clipping of marks are those of matplotlib's own SVG, whatever parts are
    drawn beside them.
    """
    made = figure("plain")
    (ax,) = made.axes
    x = np.linspace(0.1, 0.9, 50)
    ax.plot(x, x**2, "o", color="black", alpha=0.5, mec="#aa3377")
    figures.settle([made])
    (drawing,), _ = svg.inline([made])
    (way,) = re.findall(MARKED, drawing)
    steps = np.array(re.findall(NUMBER, way), dtype=float).reshape(-1, 2)
    wanted = ax.transData.transform(np.column_stack([x, x**2])) * (1.0, -1.0)
    wanted[:, 1] += made.bbox.height
    np.testing.assert_allclose(np.cumsum(steps, axis=0), wanted, atol=0.006)
    (mark,) = re.findall(r"<marker[^>]*>(.*?)</marker>", drawing)
    assert all(part in mark for part in ('stroke="#aa3377"', 'fill="#000000"', 'opacity="0.5"'))
