"""Results of a run as functions of their inputs: what certificates tabulate, `evaluate` prints at
any point and `compare` holds against an earlier run.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from calibkit.certificate.results import Result
from calibkit.certificate.stated import Stated, input_unit, interval_of_magnitude
from calibkit.certificate.uncertainty import TYPE_A
from calibkit.certificate.words import Words
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Figure, Model, Record
from calibkit.records.forms import Form

At: TypeAlias = "Mapping[str, float]"
"""Canonical column → value in its unit."""
Slopes: TypeAlias = "Mapping[str, tuple[float, float]]"
"""Input → its value and the derivative of a result by it."""
NAMELESS = Words("")
NO_SLOPES: Slopes = MappingProxyType({})
STEP = 1e-4
"""Half the step of a numerical derivative, as a share of the range of the input."""


@dataclass(frozen=True, slots=True)
class QuantityInput:
    """An input of a result: its column, the range in which the model holds, and the value that is
    taken where none is given (None: it must be given).
    """

    column: str
    low: float = -math.inf
    high: float = math.inf
    rest: float | None = None

    @property
    def unit(self) -> str:
        """Unit of the column."""
        return input_unit(self.column)


@dataclass(frozen=True, slots=True)
class Point:
    """A result at one point: value, models with the derivatives [p] by their coefficients,
    sensitivities to influences (value, derivative), and further uncertainties (name, u, degrees of
    freedom).
    """

    value: float
    parts: tuple[tuple[Model, Array], ...] = ()
    influences: Slopes = field(default_factory=dict)
    more: tuple[tuple[Words, float, float], ...] = ()

    def type_a(self) -> tuple[tuple[Words, float, float], ...]:
        """Type A uncertainties: of each model from its covariance, and the further ones."""
        uncertainties = []
        for model, weights in self.parts:
            name = TYPE_A if len(self.parts) == 1 else TYPE_A + Words.literal(f", {model.name}")
            u = float(gum.uncertainty_along(weights[None], np.array(model.covariance))[0])
            uncertainties.append((name, u, dof_along(model, weights)))
        return (*uncertainties, *self.more)


def dof_along(model: Model, weights: Array) -> float:
    """Effective degrees of freedom of a sum of a model's coefficients with weights [p], 0 where one
    that takes part has none: of those that are correlated the fewest, which is at most 6 % of U
    more, and 1 % less, than what the fit itself states; 5 % less where a mounting is stated.
    """
    dof = np.array([float(model.dof_of(c)) for c in model.coefficients])
    return gum.degrees_of_freedom(weights, np.array(model.covariance), dof)


@dataclass(frozen=True, slots=True)
class ResultLimit:
    """Largest change of a result since the last calibration, or lowest and highest value of it, and
    the key that states it.
    """

    key: str
    change: float | None = None
    lower: float | None = None
    upper: float | None = None

    def bounds(self, now: float) -> tuple[float, float]:
        """Lowest and highest value, of a limit on changes those from the value now."""
        if self.change is not None:
            return now - self.change, now + self.change
        low = -math.inf if self.lower is None else self.lower
        return low, math.inf if self.upper is None else self.upper


@dataclass(frozen=True, slots=True)
class Quantity:
    """A result of a run: its name in the run, words, unit and inputs, and its value at a point.

    Runs of other model forms have the same quantity under the same `name`. `compared` is empty for
    a result that says nothing of the instrument itself; else it holds groups of the inputs other
    than the first, of each of which the first that both runs hold at is compared.
    """

    name: str
    stage: str
    model: str
    words: Words
    unit: str
    inputs: tuple[QuantityInput, ...]
    point: Callable[[At], Point]
    compared: tuple[tuple[At, ...], ...] = ()
    limit: ResultLimit | None = None
    relative: bool = False
    """Whether a change is printed as a share of the value, in ppm."""
    beyond: Callable[[At], str] | None = None
    """Why the model does not hold at a point, where ranges of inputs alone do not tell; empty where
    it holds.
    """
    called: tuple[str, ...] = ()
    """Names by which type B terms may call it."""
    symbol: str | None = None
    """Symbol on a certificate; None where its name is one."""
    standard: str = ""
    """Standard whose definition is meant where several define the same word."""
    magnitude: bool = False
    """Whether it cannot be negative, and is stated with a coverage interval."""
    principal: bool = False
    """Whether its budget is printed in full, where it depends on something at one point."""
    undecided: Words | None = None
    """Why no limit on it is decided: what its U leaves out, because no log shows it."""
    completed_by: tuple[str, ...] = ()
    """Quantities of type B terms that state what U would leave out."""

    @property
    def key(self) -> str:
        """Name in certificates and profiles."""
        return ".".join(filter(None, (self.stage, self.model, self.name)))

    def complete(self, input_values: At) -> dict[str, float]:
        """Value of every input, by the rest value where none is given; KeyError for one that has
        none.
        """
        return {
            entry.column: input_values[entry.column]
            if entry.rest is None
            else input_values.get(entry.column, entry.rest)
            for entry in self.inputs
        }

    def spread(self) -> list[dict[str, float]]:
        """Points with every input: of each group that is compared the first, at the ends and in the
        middle of the first input.
        """
        points = []
        for group in self.compared:
            levels: list[At] = [{}]
            if self.inputs and self.inputs[0].column not in group[0]:
                first = self.inputs[0]
                middle = (first.low + first.high) / 2.0
                levels = [{first.column: x} for x in (first.low, middle, first.high)]
            points += [self.complete({**group[0], **level}) for level in levels]
        return points

    def outside(self, input_values: At) -> str:
        """Why the model does not hold at a point with every input; empty where it holds."""
        if self.beyond is None:
            return outside_ranges(self.inputs, input_values)
        return self.beyond(input_values)


def outside_ranges(inputs: Iterable[QuantityInput], input_values: At) -> str:
    """Which inputs are outside the ranges in which a model holds; empty where none is."""
    return "; ".join(
        f"{entry.column} {input_values[entry.column]:g} is outside"
        f" {entry.low:.4g} … {entry.high:.4g} {entry.unit}"
        for entry in inputs
        if not entry.low <= input_values[entry.column] <= entry.high
    )


def state(
    basis: Stated, quantity: Quantity, input_values: At, *, principal: bool | None = None
) -> Result:
    """Result of a quantity at a point with every input, its uncertainty combined as on a
    certificate.
    """
    point = quantity.point(input_values)
    influences, parts_of = basis.of_models(point.parts)
    if not point.parts and quantity.called:
        influences = basis.influences({f"{quantity.stage}.{quantity.called[0]}": 1.0})
    for name, (value, slope) in point.influences.items():
        # the run's sensitivities tell more than the slope over an input of the result
        if not (quantity.inputs and basis.knows(name)):
            influences |= {(name, "offset"): slope, (name, "scale"): value * slope}
    conditions = tuple(
        (entry.column, input_values[entry.column], entry.unit) for entry in quantity.inputs
    )
    by_definition = not (point.parts or point.influences or point.more)
    result = Result(
        quantity.key,
        quantity.name if quantity.symbol is None else quantity.symbol,
        quantity.words,
        point.value,
        quantity.unit,
        at=conditions,
        standard=quantity.standard,
        principal=quantity.principal if principal is None else principal,
        condition=f"{conditions[0][1]:g}" if conditions else "",
        by_definition=by_definition,
        undecided=quantity.undecided,
    )
    if by_definition:
        return result
    names = (
        result.key,
        quantity.key,
        f"{quantity.model}.{quantity.name}",
        quantity.name,
        *quantity.called,
    )
    uncertainty = basis.source.uncertainty(
        names, point.value, quantity.unit, point.type_a(), influences, parts_of
    )
    result = basis.scope.raise_to_floor(replace(result, uncertainty=uncertainty))
    if {part.quantity for part in result.contributions} & {*quantity.completed_by}:
        result = replace(result, undecided=None)
    if result.uncertainty is None or not quantity.magnitude:
        return result
    return replace(result, interval=interval_of_magnitude(point.value, result.uncertainty))


def coefficient(
    record: Record,
    model: Model,
    name: str,
    words: Words = NAMELESS,
    slopes: Slopes = NO_SLOPES,
) -> Quantity:
    """A coefficient of a model, which depends on nothing; `slopes` as influences of a point."""
    fitted = next(c for c in model.coefficients if c.name == name)
    weights = np.array([float(c is fitted) for c in model.coefficients])
    point = Point(fitted.value, ((model, weights),), slopes)
    return Quantity(name, record.stage, model.name, words, fitted.unit, (), lambda _: point)


def polynomial(model: Model, terms: Sequence[str], column: str) -> Callable[[At], Point]:
    """Σ c_k x^k as a function of its abscissa x; `terms` names the coefficients c_k."""
    names = [c.name for c in model.coefficients]
    columns = [names.index(term) for term in terms]
    coefficients = np.array([c.value for c in model.coefficients])
    powers = np.arange(len(terms))

    def point(input_values: At) -> Point:
        x = input_values.get(column, 0.0)
        weights, by_abscissa = np.zeros((2, coefficients.size))
        weights[columns] = x**powers
        by_abscissa[columns[1:]] = powers[1:] * x ** (powers[1:] - 1)
        slope = float(by_abscissa @ coefficients)
        return Point(float(weights @ coefficients), ((model, weights),), {column: (x, slope)})

    return point


def numbered(prefix: str, model: Model) -> list[str]:
    """Coefficients <prefix>0, <prefix>1, … of a model, as many as it has."""
    names = [c.name for c in model.coefficients]
    candidates = (f"{prefix}{k}" for k in range(len(names)))
    return [name for name in candidates if name in names]


def against_rest(point: Callable[[At], Point], rest_values: At) -> Callable[[At], Point]:
    """A result less that at rest: there it is 0 by definition. Further uncertainties and the
    derivatives by the inputs are those of the result itself, as `rest` is no measured value.
    """

    def difference(input_values: At) -> Point:
        if all(value == rest_values.get(name, 0.0) for name, value in input_values.items()):
            return Point(0.0)
        result_point = point(input_values)
        return replace(less(result_point, point(rest_values)), influences=result_point.influences)

    return difference


def less(minuend: Point, subtrahend: Point) -> Point:
    """A result less another of the same model; further uncertainties are those of the first."""
    ((model, weights),), ((_, subtrahend_weights),) = minuend.parts, subtrahend.parts
    slopes = {
        name: (input_value, slope - subtrahend.influences[name][1])
        for name, (input_value, slope) in minuend.influences.items()
    }
    return replace(
        minuend,
        value=minuend.value - subtrahend.value,
        parts=((model, weights - subtrahend_weights),),
        influences=slopes,
    )


def of_form(
    form: Form, model: Model, inputs: Sequence[QuantityInput], component: int | None = None
) -> Callable[[At], Point]:
    """A model's result (one component of it) as a function of its inputs, to each of which it is
    sensitive.
    """

    def evaluate(input_values: At) -> float:
        result = form.evaluate(model, {name: np.array([x]) for name, x in input_values.items()})[0]
        return float(result if component is None else result[component])

    def point(input_values: At) -> Point:
        columns = {name: np.array([x]) for name, x in input_values.items()}
        row = form.gradient(model, columns)[0]
        influences = {
            entry.column: (input_values[entry.column], slope_by(evaluate, entry, input_values))
            for entry in inputs
        }
        weights = row if component is None else row[component]
        return Point(evaluate(input_values), ((model, weights),), influences)

    return point


def slope_by(evaluate: Callable[[At], float], entry: QuantityInput, input_values: At) -> float:
    """Numerical derivative of a function of the inputs by one of them."""
    span = entry.high - entry.low
    x = input_values[entry.column]
    h = STEP * (span if math.isfinite(span) and span > 0.0 else max(abs(x), 1.0))
    up, down = (evaluate({**input_values, entry.column: x + way * h}) for way in (1.0, -1.0))
    return (up - down) / (2.0 * h)


def of_figure(
    record: Record,
    figure: Figure,
    words: Words,
    *,
    dof: float = math.inf,
    slopes: Slopes = NO_SLOPES,
) -> Quantity:
    """A figure of a coefficient file, which depends on nothing; `dof` where the file does not state
    its own.
    """
    type_a = (TYPE_A, figure.standard_uncertainty, figure.effective_dof or dof)
    point = Point(figure.value, influences=slopes, more=(type_a,))
    name, stage = figure.name, record.stage
    return Quantity(
        *(name, stage, "", words, figure.unit, ()), lambda _: point, called=(name,), symbol=""
    )


def ranged(model: Model, column: str, rest_value: float | None = None) -> QuantityInput:
    """Input with the range in which a model holds; one that the model does not state is
    unlimited.
    """
    low, high = model.valid.get(column, (-math.inf, math.inf))
    return QuantityInput(column, low, high, rest_value)
