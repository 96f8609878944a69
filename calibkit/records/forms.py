"""Model forms: what the coefficients of a fitted model are called, in which units they stand, and
how a result follows from them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibkit.errors import CoefficientError, FitError
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.fit.solve import Fit, SharedSize
from calibkit.numeric.arrays import Array, Mask
from calibkit.records.coefficients import Coefficient, Component, Model, Parameter

Inputs: TypeAlias = "Mapping[str, Array]"
"""Canonical column → values [n] in its unit."""
FormsOf: TypeAlias = "Callable[[str], Mapping[str, Form]]"
"""Procedure → its model forms by name."""
INFINITE_DOF = 1e9
"""What a file states for infinite degrees of freedom, which JSON cannot write."""


@dataclass(frozen=True, slots=True)
class Form:
    """One model form; every reader and writer of its coefficients goes through it."""

    name: str
    """As it stands in coefficient files."""
    gradient: Callable[[Model, Inputs], Array]
    """Derivatives [n, p] of the result by the coefficients, in their order in the model; [n, m, p]
    of a result with m components.
    """
    function: Callable[[Model, Inputs], Array] | None = None
    """Result [n] or [n, m] where it is not the gradient times the coefficients."""
    meaning: tuple[str, ...] = ()
    """Parameters without which the coefficients are other quantities."""
    measured: Mapping[str, float] = field(default_factory=dict)
    """Parameters that state where the coefficients were measured, with the difference [their unit]
    that matters.
    """
    further: Callable[[Model, Inputs], Array] | None = None
    """Standard uncertainty [n] of what no coefficient states, such as the error of the model."""
    per_log: bool = False
    """Whether each log has a model of its own, named by it."""

    @classmethod
    def of_equation(
        cls,
        name: str,
        equation: Callable[[Model, Numbers, Inputs], Numbers],
        meaning: tuple[str, ...] = (),
    ) -> "Form":
        """Form of an equation: model, coefficients [p] and inputs [n] → result [n] or [n, m]; its
        derivatives are those of the equation by the complex step.
        """

        def function(model: Model, inputs: Inputs) -> Array:
            return np.asarray(equation(model, form.read(model), inputs))

        def gradient(model: Model, inputs: Inputs) -> Array:
            return derivative(lambda p: equation(model, p, inputs), form.read(model))

        form = cls(name, gradient, function, meaning)
        return form

    def write_fit(
        self,
        name: str,
        fit: Fit,
        coefficients: Sequence[tuple[str, str]],
        *,
        residual_rms: float,
        residual_unit: str,
        valid: Mapping[str, tuple[float, float]],
        parameters: tuple[Parameter, ...] = (),
        to_raw: NDArray[np.longdouble] | None = None,
    ) -> Model:
        """Model of this form, its coefficients, each with name and unit, the parameters of a fit,
        or what a matrix [c, p] in extended precision makes of them: powers of a mapped abscissa.
        """
        matrix = np.eye(len(fit.parameters)) if to_raw is None else to_raw
        numbers = np.asarray(matrix @ fit.parameters, dtype=np.float64).tolist()
        G = matrix.astype(np.float64)
        values_by_name = zip(coefficients, numbers, strict=True)
        return self.write(
            name,
            [(coefficient, number, unit) for (coefficient, unit), number in values_by_name],
            G @ fit.total_covariance @ G.T,
            dof=fit.dof,
            residual_rms=residual_rms,
            residual_unit=residual_unit,
            valid=valid,
            parameters=parameters,
            effective_dof=fit.dof_along(G),
            components=components_of(fit.shared),
        )

    def write(
        self,
        name: str,
        coefficients: Sequence[tuple[str, float, str]],
        covariance: Array,
        *,
        dof: int,
        residual_rms: float,
        residual_unit: str,
        valid: Mapping[str, tuple[float, float]],
        parameters: tuple[Parameter, ...] = (),
        effective_dof: Array | None = None,
        components: tuple[Component, ...] = (),
    ) -> Model:
        """Model of this form from (name, value, unit) of each coefficient and their covariance
        [p, p]; standard uncertainties are the roots of its diagonal, with effective degrees of
        freedom [p] where they are not `dof`. Raises FitError where a number is not finite.
        """
        values = [value for _, value, _ in coefficients]
        if not np.isfinite([*values, *covariance.flat, residual_rms]).all():
            raise FitError(
                f"model '{name}': a coefficient, covariance or residual is not a number",
                hint="the data do not determine it: measure more conditions, or lower the orders",
            )
        dof_of_each = [None] * len(coefficients)
        if effective_dof is not None:
            dof_of_each = np.minimum(effective_dof, INFINITE_DOF).tolist()
        uncertainty = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        return Model(
            name=name,
            form=self.name,
            coefficients=tuple(
                Coefficient(*entry, u, own_dof)
                for entry, u, own_dof in zip(coefficients, uncertainty, dof_of_each, strict=True)
            ),
            covariance=tuple(map(tuple, covariance.tolist())),
            dof=dof,
            residual_rms=residual_rms,
            residual_unit=residual_unit,
            valid=valid,
            parameters=parameters,
            components=components,
        )

    def read(self, model: Model) -> Array:
        """Coefficients [p] of a model of this form, or CoefficientError."""
        if model.form != self.name:
            raise CoefficientError(
                f"model '{model.name}' is of form {model.form}, expected {self.name}",
                hint="the file is not of this procedure",
            )
        return np.array([coefficient.value for coefficient in model.coefficients])

    def evaluate(self, model: Model, inputs: Inputs) -> Array:
        """Result [n] or [n, m] at inputs [n], which may lie outside the valid ranges."""
        values = self.read(model)
        if self.function is not None:
            return self.function(model, inputs)
        return self.gradient(model, inputs) @ values

    def standard_uncertainty(self, model: Model, inputs: Inputs) -> Array:
        """Standard uncertainty [n] or [n, m] of the result: √(J C Jᵀ), C the covariance, and what
        the form has further.
        """
        gradient, covariance = self.gradient(model, inputs), np.array(model.covariance)
        variance = np.sum((gradient @ covariance) * gradient, axis=-1)
        if self.further is not None:
            variance = variance + self.further(model, inputs) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def within_ranges(model: Model, inputs: Inputs) -> tuple[Inputs, Mask]:
    """Inputs brought into the valid ranges of a model, and where [n] one of them was outside."""
    inputs_inside = dict(inputs)
    outside = np.zeros(len(next(iter(inputs.values()))), dtype=np.bool_)
    for column, (low, high) in model.valid.items():
        if column in inputs:
            inputs_inside[column] = np.clip(inputs[column], low, high)
            outside |= (inputs[column] < low) | (inputs[column] > high)
    return inputs_inside, outside


def power_unit(unit: str, per: str, power: int) -> str:
    """Unit of the coefficient of a power of an abscissa."""
    return unit if power == 0 else f"{unit}/({per})" if power == 1 else f"{unit}/({per})^{power}"


def _powers(model: Model, inputs: Inputs) -> Array:
    """Ascending powers [n, p] of the abscissa, which is the one column of the valid ranges."""
    (column,) = model.valid
    return np.vander(inputs[column], len(model.coefficients), increasing=True)


def _horner(model: Model, inputs: Inputs) -> Array:
    """Polynomial [n] of the abscissa by Horner's rule."""
    (column,) = model.valid
    powers = [coefficient.value for coefficient in model.coefficients]
    return np.asarray(np.polynomial.polynomial.polyval(inputs[column], powers), dtype=np.float64)


POLYNOMIAL = Form("polynomial/1", _powers, _horner)
"""Σ p_k x^k in raw units, x the one column of the valid ranges."""


def components_of(sizes: Sequence[SharedSize]) -> tuple[Component, ...]:
    """Shared errors that the rows show, or that are known, as a coefficient file holds them."""
    return tuple(
        Component(
            size.error.group,
            size.error.effect,
            size.value,
            size.error.unit,
            size.u,
            size.error.levels,
        )
        for size in sizes
        if size.known or size.dof
    )
