"""The documentation: every tutorial runs as it is written, file formats have schemas that hold,
pages build without a warning.
"""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
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


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash on this machine")
def test_a_tutorial_runs_in_a_shell(tmp_path):
    """The commands of a tutorial, one after the other by bash with the command that is installed:
    all end with exit code 0.
    """
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "calibkit"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m calibkit "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    path = f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    text = (ROOT / "docs" / "tutorials" / "inclinometer.md").read_text(encoding="utf-8")
    script = "".join(block for language, block in pages.BLOCK.findall(text) if language == "sh")
    done = subprocess.run(
        ["bash", "-euc", script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


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


@pytest.mark.slow
def test_the_pages_build_without_a_warning(tmp_path):
    """Sphinx with warnings as errors, every reference resolved; equations are drawn, and none is
    left as it was typed.
    """
    for module in ("sphinx", "myst_parser", "furo", "numpydoc", "latex2mathml"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install 'calibkit[docs]'")
    arguments = [
        "-m",
        "sphinx",
        "-W",
        "-n",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(ROOT / "docs"),
        str(tmp_path),
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert "Glossary" in (tmp_path / "glossary.html").read_text(encoding="utf-8")
    for page in (tmp_path / "methods").glob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert "<math" in text
        assert re.search(r"\\(frac|hat|omega|text)\b|\$\$", text) is None, page.name


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
