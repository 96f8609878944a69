"""Signatures that are verified before anybody has them: of who issues a certificate, and of who
checked or approved one that is signed already.
"""

from pathlib import Path
from typing import Any

from calibkit.certificate import content, sign, signature_trust, verify, verify_signature
from calibkit.certificate.signing_key import Key
from calibkit.errors import OutputError, UsageError
from calibkit.records import new_files, store


def countersign(
    issued: Path,
    out: Path,
    layout_of: content.LayoutOf,
    key: Key,
    role: str,
    trust: tuple[Path, ...] = (),
    *,
    dry_run: bool,
) -> tuple[str, ...]:
    """Write a signed certificate with one signature more, of who checked or approved it; returns
    what `verify` warns of, and what the signature could not hold. Nothing is overwritten.

    With `trust`, files of certificates, every signature before has to be by a trusted signer.

    Raises CoefficientError for a certificate that does not verify, UsageError for a key that cannot
    sign or a certificate that nobody signed before, NotCheckedError where a library is absent.
    """
    if not issued.is_file():
        raise UsageError(f"{issued}: no such file", hint="name a signed certificate")
    new_files.refuse_existing(out)
    signer = key.load_signer()
    verified = verify.verify(issued, layout_of, signature_trust.Demands(key.now, trust))
    if not verified.signatures:
        raise UsageError(
            f"{issued}: is not signed", hint="issue it with calibkit certify --sign first"
        )
    signed = sign_checked(store.read_bytes(issued), signer, key, role)
    new_files.write_all({out: signed.document}, dry_run=dry_run)
    return (*verified.warnings, *signed.warnings)


def sign_checked(document: bytes, signer: Any, key: Key, role: str = "") -> sign.Signed:  # noqa: ANN401 (a class of an optional library)
    """A document with one signature more; OutputError where it would not verify."""
    signed = sign.sign_document(document, signer, key, role)
    signatures = verify_signature.check_signatures(
        signed.document, signature_trust.Demands(now=key.now)
    )
    if faults := [fault for signature in signatures for fault in signature.faults]:
        raise OutputError(
            f"--sign {key.path}: the signature does not verify: {faults[0]}",
            hint="sign with another key, or without --timestamp",
        )
    return signed
