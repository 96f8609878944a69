"""What calibkit calibrates: one package per instrument, and the registry of their procedures."""

from __future__ import annotations

import importlib
import importlib.util
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from calibkit import recipe
from calibkit.errors import UsageError
from calibkit.libraries import plugins

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from types import ModuleType

    from calibkit.certificate.content import Layout
    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.records.coefficients import Input, StageResult
    from calibkit.records.forms import Form
    from calibkit.records.left_out import LeftOut
    from calibkit.records.sensitivities import Sensitivity
    from calibkit.report.summary import Summary
    from calibkit.simulate.campaign import Campaign

Drawing = TypeVar("Drawing")
Spec: TypeAlias = Any
"""Recipe of an instrument, an object of its own class `Recipe`."""


Progress: TypeAlias = "Callable[[Sequence[str], str], Iterable[str]]"
"""Passes items through, and may show an activity and how far one is."""


def silent(items: Sequence[str], activity: str) -> Iterable[str]:  # noqa: ARG001 (as Progress)
    """Progress that shows nothing."""
    return items


@dataclass(frozen=True, slots=True)
class Fitted(Generic[Drawing]):
    """What a fit gives: one result per stage, the logs it used, the summary, what to draw."""

    results: tuple[StageResult, ...]
    inputs: tuple[Input, ...]
    summary: Summary
    drawing: Drawing
    """What `draw` needs. `residuals()`, where it has this, gives columns of a tidy table of what
    the fit leaves; `units` in it states column → unit where a name does not.
    """
    uncertainty: tuple[Mapping[str, Any], ...] = ()
    """Combined and expanded uncertainties of results, as JSON objects."""
    lacks: tuple[str, ...] = ()
    """What the logs do not determine, and what they would have to hold."""
    exports: bool = True
    """Whether there is a correction to export, or a result to state."""
    sensitivities: tuple[Sensitivity, ...] = ()
    """How the results move where an input is off."""
    left_out: tuple[LeftOut, ...] = ()
    """Positions and stations that the fit did not use."""


Instrument: TypeAlias = "ModuleType"
"""A procedure: a module with the names in `REQUIRED`, and with those in `ROOMS` that it can do."""
REQUIRED = ("Recipe", "FORMS", "read", "faults", "fit", "validate", "correct")
"""Names that the module of every instrument has.

Recipe: strict record of its recipes; `procedure` is a `Literal` of its name.
FORMS: model forms that its coefficient files hold.
read(spec, data, file, reader = ...) → log of the data folder in canonical columns, by another
    reader where one is given.
faults(spec, log) → Examined: what is wrong with a log before anything is fitted to it, and its held
    conditions.
fit(spec, data, files, progress) → Fitted.
validate(spec, records, logs) → JSON object and summary of frozen coefficients on unseen logs, which
    are read one after the other.
correct(spec, records, data) → Applied: a compensated log; raises before the first part where it
    cannot be compensated.
"""
ROOMS = {
    "draw": "figures",
    "results": "quantities",
    "blocks": "certificate",
    "chain": "firmware",
    "files": "firmware",
    "conventions": "firmware",
    "prepare_plan": "plan",
    "simulate_plan": "plan",
    "CAMPAIGNS": "simulate",
    "propose": "propose",
    "KEY_FIGURES": "forms",
}
"""Name that an instrument may have → module of its package where it stands, unless it stands beside
`fit`. Rooms are imported when they are asked for: a fit needs no certificate.

draw(title, fitted) → Drawn: figures of a fit, and its summary in full.
results(records, spec) → quantities: results of a run as functions of their inputs.
blocks(stated) → blocks of results on a certificate; without it those that the results alone give.
chain(spec, records) → correction chain of firmware, files(spec) → coefficient files that it takes
    its numbers from, conventions(spec) → conventions of inputs and outputs, one line each.
prepare_plan(spec, task) → campaigns among which a plan chooses, and what they will tell,
    simulate_plan(spec, schedule, assumed, seed) → logs of a campaign that was run by a plan.
CAMPAIGNS: name → simulated campaign by its seed.
propose(evidence) → recipe for logs that are of this instrument; None for other logs.
KEY_FIGURES: patterns of whole names of the figures that a fleet compares from device to device.
"""
SKELETON = "bias_temperature"
"""Recipe that is proposed as a skeleton for logs that no procedure recognises."""
SHIPPED = {
    "gyro_pair": "gyro_scale.gyro_pair",
    "gyro_triad": "gyro_scale.gyro_triad",
    "rate_table": "gyro_scale.rate_table",
    "inclinometer": "inclinometer.instrument",
    "gyro_noise": "gyro_noise.instrument",
    "accelerometer": "accelerometer.instrument",
    "fog_thermal": "bias.fog_thermal",
    "thermal": "bias.thermal",
    "bias_temperature": "bias.bias_temperature",
}
"""Procedure → its module below this package; a recipe for unknown logs is sought in this order."""


class Registry(Mapping[str, Instrument]):
    """Procedure → instrument, shipped or of an installed plugin; imported when it is asked for."""

    def __init__(self) -> None:
        self._points: dict[str, EntryPoint] = {}
        self._loaded: dict[str, Instrument] = {}

    def _entry_points(self) -> dict[str, EntryPoint]:
        """Entry points of plugins, then of what is shipped: a plugin replaces none of these."""
        if not self._points:
            group = plugins.INSTRUMENTS
            self._points = dict(plugins.installed(group)) | {
                name: EntryPoint(name, f"{__name__}.{module}", group)
                for name, module in SHIPPED.items()
            }
        return self._points

    def __getitem__(self, name: str) -> Instrument:
        """Instrument of a procedure; KeyError where there is none."""
        if name not in self._loaded:
            entry = self._entry_points()[name]
            loaded = plugins.load(entry)
            missing = [required for required in REQUIRED if not hasattr(loaded, required)]
            if missing:
                raise UsageError(
                    f"'{name}' is added by {plugins.identify(entry).distribution}, whose entry"
                    f" point {entry.value} lacks {', '.join(missing)}, expected a module with"
                    f" {', '.join(REQUIRED)}",
                    hint="update or repair that package, or uninstall it",
                )
            self._loaded[name] = loaded
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._entry_points()

    def __iter__(self) -> Iterator[str]:
        points = self._entry_points()
        return iter((*SHIPPED, *(name for name in points if name not in SHIPPED)))

    def __len__(self) -> int:
        return len(self._entry_points())


REGISTRY = Registry()


def list_usable() -> dict[str, Instrument]:
    """Procedure → instrument; a warning names each plugin that cannot be used."""
    instruments_by_name = {name: REGISTRY[name] for name in SHIPPED}
    for name in plugins.usable(plugins.INSTRUMENTS):
        try:
            instruments_by_name.setdefault(name, REGISTRY[name])
        except UsageError as error:
            logging.getLogger("calibkit").warning("skipped: %s", error)
    return instruments_by_name


def find(procedure: str) -> Instrument:
    """Instrument of a procedure's name, or UsageError."""
    if procedure not in REGISTRY:
        raise UsageError(
            f"procedure '{procedure}' is not implemented", hint="see the shipped recipes"
        )
    return REGISTRY[procedure]


def optional(procedure: str, name: str) -> Any:  # noqa: ANN401 (a name of `ROOMS` is any of these)
    """What an instrument need not have, by its name in `ROOMS`; None where it has none."""
    module = find(procedure)
    if hasattr(module, name) or not module.__package__:
        return getattr(module, name, None)
    room = f"{module.__package__}.{ROOMS[name]}"
    if importlib.util.find_spec(room) is None:
        return None
    return getattr(importlib.import_module(room), name, None)


def parse_recipe(source: recipe.Source) -> recipe.Recipe:
    """Record of a recipe's text, of whichever procedure; raises RecipeError with every fault."""
    return recipe.parse(source, REGISTRY)


def fitted_recipe(document: Mapping[str, Any], *overrides: str) -> recipe.Recipe:
    """Recipe of a run by its run.json, with more overrides behind those of the fit."""
    text = document["recipe"]
    source = recipe.Source(text["name"], text["text"], (*text["overrides"], *overrides))
    return recipe.parse(source, REGISTRY)


def model_forms(procedure: str) -> dict[str, Form]:
    """Name → model form of a procedure; empty for an unknown one."""
    forms = REGISTRY[procedure].FORMS if procedure in REGISTRY else ()
    return {form.name: form for form in forms}


def campaigns() -> dict[str, Callable[[int], Campaign]]:
    """Name → simulated campaign by its seed, of every instrument."""
    return {
        name: campaign
        for procedure in list_usable()
        for name, campaign in (optional(procedure, "CAMPAIGNS") or {}).items()
    }


def certificate_layout(document: Mapping[str, Any]) -> Layout:
    """Layout and recipe of a certificate of a run, by its run.json; UsageError for an unknown
    procedure.
    """
    from calibkit.certificate.blocks import lay_out_records
    from calibkit.certificate.content import Layout

    procedure = str(document["procedure"])
    if procedure not in REGISTRY:
        raise UsageError(
            f"{document['serial']}@r{document['revision']:03d}: no certificate layout for procedure"
            f" '{procedure}'",
            hint="use a newer calibkit",
        )
    spec = fitted_recipe(document)
    results = optional(procedure, "results")

    def lay_out(basis: Stated) -> tuple[Block, ...]:
        quantities = () if results is None else results(basis.records, spec)
        return lay_out_records(basis, quantities)

    return Layout(optional(procedure, "blocks") or lay_out, spec)
