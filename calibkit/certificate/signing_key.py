"""The key that signs a certificate: opened, and checked for what a signature is worth nothing
without.
"""

import contextlib
import datetime as dt
import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibkit.errors import UsageError
from calibkit.libraries import extras

PASSPHRASE = "CALIBKIT_SIGN_PASSPHRASE"  # noqa: S105 (the name of the variable, not what it holds)
_LEAST_BITS = {"rsa": 2048, "rsassa_pss": 2048, "ec": 256}
"""Bits of a key that nobody can compute from its certificate (NIST SP 800-57, part 1, table 2)."""
_BROKEN_DIGESTS = {"md2", "md5", "sha1"}
_USAGES = {"digital_signature", "non_repudiation"}
_PURPOSES = {
    "any_extended_key_usage",
    "email_protection",
    "adobe_authentic_documents_trust",
    "microsoft_document_signing",
    "1.3.6.1.5.5.7.3.36",  # documents (RFC 9336)
}
"""Purposes of a certificate that cover signed documents; one without purposes may do anything."""


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep libraries from logging to stderr what calibkit reports in one line."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


@dataclass(frozen=True, slots=True)
class Key:
    """A PKCS#12 file with its passphrase, the time that the signer claims to sign at, and the
    address of a server of time stamps (RFC 3161), if there is one.
    """

    path: Path
    passphrase: str = field(repr=False)
    now: dt.datetime
    timestamp: str = ""

    def load_signer(self) -> Any:  # noqa: ANN401 (a class of an optional library)
        """Signer of a PKCS#12 file, opened before anything is made; UsageError where it cannot
        sign, OutputError without pyHanko.
        """
        if self.timestamp and not self.timestamp.startswith(("http://", "https://")):
            raise UsageError(
                f"--timestamp {self.timestamp}: not the address of a server",
                hint="state one that begins with http:// or https://",
            )
        signer = _opened(self)
        certificate = signer.signing_cert
        for fault in (*list_weaknesses(certificate), *list_wrong_uses(certificate)):
            raise UsageError(
                f"--sign {self.path}: {fault}", hint="sign with a key that was issued for documents"
            )
        if not is_valid_at(certificate, self.now):
            raise UsageError(
                f"--sign {self.path}: the key's certificate is {format_validity(certificate)}",
                hint="sign with a certificate that is valid now",
            )
        return signer


def is_valid_at(certificate: Any, moment: dt.datetime) -> bool:  # noqa: ANN401 (a class of an optional library)
    """Whether a moment lies within the dates of a certificate."""
    valid = certificate["tbs_certificate"]["validity"]
    return bool(valid["not_before"].native <= moment <= valid["not_after"].native)


def format_validity(certificate: Any) -> str:  # noqa: ANN401 (a class of an optional library)
    """The dates of a certificate in words."""
    valid = certificate["tbs_certificate"]["validity"]
    first, last = valid["not_before"].native, valid["not_after"].native
    return f"valid from {first:%Y-%m-%d} to {last:%Y-%m-%d}"


def list_weaknesses(certificate: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Why anybody could sign in the name of a certificate: a short key, a broken digest."""
    key = certificate.public_key
    least_bits = _LEAST_BITS.get(key.algorithm)
    if least_bits is None:
        yield f"its key is of the kind {key.algorithm}: expected RSA or an elliptic curve"
    elif key.bit_size < least_bits:
        yield (
            f"its {key.algorithm.upper()} key has {key.bit_size} bits: expected at least"
            f" {least_bits}"
        )
    if not certificate.self_issued and certificate.hash_algo in _BROKEN_DIGESTS:
        yield f"its certificate is signed with {certificate.hash_algo}: expected SHA-256 or better"


def list_wrong_uses(certificate: Any) -> Iterator[str]:  # noqa: ANN401 (a class of an optional library)
    """Why a certificate was not issued for signing documents; nothing where it states no use (RFC
    5280, 4.2.1.3 and 4.2.1.12).
    """
    usage, purposes = certificate.key_usage_value, certificate.extended_key_usage_value
    key_usages = set() if usage is None else usage.native
    if usage is not None and not key_usages & _USAGES:
        uses = _listed(key_usages)
        yield f"its certificate is for {uses}: expected digital signature or non repudiation"
    if purposes is not None and not set(purposes.native) & _PURPOSES:
        uses = _listed(purposes.native)
        yield f"its certificate is for {uses}: expected email protection or document signing"


def _listed(uses: Any) -> str:  # noqa: ANN401 (a collection of an optional library)
    """Uses of a key in words."""
    return ", ".join(sorted(use.replace("_", " ") for use in uses)) or "nothing"


def _opened(key: Key) -> Any:  # noqa: ANN401 (a class of an optional library)
    """Signer of a PKCS#12 file with its certificate; UsageError where it cannot be opened."""
    signers = extras.load_library("pyhanko.sign.signers", "sign", "signing needs pyHanko")
    try:
        content = key.path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"--sign {key.path}: {error.strerror}", hint="name a PKCS#12 file (.p12, .pfx)"
        ) from None
    passphrase = key.passphrase.encode() if key.passphrase else None
    with quiet():
        try:
            signer = signers.SimpleSigner.load_pkcs12_data(
                content, other_certs=(), passphrase=passphrase
            )
        except (ValueError, TypeError):
            signer = None
    if signer is None:
        state = "is not its passphrase" if key.passphrase else "is not set"
        raise UsageError(
            f"--sign {key.path}: cannot be opened: {PASSPHRASE} {state}, or it is no PKCS#12 file",
            hint=f"set {PASSPHRASE}",
        )
    if signer.signing_cert is None:
        raise UsageError(
            f"--sign {key.path}: holds no certificate for its key",
            hint="export key and certificate together",
        )
    return signer
