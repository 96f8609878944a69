"""What calibkit calibrates: one package per instrument, and the registry of their procedures."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from calibkit import plugins, recipe
from calibkit.errors import UsageError
from calibkit.recipe import Recipe

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from calibkit.certificate.content import Layout
    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Input, Record, StageResult
    from calibkit.firmware.chain import Chain
    from calibkit.firmware.program import Program
    from calibkit.forms import Form
    from calibkit.frame import Examined, Log
    from calibkit.ingest.evidence import Evidence
    from calibkit.ingest.logs import Reader
    from calibkit.ingest.recipe_text import Choice
    from calibkit.ingest.write_back import Applied
    from calibkit.left_out import LeftOut
    from calibkit.planning.proposal import Planner
    from calibkit.report.documents import Drawn
    from calibkit.report.summary import Summary
    from calibkit.sensitivities import Sensitivity
    from calibkit.simulate.campaign import Campaign

Spec = TypeVar("Spec", bound=Recipe)
SpecIn_contra = TypeVar("SpecIn_contra", bound=Recipe, contravariant=True)
Drawing = TypeVar("Drawing")


class Progress(Protocol):
    """Passes items through and may show how far one is."""

    def __call__(self, items: Sequence[str], what: str) -> Iterable[str]:
        """Yield the items."""
        ...


def silent(items: Sequence[str], what: str) -> Iterable[str]:  # noqa: ARG001 (as Progress)
    """Progress that shows nothing."""
    return items


class Read(Protocol[SpecIn_contra]):
    """Reads one log in canonical columns, by another reader where one is given."""

    def __call__(self, spec: SpecIn_contra, data: Path, file: str, reader: Reader = ...) -> Log:
        """Read one log of the data folder."""
        ...


@dataclass(frozen=True, slots=True)
class Fitted(Generic[Drawing]):
    """What a fit gives: one result per stage, the logs it used, the summary, what to draw."""

    results: tuple[StageResult, ...]
    inputs: tuple[Input, ...]
    summary: Summary
    drawing: Drawing
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


def _draw_tables(_: str, fitted: Fitted[Any]) -> Drawn:
    """Report without figures."""
    from calibkit.report.documents import Drawn

    return Drawn((), fitted.summary)


@dataclass(frozen=True, slots=True)
class Firmware(Generic[Spec]):
    """How a run of an instrument becomes firmware."""

    files: Callable[[Spec], tuple[str, ...]]
    """Coefficient files that the chain takes its numbers from."""
    chain: Callable[[Spec, Mapping[str, Record]], Chain]
    """Correction chain of a run's files; raises OutputError where there is none."""
    apply: Callable[[Spec, Chain, Program, Path], Applied]
    """Correct a log as the exported firmware would."""
    conventions: Callable[[Spec], tuple[str, ...]] = lambda _: ()
    """Conventions of inputs and outputs, one line each."""


@dataclass(frozen=True, slots=True)
class Instrument(Generic[Spec, Drawing]):
    """One procedure: everything that a command may ask of it."""

    recipe: type[Spec]
    read: Read[Spec]
    examine: Callable[[Spec, Log], Examined]
    """Find what is wrong with a log before anything is fitted to it, and its held conditions."""
    fit: Callable[[Spec, Path, Sequence[str], Progress], Fitted[Drawing]]
    """Fit the logs of a data folder."""
    validate: Callable[[Spec, Mapping[str, Record], Iterable[Log]], tuple[dict[str, Any], Summary]]
    """Test frozen coefficients on unseen logs, which are read one after the other."""
    apply: Callable[[Spec, Mapping[str, Record], Path], Applied]
    """Compensate a log; raises before the first part where it cannot be compensated."""
    draw: Callable[[str, Fitted[Drawing]], Drawn] = _draw_tables
    """Figures of a fit under a title, and its summary in full."""
    residuals: Callable[[Drawing], Mapping[str, Any]] = lambda _: {}
    """Columns of a tidy table of what a fit leaves, none where it has no residuals; `units` states
    column → unit where a name does not.
    """
    certificate: Callable[[Stated], tuple[Block, ...]] | None = None
    """Blocks of results on a certificate; None where there is none."""
    quantities: Callable[[Mapping[str, Record], Spec], tuple[Quantity, ...]] = lambda _, __: ()
    """Results of a run as functions of their inputs, for `evaluate`, `compare` and `history`."""
    forms: Callable[[], tuple[Form, ...]] = tuple
    """Model forms that its coefficient files hold."""
    firmware: Callable[[], Firmware[Spec]] | None = None
    """None where there is nothing that firmware could correct."""
    key_figures: tuple[str, ...] = (".+",)
    """Patterns of whole names of the figures that a fleet compares from device to device."""
    campaigns: Mapping[str, Callable[[int], Campaign]] = field(default_factory=dict)
    """Name → simulated campaign by its seed."""
    propose: Callable[[Evidence], Choice | None] = lambda _: None
    """Recipe for logs that are of this instrument; None for other logs."""
    planner: Callable[[], Planner] | None = None
    """How its campaigns are planned; None where they are not."""


SKELETON = "bias_temperature"
"""Recipe that is proposed as a skeleton for logs that no procedure recognises."""
SHIPPED = {
    "gyro_pair": "gyro_scale.instrument:PAIR",
    "gyro_triad": "gyro_scale.instrument:TRIAD",
    "rate_table": "gyro_scale.instrument:RATE_TABLE",
    "inclinometer": "inclinometer.instrument:INSTRUMENT",
    "gyro_noise": "gyro_noise.instrument:INSTRUMENT",
    "accelerometer": "accelerometer.instrument:INSTRUMENT",
    "fog_thermal": "fog_thermal.instrument:INSTRUMENT",
    "thermal": "thermal.instrument:INSTRUMENT",
    "bias_temperature": "bias_temperature.instrument:INSTRUMENT",
}
"""Procedure → module below this package and its record there; a recipe for unknown logs is sought
in this order.
"""


class Registry(Mapping[str, "Instrument[Any, Any]"]):
    """Procedure → instrument, shipped or of an installed plugin; imported when it is asked for."""

    def __init__(self) -> None:
        self._points: dict[str, EntryPoint] = {}
        self._loaded: dict[str, Instrument[Any, Any]] = {}

    def _entry_points(self) -> dict[str, EntryPoint]:
        """Entry points of plugins, then of what is shipped: a plugin replaces none of these."""
        if not self._points:
            group = plugins.INSTRUMENTS
            self._points = dict(plugins.installed(group)) | {
                name: EntryPoint(name, f"{__name__}.{record}", group)
                for name, record in SHIPPED.items()
            }
        return self._points

    def __getitem__(self, name: str) -> Instrument[Any, Any]:
        """Instrument of a procedure; KeyError where there is none."""
        if name not in self._loaded:
            entry = self._entry_points()[name]
            loaded = plugins.load(entry)
            if not isinstance(loaded, Instrument):
                raise UsageError(
                    f"'{name}' is added by {plugins.identify(entry).distribution}, whose entry"
                    f" point {entry.value} is {type(loaded).__name__}, expected an Instrument",
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


def list_usable() -> dict[str, Instrument[Any, Any]]:
    """Procedure → instrument; a warning names each plugin that cannot be used."""
    found = {name: REGISTRY[name] for name in SHIPPED}
    for name in plugins.usable(plugins.INSTRUMENTS):
        try:
            found.setdefault(name, REGISTRY[name])
        except UsageError as error:
            logging.getLogger("calibkit").warning("skipped: %s", error)
    return found


def find(procedure: str) -> Instrument[Any, Any]:
    """Instrument of a procedure's name, or UsageError."""
    if procedure not in REGISTRY:
        raise UsageError(
            f"procedure '{procedure}' is not implemented", hint="see the shipped recipes"
        )
    return REGISTRY[procedure]


def parse_recipe(source: recipe.Source) -> Recipe:
    """Record of a recipe's text, of whichever procedure; raises RecipeError with every fault."""
    return recipe.parse(source, REGISTRY)


def fitted_recipe(document: Mapping[str, Any], *overrides: str) -> Recipe:
    """Recipe of a run by its run.json, with more overrides behind those of the fit."""
    text = document["recipe"]
    source = recipe.Source(text["name"], text["text"], (*text["overrides"], *overrides))
    return recipe.parse(source, REGISTRY)


def model_forms(procedure: str) -> dict[str, Form]:
    """Name → model form of a procedure; empty for an unknown one."""
    found = REGISTRY[procedure].forms() if procedure in REGISTRY else ()
    return {form.name: form for form in found}


def campaigns() -> dict[str, Callable[[int], Campaign]]:
    """Name → simulated campaign by its seed, of every instrument."""
    return {
        name: campaign
        for instrument in list_usable().values()
        for name, campaign in instrument.campaigns.items()
    }


def certificate_layout(document: Mapping[str, Any]) -> Layout:
    """Layout and recipe of a certificate of a run, by its run.json; UsageError for an unknown
    procedure.
    """
    from calibkit.certificate.content import Layout

    procedure = str(document["procedure"])
    layout = REGISTRY[procedure].certificate if procedure in REGISTRY else None
    if layout is None:
        raise UsageError(
            f"{document['serial']}@r{document['revision']:03d}: no certificate layout for procedure"
            f" '{procedure}'",
            hint="use a newer calibkit",
        )
    return Layout(layout, fitted_recipe(document))
