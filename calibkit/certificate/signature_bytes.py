"""The bytes of a signed PDF that its signatures do not prove by themselves: a signature's own
container, and traces of one that is not there any more.
"""

import hashlib
import re
from collections.abc import Sequence
from typing import Any

from calibkit.certificate.verify_text import compact
from calibkit.certificate.words import SENTENCES

_MARKS = re.compile(
    rb"/ByteRan|/SubFil|ETSI\.|/Adobe\.PPK|adbe\.pkcs7|/DocMDP|/SigFlags|/SigRef|/AcroForm"
    rb"|/DocTimeStamp|/TransformP|<30[0-9A-Fa-f]{400}"
)
_KEYS = frozenset({"/AcroForm", "/Perms", "/DSS", "/ByteRange", "/SubFilter", "/SigFlags"})
_TYPES = frozenset({"/Sig", "/DocTimeStamp", "/SigRef", "/TransformParams", "/DSS"})


def is_canonical(document: bytes, embedded: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether the gap that a signature leaves in a document is its container in hexadecimal and
    nothing else, and the container and its time stamp hold nothing but what was signed.
    """
    from asn1crypto.parser import peek

    start, length, after, _ = (int(number) for number in embedded.byte_range)
    gap = document[start + length : after]
    der = bytes.fromhex(gap[1:-1].decode("ascii"))
    parts = [(der[: peek(der)], embedded.signed_data)]
    attributes = embedded.signer_info["unsigned_attrs"]
    for attribute in attributes if attributes.native else ():
        if attribute["type"].native != "signature_time_stamp_token":
            return False
        parts += [(token.dump(), token["content"]) for token in attribute["values"]]
    return (
        gap == b"<" + parts[0][0].hex().upper().encode().ljust(len(gap) - 2, b"0") + b">"
        and len(parts) <= 2
        and all(_repeats_what_is_signed(*part) for part in parts)
    )


def _repeats_what_is_signed(der: bytes, signed_data: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether the parts of a container that are not signed follow from what is (RFC 5652, 5.1 and
    5.3): versions, algorithms, the name of the signer's certificate; and the certificates beside it
    are among those that the signature names, where it names more than one.
    """
    from asn1crypto import cms, core
    from pyhanko.sign.validation import generic_cms

    certificates = generic_cms.extract_certs_for_validation(signed_data)
    container = cms.ContentInfo.load(der, strict=True)
    data = container["content"]
    (signer_info,) = data["signer_infos"]
    attribute = generic_cms.get_signing_cert_attr(signer_info["signed_attrs"].untag())
    named_digests = [entry["cert_hash"].native for entry in attribute["certs"]] if attribute else []
    other_digests = {hashlib.sha256(other.dump()).digest() for other in certificates.other_certs}
    is_detached = data["encap_content_info"]["content_type"].native == "data"
    by_issuer = signer_info["sid"].name == "issuer_and_serial_number"
    if by_issuer:
        signer = certificates.signer_cert
        name = {"issuer": signer.issuer, "serial_number": signer.serial_number}
        signer_info["sid"] = cms.SignerIdentifier(
            "issuer_and_serial_number", cms.IssuerAndSerialNumber(name)
        )
    signer_info["version"] = "v1" if by_issuer else "v3"
    data["version"] = "v1" if by_issuer and is_detached else "v3"
    if is_detached:
        data["encap_content_info"] = cms.ContentInfo({"content_type": "data"})
    digest, rebuilt = signer_info["digest_algorithm"]["algorithm"].native, []
    # some write no parameters where others write that there are none
    for parameters in ({"parameters": core.Null()}, {}):
        algorithm = cms.DigestAlgorithm({"algorithm": digest, **parameters})
        signer_info["digest_algorithm"] = algorithm
        data["digest_algorithms"] = cms.DigestAlgorithms([algorithm])
        rebuilt.append(container.dump())
    return der in rebuilt and (len(named_digests) < 2 or other_digests <= set(named_digests))


def find_mark(document: bytes) -> str:
    """First bytes in a PDF that signatures alone have, quoted; empty where there are none."""
    match = _MARKS.search(document)
    return f"'{match.group()[:20].decode('ascii')}'" if match else ""


def find_trace(document: bytes, reader: Any, pages: Sequence[str]) -> str:  # noqa: ANN401 (a class of an optional library)
    """What is left of a signature in a PDF, in words; empty where nothing is.

    `reader` is pypdf's of the document, `pages` are the texts of its pages.
    """
    if mark := find_mark(document):
        return mark
    printed = compact("".join(pages))
    if any(compact(text) in printed for text in (SENTENCES["signed"].en, SENTENCES["signed"].zh)):
        return "the printed words that it is signed electronically"
    numbers = {number for offsets in reader.xref.values() for number in offsets}
    for number in sorted(numbers | set(reader.xref_objStm)):
        value = reader.get_object(number)
        if isinstance(value, dict):
            marks = _KEYS & value.keys() | _TYPES & {value.get("/Type"), value.get("/FT")}
            if marks:
                return f"'{min(marks)}'"
    return ""
