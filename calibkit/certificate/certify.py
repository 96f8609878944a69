"""The commands: a run folder, a profile, a validation and a date → a certificate, written once; and
a signed certificate with one signature more, of who checked or approved it.
"""

import datetime as dt
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calibkit.certificate import (
    content,
    dcc,
    pdf,
    profile,
    run_files,
    sign,
    signature_bytes,
    signature_trust,
    verify,
)
from calibkit.certificate.checklist import Missing
from calibkit.certificate.signing_key import Key
from calibkit.certificate.words import Lang
from calibkit.errors import RecipeError, UsageError
from calibkit.recipe import loader
from calibkit.records import new_files, store
from calibkit.records.run_document import ACCEPTED


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate that was written: its files and what it lacks."""

    files: tuple[Path, ...]
    certificate: content.Certificate
    warnings: tuple[str, ...] = ()
    """What its signature could not hold."""

    @property
    def missing(self) -> tuple[Missing, ...]:
        """Items that make it a DRAFT."""
        return self.certificate.missing

    def summarise(self) -> dict[str, Any]:
        """JSON object of a certificate: its files, what is missing, every result by its key, every
        statement of conformity.
        """
        certificate = self.certificate
        return {
            "out": [str(path) for path in self.files],
            "number": certificate.profile.certificate.number,
            "draft": certificate.draft,
            "verdict": certificate.run.verdict,
            "accepted": ACCEPTED[certificate.run.verdict],
            "missing": [{"key": item.key, "what": item.description.en} for item in self.missing],
            "results": [
                {
                    "key": r.key,
                    "value": r.value,
                    "unit": r.unit,
                    "expanded_uncertainty": None if u is None else u.expanded_uncertainty,
                    "coverage_factor": None if u is None else u.coverage_factor,
                    "interval": None if r.interval is None else list(r.interval),
                    "principal": r.principal,
                }
                for r in certificate.results
                # an interval stands for ± U
                for u in (r.uncertainty if r.interval is None else None,)
            ],
            "statements": [
                {"key": s.result.key, "rule": s.rule, "verdict": s.verdict}
                for s in certificate.statements
            ],
        }


def certify(
    run_folder: Path,
    out: Path | None,
    layout_of: content.LayoutOf,
    *,
    date: str,
    profile_path: Path | None = None,
    validation: Path | None = None,
    lang: Lang = "en",
    overrides: tuple[str, ...] = (),
    schema_dir: Path | None = None,
    key: Key | None = None,
    dry_run: bool = False,
) -> Issued:
    """Write the certificate of a run as PDF, with its DCC inside and beside it; nothing is
    overwritten. Without `out` all is made and nothing written, to see what it would lack.

    Before it is signed, a pure function of the run folder, the profile with its overrides, the
    validation and the date. Raises RecipeError for a faulty profile, CoefficientError for files
    that are not what they claim to be, UsageError for a key that cannot sign or an `out` that is no
    .pdf, OutputError where a file exists or a DCC does not fit the schema.
    """
    if out is not None:
        _beside(out)
    pdf.load_typst()  # its extra brings what the DCC needs too
    signer = None if key is None else key.load_signer()
    run = run_files.RunFiles.read(store.load(run_folder))
    validated = None if validation is None else run_files.AsFoundAsLeft.load(validation, run)
    certificate_profile, text = profile.load(profile_path, overrides)
    with profile.read_source(profile_path, overrides).placing():
        certificate = content.build(
            run, layout_of, certificate_profile, text, validated, dt.date.fromisoformat(date)
        )
    folder = Path() if profile_path is None else profile_path.parent
    fonts = (folder / font for font in certificate_profile.certificate.fonts)
    digital = dcc.attach_dcc(certificate, lang, schema_dir)
    certificate = replace(certificate, attachments=(*certificate.attachments, digital))
    document = pdf.render(
        certificate,
        lang,
        tuple(fonts),
        signed=key is not None,
        mark=_read_mark(certificate_profile, folder),
    )
    if trace := signature_bytes.find_mark(document):
        raise RecipeError(
            f"the texts of the certificate hold {trace}, which verify takes for a signature's",
            hint="write the number, the title and the names otherwise",
        )
    if out is None:
        return Issued((), certificate)
    warnings: tuple[str, ...] = ()
    if key is not None:
        if certificate.draft:
            missing_keys = ", ".join(item.key for item in certificate.missing)
            raise UsageError(
                f"a DRAFT is not signed; missing: {missing_keys}",
                hint="state what is missing, or leave out --sign",
            )
        signed = sign.sign_checked(document, signer, key)
        document, warnings = signed.document, signed.warnings
    files = {out: document, _beside(out): digital.content}
    new_files.write_all(files, dry_run=dry_run)
    return Issued(tuple(files), certificate, warnings)


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
    signed = sign.sign_checked(store.read_bytes(issued), signer, key, role)
    new_files.write_all({out: signed.document}, dry_run=dry_run)
    return (*verified.warnings, *signed.warnings)


def _beside(out: Path) -> Path:
    """Path of the DCC beside a certificate; OutputError where one of the two files exists."""
    if out.suffix.lower() != ".pdf" or out.is_dir():
        raise UsageError(
            f"--out {str(out)!r} is no name of a PDF",
            hint="name a file that ends in .pdf; its DCC is put beside it",
        )
    dcc_path = out.with_name(f"{out.stem}.xml")
    for path in (out, dcc_path):
        new_files.refuse_existing(path)
    return dcc_path


def _read_mark(certificate_profile: profile.Profile, folder: Path) -> bytes:
    """Image of the accreditation's mark, empty for none; RecipeError for what is no SVG or PNG."""
    name = certificate_profile.accreditation.mark
    if not name:
        return b""
    try:
        image = loader.read_limited(folder / name)
    except OSError as error:
        raise RecipeError(
            f"accreditation.mark: {folder / name}: {error.strerror}", hint="name an SVG or PNG file"
        ) from None
    if not image.startswith(b"\x89PNG") and b"<svg" not in image:
        raise RecipeError(
            f"accreditation.mark: {folder / name} is neither SVG nor PNG", hint="convert it"
        )
    return image
