"""The command: a run folder, a profile, a validation and a date → a certificate, written once."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit import store
from calibkit.certificate import as_found, content, pdf, profile

if TYPE_CHECKING:
    from calibkit.certificate.checklist import Missing
    from calibkit.certificate.words import Lang


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate that was written: its files and what it lacks."""

    files: tuple[Path, ...]
    certificate: content.Certificate

    @property
    def missing(self) -> tuple[Missing, ...]:
        """Items that make it a DRAFT."""
        return self.certificate.missing


def certify(
    run_folder: Path,
    out: Path,
    *,
    date: str,
    profile_path: Path | None = None,
    validation: Path | None = None,
    lang: Lang = "en",
    overrides: tuple[str, ...] = (),
) -> Issued:
    """Write the certificate of a run; nothing is overwritten.

    A pure function of the run folder, the profile with its overrides, the validation and the date. Raises RecipeError for
    a faulty profile, CoefficientError for files that are not what they claim to be, OutputError where `out` exists.
    """
    store.refuse_existing(out)
    run = store.load(run_folder)
    stated, text = profile.load(profile_path, overrides)
    validated = None if validation is None else as_found.load(validation, run)
    certificate = content.build(run, stated, text, validated, dt.date.fromisoformat(date))
    folder = Path() if profile_path is None else profile_path.parent
    fonts = tuple(folder / font for font in stated.certificate.fonts)
    store.write_new(out, pdf.render(certificate, lang, fonts))
    return Issued((out,), certificate)


def said(issued: Issued) -> dict[str, Any]:
    """What --json says of a certificate: its files, what is missing, every result by its key, every statement."""
    certificate = issued.certificate
    results = [
        {
            "key": r.key,
            "value": r.value,
            "unit": r.unit,
            "expanded_uncertainty": None if r.uncertainty is None else r.uncertainty.expanded_uncertainty,
            "coverage_factor": None if r.uncertainty is None else r.uncertainty.coverage_factor,
        }
        for r in certificate.results
    ]
    return {
        "out": [str(path) for path in issued.files],
        "number": certificate.profile.certificate.number,
        "draft": certificate.draft,
        "missing": [{"key": item.key, "what": item.what.en} for item in issued.missing],
        "results": results,
        "statements": [{"key": s.result.key, "rule": s.rule, "verdict": s.verdict} for s in certificate.statements],
    }
