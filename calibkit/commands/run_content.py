"""What a fit writes into its run folder: coefficient files, the report in its three forms, and
run.json, which lists them.
"""

import functools
import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from calibkit import instruments
from calibkit.check import copies
from calibkit.errors import CalibkitError, CoefficientError
from calibkit.history.pooling import POOLED, Pooled
from calibkit.instruments import SHIPPED, Fitted
from calibkit.libraries import plugins
from calibkit.recipe import Recipe, Source, type_b
from calibkit.records import (
    coefficients,
    new_files,
    run_document,
    sealed,
    store,
)
from calibkit.records.version import SOFTWARE
from calibkit.report import budget, documents, figures, page, pdf, screen, svg
from calibkit.report.overview import describe_span
from calibkit.report.run import Shown, compose_page, summarize_run
from calibkit.report.summary import Summary

_LIBRARIES = ("numpy", "scipy", "pandas", "PyWavelets", "lmfit", "matplotlib")


def complete_summary(fitted: Fitted[Any], pooled: Pooled) -> Summary:
    """Summary of a fit with the flags of pooled runs, the names of its logs, how many they are, and
    the case temperatures over which its models hold.
    """
    flags = (*pooled.flags, *fitted.summary.flags)
    count = len(fitted.inputs)
    valid = [
        model.valid["temp_case_degc"]
        for result in fitted.results
        for model in result.models
        if "temp_case_degc" in model.valid
    ]
    data_extent = f"{count} log{'s' if count > 1 else ''}"
    if valid:
        low, high = min(low for low, _ in valid), max(high for _, high in valid)
        data_extent += f", {describe_span(low, high, '°C')}"
    overview = replace(fitted.summary.overview, data_extent=data_extent)
    logs = tuple(log.name for log in fitted.inputs)
    return replace(fitted.summary, flags=flags, logs=logs, overview=overview)


def build_run(
    source: Source,
    pooled: Pooled,
    fitted: Fitted[Any],
    serial: str,
    revision: int,
    date: str,
    superseded: Mapping[str, str],
) -> tuple[
    dict[str, Any], dict[str, coefficients.Record], dict[str, bytes], Shown, documents.Drawn
]:
    """Make all files of a run that holds from `date`; `superseded` is the digest of each stage's
    coefficient file in the revision before.

    Returns what run.json and the coefficient files hold, name → bytes of every file, what the
    report shows, and its figures.
    """
    identity = coefficients.Identity(serial, revision, date, SOFTWARE, source.sha256, fitted.inputs)
    records = {
        result.file: result.as_record(identity, superseded.get(result.stage, ""))
        for result in fitted.results
    }
    files = {name: record.dumps().encode() for name, record in records.items()}
    with figures.styled():
        draw = instruments.optional(pooled.recipe.procedure, "draw")
        drawn = documents.Drawn((), fitted.summary)
        if draw is not None:
            drawn = draw(f"{serial} r{revision:03d}", fitted)
        figures.settle(drawn.figures)
    summary = drawn.summary
    files[documents.TEXT] = screen.plain_text(summary).encode()
    facts = _run_facts(source, pooled, identity, fitted)
    dates = {log.last_date for log in fitted.inputs if log.last_date}
    measured = " to ".join(dict.fromkeys((min(dates), max(dates)))) if dates else ""
    exported, no_firmware = _describe_firmware(pooled.recipe, records)
    drawings, thinned = svg.inline(drawn.figures)
    shown = Shown(
        title=summary.title,
        verdict=summary.last_line,
        overview=replace(summary.overview, table=None),
        tables=summary.tables,
        checks=tuple(summary.checks),
        captions=tuple(figure.get_suptitle() for figure in drawn.figures),
        thinned=thinned,
        exported=exported,
        no_firmware=no_firmware,
        measured=measured,
    )
    report = compose_page(facts | {"files": store.list_files(files)}, records, shown, drawings)
    files[documents.PAGE] = page.render(report, shown)
    text = sealed.seal(facts | {"files": store.list_files(files)})
    document = run_document.loads(text, new_files.RUN_FILE)
    return document, records, {new_files.RUN_FILE: text.encode(), **files}, shown, drawn


def read_report(run: store.StoredRun, suffix: str) -> bytes:
    """The report of a run again: the page that it keeps, or as .pdf the same content."""
    path = run.folder / documents.PAGE
    if not path.is_file():
        raise CoefficientError(
            f"{run.name} keeps no {documents.PAGE}",
            hint="an older calibkit wrote it; see report.pdf there",
        )
    content = store.read_bytes(path)
    if suffix == ".html":
        return content
    try:
        shown, drawings = page.read_kept(content.decode())
    except ValueError as error:
        raise CoefficientError(
            f"{path}: not the page that calibkit wrote: {str(error).splitlines()[0]}",
            hint="restore it from a copy; `calibkit verify` names files that were changed",
        ) from None
    if shown is None:  # calibkit 0.2 wrote the page: the results stand in the text beside it
        text = store.read_bytes(run.folder / documents.TEXT).decode()
        summary = summarize_run(run.name, run.document, {})
        captions = ("",) * len(drawings)
        checks = tuple(summary.checks)
        shown = Shown("", summary.last_line, checks=checks, captions=captions, text=text)
    report = compose_page(run.document, run.records, shown, drawings)
    return pdf.render(report, run.document["effective_from"])


def _describe_firmware(
    spec: Recipe, records: Mapping[str, coefficients.Record]
) -> tuple[tuple[str, ...], str]:
    """Coefficient files that firmware takes, and why nothing can be exported, which is empty where
    it can; no file where the procedure corrects nothing.
    """
    make_chain = instruments.optional(spec.procedure, "chain")
    if make_chain is None:
        return (), "this procedure corrects no indication"
    files = instruments.optional(spec.procedure, "files")(spec)
    try:
        make_chain(spec, records)
    except CalibkitError as error:
        return files, error.message
    return files, ""


def _run_facts(
    source: Source, pooled: Pooled, identity: coefficients.Identity, fitted: Fitted[Any]
) -> dict[str, Any]:
    """run.json without its list of files: the recipe, the logs, the software, the verdict."""
    spec = pooled.recipe
    readers = {plugin for log in identity.inputs for plugin in log.plugins}
    used_plugins = sorted(readers, key=lambda plugin: plugin.name)
    if spec.procedure not in SHIPPED:
        entry = plugins.installed(plugins.INSTRUMENTS)[spec.procedure]
        used_plugins.insert(0, plugins.identify(entry))
    facts = {
        "format": run_document.FORMAT,
        "serial": identity.serial,
        "revision": identity.revision,
        "procedure": spec.procedure,
        "type": spec.type,
        "effective_from": identity.effective_from,
        "software": SOFTWARE,
        "python": platform.python_version(),
        "libraries": dict(_library_versions()),
        "plugins": [asdict(plugin) for plugin in used_plugins],
        "recipe": describe_recipe(source),
        "inputs": [copies.describe_input(log) for log in identity.inputs],
        "excluded": [
            {key: value for key, value in entry.model_dump().items() if value != ()}
            for entry in spec.exclude
        ],
        "corrections": [entry.model_dump() for entry in spec.correction],
        "type_b": type_b.dumps(spec.type_b),
        POOLED: list(pooled.runs),
        "verdict": fitted.summary.verdict,
        "accepted": run_document.ACCEPTED[fitted.summary.verdict],
        "acceptance": [asdict(criterion) for criterion in fitted.summary.criteria],
        "uncertainty": budget.combine_results(fitted.results, spec.type_b, fitted.uncertainty),
        "sensitivities": [asdict(entry) for entry in fitted.sensitivities],
        "left_out": [
            asdict(fact)
            for facts in (*(log.left_out for log in identity.inputs), fitted.left_out)
            for fact in facts
        ],
        "flags": list(fitted.summary.flags),
    }
    optional = ("type", "plugins", "corrections", "left_out", POOLED)
    return {key: value for key, value in facts.items() if value or key not in optional}


@functools.cache
def _library_versions() -> dict[str, str]:
    """Library → version; found once, because each is a file that is searched for and parsed."""
    return {name: importlib.metadata.version(name) for name in _LIBRARIES}


def describe_recipe(source: Source) -> dict[str, Any]:
    """A recipe as run.json and fleet.json state it."""
    return {
        "name": source.name,
        "sha256": source.sha256,
        "overrides": list(source.overrides),
        "text": source.text,
    }


def list_guesses(inputs: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """What was guessed of how the logs are written: one line per guess, with the logs that it was
    made of, as run.json lists them.
    """
    logs_by_guess: dict[str, list[str]] = {}
    for entry in inputs:
        for guess in entry.get("guesses", ()):
            logs_by_guess.setdefault(guess, []).append(entry["name"])
    return tuple(
        f"{names[0] if len(names) == 1 else f'{len(names)} logs'}: {guess}; pin it in the recipe"
        for guess, names in logs_by_guess.items()
    )
