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
import pytest

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
from calibkit.report.run import Shown, compose_page
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
    assert "into the firmware" not in rejected
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
