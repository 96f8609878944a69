"""The certificate as a file: PDF/A-3, attachments, the checklist on its text, drafts, amendments,
text of every kind.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from calibkit.certificate import profile
from conftest import AUTHORITIES, ROOT, called
from sample_runs import sample_run

pytest.importorskip("typst")
pikepdf = pytest.importorskip("pikepdf")

PROFILE = ROOT / "reports" / "profiles" / "gyro_pair.toml"
pytestmark = pytest.mark.drawn
CHINESE = Path("/usr/share/fonts/truetype/wqy/wqy-zenhei.ttc")
needs_pdftotext = pytest.mark.skipif(
    shutil.which("pdftotext") is None, reason="pdftotext is not installed"
)
needs_chinese = pytest.mark.skipif(
    not CHINESE.is_file(), reason="the WenQuanYi Zen Hei font is not installed"
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folder of runs with the sample gyro pair in it."""
    return sample_run(tmp_path_factory, "gyro_pair").folder.parents[1]


@pytest.fixture(scope="module")
def issue(runs, tmp_path_factory):
    """Issue a certificate of the sample pair and return its path."""
    folder = tmp_path_factory.mktemp("issued")
    count = iter(range(1000))

    def write(*arguments, profile=PROFILE, date="2026-11-21"):
        out = folder / f"{next(count)}.pdf"
        stated = () if profile is None else ("--profile", profile)
        code = called("certify", "S-1", *stated, *arguments, runs=runs, out=out, date=date)
        assert code == 0
        return out

    return write


@pytest.fixture(scope="module")
def certificate(issue):
    """The sample certificate."""
    return issue()


def text_of(path, order="-layout"):
    """Text of a PDF, page by page, with the spaces of a line folded; -raw: cell after cell."""
    found = subprocess.run(
        ["pdftotext", order, path, "-"], capture_output=True, text=True, check=True
    ).stdout
    return [re.sub(r"\s+", " ", page) for page in found.split("\f")[:-1]]


def squeezed(text):
    """Text without spaces and places to break: what was said, however the lines fell."""
    return re.sub(r"[\s\u200b]+", "", text)


@needs_pdftotext
def test_every_item_of_the_checklist_is_on_the_certificate(certificate):
    """ISO/IEC 17025 7.8.2 and 7.8.4, one by one, in the text that a reader can copy out of it."""
    whole = squeezed("".join(text_of(certificate, "-raw")))
    items = {
        "title": "Calibration certificate",
        "laboratory": "Sample calibration laboratory",
        "street": "1 Sample Street",
        "town": "10000 Sampletown",
        "place of work": "rate-table room, ground floor",
        "customer": "Sample customer",
        "method": "Scale factor and orthogonality of a gyro pair, procedure LP-03",
        "revision": "2, 2026-09-01",
        "item": "Pair of fibre-optic gyros",
        "maker": "Sample maker",
        "model": "FOG-P2",
        "serial": "S-1",
        "condition": "no damage seen; connector clean",
        "received": "2026-11-09",
        "performed": "2026-11-12 … 2026-11-13",
        "issued": "Issued 2026-11-21",
        "only the item": "The results relate only to the item calibrated",
        "deviations": "Deviations from the method none",
        "external providers": "From external providers none",
        "authorised by": "(sample, not signed)",
        "role": "head of laboratory",
        "temperature": "23 °C ± 2 °C",
        "supply": "15.0 V ± 0.1 V",
        "gravity": "9.7967 m/s²",
        "latitude": "34.20° N",
        "earth's rate": "symmetric ± rates cancel it in K",
        "warm-up": "60 min before the first rate",
        "standard": "Rate table, time-base counter",
        "its certificate": "R-2026-031",
        "its date": "2026-02-11",
        "its laboratory": "national metrology institute (sample)",
        "coverage": "coverage probability about 95 %",
        "specification": "angle between the axes",
        "decision rule": "guarded acceptance",
        "as found and as left": "As found and as left No adjustment of the instrument",
        "end mark": "End of certificate SAMPLE-2026-003",
    }
    absent = [name for name, text in items.items() if squeezed(text) not in whole]
    assert absent == []


@needs_pdftotext
def test_printed_values_are_those_of_the_file_rounded_with_their_uncertainty(certificate, runs):
    """N on the page is N in the file, at the decimal place of two digits of U = 2 u of 30 degrees
    of freedom and more.
    """
    file = json.loads(
        (runs / "S-1" / "r001" / "gyro_orthogonality.json").read_text(encoding="utf-8")
    )
    N = next(c for c in file["models"][0]["coefficients"] if c["name"] == "N")
    assert N["effective_dof"] >= 30.0
    expanded = 2.0 * N["standard_uncertainty"]
    whole = " ".join(text_of(certificate))
    assert f"ratio of the scale factors N {N['value']:.7f} {expanded:.7f} 2 1" in whole


def test_the_file_says_pdfa_3b_and_embeds_every_font(certificate):
    """XMP says part 3, conformance B; every font on every page has its program in the file."""
    with pikepdf.open(certificate) as pdf:
        with pdf.open_metadata() as metadata:
            assert (metadata["pdfaid:part"], metadata["pdfaid:conformance"]) == ("3", "B")
        fonts = {}
        for page in pdf.pages:
            for name, font in page.resources.get("/Font", {}).items():
                fonts[str(name)] = font
        assert fonts
        for font in fonts.values():
            descriptor = (
                font.DescendantFonts[0].FontDescriptor
                if "/DescendantFonts" in font
                else font.FontDescriptor
            )
            assert {"/FontFile2", "/FontFile3"} & set(descriptor.keys())


def test_attachments_are_the_files_of_the_run_with_their_relationship(certificate, runs):
    """Byte for byte, each with AFRelationship, media type, and listed in the catalogue's /AF."""
    folder = runs / "S-1" / "r001"
    with pikepdf.open(certificate) as pdf:
        assert len(pdf.Root.AF) == len(pdf.attachments)
        _, stated = profile.load(PROFILE)
        kinds = {str(spec.F): str(spec.AFRelationship) for spec in pdf.Root.AF}
        for name in ("gyro_scale.json", "gyro_orthogonality.json", "run.json"):
            assert pdf.attachments[name].get_file().read_bytes() == (folder / name).read_bytes()
            assert pdf.attachments[name].get_file().mime_type == "application/json"
        assert pdf.attachments["profile.toml"].get_file().read_bytes() == stated.encode()
    assert kinds["gyro_scale.json"] == "/Data"
    assert kinds["run.json"] == "/Source"


@pytest.mark.skipif(shutil.which("qpdf") is None, reason="qpdf is not installed")
def test_qpdf_finds_nothing(certificate):
    """The command qpdf --check ends with 0 and no warning."""
    found = subprocess.run(
        ["qpdf", "--check", certificate], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0
    assert "WARNING" not in found.stdout + found.stderr


def test_pdfa_check_finds_nothing_beyond_the_known_false_alarms(certificate):
    """Each finding of the allow-list checker is one that is known and has a reason."""
    pdfa = pytest.importorskip("pikepdf.pdfa")
    document = json.loads((AUTHORITIES / "pdfa_false_alarms.json").read_text(encoding="utf-8"))
    known = {(entry["rule"], entry["message"]) for entry in document["findings"]}
    report = pdfa.validate_written(certificate, "3b")
    found = {(finding.rule, re.sub(r"\d+", "#", finding.message)) for finding in report.findings}
    known = {(rule, re.sub(r"\d+", "#", message)) for rule, message in known}
    assert found <= known, found - known


def test_same_run_profile_and_date_give_the_same_bytes(issue, certificate):
    """Nothing of the clock, the folder or the moment is in a certificate; another date makes other
    bytes.
    """
    assert issue().read_bytes() == certificate.read_bytes()
    assert issue(date="2026-11-22").read_bytes() != certificate.read_bytes()
    assert certificate.read_bytes().endswith(b"\n")


@needs_pdftotext
def test_without_a_profile_every_page_says_draft_and_the_command_lists_what_is_missing(
    runs, tmp_path, calibkit
):
    """Exit 0, DRAFT on each page, every missing item by its key on stderr and on the first
    pages.
    """
    out = tmp_path / "draft.pdf"
    call = ("certify", "S-1", "--runs", runs, "--out", out, "--date", "2026-11-21")
    outcome = calibkit(*call, "--details")
    assert outcome.code == 0
    pages = text_of(out)
    assert all("DRAFT: not a calibration certificate" in page for page in pages)
    for key in (
        "laboratory.name",
        "customer.name",
        "method.deviations",
        "standard",
        "authorised_by.name",
    ):
        assert key in outcome.err
        assert squeezed(key) in squeezed(" ".join(pages))


@needs_pdftotext
def test_an_amendment_names_the_former_certificate_and_what_changed(issue):
    """New number, reference to the former, list of changes; without the changes it is a DRAFT."""
    amended = (
        "--set",
        "certificate.number=SAMPLE-2026-003-1",
        "--set",
        "certificate.amends=SAMPLE-2026-003",
        "--set",
        'certificate.changes=["the customer moved"]',
    )
    first = text_of(issue(*amended))[0]
    assert "replaces certificate SAMPLE-2026-003," in first
    assert "the customer moved" in first
    assert "DRAFT" not in first
    assert "DRAFT" in text_of(issue(*amended[:4]))[0]


NASTY = {
    "typst": '#eval("1") #let x = $x^2$ *b* _i_ `c` \\ @ref <label> //c /*d*/ ~ [a] {b} = h',
    "quotes": "\"double\" 'single' `back` \\back & < > %",
    "long": "w" * 200,
    "right to left": "מכון הכיול العربية",
}


def profile_with(text, path):
    """Sample profile with one text in every field that takes text."""
    lines = []
    keep = ("country", "quantity", "unit", "rule", "decision_rule", "result")
    for number, line in enumerate(PROFILE.read_text(encoding="utf-8").splitlines()):
        key = line.split("=")[0].strip()
        if re.match(r'^[a-z_]+ = ".*"', line) and '"""' not in line and key not in keep:
            unique = f"{text} {number}" if key == "name" else text
            lines.append(f"{key} = {json.dumps(unique, ensure_ascii=False)}")
        else:
            lines.append(line)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@needs_pdftotext
@pytest.mark.parametrize("text", NASTY.values(), ids=NASTY.keys())
def test_text_of_every_kind_is_shown_as_it_was_written(issue, tmp_path, text):
    """No text of a profile is source, whatever it looks like; long words break, right-to-left text
    is kept.
    """
    out = issue(profile=profile_with(text, tmp_path / "lab.toml"))
    whole = squeezed("".join(text_of(out)))
    if text == NASTY["right to left"]:
        assert all(letter in whole for letter in squeezed(text))
    else:
        assert squeezed(text) in whole
    assert "DRAFT" not in whole


@needs_pdftotext
@needs_chinese
@pytest.mark.parametrize("lang", ["en", "zh", "both"])
def test_chinese_is_set_in_the_font_that_the_profile_names(issue, tmp_path, lang):
    """With a Chinese font named, a profile in Chinese prints in every language, and nothing is
    missing.
    """
    profile = profile_with("北京惯性技术计量站", tmp_path / "lab.toml")
    whole = squeezed(
        "".join(
            text_of(
                issue("--lang", lang, "--set", f'certificate.fonts=["{CHINESE}"]', profile=profile)
            )
        )
    )
    assert "北京惯性技术计量站" in whole
    assert ("校准证书" in whole) == (lang != "en")
    assert ("Calibrationcertificate" in whole) == (lang != "zh")
    assert "草稿" not in whole
    assert "DRAFT" not in whole


def test_json_gives_every_result_by_the_key_that_specifications_use(runs, tmp_path, calibkit):
    """One document: files, number, whether it is a draft, results with U and k, statements with
    their verdicts.
    """
    out = tmp_path / "c.pdf"
    said = calibkit("certify", "S-1", "--json", runs=runs, out=out, profile=PROFILE).json
    assert said["ok"] is True
    assert said["draft"] is False
    keys = {result["key"] for result in said["results"]}
    assert {"gyro_scale.a_about_a.K", "gyro_orthogonality.pair.gamma"} <= keys
    assert {
        "key": "gyro_orthogonality.pair.alpha_deg",
        "rule": "guarded",
        "verdict": "fail",
    } in said["statements"]
