"""The glossary explains every symbol that tables of the sample reports and certificates print."""

import html
import re

import pytest

from conftest import ROOT

SYMBOL = re.compile(
    r"(?:[A-Zabdeksuγετνα]|[A-Zabks][0-9]|s [xy]|s_\w+|tau|alpha|gamma|epsilon|ν_eff)"
)


def heads(page):
    """Heads of the columns and rows of a page's tables, units and what stands in brackets left
    out.
    """
    found = (
        html.unescape(re.sub("<[^>]+>", "", head))
        for head in re.findall(r"<th[^>]*>(.*?)</th>", page, re.DOTALL)
    )
    return {re.sub(r"\s*[\[(].*", "", head).strip() for head in found}


def explained():
    """Symbols in the first column of the glossary's second table."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Symbols")[2]
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("|")]
    found = {part for row in rows for part in re.split(r",\s*|\s+\(|\)", row.strip())}
    for first, last in re.findall(r"(\w\d) … (\w\d)", " ".join(rows)):
        found |= {f"{first[0]}{n}" for n in range(int(first[1]), int(last[1]) + 1)}
    return found


@pytest.mark.parametrize("page", sorted(path.name for path in (ROOT / "reports").glob("*.html")))
def test_every_symbol_of_a_sample_report_is_in_the_glossary(page):
    """Heads that are symbols alone, or a sum or power of them."""
    printed = {
        head
        for head in heads((ROOT / "reports" / page).read_text(encoding="utf-8"))
        if SYMBOL.fullmatch(head)
    }
    assert printed <= explained(), printed - explained()
