"""The documentation: every tutorial runs as it is written, file formats have schemas that hold,
pages build without a warning.
"""

import json
import re
from pathlib import Path

import pytest

from conftest import ROOT, load_script, slow_after
from house import pages
from house.pages import validators

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
PLUGIN_PAGES = {"format_of_my_own", "instrument_of_my_own"}
# run in an environment of their own by test_plugins
HOW_TO = sorted((ROOT / "docs" / "how_to").glob("*.md"))
QUICK = {"rate_table", "inclinometer"}
PAGES = [*TUTORIALS, *(page for page in HOW_TO if page.stem not in PLUGIN_PAGES)]
PAGES.sort(key=lambda page: page.stem not in QUICK)


@pytest.mark.drawn
@pytest.mark.parametrize("page", slow_after(len(QUICK), PAGES), ids=lambda page: page.stem)
def test_a_page_runs_as_it_is_written_and_what_it_writes_is_of_its_schema(
    page, tmp_path, calibkit, monkeypatch
):
    """Every block in order ends as the page says; every JSON file holds against its schema, every
    form is in the table.
    """
    text = page.read_text(encoding="utf-8")
    if "calibkit certify" in text:
        pytest.importorskip("typst")
    if missing := [
        font for font in re.findall(r'"(/usr/share/fonts/[^"]+)"', text) if not Path(font).is_file()
    ]:
        pytest.skip(f"no font {missing[0]} on this machine")
    pages.follow(page, tmp_path, calibkit, monkeypatch)
    known, forms = validators(), (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    for path in tmp_path.rglob("report.html"):
        assert len(path.read_bytes()) > 10_000
    for path in tmp_path.rglob("*.json"):
        document = json.loads(path.read_text(encoding="utf-8"))
        if "format" in document:
            known[document["format"]].validate(document)
        if document.get("format", "").startswith("calibkit-coefficients/"):
            assert [
                model["form"]
                for model in document["models"]
                if f"| `{model['form']}` |" not in forms
            ] == []


def test_every_shipped_recipe_has_a_tutorial():
    """Each recipe of a procedure is fitted on a page; that of a certain sensor's raw counts is an
    example of mapping.
    """
    text = "".join(page.read_text(encoding="utf-8") for page in TUTORIALS)
    names = {path.stem for path in (ROOT / "recipes").glob("*.toml")} - {"mpu6050_warmup"}
    assert [name for name in sorted(names) if f"calibkit fit {name} " not in text] == []


def test_every_format_has_a_schema_and_a_line():
    """What calibkit writes with a format in it: the schema's title is that format, and the page on
    formats names both.
    """
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "calibkit").rglob("*.py"))
    written = set(re.findall(r'"(calibkit-[a-z]+/[0-9]+)"', source)) - {
        "calibkit-firmware/1"
    }  # a header's own, no JSON
    listed = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    assert written == set(validators())
    for name in written:
        assert f"| `{name}` |" in listed
        assert f"`{name.replace('/', '-')}.schema.json`" in listed


def test_a_schema_refuses_a_coefficient_without_its_unit():
    """The golden file passes; the same without one unit does not."""
    golden = json.loads(
        (ROOT / "tests" / "golden" / "coefficients-2.json").read_text(encoding="utf-8")
    )
    golden |= {"recipe_sha256": "0" * 64, "inputs": []}  # its own are shortened
    validator = validators()[golden["format"]]
    validator.validate(golden)
    del golden["models"][0]["coefficients"][0]["unit"]
    assert not validator.is_valid(golden)


def test_every_recipe_key_and_every_finding_has_a_sentence():
    """Pages that are made from the code have no empty cell, and state each finding."""
    pytest.importorskip("sphinx")
    reference = load_script(ROOT / "docs" / "reference.py")
    for part in (reference.describe_keys(), reference.describe_profile()):
        assert [line for line in part.splitlines() if line.endswith("|  |")] == []
    findings = reference.describe_findings()
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "calibkit").rglob("*.py"))
    checks = re.findall(r'Finding\((?:[^()]|\([^()]*\))*?name="(\w+)"', source)
    assert [
        name for name in sorted({*checks, "stuck", "aliased"}) if f"| `{name}` |" not in findings
    ] == []


def test_pages_that_messages_and_lists_name_exist():
    """Sphinx sees only docs/: links of README, changelog and CONTRIBUTING, pages that messages
    name, with their headings.
    """
    lists = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
    named = {
        found
        for path in [*lists, *(ROOT / "calibkit").rglob("*.py")]
        for found in re.findall(r"\b(docs/[\w/]+\.md)(#[\w-]+)?", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 20
    for page, anchor in sorted(named):
        text = (ROOT / page).read_text(encoding="utf-8")
        titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        slugs = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
        assert anchor.removeprefix("#") in slugs | {""}, page + anchor


def test_the_changelog_names_a_change_once():
    """A merge that takes both sides brings a replaced list back: no heading and no entry stands
    twice, and what is unreleased is read in a few minutes.
    """
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased = text.partition("## Unreleased\n")[2].partition("\n## ")[0]
    lines = [line for line in unreleased.splitlines() if line.startswith(("#", "- "))]
    assert len(lines) == len(set(lines))
    assert len(unreleased.split()) < 4000, "one or two sentences for each change"
