"""Results of a run at points that a person types: value ± U, and why the model does not hold where
it does not.

Inputs are typed as `temp_case_degc=25` or `temp_case=298.15K`, ranges as `temp_case=-40:85:5`.

Value and U are those of the certificate (`certificate.quantities.state`): u² = Σ (c_i u_i)² over
coefficients, model error and type B terms (JCGM 100 eq. 10). Outside the calibrated ranges the
model is extrapolated, and no U is stated.
"""

import fnmatch
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from calibkit import instruments, units
from calibkit.certificate.quantities import At, Quantity, QuantityInput, state
from calibkit.certificate.results import Result, print_expanded, round_descriptor
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.errors import UsageError, did_you_mean
from calibkit.numeric.arrays import Array
from calibkit.recipe import TypeB, type_b
from calibkit.records import sensitivities
from calibkit.records.store import StoredRun
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table
from calibkit.units import unit_mark

SETTLED = "rates are held until the lags of the model have settled"
EXTRAPOLATED = "extrapolated, U is not known"
MOST_POINTS = 20_000
"""Points that one command evaluates."""
EXAMPLES = {
    False: "name=value, as temp_case_degc=25",
    True: "name=from:to:step, as temp_case=-40:85:5",
}
"""Whether an input is a range → how it is written."""
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_INPUT = re.compile(rf"\s*{_NUMBER}(?:\s*:\s*{_NUMBER}\s*:\s*{_NUMBER})?\s*(.*?)\s*")


@dataclass(frozen=True, slots=True)
class RunResults:
    """A run with its results as functions of their inputs."""

    run: StoredRun
    quantities: tuple[Quantity, ...]
    basis: Stated
    gravity_mps2: float | None

    @classmethod
    def read(cls, run: StoredRun, terms: Sequence[TypeB] = ()) -> Self:
        """Results of a run, with type B terms on top of the recipe's."""
        spec = instruments.fitted_recipe(run.document)
        results = instruments.optional(spec.procedure, "results")
        quantities = () if results is None else results(run.records, spec)
        source = TypeBTerms.merge(type_b.loads(run.document.get("type_b", ())), terms)
        known_sensitivities = sensitivities.loads(run.document.get("sensitivities", []), run.name)
        basis = Stated(run.records, source, (), spec.reference_temp_degc, known_sensitivities)
        return cls(run, quantities, basis, spec.site.local_gravity())

    def require_any(self) -> None:
        """Raise UsageError for a run that exports nothing that could be evaluated."""
        if not self.quantities:
            raise UsageError(
                f"{self.run.name}: no model was exported that could be evaluated",
                hint="see `calibkit show`; of a plugin's model, calibkit.evaluate in Python",
            )

    @property
    def inputs(self) -> dict[str, QuantityInput]:
        """Column → input that any of the results has."""
        return {i.column: i for quantity in self.quantities for i in quantity.inputs}

    def state(self, quantity: Quantity, point: At) -> Result:
        """Result of one of the quantities at a point."""
        return state(self.basis, quantity, point)


@dataclass(frozen=True, slots=True)
class PointResult:
    """A result at a point; `outside` states why the model does not hold there, else it is empty."""

    quantity: Quantity
    point: At
    result: Result
    outside: str

    @property
    def expanded(self) -> float | None:
        """Expanded uncertainty; None where it is not known."""
        uncertainty = None if self.outside else self.result.uncertainty
        return None if uncertainty is None else uncertainty.expanded_uncertainty


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


def choose(
    run_results: RunResults, columns_given: Iterable[str], only: str
) -> tuple[Quantity, ...]:
    """Results that a pattern names, or that depend on what is given; UsageError where none does,
    or one lacks an input.
    """
    columns, name = set(columns_given), run_results.run.name
    matching = [
        quantity
        for quantity in run_results.quantities
        if not only or fnmatch.fnmatchcase(quantity.key, only) or quantity.name == only
    ]
    if not matching:
        keys = ", ".join(quantity.key for quantity in run_results.quantities)
        raise UsageError(f"--only {only}: no result of {name}", hint=f"there are: {keys}")
    selected, calls = [], []
    for quantity in matching:
        required = {i.column for i in quantity.inputs if i.rest is None}
        if required <= columns <= {i.column for i in quantity.inputs}:
            selected.append(quantity)
        # inputs that need not be given have brackets
        inputs = [i.column if i.rest is None else f"[{i.column}]" for i in quantity.inputs]
        calls.append(f"{quantity.key}({', '.join(inputs)})")
    if not selected:
        raise UsageError(
            f"{', '.join(sorted(columns)) or 'no input'}: no result of {name} depends on"
            f" {'these and no others' if len(columns) > 1 else 'this alone'}",
            hint=f"its results and their inputs: {'; '.join(dict.fromkeys(calls[:12]))}",
        )
    return tuple(selected)


def evaluate(
    run_results: RunResults, quantities: Sequence[Quantity], points: Sequence[At]
) -> Iterator[PointResult]:
    """Every result at every point, result by result."""
    for quantity in quantities:
        for point in points:
            full_point = quantity.complete(point)
            result = run_results.state(quantity, full_point)
            yield PointResult(quantity, full_point, result, quantity.outside(full_point))


def answer(
    run_results: RunResults, inputs: Sequence[str], ranges: Sequence[str], only: str
) -> tuple[list[PointResult], dict[str, Array]]:
    """Values that a command line asks for, at all combinations of its inputs, the last range
    fastest, and its ranges; UsageError for an input that is given twice, and for too many points.
    """
    of_run = run_results.inputs, run_results.gravity_mps2
    parsed = [parse_input(text, *of_run) for text in inputs]
    parsed_ranges = [parse_input(text, *of_run, ranged=True) for text in ranges]
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
    selected = choose(run_results, points[0], only)
    return list(evaluate(run_results, selected, points)), dict(parsed_ranges)


def state_expanded(value: float, U: float | None, unit: str, digits: int = 6) -> str:
    """A value ± U with its unit: to two digits of U, or to so many of a value without one."""
    text = " ± ".join(print_expanded(value, U)) if U else f"{value:.{digits}g}"
    return f"{text} {unit_mark(unit)}".strip()


def list_results(run_results: RunResults) -> Table:
    """Results of a run, their units, and their inputs with the ranges in which the model holds."""
    rows = []
    for quantity in run_results.quantities:
        described = []
        for quantity_input in quantity.inputs:
            # one that need not be given has brackets
            column, low, high = quantity_input.column, quantity_input.low, quantity_input.high
            name = column if quantity_input.rest is None else f"[{column}]"
            span = f"{low:.4g}" if low == high else f"{low:.4g} … {high:.4g}"
            described.append(f"{name} {span} {unit_mark(quantity_input.unit)}")
        rows.append((quantity.key, unit_mark(quantity.unit), ", ".join(described)))
    inputs = Column("inputs and where they hold", key="inputs")
    return Table("", (Column("result", key="quantity"), "unit", inputs), tuple(rows))


def tabulate(values: Sequence[PointResult]) -> Table:
    """Values as people read them: a row for each, with the inputs that any of them has."""
    columns = dict.fromkeys(i.column for value in values for i in value.quantity.inputs)
    flagged = any(value.outside for value in values)
    rows = []
    for value in values:
        # two digits of U, or six of a value without one
        y, U = value.result.value, value.expanded
        value_cells = f"{y:.6g}", "-"
        if U is not None and U > 0.0:
            value_cells = print_expanded(y, U)
        elif y and not value.outside:
            descriptor = round_descriptor(y)
            value_cells = value_cells if descriptor.exponent else (descriptor.value, "-")
        inputs = ("" if name not in value.point else f"{value.point[name]:.9g}" for name in columns)
        unit = unit_mark(value.quantity.unit)
        status = ("outside" if value.outside else "",) * flagged
        rows.append((*inputs, value.quantity.key, *value_cells, unit, *status))
    heads = (*columns, "result", "value", "U", "unit", *(("",) * flagged))
    return Table("", heads, tuple(rows))


def list_values(values: Sequence[PointResult]) -> Table:
    """Values with every digit, for CSV and JSON; one row each."""
    columns = dict.fromkeys(i.column for value in values for i in value.quantity.inputs)
    rows = []
    for value in values:
        uncertainty = None if value.outside else value.result.uncertainty
        rows.append(
            (
                *(value.point.get(name) for name in columns),
                value.quantity.key,
                value.result.value,
                value.quantity.unit,
                None if uncertainty is None else uncertainty.standard_uncertainty,
                value.expanded,
                None if uncertainty is None else uncertainty.coverage_factor,
                f"{value.outside}: {EXTRAPOLATED}" if value.outside else "",
            )
        )
    heads = ("standard_uncertainty", "expanded_uncertainty", "coverage_factor", "status")
    return Table("", (*columns, "quantity", "value", "unit", *heads), tuple(rows))


def flag_outside(outside: Sequence[str]) -> tuple[str, ...]:
    """What must be known of values of which some state why the model does not hold there."""
    reasons = [*filter(None, outside)]
    if not reasons:
        return ()
    return (f"{len(reasons)} of {len(outside)} values are {EXTRAPOLATED}: {reasons[0]}",)


def flag_values(values: Sequence[PointResult]) -> tuple[str, ...]:
    """What must be known of the values: lags, and points outside the ranges."""
    lagged = any(
        value.quantity.beyond is not None and any(list(value.point.values())[1:])
        for value in values
    )
    without_uncertainty = {
        value.quantity.key
        for value in values
        if value.result.value and not value.outside and not value.expanded
    }
    flags = [SETTLED] if lagged else []
    flags += flag_outside([value.outside for value in values])
    if without_uncertainty:
        flags.append(f"no uncertainty is known of {', '.join(sorted(without_uncertainty))}")
    return tuple(flags)


def summarise(run_results: RunResults, values: Sequence[PointResult]) -> Summary:
    """Values for the console."""
    count_inside = sum(not value.outside for value in values)
    last = f"{count_inside} of {len(values)} values within the calibrated range"
    return Summary(run_results.run.name, (tabulate(values),), flag_values(values), (), last)


def document(run_results: RunResults, values: Sequence[PointResult]) -> Mapping[str, Any]:
    """Values as a JSON object."""
    return {
        "run": run_results.run.name,
        "values": list_values(values).to_objects(),
        "flags": list(flag_values(values)),
    }
