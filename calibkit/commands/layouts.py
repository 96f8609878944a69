"""Flags on a new run whose firmware is not laid out as that of its type or of the revision before,
so that a loader in the field would refuse it.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibkit import instruments
from calibkit.errors import CalibkitError
from calibkit.instruments import Fitted
from calibkit.recipe import Recipe
from calibkit.records import store
from calibkit.records.coefficients import Identity, Record
from calibkit.records.version import SOFTWARE
from calibkit.report.summary import Summary

_Layout = tuple[tuple[str, ...], object, Mapping[str, int]]
"""Model forms, steps, and lengths of tables."""


def flag_layout(
    summary: Summary, spec: Recipe, fitted: Fitted[Any], runs: Path, serial: str, revision: int
) -> Summary:
    """The summary of a revision about to be saved, with a flag where the firmware's layout is not
    that of the revision before, or of the first device of its type in the runs.
    """
    earlier = [number for number in store.revisions(runs / serial) if number < revision]
    # a serial may have runs of several procedures, each with a loader of its own
    before = [n for n in earlier if _procedure(runs, serial, n) == spec.procedure]
    compared = [(serial, before[-1], "the revision before")] if before else []
    first = _first_of_type(spec, runs, serial)
    compared += [(*first, f"the first of type '{spec.type}' here")] if first else []
    if not compared:
        return summary
    identity = Identity(serial, revision, "", SOFTWARE, "", ())
    layout = _layout(
        spec, {result.file: result.as_record(identity, "") for result in fitted.results}
    )
    flags = []
    for name, number, role in compared if layout else ():
        try:
            run = store.load_revision(runs, name, number)
            other = _layout(instruments.fitted_recipe(run.document), run.records)
        except CalibkitError:  # a damaged old revision does not stop the new one
            continue
        if other is None or layout is None or other == layout:
            continue
        forms, other_forms = ", ".join(layout[0]), ", ".join(other[0])
        changed = f"other terms of {forms}"
        if forms != other_forms:
            changed = f"model form {forms}, not {other_forms}"
        flags.append(
            f"firmware: not laid out as {name} r{number:03d}, {role} ({changed}): a loader exported"
            " with that one refuses it; pin the model in the recipe, or export a loader of its own"
        )
    return replace(summary, flags=(*summary.flags, *flags))


def _procedure(runs: Path, serial: str, revision: int) -> str:
    """Procedure of a revision; empty where its run.json is damaged."""
    try:
        return str(store.own_document(runs, serial, revision)["procedure"])
    except CalibkitError:
        return ""


def _layout(spec: Recipe, records: Mapping[str, Record]) -> _Layout | None:
    """Layout of a run's chain; None where nothing can be exported."""
    make_chain = instruments.optional(spec.procedure, "chain")
    if make_chain is None:
        return None
    try:
        chain = make_chain(spec, records)
    except CalibkitError:
        return None
    lengths = {name: len(chain.tables[name]) for name in chain.structure.tables}
    return chain.structure.forms, chain.structure, lengths


def _first_of_type(spec: Recipe, runs: Path, serial: str) -> tuple[str, int] | None:
    """Serial and newest revision of the first other device whose type and procedure are those of a
    recipe; None where it names no type.
    """
    for folder in sorted(runs.iterdir()) if spec.type and runs.is_dir() else ():
        revisions = store.revisions(folder) if folder.is_dir() and folder.name != serial else []
        try:
            document = store.own_document(runs, folder.name, revisions[-1]) if revisions else {}
        except CalibkitError:
            continue
        if (document.get("procedure"), document.get("type")) == (spec.procedure, spec.type):
            return folder.name, revisions[-1]
    return None
