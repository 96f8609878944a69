"""What stands in logs, before coefficients are written: check and init."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from calibkit import instruments, recipe
from calibkit.certificate.quantities import state
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.check import examination
from calibkit.check.report import CheckedCampaign, Judgement, Reached
from calibkit.errors import FitError, FrameError, LogFormatError, RecipeError, UsageError, visible
from calibkit.libraries.threads import one_thread
from calibkit.logs import log_files, proposal
from calibkit.planning import comparison, equipment, search
from calibkit.planning.bench import COVERAGE, Task
from calibkit.recipe import type_b
from calibkit.records import new_files
from calibkit.records.coefficients import Identity
from calibkit.report import budget, figures
from calibkit.results.still_good import state_place
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from calibkit.check.report import LogReport
    from calibkit.instruments import Fitted, Instrument, Progress
    from calibkit.logs.proposal import ProposedText
    from calibkit.planning.document import Plan
    from calibkit.records.frame import Log

LARGEST_TRIAL = 50_000_000
"""Bytes of logs up to which a campaign is judged by a fit on trial."""


@one_thread()
def check(
    source: recipe.Source,
    data: Path,
    figure: Path | None = None,
    progress: Progress = instruments.silent,
    planned: Plan | None = None,
) -> CheckedCampaign:
    """What each log that a recipe would read holds and what is wrong with it, and what the logs
    determine together; nothing is written but the figure.

    A figure (PDF, one page per log) is written where a path for it is given. Where the recipe is
    that of a plan, its schedule states what is missing or differs.
    """
    if figure is not None:
        new_files.refuse_existing(figure)
    spec = instruments.parse_recipe(source)
    instrument = instruments.find(spec.procedure)
    with source.placing():
        files = log_files.find_logs(spec, data)
        log_files.require_named_logs(spec, files)
        outcomes = [
            examination.examine_log(instrument, spec, data, file)
            for file in progress(files, "checking")
        ]
    compared = examination.compare_logs(outcomes)
    if figure is not None:
        log_figures = [outcome.figure for outcome in outcomes if outcome.figure is not None]
        if not log_figures:
            raise FrameError(
                f"{data}: no log could be read, nothing to draw", hint="see check without --figure"
            )
        with figures.styled():
            new_files.write_new(
                figure, figures.pdf([log_figure.draw() for log_figure in log_figures])
            )
    reports = []
    for report in (outcome.report for outcome in outcomes):
        shared = [finding for log_file, finding in compared if log_file == report.file]
        reports.append(replace(report, findings=(*report.findings, *shared)))
    judgement = _judge(instrument, spec, data, files, reports, progress, planned)
    if planned is not None:
        refused = {report.file for report in reports if report.refused}

        def read(name: str) -> Log | None:
            is_readable = (data / name).is_file() and name not in refused
            return instrument.read(spec, data, name) if is_readable else None

        missing = comparison.find_differences(planned.schedule, read)
        judgement = replace(judgement, lacks=(*judgement.lacks, *missing))
    return CheckedCampaign(tuple(reports), judgement)


def _judge(
    instrument: Instrument,
    spec: recipe.Recipe,
    data: Path,
    files: Sequence[str],
    reports: Sequence[LogReport],
    progress: Progress,
    planned: Plan | None,
) -> Judgement:
    """What the logs of a campaign determine together: by the fit itself, on trial, and with which
    uncertainty, as a plan judges it.
    """
    refused = sum(report.refused for report in reports)
    if refused:
        lacks = f"{refused} of {len(reports)} logs refused: mend them, or exclude them"
        return Judgement((), (lacks,), exports=False, exit_code=FrameError.exit_code)
    size = sum((data / file).stat().st_size for file in files if (data / file).is_file())
    if size > LARGEST_TRIAL:
        lacks = f"{size / 1e6:,.0f} MB of logs are not fitted on trial: see fit --dry-run"
        return Judgement((), (lacks,), exports=None)
    try:
        fitted = instrument.fit(spec, data, files, progress)
        results = budget.name_results(fitted.results)
        type_b.require_known(spec.type_b, (*results, *spec.own_columns()))
    except (FrameError, FitError, LogFormatError, RecipeError) as error:
        plannable = (
            isinstance(error, FitError)
            and instruments.optional(spec.procedure, "prepare_plan") is not None
        )
        cure = (f"calibkit plan RECIPE --have {data} plans what it takes",) if plannable else ()
        return Judgement((), (str(error), *cure), exports=False, exit_code=error.exit_code)
    determined = []
    for result in fitted.results:
        models = [model.name for model in result.models]
        content = f"{len(result.figures)} figures"
        if models:
            content = ", ".join(models) if len(models) < 5 else f"{len(models)} models"
        determined.append(f"{result.stage} ({content})")
    predicted = _predict(instrument, spec, data, files, fitted, planned) if planned else ()
    missed = (
        f"{prediction}: calibkit plan RECIPE --have {data} plans what is missing"
        for prediction in predicted
        if prediction.wanted is not None and prediction.expanded_uncertainty > prediction.wanted
    )
    return Judgement(
        tuple(determined),
        (*fitted.lacks, *missed),
        exports=fitted.exports,
        verdict=fitted.summary.verdict,
        reached=tuple(_state_largest(spec, fitted)),
        predicted=predicted,
    )


def _state_largest(spec: recipe.Recipe, fitted: Fitted[Any]) -> Iterator[Reached]:
    """Largest uncertainty of each result that runs are compared by, as the fit on trial states it:
    at the ends and in the middle of the first input.
    """
    list_results = instruments.optional(spec.procedure, "results")
    if list_results is None or not fitted.results:
        return
    identity = Identity("", 0, "", "", "", fitted.inputs)
    records = {result.file: result.as_record(identity, "") for result in fitted.results}
    source = TypeBTerms.merge(spec.type_b, ())
    basis = Stated(records, source, (), spec.reference_temp_degc, fitted.sensitivities)
    quantities = list_results(records, spec)
    names = Counter(quantity.words.en for quantity in quantities)
    for quantity in quantities:
        points = [point for point in quantity.spread() if not quantity.outside(point)]
        results = [state(basis, quantity, point) for point in points]
        known = [(result, result.uncertainty) for result in results if result.uncertainty]
        if not known:
            continue
        relative = quantity.relative and all(result.value for result, _ in known)
        stated = [
            (u.expanded_uncertainty / (1e-6 * abs(result.value) if relative else 1.0), k)
            for k, (result, u) in enumerate(known)
        ]
        expanded, number = max(stated)
        result, largest = known[number]
        unit = "ppm" if relative else unit_mark(quantity.unit)
        part = max(largest.contributions, key=lambda part: part.contribution)
        name = quantity.words.en
        if names[name] > 1:
            name = f"{name} of {quantity.model}"
        yield Reached(
            *(name, unit, expanded, largest.coverage_factor),
            state_place(result),
            part.name.en,
        )


def _predict(
    instrument: Instrument,
    spec: recipe.Recipe,
    data: Path,
    files: Sequence[str],
    fitted: Fitted[Any],
    planned: Plan,
) -> tuple[Reached, ...]:
    """Uncertainty of what a plan wants over its range: with noise and shared errors as the fit
    found them, others as on the sample bench. Empty for what is not determined.
    """
    prepare = instruments.optional(spec.procedure, "prepare_plan")
    if prepare is None or planned.range_degc is None:
        return ()
    logs = tuple(instrument.read(spec, data, file) for file in files)
    earlier = {f"{result.stage}.json": result for result in fitted.results}
    bench = equipment.read_equipment(None)
    try:
        task = Task(bench, range_degc=planned.range_degc, earlier=earlier, have=logs)
        predictions = search.judge(prepare(spec, task))
    except (UsageError, FitError, FrameError):
        return ()
    low, high = planned.range_degc
    where = " to ".join(dict.fromkeys((f"{low:.0f}", f"{high:.0f}")))
    return tuple(
        Reached(
            *(result.name, result.unit, result.expanded, COVERAGE, f"{where} °C"),
            max(result.limits, key=lambda source: result.limits[source]),
            planned.wanted[result.name],
        )
        for result in predictions
        if result.name in planned.wanted
    )


def init(folder: Path, sheet: str = "") -> ProposedText:
    """Commented recipe for the logs of a folder, with what check finds in the first of them."""
    proposers = [
        propose
        for procedure in instruments.list_usable()
        if (propose := instruments.optional(procedure, "propose")) is not None
    ]
    parse, skeleton = instruments.parse_recipe, instruments.SKELETON
    proposed = proposal.propose(folder, parse, proposers, skeleton, sheet)
    spec = parse(recipe.Source("proposed recipe", proposed.text))
    instrument, file = instruments.find(spec.procedure), log_files.find_logs(spec, folder)[0]
    try:
        report = examination.examine_log(instrument, spec, folder, file).report
    except RecipeError as error:  # something that is not in the logs, like the site's gravity
        check_lines = [str(error)]
    else:
        check_lines = [*report.reading, *map(str, report.findings)] or ["nothing is wrong with it"]
    lines = [visible(f"# check of {file}: {x}") for part in check_lines for x in part.splitlines()]
    return replace(proposed, text="\n".join([*lines, proposed.text]))
