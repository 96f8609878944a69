"""Inputs of results as a person types them: `temp_case_degc=25`, `temp_case=298.15K`, and ranges
`temp_case=-40:85:5`; limits on changes, `K_x<=20 ppm`.
"""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from calibkit import units
from calibkit.arrays import Array
from calibkit.certificate.quantities import QuantityInput
from calibkit.errors import UsageError, did_you_mean

MOST_POINTS = 20_000
"""Points that one command evaluates."""
EXAMPLES = {
    False: "name=value, as temp_case_degc=25",
    True: "name=from:to:step, as temp_case=-40:85:5",
}
"""Whether an input is a range → how it is written."""
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_INPUT = re.compile(rf"\s*{_NUMBER}(?:\s*:\s*{_NUMBER}\s*:\s*{_NUMBER})?\s*(.*?)\s*")


def parse_input(
    text: str,
    inputs: Mapping[str, QuantityInput],
    gravity_mps2: float | None = None,
    *,
    ranged: bool = False,
) -> tuple[str, Array]:
    """Column and values [n] in its unit of `name=value[unit]`, or of `name=from:to:step[unit]` with
    both ends, for one of the inputs by their columns; accelerations in m/s² need local gravity.

    Raises UsageError, and RecipeError for a unit of another kind.
    """
    name, equals, number_text = text.partition("=")
    parts = _INPUT.fullmatch(number_text)
    if not equals or parts is None or ranged != bool(parts[2]):
        raise UsageError(f"'{text}' is no input", hint=f"write {EXAMPLES[ranged]}")
    name = name.strip()
    # a column may be named without its unit
    matching_inputs = [
        quantity_input
        for column, quantity_input in inputs.items()
        if name in (column, column.removesuffix("_min").rpartition("_")[0])
    ]
    if len(matching_inputs) != 1:
        input_names = ", ".join(inputs) or "none: its results depend on nothing"
        raise UsageError(
            f"'{name}' is no input of this run",
            hint=did_you_mean(name, [*inputs], f"its inputs: {input_names}"),
        )
    column, unit = matching_inputs[0].column, matching_inputs[0].unit
    values = np.array([float(parts[1])])
    if ranged:
        low, high, step = map(float, parts.group(1, 2, 3))
        steps = (high - low) / step if step else math.inf
        if not 0.0 <= steps < math.inf:
            raise UsageError(
                f"--range {text}: a step of {step:g} never leads from {low:g} to {high:g}",
                hint="give a step towards the end",
            )
        count = math.floor(steps + 1e-9) + 1
        if count > MOST_POINTS:
            raise UsageError(
                f"--range {text}: {count} points, at most {MOST_POINTS}",
                hint="take a larger step",
            )
        # the same decimals as typed: 0.1 steps have no tails of binary rounding
        digits = [
            15 if "e" in number.lower() else len(number.partition(".")[2])
            for number in parts.group(1, 2, 3)
        ]
        values = np.round(low + step * np.arange(count), max(digits))
    typed_unit = parts[4].strip("[]() ")
    if typed_unit not in ("", unit):
        if column.startswith("gradient") or unit not in units.TABLE:
            values = values * units.difference_factor(typed_unit, unit)
        else:
            values = units.convert(values, typed_unit, unit, gravity_mps2=gravity_mps2)
    if not np.isfinite(values).all():
        raise UsageError(f"'{text}': too large for a number", hint="give a finite value")
    return column, values


def parse_inputs(
    inputs: Mapping[str, QuantityInput],
    gravity_mps2: float | None,
    values: Sequence[str],
    ranges: Sequence[str],
) -> tuple[list[dict[str, float]], dict[str, Array]]:
    """Points of all combinations of inputs of a command line, the last range fastest, and the
    ranges; UsageError for an input that is given twice, and for too many points.
    """
    parsed = [parse_input(text, inputs, gravity_mps2) for text in values]
    parsed_ranges = [parse_input(text, inputs, gravity_mps2, ranged=True) for text in ranges]
    columns = [column for column, _ in (*parsed, *parsed_ranges)]
    for column in columns:
        if columns.count(column) > 1:
            raise UsageError(f"{column} is given twice", hint="give each input once")
    count = math.prod(x.size for _, x in parsed_ranges)
    if count > MOST_POINTS:
        raise UsageError(f"{count} points, at most {MOST_POINTS}", hint="take larger steps")
    points: list[dict[str, float]] = [{}]
    for column, grid in (*parsed, *parsed_ranges):
        points = [{**point, column: x} for point in points for x in grid.tolist()]
    return points, dict(parsed_ranges)


def parse_limits(texts: Sequence[str]) -> dict[str, tuple[float, str]]:
    """Result → largest change and its unit, of texts `name<=value unit`; UsageError."""
    limits: dict[str, tuple[float, str]] = {}
    for text in texts:
        name, value, unit = units.parse_limit(text, "--limit")
        if name in limits:
            raise UsageError(f"--limit: two limits on {name}", hint="state one")
        limits[name] = value, unit
    return limits
