"""Noise of gyros at rest: records → Allan deviation, noise terms, bias stability →
gyro_noise.json.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from calibkit.certificate.results import Block
from calibkit.certificate.stated import Stated
from calibkit.check import copies
from calibkit.coefficients import Input, Record
from calibkit.errors import FitError, UsageError
from calibkit.frame import Examined, Finding, Log, refuse
from calibkit.ingest import logs as ingest
from calibkit.ingest.logs import Reader
from calibkit.ingest.proposal import Choice, Evidence
from calibkit.ingest.write_back import Applied
from calibkit.instruments import Fitted, Instrument, Progress
from calibkit.instruments.gyro_noise import deviations, figures as pages, tables
from calibkit.instruments.gyro_noise.deviations import NoiseFigures
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary
from calibkit.simulate.campaign import Campaign


def _read(spec: GyroNoiseRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log in canonical columns; the case temperature is read where the log has it."""
    return reader(spec, data / file, file, ("time_s", *spec.noise.columns), (deviations.CASE,))


def _examine(spec: GyroNoiseRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    found = deviations.find_faults(log, spec)
    if not any(finding.refused for finding in found):
        try:
            deviations.read_records(log, spec.noise.columns)
        except FitError as error:
            found.append(Finding.of(error))
    return Examined(tuple(found))


def _figures(spec: GyroNoiseRecipe, log: Log) -> tuple[list[NoiseFigures], list[str]]:
    """Figures of every record in a log, and what was noted on the way."""
    found = deviations.find_faults(log, spec)
    refuse(found)
    flags = [f"{log.file}: {note}" for note in log.notes] + [
        str(finding) for finding in found if finding.flagged
    ]
    return [
        deviations.estimate_noise(record, spec)
        for record in deviations.read_records(log, spec.noise.columns)
    ], flags


def _fit(
    spec: GyroNoiseRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.NoiseReport]:
    """Estimate the noise of every record."""
    inputs, figures, flags = [], [], []
    for log in copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: _read(spec, data, file)
        )
    ):
        found, noted = _figures(spec, log)
        inputs.append(Input.of(log))
        figures += found
        flags += [*noted, *(flag for one in found for flag in one.flags)]
    result = deviations.result(figures, flags)
    summary = Summary(
        spec.title,
        tables.tables(figures),
        tuple(flags),
        tables.criteria(figures, spec.acceptance),
    )
    return Fitted((result,), tuple(inputs), summary, tables.drawing(figures))


def _apply(
    spec: GyroNoiseRecipe,
    records: Mapping[str, Record],  # noqa: ARG001 (the protocol's shape)
    data: Path,  # noqa: ARG001 (the same)
) -> Applied:
    """Refuse: noise is stated, not compensated."""
    raise UsageError(
        f"a run of {spec.procedure} holds nothing to compensate with",
        hint="apply a run of fog_thermal",
    )


def _validate(
    spec: GyroNoiseRecipe,
    records: Mapping[str, Record],  # noqa: ARG001 (the protocol's shape)
    logs: Iterable[Log],
) -> tuple[dict[str, Any], Summary]:
    """Noise of records that were not fitted, held against the recipe's limits."""
    entries, figures, flags = [], [], []
    for log in logs:
        found, noted = _figures(spec, log)
        entries.append(
            {
                "name": log.file,
                "sha256": log.sha256,
                "rows": log.rows,
                "records": [tables.validation_entry(one) for one in found],
            }
        )
        figures += found
        flags += [*noted, *(flag for one in found for flag in one.flags)]
    criteria = tables.criteria(figures, spec.acceptance)
    return {"logs": entries}, Summary("", tables.tables(figures), tuple(flags), criteria)


def _draw(title: str, fitted: Fitted[pages.NoiseReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(title, fitted.drawing)), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.gyro_noise.certificate import blocks

    return blocks(stated)


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.gyro_noise.simulate import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.gyro_noise.propose import propose

    return propose(evidence)


INSTRUMENT = Instrument(
    recipe=GyroNoiseRecipe,
    read=_read,
    examine=_examine,
    fit=_fit,
    draw=_draw,
    validate=_validate,
    apply=_apply,
    certificate=_certificate,
    key_figures=(r"gyro_noise\.(?!allan_deviation|wavelet_deviation).+",),
    campaigns={"gyro_noise": _simulate},
    propose=_propose,
)
