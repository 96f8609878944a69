"""Results of a run as functions of their inputs: what certificates tabulate, `evaluate` prints at
any point and `compare` holds against an earlier run.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from calibkit import units
from calibkit.arrays import Array
from calibkit.certificate.results import Result
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TYPE_A
from calibkit.certificate.words import Words
from calibkit.coefficients import Figure, Model, Record
from calibkit.forms import Form
from calibkit.numeric import gum

At: TypeAlias = "Mapping[str, float]"
"""Canonical column → value in its unit."""
STEP = 1e-4
"""Half the step of a numerical derivative, as a share of the range of the input."""


@dataclass(frozen=True, slots=True)
class Input:
    """An input of a result: its column, the range in which the model holds, and the value that is
    taken where none is given (None: it must be given).
    """

    column: str
    low: float = -math.inf
    high: float = math.inf
    rest: float | None = None

    @property
    def unit(self) -> str:
        """Unit of the column; a gradient is a difference of temperatures."""
        degree = "K" if self.column.startswith("gradient") else "degC"
        if self.column.endswith("_degc_min"):
            return f"{degree}/min"
        return degree if self.column.endswith("_degc") else units.column_unit(self.column)


@dataclass(frozen=True, slots=True)
class Point:
    """A result at one point: value, models with the derivatives [p] by their coefficients,
    sensitivities to influences (value, derivative), and further uncertainties (name, u, degrees of
    freedom).
    """

    value: float
    parts: tuple[tuple[Model, Array], ...] = ()
    influences: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    more: tuple[tuple[Words, float, float], ...] = ()

    def type_a(self) -> tuple[tuple[Words, float, float], ...]:
        """Type A uncertainties: of each model from its covariance, and the further ones."""
        found = []
        for model, weights in self.parts:
            covariance = np.array(model.covariance)
            dof = np.array([float(model.dof_of(c)) for c in model.coefficients])
            name = TYPE_A if len(self.parts) == 1 else TYPE_A + Words(f", {model.name}")
            u = gum.standard_uncertainty(weights, covariance)
            found.append((name, u, gum.degrees_of_freedom(weights, covariance, dof)))
        return (*found, *self.more)


@dataclass(frozen=True, slots=True)
class Limit:
    """Largest change of a result since the last calibration, or lowest and highest value of it, and
    the key that states it.
    """

    key: str
    change: float | None = None
    lower: float | None = None
    upper: float | None = None


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
    inputs: tuple[Input, ...]
    point: Callable[[At], Point]
    compared: tuple[tuple[At, ...], ...] = ()
    limit: Limit | None = None
    relative: bool = False
    """Whether a change is printed as a share of the value, in ppm."""
    beyond: Callable[[At], str] | None = None
    """Why the model does not hold at a point, where ranges of inputs alone do not tell; empty where
    it holds.
    """
    called: tuple[str, ...] = ()
    """Names by which type B terms may call it."""

    @property
    def key(self) -> str:
        """Name in certificates and profiles."""
        return ".".join(filter(None, (self.stage, self.model, self.name)))

    def complete(self, at: At) -> dict[str, float]:
        """Value of every input, by the rest value where none is given; KeyError for one that has
        none.
        """
        return {
            one.column: at[one.column] if one.rest is None else at.get(one.column, one.rest)
            for one in self.inputs
        }

    def outside(self, at: At) -> str:
        """Why the model does not hold at a point with every input; empty where it holds."""
        return outside_ranges(self.inputs, at) if self.beyond is None else self.beyond(at)


def outside_ranges(inputs: Iterable[Input], at: At) -> str:
    """Which inputs are outside the ranges in which a model holds; empty where none is."""
    return "; ".join(
        f"{one.column} {at[one.column]:g} is outside {one.low:.4g} … {one.high:.4g} {one.unit}"
        for one in inputs
        if not one.low <= at[one.column] <= one.high
    )


def state(
    stated: Stated, quantity: Quantity, at: At, *, principal: bool = False, symbol: str = ""
) -> Result:
    """Result of a quantity at a point with every input, its uncertainty combined as on a
    certificate.
    """
    found = quantity.point(at)
    influences, parts_of = stated.of_models(found.parts)
    if not found.parts and quantity.called:
        influences = stated.influences({f"{quantity.stage}.{quantity.called[0]}": 1.0})
    for name, (value, slope) in found.influences.items():
        if not stated.knows(name):
            influences |= {(name, "offset"): slope, (name, "scale"): value * slope}
    conditions = tuple((one.column, at[one.column], one.unit) for one in quantity.inputs)
    return stated.result(
        f"{quantity.stage}.json",
        quantity.key,
        symbol or quantity.name,
        quantity.words,
        found.value,
        quantity.unit,
        type_a=0.0,
        dof=math.inf,
        called=(
            quantity.key,
            f"{quantity.model}.{quantity.name}",
            quantity.name,
            *quantity.called,
        ),
        influences=influences,
        at=conditions,
        principal=principal,
        condition=f"{conditions[0][1]:g}" if conditions else "",
        more=found.type_a(),
        parts_of=parts_of,
    )


def weigh(
    model: Model,
    weights: Mapping[str, float],
    *,
    slope: Mapping[str, float] | None = None,
    of: tuple[str, float] = ("", 0.0),
    influences: Mapping[str, tuple[float, float]] | None = None,
) -> Point:
    """Σ w_i c_i of a model's coefficients; `slope` holds dw/dx for the column and value `of`."""
    values = np.array([c.value for c in model.coefficients])

    def along(by_name: Mapping[str, float]) -> Array:
        return np.array([by_name.get(c.name, 0.0) for c in model.coefficients])

    known = dict(influences or {})
    if slope is not None:
        known[of[0]] = (of[1], float(along(slope) @ values))
    w = along(weights)
    return Point(float(w @ values), ((model, w),), known)


def of_form(
    form: Form, model: Model, inputs: Sequence[Input], component: int | None = None
) -> Callable[[At], Point]:
    """A model's result (one component of it) as a function of its inputs, to each of which it is
    sensitive.
    """

    def evaluate(at: At) -> float:
        found = form.evaluate(model, {name: np.array([x]) for name, x in at.items()})[0]
        return float(found if component is None else found[component])

    def point(at: At) -> Point:
        columns = {name: np.array([x]) for name, x in at.items()}
        row = form.gradient(model, columns)[0]
        influences = {one.column: (at[one.column], slope_by(evaluate, one, at)) for one in inputs}
        weights = row if component is None else row[component]
        return Point(evaluate(at), ((model, weights),), influences)

    return point


def slope_by(evaluate: Callable[[At], float], one: Input, at: At) -> float:
    """Numerical derivative of a function of the inputs by one of them."""
    span = one.high - one.low
    h = STEP * (span if math.isfinite(span) and span > 0.0 else max(abs(at[one.column]), 1.0))
    up, down = (evaluate({**at, one.column: at[one.column] + way * h}) for way in (1.0, -1.0))
    return (up - down) / (2.0 * h)


def of_figure(
    record: Record,
    figure: Figure,
    words: Words,
    *,
    name: str,
    dof: float = math.inf,
    limit: Limit | None = None,
) -> Quantity:
    """A figure of a coefficient file, which depends on nothing."""
    own = figure.effective_dof or dof
    point = Point(figure.value, more=((TYPE_A, figure.standard_uncertainty, own),))
    return Quantity(
        name,
        record.stage,
        "",
        words,
        figure.unit,
        (),
        lambda _: point,
        compared=(({},),),
        limit=limit,
        called=(figure.name,),
    )


def ranged(model: Model, column: str, rest: float | None = None) -> Input:
    """Input with the range in which a model holds; one that the model does not state is
    unlimited.
    """
    low, high = model.valid.get(column, (-math.inf, math.inf))
    return Input(column, low, high, rest)
