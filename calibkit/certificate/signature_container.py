"""The bytes of a signature that it does not sign itself: its container, the certificates that
travel with it, its time stamp. Each is what the signed part says, or the signature was changed.
"""

import hashlib
from collections.abc import Iterator
from typing import Any

STAMP = "signature_time_stamp_token"
_CHANGED = "the signature's own bytes were changed"


def find_stamps(signer_info: Any) -> list[Any]:  # noqa: ANN401 (classes of an optional library)
    """Time-stamp tokens (RFC 3161) that a signature carries."""
    attributes = signer_info["unsigned_attrs"]
    return [
        token
        for attribute in (attributes if attributes.native else ())
        if attribute["type"].native == STAMP
        for token in attribute["values"]
    ]


def list_changes(document: bytes, embedded: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Changes of a signature of a document in what it does not sign."""
    start, length, after, tail_length = (int(number) for number in embedded.byte_range)
    gap = document[start + length : after]
    der = _first_value(bytes.fromhex(gap[1:-1].decode("ascii"))) if len(gap) > 2 else b""
    canonical_gap = b"<" + der.hex().upper().encode().ljust(len(gap) - 2, b"0") + b">"
    stamps = find_stamps(embedded.signer_info)
    attributes = embedded.signer_info["unsigned_attrs"]
    unknown = len(attributes) - len(stamps) if attributes.native else 0
    if (
        start != 0
        or after + tail_length > len(document)
        or gap != canonical_gap
        or not _is_regular(der, embedded.signer_cert)
        or len(stamps) > 1
        or unknown
    ):
        yield _CHANGED
    if not _are_known(embedded.signer_info, embedded.signer_cert, embedded.other_embedded_certs):
        yield "a certificate beside the signer's is not one that was signed with"
    for token in stamps:
        yield from _list_token_changes(token)


def _first_value(der: bytes) -> bytes:
    """The first DER value, without the zeros behind it."""
    from asn1crypto.parser import peek

    return der[: peek(der)]


def _list_token_changes(token: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Changes of a time-stamp token in what it does not sign."""
    from pyhanko.sign.validation.generic_cms import extract_certs_for_validation

    certificates = extract_certs_for_validation(token["content"])
    if not _is_regular(token.dump(), certificates.signer_cert):
        yield "the time stamp's own bytes were changed"
    signer_info = token["content"]["signer_infos"][0]
    if not _are_known(signer_info, certificates.signer_cert, certificates.other_certs):
        yield "a certificate beside the time stamp's is not one that it was made with"


def _is_regular(der: bytes, signer: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether the parts of a signature container that are not signed repeat what is signed (RFC
    5652, 5.1 and 5.3), and all of it is written in the one way of DER.
    """
    from asn1crypto import cms, core

    encodings = []
    for parameters in ({"parameters": core.Null()}, {}):
        container = cms.ContentInfo.load(der, strict=True)
        data = container["content"]
        signer_info = data["signer_infos"][0]
        algorithm = {"algorithm": signer_info["digest_algorithm"]["algorithm"].native, **parameters}
        by_issuer_serial = signer_info["sid"].name == "issuer_and_serial_number"
        detached = data["encap_content_info"]["content_type"].native == "data"
        if by_issuer_serial:
            serial = {"issuer": signer.issuer, "serial_number": signer.serial_number}
            signer_info["sid"] = cms.SignerIdentifier(
                "issuer_and_serial_number", cms.IssuerAndSerialNumber(serial)
            )
        signer_info["version"] = "v1" if by_issuer_serial else "v3"
        data["version"] = "v1" if by_issuer_serial and detached else "v3"
        signer_info["digest_algorithm"] = cms.DigestAlgorithm(algorithm)
        data["digest_algorithms"] = cms.DigestAlgorithms([cms.DigestAlgorithm(algorithm)])
        if detached:
            data["encap_content_info"] = cms.ContentInfo({"content_type": "data"})
        encodings.append(container.dump())
    return (
        der in encodings
        and _is_plain(der)
        and signer_info["signature_algorithm"].dump(force=True) in der
    )


def _is_plain(der: bytes) -> bool:
    """Whether lengths are written with the fewest bytes and every value fills the one around it."""
    from asn1crypto import parser

    while der:
        kind, method, tag, header, content, trailer = parser.parse(der)
        if header != parser.emit(kind, method, tag, content)[: len(header)] or trailer:
            return False
        if method and not _is_plain(content):
            return False
        der = der[len(header) + len(content) :]
    return True


def _are_known(signer_info: Any, signer: Any, other_certificates: Any) -> bool:  # noqa: ANN401 (classes of an optional library)
    """Whether every certificate that travels with a signature is one that it names; or, where it
    names its signer's alone, one that another of them signed, or whose issuer does not travel.
    """
    from cryptography import x509

    named_digests = _list_named(signer_info)
    certificates = [
        x509.load_der_x509_certificate(asn1_certificate.dump())
        for asn1_certificate in (signer, *other_certificates)
    ]
    for asn1_certificate, certificate in zip(other_certificates, certificates[1:], strict=True):
        is_named = hashlib.sha256(asn1_certificate.dump()).digest() in named_digests
        issuers = [other for other in certificates if other.subject == certificate.issuer]
        related = any(
            _issued(certificate, other) if issuers else _issued(other, certificate)
            for other in issuers or certificates
        )
        if not is_named and (len(named_digests) > 1 or not related):
            return False
    return True


def _list_named(signer_info: Any) -> set[bytes]:  # noqa: ANN401 (a class of an optional library)
    """Digests (SHA-256) of the certificates that the signed attributes name."""
    from pyhanko.sign.general import NonexistentAttributeError, find_unique_cms_attribute

    try:
        value = find_unique_cms_attribute(signer_info["signed_attrs"], "signing_certificate_v2")
    except NonexistentAttributeError:
        return set()
    return {entry["cert_hash"].native for entry in value["certs"]}


def _issued(certificate: Any, issuer: Any) -> bool:  # noqa: ANN401 (classes of an optional library)
    """Whether one certificate was signed by another."""
    from cryptography.exceptions import InvalidSignature

    try:
        certificate.verify_directly_issued_by(issuer)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return True
