"""Inputs of results as a person types them: `temp_case_degc=25`, `temp_case=298.15K`, and ranges
`temp_case=-40:85:5`.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit import units
from calibkit.arrays import Array
from calibkit.certificate.quantities import Quantity, QuantityInput
from calibkit.errors import UsageError, did_you_mean

MOST_POINTS = 20_000
"""Points that one command evaluates."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_VALUE = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*")
_RANGE = re.compile(rf"\s*({_NUMBER})\s*:\s*({_NUMBER})\s*:\s*({_NUMBER})\s*(.*?)\s*")


@dataclass(frozen=True, slots=True)
class Names:
    """Inputs of the results of a run by their columns, and local gravity [m/s²] where it is known,
    for accelerations in m/s².
    """

    inputs: Mapping[str, QuantityInput]
    gravity_mps2: float | None

    @classmethod
    def of(cls, quantities: Iterable[Quantity], gravity_mps2: float | None) -> "Names":
        """Inputs of all results."""
        found = {
            column_input.column: column_input
            for quantity in quantities
            for column_input in quantity.inputs
        }
        return cls(found, gravity_mps2)

    def parse_value(self, text: str) -> tuple[str, float]:
        """Column and value of `name=value[unit]`; raises UsageError."""
        found, parts = self._parse(text, _VALUE, "name=value, as temp_case_degc=25")
        number, unit = parts
        value = float(self._convert(found, np.array([float(number)]), unit)[0])
        if not math.isfinite(value):
            raise UsageError(f"'{text}': too large for a number", hint="give a finite value")
        return found.column, value

    def parse_range(self, text: str) -> tuple[str, Array]:
        """Column and values of `name=from:to:step[unit]`, both ends included; raises UsageError."""
        found, parts = self._parse(text, _RANGE, "name=from:to:step, as temp_case_degc=-40:85:5")
        low, high, step = map(float, parts[:3])
        if step == 0.0 or (high - low) / step < 0.0 or not math.isfinite((high - low) / step):
            raise UsageError(
                f"--range {text}: a step of {step:g} never leads from {low:g} to {high:g}",
                hint="give a step towards the end",
            )
        count = math.floor((high - low) / step + 1e-9) + 1
        if count > MOST_POINTS:
            raise UsageError(
                f"--range {text}: {count} points, at most {MOST_POINTS}", hint="take a larger step"
            )
        # the same decimals as typed: 0.1 steps have no tails of binary rounding
        places = max(
            15 if "e" in part.lower() else len(part.partition(".")[2]) for part in parts[:3]
        )
        return found.column, self._convert(
            found, np.round(low + step * np.arange(count), places), parts[3]
        )

    def _parse(
        self, text: str, pattern: re.Pattern[str], expected: str
    ) -> tuple[QuantityInput, tuple[str, ...]]:
        """Input and parts of a text."""
        name, equals, rest = text.partition("=")
        parts = pattern.fullmatch(rest)
        if not equals or parts is None:
            raise UsageError(f"'{text}' is no input", hint=f"write {expected}")
        # a column may be named without its unit
        found = [
            column_input
            for column_input in self.inputs.values()
            if name.strip()
            in (column_input.column, column_input.column.removesuffix("_min").rpartition("_")[0])
        ]
        if len(found) != 1:
            listed = ", ".join(self.inputs) or "none: its results depend on nothing"
            raise UsageError(
                f"'{name.strip()}' is no input of this run",
                hint=did_you_mean(name.strip(), [*self.inputs], f"its inputs: {listed}"),
            )
        return found[0], parts.groups()

    def _convert(self, column_input: QuantityInput, values: Array, unit: str) -> Array:
        """Values in the unit of a column; raises RecipeError for one of another kind."""
        spelled = unit.strip("[]() ")
        if not spelled or spelled == column_input.unit:
            return values
        if column_input.column.startswith("gradient") or column_input.unit not in units.TABLE:
            return values * units.difference_factor(spelled, column_input.unit)
        return units.convert(values, spelled, column_input.unit, gravity_mps2=self.gravity_mps2)


def grid(fixed: Mapping[str, float], ranges: Mapping[str, Array]) -> list[dict[str, float]]:
    """Points of all combinations of ranges, the last range fastest; UsageError for too many."""
    count = math.prod(values.size for values in ranges.values())
    if count > MOST_POINTS:
        raise UsageError(f"{count} points, at most {MOST_POINTS}", hint="take larger steps")
    points = [dict(fixed)]
    for column, values in ranges.items():
        points = [{**point, column: float(x)} for point in points for x in values]
    return points


def parse_inputs(
    names: Names, values: Sequence[str], ranges: Sequence[str]
) -> tuple[dict[str, float], dict[str, Array]]:
    """Fixed inputs and ranges of a command line; UsageError for one that is given twice."""
    fixed = [names.parse_value(text) for text in values]
    range_values = [names.parse_range(text) for text in ranges]
    columns = [column for column, _ in (*fixed, *range_values)]
    repeated = next((column for column in columns if columns.count(column) > 1), None)
    if repeated is not None:
        raise UsageError(f"{repeated} is given twice", hint="give each input once")
    return dict(fixed), dict(range_values)


def parse_limits(texts: Sequence[str]) -> dict[str, tuple[float, str]]:
    """Result → largest change and its unit, of texts `name<=value unit`; UsageError."""
    stated: dict[str, tuple[float, str]] = {}
    for text in texts:
        name, value, unit = units.parse_limit(text, "--limit")
        if name in stated:
            raise UsageError(f"--limit: two limits on {name}", hint="state one")
        stated[name] = value, unit
    return stated
