"""The certificate as a file: PDF/A-3, attachments, the checklist on its text, drafts, amendments,
text of every kind.
"""

import hashlib
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
def test_number_and_page_stand_on_every_page(certificate):
    """Every page has the certificate's number and says which of how many it is."""
    pages = text_of(certificate)
    for number, page in enumerate(pages, start=1):
        assert "SAMPLE-2026-003" in page
        assert f"Page {number} of {len(pages)}" in page


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


@needs_pdftotext
def test_digests_of_all_attachments_are_printed(certificate):
    """SHA-256 of every attached file stands on the certificate."""
    whole = squeezed("".join(text_of(certificate)))
    with pikepdf.open(certificate) as pdf:
        for name, spec in pdf.attachments.items():
            assert hashlib.sha256(spec.get_file().read_bytes()).hexdigest() in whole, name


@needs_pdftotext
def test_the_digest_of_the_run_says_what_it_is_compared_with(certificate, runs):
    """It is the field sha256 inside run.json, and called that; the digest of the file is another
    and stands in the list.
    """
    whole = squeezed("".join(text_of(certificate)))
    path = runs / "S-1" / "r001" / "run.json"
    own = json.loads(path.read_text(encoding="utf-8"))["sha256"]
    assert f"digestofitscontent(fieldsha256ofrun.json;theSHA-256ofthefileisanother):{own}" in whole
    assert f"SHA-256{own}" not in whole
    assert hashlib.sha256(path.read_bytes()).hexdigest() in whole
    assert f"fieldsha256ofrun.json;theSHA-256ofthefileisanother):{own}" in squeezed(
        certificate.with_suffix(".xml").read_text(encoding="utf-8")
    )


@needs_pdftotext
def test_a_long_word_in_an_address_stays_in_its_column(issue, tmp_path):
    """Wide capitals without a space, and a long address of e-mail: nothing reaches into the
    customer's column.
    """
    text = PROFILE.read_text(encoding="utf-8").replace(
        '"""1 Sample Street', f'"""{"MUSTERWEG" * 6}\n1 Sample Street'
    )
    text = text.replace(
        "[customer]", f'email = "{"office." * 8}institute@example.org"\n\n[customer]', 1
    )
    (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
    out = issue(profile=tmp_path / "lab.toml")
    page = subprocess.run(
        ["pdftotext", "-bbox", "-l", "1", out, "-"], capture_output=True, text=True, check=True
    ).stdout
    words = re.findall(
        r'xMin="([\d.]+)" yMin="([\d.]+)" xMax="([\d.]+)" yMax="[\d.]+">([^<]*)<', page
    )
    (customer,) = (float(x) for x, _, _, word in words if word == "Customer")
    top, bottom = (
        float(next(y for _, y, _, word in words if word == name)) for name in ("Customer", "Item")
    )
    inside = [
        (x, end, squeezed(word))
        for x, y, end, word in words
        if top <= float(y) < bottom and float(x) < customer
    ]
    assert any("MUSTER" in word for *_, word in inside)
    assert [(word, end) for _, end, word in inside if float(end) > customer] == []


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


def test_figures_are_vectors(tmp_path_factory):
    """No page holds an image: figures are lines and polygons with text in the certificate's
    fonts.
    """
    run = sample_run(tmp_path_factory, "rate_table")
    out = tmp_path_factory.mktemp("vectors") / "certificate.pdf"
    assert called("certify", run.folder, "--out", out, "--date", "2026-11-21") == 0
    with pikepdf.open(out) as pdf:
        assert [page for page in pdf.pages if len(page.get_images())] == []


def test_same_run_profile_and_date_give_the_same_bytes(issue, certificate):
    """Nothing of the clock, the folder or the moment is in a certificate; another date makes other
    bytes.
    """
    assert issue().read_bytes() == certificate.read_bytes()
    assert issue(date="2026-11-22").read_bytes() != certificate.read_bytes()
    assert certificate.read_bytes().endswith(b"\n")


def test_nothing_is_overwritten(runs, certificate, calibkit):
    """A certificate that exists stays as it is: exit 4."""
    before = certificate.read_bytes()
    outcome = calibkit("certify", "S-1", "--runs", runs, "--out", certificate, "--profile", PROFILE)
    assert outcome.code == 4
    assert "nothing is overwritten" in outcome.err
    assert certificate.read_bytes() == before


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
def test_one_missing_item_makes_a_draft_and_a_whole_profile_makes_none(issue, certificate):
    """Drop the warm-up alone: DRAFT on every page; the sample profile lacks nothing."""
    assert not any("DRAFT" in page for page in text_of(certificate))
    assert all("DRAFT" in page for page in text_of(issue("--set", "conditions.warm_up=")))


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


def test_an_amendment_of_a_later_certificate_is_refused_with_its_line(runs, tmp_path, calibkit):
    """amends_issued after the date of issue: exit 2 with the line; of the same day it may be;
    without amends it is refused.
    """

    def code(line):
        text = PROFILE.read_text(encoding="utf-8").replace(
            "[laboratory]", f"changes = ['x']\n{line}\n[laboratory]", 1
        )
        (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
        stated = (
            "--profile",
            tmp_path / "lab.toml",
            "--date",
            "2026-11-21",
            "--out",
            tmp_path / "c.pdf",
        )
        return calibkit("certify", "S-1", "--runs", runs, *stated)

    late = code("amends = 'A'\namends_issued = 2026-11-22")
    assert late.code == 2
    line = (tmp_path / "lab.toml").read_text(encoding="utf-8").splitlines().index(
        "amends_issued = 2026-11-22"
    ) + 1
    assert (
        f"lab.toml:{line}: certificate.amends_issued: 2026-11-22 is later than the date of issue"
        " 2026-11-21" in late.err
    )
    assert "amends names no certificate" in code("amends_issued = 2026-11-20").err
    assert not (tmp_path / "c.pdf").exists()
    assert code("amends = 'A'\namends_issued = 2026-11-21").code == 0


def test_a_specification_that_does_not_fit_the_run_is_named_with_its_line(runs, tmp_path, calibkit):
    """A result that the run has not, and another unit: file and line of the key."""
    start = PROFILE.read_text(encoding="utf-8")
    for wrong, said in (
        ("result = 'gyro_scale.nothing'\nunit = 'ppm'", "is no result of this run"),
        ("unit = 'g'\nresult = 'gyro_orthogonality.pair.N'", "is in 'g'"),
    ):
        (tmp_path / "lab.toml").write_text(
            f"{start}\n[[specification]]\n{wrong}\nupper = 1.0\n", encoding="utf-8"
        )
        found = calibkit(
            "certify", "S-1", runs=runs, profile=tmp_path / "lab.toml", out=tmp_path / "c.pdf"
        )
        assert found.code == 2
        assert f"lab.toml:{len(start.splitlines()) + 3}: [[specification]]" in found.err
        assert said in found.err


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


def test_characters_that_no_font_has_are_refused(runs, tmp_path, calibkit):
    """A Chinese name must not vanish or turn into boxes: exit 2, the characters, what to do."""
    out = tmp_path / "c.pdf"
    profile = profile_with("计量", tmp_path / "lab.toml")
    outcome = calibkit("certify", "S-1", runs=runs, out=out, profile=profile)
    assert outcome.code == 2
    assert "no font has '计量'" in outcome.err
    assert "[certificate] fonts" in outcome.err
    assert not out.exists()


@needs_pdftotext
def test_control_characters_and_overrides_of_direction_are_shown_by_number(issue, tmp_path):
    """A name that would reorder what stands beside it on a certificate is shown for what it is."""
    whole = squeezed(
        "".join(text_of(issue(profile=profile_with("a\u202eb\u0007c", tmp_path / "lab.toml"))))
    )
    assert "a[U+202E]b[U+0007]c" in whole


def test_chinese_without_a_font_is_refused_with_what_to_do(runs, tmp_path, calibkit):
    """--lang zh needs a font that the user names: exit 2, nothing written."""
    out = tmp_path / "c.pdf"
    outcome = calibkit("certify", "S-1", runs=runs, out=out, profile=PROFILE, lang="zh")
    assert outcome.code == 2
    assert "[certificate] fonts" in outcome.err
    assert not out.exists()


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


@pytest.mark.parametrize("out", [".", "/", "", "..", "certificate", "certificate.xml"])
def test_a_name_that_is_no_pdf_is_refused_with_what_to_name(out, runs, calibkit):
    """Folders, the empty name, and the name of the DCC: exit 2, not a fault of the program."""
    outcome = calibkit("certify", "S-1", "--runs", runs, "--out", out, "--profile", PROFILE)
    assert outcome.code == 2
    assert "ends in .pdf" in outcome.err
