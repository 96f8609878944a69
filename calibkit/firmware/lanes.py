"""One call of a firmware while it runs, and what it keeps from call to call.

Every value is an array over lanes, so that one call runs many instants of a chain without memory,
or many devices.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Words: TypeAlias = NDArray[Any]
"""Floats of the program's format."""


@dataclass(frozen=True, slots=True)
class State:
    """What a chain keeps from update to update."""

    values: Mapping[str, Words]
    histories: Mapping[str, Words]
    """Last values of each slope's source, the newest first."""
    updates: Words
    last_outputs: Mapping[str, Words]
    """Last outputs, which an invalid input leaves as they were."""
    before: Mapping[str, Words]
    """Outputs of the update before."""
    inputs: Mapping[str, Words]
    """Last inputs that were used."""
    waited_ms: Words
    """Since the last used inputs, and half an interval."""


@dataclass(slots=True)
class Call:
    """Values by name, status, and the status of each side of a selection."""

    tables: Mapping[str, tuple[float, ...]]
    number: Any
    """Type of a number in numpy."""
    bits: Mapping[str, int]
    """Bit of each status."""
    state: State | None
    status: Words
    values: dict[str, Words] = field(default_factory=dict)
    sides: dict[str, Words] = field(default_factory=dict)
    histories: dict[str, Words] = field(default_factory=dict)

    @property
    def before(self) -> State:
        """What a chain with memory kept."""
        assert self.state is not None  # noqa: S101 (it is called with its state)
        return self.state

    def numbers(self, table: str) -> list[Any]:
        """Numbers of a table in the type of the lanes."""
        return [self.number(x) for x in self.tables[table]]

    def flag(self, name: str, lanes: Words, group: str = "") -> None:
        """Raise a status on some lanes, of one side where a group is named."""
        if not name:
            return
        raised = np.where(lanes, self.bits[name], 0)
        if group:
            self.sides[group] = self.sides.get(group, np.zeros_like(self.status)) | raised
        else:
            self.status = self.status | raised

    def limited(self, x: Words, low: Any, high: Any, flag: str = "", group: str = "") -> Words:  # noqa: ANN401 (words or numbers)
        """Bring a value into a range; raises the flag where it was outside."""
        self.flag(flag, (x < low) | (x > high), group)
        # as the C code compares: a value that is no number stays one
        return np.where(x < low, low, np.where(x > high, high, x))
