"""One list of blocks, shown alike on a page, in a PDF and on the console."""

import re

import pytest

from calibkit.report import page, pdf, screen
from calibkit.report.blocks import Chart, Findings, Fold, Heading, Page, Text, Values
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Number, Table
from outputs.test_report_pdf import printed

TABLE = Table(
    "Limits",
    ("limit on", Column("value", ".3g"), Column("u", ".2g", missing="none"), "unit", ""),
    (
        ("K", 1.0 / 3.0, None, "1/deg", "met"),
        ("F0", Number(2.0, ".1f", 0.5, ".1f"), 3, "1/s", "no"),
    ),
    failed=(1,),
)
SVG = '<svg viewBox="0 0 10 10"><path d="M0 0L9 9" stroke="#000000"/></svg>'
PAGE = Page(
    "A title",
    "rejected: a verdict",
    "rejected",
    (
        Heading("A heading"),
        Text("A paragraph"),
        Text("x = 1", "code"),
        TABLE,
        Fold("A fold", (Text("folded"), Findings(("a finding",)))),
    ),
    subtitle="a subtitle",
    lead="A sentence",
    first=(Chart(SVG, "A figure"), Values((("K", "1.0(2)"),)), Text("beside")),
)
WORDS = (
    *("A title", "a subtitle", "rejected: a verdict", "A sentence", "A figure", "1.0(2)", "beside"),
    *("A heading", "A paragraph", "x = 1", "Limits", "0.333", "2.0 ± 0.5", "none", "F0", "A fold"),
    *("folded", "a finding"),
)


def test_a_page_and_a_pdf_of_blocks_say_the_same(tmp_path):
    """Every text of every kind of block is in both."""
    pytest.importorskip("typst")
    html = re.sub(
        r"<(style|script).*?</\1>|<[^>]+>", "", page.render(PAGE).decode(), flags=re.DOTALL
    )
    text = printed(pdf.render(PAGE, "2026-11-21"), tmp_path)
    for shown in (html, text):
        assert [word for word in WORDS if word not in shown] == []


def test_numbers_stand_to_the_right_and_keep_every_digit():
    """Columns of numbers are set as such, the first column and words are not; a rounded number has
    its value beside it; a row of a failed limit is marked.
    """
    assert TABLE.numbers == (False, True, True, False, False)
    html = page.summary_table(TABLE)
    assert '<td class="number"><data value="0.3333333333333333">0.333</data></td>' in html
    assert re.findall(r'<tr class="failed"><th scope="row">(\w+)</th>', html) == ["F0"]


def test_the_console_drops_whole_columns_where_there_is_no_room():
    """A number that is cut would be another number."""
    lines = screen.arrange(["title"], [TABLE], [], [], 24)
    assert lines[-1].split() == ["F0", "2.0", "±", "0.5"]
    assert max(map(len, lines)) <= 24
    full = screen.plain_text(Summary("title", (TABLE,), conclusion="end"))
    assert "1/deg" in full
    assert full.splitlines()[-1] == "end"
