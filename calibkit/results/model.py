"""A model of a run as a function of its inputs, with the covariance between them."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.quantities import dof_along, outside_ranges, ranged
from calibkit.errors import UsageError
from calibkit.fit.value import Value
from calibkit.results.evaluation import flag_outside

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calibkit.numeric.arrays import Array
    from calibkit.records.coefficients import Model
    from calibkit.records.forms import Form


@dataclass(frozen=True, slots=True, repr=False)
class Evaluated:
    """Result of a model at n inputs, or of m components there.

    Attributes
    ----------
    value : result [n] or [n, m], in the unit that the model's form states.
    standard_uncertainty : of the same shape and unit.
    expanded_uncertainty : t u for 95.45 %, t by the degrees of freedom of the coefficients used;
        of the same shape and unit.
    covariance : [n, n], or [n, m, n, m]; its diagonal is the square of the standard uncertainty.
        Between two inputs it is that of the coefficients: how the error of the model itself at one
        input goes with that at another is not known, and not in it.
    outside : for each of the n inputs which columns are outside the ranges that the fit covered,
        empty where none is. The uncertainty does not cover an extrapolated value.

    """

    value: Array
    standard_uncertainty: Array
    expanded_uncertainty: Array
    covariance: Array
    outside: tuple[str, ...]

    def __repr__(self) -> str:
        value_text = f"{self.value} ± {self.standard_uncertainty}"
        return f"<{'; '.join((value_text, *flag_outside(self.outside)))}>"


@dataclass(frozen=True, slots=True, repr=False)
class RunModel:
    """One model of a run."""

    model: Model
    """Its coefficients with units, covariance and valid ranges."""
    form: Form

    def __repr__(self) -> str:
        count = len(self.model.coefficients)
        return f"<{self.model.name}: {self.model.form}, {count} coefficients>"

    def evaluate(self, **column_values: ArrayLike) -> Evaluated:
        """Result at inputs with its standard uncertainty and covariance.

        Parameters
        ----------
        column_values : canonical column = values [n] in its unit, one per input of the model's
            form; rates and gradients of a drift model on levels that are not given are 0, as at
            rest. Beyond the valid ranges the form is extrapolated, which the result states in
            `outside`.

        Returns
        -------
        Evaluated: value, standard uncertainty and covariance. The uncertainty is of type A, and of
        a drift model on levels has its error on left-out ramps and, at rest, its hysteresis.

        Raises
        ------
        CalibkitError : an input that is missing, unknown, or not finite real numbers.

        """
        form, model, inputs_read = self.form, self.model, _Inputs()
        try:
            columns = [_read_input(model, name, values) for name, values in column_values.items()]
            inputs_read.update(zip(column_values, np.broadcast_arrays(*columns), strict=True))
            value = form.evaluate(model, inputs_read)
            u = form.standard_uncertainty(model, inputs_read)
            gradient = form.gradient(model, inputs_read)
        except KeyError as error:
            raise UsageError(
                f"model '{model.name}' needs {error}", hint="give it by name"
            ) from None
        except (OverflowError, TypeError, ValueError) as error:
            raise UsageError(
                f"model '{model.name}': {error}", hint="give real numbers, as many of each"
            ) from None
        if unknown := column_values.keys() - inputs_read.asked:
            raise UsageError(
                f"model '{model.name}' has no input {', '.join(sorted(unknown))}",
                hint=f"its inputs are {', '.join(sorted(inputs_read.asked))}",
            )
        flat = gradient.reshape(-1, gradient.shape[-1])
        covariance = flat @ np.array(model.covariance) @ flat.T
        np.fill_diagonal(covariance, u.ravel() ** 2)
        dof = np.array([dof_along(model, weights) for weights in flat]).reshape(u.shape)
        inputs = [ranged(model, name) for name in inputs_read]
        points = zip(*(values.tolist() for values in inputs_read.values()), strict=True)
        outside = [outside_ranges(inputs, dict(zip(inputs_read, x, strict=True))) for x in points]
        expanded = Value(value, u, np.maximum(dof, 1.0)).expanded
        return Evaluated(value, u, expanded, covariance.reshape(u.shape * 2), tuple(outside))


def _read_input(model: Model, name: str, input_values: ArrayLike) -> Array:
    """Values [n] of an input; UsageError for one that is no finite real number."""
    values = np.atleast_1d(np.asarray(input_values))
    if values.dtype.kind in "iuf":
        good = np.isfinite(values)
    else:
        # True and False are no numbers here
        good = np.array(
            [
                isinstance(number, numbers.Real)
                and not isinstance(number, bool)
                and math.isfinite(number)
                for number in values.flat
            ],
            dtype=bool,
        ).reshape(values.shape)
    if values.ndim == 1 and good.all():
        return values.astype(np.float64)
    fault = f"numbers of shape {values.shape}"
    if not good.all():
        wrong = values[~good][0]
        fault = f"{wrong} ({type(wrong).__name__})"
    raise UsageError(
        f"model '{model.name}': {name} holds {fault}, expected finite real numbers",
        hint=f"give a number, or a list, array or Series of them, in {ranged(model, name).unit}",
    )


class _Inputs(dict[str, "Array"]):
    """Inputs of a model, and which of them its form asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> Array:
        self.asked.add(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 (as dict)
        """Input of a name that need not be given."""
        self.asked.add(name)
        return super().get(name, default)
