"""A certificate checked by itself: signature, attachments, digests, and that what is printed
follows from what is attached.

The attached files are all that a certificate is made from. So it is made again from them, as a
record, and both its DCC and the text of its pages are compared with that record. An unsigned
certificate can be checked no further: nothing states who made it, and nothing covers what its
figures and fonts look like.
"""

from __future__ import annotations

import base64
import binascii
import datetime as dt
import hashlib
import io
import math
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from calibkit.certificate import (
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
from calibkit.certificate.dcc_results import LANGUAGES
from calibkit.certificate.dcc_xml import NAMES, SI
from calibkit.certificate.run_files import AsFoundAsLeft, RunFiles
from calibkit.certificate.signing_key import quiet
from calibkit.errors import CalibkitError, CoefficientError, NotCheckedError
from calibkit.libraries import extras
from calibkit.records import coefficients, new_files, store

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from lxml.etree import _Element

    from calibkit.certificate.words import Lang

MAGIC = b"%PDF-"
UNSIGNED = (
    "not signed: nothing says who made it; figures and fonts are not checked, only texts and files"
)
A4_PT = (595.2756, 841.8898)
"""Width and height of a page [pt]."""
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


@dataclass(frozen=True, slots=True)
class _OpenedPdf:
    """Text of every page of a certificate, its attached files, and what is left of a signature."""

    pages: list[str]
    attached: dict[str, bytes]
    trace: str


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
        return _verify_dcc(path, document, demands, schema_dir, pdfs or {})
    signatures = verify_signature.check_signatures(document, demands)
    faults = [fault for signature in signatures for fault in signature.faults]
    warnings = [warning for signature in signatures for warning in signature.warnings]
    try:
        opened = _open(document)
        is_signed = any(signature.role != signature_trust.STAMP for signature in signatures)
        if not is_signed:
            if opened.trace:
                faults.append(f"its signature was taken off or damaged: {opened.trace} is left")
            if demands.signed:
                faults.append("not signed, and a signature is required")
            warnings.append(UNSIGNED)
        faults += _check_digests(opened)
        run = RunFiles.parse(opened.attached)
        own_names = {new_files.RUN_FILE, dcc.FILE, content.VALIDATION, content.PROFILE}
        others = opened.attached.keys() - run.records.keys() - own_names
        faults += [f"{name} does not belong to the run" for name in sorted(others)]
        if faults:
            raise _failure(path, faults)
        certificate, root, release = _make_again(run, layout_of, schema_dir)
        made_by = f"made by calibkit {release}, checked by {dcc.RELEASE}"
        different, count = _compare(certificate, root, opened.pages, words=release == dcc.RELEASE)
    except NotCheckedError:
        raise
    except CalibkitError as error:
        raise _failure(path, [*faults, error.message]) from None
    if release != dcc.RELEASE:
        different = [f"{fault} ({made_by}: check it with that)" for fault in different]
        warnings.append(
            f"{made_by}: its numbers are those of its files, its words and budgets were not"
            " compared"
        )
    if different:
        raise _failure(path, different)
    if certificate.draft:
        warnings.append("a DRAFT: not a calibration certificate")
    if run.document["verdict"] == "rejected":
        warnings.append("the run failed its acceptance limits")
    number = root.findtext(".//dcc:uniqueIdentifier", "", NAMES)
    signed = "".join(f", {signature}" for signature in signatures)
    description = (
        f"certificate {number} of {run.document['serial']} r{run.document['revision']:03d},"
        f" {len(opened.attached)} attachments as printed, {count} rows of numbers as the attached"
        f" files give them{signed}"
    )
    return Verified(description, tuple(warnings), signatures, opened.attached[dcc.FILE])


def _verify_dcc(
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
        files = root.findall(".//dcc:byteData", NAMES)
        for element in files:
            name = element.findtext("dcc:fileName", "", NAMES)
            data = base64.b64decode(element.findtext("dcc:dataBase64", "", NAMES))
            coefficients.loads(store.decode(data, name), name)
    except CalibkitError as error:
        raise _failure(path, [error.message]) from None
    except binascii.Error:
        raise _failure(path, [f"{name}: not in base64, or cut off"]) from None
    number = root.findtext(".//dcc:uniqueIdentifier", "", NAMES)
    description = f"DCC {dcc_xml.VERSION} of certificate {number}, {len(files)} coefficient files"
    embedded_dccs = {pdf: verified.dcc for pdf, verified in pdfs.items()} or _find_beside(path)
    matching_pdfs = [pdf for pdf, embedded_dcc in embedded_dccs.items() if embedded_dcc == document]
    if embedded_dccs and not matching_pdfs:
        pdf_list = ", ".join(map(str, embedded_dccs))
        raise _failure(path, [f"it is not the {dcc.FILE} that {pdf_list} holds"])
    if matching_pdfs and matching_pdfs[0] in pdfs and pdfs[matching_pdfs[0]].signatures:
        return Verified(f"{description}, which {matching_pdfs[0]} holds and its signature covers")
    if demands.signed:
        remedy = "name the signed PDF with it, which holds the same file"
        raise _failure(path, [f"not signed, and a signature is required: {remedy}"])
    remedy = "check it together with the certificate that holds the same file"
    return Verified(description, (f"not signed: {remedy}",))


def _find_beside(path: Path) -> dict[Path, bytes]:
    """The DCC that a PDF of the same name in the same folder holds, if there is one."""
    other = path.with_suffix(".pdf")
    try:
        return {other: _open(store.read_bytes(other)).attached[dcc.FILE]}
    except NotCheckedError:
        raise
    except (CalibkitError, KeyError):
        return {}


def _failure(path: Path, faults: Sequence[str]) -> CoefficientError:
    """The error that lists faults."""
    unique_faults = list(dict.fromkeys(faults))
    omission = f"; and {len(unique_faults) - MOST} more" if len(unique_faults) > MOST else ""
    return CoefficientError(
        f"{path}: {'; '.join(unique_faults[:MOST])}{omission}",
        hint="do not rely on it; ask the laboratory for the original",
    )


def _open(document: bytes) -> _OpenedPdf:
    """Pages and files of a certificate; CoefficientError for what is none."""
    pypdf = extras.load_checker("pypdf")
    try:
        with quiet():
            # strict: what it would mend, a viewer may leave out
            reader = pypdf.PdfReader(io.BytesIO(document), strict=True)
            if len(reader.pages) > MOST_PAGES:
                raise CoefficientError(  # noqa: TRY301 (pages are counted as they are read)
                    f"{len(reader.pages)} pages, at most {MOST_PAGES} are read"
                )
            cut = [n for n, page in enumerate(reader.pages, start=1) if not _is_whole(page)]
            if cut:
                raise CoefficientError(  # noqa: TRY301 (the same)
                    f"page {cut[0]} is not a whole A4 page: a viewer may hide part of it"
                )
            pages = [page.extract_text() for page in reader.pages]
            attachments = {name: list(contents) for name, contents in reader.attachments.items()}
            trace = signature_bytes.find_trace(document, reader, pages)
    except CalibkitError:
        raise
    except Exception as error:  # a damaged file fails in as many ways as it has bytes
        raise CoefficientError("the PDF is damaged: it cannot be read") from error
    if not {new_files.RUN_FILE, dcc.FILE} & attachments.keys():
        raise CoefficientError(
            "no run.json and no dcc.xml is attached: not a certificate of calibkit"
        )
    for name, contents in attachments.items():
        if len(contents) > 1:
            raise CoefficientError(f"{name} is attached twice")
    return _OpenedPdf(pages, {name: contents[0] for name, contents in attachments.items()}, trace)


def _is_whole(page: Any) -> bool:  # noqa: ANN401 (pypdf is loaded late)
    """Whether a viewer shows all of a page as it was made."""
    edges = [
        abs(float(edge) - of_a4) < 0.01
        for box in (page.mediabox, page.cropbox)
        for edge, of_a4 in zip(box, (0.0, 0.0, *A4_PT), strict=True)
    ]
    return all(edges) and page.rotation == 0


def _check_digests(opened: _OpenedPdf) -> Iterator[str]:
    """Attached files whose SHA-256 is not printed, and those that are missing or too many."""
    text = verify_text.compact("".join(opened.pages))
    for name, data in opened.attached.items():
        if hashlib.sha256(data).hexdigest() not in text:
            yield f"{name}: the attached file is not the one whose SHA-256 is printed"
    if dcc.FILE not in opened.attached:
        yield f"{dcc.FILE} is not attached"


def _make_again(
    run: RunFiles, layout_of: content.LayoutOf, schema_dir: Path | None
) -> tuple[content.Certificate, _Element, str]:
    """The certificate that the attached files make, with the DCC as it is attached, the root of
    this DCC, and the release that made it.
    """
    attached = run.contents
    root = dcc_xml.read(attached[dcc.FILE], schema_dir)
    validated = None
    if content.VALIDATION in attached:
        validated = AsFoundAsLeft.parse(attached[content.VALIDATION], content.VALIDATION, run)
    text = store.decode(attached.get(content.PROFILE, b""), content.PROFILE)
    try:
        issued = dt.date.fromisoformat(root.findtext(".//dcc:issueDate", "", NAMES))
        certificate = content.build(
            *(run, layout_of, profile.parse(text, content.PROFILE), text, validated, issued)
        )
    except CalibkitError as error:
        raise CoefficientError(
            f"the attached files do not make a certificate: {error.message}"
        ) from None
    except (KeyError, TypeError, ValueError) as error:
        raise CoefficientError(
            "the attached files do not make a certificate: they do not fit each other, or"
            f" {dcc.FILE} states no date of issue"
        ) from error
    data = content.Attachment(dcc.FILE, attached[dcc.FILE], *dcc.DESCRIBED)
    certificate = replace(certificate, attachments=(*certificate.attachments, data))
    return certificate, root, root.findtext(".//dcc:software/dcc:release", "", NAMES)


def _compare(
    certificate: content.Certificate, root: _Element, pages: Sequence[str], *, words: bool
) -> tuple[list[str], int]:
    """Where an attached DCC and the pages differ from a certificate, and how many rows of numbers
    agree; without `words` numbers alone, as another release may have other words.
    """
    codes = {element.text for element in root.iterfind(".//dcc:usedLangCodeISO639_1", NAMES)}
    lang: Lang = next((key for key, of_lang in LANGUAGES.items() if codes == {*of_lang}), "en")
    without_dcc = replace(certificate, attachments=certificate.attachments[:-1])
    remade = dcc_xml.read(dcc.render(without_dcc, lang))
    faults = [f"{dcc.FILE}: {fault}" for fault in _differences(root, remade, words=words)]
    printed = pdf.clean_sheet(sheet.sheet(certificate, lang))
    missing, count = verify_text.find_unprinted(printed, pages, words=words)
    return [*faults, *missing], count


def _differences(attached_root: _Element, remade_root: _Element, *, words: bool) -> Iterator[str]:
    """First difference between two documents: elements, attributes, texts, numbers to nine digits;
    without `words` those of D-SI alone.
    """
    place = ""
    attached, remade = (
        [element for element in root.iter() if words or str(element.tag).startswith(f"{{{SI}}}")]
        for root in (attached_root, remade_root)
    )
    for element, expected in zip_longest(attached, remade):
        name = str((element if expected is None else expected).tag).rpartition("}")[2]
        if (
            element is None
            or expected is None
            or element.tag != expected.tag
            or element.items() != expected.items()
        ):
            yield f"{name} is not what the attached files give{place}"
            return
        text, expected_text = element.text or "", expected.text or ""
        # an identifier outside of D-SI may look like a number
        is_number = str(element.tag).startswith(f"{{{SI}}}")
        if text != expected_text and not (is_number and _same(text, expected_text)):
            yield (
                f"{name} '{text[:40]}' is not what the attached files give,"
                f" '{expected_text[:40]}'{place}"
            )
            return
        if name in {"label", "labelXMLList"}:
            place = f", at {text.split(' ', 1)[0]}"


def _same(text: str, other_text: str) -> bool:
    """Whether two texts are as many numbers that are alike."""
    items, other_items = text.split(), other_text.split()
    try:
        pairs = [(float(a), float(b)) for a, b in zip(items, other_items, strict=True)]
    except ValueError:
        return False
    return all(math.isclose(a, b, rel_tol=SAME, abs_tol=1e-300) for a, b in pairs)
