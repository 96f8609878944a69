"""A certificate checked by itself: signature, attachments, digests, and that what is printed
follows from what is attached.

The attached files are all that a certificate is made from. So it is made again from them, as a
record, and both its DCC and the text of its pages are compared with that record. An unsigned
certificate can be checked no further: nothing states who made it.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import io
import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from calibkit.certificate import (
    checklist,
    content,
    dcc,
    dcc_xml,
    pdf,
    profile,
    sheet,
    signature_bytes,
    signature_trust,
    verify_signature,
    verify_text,
)
from calibkit.certificate.content import Attachment
from calibkit.certificate.dcc_results import LANGUAGES
from calibkit.certificate.dcc_xml import NAMES, SI
from calibkit.certificate.run_files import AsFoundAsLeft, RunFiles
from calibkit.certificate.signing_key import quiet
from calibkit.errors import CalibkitError, CoefficientError, NotCheckedError, OutputError
from calibkit.libraries import extras
from calibkit.records import coefficients, new_files, run_document, store

if TYPE_CHECKING:
    import datetime as dt
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from lxml.etree import _Element

    from calibkit.certificate.words import Lang

MAGIC = b"%PDF-"
UNSIGNED = "not signed: nothing says who made it"
MOST_PAGES = 500
"""Pages that are read; certificates of the samples have at most eight, and take 0.1 s each."""
MOST = 6
"""Faults that a message lists."""
SAME = 1e-9
"""Relative difference up to which a number recomputed on another machine is the same: far below any
printed digit.
"""


@dataclass(frozen=True, slots=True)
class Verified:
    """What a certificate is, warnings where nothing is wrong with it, its signatures, and the DCC
    that it holds.
    """

    what: str
    warnings: tuple[str, ...] = ()
    signatures: tuple[signature_trust.Signature, ...] = ()
    dcc: bytes = b""


def is_certificate(path: Path) -> bool:
    """Whether a file is to be checked as a certificate: by its name, or because it is a PDF."""
    if path.suffix.lower() in {".pdf", ".xml"}:
        return True
    with path.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def verify(
    path: Path,
    layout_of: content.LayoutOf,
    demands: signature_trust.Demands | None = None,
    schema_dir: Path | None = None,
    pdfs: Mapping[Path, Verified] | None = None,
) -> Verified:
    """Check a certificate; `pdfs` are those that a DCC has to agree with, as they were found
    to be.

    Raises CoefficientError that lists what is wrong, NotCheckedError where a library is absent.
    """
    document = store.read_bytes(path)
    demands = demands or signature_trust.Demands()
    extras.load_checker("lxml.etree")
    if path.suffix.lower() == ".xml":
        return _alone(path, document, demands, schema_dir, pdfs or {})
    signatures = verify_signature.check_signatures(document, demands)
    faults = [fault for signature in signatures for fault in signature.faults]
    warnings = [warning for signature in signatures for warning in signature.warnings]
    pages, attached, twice, trace = _opened(path, document, faults)
    if all(signature.role == signature_trust.STAMP for signature in signatures):
        faults += [f"its signature was taken off or damaged: {trace} is left of it"] * bool(trace)
        warnings.append(UNSIGNED)
    faults += [f"{name} is attached twice" for name in twice]
    faults += _digests(attached, pages)
    count, draft = 0, False
    if not faults:
        remade_faults, count, draft, release = _remade(attached, layout_of, pages, schema_dir)
        faults += remade_faults
        if release not in ("", dcc.RELEASE):
            warnings.append(
                f"made by calibkit {release}, checked by {dcc.RELEASE}: its numbers are those of"
                " its files, its words and budgets were not compared"
            )
    if demands.signed and UNSIGNED in warnings:
        faults.append("not signed, and a signature is required")
    if faults:
        raise _failed(path, faults)
    if draft:
        warnings.append("a DRAFT: not a calibration certificate")
    if _document(attached)["verdict"] == "rejected":
        warnings.append("the run failed its acceptance limits")
    description = _what(attached, signatures, count)
    return Verified(description, tuple(warnings), signatures, attached[dcc.FILE])


def _opened(
    path: Path, document: bytes, faults: Sequence[str]
) -> tuple[list[str], dict[str, bytes], list[str], str]:
    """What `_read` finds in a certificate; CoefficientError, after the faults that are known, for
    what is none.
    """
    try:
        contents = _read(document)
    except CoefficientError as error:
        raise _failed(path, [*faults, error.message]) from None
    except CalibkitError:
        raise
    except Exception as error:  # noqa: BLE001 (a damaged file fails in as many ways as it has bytes)
        raise _failed(path, [*faults, f"the PDF cannot be read: {type(error).__name__}"]) from None
    if not {new_files.RUN_FILE, dcc.FILE} & contents[1].keys():
        raise _failed(
            path, [*faults, "no run.json and no dcc.xml is attached: not a certificate of calibkit"]
        )
    return contents


def _alone(
    path: Path,
    document: bytes,
    demands: signature_trust.Demands,
    schema_dir: Path | None,
    pdfs: Mapping[Path, Verified],
) -> Verified:
    """Check a DCC: structure, schema, the coefficient files in it by their own digests, and that
    one of the PDFs beside it holds the same bytes.
    """
    try:
        root = dcc_xml.read(document, schema_dir)
        files = {
            element.findtext("dcc:fileName", "", NAMES): element
            for element in root.iterfind(".//dcc:byteData", NAMES)
        }
        for name, element in files.items():
            data = base64.b64decode(element.findtext("dcc:dataBase64", "", NAMES))
            coefficients.loads(data.decode("utf-8"), name)
    except (OutputError, CoefficientError, UnicodeDecodeError, binascii.Error) as error:
        raise _failed(path, [_message(error)]) from None
    number = root.findtext(".//dcc:uniqueIdentifier", "", NAMES)
    description = f"DCC {dcc_xml.VERSION} of certificate {number}, {len(files)} coefficient files"
    embedded_dccs = {pdf: verified.dcc for pdf, verified in pdfs.items()} or _held_beside(path)
    matching_pdfs = [pdf for pdf, embedded_dcc in embedded_dccs.items() if embedded_dcc == document]
    if embedded_dccs and not matching_pdfs:
        pdf_list = ", ".join(map(str, embedded_dccs))
        raise _failed(path, [f"it is not the {dcc.FILE} that {pdf_list} holds"])
    if matching_pdfs and matching_pdfs[0] in pdfs and pdfs[matching_pdfs[0]].signatures:
        return Verified(f"{description}, which {matching_pdfs[0]} holds and its signature covers")
    if demands.signed:
        remedy = "name the signed PDF with it, which holds the same file"
        raise _failed(path, [f"not signed, and a signature is required: {remedy}"])
    return Verified(
        description,
        ("not signed: check it together with the certificate that holds the same file",),
    )


def _held_beside(path: Path) -> dict[Path, bytes]:
    """The DCC that a PDF of the same name in the same folder holds, if there is one."""
    other = path.with_suffix(".pdf")
    try:
        attached = _read(store.read_bytes(other))[1]
    except NotCheckedError:
        raise
    except Exception:  # noqa: BLE001 (it is not there, or no PDF: nothing to compare with)
        return {}
    return {other: attached[dcc.FILE]} if dcc.FILE in attached else {}


def _message(error: Exception) -> str:
    """What an error states, without its hint."""
    return error.message if isinstance(error, CalibkitError) else str(error)


def _failed(path: Path, faults: Sequence[str]) -> CoefficientError:
    """The error that lists faults."""
    unique_faults = list(dict.fromkeys(faults))
    omission = f"; and {len(unique_faults) - MOST} more" if len(unique_faults) > MOST else ""
    return CoefficientError(
        f"{path}: {'; '.join(unique_faults[:MOST])}{omission}",
        hint="do not rely on it; ask the laboratory for the original",
    )


def _read(document: bytes) -> tuple[list[str], dict[str, bytes], list[str], str]:
    """Text of every page, every attached file, the names that are attached more than once, and what
    is left of a signature.
    """
    pypdf = extras.load_checker("pypdf")
    with quiet():
        reader = pypdf.PdfReader(io.BytesIO(document))
        if len(reader.pages) > MOST_PAGES:
            raise CoefficientError(f"{len(reader.pages)} pages, at most {MOST_PAGES} are read")
        pages = [page.extract_text() for page in reader.pages]
        attachments = {name: list(contents) for name, contents in reader.attachments.items()}
        trace = signature_bytes.find_trace(document, reader, pages)
    return (
        pages,
        {name: contents[0] for name, contents in attachments.items()},
        [n for n, c in attachments.items() if len(c) > 1],
        trace,
    )


def _digests(attached: Mapping[str, bytes], pages: Sequence[str]) -> Iterator[str]:
    """Attachments whose SHA-256 is not printed, or that are not what they or run.json say they
    are.
    """
    text = verify_text.compact("".join(pages))
    for name, data in attached.items():
        if hashlib.sha256(data).hexdigest() not in text:
            yield f"{name}: the attached file is not the one whose SHA-256 is printed"
    for name in (new_files.RUN_FILE, dcc.FILE):
        if name not in attached:
            yield f"{name} is not attached"
    try:
        run = _document(attached)
    except CoefficientError as error:
        yield error.message
        return
    run_digests = {entry["name"]: entry["sha256"] for entry in run["files"]}
    for name, digest in run_digests.items():
        if name.endswith(".json") and name not in attached:
            yield f"{name} is not attached"
        elif name in attached and hashlib.sha256(attached[name]).hexdigest() != digest:
            yield f"{name}: the attached file is not the one that run.json lists"
    expected_names = {
        *run_digests,
        new_files.RUN_FILE,
        dcc.FILE,
        content.VALIDATION,
        content.PROFILE,
    }
    for name in sorted(attached.keys() - expected_names):
        yield f"{name} does not belong to the run"
    yield from _records(attached, run)


def _records(attached: Mapping[str, bytes], run: Mapping[str, Any]) -> Iterator[str]:
    """Coefficient files that are damaged, changed, or of another run."""
    for name in sorted(attached.keys() & {entry["name"] for entry in run["files"]}):
        try:
            record = coefficients.loads(attached[name].decode("utf-8"), name)
        except (CoefficientError, UnicodeDecodeError) as error:
            yield getattr(error, "message", f"{name}: not UTF-8 text")
            continue
        if (record.serial, record.revision) != (run["serial"], run["revision"]):
            yield f"{name}: of {record.serial} r{record.revision:03d}, not of this run"


def _document(attached: Mapping[str, bytes]) -> dict[str, Any]:
    """The attached run.json, or CoefficientError."""
    data = attached.get(new_files.RUN_FILE, b"").decode("utf-8", errors="replace")
    return run_document.loads(data, new_files.RUN_FILE)


def _remade(
    attached: Mapping[str, bytes],
    layout_of: content.LayoutOf,
    pages: Sequence[str],
    schema_dir: Path | None,
) -> tuple[list[str], int, bool, str]:
    """Where DCC and pages differ from a certificate made from the attached files; how many rows
    agree; whether it is a DRAFT; the release that made it, whose words may be others.
    """
    attached_dcc = attached[dcc.FILE]
    try:
        root = dcc_xml.read(attached_dcc, schema_dir)
        lang, issued, release = _facts(root)
    except (OutputError, ValueError) as error:
        return [_message(error)], 0, False, ""
    words = release == dcc.RELEASE
    release_note = (
        ""
        if words
        else f" (made by calibkit {release}, checked by {dcc.RELEASE}: check it with that)"
    )
    try:
        certificate = _rebuilt(attached, layout_of, issued)
        certificate = certificate.without_glyphs(_unshown(root))
        remade_dcc = dcc.render(certificate, lang)
    except (CalibkitError, KeyError, TypeError, ValueError, UnicodeDecodeError) as error:
        fault = f"the attached files do not make a certificate: {error}{release_note}"
        return [fault], 0, False, release
    faults = [
        f"{dcc.FILE}: {difference}{release_note}"
        for difference in _differences(root, dcc_xml.read(remade_dcc), words=words)
    ]
    data = Attachment(dcc.FILE, attached_dcc, *dcc.DESCRIBED)
    with_dcc = replace(certificate, attachments=(*certificate.attachments, data))
    missing, count = verify_text.find_unprinted(
        pdf.clean_sheet(sheet.sheet(with_dcc, lang), with_dcc.unshown), pages, words=words
    )
    missing = [f"{fault}{release_note}" for fault in missing]
    return [*faults, *missing], count, certificate.draft, release


def _facts(root: _Element) -> tuple[Lang, dt.date, str]:
    """Languages, date of issue, release of calibkit that a DCC states; ValueError where it states
    none.
    """
    import datetime as dt

    core = "dcc:administrativeData/dcc:coreData"
    codes = {element.text for element in root.iterfind(f"{core}/dcc:usedLangCodeISO639_1", NAMES)}
    lang: Lang = next(
        (key for key, language_codes in LANGUAGES.items() if codes == {*language_codes}), "en"
    )
    return (
        lang,
        dt.date.fromisoformat(root.findtext(f"{core}/dcc:issueDate", "", NAMES)),
        root.findtext("dcc:administrativeData/dcc:dccSoftware/dcc:software/dcc:release", "", NAMES),
    )


def _unshown(root: _Element) -> set[str]:
    """Characters that the DCC of a DRAFT says no font had: the fonts are not attached."""
    drafts = (
        s
        for s in root.iterfind("dcc:administrativeData/dcc:statements/dcc:statement", NAMES)
        if s.findtext("dcc:name/dcc:content", "", NAMES).startswith(("DRAFT", "草稿"))
    )
    texts = (
        element.text or ""
        for s in drafts
        for element in s.iterfind("dcc:declaration/dcc:content", NAMES)
    )
    font_texts = (text for text in texts if text.startswith(f"{checklist.FONTS}: "))
    return {
        chr(int(digits, 16))
        for text in font_texts
        for digits in re.findall(r"\[U\+([0-9A-F]{4,6})\]", text)
    }


def _rebuilt(
    attached: Mapping[str, bytes], layout_of: content.LayoutOf, issued: dt.date
) -> content.Certificate:
    """The certificate that the attached files make."""
    document = _document(attached)
    names = [entry["name"] for entry in document["files"] if entry["name"] in attached]
    records = {name: coefficients.loads(attached[name].decode("utf-8"), name) for name in names}
    run, validated = RunFiles(document, records, attached), None
    if content.VALIDATION in attached:
        validated = AsFoundAsLeft.parse(attached[content.VALIDATION], content.VALIDATION, run)
    text = attached.get(content.PROFILE, b"").decode("utf-8")
    certificate_profile = profile.parse(text, content.PROFILE)
    return content.build(run, layout_of, certificate_profile, text, validated, issued)


def _differences(attached_root: _Element, remade_root: _Element, *, words: bool) -> Iterator[str]:
    """First difference between two documents: elements, attributes, texts, numbers to nine digits;
    without `words` those of another release, its own included, are passed over.
    """
    pairs = zip(attached_root.iter(), remade_root.iter(), strict=False)
    place = ""
    for element, remade_element in pairs:
        name = str(element.tag).rpartition("}")[2]
        if (
            element.tag != remade_element.tag
            or element.items() != remade_element.items()
            or len(element) != len(remade_element)
        ):
            yield f"{name} is not what the attached files give{place}"
            return
        compared = words or name not in {"content", "release"}
        numbers = str(element.tag).startswith(f"{{{SI}}}")  # an identifier may look like a number
        same_text = element.text == remade_element.text or (
            numbers and _same(element.text or "", remade_element.text or "")
        )
        if compared and not same_text:
            yield (
                f"{name} '{(element.text or '')[:40]}' is not what the attached files give,"
                f" '{(remade_element.text or '')[:40]}'{place}"
            )
            return
        if name in {"label", "labelXMLList"}:
            place = f", at {(element.text or '').split(' ', 1)[0]}"


def _same(text: str, other_text: str) -> bool:
    """Whether two texts are as many numbers that are alike."""
    items, other_items = text.split(), other_text.split()
    try:
        pairs = [(float(a), float(b)) for a, b in zip(items, other_items, strict=True)]
    except ValueError:
        return False
    return all(math.isclose(a, b, rel_tol=SAME, abs_tol=1e-300) for a, b in pairs)


def _what(
    attached: Mapping[str, bytes], signatures: Sequence[signature_trust.Signature], count: int
) -> str:
    """A certificate in one line."""
    run = _document(attached)
    number = dcc_xml.read(attached[dcc.FILE]).findtext(".//dcc:uniqueIdentifier", "", NAMES)
    signed = "".join(f", {signature}" for signature in signatures)
    return (
        f"certificate {number} of {run['serial']} r{run['revision']:03d}, {len(attached)}"
        f" attachments as printed, {count} rows of numbers as the attached files give them{signed}"
    )
