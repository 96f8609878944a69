"""What a certificate's signature states: whether any byte was changed after it, who signed, and
whether the signer is trusted.
"""

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibkit import extras
from calibkit.certificate.sign import quiet
from calibkit.errors import UsageError


@dataclass(frozen=True, slots=True)
class Signature:
    """Who signed, the time that the signer states, faults of the signature, and warnings."""

    signer: str
    claimed: str
    faults: tuple[str, ...]
    warnings: tuple[str, ...]


def load_trust_roots(paths: Sequence[Path]) -> list[Any]:
    """Certificates of PEM or DER files; UsageError for a file that holds none."""
    found: list[Any] = []
    for path in paths:
        keys = extras.load_library("pyhanko.keys", "verify", "signatures need pyHanko")
        try:
            found += keys.load_certs_from_pemder([str(path)])
        except (OSError, ValueError) as error:
            raise UsageError(
                f"--trust {path}: no certificate: {error}", hint="name a PEM or DER file"
            ) from None
    return found


def check_signatures(document: bytes, roots: Sequence[Any]) -> tuple[Signature, ...]:
    """Every signature of a PDF, none for an unsigned one; OutputError without pyHanko where there
    is something to check.
    """
    if b"/ByteRange" not in document:
        return ()
    reader = extras.load_library(
        "pyhanko.pdf_utils.reader",
        "verify",
        "the certificate is signed; its signature needs pyHanko",
    )
    with quiet():
        try:
            embedded = reader.PdfFileReader(io.BytesIO(document), strict=True).embedded_signatures
        except Exception as error:  # noqa: BLE001 (a damaged file fails in as many ways as it has bytes)
            return (Signature("", "", (f"the signed PDF cannot be read: {_one_line(error)}",), ()),)
        if not embedded:
            return (Signature("", "", ("the PDF has a signature's bytes, but no signature",), ()),)
        return tuple(_checked(document, one, roots, last=one is embedded[-1]) for one in embedded)


def _checked(document: bytes, embedded: Any, roots: Sequence[Any], *, last: bool) -> Signature:  # noqa: ANN401
    """One signature (of an optional library's class, hence Any)."""
    from pyhanko.sign.validation import validate_pdf_signature
    from pyhanko_certvalidator import ValidationContext

    try:
        context = ValidationContext(trust_roots=list(roots), allow_fetching=False)
        status = validate_pdf_signature(embedded, signer_validation_context=context)
        *_, after, rest = (int(number) for number in embedded.byte_range)
        signer = status.signing_cert.subject.human_friendly
        claimed = status.signer_reported_dt
        faults = [
            *_status(status, last=last, whole=after + rest == len(document)),
            *_container(document, embedded),
            *_bag(embedded),
        ]
    except Exception as error:  # noqa: BLE001 (a damaged signature fails in as many ways as it has bytes)
        return Signature("", "", (f"the signature cannot be read: {_one_line(error)}",), ())
    warnings = []
    if not faults and not status.trusted:
        warnings.append(f"the signature is intact, but its signer is not trusted: {signer}")
    if not faults and status.docmdp_ok is None:
        warnings.append("the signature is not a certification signature")
    return Signature(
        signer, "" if claimed is None else claimed.isoformat(), tuple(faults), tuple(warnings)
    )


def _one_line(error: Exception) -> str:
    """An exception in one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _status(status: Any, *, last: bool, whole: bool) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Faults that pyHanko found, apart from missing trust."""
    from pyhanko.sign.diff_analysis import ModificationLevel

    if not status.intact:
        yield "a byte was changed after signing: the signed digest is another"
    elif not status.valid:
        yield "the signature was not made by the key of its certificate, or was changed"
    if status.revoked:
        yield "the signer's certificate was revoked"
    if status.docmdp_ok is False:
        yield "the PDF was changed after signing, which its signature forbids"
    if last and status.modification_level != ModificationLevel.LTA_UPDATES and not whole:
        yield "something was added to the PDF after signing"


def _container(document: bytes, embedded: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """The gap that the signature does not cover holds the signature, zeros, and nothing else."""
    from asn1crypto.parser import peek

    start, length, after, rest = (int(number) for number in embedded.byte_range)
    gap = document[start + length : after]
    der = bytes.fromhex(gap[1:-1].decode("ascii")) if len(gap) > 2 else b""
    der = der[: peek(der)] if der else b""  # the first DER value, without the zeros behind it
    plain = {
        b"<" + text.ljust(len(gap) - 2, b"0") + b">"
        for text in (der.hex().encode(), der.hex().upper().encode())
    }
    if (
        start != 0
        or after + rest > len(document)
        or gap not in plain
        or not _regular(der, embedded.signer_cert)
    ):
        yield "the signature's own bytes were changed"


def _regular(der: bytes, signer: Any) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether the parts of the signature container that are not signed repeat what is signed (RFC
    5652, 5.1 and 5.3).
    """
    from asn1crypto import cms, core

    found = []
    for parameters in ({"parameters": core.Null()}, {}):
        made = cms.ContentInfo.load(der, strict=True)
        data = made["content"]
        own = data["signer_infos"][0]
        algorithm = {"algorithm": own["digest_algorithm"]["algorithm"].native, **parameters}
        named = own["sid"].name == "issuer_and_serial_number"
        if named:
            serial = {"issuer": signer.issuer, "serial_number": signer.serial_number}
            own["sid"] = cms.SignerIdentifier(
                "issuer_and_serial_number", cms.IssuerAndSerialNumber(serial)
            )
        own["version"] = data["version"] = "v1" if named else "v3"
        own["digest_algorithm"] = cms.DigestAlgorithm(algorithm)
        data["digest_algorithms"] = cms.DigestAlgorithms([cms.DigestAlgorithm(algorithm)])
        data["encap_content_info"] = cms.ContentInfo({"content_type": "data"})
        found.append(made.dump(force=True))
    return der in found


def _bag(embedded: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Every certificate that travels with a signature is one that it names, or one that is signed
    by another of them.
    """
    from cryptography import x509

    listed = _list_named(embedded)
    every = [
        x509.load_der_x509_certificate(one.dump())
        for one in (embedded.signer_cert, *embedded.other_embedded_certs)
    ]
    for one, certificate in zip(embedded.other_embedded_certs, every[1:], strict=True):
        named = hashlib.sha256(one.dump()).digest() in listed
        issuers = [other for other in every if other.subject == certificate.issuer]
        issued = any(_issued(certificate, issuer) for issuer in issuers)
        if not named and (len(listed) > 1 or not issued):
            yield "a certificate beside the signer's is not one that was signed with"


def _list_named(embedded: Any) -> set[bytes]:  # noqa: ANN401 (a class of an optional library)
    """Digests (SHA-256) of the certificates that the signed attributes name."""
    from pyhanko.sign.general import find_unique_cms_attribute

    value = find_unique_cms_attribute(
        embedded.signer_info["signed_attrs"], "signing_certificate_v2"
    )
    return {entry["cert_hash"].native for entry in value["certs"]}


def _issued(certificate: Any, issuer: Any) -> bool:  # noqa: ANN401 (classes of an optional library)
    """Whether one certificate was signed by another."""
    from cryptography.exceptions import InvalidSignature

    try:
        certificate.verify_directly_issued_by(issuer)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return True
