"""Signatures of a PDF, judged by pyHanko: whether each holds, when it was made, what was put into
the document behind it; and whether its signer is one who may sign.

What nobody signed is not passed over: what stands behind the first signature is further signatures
with what belongs to them, and the last one covers the whole file.
"""

import asyncio
import io
import re
from collections.abc import Iterator
from typing import Any

from calibkit.certificate import signature_bytes
from calibkit.certificate.signature_trust import Demands, JudgedSignature, Signature
from calibkit.certificate.signing_key import quiet
from calibkit.errors import CalibkitError
from calibkit.libraries import extras

_MARKS = (re.compile(rb"/ByteRange"), re.compile(rb"/Contents\s*<30"))
"""What every signature has once."""


def check_signatures(document: bytes, demands: Demands) -> tuple[Signature, ...]:
    """Every signature of a PDF, none for an unsigned one; NotCheckedError without pyHanko where
    there is something to check.
    """
    if b"/ByteRange" not in document:
        return ()
    extras.load_checker("pyhanko.sign.validation")
    reading = extras.load_checker("pyhanko.pdf_utils.reader")
    with quiet():
        try:
            reader = reading.PdfFileReader(io.BytesIO(document), strict=True)
            return asyncio.run(_judge_all(document, reader, demands))
        except CalibkitError:
            raise
        except Exception as error:  # noqa: BLE001 (a damaged file fails in as many ways as it has bytes)
            return (_unreadable("the signed PDF", error),)


def _unreadable(subject: str, error: Exception) -> Signature:
    """A signature that cannot be read, with the reason in one line."""
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return Signature(faults=(f"{subject} cannot be read: {reason}",))


async def _judge_all(document: bytes, reader: Any, demands: Demands) -> tuple[Signature, ...]:  # noqa: ANN401 (a class of an optional library)
    """Every signature, judged from the last to the first: a time stamp of the document says that
    what it covers is older.
    """
    from pyhanko.sign.validation.dss import DocumentSecurityStore

    roots = demands.load_roots()
    store = DocumentSecurityStore.read_dss(reader) if "/DSS" in reader.root else None
    signatures, stamped = [], None
    for embedded in reversed(reader.embedded_signatures):
        judgement = JudgedSignature(embedded, demands, roots, store, stamped)
        try:
            judgement.faults += _list_additions(document, embedded)
            signatures.append(await judgement.judge())
        except Exception as error:  # noqa: BLE001 (a damaged signature fails in as many ways as it has bytes)
            signatures.append(_unreadable("a signature", error))
        if embedded.sig_object_type == "/DocTimeStamp":
            stamped = judgement.stamped
    if any(len(mark.findall(document)) != len(signatures) for mark in _MARKS):
        signatures.append(Signature(faults=("the PDF has other signatures in it than it shows",)))
    return tuple(reversed(signatures))


def _list_additions(document: bytes, embedded: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """What was put into a document that a signature does not cover, but for further signatures."""
    from pyhanko.sign.validation.status import SignatureCoverageLevel

    embedded.compute_integrity_info(diff_policy=_allow_signatures(embedded.reader))
    state = embedded.summarise_integrity_info()
    _, _, after, tail_length = (int(number) for number in embedded.byte_range)
    signatures = embedded.reader.embedded_signatures
    first, last = signatures[0], signatures[-1]
    if not signature_bytes.is_canonical(document, embedded):
        yield "the signature's own bytes were changed"
    if embedded is last and after + tail_length != len(document):
        yield "something was added to the PDF after signing"
    elif state["coverage"] < SignatureCoverageLevel.ENTIRE_REVISION:
        yield "a signature leaves out a part of what it was put on"
    elif not state["docmdp_ok"] or _describe(embedded, last) != _describe(embedded, embedded):
        yield "the PDF was changed after signing, by more than a further signature"
    if embedded is not first and _is_visible(embedded.sig_field):
        yield "a further signature paints over a page"


def _allow_signatures(reader: Any) -> Any:  # noqa: ANN401 (a class of an optional library)
    """Rule on what may follow a signature: further signatures with their data on revocation, no
    other field of a form, no annotation. With a signature other programs also write themselves and
    the date into the metadata, and a later version of PDF; what nobody signed at once writes
    neither.
    """
    from pyhanko.sign import diff_analysis as rules

    catalog = {"/AcroForm", "/DSS"}
    further = [rules.XrefStreamRule(), rules.ObjectStreamRule(), rules.DSSCompareRule()]
    signed = {embedded.signed_revision for embedded in reader.embedded_signatures}
    if signed >= set(range(min(signed), reader.xrefs.total_revisions)):
        catalog |= {"/Extensions", "/Metadata", "/Version"}
        further += [rules.DocInfoRule(), rules.MetadataUpdateRule()]
    level = rules.ModificationLevel.LTA_UPDATES
    fields = [rules.SigFieldCreationRule(), rules.SigFieldModificationRule()]
    return rules.StandardDiffPolicy(
        [rules.CatalogModificationRule(catalog), *(rule.as_qualified(level) for rule in further)],
        rules.FormUpdatingRule(fields),
    )


def _describe(embedded: Any, until: Any) -> list[Any]:  # noqa: ANN401 (classes of an optional library)
    """What a document says of itself up to a signature, but for the date of its last change and the
    programs that wrote it.
    """
    from pyhanko.pdf_utils.metadata import model, xmp_xml

    reader, revision = embedded.reader, until.signed_revision
    document = reader.get_historical_resolver(revision)
    info: dict[str, Any] = {}
    fields: dict[Any, list[Any]] = {}
    if reference := document.trailer_view.get_value_as_reference("/Info", optional=True):
        info |= reader.get_object(reference, revision=revision)
    if reference := document.root.get_value_as_reference("/Metadata", optional=True):
        stream = reader.get_object(reference, revision=revision)
        for structure in xmp_xml.parse_xmp(io.BytesIO(stream.data)):
            for name, value in structure:  # a name that stands twice has both values
                fields.setdefault(name, []).append(value)
    for written in (model.XMP_MODDATE, model.PDF_PRODUCER):
        fields.pop(written, None)
    return [{key: info[key] for key in info if key not in {"/ModDate", "/Producer"}}, fields]


def _is_visible(sig_field: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether a signature's field takes space on a page."""
    boxes = [sig_field, *(widget.get_object() for widget in sig_field.get("/Kids", ()))]
    corners = (tuple(map(float, widget["/Rect"])) for widget in boxes if "/Rect" in widget)
    return any(x1 != x2 and y1 != y2 for x1, y1, x2, y2 in corners)
