"""The procedures that calibkit knows: one module each, with the six functions that a command can
ask of it.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

from calibkit.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.coefficients import Input, Record, StageResult
    from calibkit.frame import Examined, Log
    from calibkit.ingest.logs import Reader
    from calibkit.recipe import Recipe
    from calibkit.report.documents import Drawn
    from calibkit.report.summary import Summary


class Progress(Protocol):
    """Passes items through and may show how far one is."""

    def __call__(self, items: Sequence[str], what: str) -> Iterable[str]:
        """Yield the items."""
        ...


def silent(items: Sequence[str], what: str) -> Iterable[str]:  # noqa: ARG001 (the protocol's shape)
    """Progress that shows nothing."""
    return items


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a procedure's fit gives: a result a stage, the logs it used, what to tell, and what to
    draw.
    """

    results: tuple[StageResult, ...]
    inputs: tuple[Input, ...]
    summary: Summary
    drawing: object
    uncertainty: tuple[Mapping[str, Any], ...] = ()
    """Combined and expanded uncertainties of results, as JSON objects."""


Applied: TypeAlias = "tuple[Iterable[bytes], tuple[str, ...]]"
"""A compensated log: the new file's bytes, part by part, and the flags."""


# Each procedure reads its own kind of recipe, which the loader has checked: hence Any.
# ruff: noqa: ANN401


class Procedure(Protocol):
    """What every procedure can do."""

    def fit(self, spec: Any, data: Path, files: Sequence[str], progress: Progress) -> Fitted:
        """Fit the logs."""

    def read(self, spec: Any, data: Path, file: str, reader: Reader = ...) -> Log:
        """Read one log in canonical columns."""

    def examine(self, spec: Any, log: Log) -> Examined:
        """Find what is wrong with a log, and its held conditions."""

    def apply(self, spec: Any, records: Mapping[str, Record], data: Path) -> Applied:
        """Compensate a log: the new file's bytes and the flags; raises before the first part where
        it cannot be.
        """

    def validate(
        self, spec: Any, records: Mapping[str, Record], logs: Iterable[Log]
    ) -> tuple[dict[str, Any], Summary]:
        """Hold frozen coefficients against unseen logs, which are read one after the other."""

    def draw(self, title: str, fitted: Fitted) -> Drawn:
        """Draw a fit: its figures under a title, and its summary in full."""


MODULES = {
    "accelerometer": "accelerometer.instrument",
    "bias_temperature": "bias_temperature.instrument",
    "fog_thermal": "fog_thermal.instrument",
    "gyro_noise": "gyro_noise.instrument",
    "gyro_pair": "gyro_scale.pair",
    "gyro_triad": "gyro_scale.triad",
    "inclinometer": "inclinometer.instrument",
    "rate_table": "gyro_scale.rate_table",
}
NAMES = tuple(MODULES)


def of(spec: Recipe) -> Procedure:
    """Procedure that a recipe names; each is imported only when it is asked for."""
    if spec.procedure not in NAMES:
        raise UsageError(
            f"procedure '{spec.procedure}' is not implemented", hint="see the shipped recipes"
        )
    return cast(
        "Procedure", importlib.import_module(f"calibkit.instruments.{MODULES[spec.procedure]}")
    )
