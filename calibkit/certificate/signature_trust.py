"""One signature of a certificate: whether it is intact, when it was made, and whether its signer is
trusted for that time.
"""

import datetime as dt
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calibkit.certificate import signing_key
from calibkit.errors import UsageError
from calibkit.libraries import extras
from calibkit.records import clock

ROLES = {"checked": "checked", "approved": "approved"}
"""What a further signature says that its signer did."""
STAMP = "time stamp"
_DAY = dt.timedelta(days=1)
_MOST_CHARACTERS = 200


@dataclass(frozen=True, slots=True)
class Demands:
    """What signatures are checked by.

    `now` is the time of checking; `trust` and `trust_timestamp` are files of certificates whose
    signatures, or whose time stamps alone, are trusted; `required` asks for a signature, whoever
    signed; `at` is the date of signing, where no time stamp states it.
    """

    now: dt.datetime = field(default_factory=clock.now)
    trust: tuple[Path, ...] = ()
    trust_timestamp: tuple[Path, ...] = ()
    required: bool = False
    at: dt.date | None = None

    @property
    def signed(self) -> bool:
        """Whether an unsigned file is refused."""
        return self.required or bool(self.trust)

    def load_roots(self) -> tuple[list[Any], list[Any]]:
        """Certificates that are trusted for signatures, and those for time stamps; UsageError for a
        file that holds none.
        """
        keys, roots = extras.load_checker("pyhanko.keys"), dict[str, list[Any]]()
        for option, paths in (("--trust", self.trust), ("--trust-timestamp", self.trust_timestamp)):
            roots[option] = []
            for path in paths:
                try:
                    roots[option] += keys.load_certs_from_pemder([str(path)])
                except (OSError, ValueError) as error:
                    raise UsageError(
                        f"{option} {path}: no certificate: {error}", hint="name a PEM or DER file"
                    ) from None
        return roots["--trust"], roots["--trust"] + roots["--trust-timestamp"]


@dataclass(frozen=True, slots=True)
class Signature:
    """Who signed in which role, the times that the signer and a trusted time stamp state, whether
    the signer is trusted, faults and warnings.
    """

    signer: str = ""
    role: str = ""
    claimed: str = ""
    stamped: str = ""
    trusted: bool = False
    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        """The signature in one clause."""
        trusted = " (trusted)" if self.trusted else ""
        time_clause = f"time stamp {self.stamped}" if self.stamped else f"who states {self.claimed}"
        return f"{self.role or 'signed'} by {quoted(self.signer)}{trusted}, {time_clause}"

    def document(self) -> dict[str, Any]:
        """JSON object of a signature that holds."""
        return {
            "signer": self.signer,
            "role": self.role,
            "claimed": self.claimed,
            "time_stamp": self.stamped,
            "trusted": self.trusted,
        }


def quoted(name: str) -> str:
    """A name that can hold anything, in quotes, which it cannot end itself."""
    return json.dumps(name[:_MOST_CHARACTERS], ensure_ascii=False)


@dataclass(slots=True)
class JudgedSignature:
    """One signature of a document (of an optional library's class) while it is judged; `stamped` is
    the earliest time by which a trusted time stamp says that it was there.
    """

    embedded: Any
    demands: Demands
    roots: tuple[list[Any], list[Any]]
    store: Any
    """Certificates and data on revocation that the document carries, or None."""
    stamped: dt.datetime | None = None
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    async def judge(self) -> Signature:
        """What the signature states, and what is wrong with it."""
        from pyhanko.sign.validation import generic_cms

        embedded = self.embedded
        if embedded.sig_object_type == "/DocTimeStamp":
            trusted = await self._read_stamp(embedded.signed_data, embedded.compute_digest)
            return self._stated(STAMP, trusted=trusted)
        imprint = generic_cms.message_imprint_checker(embedded.signer_info)
        for token in generic_cms.extract_tst_data_iter(embedded.signer_info, signed=False):
            await self._read_stamp(token, imprint)
        await self._judge_signer()
        reason = str(embedded.sig_object.get("/Reason", ""))
        return self._stated(ROLES.get(reason, ""), trusted=bool(self.demands.trust))

    def _stated(self, role: str, *, trusted: bool) -> Signature:
        """The record of a signature that was judged."""
        claimed = self.embedded.self_reported_timestamp
        return Signature(
            self.embedded.signer_cert.subject.human_friendly,
            role,
            "" if claimed is None else claimed.isoformat(),
            "" if self.stamped is None else self.stamped.isoformat(timespec="seconds"),
            trusted=trusted and not self.faults,
            faults=tuple(self.faults),
            warnings=() if self.faults else tuple(self.warnings),
        )

    def _context(self, roots: list[Any], moment: dt.datetime) -> Any:  # noqa: ANN401 (a class of an optional library)
        """What certificates are checked by at a moment; nothing is asked of any network."""
        from pyhanko_certvalidator import ValidationContext

        options: dict[str, Any] = {
            "trust_roots": roots,
            "moment": moment,
            "retroactive_revinfo": True,
        }
        if self.store is None:
            return ValidationContext(**options)
        return self.store.as_validation_context(options)

    async def _read_stamp(self, token: Any, imprint: Any) -> bool:  # noqa: ANN401 (classes of an optional library)
        """Judge a time stamp, and return whether it is trusted: broken ones are faults, those of
        strangers state no time.
        """
        from pyhanko.sign.validation import generic_cms
        from pyhanko.sign.validation.status import TimestampSignatureStatus

        time = token["encap_content_info"]["content"].parsed["gen_time"].native
        status = TimestampSignatureStatus(
            **await generic_cms.validate_tst_signed_data(
                token, self._context(self.roots[1], time), imprint
            )
        )
        stamp_certificate = status.signing_cert
        stamp_name = f"the time stamp of {quoted(stamp_certificate.subject.human_friendly)}"
        if not (status.intact and status.valid):
            self.faults.append("its time stamp is of something else, or was changed")
            return False
        if not status.trusted or not signing_key.is_valid_at(stamp_certificate, time):
            self.warnings.append(
                f"{stamp_name} is not trusted: it states {time.isoformat(timespec='seconds')}"
            )
            return False
        self.stamped = min(time, self.stamped or time)
        if not signing_key.is_valid_at(stamp_certificate, self.demands.now):
            self.warnings.append(
                f"{stamp_name} was {signing_key.format_validity(stamp_certificate)}"
            )
        return True

    async def _judge_signer(self) -> None:
        """Judge the signature itself, its key, and its signer for the time of signing."""
        from pyhanko.sign.validation import settings
        from pyhanko.sign.validation.pdf_embedded import async_validate_pdf_signature

        certificate = self.embedded.signer_cert
        moment = self._moment()
        status = await async_validate_pdf_signature(
            self.embedded,
            self._context(self.roots[0], moment),
            self._context(self.roots[1], moment),
            key_usage_settings=settings.KeyUsageConstraints(key_usage=()),
            skip_diff=True,
        )
        if not status.intact:
            self.faults.append("a byte was changed after signing: the signed digest is another")
        elif not status.valid:
            self.faults.append(
                "the signature was not made by the key of its certificate, or was changed"
            )
        if status.revoked:
            self.faults.append("the signer's certificate was revoked")
        self.faults += (
            f"the signer: {weakness}" for weakness in signing_key.list_weaknesses(certificate)
        )
        doubts = [*signing_key.list_wrong_uses(certificate), *self._list_doubts(moment)]
        if not status.trusted:
            doubts.append(
                f"its signer is not trusted: {quoted(certificate.subject.human_friendly)}"
            )
        if self.demands.trust:
            self.faults += (f"the signature does not count: {doubt}" for doubt in doubts)
        else:
            self.warnings += (f"the signature is intact, but {doubt}" for doubt in doubts)

    def _moment(self) -> dt.datetime:
        """The time for which the signer has to be trusted: that of a time stamp, else on the date
        that was asked for, else now, as nobody can tell.
        """
        claimed, signing_date = self.embedded.self_reported_timestamp, self.demands.at
        if self.stamped is not None:
            return self.stamped
        if signing_date is None:
            return self.demands.now
        end = dt.datetime.combine(signing_date, dt.time(), dt.UTC) + _DAY
        return claimed if claimed is not None and abs(end - claimed - _DAY / 2) < _DAY else end

    def _list_doubts(self, moment: dt.datetime) -> Iterator[str]:
        """Why a signature says less than it seems to, as far as times say so."""
        certificate, claimed = self.embedded.signer_cert, self.embedded.self_reported_timestamp
        proved = self.stamped is not None or self.demands.at is not None
        dates = signing_key.format_validity(certificate)
        if not signing_key.is_valid_at(certificate, moment):
            yield f"its signer's certificate is {dates}" + (
                f", not at {moment:%Y-%m-%d}, when it was signed"
                if proved
                else ", and nothing but the signer's own clock says when it was signed: state --at"
            )
        elif (
            not proved and claimed is not None and not signing_key.is_valid_at(certificate, claimed)
        ):
            yield f"its signer states {claimed:%Y-%m-%d}, and the certificate is {dates}"
        if proved and claimed is not None and abs(claimed - moment) > 2 * _DAY:
            self.warnings.append(
                f"its signer states {claimed:%Y-%m-%d}, and it was signed on {moment:%Y-%m-%d}"
            )
