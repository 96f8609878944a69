"""plan.json and the files beside it: written together, read back only as they were written.

plan.json is sealed, and holds the SHA-256 of schedule.csv and recipe.toml.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibkit import sealed, store
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import CoefficientError, UsageError
from calibkit.planning.equipment import Device, read_equipment
from calibkit.planning.schedule import Schedule, read_schedule
from calibkit.planning.search import COVERAGE, Design, Proposal, name_source
from calibkit.planning.task import Assumed, Task
from calibkit.recipe import Recipe, Source, toml_text
from calibkit.recipe.tables import ErrorComponent
from calibkit.version import SOFTWARE

FORMAT = "calibkit-plan/1"
PLAN, SCHEDULE, RECIPE, PAGE = "plan.json", "schedule.csv", "recipe.toml", "plan.html"
HEAD = "# Written by calibkit plan: the recipe of the plan, with the errors that it assumes.\n"
_OF_OTHER_LOGS = ("exclude", "segment", "correction", "serial")
"""Tables and keys of a recipe that belong to the logs it was written for."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that was read back."""

    document: Mapping[str, Any]
    schedule: Schedule
    source: Source
    """Its recipe."""

    @property
    def assumed(self) -> Assumed:
        """What the plan assumes; UsageError for an error of a plan of calibkit 0.2 whose unit in a
        fit the sample bench does not tell.
        """
        document, schedule = self.document, self.schedule
        set_degc = [action.set_degc for action in schedule.actions]
        range_degc = self.range_degc or (min(set_degc), max(set_degc))
        noise, unit = document["noise"]["value"], document["noise"]["unit"]
        errors = [ErrorComponent.model_validate(component) for component in document["components"]]
        if "device" in document:
            device = Device.model_validate(document["device"])
        else:
            # calibkit 0.2 stated the noise over a time of its settings, and a lag
            settings, over_s = document["settings"], 1.0
            if "noise_1s" in settings:
                noise = settings["noise_1s"]
            elif "terms" in settings:
                noise, over_s = settings["terms"]["angle_random_walk"], SECONDS_PER_HOUR
            else:
                of_dwell = settings.get("noise_g", settings.get("noise_dph"))
                if of_dwell is not None:
                    noise, over_s = of_dwell, schedule.recorded("dwell")[0].duration_s
            device = Device(
                lags_s=(settings.get("lag_s", 1.0),),
                fastest_degc_per_min=1.0,
                noise=noise,
                noise_unit=unit,
                noise_s=over_s,
            )
            bench = read_equipment(None).device.values()
            components = [error for device in bench for error in device.component]
            bench_errors = {(error.group, error.effect, error.unit) for error in components}
            for error in errors:
                if (error.group, error.effect, error.unit) not in bench_errors:
                    raise UsageError(
                        f"the plan states {name_source(error)} in {error.unit}: calibkit 0.2 wrote"
                        " it",
                        hint="plan again to simulate it",
                    )
        by_name = {(error.group, error.effect): error for error in errors}
        return Assumed(device, noise, range_degc, by_name, ())

    @property
    def range_degc(self) -> tuple[float, float] | None:
        """Range of use."""
        low, high = self.document.get("range_degc", (None, None))
        return None if low is None or high is None else (low, high)

    @property
    def wanted(self) -> dict[str, float]:
        """Result → expanded uncertainty that was wanted, in the unit of the result."""
        wishes = {result["name"]: result["wanted"] for result in self.document["results"]}
        return {name: value for name, value in wishes.items() if value is not None}


def write_recipe(spec: Recipe, design: Design, *, added: bool) -> str:
    """Text of the recipe by which the logs of a plan are fitted, with the errors that were assumed.
    Logs that are `added` stand beside those that the recipe reads already.
    """
    tables = spec.model_dump(mode="json", by_alias=True, exclude_unset=True)
    files = list(design.logs)
    if added:
        files = [*tables["logs"]["files"], *files]
    else:
        tables = {name: value for name, value in tables.items() if name not in _OF_OTHER_LOGS}
    tables["logs"] = {**tables["logs"], "files": files}
    for name, value in design.changes.items():
        tables[name] = {**tables.get(name, {}), **value} if isinstance(value, dict) else value
    # a line begins with a bracket where a table does
    return HEAD + toml_text.from_tables(tables).text.replace("\n[", "\n\n[")


def plan_document(
    proposal: Proposal,
    task: Task,
    source: Source,
    procedure: str,
    files: Mapping[str, bytes],
) -> str:
    """Sealed text of plan.json."""
    results = []
    for result in proposal.results:
        wish = proposal.wishes.get(result.name)
        results.append(
            {
                "name": result.name,
                "unit": result.unit,
                "standard_uncertainty_rms": result.u,
                "standard_uncertainty_max": result.largest_u,
                "expanded_uncertainty": result.expanded,
                "wanted": wish,
                "met": None if wish is None else result.expanded <= wish,
                "limits": [{"source": key, "share": share} for key, share in result.limits.items()],
            }
        )
    assumed, schedule = proposal.assumed, proposal.campaign.schedule
    longer = proposal.longer_campaign
    return sealed.seal(
        {
            "format": FORMAT,
            "software": SOFTWARE,
            "procedure": procedure,
            "plan": proposal.campaign.label,
            "recipe": {"name": source.name, "sha256": source.sha256},
            "equipment": task.equipment.name,
            "attitudes": task.attitudes,
            "within_h": task.within_h,
            "range_degc": list(assumed.range_degc),
            "hours": schedule.hours,
            "operator_h": schedule.operator_h,
            "coverage_factor": COVERAGE,
            "results": results,
            "coefficients": [asdict(coefficient) for coefficient in proposal.coefficients],
            "device": assumed.device.model_dump(mode="json", exclude={"component"}),
            "noise": {"value": assumed.noise, "unit": assumed.device.noise_unit},
            "components": [error.model_dump(mode="json") for error in assumed.errors.values()],
            "third_more": None if longer is None else _campaign(longer),
            "curve": [_campaign(campaign) for campaign in proposal.curve],
            "notes": list(proposal.notes),
            "files": [
                {"name": key, "sha256": hashlib.sha256(content).hexdigest()}
                for key, content in files.items()
            ],
        }
    )


def _campaign(campaign: Design) -> dict[str, Any]:
    """A campaign as JSON."""
    return {
        "name": campaign.label,
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
    document = sealed.unseal(store.read_utf8(folder / plan), str(folder / plan), FORMAT)
    names = sorted(entry["name"] for entry in document["files"])
    if names != [RECIPE, SCHEDULE]:
        raise CoefficientError(
            f"{folder / plan}: lists {', '.join(names)}, expected {RECIPE} and {SCHEDULE}",
            hint="calibkit did not write it; plan again, or restore the folder",
        )
    for entry in document["files"]:
        path = folder / entry["name"]
        if hashlib.sha256(store.read_utf8(path).encode()).hexdigest() != entry["sha256"]:
            raise CoefficientError(
                f"{path}: is not the file that belongs to {plan}",
                hint="it was changed after it was written; plan again, or restore it",
            )
    schedule = read_schedule(store.read_utf8(folder / SCHEDULE), str(folder / SCHEDULE))
    return Plan(document, schedule, Source(RECIPE, store.read_utf8(folder / RECIPE)))


def beside(recipe: Path) -> Plan | None:
    """Plan beside a recipe's file, which may have been changed since; None where there is none."""
    path, plan = recipe.with_name(SCHEDULE), recipe.with_name(PLAN)
    if not (recipe.is_file() and path.is_file() and plan.is_file()):
        return None
    document = sealed.unseal(store.read_utf8(plan), str(plan), FORMAT)
    return Plan(
        document,
        read_schedule(store.read_utf8(path), str(path)),
        Source(RECIPE, store.read_utf8(recipe)),
    )
