"""`verify` on files that somebody changed: exit code 4 and one line, never an internal error."""

import hashlib
import shutil
from functools import partial

import pytest

from attacks import documents
from calibkit.commands import pipeline
from calibkit.errors import CoefficientError
from calibkit.records import sealed
from conftest import ROOT

GOLDEN = ROOT / "tests" / "golden"


@pytest.fixture
def delivery(tmp_path):
    """Return the manifest of a copy of a delivery of two devices."""
    folder = shutil.copytree(GOLDEN / "exports-2" / "blob", tmp_path / "delivery")
    return folder / "cal_manifest.json"


def test_a_forged_manifest_is_refused_in_one_line(delivery):
    """300 manifests with members replaced or removed and a right digest: KeyError, TypeError and a
    name too long for the system were internal errors.
    """
    forged = partial(documents.forge, documents.read_json(delivery))
    assert documents.attack(delivery, forged, 300, 1) == (300, [])


@pytest.mark.parametrize("name", ["../elsewhere.bin", "/etc/hostname", "a/b.bin", "..", "x" * 300])
def test_a_manifest_vouches_for_no_file_outside_its_folder(delivery, name):
    """A path that leads out of the folder is refused, also where the digest there is right."""
    content = b"not delivered"
    (delivery.parent.parent / "elsewhere.bin").write_bytes(content)
    document = documents.read_json(delivery)
    entry = {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
    document["files"].append(entry)
    delivery.write_text(sealed.seal(document), encoding="utf-8")
    with pytest.raises(CoefficientError, match=r"leaves the folder|cannot be read"):
        pipeline.verify(delivery)


def test_a_damaged_dcc_is_refused_in_one_line(tmp_path):
    """200 damages: texts that are no numbers, elements that are missing, files that are none."""
    pytest.importorskip("lxml")
    content = (GOLDEN / "dcc.xml").read_bytes()
    assert documents.outcome(tmp_path / "a.xml", content) == "passed"

    def damage(generator):
        return documents.damage_xml(documents.damage_xml(content, generator), generator)

    assert documents.attack(tmp_path / "a.xml", damage, 200, 2) == (200, [])


def test_a_list_of_two_numbers_in_one_is_refused(tmp_path, real):
    """A covariance whose entry is two numbers behind each other, where the schemas are given; it
    was an internal error.
    """
    pytest.importorskip("lxml")
    text = (GOLDEN / "dcc.xml").read_text(encoding="utf-8")
    at = text.index("<si:valueXMLList>", text.index("<si:columnXMLList>")) + len(
        "<si:valueXMLList>"
    )
    (tmp_path / "a.xml").write_text(text[:at] + "1.0-" + text[at:], encoding="utf-8")
    with pytest.raises(CoefficientError):
        pipeline.verify(tmp_path / "a.xml", schema_dir=real / "dcc-schema")


def test_a_cycle_of_pages_or_names_is_refused(tmp_path):
    """A page tree and a tree of attachments that hold themselves."""
    pytest.importorskip("pypdf")
    pages = b"<</Type/Catalog/Pages 2 0 R>>", b"<</Type/Pages/Kids[2 0 R]/Count 1>>"
    names = (
        b"<</Type/Catalog/Pages 2 0 R/Names<</EmbeddedFiles 3 0 R>>>>",
        b"<</Type/Pages/Kids[]/Count 0>>",
        b"<</Kids[3 0 R 3 0 R]>>",
    )
    for objects in (pages, names):
        assert documents.outcome(tmp_path / "a.pdf", write_pdf(objects)) == "refused"


def write_pdf(objects):
    """PDF of objects as they are written."""
    content, places = b"%PDF-1.7\n", []
    for number, text in enumerate(objects, start=1):
        places.append(len(content))
        content += b"%d 0 obj\n" % number + text + b"\nendobj\n"
    start, size = len(content), len(objects) + 1
    content += b"xref\n0 %d\n0000000000 65535 f \n" % size
    content += b"".join(b"%010d 00000 n \n" % place for place in places)
    return content + b"trailer\n<</Size %d/Root 1 0 R>>\nstartxref\n%d\n%%%%EOF\n" % (size, start)
