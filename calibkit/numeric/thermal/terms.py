"""Terms of the level and lagged drift models, their scaled basis, and the fitted ranges of their
drivers.

    ω = b0 + b1 T + b2 T² + b3 T³ + s_rate Ṫ + s_grad G + s_grad2 G² + s_temp_rate T Ṫ + s_grad_rate
    Ġ

is the environmental model of IEEE Std 952 (D_T ΔT + D_Ṫ dT/dt + D_∇T d∇T/dt), with the static part
to third order and products for the coil's conduction and Shupe effect. `coil` says what T
and G are: `level_drivers` of a level model, `Path.drivers` of a lagged one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.thermal.pooled_fit import BlockNoise

Span = tuple[float, float]

TERMS = ("b0", "b1", "b2", "b3", "s_rate", "s_grad", "s_grad2", "s_temp_rate", "s_grad_rate")
CASE, RATE, GRADIENT = "temp_case_degc", "temp_rate_degc_min", "gradient_degc"
DRIVERS = (CASE, RATE, GRADIENT, "gradient_rate_degc_min")
"""Columns of the drivers; of a lagged model those of lagged temperatures."""
LAGS = ("tau_outer", "tau_inner")
"""Names of the lags of a lagged model [s]; their derivatives follow those of the terms."""
NEEDS = {"b2": "b1", "b3": "b2", "s_grad2": "s_grad", "s_temp_rate": "s_rate"}
"""Term → lower term that it needs: without it the model would depend on the zero of a scale."""


class Drivers(NamedTuple):
    """Inputs of the drift model, each [n]: temperature [°C], its rate [°C/min], gradient [K], its
    rate [K/min].
    """

    temperature: Array
    rate: Array
    gradient: Array
    gradient_rate: Array

    def valid(self) -> "Valid":
        """Range of each driver."""
        return Valid(*((float(values.min()), float(values.max())) for values in self))

    def raw_design(self) -> Array:
        """Design [n, 9] in raw units, one column per term; complex where a driver is."""
        T, r, G, q = self
        design, square = np.ones((T.size, 9), np.result_type(*self)), T * T
        for k, term in enumerate((T, square, square * T, r, G, G * G, T * r, q), start=1):
            design[:, k] = term
        return design

    def scaled_design(self, scales: "Scales") -> Array:
        """Design [n, 9] of the same terms on scaled drivers, well conditioned."""
        return Drivers(
            (self.temperature - scales.middle) / scales.half,
            self.rate / scales.rate,
            self.gradient / scales.gradient,
            self.gradient_rate / scales.gradient_rate,
        ).raw_design()


class Valid(NamedTuple):
    """Fitted ranges of the drivers: temperature [°C], its rate [°C/min], gradient [K], its rate
    [K/min].
    """

    temperature: Span
    rate: Span
    gradient: Span
    gradient_rate: Span

    def scales(self) -> "Scales":
        """Scales for these ranges; a driver that is always zero has scale 1."""
        low, high = self.temperature
        largest = [
            max(abs(a), abs(b)) or 1.0 for a, b in (self.rate, self.gradient, self.gradient_rate)
        ]
        return Scales((low + high) / 2.0, (high - low) / 2.0 or 1.0, *largest)


def chosen_columns(terms: Sequence[str]) -> Integers:
    """Design columns of a set of terms; raises FitError for an unknown term or one without the term
    it needs.
    """
    for term in terms:
        if term not in TERMS:
            raise FitError(
                f"{term!r} is not a drift term", hint=f"the terms are {', '.join(TERMS)}"
            )
        # without the lower term the model would depend on the zero of the temperature scale
        if term in NEEDS and NEEDS[term] not in terms:
            raise FitError(f"drift term {term} without {NEEDS[term]}", hint="add the lower term")
    if "b0" not in terms:
        raise FitError("a drift model without b0", hint="the mean rate is always a term")
    return np.array([k for k, term in enumerate(TERMS) if term in terms], dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Scales:
    """Scales of the drivers to about [−1, 1]: u = (T − middle)/half; the others are divided by
    their largest magnitude.
    """

    middle: float
    half: float
    rate: float
    gradient: float
    gradient_rate: float

    def to_raw(self) -> Array:
        """Matrix [9, 9] from coefficients of the scaled design to coefficients in raw units."""
        matrix = np.zeros((9, 9))
        # the static part is a polynomial of the mapped temperature
        matrix[:4, :4] = polynomial.to_raw_powers(self.middle, self.half, 3)
        product = self.half * self.rate
        # the product u Ṫ of the scaled temperature holds a part of Ṫ
        matrix[4, 4], matrix[4, 7] = 1.0 / self.rate, -self.middle / product
        matrix[5, 5], matrix[6, 6] = 1.0 / self.gradient, 1.0 / self.gradient**2
        matrix[7, 7], matrix[8, 8] = 1.0 / product, 1.0 / self.gradient_rate
        return matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasModel:
    """Fitted model of a bias whose value is known at every instant, without integration."""

    coefficients: Array
    """[p], in the unit of the bias, °C, °C/min and K; 0 for terms that were not fitted."""
    covariance: Array
    """[p + lags, p + lags], type A covariance of coefficients and lags."""
    valid: Valid
    turn_on: Array
    """[logs], bias of each log relative to b0 [°/h]."""
    constant_dof: float = float("inf")
    """Degrees of freedom of b0, an average over few power-ons: those of the logs, never those of
    their rows; infinite where the sizes of turn-on biases that the logs allow are averaged.
    """
    dof: int
    residual_rms: float
    """Residual rms of the block means without spikes [°/h]."""
    noise: BlockNoise
    """White noise of a block and flicker noise (including model misfit), from which the covariance
    follows.
    """
    model_error: float = 0.0
    """Standard deviation of the model's error on left-out ramps beyond type A and noise [°/h]; 0 if
    none was left out.
    """
    model_error_dof: float = float("inf")
    """Degrees of freedom of the model error: number of left-out ramps less one."""
    entangled: tuple[str, ...] = ()
    """Coefficients and lags whose uncertainties hold jointly, through the covariance, but not
    individually.
    """
    flags: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    """What asks for nothing, as the uncertainty holds it."""

    def nearest_fitted(self, temperature: float) -> float:
        """Temperature [°C] clamped to the fitted range."""
        low, high = self.valid.temperature
        return min(max(temperature, low), high)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalModel(BiasModel):
    """Fitted model of form level or lagged; its nine coefficients are in the order of TERMS."""

    form: Literal["level", "lagged"]
    terms: tuple[str, ...]
    """Fitted terms."""
    lags: tuple[float, ...]
    """tau_outer and, for a coil of two masses, tau_inner [s]; empty for a level model."""
    window_s: float
    """Trailing window of the rates of a level model [s]; 0 for a lagged model."""
    turn_on_variance: float = 0.0
    """Part of the variance of b0 that the turn-on biases of the logs make [(°/h)²]."""
