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
    from pyhanko.sign.validation.generic_cms import extract_certs_for_validation

    start, length, after, _ = (int(number) for number in embedded.byte_range)
    gap = document[start + length : after]
    der = bytes.fromhex(gap[1:-1].decode("ascii"))
    der = der[: peek(der)]
    if gap != b"<" + der.hex().upper().encode().ljust(len(gap) - 2, b"0") + b">":
        return False
    attributes = embedded.signer_info["unsigned_attrs"]
    tokens = [
        token
        for attribute in (attributes if attributes.native else ())
        if attribute["type"].native == "signature_time_stamp_token"
        for token in attribute["values"]
    ]
    if len(tokens) > 1 or len(tokens) != len(attributes if attributes.native else ()):
        return False
    stamps = [(token.dump(), extract_certs_for_validation(token["content"])) for token in tokens]
    certificates = extract_certs_for_validation(embedded.signed_data)
    return all(_repeats_what_is_signed(*part) for part in [(der, certificates), *stamps])


def _repeats_what_is_signed(der: bytes, certificates: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether the parts of a container that are not signed follow from what is (RFC 5652, 5.1 and
    5.3): versions, algorithms, the name of the signer's certificate; and the certificates beside it
    are among those that the signature names, where it names more than one.
    """
    from asn1crypto import cms, core
    from pyhanko.sign.validation.generic_cms import get_signing_cert_attr

    container = cms.ContentInfo.load(der, strict=True)
    data = container["content"]
    (signer_info,) = data["signer_infos"]
    signer, digest = certificates.signer_cert, signer_info["digest_algorithm"]["algorithm"].native
    named = get_signing_cert_attr(signer_info["signed_attrs"].untag())
    digests = [] if named is None else [entry["cert_hash"].native for entry in named["certs"]]
    others = [hashlib.sha256(other.dump()).digest() for other in certificates.other_certs]
    is_detached = data["encap_content_info"]["content_type"].native == "data"
    is_named = signer_info["sid"].name == "issuer_and_serial_number"
    if is_named:
        name = {"issuer": signer.issuer, "serial_number": signer.serial_number}
        signer_info["sid"] = cms.SignerIdentifier(
            "issuer_and_serial_number", cms.IssuerAndSerialNumber(name)
        )
    signer_info["version"] = "v1" if is_named else "v3"
    data["version"] = "v1" if is_named and is_detached else "v3"
    if is_detached:
        data["encap_content_info"] = cms.ContentInfo({"content_type": "data"})
    rebuilt = []  # some write no parameters where others write none of them
    for parameters in ({"parameters": core.Null()}, {}):
        algorithm = cms.DigestAlgorithm({"algorithm": digest, **parameters})
        signer_info["digest_algorithm"] = algorithm
        data["digest_algorithms"] = cms.DigestAlgorithms([algorithm])
        rebuilt.append(container.dump())
    return der in rebuilt and (len(digests) < 2 or set(others) <= set(digests))


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
