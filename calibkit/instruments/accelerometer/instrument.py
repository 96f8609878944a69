"""Triaxial accelerometer: dwells → accel_k.json, accel_q.json, accel_affine.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.check import copies
from calibkit.coefficients import Criterion, Input
from calibkit.frame import refuse, require
from calibkit.ingest import logs as ingest
from calibkit.ingest import write_back
from calibkit.instruments import Fitted, Instrument
from calibkit.instruments.accelerometer import attitude as accel_attitude
from calibkit.instruments.accelerometer import coefficient_files, forms
from calibkit.instruments.accelerometer import dwells as accel_dwells
from calibkit.instruments.accelerometer import figures as pages
from calibkit.instruments.accelerometer import fit as accel_fit
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude, chunks
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.arrays import Array
    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Record
    from calibkit.frame import Examined, Log
    from calibkit.ingest.logs import Reader
    from calibkit.ingest.proposal import Choice, Evidence
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments import Firmware, Progress
    from calibkit.instruments.accelerometer.coefficient_files import Correction
    from calibkit.report.table import Table
    from calibkit.simulate.campaign import Campaign


def read(spec: AccelerometerRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log in canonical columns; m/s² become g by the site's gravity."""
    columns, optional = accel_dwells.needed(spec)
    return reader(spec.on_site(), data / file, file, columns, optional)


def examine(spec: AccelerometerRecipe, log: Log) -> Examined:
    """Find what is wrong with one log, and its dwells."""
    return accel_dwells.examine(log, spec)


def fit(
    spec: AccelerometerRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.TriadReport]:
    """Fit K-factor, Q-factor and the affine triad to the dwells of all logs together."""
    logs = list(
        copies.distinct(
            ingest.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
        )
    )
    dwells = accel_dwells.collect(logs, spec)
    fitted = accel_fit.fit(dwells, spec)
    corrections = []
    if fitted.k:
        corrections.append(("K-factor", coefficient_files.k_correction(fitted, dwells)))
    if spec.compensation == "kq":
        corrections.append(("K- and Q-factor", coefficient_files.kq_correction(fitted, dwells)))
    if fitted.affine is not None:
        corrections.append(("affine", coefficient_files.affine_correction(fitted.affine, dwells)))
    stands = accel_attitude.before_after(dwells, corrections, spec)
    figures = (
        accel_attitude.propagated(fitted.affine, dwells, spec.toolface_range_deg)
        if fitted.affine
        else ()
    )
    return Fitted(
        coefficient_files.results(fitted, dwells, spec.site.local_gravity(), figures),
        tuple(Input.of(log) for log in logs),
        accel_attitude.summary(fitted, stands, spec, figures),
        accel_attitude.drawing(dwells, stands, spec),
    )


def apply(spec: AccelerometerRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Correct every row of a log, in the log's own unit and sign, and add inclination and
    toolface.
    """
    rowwise = spec.model_copy(
        update={"reference": spec.reference.model_copy(update={"kind": "magnitude"})}
    )
    log = read(
        rowwise.model_copy(update={"dwells": spec.dwells.model_copy(update={"mode": "rows"})}),
        data.parent,
        data.name,
    )
    refuse(accel_dwells.findings(log, rowwise))
    correction = coefficient_files.correction(records, spec)
    temperature = accel_dwells.optional(log, accel_dwells.TEMPERATURE)
    flags = []
    if accel_dwells.TEMPERATURE not in log.frame.columns:
        low, high = correction.temperature
        if high - low > 0.0:
            require(log.file, log.frame.columns, [accel_dwells.TEMPERATURE])
        temperature = np.broadcast_to(low, len(log.frame))
    if (outside := correction.outside(temperature)) > 0.0:
        low, high = correction.temperature
        flags.append(
            f"{log.file}: temperature clamped to {low:.1f} … {high:.1f} °C over"
            f" {100.0 * outside:.1f} % of the rows"
        )
    columns, derived = _corrected(log, correction, temperature, spec)
    return write_back.rewrite_log(spec.on_site(), data, columns, derived), tuple(flags)


def _corrected(
    log: Log, correction: Correction, temperature: Array, spec: AccelerometerRecipe
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Corrected components [n] in the log's own sign, and inclination and toolface [n], a span of
    rows at a time.
    """
    shown = accel_dwells.indication(log, spec)
    columns = {name: log.room(len(shown)) for name in accel_dwells.AXES}
    derived = {name: log.room(len(shown)) for name in accel_dwells.ATTITUDE}
    for a, b in chunks.ranges_along(shown, temperature, *columns.values(), *derived.values()):
        vector = correction(shown[a:b], temperature[a:b])
        own_sign = attitude.gravity_positive(vector, spec.reference.convention)
        for i, column in enumerate(columns.values()):
            column[a:b] = own_sign[:, i]
        for column, angle in zip(
            derived.values(), (attitude.inclination, attitude.toolface), strict=True
        ):
            column[a:b] = angle(vector)
    return columns, derived


def validate(
    spec: AccelerometerRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Attitude errors before and after on dwells that were not fitted."""
    correction = coefficient_files.correction(records, spec)
    entries: list[dict[str, object]] = []
    tables: list[Table] = []
    flags: list[str] = []
    criteria: list[Criterion] = []
    for log in logs:
        dwells = accel_dwells.collect([log], spec)
        stands = accel_attitude.before_after(dwells, [("corrected", correction)], spec)
        entries.append(accel_attitude.entry(log.file, log.sha256, log.rows, stands))
        tables.append(accel_attitude.table(stands, spec, log.file))
        criteria += [accel_attitude.improved(stands), *accel_attitude.criteria(stands[-1], spec)]
        flags += dwells.flags
        if (outside := correction.outside(dwells.temperature)) > 0.0:
            flags.append(
                f"{log.file}: temperature clamped over {100.0 * outside:.1f} % of the dwells"
            )
    return {"logs": entries}, Summary("", tuple(tables), tuple(flags), tuple(criteria))


def draw(title: str, fitted: Fitted[pages.TriadReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(title, fitted.drawing)), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.accelerometer.certificate import blocks

    return blocks(stated)


def _firmware() -> Firmware[AccelerometerRecipe]:
    """How a run becomes firmware."""
    from calibkit.instruments.accelerometer.firmware import FIRMWARE

    return FIRMWARE


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.accelerometer.simulate import campaign

    return campaign(seed)


def _simulate_magnitude(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.accelerometer.simulate_magnitude import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.accelerometer.propose import propose

    return propose(evidence)


INSTRUMENT = Instrument(
    recipe=AccelerometerRecipe,
    read=read,
    examine=examine,
    fit=fit,
    draw=draw,
    validate=validate,
    apply=apply,
    certificate=_certificate,
    forms=lambda: forms.FORMS,
    firmware=_firmware,
    key_figures=(
        r"accel_k\.accel_\w\.(K\d|residual_rms)",
        r"accel_q\.triad\.(Q\d|residual_rms)",
        r"accel_affine\.triad\.(m_\w\w0|b_\w0|residual_rms)",
    ),
    campaigns={"accelerometer": _simulate, "accelerometer_magnitude": _simulate_magnitude},
    propose=_propose,
)
