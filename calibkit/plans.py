"""`calibkit plan`: a recipe and wishes → the campaign to run, its recipe and its page."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import instruments, new_files, recipe, store, units
from calibkit.errors import UsageError
from calibkit.frame import refuse
from calibkit.ingest import column_values, logs as ingest
from calibkit.planning import document, equipment, page, screen, search
from calibkit.planning.search import WITHHELD
from calibkit.planning.task import Task
from calibkit.threads import one_thread

if TYPE_CHECKING:
    from pathlib import Path

    from calibkit.planning.search import Proposal
    from calibkit.report.summary import Summary
    from calibkit.simulate.campaign import Campaign

PRINTED = ("plan", "hours", "operator_h", "results", "third_more", "notes")
"""What --json prints of plan.json."""
UNJUDGED = "no log is withheld: none judges the fit that it did not see"
PLAIN = {"files", "missing", "sentinels"}
"""Keys of [logs] that plain CSV may have."""
NOT_NUMBERS = {"time_format", "date", "accumulated", "wraps_at"}
"""Keys of a column whose values are not those of the canonical one."""


@dataclass(frozen=True, slots=True)
class _Planned:
    """A plan that was written."""

    proposal: Proposal
    summary: Summary
    files: tuple[Path, ...]
    document: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Request:
    """What a plan is asked for, as the command line states it."""

    wishes: tuple[str, ...] = ()
    within_h: float | None = None
    range_degc: tuple[float, float] | None = None
    equipment: Path | None = None
    attitudes: str = ""
    earlier: str = ""
    runs: Path | None = None
    have: Path | None = None


@one_thread()
def plan(source: recipe.Source, request: Request, out: Path, *, dry_run: bool = False) -> _Planned:
    """Plan a campaign and write schedule.csv, plan.json, recipe.toml and plan.html.

    Raises UsageError for what cannot be planned.
    """
    spec = instruments.parse_recipe(source)
    prepare = _stated(spec.procedure, "prepare_plan")
    paths = [document.PLAN, document.SCHEDULE, document.RECIPE, document.PAGE]
    for name in paths:
        new_files.refuse_existing(out / name)
    task = _task(spec, request)
    proposal = search.propose(prepare(spec, task))
    logs = {one.log for one in proposal.schedule.actions}
    if not task.withheld and not any(log.startswith(WITHHELD) for log in logs):
        proposal = replace(proposal, notes=(*proposal.notes, UNJUDGED))
    title = spec.title or spec.procedure
    summary = screen.summarize(proposal, title, request.within_h)
    written = document.write_recipe(spec, proposal, added=bool(task.have))
    # the recipe that is handed out must be one
    instruments.parse_recipe(recipe.Source(document.RECIPE, written))
    beside = {
        document.SCHEDULE: proposal.schedule.to_csv(),
        document.RECIPE: written.encode(),
    }
    text = document.plan_document(proposal, task, source, spec.procedure, beside)
    shown = page.make_page(summary, proposal)
    files = {document.PLAN: text.encode(), **beside, document.PAGE: shown}
    new_files.write_all({out / name: files[name] for name in paths}, dry_run=dry_run)
    printed = {key: value for key, value in json.loads(text).items() if key in PRINTED}
    return _Planned(proposal, summary, tuple(out / name for name in paths), printed)


def _stated(procedure: str, name: str) -> Any:  # noqa: ANN401 (a name of `instruments.ROOMS`)
    """A function of the plan of a procedure; UsageError where it is not planned."""
    function = instruments.optional(procedure, name)
    if function is None:
        able = [one for one in instruments.list_usable() if instruments.optional(one, name)]
        raise UsageError(
            f"campaigns of '{procedure}' are not planned", hint=f"there are {', '.join(able)}"
        )
    return function


def _task(spec: recipe.Recipe, request: Request) -> Task:
    """Task of a plan, with everything that has to be read for it."""
    found = None if request.equipment is None else recipe.find(str(request.equipment))
    earlier = None
    if request.earlier and request.runs is not None:
        earlier = store.load(store.find(request.earlier, request.runs)).records
    have: tuple[Any, ...] = ()
    if request.have is not None:
        if not request.have.is_dir():
            raise UsageError(
                f"--have {request.have}: no such folder",
                hint="name the folder that holds the logs which are measured already",
            )
        instrument, names = instruments.find(spec.procedure), ingest.find_logs(spec, request.have)
        have = tuple(instrument.read(spec, request.have, name) for name in names)
        for log in have:
            refuse(instrument.faults(spec, log).findings)
    return Task(
        equipment.read_equipment(found),
        request.wishes,
        request.within_h,
        request.range_degc,
        request.attitudes,
        earlier,
        have,
        request.have is not None and any((request.have / WITHHELD).glob("*")),
    )


def simulate(folder: Path, out: Path, seed: int, *, dry_run: bool = False) -> list[str]:
    """Write the logs of a campaign that was run by a plan, and its truth; returns the names of the
    files.
    """
    files = simulated(folder, seed).files()
    new_files.write_all({out / name: content for name, content in files.items()}, dry_run=dry_run)
    return sorted(files)


def simulated(folder: Path, seed: int) -> Campaign:
    """Campaign that was run by the plan of a folder."""
    found = document.load_plan(folder)
    if not found.schedule.actions:
        raise UsageError(f"{folder}: a plan of no actions", hint="it has nothing to simulate")
    spec = instruments.parse_recipe(found.source)
    run = _stated(spec.procedure, "simulate_plan")
    campaign = run(spec, found.schedule, found.assumed, seed)
    truth = {**campaign.truth, "seed": seed, "plan": found.document["sha256"]}
    return _as_logged(spec, replace(campaign, truth=truth))


def _as_logged(spec: recipe.Recipe, made: Campaign) -> Campaign:
    """Logs in the columns, units and signs that the recipe maps; UsageError for a recipe whose logs
    are no plain CSV.
    """
    others = [f"[logs] {key}" for key in spec.logs.model_fields_set - PLAIN]
    mapped = {name: one for name, one in spec.columns.items() if name in made.decimals}
    for name, one in mapped.items():
        keys = one.model_fields_set & NOT_NUMBERS
        others += [f"[columns.{name}] {key}" for key in keys]
    if spec.chamber is not None:
        others.append("[chamber]")
    if others:
        raise UsageError(
            f"the recipe of the plan states {', '.join(sorted(others))}: simulated logs are plain"
            " CSV, with numbers",
            hint="plan and simulate by a recipe without it",
        )
    decimals, logs = dict(made.decimals), {file: dict(log) for file, log in made.logs.items()}
    for name, one in mapped.items():
        stated = units.unit_in_header(one.source)
        ends = column_values.unmap_values(np.array([0.0, 1.0]), one, name, spec, stated)
        slope = abs(float(ends[1] - ends[0]))
        decimals[one.source] = max(decimals[name] - math.floor(math.log10(slope)), 0)
        for log in logs.values():
            column = np.asarray(log.pop(name), dtype=np.float64)
            log[one.source] = column_values.unmap_values(column, one, name, spec, stated)
    return replace(made, logs=logs, decimals=decimals)
