"""One function per command, read top to bottom: logs → stages → coefficient files → run folder."""

from __future__ import annotations

import difflib
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from calibkit import instruments, recipe
from calibkit.check import copies, thermometers
from calibkit.commands import layouts, own_files, run_content
from calibkit.errors import (
    CalibkitError,
    CoefficientError,
    FrameError,
    MissingColumnError,
    OutputError,
    TakenError,
    UsageError,
)
from calibkit.history import dates, pooling
from calibkit.libraries.threads import one_thread
from calibkit.logs import log_files
from calibkit.recipe import type_b
from calibkit.records import clock, new_files, run_document, sealed, store
from calibkit.records.frame import refuse
from calibkit.records.version import SOFTWARE
from calibkit.report import budget

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from calibkit.certificate.signature_trust import Demands
    from calibkit.certificate.verify import Verified
    from calibkit.firmware.chain import Chain
    from calibkit.firmware.export import FirmwareRun
    from calibkit.instruments import Progress
    from calibkit.logs.write_back import Applied, Rewritten
    from calibkit.report.documents import Drawn
    from calibkit.report.run import Shown
    from calibkit.report.summary import Summary
    from calibkit.simulate.campaign import Campaign


@dataclass(frozen=True, slots=True)
class FitOutcome:
    """A finished fit: its run, which a dry run does not save, the summary for people, and what was
    guessed of how the logs are written and of the date.
    """

    run: store.StoredRun
    summary: Summary
    guesses: tuple[str, ...]
    overlaps: tuple[str, ...]
    """Where each log and its second logger's file overlap, and how their clocks differ."""
    files: Mapping[str, bytes]
    """Content of every file of the run folder."""
    shown: Shown
    """What the report shows."""
    drawn: Drawn
    """Its figures."""
    residuals: Callable[[], Mapping[str, object]]
    """Columns of the residuals of the fit, or none."""


@one_thread()
def fit(
    source: recipe.Source,
    data: Path,
    serial: str,
    out: Path,
    date: str | None,
    progress: Progress,
    *,
    dry_run: bool = False,
    today: str | None = None,
    expected: int = 0,
) -> FitOutcome:
    """Fit a recipe to logs and write the next revision of a run folder; a dry run only names it.
    Where another process has taken the number meanwhile it becomes the revision after that; where a
    number is `expected`, TakenError is raised.

    Without a date that of the logs' last row holds, and where they have none `today`, which is the
    clock's where it is not given.
    """
    spec = instruments.parse_recipe(source)
    serial = store.check_serial(serial or spec.serial)
    with source.placing():
        logs = log_files.find_logs(spec, data)
        log_files.require_named_logs(spec, logs)
        pooled = pooling.pool_components(spec, out, [data / name for name in logs])
        fitted = instruments.find(spec.procedure).fit(pooled.recipe, data, logs, progress)
    other_unit_findings = thermometers.find_other_units(
        {log.name: log.measured for log in fitted.inputs}
    )
    refuse(finding for _, finding in other_unit_findings)
    type_b.require_known(spec.type_b, (*budget.name_results(fitted.results), *spec.own_columns()))
    dated = "" if date else max((log.last_date for log in fitted.inputs), default="")
    date = date or dated or clock.date_or_today(today)
    for revision, superseded in store.next_revisions(out, serial):
        if expected not in (0, revision):
            raise TakenError(
                f"{out / serial}: another calibkit has just written r{expected:03d}",
                hint="run again",
            )
        fit_summary = run_content.complete_summary(fitted, pooled)
        fit_summary = replace(
            fit_summary,
            flags=(*fit_summary.flags, *(str(finding) for _, finding in other_unit_findings)),
        )
        summary = dates.flag_earlier_runs(fit_summary, out, serial, revision, date)
        summary = layouts.flag_layout(summary, pooled.recipe, fitted, out, serial, revision)
        document, records, files, shown, drawn = run_content.build_run(
            source, pooled, replace(fitted, summary=summary), serial, revision, date, superseded
        )
        folder = store.save(out, serial, revision, files, dry_run=dry_run)
        if folder is not None:
            run = store.StoredRun(folder, document, records)
            break
    residuals = getattr(fitted.drawing, "residuals", dict)
    summary = replace(drawn.summary, title=f"{run.name}: {spec.title or spec.procedure}")
    guesses = run_content.list_guesses(run.document["inputs"])
    last = f"effective from {dated}, the date of the last row of the logs; --date states another"
    overlaps = tuple(f"{log.name}: {log.overlap}" for log in fitted.inputs if log.overlap)
    guesses = (*guesses, last) if dated else guesses
    return FitOutcome(run, summary, guesses, overlaps, files, shown, drawn, residuals)


def run_recipe(run: store.StoredRun, overrides: tuple[str, ...]) -> recipe.Recipe:
    """Recipe of a run as it was fitted, with overrides for the place of use; nothing is excluded
    from now on. CoefficientError for a model of a form that its procedure does not have.
    """
    forms = [form.name for form in instruments.find(run.document["procedure"]).FORMS]
    for name, record in run.records.items():
        for model in record.models:
            if model.form not in forms:
                raise CoefficientError(
                    f"{run.folder / name}: model form '{model.form}', expected one of"
                    f" {', '.join(forms) or 'none'}",
                    hint="use the calibkit, or the plugin, that wrote it",
                )
    return instruments.fitted_recipe(run.document, *overrides).model_copy(update={"exclude": ()})


def apply(
    run: store.StoredRun,
    data: Path,
    out: Path,
    overrides: tuple[str, ...],
    *,
    keep: bool = False,
    dry_run: bool = False,
) -> tuple[Rewritten, tuple[str, ...]]:
    """Write a log that is compensated as by `compensate`, every row and column of it; returns what
    was done and the flags.
    """
    new_files.refuse_existing(out)
    if not data.is_file():
        raise UsageError(f"--data {data}: no such file", hint="name one log")
    content, flags = compensate(run, data, overrides, keep=keep)
    new_files.write_new(out, content, dry_run=dry_run)
    return content, flags


def compensate(
    run: store.StoredRun,
    data: Path,
    overrides: tuple[str, ...],
    *,
    keep: bool = False,
) -> Applied:
    """A log compensated with a run's coefficients, and the flags.

    Rows that cannot be corrected have a status, and `keep` their logged value.
    """
    spec = run_recipe(run, overrides)
    # every row is written: one file as it is; rows that lack a value are not corrected
    logs = spec.logs.model_copy(update={"split": False, "missing": "drop"})
    spec = spec.model_copy(update={"logs": logs})
    try:
        content, flags = instruments.find(spec.procedure).correct(spec, run.records, data)
        flags = (*store.flag_rejected(run), *flags)
    except MissingColumnError as error:
        mapped = " ".join(f"--set columns.{name}.from=…" for name in error.columns)
        raise FrameError(
            error.message,
            hint=(
                f"{run.name} needs {', '.join(error.columns)}: name the log's own columns with"
                f" {mapped}"
            ),
        ) from None
    corrected = (
        f"{entry.column} corrected by certificate {entry.certificate}: --set correction=[] where"
        " other instruments measured"
        for entry in spec.correction
    )
    return replace(content, keep=keep), (*corrected, *flags)


def validate(
    run: store.StoredRun,
    data: Path,
    out: Path,
    progress: Progress,
    overrides: tuple[str, ...] = (),
    *,
    dry_run: bool = False,
) -> tuple[dict[str, Any], Summary]:
    """Write as JSON what `judge_unseen` finds."""
    new_files.refuse_existing(out)
    text, summary = judge_unseen(run, data, progress, overrides)
    new_files.write_new(out, text.encode(), dry_run=dry_run)
    return sealed.unseal(text, str(out), run_document.VALIDATION_FORMAT), summary


@one_thread()
def judge_unseen(
    run: store.StoredRun, data: Path, progress: Progress, overrides: tuple[str, ...] = ()
) -> tuple[str, Summary]:
    """Hold a run's frozen coefficients against logs that they have not seen, as written or named
    otherwise by overrides of its recipe; the figures as JSON, and a summary.
    """
    spec, inputs = run_recipe(run, overrides), run.document["inputs"]
    files = log_files.find_logs(spec, data)
    instrument = instruments.find(spec.procedure)
    excluded = instruments.fitted_recipe(run.document).exclude
    fitted_log_notes: list[str] = []
    new = copies.read_unseen(
        instrument.read,
        spec,
        data,
        progress(files, "validating"),
        inputs,
        excluded,
        run.name,
        fitted_log_notes,
    )
    body, summary = instrument.validate(spec, run.records, new)
    summary = replace(
        summary,
        title=f"{run.name} on {len(files) - len(fitted_log_notes)} logs that it has not seen",
        flags=(
            *fitted_log_notes,
            *copies.flag_missing_fingerprints(run.name, inputs),
            *summary.flags,
        ),
        logs=tuple(files),
    )
    document = {
        "format": run_document.VALIDATION_FORMAT,
        "serial": run.document["serial"],
        "revision": run.document["revision"],
        "run_sha256": run.document["sha256"],
        "software": SOFTWARE,
        **body,
        "acceptance": [asdict(criterion) for criterion in summary.criteria],
        "verdict": summary.verdict,
        "accepted": run_document.ACCEPTED[summary.verdict],
        "flags": list(summary.flags),
    }
    return sealed.seal(document), summary


def _firmware_export(
    run: store.StoredRun, number: str, prefix: str, *, allow_rejected: bool
) -> FirmwareRun:
    """A run's correction chain in a number format; refuses a run that failed its acceptance limits
    unless told not to.
    """
    from calibkit.firmware import export, formats, sources

    document = run.document
    rejected = store.flag_rejected(run)
    if rejected and not allow_rejected:
        raise OutputError(
            rejected[0],
            hint="fit it again within its limits, or export it as rejected with --allow-rejected",
        )
    spec, number_format = run_recipe(run, ()), formats.Format.find(number)
    make_chain = instruments.optional(spec.procedure, "chain")
    if make_chain is None:
        raise OutputError(
            f"procedure '{spec.procedure}' has no firmware form", hint="nothing can be exported"
        )
    chain: Chain = make_chain(spec, run.records)
    stages = run.stage_digests()
    identity = export.RunIdentity(
        document["serial"],
        document["revision"],
        document["effective_from"],
        document["sha256"],
        {
            name: stages[name.removesuffix(".json")]
            for name in instruments.optional(spec.procedure, "files")(spec)
        },
        SOFTWARE,
        document["verdict"],
    )
    conventions = instruments.optional(spec.procedure, "conventions")
    convention_lines = () if conventions is None else conventions(spec)
    lines = sources.describe_sources(spec, chain, convention_lines)
    return export.prepare(chain, identity, number_format, prefix, lines)


def export(
    runs: Sequence[store.StoredRun],
    target: str,
    number: str,
    prefix: str,
    out: Path,
    *,
    address: int | None = None,
    layout_of: store.StoredRun | None = None,
    allow_rejected: bool = False,
    dry_run: bool = False,
) -> list[Path]:
    """Write the correction chains of one run or of a fleet's for a firmware target and return the
    files; OutputError where they are not laid out as the run that `layout_of` names.
    """
    from calibkit.firmware import targets

    firmware_target = targets.find_target(target, number, address)
    exports = [_firmware_export(run, number, prefix, allow_rejected=allow_rejected) for run in runs]
    if layout_of is not None:
        pinned = _firmware_export(layout_of, number, prefix, allow_rejected=True)
        targets.require_layout(exports, pinned)
    files = targets.files(firmware_target, exports, address or 0)
    new_files.write_all({out / name: content for name, content in files.items()}, dry_run=dry_run)
    return [out / name for name in sorted(files)]


def verify(
    path: Path,
    demands: Demands | None = None,
    schema_dir: Path | None = None,
    pdfs: Mapping[Path, Verified] | None = None,
) -> Verified:
    """Check a file that calibkit wrote; returns what it is, and the warnings on a certificate. A
    DCC is compared with the certificates in `pdfs`.

    Raises CoefficientError for whatever is wrong with it: its author may have meant it to break;
    NotCheckedError where an optional library is missing.
    """
    from calibkit.certificate import verify as certificates

    try:
        if path.is_file() and certificates.is_certificate(path):
            return certificates.verify(
                path, instruments.certificate_layout, demands, schema_dir, pdfs
            )
        verified = certificates.Verified(own_files.identify(path))
    except CalibkitError:
        raise
    except Exception as error:
        raise CoefficientError(
            f"{path}: cannot be read", hint="it is damaged, or calibkit did not write it"
        ) from error
    if demands is not None and demands.signed:
        raise CoefficientError(
            f"{path}: not signed, and a signature is required: {verified.what}",
            hint="verify the signed certificate, which holds the files that it rests on",
        )
    return verified


def simulate(procedure: str, out: Path, seed: int, *, dry_run: bool = False) -> list[str]:
    """Write a simulated campaign's logs and truth into a new folder; returns the names of the
    files.
    """
    files = simulated(procedure, seed).files()
    new_files.write_all({out / name: content for name, content in files.items()}, dry_run=dry_run)
    return sorted(files)


@one_thread()
def simulated(campaign: str, seed: int) -> Campaign:
    """Simulated campaign of a name, or UsageError with the names there are."""
    campaigns = instruments.campaigns()
    if campaign not in campaigns:
        close = difflib.get_close_matches(campaign, campaigns, n=1)
        guess = f"did you mean '{close[0]}'? " if close else ""
        raise UsageError(
            f"procedure '{campaign}' cannot be simulated",
            hint=f"{guess}there are: {', '.join(sorted(campaigns))}",
        )
    return campaigns[campaign](seed)
