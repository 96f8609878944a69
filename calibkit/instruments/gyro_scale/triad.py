"""Any number of gyros on a rate table, turned about three axes of their base: → gyro_scale.json,
gyro_orthogonality.json.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.check import copies
from calibkit.coefficients import Input
from calibkit.ingest import logs as ingest, write_back
from calibkit.instruments import Fitted, Instrument
from calibkit.instruments.gyro_scale import (
    axes as gyro_axes,
    axes_compensate,
    axes_figures as pages,
    axes_files,
    axes_tables,
    runs as gyro_runs,
    tables as gyro_report,
)
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Record
    from calibkit.frame import Examined, Log
    from calibkit.ingest.logs import Reader
    from calibkit.ingest.proposal import Choice, Evidence
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments import Firmware, Progress
    from calibkit.instruments.gyro_scale.runs import TableRun
    from calibkit.simulate.campaign import Campaign


def read(spec: GyroTriadRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log of the table in canonical columns."""
    return gyro_runs.read(spec, data, file, spec.gyros, reader)


def examine(spec: GyroTriadRecipe, log: Log) -> Examined:
    """Find what is wrong with one log, and its held rates."""
    return gyro_runs.examine(log, spec.gyros, spec)


def _run(spec: GyroTriadRecipe, data: Path, file: str) -> TableRun:
    """Held rates and lines of one log."""
    return gyro_runs.run_of(gyro_runs.read(spec, data, file, spec.gyros), spec.gyros, spec)


def fit(
    spec: GyroTriadRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.AxesReport]:
    """Fit the sensitivities of every gyro about three axes, the angles between them, and both over
    temperature.
    """
    axes = gyro_axes.axis_of(spec, files)
    runs: dict[str, tuple[TableRun, ...]] = {}
    for log in copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: read(spec, data, file)
        )
    ):
        runs[axes[log.file]] = (
            *runs.get(axes[log.file], ()),
            gyro_runs.run_of(log, spec.gyros, spec),
        )
    fitted = gyro_axes.fit(spec, runs)
    scales = axes_files.scale_result(fitted, spec)
    tables = (
        *axes_tables.tables(fitted),
        *gyro_report.bias_table(scales.figures),
        *gyro_report.temperature_table(scales.models),
    )
    logs = [run.log for axis in gyro_axes.AXES for run in runs[axis]]
    return Fitted(
        (scales, axes_files.orthogonality_result(fitted, spec)),
        tuple(map(Input.of, logs)),
        Summary(
            spec.title,
            tables,
            fitted.flags,
            axes_tables.criteria(fitted, scales.figures, spec.acceptance),
        ),
        axes_tables.drawing(fitted),
    )


def apply(spec: GyroTriadRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add the compensated rates about the axes of the base to every row of a log."""
    known = axes_compensate.base(records, spec)
    log = axes_compensate.read(spec, data, known)
    derived, flags = axes_compensate.compensated(log, known)
    return write_back.rewrite_log(spec, data, {}, derived), (*log.notes, *flags)


def validate(
    spec: GyroTriadRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Rates of unseen runs along and across the turned axis under the frozen coefficients."""
    known = axes_compensate.base(records, spec)
    vertical = gyro_runs.vertical_rate_dps(spec) or 0.0
    entries, named, flags = [], [], []
    for log in logs:
        axis = gyro_axes.axis_of(spec, [log.file])[log.file]
        run = gyro_runs.run_of(log, spec.gyros, spec)
        one, said = axes_compensate.stand(run, axis, known, vertical)
        entries.append({"name": log.file, "sha256": log.sha256, "rows": log.rows, **one})
        named.append((log.file, one))
        flags += [*run.flags, *said]
    criteria = axes_tables.validation_criteria([one for _, one in named], spec.acceptance)
    table = axes_tables.validation_table(named)
    return {"logs": entries}, Summary("", (table,), tuple(dict.fromkeys(flags)), criteria)


def draw(title: str, fitted: Fitted[pages.AxesReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(title, fitted.drawing)), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.gyro_scale.certificate import blocks

    return blocks(stated)


def _firmware() -> Firmware[GyroTriadRecipe]:
    """How a run becomes firmware."""
    from calibkit.instruments.gyro_scale.axes_firmware import FIRMWARE

    return FIRMWARE


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.gyro_scale.simulate_triad import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.gyro_scale.propose import propose_triad

    return propose_triad(evidence)


INSTRUMENT = Instrument(
    recipe=GyroTriadRecipe,
    read=read,
    examine=examine,
    fit=fit,
    draw=draw,
    validate=validate,
    apply=apply,
    certificate=_certificate,
    firmware=_firmware,
    key_figures=(
        r"gyro_orthogonality\.scale_factor\.[a-z0-9]+",
        r"gyro_orthogonality\.misalignment\.(?!(\w)\1$)[a-z0-9]+",
        r"gyro_orthogonality\.orthogonality_error_deg\.[a-z0-9]+_[a-z0-9]+",
    ),
    campaigns={"gyro_triad": _simulate},
    propose=_propose,
)
