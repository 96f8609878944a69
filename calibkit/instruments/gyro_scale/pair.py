"""Two gyros on a rate table, about A's reference axis and about B's own: → gyro_scale.json,
gyro_orthogonality.json.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.check import copies
from calibkit.coefficients import Input
from calibkit.errors import CoefficientError, RecipeError
from calibkit.ingest import logs as ingest, write_back
from calibkit.instruments import Fitted, Instrument
from calibkit.instruments.gyro_scale import (
    compensate,
    figures as pages,
    pair_files,
    runs as gyro_runs,
    tables as gyro_report,
)
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary
from calibkit.report.table import Table

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
    from calibkit.instruments.gyro_scale.compensate import Frozen
    from calibkit.instruments.gyro_scale.numeric.pair import GyroPair
    from calibkit.simulate.campaign import Campaign

GYROS = ("a", "b")


def read(spec: GyroPairRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log of the table in canonical columns."""
    return gyro_runs.read(spec, data, file, GYROS, reader)


def examine(spec: GyroPairRecipe, log: Log) -> Examined:
    """Find what is wrong with one log, and its held rates."""
    return gyro_runs.examine(log, GYROS, spec)


def _axes(spec: GyroPairRecipe, files: Sequence[str]) -> dict[str, str]:
    """Table axis → log; raises RecipeError for an axis without its log, or a log of neither."""
    axes = {"a": spec.pair.axis_a, "b": spec.pair.axis_b}
    for axis, name in axes.items():
        if name not in files:
            raise RecipeError(
                f"pair.axis_{axis} = '{name}': no such log among {', '.join(files)}",
                hint="a pair needs the log of each table axis; see [logs] files and [[exclude]]",
            )
    if extra := [file for file in files if file not in axes.values()]:
        raise RecipeError(
            f"{extra[0]}: a log of neither table axis", hint="name one log an axis under [pair]"
        )
    return axes


def _fit(
    spec: GyroPairRecipe, data: Path, files: Sequence[str], progress: Progress
) -> pair_files.PairFit:
    """Both runs and what they say of the pair."""
    axes = {file: axis for axis, file in _axes(spec, files).items()}
    logs = copies.refuse_copies(
        ingest.read_ahead(
            progress(list(axes), "reading and averaging"), lambda file: read(spec, data, file)
        )
    )
    runs = {axes[log.file]: gyro_runs.run_of(log, GYROS, spec) for log in logs}
    return pair_files.pair_fit(runs["a"], runs["b"])


def fit(
    spec: GyroPairRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.GyroReport]:
    """Fit the scale factors about both axes and the orthogonality of the pair."""
    fitted = _fit(spec, data, files, progress)
    scales = pair_files.pair_scale_result(fitted, spec)
    tables = (
        gyro_report.scale_table(scales.models),
        *gyro_report.temperature_table(scales.models),
        gyro_report.figure_table(
            scales.figures, ("a_about_a", "b_about_b"), "Figures of each gyro about its own axis"
        ),
        *gyro_report.bias_table(scales.figures),
        gyro_report.pair_table(fitted),
    )
    criteria = gyro_report.pair_criteria(fitted, scales, spec.acceptance)
    logs = [fitted.runs[axis].log for axis in ("a", "b")]
    return Fitted(
        (scales, pair_files.orthogonality_result(fitted, spec)),
        tuple(Input.of(log) for log in logs),
        Summary(spec.title, tables, fitted.flags, criteria),
        gyro_report.pair_drawing(fitted),
    )


def _frozen(records: Mapping[str, Record]) -> list[Frozen]:
    """Coefficients of both gyros about their own axes."""
    return [compensate.frozen(records, gyro, f"{gyro}_about_{gyro}") for gyro in GYROS]


def apply(spec: GyroPairRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add each gyro's compensated rate about its own axis to every row of a log."""
    coefficients = _frozen(records)
    log = compensate.read(spec, data, coefficients)
    derived, flags = compensate.compensated(log, coefficients, compensate.earth_rate(records, spec))
    return write_back.rewrite_log(spec, data, {}, derived), flags


def validate(
    spec: GyroPairRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Scale factors of unseen runs against the frozen ones; with both logs, N and γ again."""
    coefficients = {one.gyro: one for one in _frozen(records)}
    known = {spec.pair.axis_a: "a", spec.pair.axis_b: "b"}
    runs: dict[str, gyro_runs.TableRun] = {}
    entries, named = [], []
    flags: list[str] = []
    for log in logs:
        if log.file not in known:
            raise RecipeError(
                f"{log.file}: a log of neither table axis", hint="name one log an axis under [pair]"
            )
        axis = known[log.file]
        run = runs[axis] = gyro_runs.run_of(log, GYROS, spec)
        stand = compensate.stand(run, coefficients[axis], spec)
        entries.append({"name": log.file, "sha256": log.sha256, "rows": log.rows, "gyros": [stand]})
        named.append((log.file, stand))
        flags += run.flags
    body: dict[str, Any] = {"logs": entries}
    tables = [gyro_report.validation_table(named)]
    if len(runs) == len(GYROS):
        again = pair_files.pair_fit(runs["a"], runs["b"])
        body["pair"] = _against(records, again.found)
        tables.append(_pair_table(body["pair"]))
        flags += again.flags
    criteria = gyro_report.validation_criteria([stand for _, stand in named], spec.acceptance)
    return body, Summary("", tuple(tables), tuple(dict.fromkeys(flags)), criteria)


def _against(records: Mapping[str, Record], again: GyroPair) -> list[dict[str, Any]]:
    """N, ε, γ, α of unseen runs against the frozen ones."""
    if "gyro_orthogonality.json" not in records:
        raise CoefficientError(
            "the run holds no gyro_orthogonality.json", hint="it is not a run of gyro_pair"
        )
    frozen = records["gyro_orthogonality.json"].model("pair")
    found = (again.N, again.epsilon, again.gamma, again.alpha_deg)
    return [
        {
            "name": c.name,
            "frozen": c.value,
            "found": value,
            "difference": value - c.value,
            "standard_uncertainty": float((u**2 + c.standard_uncertainty**2) ** 0.5),
            "unit": c.unit,
        }
        for c, value, u in zip(
            frozen.coefficients, found, again.standard_uncertainty.tolist(), strict=True
        )
    ]


def _pair_table(entries: Sequence[dict[str, Any]]) -> Table:
    """Pair figures, frozen and found."""
    rows = tuple(
        (
            e["name"],
            f"{e['frozen']:.9f}",
            f"{e['found']:.9f}",
            f"{e['difference']:+.1e} ± {e['standard_uncertainty']:.0e}",
            e["unit"],
        )
        for e in entries
    )
    return Table("The pair again", ("", "frozen", "found", "difference", "unit"), rows)


def draw(title: str, fitted: Fitted[pages.GyroReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(title, fitted.drawing)), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.gyro_scale.certificate import blocks

    return blocks(stated)


def _firmware() -> Firmware[GyroPairRecipe]:
    """How a run becomes firmware."""
    from calibkit.instruments.gyro_scale.firmware import PAIR

    return PAIR


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.gyro_scale.simulate_pair import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.gyro_scale.propose import propose_pair

    return propose_pair(evidence)


INSTRUMENT = Instrument(
    recipe=GyroPairRecipe,
    read=read,
    examine=examine,
    fit=fit,
    draw=draw,
    validate=validate,
    apply=apply,
    certificate=_certificate,
    firmware=_firmware,
    key_figures=(
        r"gyro_scale\.(a_about_a|b_about_b|b_about_a|a_about_b)\.(K|F0|residual_rms)",
        r"gyro_scale\.(nonlinearity_full_scale|asymmetry)\.GJB 2426A\..+",
        r"gyro_orthogonality\.(N|epsilon|gamma|alpha_deg)",
    ),
    campaigns={"gyro_pair": _simulate},
    propose=_propose,
)
