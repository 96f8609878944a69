"""How every result of a fit moves where an input of the logs is off: the fit is made again with
that input shifted, its model, orders and weights held.

    ∂r/∂x = (r(x + s) - r(x))/s,   of a scale (r(x + s) - r(x - s))/(2 s)       s the step
"""

from __future__ import annotations

from collections.abc import Mapping  # noqa: TC003 (pydantic reads annotations)
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from calibkit.records.sealed import read_as

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from calibkit.records.coefficients import StageResult

Kind = Literal["offset", "scale", "span"]
"""An error of every reading that is the same, that is in proportion to the reading, or that grows
from −1 at the lowest reading to 1 at the highest.
"""
ROUNDING = 1e-11
"""Change, relative to a result and to its uncertainty, that is rounding."""
THERMOMETER_STEP_DEGC = 0.01


@dataclass(frozen=True, slots=True)
class InputError:
    """An error of an input by its canonical column or site value; `step` [unit of its name, 1 of a
    scale] is about as large as such errors are.
    """

    input: str
    kind: Kind
    step: float
    ends: tuple[float, float] = (0.0, 1.0)
    """Lowest and highest reading, of a span."""

    def shift(self, values: Any) -> Any:  # noqa: ANN401 (a number or an array)
        """Values that the input would have had with the error."""
        if self.kind == "scale":
            return values * (1.0 + self.step)
        low, high = self.ends
        half = (high - low) / 2.0
        return values + self.step * ((values - low) / half - 1.0 if self.kind == "span" else 1.0)


def of_thermometer(column: str, low: float, high: float) -> tuple[InputError, ...]:
    """Errors of a thermometer that read from `low` to `high` [°C]: an offset, and one that turns
    the slopes over temperature.
    """
    offset = InputError(column, "offset", THERMOMETER_STEP_DEGC)
    if not high > low:
        return (offset,)
    return offset, InputError(column, "span", THERMOMETER_STEP_DEGC, (low, high))


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Derivatives of results, named <stage>.<model>.<coefficient> or <stage>.<figure>, by an error
    of an input [unit of the result per unit of the input's name, or per 1 of a scale]; none of a
    result that it changes by rounding alone, or that one of the refits does not have.
    """

    input: str
    error: Kind
    derivatives: Mapping[str, float]


def differentiate(
    errors: Iterable[InputError],
    base: Iterable[StageResult],
    refit: Callable[[InputError], Iterable[StageResult]],
) -> tuple[Sensitivity, ...]:
    """Sensitivities by finite differences of refits: of a scale, in which results bend, on both
    sides; of an offset or a span, in which they are nearly linear, against `base`, which is fitted
    as they are.
    """
    before, sensitivities = _values(base), []
    for error in errors:
        up = _values(refit(error))
        down, width = before, error.step
        if error.kind == "scale":
            down, width = _values(refit(replace(error, step=-error.step))), 2.0 * error.step
        derivatives = {
            key: (value - down[key][0]) / width
            for key, (value, _) in up.items()
            if key in down
            and key in before
            and abs(value - down[key][0]) > ROUNDING * max(map(abs, before[key]))
        }
        sensitivities.append(Sensitivity(error.input, error.kind, derivatives))
    return tuple(sensitivities)


def _values(results: Iterable[StageResult]) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty of every coefficient and figure."""
    values: dict[str, tuple[float, float]] = {}
    for result in results:
        for model in result.models:
            values |= {
                f"{result.stage}.{model.name}.{c.name}": (c.value, c.standard_uncertainty)
                for c in model.coefficients
            }
        values |= {
            f"{result.stage}.{figure.name}": (figure.value, figure.standard_uncertainty)
            for figure in result.figures
        }
    return values


def loads(entries: object, name: str) -> tuple[Sensitivity, ...]:
    """Sensitivities of a run.json; CoefficientError for what is none."""
    return read_as(tuple[Sensitivity, ...], entries, name, "a list of sensitivities")
