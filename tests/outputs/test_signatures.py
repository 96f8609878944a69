"""Signatures of certificates: who signed, when, whether it counts; what is forged, changed or not
known ends as a refusal.
"""

import datetime as dt
import io

import pytest

from calibkit.certificate import sign, signature_trust, signing_key, verify_signature
from calibkit.commands import pipeline
from calibkit.errors import CalibkitError, UsageError

for needed in ("typst", "lxml", "pypdf", "pyhanko", "pikepdf"):
    pytest.importorskip(needed)
authority = pytest.importorskip("outputs.authority")
attacks = pytest.importorskip("attacks.signed")

PROFILE, STATED = attacks.PROFILE, attacks.STATED
DAY = dt.timedelta(days=1)


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Folder with the keys of a laboratory, of its head, and of a stranger of the same name; the
    certificates of their authorities.
    """
    folder = tmp_path_factory.mktemp("keys")
    own, other = authority.Authority(), authority.Authority("Test authority", 400)
    own.write(folder / "own.pem")
    other.write(folder / "other.pem")
    own.issue(folder / "laboratory.p12")
    own.issue(folder / "head.p12", "Head of laboratory", "p256")
    own.issue(folder / "old.p12", days=(-2200, -1400))
    own.issue(folder / "machine.p12", usage=("key_encipherment",))
    other.issue(folder / "stranger.p12", number=1)
    return folder


@pytest.fixture(scope="module")
def stamps():
    """Address of a server of time stamps, and its authority."""
    issuer = authority.Authority("Stamp authority", 500)
    with authority.serve_stamps(issuer) as url:
        yield url, issuer


@pytest.fixture(scope="module")
def issued(tmp_path_factory, keys):
    """A signed certificate as `certify` writes it; `unsigned.pdf` beside it is another."""
    return attacks.certified(tmp_path_factory.mktemp("issued"), keys / "laboratory.p12")


@pytest.fixture(scope="module")
def plain(issued):
    """The certificate before it was signed."""
    return attacks.unsigned_part(issued.read_bytes())


@pytest.fixture
def passphrase(monkeypatch):
    """The passphrase of every key here, in the environment."""
    monkeypatch.setenv(signing_key.PASSPHRASE, authority.SECRET)


def written(path, document):
    """Write a document; returns its path."""
    path.write_bytes(document)
    return path


def check(document, **demands):
    """Signatures of a document."""
    return verify_signature.check_signatures(document, signature_trust.Demands(**demands))


def faults(document, **demands):
    """Everything that is wrong with the signatures of a document."""
    return [fault for one in check(document, **demands) for fault in one.faults]


def test_only_a_trusted_signer_counts_where_trust_is_asked_for(
    issued, plain, keys, tmp_path, calibkit
):
    """The laboratory's authority and its own certificate pass; a stranger of the same name, a
    certificate for something else, and no signature: exit 4.
    """
    for name in ("own.pem", "laboratory.leaf.pem"):
        found = calibkit("verify", issued, "--trust", keys / name)
        assert (found.code, "(trusted)" in found.out, found.err) == (0, True, "")
    assert calibkit("verify", issued, "--trust", keys / "other.pem").code == 4
    forged = written(tmp_path / "f.pdf", attacks.signed(plain, keys / "stranger.p12"))
    assert calibkit("verify", forged).code == 0
    found = calibkit("verify", forged, "--trust", keys / "own.pem")
    assert (found.code, "not trusted" in found.err) == (4, True)
    unsigned = issued.with_name("unsigned.pdf")
    for demand in (("--require-signature",), ("--trust", keys / "own.pem")):
        found = calibkit("verify", unsigned, *demand)
        assert (found.code, "a signature is required" in found.err) == (4, True)
        run = calibkit("verify", issued.parent / "P" / "r001", *demand)
        assert (run.code, "a signature is required" in run.err) == (4, True)
    assert calibkit("verify", forged, "--require-signature").code == 0


def test_a_key_for_something_else_or_out_of_date_does_not_count(plain, keys, monkeypatch):
    """Made by other programs, which do not look: refused where trust is asked for, a warning where
    it is not.
    """
    monkeypatch.setattr(signing_key, "list_wrong_uses", lambda _: ())
    monkeypatch.setattr(signing_key, "is_valid_at", lambda *_: True)
    made = {name: attacks.signed(plain, keys / f"{name}.p12") for name in ("machine", "old")}
    monkeypatch.undo()
    for name, words in (("machine", "key encipherment"), ("old", "nothing but the signer's own")):
        for root in ("own", name + ".leaf"):  # the key itself is trusted, not what it does here
            found = faults(made[name], trust=(keys / f"{root}.pem",))
            assert any(words in fault for fault in found), (name, root)
        assert any(words in warning for warning in check(made[name])[0].warnings)


def test_the_dcc_is_held_against_the_pdf_that_is_named_with_it(issued, keys, tmp_path, calibkit):
    """The same file is covered by the signature; with a value, customer or unit changed it is exit
    4, in any order, and where the genuine PDF lies beside it without being named; alone it is a
    warning, or exit 4 where a signature is required.
    """
    dcc = issued.with_suffix(".xml")
    for files in ((issued, dcc), (dcc, issued)):
        found = calibkit("verify", *files, "--require-signature", "--trust", keys / "own.pem")
        assert (found.code, found.err) == (0, "")
        assert "its signature covers" in found.out
        assert [line.split(":")[0].split("/")[-1] for line in found.out.splitlines()] == [
            one.name for one in files
        ]
    text = dcc.read_bytes()
    beside = written(tmp_path / "c.pdf", issued.read_bytes())
    for old, new in ((b"Sample customer", b"Other customer!"), (rb"\degree", rb"\radian")):
        assert old in text
        changed = written(tmp_path / "c.xml", text.replace(old, new))
        for files in ((issued, changed), (changed, issued), (changed,)):
            found = calibkit("verify", *files)
            assert (found.code, "is not the dcc.xml that" in found.err) == (4, True)
        assert str(beside) in found.err
        alone = written(tmp_path / "alone.xml", changed.read_bytes())
        assert calibkit("verify", alone).code == 0
        assert calibkit("verify", alone, "--require-signature").code == 4


def test_a_time_stamp_states_when_it_was_signed(plain, keys, stamps, tmp_path, calibkit):
    """A real reply of a server: trusted with its authority, in either option; a warning without;
    its server's certificate is no signer's.
    """
    url, issuer = stamps
    root = issuer.write(tmp_path / "stamps.pem")
    path = written(
        tmp_path / "s.pdf", attacks.signed(plain, keys / "laboratory.p12", stamps=f"{url}/tsa")
    )
    own = ("--trust", keys / "own.pem")
    for option in ("--trust", "--trust-timestamp"):
        found = calibkit("verify", path, *own, option, root, "--json").json["files"][0]
        (one,) = found["signatures"]
        assert (one["trusted"], found["warnings"]) == (True, [])
        stated = dt.datetime.fromisoformat(one["time_stamp"])
        assert abs(stated - dt.datetime.now(dt.UTC)) < dt.timedelta(minutes=5)
    found = calibkit("verify", path, *own)
    assert (found.code, "time stamp of" in found.err) == (0, True)
    assert calibkit("verify", path, "--trust", root).code == 4
    assert calibkit("verify", path, "--trust-timestamp", root, "--require-signature").code == 0


def test_a_time_stamp_of_something_else_is_found(plain, keys, stamps):
    """The token of another signature put into this one: refused."""
    from asn1crypto import cms

    url, _ = stamps
    one, two = (
        attacks.signed(plain, keys / name, stamps=f"{url}/tsa")
        for name in ("laboratory.p12", "stranger.p12")
    )

    def opened(document):
        first, last = attacks._contents(document)
        return (
            first,
            last,
            cms.ContentInfo.load(bytes.fromhex(document[first + 1 : last - 1].decode())),
        )

    first, last, own = opened(one)
    other = opened(two)[2]
    info = own["content"]["signer_infos"][0]
    info["unsigned_attrs"] = other["content"]["signer_infos"][0]["unsigned_attrs"]
    made = own.dump().hex().encode().ljust(last - first - 2, b"0")
    forged = one[: first + 1] + made + one[last - 1 :]
    assert faults(one) == []
    assert "its time stamp is of something else, or was changed" in faults(forged)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("ftp://x", "not the address of a server"),
        ("http://127.0.0.1:9/tsa", "no time stamp"),
        ("/absent", "no time stamp: 404"),
        ("/text", "no time stamp"),
        ("/short", "no time stamp"),
    ],
)
def test_a_server_that_gives_no_time_stamp_leaves_nothing_behind(
    place, words, issued, keys, stamps, tmp_path, passphrase, calibkit
):
    """No server, no such page, a page of text, half a reply: one line, no certificate."""
    address = stamps[0] + place if place.startswith("/") else place
    arguments = ("--profile", PROFILE, "--set", STATED, "--date", "2026-11-21")
    out = tmp_path / "c.pdf"
    found = calibkit(
        "certify", issued.parent / "P" / "r001", *arguments, "--out", out,
        "--sign", keys / "laboratory.p12", "--timestamp", address,
    )  # fmt: skip
    assert found.code in {2, 4}
    assert f"--timestamp {address}: {words}" in found.err
    assert len(found.err.splitlines()) == 1
    assert [*tmp_path.iterdir()] == []


def test_five_years_later_the_time_of_signing_has_to_be_known(
    plain, keys, stamps, tmp_path, calibkit
):
    """The signer's certificate has expired: a time stamp or --at says that it was valid then; where
    neither does, that is said, and refused where trust is asked for.
    """
    url, issuer = stamps
    root = issuer.write(tmp_path / "stamps.pem")
    then = authority.THEN
    key = keys / "old.p12"
    stamped = written(
        tmp_path / "s.pdf", attacks.signed(plain, key, stamps=f"{url}/then", now=then)
    )
    bare = written(tmp_path / "b.pdf", attacks.signed(plain, key, now=then))
    own, on = ("--trust", keys / "own.pem"), ("--at", f"{then:%Y-%m-%d}")
    assert calibkit("verify", stamped, *own, "--trust-timestamp", root).err == ""
    assert calibkit("verify", bare, *own, *on).err == ""
    assert calibkit("verify", bare, *on).code == 0
    found = calibkit("verify", bare)
    assert (found.code, "nothing but the signer's own clock" in found.err) == (0, True)
    found = calibkit("verify", bare, *own)
    assert (found.code, "state --at" in found.err) == (4, True)
    for date in (then - 400 * DAY, then + 700 * DAY):
        found = calibkit("verify", bare, *own, "--at", f"{date:%Y-%m-%d}")
        assert (found.code, "when it was signed" in found.err) == (4, True)
    later = calibkit("verify", bare, *own, "--at", f"{then + 100 * DAY:%Y-%m-%d}")
    assert (later.code, "and it was signed on" in later.err) == (0, True)
    wrong = calibkit("verify", bare, "--at", "yesterday")
    assert (wrong.code, "--at yesterday: not a date" in wrong.err) == (2, True)


def test_a_second_and_third_signature_leave_the_first_valid(
    issued, keys, stamps, tmp_path, passphrase, calibkit
):
    """Checked by, approved by: each covers what was there; all have to be trusted; what is not
    signed, or damaged, or has such a file already, is not signed again.
    """
    url, issuer = stamps
    issuer.write(tmp_path / "stamps.pem")
    checked, approved = tmp_path / "checked.pdf", tmp_path / "approved.pdf"
    head = ("--key", keys / "head.p12", "--role")
    assert calibkit("sign", issued, *head, "checked", "--out", checked).code == 0
    by = ("--key", keys / "stranger.p12", "--role", "approved", "--out", approved)
    assert calibkit("sign", checked, *by, "--timestamp", f"{url}/tsa").code == 0
    assert approved.read_bytes().startswith(checked.read_bytes())
    assert checked.read_bytes().startswith(issued.read_bytes())
    own = ("--trust", keys / "own.pem")
    assert calibkit("verify", checked, *own).err == ""
    assert calibkit("verify", approved, *own).code == 4
    found = calibkit(
        "verify", approved, *own, "--trust", keys / "other.pem", "--trust", tmp_path / "stamps.pem"
    )
    assert (found.code, found.err) == (0, "")
    assert 'checked by "Common Name: Head of laboratory" (trusted)' in found.out
    assert 'approved by "Common Name: Test laboratory" (trusted), time stamp' in found.out
    assert calibkit("sign", issued, *head, "checked", "--out", checked).code == 4
    unsigned = issued.with_name("unsigned.pdf")
    out = tmp_path / "x.pdf"
    assert "is not signed" in calibkit("sign", unsigned, *head, "checked", "--out", out).err
    damaged = written(tmp_path / "d.pdf", issued.read_bytes().replace(b"/ByteRange", b"/ByteRangd"))
    assert calibkit("sign", damaged, *head, "checked", "--out", out).code == 4
    assert calibkit("sign", tmp_path / "no.pdf", *head, "checked", "--out", out).code == 2
    assert not out.exists()


def test_a_further_signature_that_is_seen_or_follows_a_change_is_refused(plain, keys):
    """A stranger's signature with a box over the results; one over an added note."""
    from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
    from pyhanko.sign import fields, signers

    document = attacks.signed(plain, keys / "laboratory.p12")
    own = signing_key.Key(keys / "stranger.p12", authority.SECRET, authority.NOW)
    meta = signers.PdfSignatureMetadata(field_name="Seen", subfilter=fields.SigSeedSubFilter.PADES)
    where = fields.SigFieldSpec("Seen", box=(50, 300, 500, 700))
    signer = signers.PdfSigner(meta, own.load_signer(), new_field_spec=where)
    seen = signer.sign_pdf(IncrementalPdfFileWriter(io.BytesIO(document))).getvalue()
    assert faults(seen)
    noted = attacks.edited(document, "free text", behind=True)
    assert any("by more than" in one for one in faults(attacks.signed(noted, keys / "head.p12")))


def test_a_further_signature_by_another_program_is_accepted_and_hides_no_other_title(plain, keys):
    """The writer of pyHanko as it comes: it writes itself, a date and a later version of PDF beside
    the signature. Another title with it, or any of these without a signature, is a change.
    """
    from pyhanko.pdf_utils import generic
    from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
    from pyhanko.sign import signers

    document = attacks.signed(plain, keys / "laboratory.p12")
    head = signing_key.Key(keys / "head.p12", authority.SECRET, authority.NOW).load_signer()
    meta = signers.PdfSignatureMetadata(field_name="Second", reason="checked")
    writer = IncrementalPdfFileWriter(io.BytesIO(document))
    further = signers.sign_pdf(writer, meta, signer=head).getvalue()
    first, second = check(further, trust=(keys / "own.pem",))
    assert (first.faults, second.faults, second.role) == ((), (), "checked")
    writer = IncrementalPdfFileWriter(io.BytesIO(document))
    info = writer.trailer.raw_get("/Info")
    info.get_object()["/Title"] = generic.pdf_string("FORGED-2026-999")
    writer.mark_update(info)
    retitled = signers.sign_pdf(writer, meta, signer=head).getvalue()
    writer = IncrementalPdfFileWriter(io.BytesIO(document))
    described = writer.root.raw_get("/Metadata")
    stream = described.get_object()
    stream._data = stream.data.replace(b"SAMPLE-2026-003", b"FORGED-2026-999")
    stream._encoded_data = None
    writer.mark_update(described)
    redescribed = signers.sign_pdf(writer, meta, signer=head).getvalue()
    for forged in (retitled, redescribed):
        assert any("by more than" in fault for fault in faults(forged))
    for what in ("version", "metadata"):
        unsigned = attacks.edited(document, what, behind=True)
        writer = IncrementalPdfFileWriter(io.BytesIO(unsigned))
        assert faults(signers.sign_pdf(writer, meta, signer=head).getvalue()), what


def test_what_issuers_say_on_revocation_is_in_the_signature(plain, tmp_path, stamps, passphrase):
    """OCSP and a list of revoked certificates, served here: embedded and covered; a revoked key
    does not sign; an issuer that does not answer is a warning.
    """
    from pyhanko.pdf_utils.reader import PdfFileReader
    from pyhanko.sign.validation.dss import DocumentSecurityStore

    pages = {}
    with authority.serve(pages) as url:
        issuer = authority.Authority(url=url)
        key = signing_key.Key(
            issuer.issue(tmp_path / "k.p12"), authority.SECRET, authority.NOW, f"{stamps[0]}/tsa"
        )
        made = sign.sign_document(plain, key.load_signer(), key)
        assert "no data on revocation" in made.warnings[0]
        pages["/crl"] = (authority.CRL, lambda _: issuer.list_revoked())
        made = sign.sign_document(plain, key.load_signer(), key)
        assert made.warnings == ()
        store = DocumentSecurityStore.read_dss(PdfFileReader(io.BytesIO(made.document)))
        assert (len(store.ocsps), len(store.crls)) == (0, 1)
        pages["/ocsp"] = (authority.OCSP, issuer.answer)
        made = sign.sign_document(plain, key.load_signer(), key)
        store = DocumentSecurityStore.read_dss(PdfFileReader(io.BytesIO(made.document)))
        assert len(store.ocsps) == 1
        root = issuer.write(tmp_path / "root.pem")
        assert faults(made.document, trust=(root,)) == []
        issuer.revoked.add(issuer.last.serial_number)
        with pytest.raises(UsageError, match="revoked"):
            sign.sign_document(plain, key.load_signer(), key)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"kind": "rsa1024"}, "RSA key has 1024 bits: expected at least 2048"),
        ({"kind": "p192"}, "EC key has 192 bits: expected at least 256"),
        ({"usage": ("key_encipherment",)}, "is for key encipherment: expected digital signature"),
        ({"usage": ("key_cert_sign", "crl_sign"), "ca": True}, "is for crl sign, key cert sign"),
        ({"purposes": ("SERVER_AUTH",)}, "is for server auth: expected email protection"),
        ({"days": (-20, -10)}, "valid from"),
    ],
)
def test_a_weak_or_wrong_key_signs_nothing(stated, words, issued, tmp_path, passphrase, calibkit):
    """Exit 2, one line with what was found and what was expected, nothing written."""
    from cryptography.x509.oid import ExtendedKeyUsageOID

    purposes = tuple(getattr(ExtendedKeyUsageOID, one) for one in stated.pop("purposes", ()))
    key = authority.Authority().issue(tmp_path / "k.p12", purposes=purposes, **stated)
    arguments = ("--profile", PROFILE, "--set", STATED, "--date", "2026-11-21", "--sign", key)
    out = tmp_path / "c.pdf"
    found = calibkit("certify", issued.parent / "P" / "r001", *arguments, "--out", out)
    assert (found.code, len(found.err.splitlines()), out.exists()) == (2, 1, False)
    assert f"--sign {key}: " in found.err
    assert words in found.err
    assert calibkit("sign", issued, "--key", key, "--role", "checked", "--out", out).code == 2


@pytest.mark.parametrize(
    "stated",
    [
        {"usage": None},
        {"usage": ("digital_signature",)},
        {"usage": ("content_commitment",)},
        {"purposes": ("EMAIL_PROTECTION", "CLIENT_AUTH")},
        {"kind": "p256"},
        {"kind": "rsa3072"},
    ],
)
def test_a_key_for_documents_signs(stated, plain, tmp_path):
    """Every usage that covers documents, RSA and an elliptic curve."""
    from cryptography.x509.oid import ExtendedKeyUsageOID

    purposes = tuple(getattr(ExtendedKeyUsageOID, one) for one in stated.pop("purposes", ()))
    issuer = authority.Authority()
    key = issuer.issue(tmp_path / "k.p12", purposes=purposes, **stated)
    made = attacks.signed(plain, key)
    assert faults(made, trust=(issuer.write(tmp_path / "root.pem"),)) == []


def outcome(path, document):
    """How `verify` of a document ends: passed, or the exit code."""
    try:
        pipeline.verify(written(path, document))
    except CalibkitError as error:
        return error.exit_code
    return "passed"


def test_no_flipped_bit_is_accepted(plain, keys, stamps, tmp_path):
    """80 bits of a stamped certificate, a third of them in the signature itself; `tests/attacks`
    flips 500.
    """
    document = attacks.signed(plain, keys / "laboratory.p12", stamps=f"{stamps[0]}/tsa")
    assert faults(document) == []
    for name, changed in attacks.flipped(document, 80, 20261121):
        if not faults(changed):  # what says that there is a signature was hit
            assert outcome(tmp_path / "c.pdf", changed) == 4, name


def test_no_change_of_the_bytes_is_accepted(plain, keys, tmp_path):
    """A renamed ByteRange, bytes before and behind, a foreign signature, cuts: exit 4."""
    document = attacks.signed(plain, keys / "laboratory.p12")
    other = attacks.signed(plain, keys / "stranger.p12")
    for name, changed in attacks.bytewise(document, other):
        assert outcome(tmp_path / "c.pdf", changed) == 4, name


@pytest.mark.parametrize(
    "what",
    [
        "XMP",
        "JavaScript",
        "swapped attachment",
        "no AcroForm",
        "no signature",
    ],
)
def test_no_change_of_the_structure_is_accepted(what, plain, keys, tmp_path):
    """In place, behind, behind and signed by a stranger: exit 4; `tests/attacks` tries 127."""
    document = attacks.signed(plain, keys / "laboratory.p12")
    behind = attacks.edited(document, what, behind=True)
    forms = {
        "behind": behind,
        "signed by a stranger": attacks._resigned(behind, keys / "stranger.p12"),
        "packed": attacks.packed(attacks.edited(document, what, behind=False)),
    }
    for name, changed in forms.items():
        assert outcome(tmp_path / "c.pdf", changed) == 4, name
