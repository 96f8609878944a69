"""Signatures of a PDF: whether they cover all of it, and what each of them states.

What nobody signed is not passed over: what stands behind the first signature is further signatures
with what belongs to them, and the last one covers the whole file.
"""

import asyncio
import io
import re
from collections.abc import Iterator, Sequence
from typing import Any

from calibkit import extras
from calibkit.certificate.signature_trust import Demands, JudgedSignature, Signature
from calibkit.certificate.signing_key import quiet
from calibkit.errors import CalibkitError

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
            signatures = asyncio.run(_judge_all(document, reader, demands))
            if any(signature.faults for signature in signatures):
                return signatures
            added = tuple(_list_additions(document, reader.embedded_signatures))
        except CalibkitError:
            raise
        except Exception as error:  # noqa: BLE001 (a damaged file fails in as many ways as it has bytes)
            return (_unreadable("the signed PDF", error),)
    return (Signature(faults=added), *signatures) if added else signatures


def _unreadable(subject: str, error: Exception) -> Signature:
    """A signature that cannot be read, with the reason in one line."""
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return Signature(faults=(f"{subject} cannot be read: {reason}",))


def _list_additions(document: bytes, embedded: Sequence[Any]) -> Iterator[str]:
    """What was put into a document that no signature covers, or that is more than a signature."""
    from pyhanko.sign.diff_analysis import SuspiciousModification
    from pyhanko.sign.validation.status import SignatureCoverageLevel

    if not embedded:
        yield "the PDF has a signature's bytes, but no signature"
    elif any(len(mark.findall(document)) != len(embedded) for mark in _MARKS):
        yield "the PDF has more signatures in it than it shows"
    diff_policy = _allow_signatures()
    for k, signature in enumerate(embedded):
        signature.compute_integrity_info(diff_policy=diff_policy)
        _, _, after, tail_length = (int(number) for number in signature.byte_range)
        if signature is embedded[-1] and after + tail_length != len(document):
            yield "something was added to the PDF after signing"
        elif signature.coverage < SignatureCoverageLevel.ENTIRE_REVISION:
            yield "a signature leaves out a part of what it was put on"
        elif isinstance(signature.diff_result, SuspiciousModification):
            yield "the PDF was changed after signing, by more than a further signature"
        elif (
            signature.docmdp_level
            and signature.diff_result.modification_level.value > signature.docmdp_level.value
        ):
            yield "the PDF was changed after signing, which its signature forbids"
        if k and _is_visible(signature.sig_field):
            yield "a further signature paints over a page"


def _allow_signatures() -> Any:  # noqa: ANN401 (a class of an optional library)
    """Rule on what may follow a signature: further signatures with their data on revocation; no
    metadata, no other field of a form, no annotation.
    """
    from pyhanko.sign import diff_analysis as rules

    level = rules.ModificationLevel.LTA_UPDATES
    return rules.StandardDiffPolicy(
        global_rules=[
            rules.CatalogModificationRule(frozenset({"/AcroForm", "/DSS"})),
            rules.XrefStreamRule().as_qualified(level),
            rules.ObjectStreamRule().as_qualified(level),
            rules.DSSCompareRule().as_qualified(level),
        ],
        form_rule=rules.FormUpdatingRule(
            [rules.SigFieldCreationRule(), rules.SigFieldModificationRule()]
        ),
    )


def _is_visible(sig_field: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether a signature's field takes space on a page."""
    boxes = [sig_field, *(widget.get_object() for widget in sig_field.get("/Kids", ()))]
    corners = (tuple(map(float, widget["/Rect"])) for widget in boxes if "/Rect" in widget)
    return any(x1 != x2 and y1 != y2 for x1, y1, x2, y2 in corners)


async def _judge_all(document: bytes, reader: Any, demands: Demands) -> tuple[Signature, ...]:  # noqa: ANN401
    """Every signature, judged from the last to the first: a time stamp of the document says that
    what it covers is older.
    """
    from pyhanko.sign.validation.dss import DocumentSecurityStore

    roots = demands.load_roots()
    store = DocumentSecurityStore.read_dss(reader) if "/DSS" in reader.root else None
    signatures, stamped = [], None
    for embedded in reversed(reader.embedded_signatures):
        judgement = JudgedSignature(document, embedded, demands, roots, store, stamped)
        try:
            signatures.append(await judgement.judge())
        except Exception as error:  # noqa: BLE001 (a damaged signature fails in as many ways as it has bytes)
            signatures.append(_unreadable("a signature", error))
        if embedded.sig_object_type == "/DocTimeStamp":
            stamped = judgement.stamped
    return tuple(reversed(signatures))
