"""`calibkit plan`: a recipe and wishes → the campaign to run, its recipe and its page."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibkit import instruments, recipe, units
from calibkit.errors import UsageError
from calibkit.libraries.threads import one_thread
from calibkit.logs import column_values, log_files
from calibkit.planning import document, search
from calibkit.planning.bench import WITHHELD, Task
from calibkit.planning.equipment import read_equipment
from calibkit.planning.search import Proposal
from calibkit.records import new_files, store
from calibkit.records.frame import refuse
from calibkit.report.summary import Summary
from calibkit.simulate.campaign import Campaign

UNJUDGED = "no log is withheld: none judges the fit that it did not see"


@dataclass(frozen=True, slots=True)
class _Planned:
    """A plan that was written."""

    proposal: Proposal
    summary: Summary
    files: tuple[Path, ...]
    document: dict[str, Any]


@one_thread()
def plan(
    source: recipe.Source,
    out: Path,
    *,
    wishes: tuple[str, ...] = (),
    within_h: float | None = None,
    range_degc: tuple[float, float] | None = None,
    equipment: Path | None = None,
    attitudes: str = "",
    earlier: str = "",
    runs: Path = Path("runs"),
    have: Path | None = None,
    dry_run: bool = False,
) -> _Planned:
    """Plan a campaign and write schedule.csv, plan.json, recipe.toml and plan.html.

    Parameters
    ----------
    source, out : recipe, and the folder that is written.
    wishes : "NAME<=VALUE UNIT", each an expanded uncertainty.
    within_h : hours of the chamber at most.
    range_degc : range of use.
    equipment : file of the laboratory, by default the sample bench.
    attitudes : name of a fixture, empty for the usual one.
    earlier, runs : run whose errors are assumed, and the folder of runs.
    have : folder with logs that are measured already.
    dry_run : whether nothing is written.

    Raises UsageError for what cannot be planned, FrameError for a measured log that a fit refuses.
    """
    from calibkit.planning import page

    spec = instruments.parse_recipe(source)
    prepare = instruments.optional(spec.procedure, "prepare_plan")
    if prepare is None:
        usable = instruments.list_usable()
        able = [name for name in usable if instruments.optional(name, "prepare_plan")]
        raise UsageError(
            f"campaigns of '{spec.procedure}' are not planned", hint=f"there are {', '.join(able)}"
        )
    paths = [document.PLAN, document.SCHEDULE, document.RECIPE, document.PAGE]
    for name in paths:
        new_files.refuse_existing(out / name)
    laboratory = None if equipment is None else recipe.find(str(equipment))
    measured = []
    if have is not None:
        if not have.is_dir():
            raise UsageError(
                f"--have {have}: no such folder",
                hint="name the folder that holds the logs which are measured already",
            )
        instrument = instruments.find(spec.procedure)
        measured = [instrument.read(spec, have, name) for name in log_files.find_logs(spec, have)]
        for log in measured:
            refuse(instrument.faults(spec, log).findings)
    task = Task(
        read_equipment(laboratory),
        wishes,
        within_h,
        range_degc,
        attitudes,
        store.load(store.find(earlier, runs)).records if earlier else None,
        tuple(measured),
        have is not None and any((have / WITHHELD).glob("*")),
    )
    proposal = search.propose(prepare(spec, task))
    logs = proposal.campaign.schedule.by_log()
    if not task.withheld and not any(log.startswith(WITHHELD) for log in logs):
        proposal = replace(proposal, notes=(*proposal.notes, UNJUDGED))
    summary = page.summarize(proposal, spec.title or spec.procedure, within_h)
    text_of_recipe = document.write_recipe(spec, proposal.campaign, added=bool(task.have))
    # the recipe that is handed out must be one
    instruments.parse_recipe(recipe.Source(document.RECIPE, text_of_recipe))
    hashed_files = {
        document.SCHEDULE: proposal.campaign.schedule.to_csv(),
        document.RECIPE: text_of_recipe.encode(),
    }
    text = document.plan_document(proposal, source, spec.procedure, hashed_files)
    page_html = page.make_page(summary, proposal)
    files = {document.PLAN: text.encode(), **hashed_files, document.PAGE: page_html}
    new_files.write_all({out / name: files[name] for name in paths}, dry_run=dry_run)
    written = json.loads(text)
    keys = ("plan", "hours", "operator_h", "results", "third_more", "notes")
    printed = {key: written[key] for key in keys}
    return _Planned(proposal, summary, tuple(out / name for name in paths), printed)


def simulate(folder: Path, out: Path, seed: int, *, dry_run: bool = False) -> list[str]:
    """Write the logs of a campaign that was run by the plan of a folder, and its truth; returns the
    names of the files.

    Logs have the columns, units and signs that the recipe of the plan maps. Raises UsageError for a
    recipe whose logs are no plain CSV, and for a plan of no actions.
    """
    planned = document.load_plan(folder)
    if not planned.schedule.actions:
        raise UsageError(f"{folder}: a plan of no actions", hint="it has nothing to simulate")
    spec = instruments.parse_recipe(planned.source)
    run = instruments.optional(spec.procedure, "simulate_plan")
    if run is None:
        raise UsageError(
            f"{spec.procedure}: nothing simulates a campaign of its plans",
            hint="run the plan on the bench",
        )
    campaign: Campaign = run(spec, planned.schedule, planned.device, seed)
    mapped = {name: mapping for name, mapping in spec.columns.items() if name in campaign.decimals}
    # of [logs] plain CSV may have three keys; of a column four make its values no numbers
    refused_keys = [] if spec.chamber is None else ["[chamber]"]
    keys = spec.logs.model_fields_set - {"files", "missing", "sentinels"}
    refused_keys += [f"[logs] {key}" for key in keys]
    for name, mapping in mapped.items():
        keys = mapping.model_fields_set & {"time_format", "date", "accumulated", "wraps_at"}
        refused_keys += [f"[columns.{name}] {key}" for key in keys]
    if refused_keys:
        raise UsageError(
            f"the recipe of the plan states {', '.join(sorted(refused_keys))}: simulated logs are"
            " plain CSV, with numbers",
            hint="plan and simulate by a recipe without it",
        )
    decimals, logs = dict(campaign.decimals), [dict(log) for log in campaign.logs.values()]
    for name, mapping in mapped.items():
        unit = units.unit_in_header(mapping.source)
        # as many digits in the logged unit as the canonical one has
        ends = column_values.unmap_values(np.array([0.0, 1.0]), mapping, name, spec, unit)
        decimals[mapping.source] = max(decimals[name] - math.floor(math.log10(np.ptp(ends))), 0)
        for log in logs:
            column = np.asarray(log.pop(name), dtype=np.float64)
            log[mapping.source] = column_values.unmap_values(column, mapping, name, spec, unit)
    truth = {**campaign.truth, "seed": seed, "plan": planned.document["sha256"]}
    as_logged = Campaign(dict(zip(campaign.logs, logs, strict=True)), decimals, truth)
    files = as_logged.files()
    new_files.write_all({out / name: content for name, content in files.items()}, dry_run=dry_run)
    return sorted(files)
