"""A certificate signed with the user's key: PAdES, a certification signature that allows nothing
but further signatures; with a time stamp and the issuer's word on revocation where they can be had.
"""

import asyncio
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from calibkit.certificate import verify_signature
from calibkit.certificate.signature_trust import Demands
from calibkit.certificate.signing_key import Key, quiet
from calibkit.errors import OutputError, UsageError

FIELD = "Signature"
_WAIT_S = 20
"""Seconds that a server of time stamps may take."""


@dataclass(frozen=True, slots=True)
class Signed:
    """A document with one signature more, and what could not be put into it."""

    document: bytes
    warnings: tuple[str, ...]


def sign_document(document: bytes, by: Any, key: Key, role: str = "") -> Signed:  # noqa: ANN401 (a class of an optional library)
    """The document with a signature behind it; what was there stays as it is, byte for byte.

    The first signature certifies the document; a further one states its role ("checked",
    "approved"). Raises OutputError where the time-stamp server does not answer, UsageError where
    the key was revoked or what was signed does not verify.
    """
    with quiet():
        return asyncio.run(_sign(document, by, key, role))


def sign_checked(document: bytes, signer: Any, key: Key, role: str = "") -> Signed:  # noqa: ANN401 (a class of an optional library)
    """A document with one signature more; OutputError where it would not verify."""
    signed = sign_document(document, signer, key, role)
    signatures = verify_signature.check_signatures(signed.document, Demands(now=key.now))
    if faults := [fault for signature in signatures for fault in signature.faults]:
        raise OutputError(
            f"--sign {key.path}: the signature does not verify: {faults[0]}",
            hint="sign with another key, or without --timestamp",
        )
    return signed


async def _sign(document: bytes, by: Any, key: Key, role: str) -> Signed:  # noqa: ANN401 (a class of an optional library)
    """Sign in pyHanko's own steps, with the time that is given rather than a clock's."""
    from pyhanko.sign.signers.pdf_cms import PdfCMSSignedAttributes
    from pyhanko.sign.timestamps import TimestampRequestError

    writer = _open_for_update(document)
    stamper, out = _find_stamper(key), io.BytesIO()
    by.signed_attr_prov_spec = _attributes(by)
    signer = _find_signer(writer.prev.embedded_signatures, by, stamper, role)
    try:
        warnings = await _embed_revocation(writer, by, stamper, key)
        session = signer.init_signing_session(writer)
        session.system_time = key.now
        none = await session.perform_presign_validation()
        prepared = session.prepare_tbs_document(
            none, await session.estimate_signature_container_size(none, tight=False)
        )
        digest, _ = prepared.digest_tbs_document(output=out)
        attributes = PdfCMSSignedAttributes(signing_time=key.now)
        post_signature = await prepared.perform_signature(
            digest.document_digest, pdf_cms_signed_attrs=attributes
        )
    except (TimestampRequestError, TimeoutError) as error:
        cause = error.__cause__ or error
        raise OutputError(
            f"--timestamp {key.timestamp}: no time stamp: {str(cause) or type(cause).__name__}",
            hint="ask again, or sign without --timestamp",
        ) from None
    await post_signature.post_signature_processing(out)
    return Signed(out.getvalue(), warnings)


def _find_signer(before: Sequence[Any], by: Any, stamper: Any, role: str) -> Any:  # noqa: ANN401 (classes of an optional library)
    """What signs a document with signatures before it; UsageError where the first one allows no
    other.
    """
    from pyhanko.sign import fields, signers

    if before and before[0].docmdp_level is fields.MDPPerm.NO_CHANGES:
        raise UsageError(
            "the first signature of this certificate allows no further one",
            hint="issue it again: since 0.2 certificates allow further signatures",
        )
    name = f"{FIELD}{len(before) + 1}" if before else FIELD
    meta = signers.PdfSignatureMetadata(
        field_name=name,
        certify=not before,
        reason=role or None,
        subfilter=fields.SigSeedSubFilter.PADES,
        docmdp_permissions=fields.MDPPerm.FILL_FORMS,
        md_algorithm="sha256",
    )
    unseen = fields.InvisSigSettings(set_print_flag=True)
    return signers.PdfSigner(
        meta,
        signer=by,
        timestamper=stamper,
        new_field_spec=fields.SigFieldSpec(name, invis_sig_settings=unseen),
    )


def _open_for_update(document: bytes) -> Any:  # noqa: ANN401 (a class of an optional library)
    """Writer that adds to a PDF what it is told to: no date of change, no later version of PDF than
    PDF/A-3 has, so that a further signature changes nothing else.
    """
    from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter

    class Writer(IncrementalPdfFileWriter):
        def _update_meta(self) -> None:
            """Leave the metadata as they are."""

        def ensure_output_version(self, version: Any) -> None:  # noqa: ANN401
            """Leave the version as it is."""

        def register_extension(self, ext: Any) -> None:  # noqa: ANN401 (the same)
            """Register that of PAdES alone, which is of the same version."""
            if ext.prefix_name == "/ESIC":
                super().register_extension(ext)

    return Writer(io.BytesIO(document))


def _find_stamper(key: Key) -> Any:  # noqa: ANN401 (a class of an optional library)
    """Client of the key's server of time stamps, or None."""
    from asn1crypto import cms
    from pyhanko.sign.timestamps import HTTPTimeStamper, TimestampRequestError
    from pyhanko.sign.validation.generic_cms import extract_certs_for_validation

    class Stamper(HTTPTimeStamper):
        issuers: tuple[Any, ...] = ()
        """Certificates that came with the stamps, beside the servers' own."""

        async def async_timestamp(self, message_digest: bytes, md_algorithm: str) -> Any:  # noqa: ANN401
            """Time stamp with the server's own certificate, which it names; the others would
            travel unsigned.
            """
            try:
                token = await super().async_timestamp(message_digest, md_algorithm)
                certificates = extract_certs_for_validation(token["content"])
            except (ValueError, TypeError, KeyError) as error:
                raise TimestampRequestError("no reply of RFC 3161") from error
            self.issuers = tuple(certificates.other_certs)
            token["content"]["certificates"] = cms.CertificateSet(
                [cms.CertificateChoices("certificate", certificates.signer_cert)]
            )
            return token

    return Stamper(key.timestamp, timeout=_WAIT_S) if key.timestamp else None


def _attributes(by: Any) -> Any:  # noqa: ANN401 (classes of an optional library)
    """Signed attributes: every certificate that travels with the signature by its digest (RFC
    5035), the signer's first.

    So none of them can be changed or replaced either, though the signature itself only needs the
    signer's.
    """
    from asn1crypto import tsp
    from pyhanko.sign.attributes import SignedAttributeProviderSpec, SigningCertificateV2Provider
    from pyhanko.sign.general import as_signing_certificate_v2

    class CertificateChain(SigningCertificateV2Provider):
        async def build_attr_value(self, dry_run: bool = False) -> tsp.SigningCertificateV2:  # noqa: ARG002, FBT001, FBT002 (pyHanko's signature)
            other_certificates = [
                certificate
                for certificate in by.cert_registry
                if certificate.dump() != by.signing_cert.dump()
            ]
            certificate_ids = [
                as_signing_certificate_v2(certificate)["certs"][0]
                for certificate in (by.signing_cert, *other_certificates)
            ]
            return tsp.SigningCertificateV2({"certs": certificate_ids})

    class Attributes(SignedAttributeProviderSpec):
        def signed_attr_providers(
            self,
            data_digest: bytes,  # noqa: ARG002 (the same)
            digest_algorithm: str,  # noqa: ARG002 (the same)
        ) -> list[CertificateChain]:
            return [CertificateChain(by.signing_cert)]

    return Attributes()


async def _embed_revocation(writer: Any, by: Any, stamper: Any, key: Key) -> tuple[str, ...]:  # noqa: ANN401 (classes of an optional library)
    """Put into the document what the issuers of the certificates say on their revocation, and the
    certificates above that of the time stamps; returns what the issuers did not say.
    """
    from pyhanko.sign.validation.dss import DocumentSecurityStore
    from pyhanko.sign.validation.generic_cms import extract_certs_for_validation

    issuers = [certificate for certificate in by.cert_registry if certificate != by.signing_cert]
    chains = [[by.signing_cert, *issuers]]
    if stamper is not None:
        token = await stamper.async_dummy_response("sha256")
        stamp_signer = extract_certs_for_validation(token["content"]).signer_cert
        chains.append([stamp_signer, *stamper.issuers])
    warnings = []
    for chain in chains:
        has_responders = any(
            certificate.ocsp_urls or certificate.crl_distribution_points for certificate in chain
        )
        context = await _ask_issuers(chain, key) if has_responders else None
        has_answer = context is not None and (context.ocsps or context.crls)
        if has_answer or (chain is not chains[0] and chain[1:]):
            DocumentSecurityStore.supply_dss_in_writer(
                writer,
                None,
                certs=chain,
                ocsps=context.ocsps if context else (),
                crls=context.crls if context else (),
            )
        if has_responders and not has_answer:
            warnings.append(
                "no data on revocation came from the issuer of"
                f" {chain[0].subject.human_friendly}: the signature holds none"
            )
    return tuple(warnings)


async def _ask_issuers(chain: list[Any], key: Key) -> Any:  # noqa: ANN401 (classes of an optional library)
    """What the issuers of a chain of certificates say on their revocation, the signer's first;
    UsageError where one of them was revoked.
    """
    from pyhanko_certvalidator import CertificateValidator, ValidationContext, errors

    roots = [certificate for certificate in chain if certificate.self_issued] or chain[1:]
    context = ValidationContext(
        trust_roots=roots, other_certs=chain, allow_fetching=True, revocation_mode="soft-fail"
    )
    try:
        await CertificateValidator(
            chain[0], intermediate_certs=chain, validation_context=context
        ).async_validate_usage(set())
    except errors.RevokedError as error:
        raise UsageError(
            f"--sign {key.path}: {' '.join(str(error).split())}",
            hint="sign with a certificate that was not revoked",
        ) from None
    except (errors.PathError, errors.ValidationError):
        pass  # an issuer that is not known says nothing
    finally:
        await context.aclose()
    return context
