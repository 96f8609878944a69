"""Runs of gyros on a rate table, repeated and over temperature, one run a log: →
gyro_scale.json.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.check import copies
from calibkit.coefficients import Input
from calibkit.ingest import logs as ingest, write_back
from calibkit.instruments import Fitted, Instrument
from calibkit.instruments.gyro_scale import (
    compensate,
    figures as pages,
    over_runs,
    runs as gyro_runs,
    tables as gyro_report,
)
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Figure, Record
    from calibkit.frame import Examined, Log
    from calibkit.ingest.logs import Reader
    from calibkit.ingest.proposal import Choice, Evidence
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments import Firmware, Progress
    from calibkit.instruments.gyro_scale.compensate import Frozen
    from calibkit.instruments.gyro_scale.over_runs import GyroOverRuns
    from calibkit.report.table import Table
    from calibkit.simulate.campaign import Campaign

COLUMNS = 3
"""Runs beside each other in a table of the summary."""


def read(spec: RateTableRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log of the table in canonical columns."""
    return gyro_runs.read(spec, data, file, spec.gyros, reader)


def examine(spec: RateTableRecipe, log: Log) -> Examined:
    """Find what is wrong with one log, and its held rates."""
    return gyro_runs.examine(log, spec.gyros, spec)


def fit(
    spec: RateTableRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.GyroReport]:
    """Fit each gyro in each run, then its scale factor over the runs and over temperature."""
    logs = copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: read(spec, data, file)
        )
    )
    runs = [gyro_runs.run_of(log, spec.gyros, spec) for log in logs]
    gyros = [over_runs.over_runs(gyro, runs, spec) for gyro in spec.gyros]
    flags = tuple(
        dict.fromkeys(
            [flag for run in runs for flag in run.flags] + over_runs.run_flags(gyros, spec)
        )
    )
    result = over_runs.rate_table_result(gyros, flags, spec)
    tables = (
        gyro_report.scale_table(result.models),
        *gyro_report.temperature_table(result.models),
        *_figure_tables(gyros, result.figures),
        *gyro_report.bias_table(result.figures),
    )
    return Fitted(
        (result,),
        tuple(Input.of(run.log) for run in runs),
        Summary(spec.title, tables, flags, gyro_report.runs_criteria(result, spec.acceptance)),
        gyro_report.runs_drawing(gyros),
    )


def _figure_tables(gyros: Sequence[GyroOverRuns], figures: Sequence[Figure]) -> list[Table]:
    """Figures over all runs of a gyro, then of its single runs."""
    tables = []
    for one in gyros:
        name = f"gyro_{one.gyro}"
        tables.append(
            gyro_report.figure_table(figures, (name,), f"Figures of {name} over its runs")
        )
        names = [f"{name}.{run.log.name}" for run in one.runs]
        groups = (names[start : start + COLUMNS] for start in range(0, len(names), COLUMNS))
        tables += [
            gyro_report.figure_table(figures, group, "Figures of single runs") for group in groups
        ]
    return [table for table in tables if table.rows]


def _frozen(records: Mapping[str, Record], spec: RateTableRecipe) -> list[Frozen]:
    """Coefficients of every gyro."""
    return [compensate.frozen(records, gyro, f"gyro_{gyro}") for gyro in spec.gyros]


def apply(spec: RateTableRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add each gyro's compensated rate to every row of a log."""
    coefficients = _frozen(records, spec)
    log = compensate.read(spec, data, coefficients)
    derived, flags = compensate.compensated(log, coefficients, compensate.earth_rate(records, spec))
    return write_back.rewrite_log(spec, data, {}, derived), flags


def validate(
    spec: RateTableRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Scale factors and rate errors of unseen runs against the frozen coefficients."""
    coefficients = _frozen(records, spec)
    entries, named, flags = [], [], []
    for log in logs:
        run = gyro_runs.run_of(log, spec.gyros, spec)
        stands = [compensate.stand(run, one, spec) for one in coefficients]
        entries.append({"name": log.file, "sha256": log.sha256, "rows": log.rows, "gyros": stands})
        named += [(log.file, stand) for stand in stands]
        flags += [
            *run.flags,
            *(flag for one in coefficients for flag in compensate.run_flags(run, one)),
        ]
    criteria = gyro_report.validation_criteria([stand for _, stand in named], spec.acceptance)
    tables = (gyro_report.validation_table(named),)
    return {"logs": entries}, Summary("", tables, tuple(dict.fromkeys(flags)), criteria)


def draw(title: str, fitted: Fitted[pages.GyroReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(title, fitted.drawing)), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.gyro_scale.certificate import blocks

    return blocks(stated)


def _firmware() -> Firmware[RateTableRecipe]:
    """How a run becomes firmware."""
    from calibkit.instruments.gyro_scale.firmware import RATE_TABLE

    return RATE_TABLE


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.gyro_scale.simulate_rate_table import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.gyro_scale.propose import propose_rate_table

    return propose_rate_table(evidence)


INSTRUMENT = Instrument(
    recipe=RateTableRecipe,
    read=read,
    examine=examine,
    fit=fit,
    draw=draw,
    validate=validate,
    apply=apply,
    certificate=_certificate,
    firmware=_firmware,
    key_figures=(
        r"gyro_scale\.gyro_[a-z0-9]+\.(K|F0|residual_rms)",
        r"gyro_scale\.(repeatability|temperature_sensitivity)\.GJB 2426A\..+",
        r"gyro_scale\.(nonlinearity_full_scale|asymmetry)\.GJB 2426A\..+",
    ),
    campaigns={"rate_table": _simulate},
    propose=_propose,
)
