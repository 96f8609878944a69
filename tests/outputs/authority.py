"""A certificate authority for tests: keys of laboratories, and a server that answers for them with
time stamps (RFC 3161), OCSP responses and lists of revoked certificates.
"""

import contextlib
import datetime as dt
import threading
from dataclasses import dataclass, field
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import pkcs12
from cryptography.x509 import ocsp
from cryptography.x509.oid import AuthorityInformationAccessOID, ExtendedKeyUsageOID

SECRET = "a secret"  # noqa: S105
NOW = dt.datetime.now(dt.UTC).replace(microsecond=0)
THEN = NOW - dt.timedelta(days=1826)
"""Five years ago."""
SIGNING = ("digital_signature", "content_commitment")
_USAGES = (
    *SIGNING,
    "key_encipherment",
    "data_encipherment",
    "key_agreement",
    "key_cert_sign",
    "crl_sign",
    "encipher_only",
    "decipher_only",
)


@cache
def make_key(kind="rsa2048", number=0):
    """Private key of a kind, made once in a process for each number."""
    del number
    if kind.startswith("rsa"):
        return rsa.generate_private_key(65537, int(kind[3:]))
    return ec.generate_private_key({"p256": ec.SECP256R1, "p192": ec.SECP192R1}[kind]())


def named(text):
    """Name of a certificate."""
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, text)])


@dataclass
class Authority:
    """Issuer of certificates; `url` is where its revocation data and time stamps can be had."""

    name: str = "Test authority"
    number: int = 100
    url: str = ""
    revoked: set = field(default_factory=set)
    serial: int = 1

    def __post_init__(self):
        """Sign the authority's own certificate."""
        self.key = make_key("rsa2048", self.number)
        self.certificate = self._signed(
            self.name, self.key, (-3000, 5000), ("key_cert_sign", "crl_sign"), ca=True
        )

    def _signed(self, subject, key, days, usage, purposes=(), *, ca=False, digest=None):
        """Certificate of a subject's key."""
        self.serial += 1
        first, last = (NOW + dt.timedelta(day) for day in days)
        by = self.key.public_key()
        builder = (
            x509.CertificateBuilder()
            .subject_name(named(subject))
            .issuer_name(named(self.name))
            .public_key(key.public_key())
            .serial_number(self.serial)
            .not_valid_before(first)
            .not_valid_after(last)
            .add_extension(x509.BasicConstraints(ca, None), critical=True)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
            )
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(by), critical=False)
        )
        if usage is not None:
            stated = {name: name in usage for name in _USAGES}
            builder = builder.add_extension(x509.KeyUsage(**stated), critical=True)
        if purposes:
            critical = purposes == (ExtendedKeyUsageOID.TIME_STAMPING,)
            builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=critical)
        if self.url and not ca:
            builder = builder.add_extension(_access(f"{self.url}/ocsp"), critical=False)
            builder = builder.add_extension(_points(f"{self.url}/crl"), critical=False)
        return builder.sign(self.key, digest or hashes.SHA256())

    def issue(self, path, name="Test laboratory", kind="rsa2048", days=(-10, 1000), **stated):
        """Write a PKCS#12 file with a key of the kind and its certificate, valid from and to days
        from now; returns its path.
        """
        stated.setdefault("usage", SIGNING)
        own = make_key(kind, stated.pop("number", 0))
        leaf = self._signed(name, own, days, **stated)
        locked = serialization.BestAvailableEncryption(SECRET.encode())
        content = pkcs12.serialize_key_and_certificates(
            b"key", own, leaf, [self.certificate], locked
        )
        path.write_bytes(content)
        path.with_suffix(".leaf.pem").write_bytes(leaf.public_bytes(serialization.Encoding.PEM))
        self.last = leaf
        return path

    def write(self, path):
        """Write the authority's certificate as PEM; returns its path."""
        path.write_bytes(self.certificate.public_bytes(serialization.Encoding.PEM))
        return path

    def stamp(self, request, days=(-2500, 4000), fixed=None):
        """Reply of a time-stamp server whose certificate this authority issued."""
        from asn1crypto import keys, tsp, x509 as asn1
        from pyhanko.sign.timestamps import DummyTimeStamper
        from pyhanko_certvalidator.registry import SimpleCertificateStore

        purposes = (ExtendedKeyUsageOID.TIME_STAMPING,)
        own = make_key("rsa2048", self.number + 1)
        leaf = self._signed(f"{self.name} time", own, days, ("digital_signature",), purposes)
        der = serialization.Encoding.DER
        store = SimpleCertificateStore()
        store.register(asn1.Certificate.load(self.certificate.public_bytes(der)))
        plain = own.private_bytes(
            der, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        server = DummyTimeStamper(
            asn1.Certificate.load(leaf.public_bytes(der)),
            keys.PrivateKeyInfo.load(plain),
            store,
            fixed_dt=fixed,
        )
        return server.request_tsa_response(tsp.TimeStampReq.load(request)).dump()

    def answer(self, request):
        """OCSP response (RFC 6960) to a request."""
        asked = ocsp.load_der_ocsp_request(request)
        gone = asked.serial_number in self.revoked
        builder = ocsp.OCSPResponseBuilder().add_response_by_hash(
            issuer_name_hash=asked.issuer_name_hash,
            issuer_key_hash=asked.issuer_key_hash,
            serial_number=asked.serial_number,
            algorithm=asked.hash_algorithm,
            cert_status=ocsp.OCSPCertStatus.REVOKED if gone else ocsp.OCSPCertStatus.GOOD,
            this_update=NOW - dt.timedelta(hours=1),
            next_update=NOW + dt.timedelta(days=7),
            revocation_time=NOW - dt.timedelta(days=2) if gone else None,
            revocation_reason=x509.ReasonFlags.key_compromise if gone else None,
        )
        for extension in asked.extensions:  # the nonce
            builder = builder.add_extension(extension.value, critical=False)
        builder = builder.responder_id(ocsp.OCSPResponderEncoding.HASH, self.certificate)
        made = builder.sign(self.key, hashes.SHA256())
        return made.public_bytes(serialization.Encoding.DER)

    def list_revoked(self):
        """List of revoked certificates (RFC 5280)."""
        builder = x509.CertificateRevocationListBuilder().issuer_name(named(self.name))
        builder = builder.last_update(NOW - dt.timedelta(hours=1))
        builder = builder.next_update(NOW + dt.timedelta(days=7))
        builder = builder.add_extension(x509.CRLNumber(1), critical=False)
        for serial in sorted(self.revoked):
            one = x509.RevokedCertificateBuilder().serial_number(serial)
            builder = builder.add_revoked_certificate(
                one.revocation_date(NOW - dt.timedelta(days=2)).build()
            )
        made = builder.sign(self.key, hashes.SHA256())
        return made.public_bytes(serialization.Encoding.DER)


def _access(url):
    """Where a certificate's OCSP server is."""
    place = x509.UniformResourceIdentifier(url)
    return x509.AuthorityInformationAccess(
        [x509.AccessDescription(AuthorityInformationAccessOID.OCSP, place)]
    )


def _points(url):
    """Where the list of revoked certificates is."""
    place = x509.UniformResourceIdentifier(url)
    return x509.CRLDistributionPoints([x509.DistributionPoint([place], None, None, None)])


@contextlib.contextmanager
def serve_stamps(issuer):
    """Address of a server of an authority's time stamps: at `/tsa` of now, at `/then` of five years
    ago; at `/text` and `/short` of what is none.
    """
    fixed = THEN + dt.timedelta(seconds=20)
    pages = {
        "/tsa": (STAMPS, issuer.stamp),
        "/then": (STAMPS, lambda body: issuer.stamp(body, fixed=fixed)),
        "/text": ("text/html", lambda body: b"<p>sign in</p>"),
        "/short": (STAMPS, lambda body: issuer.stamp(body)[:100]),
    }
    with serve(pages) as url:
        yield url


@contextlib.contextmanager
def serve(pages):
    """Address of a server on this machine; `pages` maps a path to a type of content and a function
    from the body of a request to that of its reply, which may be changed while it runs.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            found = pages.get(self.path)
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            if found is None:
                self.send_error(404)
                return
            content = found[1](body)
            self.send_response(200)
            self.send_header("Content-Type", found[0])
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def do_GET(self):
            self.do_POST()

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


STAMPS = "application/timestamp-reply"
OCSP = "application/ocsp-response"
CRL = "application/pkix-crl"
