"""A certificate signed with the user's key: PAdES, a certification signature that allows no change,
over the whole file.
"""

import asyncio
import contextlib
import datetime as dt
import io
import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibkit import extras
from calibkit.errors import UsageError

FIELD = "Signature"
PASSPHRASE = "CALIBKIT_SIGN_PASSPHRASE"  # noqa: S105 (the name of the variable, not what it holds)


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
    """A PKCS#12 file with its passphrase, and the time that the signer claims to sign at."""

    path: Path
    passphrase: str = field(repr=False)
    now: dt.datetime

    def load_signer(self) -> Any:  # noqa: ANN401 (a class of an optional library)
        """Signer of a PKCS#12 file, opened before anything is made; UsageError where it cannot
        sign, OutputError without pyHanko.
        """
        found = _opened(self)
        valid = found.signing_cert["tbs_certificate"]["validity"]
        first, last = valid["not_before"].native, valid["not_after"].native
        if not first <= self.now <= last:
            raise UsageError(
                f"--sign {self.path}: the key's certificate is valid from {first:%Y-%m-%d} to"
                f" {last:%Y-%m-%d}",
                hint="sign with a certificate that is valid now",
            )
        found.signed_attr_prov_spec = _attributes(found)
        return found


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
            found = signers.SimpleSigner.load_pkcs12_data(
                content, other_certs=(), passphrase=passphrase
            )
        except (ValueError, TypeError):
            found = None
    if found is None:
        state = "is not its passphrase" if key.passphrase else "is not set"
        raise UsageError(
            f"--sign {key.path}: cannot be opened: {PASSPHRASE} {state}, or it is no PKCS#12 file",
            hint=f"set {PASSPHRASE}",
        )
    if found.signing_cert is None:
        raise UsageError(
            f"--sign {key.path}: holds no certificate for its key",
            hint="export key and certificate together",
        )
    return found


def _attributes(by: Any) -> Any:  # noqa: ANN401 (classes of an optional library)
    """Signed attributes: every certificate that travels with the signature by its digest (RFC
    5035), the signer's first.

    So none of them can be changed or replaced either, though the signature itself only needs the
    signer's.
    """
    from asn1crypto import tsp
    from pyhanko.sign.attributes import SignedAttributeProviderSpec, SigningCertificateV2Provider
    from pyhanko.sign.general import as_signing_certificate_v2

    class Chain(SigningCertificateV2Provider):
        async def build_attr_value(self, dry_run: bool = False) -> tsp.SigningCertificateV2:  # noqa: ARG002, FBT001, FBT002 (pyHanko's signature)
            others = [one for one in by.cert_registry if one.dump() != by.signing_cert.dump()]
            listed = [
                as_signing_certificate_v2(one)["certs"][0] for one in (by.signing_cert, *others)
            ]
            return tsp.SigningCertificateV2({"certs": listed})

    class Attributes(SignedAttributeProviderSpec):
        def signed_attr_providers(self, data_digest: bytes, digest_algorithm: str) -> list[Chain]:  # noqa: ARG002 (the same)
            return [Chain(by.signing_cert)]

    return Attributes()


def sign_document(document: bytes, by: Any, now: dt.datetime) -> bytes:  # noqa: ANN401 (a class of an optional library)
    """The document with a signature behind it; what was there stays as it is, byte for byte.

    `now` stands in the signature as the time that the signer claims.
    """
    from pyhanko.sign import fields, signers

    meta = signers.PdfSignatureMetadata(
        field_name=FIELD,
        certify=True,
        subfilter=fields.SigSeedSubFilter.PADES,
        docmdp_permissions=fields.MDPPerm.NO_CHANGES,
        md_algorithm="sha256",
    )
    made = fields.SigFieldSpec(
        FIELD, invis_sig_settings=fields.InvisSigSettings(set_print_flag=True)
    )
    with quiet():
        return asyncio.run(
            _sign_document(document, signers.PdfSigner(meta, signer=by, new_field_spec=made), now)
        )


async def _sign_document(document: bytes, by: Any, now: dt.datetime) -> bytes:  # noqa: ANN401 (a class of an optional library)
    """Sign in pyHanko's own steps, with the time that is given rather than a clock's."""
    from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
    from pyhanko.sign.signers.pdf_cms import PdfCMSSignedAttributes

    session = by.init_signing_session(IncrementalPdfFileWriter(io.BytesIO(document)))
    session.system_time = now
    none = await session.perform_presign_validation()
    prepared = session.prepare_tbs_document(
        none, await session.estimate_signature_container_size(none, tight=False)
    )
    digest, out = prepared.digest_tbs_document(output=io.BytesIO())
    attributes = PdfCMSSignedAttributes(signing_time=now)
    done = await prepared.perform_signature(digest.document_digest, pdf_cms_signed_attrs=attributes)
    await done.post_signature_processing(out)
    return bytes(out.getvalue())
