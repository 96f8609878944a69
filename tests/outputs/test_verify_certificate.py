"""Signed and unsigned certificates: what is intact passes, whatever was changed is found and
named.
"""

import datetime as dt
import json
import re
import shutil
from dataclasses import replace

import pytest

from calibkit import instruments
from calibkit.certificate import (
    content,
    dcc,
    pdf,
    profile,
    run_files,
    signing_key,
    verify,
)
from calibkit.certificate.results import ListTable
from calibkit.errors import CoefficientError
from calibkit.records import sealed
from conftest import ROOT, called
from sample_runs import sample_run

pytest.importorskip("typst")
pytest.importorskip("lxml")
pytest.importorskip("pypdf")
pytest.importorskip("pyhanko")
pikepdf = pytest.importorskip("pikepdf")
authority = pytest.importorskip("outputs.authority")

PROFILE = ROOT / "reports" / "profiles" / "gyro_pair.toml"
ISSUED = dt.date(2026, 11, 21)
STATED = 'adjustment.statement="no adjustment"'


def key_file(path, days=(-10, 1000)):
    """Write a PKCS#12 file with a key, its certificate by an authority; beside it the authority's
    as PEM.
    """
    issuer = authority.Authority()
    issuer.write(path.with_suffix(".pem"))
    return issuer.issue(path, days=days)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run of the sample gyro pair."""
    return sample_run(tmp_path_factory, "gyro_pair")


@pytest.fixture(scope="module")
def key(tmp_path_factory):
    """A key that was made for these tests."""
    return key_file(tmp_path_factory.mktemp("key") / "key.p12")


@pytest.fixture(scope="module")
def unsigned(run, tmp_path_factory):
    """The sample certificate without a signature."""
    out = tmp_path_factory.mktemp("unsigned") / "certificate.pdf"
    arguments = ("--profile", PROFILE, "--date", ISSUED, "--set", STATED)
    assert called("certify", run.folder, "--out", out, *arguments) == 0
    return out


@pytest.fixture(scope="module")
def signed(run, key, tmp_path_factory):
    """The same with a signature."""
    out = tmp_path_factory.mktemp("signed") / "certificate.pdf"
    arguments = ("--profile", PROFILE, "--date", ISSUED, "--set", STATED, "--sign", key)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(signing_key.PASSPHRASE, "a secret")
        assert called("certify", run.folder, "--out", out, *arguments) == 0
    return out


@pytest.fixture(scope="module")
def record(run):
    """The certificate as a record, with its DCC."""
    stated, text = profile.load(PROFILE, (STATED,))
    files = run_files.RunFiles.read(run)
    made = content.build(files, instruments.certificate_layout, stated, text, None, ISSUED)
    return replace(made, attachments=(*made.attachments, dcc.attach_dcc(made, "en")))


def refused(path, *words):
    """Check that a certificate is refused for reasons that hold these words."""
    with pytest.raises(CoefficientError) as caught:
        verify.verify(path, instruments.certificate_layout)
    for word in words:
        assert word in str(caught.value)


def changed(source, out, changes):
    """Write a certificate with other attachments: name → content."""
    with pikepdf.open(source) as document:
        for name, data in changes.items():
            document.attachments[name] = pikepdf.AttachedFileSpec(document, data, filename=name)
        document.save(out)
    return out


def other(name, run):
    """A coefficient file of the run with its first value changed and its digest right."""
    document = json.loads((run.folder / name).read_text(encoding="utf-8"))
    document["models"][0]["coefficients"][0]["value"] *= 1.0 + 1e-6
    return sealed.seal(document).encode()


def relisted(run, name, data):
    """run.json that lists a changed file, its digest right."""
    from hashlib import sha256

    document = json.loads((run.folder / "run.json").read_text(encoding="utf-8"))
    for entry in document["files"]:
        if entry["name"] == name:
            entry["sha256"] = sha256(data).hexdigest()
    return sealed.seal(document).encode()


def test_an_intact_signature_by_a_stranger_passes_with_a_warning(signed, key, calibkit):
    """Exit 0; the signer is named; the warning goes when the authority is trusted."""
    found = calibkit("verify", signed)
    assert found.code == 0
    assert 'signed by "Common Name: Test laboratory"' in found.out
    assert "rows of numbers as the attached files give them" in found.out
    assert "its signer is not trusted" in found.err
    trusted = calibkit("verify", signed, "--trust", key.with_suffix(".pem"), "--json")
    assert trusted.code == 0
    assert trusted.json["files"][0]["warnings"] == []
    stranger = calibkit("verify", signed, "--trust", signed)
    assert stranger.code == 2
    assert "no certificate" in stranger.err


def test_the_signature_is_a_certification_that_allows_signatures_alone(signed):
    """PAdES subfilter, DocMDP level 2, the whole file covered, the metadata of before, still
    PDF/A-3b.
    """
    with pikepdf.open(signed) as document:
        signature = document.Root.AcroForm.Fields[0].V
        assert signature.SubFilter == "/ETSI.CAdES.detached"
        assert signature.Reference[0].TransformParams.P == 2
        assert document.Root.Perms.DocMDP == signature
        start, length, after, rest = (int(number) for number in signature.ByteRange)
    assert (start, after + rest) == (0, signed.stat().st_size)
    assert signed.read_bytes()[length : length + 1] == b"<"
    with pikepdf.open(signed) as document:
        metadata = bytes(document.Root.Metadata.read_bytes())
        assert b"<pdfaid:part>3</pdfaid:part>" in metadata or b'pdfaid:part="3"' in metadata


@pytest.mark.parametrize("name", ["gyro_scale.json", "run.json", "profile.toml", "dcc.xml"])
def test_a_swapped_attachment_is_named(name, unsigned, run, tmp_path, calibkit):
    """Another file under the same name does not have the printed digest."""
    data = other("gyro_orthogonality.json", run) if name.endswith(".json") else b"# nothing\n"
    path = changed(unsigned, tmp_path / "swapped.pdf", {name: data})
    found = calibkit("verify", path)
    assert found.code == 4
    assert f"{name}: the attached file is not the one whose SHA-256 is printed" in found.err


@pytest.mark.parametrize(
    ("place", "byte", "word"),
    [
        (rb"MediaBox\[0 0 (5)95", b"2", "not a whole A4 page"),
        (rb"MediaBox\[0 0 595\.2756 (8)41", b"4", "not a whole A4 page"),
        (rb"(\d)\d* 0 obj\s*<<[^>]*/Type\s*/Page\b", b"0", "cannot be read"),
    ],
)
def test_a_page_that_a_viewer_would_hide_is_refused(place, byte, word, unsigned, tmp_path):
    """Half of a page outside of its box, or an object that only some readers find again."""
    content = bytearray(unsigned.read_bytes())
    *_, last = re.finditer(place, content)
    content[last.start(1) : last.end(1)] = byte
    (tmp_path / "c.pdf").write_bytes(content)
    refused(tmp_path / "c.pdf", word)


def test_a_changed_coefficient_is_named_with_and_without_a_right_digest(unsigned, run, tmp_path):
    """The file's own digest, the list of run.json and the printed digest each say so."""
    data = (run.folder / "gyro_scale.json").read_bytes()
    at = data.index(b'"value": ') + len(b'"value": ') + 3
    digit = b"1" if data[at : at + 1] != b"1" else b"2"
    plain = data[:at] + digit + data[at + 1 :]
    refused(
        changed(unsigned, tmp_path / "a.pdf", {"gyro_scale.json": plain}), "gyro_scale.json: digest"
    )
    sealed = other("gyro_scale.json", run)
    both = {"gyro_scale.json": sealed, "run.json": relisted(run, "gyro_scale.json", sealed)}
    refused(
        changed(unsigned, tmp_path / "b.pdf", both),
        "gyro_scale.json",
        "run.json",
        "SHA-256 is printed",
    )


def written(certificate, path):
    """Write a certificate record as PDF."""
    path.write_bytes(pdf.render(certificate, "en"))
    return path


def attached(certificate, changes):
    """The record with other content in its attachments."""
    files = (replace(a, content=changes.get(a.name, a.content)) for a in certificate.attachments)
    return replace(certificate, attachments=tuple(files))


def test_numbers_that_do_not_follow_from_the_attached_files_are_named(record, run, tmp_path):
    """A coefficient changed everywhere but in the printed numbers: every digest is right, the rows
    are not.
    """
    data = other("gyro_scale.json", run)
    forged = attached(
        record, {"gyro_scale.json": data, "run.json": relisted(run, "gyro_scale.json", data)}
    )
    path = written(forged, tmp_path / "forged.pdf")
    refused(path, "principal results: 'scale factor K, gyro a", "is not printed", "dcc.xml")


@pytest.mark.parametrize("release", [dcc.RELEASE, "v9.9.9"])
def test_a_changed_printed_number_is_named(record, tmp_path, monkeypatch, release):
    """One printed value and nothing else: its file and its row are named, whichever release printed
    it.
    """
    monkeypatch.setattr(dcc, "RELEASE", release)
    block = record.blocks[-1]
    table = block.tables[0]
    assert isinstance(table, ListTable)
    first = table.results[0]
    results = (replace(first, value=first.value * 1.001), *table.results[1:])
    blocks = (
        *record.blocks[:-1],
        replace(block, tables=(replace(table, results=results), *block.tables[1:])),
    )
    path = written(replace(record, blocks=blocks), tmp_path / "forged.pdf")
    refused(path, f"{block.file}: 'N", "is not printed")


def test_a_changed_number_in_the_dcc_is_named(record, tmp_path):
    """The digest of the changed DCC is printed, but its numbers are not those of the files."""
    made = next(a for a in record.attachments if a.name == dcc.FILE).content
    at = made.index(b"<si:value>") + len(b"<si:value>")
    end = made.index(b"<", at)
    forged = made[:at] + repr(float(made[at:end]) * (1.0 + 1e-8)).encode() + made[end:]
    refused(
        written(attached(record, {dcc.FILE: forged}), tmp_path / "forged.pdf"), "dcc.xml: value '"
    )


@pytest.mark.parametrize(
    "text",
    [
        "# $ \" ' < & \\ [x] #sys.inputs *bold* _it_",
        "x" * 200,
        "מעבדת כיול \u202eABC\u202c مختبر المعايرة 123.456",
        "office affluent ﬁﬂ naïve Ångström é e\u0301 1.5 −2",
        "bell \x07 and escape \x1b",
        "a very long text that goes on over the edge of the page " * 40,
    ],
)
def test_text_of_every_kind_in_a_profile_raises_no_false_alarm(text, run, tmp_path):
    """What is printed in any script, over page breaks and all, is still that of the attached
    files.
    """
    fields = (
        "certificate.number",
        "laboratory.name",
        "laboratory.address",
        "customer.name",
        "item.type",
        "item.model",
    )
    fields += (
        "method.name",
        "method.deviations",
        "conditions.chamber",
        "conditions.supply",
        "authorised_by.name",
    )
    overrides = [f"{field}={json.dumps(text)}" for field in fields]
    lines = [
        "[[specification]]",
        'result = "gyro_scale.a_about_a.K"',
        'unit = "1/deg"',
        "upper = 1e9",
    ]
    lines += [
        f"name = {json.dumps(text)}",
        "[[type_b]]",
        f"name = {json.dumps(text)}",
        'quantity = "time_s"',
    ]
    lines += ['unit = "ppm"', "half_width = 1"]
    path = tmp_path / "lab.toml"
    path.write_text(
        "\n".join(lines), encoding="utf-8"
    )  # no line end: the overrides stand behind it
    out = tmp_path / "certificate.pdf"
    code = called(
        "certify",
        run.folder,
        *(w for o in overrides for w in ("--set", o)),
        out=out,
        profile=path,
        date=ISSUED,
    )
    assert code == 0
    found = verify.verify(out, instruments.certificate_layout)
    assert any("DRAFT" in warning for warning in found.warnings)


def test_the_dcc_alone_is_checked_by_structure_and_digests(unsigned, tmp_path, calibkit):
    """The file beside the PDF passes with a warning; a changed coefficient file in it, or what is
    no DCC, is refused.
    """
    beside = unsigned.with_suffix(".xml")
    found = calibkit("verify", beside)
    assert found.code == 0
    assert "2 coefficient files" in found.out
    assert "not signed" in found.err
    document = beside.read_bytes()
    at = document.index(b"<dcc:dataBase64>") + len(b"<dcc:dataBase64>") + 400
    damaged = document[:at] + (b"A" if document[at : at + 1] != b"A" else b"B") + document[at + 1 :]
    for k, data in enumerate(
        (damaged, b"<a/>", b"<a", document.replace(b"uniqueIdentifier", b"identifier"))
    ):
        path = tmp_path / f"{k}.xml"
        path.write_bytes(data)
        assert calibkit("verify", path).code == 4


def test_a_key_that_cannot_sign_stops_before_anything_is_written(
    run, key, tmp_path, calibkit, monkeypatch
):
    """No passphrase, a wrong one, no such file, no PKCS#12, an expired certificate: exit 2, no
    certificate.
    """
    out = tmp_path / "certificate.pdf"
    shutil.copy(key.with_suffix(".pem"), tmp_path / "key.pem")
    expired = key_file(tmp_path / "expired.p12", days=(-20, -10))
    cases = [
        (key, None, "CALIBKIT_SIGN_PASSPHRASE is not set"),
        (key, "wrong", "is not its passphrase"),
        (tmp_path / "absent.p12", "x", "No such file"),
        (tmp_path / "key.pem", "x", "no PKCS#12"),
        (expired, "a secret", "is valid from"),
    ]
    for path, passphrase, words in cases:
        monkeypatch.delenv(signing_key.PASSPHRASE, raising=False)
        if passphrase is not None:
            monkeypatch.setenv(signing_key.PASSPHRASE, passphrase)
        found = calibkit("certify", run.folder, "--out", out, "--sign", path)
        assert found.code == 2
        assert words in found.err
        assert passphrase is None or len(passphrase) < 2 or passphrase not in found.err
    assert not list(tmp_path.glob("certificate.*"))


def test_a_draft_is_not_signed(run, key, tmp_path, monkeypatch, calibkit):
    """A signature makes a certificate of what it stands under: exit 2, what is missing, nothing
    written.
    """
    monkeypatch.setenv(signing_key.PASSPHRASE, "a secret")
    out = tmp_path / "c.pdf"
    arguments = (
        "--profile",
        PROFILE,
        "--date",
        ISSUED,
        "--set",
        'customer.name=""',
        "--sign",
        key,
    )
    outcome = calibkit("certify", run.folder, "--out", out, *arguments)
    assert outcome.code == 2
    assert "customer.name" in outcome.err
    assert not out.exists()


def test_a_rejected_run_is_called_one_on_its_first_page_and_by_every_command(
    run, tmp_path, calibkit
):
    """A run that failed its limits: a line on page 1, --json, a warning of certify and one of
    verify.
    """
    from pypdf import PdfReader

    folder = tmp_path / "r001"
    shutil.copytree(run.folder, folder)
    document = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    limit = {"name": "scale_residual", "value": 2.0, "limit": 1.0, "unit": "ppm", "passed": False}
    changed_run = sealed.seal(
        document | {"verdict": "rejected", "accepted": False, "acceptance": [limit]}
    )
    (folder / "run.json").chmod(0o644)
    (folder / "run.json").write_bytes(changed_run.encode())
    out = tmp_path / "c.pdf"
    arguments = ("--profile", PROFILE, "--date", ISSUED, "--set", STATED, "--json")
    outcome = calibkit("certify", folder, "--out", out, *arguments)
    assert outcome.json["accepted"] is False
    assert "failed its acceptance limits: scale_residual" in outcome.err
    assert "failed its acceptance limits: scale_residual" in " ".join(
        PdfReader(out).pages[0].extract_text().split()
    )
    checked = calibkit("verify", out)
    assert checked.code == 0
    assert "failed its acceptance limits" in checked.err


@pytest.mark.parametrize("key", ["certificate.number", "certificate.title"])
@pytest.mark.parametrize("text", ["/ByteRange 7", "a /DocMDP b"])
def test_a_text_that_looks_like_a_signature_is_refused_before_it_is_issued(
    run, tmp_path, capsys, key, text
):
    """`verify` would refuse the certificate as one whose signature was taken off."""
    out = tmp_path / "c.pdf"
    arguments = ("--profile", PROFILE, "--date", ISSUED, "--set", STATED, "--set")
    assert called("certify", run.folder, "--out", out, *arguments, f'{key}="{text}"') == 2
    assert text.split()[0][:8] in capsys.readouterr().err
    assert not out.exists()
