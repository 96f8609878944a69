"""`calibkit report`: the page of a run again, and the same content as PDF."""

import re
import shutil
import subprocess

import pytest

from calibkit.commands import run_content
from calibkit.records import store
from calibkit.report import pdf
from conftest import ROOT
from outputs.test_html import HOSTILE, composed, figure

pytestmark = pytest.mark.drawn


def printed(content, folder):
    """Text of a PDF."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine")
    (folder / "r.pdf").write_bytes(content)
    done = subprocess.run(
        ["pdftotext", "-layout", folder / "r.pdf", "-"], capture_output=True, check=True
    )
    return done.stdout.decode()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the folder of runs with one of the sample record of noise."""
    from calibkit import recipe
    from calibkit.commands import pipeline
    from calibkit.instruments import silent

    runs = tmp_path_factory.mktemp("report") / "runs"
    data = ROOT / "datasets" / "gyro_noise"
    pipeline.fit(recipe.find("gyro_noise"), data, "N-1", runs, "2026-11-21", silent)
    return runs


def test_the_pdf_prints_what_the_page_shows(run, tmp_path, calibkit):
    """Verdict, sentence, key values, headings and each caption of the page are in the PDF, whose
    bytes are the same twice; the HTML file is the page itself.
    """
    pytest.importorskip("typst")
    page = (run / "N-1" / "r001" / "report.html").read_text(encoding="utf-8")
    for name in ("a.pdf", "b.pdf", "c.html"):
        done = calibkit("report", "N-1", "--runs", run, "--out", tmp_path / name)
        assert (done.code, done.out) == (0, f"{tmp_path / name}\n")
    content = (tmp_path / "a.pdf").read_bytes()
    assert content == (tmp_path / "b.pdf").read_bytes()
    assert (tmp_path / "c.html").read_text(encoding="utf-8") == page
    text = " ".join(printed(content, tmp_path).split())
    found = re.findall(r"<(?:h[1-4]|dd|dt|figcaption|strong)[^>]*>([^<]+)<", page)
    assert len(found) > 15
    missing = [one for one in found if " ".join(one.split()) not in text]
    assert missing == []


def test_hostile_texts_are_only_shown(tmp_path):
    """Texts that are code in typst or HTML are printed as they are; a rejected run says so on every
    sheet.
    """
    pytest.importorskip("typst")
    hostile = HOSTILE + "#panic() $x$ *b* _i_ `r` \\"
    page, _ = composed(hostile, accepted=False, drawings=(figure(),))
    text = printed(pdf.render(page, "2026-11-21"), tmp_path)
    assert "#panic() $x$ *b* _i_" in text
    assert all("REJECTED" in sheet for sheet in text.split("\f")[:-1])


def test_what_cannot_be_written_is_refused(run, tmp_path, calibkit, monkeypatch):
    """Another suffix is usage; an existing file, and a PDF without typst, are output."""
    call = ("report", "N-1", "--runs", run, "--out")
    assert calibkit(*call, tmp_path / "r.docx").code == 2
    (tmp_path / "r.html").write_bytes(b"mine")
    assert calibkit(*call, tmp_path / "r.html").code == 4
    monkeypatch.setitem(__import__("sys").modules, "typst", None)
    refused = calibkit(*call, tmp_path / "r.pdf")
    assert (refused.code, "calibkit[pdf]" in refused.err) == (4, True)
    assert not (tmp_path / "r.pdf").exists()


def test_a_run_of_release_0_2_still_has_a_pdf(tmp_path):
    """Its page keeps no tables: figures are those of the page, results those of the text."""
    pytest.importorskip("typst")
    (folder,) = (ROOT / "tests" / "golden" / "0.2" / "gyro_pair").glob("*/r001")
    stored = store.load(folder)
    text = printed(run_content.read_report(stored, ".pdf"), tmp_path)
    sentence = (folder / "report.txt").read_text(encoding="utf-8").splitlines()[1]
    assert all(word in text for word in (*sentence.split(), "Figure 1."))


def test_a_page_that_was_changed_is_refused_in_one_line(run, tmp_path, calibkit):
    """What the page keeps is not what calibkit put there: exit code 4, not an internal error."""
    shutil.copytree(run, tmp_path / "runs")
    path = tmp_path / "runs" / "N-1" / "r001" / "report.html"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"captions":[', '"captions":[7,', 1), encoding="utf-8")
    refused = calibkit("report", "N-1", "--runs", tmp_path / "runs", "--out", tmp_path / "r.pdf")
    assert (refused.code, refused.err.count("\n")) == (4, 1)
    assert "report.html" in refused.err
