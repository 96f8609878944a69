"""plan.json and the files beside it: written together, read back only as they were written."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from calibkit import sealed, store
from calibkit.errors import CoefficientError, UsageError
from calibkit.planning.proposal import COVERAGE, Candidate, Predicted, Task
from calibkit.planning.schedule import Schedule, read_schedule
from calibkit.recipe import Source
from calibkit.version import SOFTWARE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from calibkit.planning.search import Proposal

FORMAT = "calibkit-plan/1"
PLAN, SCHEDULE, RECIPE, PAGE = "plan.json", "schedule.csv", "recipe.toml", "plan.html"
LONGER = 4.0 / 3.0
"""Hours of the longer campaign that is offered beside a plan, relative to the plan's."""
WORTH = 0.99
"""Uncertainty, relative to that of the plan, from which on more hours buy something."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that was read back."""

    document: Mapping[str, Any]
    schedule: Schedule
    source: Source
    """Its recipe."""


def third_more(proposal: Proposal) -> Candidate | None:
    """The campaign that a third more hours would allow, and to a plan of none the shortest; None
    where they allow no better campaign.
    """
    name = proposal.sought.name
    shortest = min(
        (campaign.hours for campaign in proposal.curve if campaign.hours > 0.0), default=0.0
    )
    hours = proposal.schedule.hours * LONGER or shortest
    inside = [campaign for campaign in proposal.curve if campaign.hours <= hours]
    better = [
        campaign
        for campaign in inside
        if campaign.expanded(name) < WORTH * proposal.sought.expanded
    ]
    return min(better, key=lambda campaign: campaign.expanded(name), default=None)


def plan_document(
    proposal: Proposal,
    task: Task,
    source: Source,
    procedure: str,
    files: Mapping[str, bytes],
) -> str:
    """Sealed text of plan.json."""
    assumed, schedule, more = proposal.assumed, proposal.schedule, third_more(proposal)
    return sealed.seal(
        {
            "format": FORMAT,
            "software": SOFTWARE,
            "procedure": procedure,
            "plan": proposal.campaign.design.label,
            "recipe": {"name": source.name, "sha256": source.sha256},
            "equipment": task.equipment.name,
            "attitudes": task.attitudes,
            "remountings": task.remountings,
            "seed": task.seed,
            "restarts": task.restarts,
            "within_h": task.within_h,
            "range_degc": list(assumed.range_degc),
            "hours": schedule.hours,
            "operator_h": schedule.operator_h,
            "coverage_factor": COVERAGE,
            "results": [
                _result(result, proposal.wanted(result.name)) for result in proposal.results
            ],
            "coefficients": [asdict(coefficient) for coefficient in proposal.coefficients],
            "noise": {"value": assumed.noise, "unit": assumed.device.noise_unit},
            "components": [error.model_dump(mode="json") for error in assumed.components],
            "third_more": None if more is None else _campaign(more),
            "curve": [_campaign(campaign) for campaign in proposal.curve],
            "usual": [_campaign(campaign) for campaign in proposal.usual],
            "notes": list(proposal.notes),
            "settings": dict(proposal.campaign.design.settings),
            "files": [
                {"name": key, "sha256": hashlib.sha256(content).hexdigest()}
                for key, content in files.items()
            ],
        }
    )


def _result(result: Predicted, wanted: float | None) -> dict[str, Any]:
    """A result as JSON."""
    return {
        "name": result.name,
        "unit": result.unit,
        "standard_uncertainty_rms": result.u,
        "standard_uncertainty_max": result.largest_u,
        "expanded_uncertainty": result.expanded,
        "wanted": wanted,
        "met": None if wanted is None else result.expanded <= wanted,
        "limits": [{"source": key, "share": share} for key, share in result.limits.items()],
    }


def _campaign(campaign: Candidate) -> dict[str, Any]:
    """A campaign as JSON."""
    return {
        "name": campaign.design.label,
        "hours": campaign.hours,
        "expanded_uncertainty": {
            name: result.expanded for name, result in campaign.results.items()
        },
    }


def load_plan(folder: Path, plan: str = PLAN) -> Plan:
    """Plan of a folder, whose file may have another name; CoefficientError where a file is not as
    it was written.
    """
    if not (folder / plan).is_file():
        raise UsageError(
            f"{folder}: holds no {plan}", hint="name the folder that calibkit plan wrote"
        )
    document = sealed.unseal(_read(folder / plan), str(folder / plan), FORMAT)
    names = sorted(entry["name"] for entry in document["files"])
    if names != [RECIPE, SCHEDULE]:
        raise CoefficientError(
            f"{folder / plan}: lists {', '.join(names)}, expected {RECIPE} and {SCHEDULE}",
            hint="calibkit did not write it; plan again, or restore the folder",
        )
    for entry in document["files"]:
        path = folder / entry["name"]
        if hashlib.sha256(_read(path).encode()).hexdigest() != entry["sha256"]:
            raise CoefficientError(
                f"{path}: is not the file that belongs to {plan}",
                hint="it was changed after it was written; plan again, or restore it",
            )
    schedule = read_schedule(_read(folder / SCHEDULE), str(folder / SCHEDULE))
    return Plan(document, schedule, Source(RECIPE, _read(folder / RECIPE)))


@dataclass(frozen=True, slots=True)
class Beside:
    """What stands beside the recipe of a plan."""

    schedule: Schedule
    range_degc: tuple[float, float] | None = None
    """Range of use; None where no plan.json is there."""
    wanted: Mapping[str, float] = field(default_factory=dict)
    """Result → expanded uncertainty that was wanted, in the unit of the result."""


def beside(recipe: Path) -> Beside | None:
    """Schedule and wishes beside a recipe's file; None where there is no schedule."""
    path = recipe.with_name(SCHEDULE)
    if not recipe.is_file() or not path.is_file():
        return None
    schedule = read_schedule(_read(path), str(path))
    plan = recipe.with_name(PLAN)
    if not plan.is_file():
        return Beside(schedule)
    document = sealed.unseal(_read(plan), str(plan), FORMAT)
    low, high = document.get("range_degc", (None, None))
    return Beside(
        schedule,
        None if low is None or high is None else (low, high),
        {
            result["name"]: result["wanted"]
            for result in document["results"]
            if result["wanted"] is not None
        },
    )


def _read(path: Path) -> str:
    """Text of a file of a plan, or CoefficientError."""
    try:
        return store.read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise CoefficientError(
            f"{path}: cannot be read: {error}", hint="restore the folder of the plan"
        ) from None
