"""plan.json and the files beside it: written together, read back only as they were written.

plan.json is sealed, and holds the SHA-256 of schedule.csv and recipe.toml.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibkit.errors import CoefficientError, UsageError
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.planning.bench import COVERAGE, Design, name_errors
from calibkit.planning.equipment import Device, read_equipment
from calibkit.planning.schedule import Schedule, read_schedule
from calibkit.planning.search import Proposal
from calibkit.recipe import Recipe, Source, toml_text
from calibkit.recipe.tables import ErrorComponent
from calibkit.records import sealed, store
from calibkit.records.version import SOFTWARE

FORMAT = "calibkit-plan/1"
PLAN, SCHEDULE, RECIPE, PAGE = "plan.json", "schedule.csv", "recipe.toml", "plan.html"


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that was read back."""

    document: Mapping[str, Any]
    schedule: Schedule
    source: Source
    """Its recipe."""

    @property
    def device(self) -> Device:
        """The device as the plan assumes it. A plan of calibkit 0.2 states none, but its noise over
        a time and its lag, and errors in the units of its equipment file: UsageError for one whose
        unit in a fit the sample bench does not tell.
        """
        document, procedure = self.document, self.document["procedure"]
        errors = [ErrorComponent.model_validate(component) for component in document["components"]]
        noise = document["noise"]["value"]
        if "device" in document:
            stated = {"noise": noise, "component": tuple(errors)}
            return Device.model_validate(document["device"]).model_copy(update=stated)
        devices, settings = read_equipment(None).device, document["settings"]
        dwells = self.schedule.recorded("dwell")
        # noise by the name that the settings give it, and the time that it is the mean of [s]
        noises = {
            "noise_1s": (settings.get("noise_1s"), 1.0),
            "terms": (settings.get("terms", {}).get("angle_random_walk"), SECONDS_PER_HOUR),
            "noise_g": (settings.get("noise_g"), dwells[0].duration_s if dwells else 1.0),
            "noise_dph": (settings.get("noise_dph"), dwells[0].duration_s if dwells else 1.0),
        }
        noise, noise_s = next((noises[key] for key in noises if key in settings), (noise, 1.0))
        known = [error for device in devices.values() for error in device.component]
        units = {(error.group, error.effect): error.unit for error in known}
        component, lag_s = name_errors(errors, units, procedure), settings.get("lag_s")
        lags_s = devices[procedure].lags_s if lag_s is None else [lag_s]
        stated = {"noise": noise, "noise_s": noise_s, "lags_s": lags_s, "component": component}
        return devices[procedure].model_copy(update=stated)

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
        # what belongs to the logs that the recipe was written for
        for name in ("exclude", "segment", "correction", "serial"):
            tables.pop(name, None)
    tables["logs"] = {**tables["logs"], "files": files}
    for name, value in design.changes.items():
        tables[name] = {**tables.get(name, {}), **value} if isinstance(value, dict) else value
    head = "# Written by calibkit plan: the recipe of the plan, with the errors that it assumes.\n"
    # a line begins with a bracket where a table does
    return head + toml_text.from_tables(tables).text.replace("\n[", "\n\n[")


def plan_document(
    proposal: Proposal,
    source: Source,
    procedure: str,
    files: Mapping[str, bytes],
) -> str:
    """Sealed text of plan.json."""
    results = []
    for result in proposal.campaign.results.values():
        wish = proposal.wishes.get(result.name)
        results.append(
            {
                "name": result.name,
                "unit": result.unit,
                "standard_uncertainty_rms": result.u,
                "standard_uncertainty_max": result.expanded / COVERAGE,
                "expanded_uncertainty": result.expanded,
                "wanted": wish,
                "met": None if wish is None else result.expanded <= wish,
                "limits": [{"source": key, "share": share} for key, share in result.limits.items()],
            }
        )
    bench, schedule = proposal.bench, proposal.campaign.schedule
    return sealed.seal(
        {
            "format": FORMAT,
            "software": SOFTWARE,
            "procedure": procedure,
            "plan": proposal.campaign.label,
            "recipe": {"name": source.name, "sha256": source.sha256},
            "equipment": bench.task.equipment.name,
            "attitudes": bench.task.attitudes,
            "within_h": bench.task.within_h,
            "range_degc": list(bench.range_degc),
            "hours": schedule.hours,
            "operator_h": schedule.operator_h,
            "coverage_factor": COVERAGE,
            "results": results,
            "coefficients": [asdict(coefficient) for coefficient in proposal.coefficients],
            "device": bench.device.model_dump(mode="json", exclude={"component"}),
            "noise": {"value": bench.device.noise, "unit": bench.device.noise_unit},
            "components": [error.model_dump(mode="json") for error in bench.device.component],
            "third_more": proposal.longer and _campaign(proposal.longer),
            "curve": [_campaign(campaign) for campaign in proposal.curve],
            "notes": list(proposal.notes),
            "files": store.list_files(files),
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
    return _read(folder / plan, folder / RECIPE)


def beside(recipe: Path) -> Plan | None:
    """Plan beside a recipe's file, which may have been changed since; None where there is none."""
    files = recipe, recipe.with_name(SCHEDULE), recipe.with_name(PLAN)
    return _read(files[-1], recipe) if all(path.is_file() for path in files) else None


def _read(plan: Path, recipe: Path) -> Plan:
    """Plan of a sealed document, of the schedule beside it, and of its recipe."""
    document = sealed.unseal(store.read_utf8(plan), str(plan), FORMAT)
    path = plan.with_name(SCHEDULE)
    schedule = read_schedule(store.read_utf8(path), str(path))
    return Plan(document, schedule, Source(RECIPE, store.read_utf8(recipe)))
