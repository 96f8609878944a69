"""Model forms of gyros on a rate table, what their models and figures are called, and the models of
a run read back: sensitivities of g gyros about a axes, for gyros about their own axes (1 by 1 each)
and for gyros about three axes of their base.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model, Record
from calibkit.errors import CalibkitError, CoefficientError
from calibkit.forms import POLYNOMIAL, Form, Inputs
from calibkit.instruments.gyro_scale.numeric import gjb_figures, response
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe, OwnAxisRecipe

SCALE_FILE, ORTHOGONALITY_FILE = "gyro_scale.json", "gyro_orthogonality.json"
RATE, TEMPERATURE = "table_rate_dps", "temp_case_degc"
AXES = ("x", "y", "z")
"""Axes of the base that the table turns a triad about."""
_FIGURE = re.compile(rf"(\w+)\.(?:({gjb_figures.GJB}|{gjb_figures.IEEE})\.)?(.+)")


class FigureName(NamedTuple):
    """What a figure of gyro_scale.json is, the standard that defines it (or ""), and its model."""

    what: str
    standard: str
    model: str

    @property
    def text(self) -> str:
        """Name in the file."""
        return ".".join(filter(None, self))


def read_figure_name(name: str) -> FigureName:
    """Parts of the name of a figure of gyro_scale.json."""
    found = _FIGURE.fullmatch(name)
    return FigureName(found[1], found[2] or "", found[3]) if found else FigureName(name, "", "")


def gyro_column(gyro: str) -> str:
    """Canonical column of a gyro's counts per second."""
    return f"gyro_{gyro}_lsb"


def line_name(gyro: str, axis: str = "") -> str:
    """Name of the line of a gyro about a table axis, or about its own where none has a name."""
    return f"{gyro}_about_{axis}" if axis else f"gyro_{gyro}"


def curve_name(line: str, letter: str) -> str:
    """Name of the polynomial over temperature of K or F0 of a line, or of the bias of a gyro."""
    return f"{line}.{letter}_over_temperature"


def response_name(line: str) -> str:
    """Name of the response over rate that belongs to a line."""
    return f"{line}.response"


def triad_names(gyros: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Names of the sensitivities of a triad, gyro by gyro, and of its biases."""
    return [f"S_{gyro}{axis}" for gyro in gyros for axis in AXES], [f"B_{gyro}" for gyro in gyros]


def _line_gradient(model: Model, at: Inputs) -> Array:  # noqa: ARG001 (as every form)
    """Derivatives [n, 2] of the indication by K and F0."""
    return np.column_stack([at[RATE], np.ones_like(at[RATE])])


def _response_gradient(model: Model, at: Inputs) -> Array:
    """Derivatives [n, p] of the indicated rate by the coefficients of the response."""
    return response.gradient(RESPONSE.read(model), at[RATE], is_sine=bool(model.value("sine")))


def _indicated_rate(model: Model, at: Inputs) -> Array:
    """Indicated rate [n, °/s]."""
    return response.evaluate(RESPONSE.read(model), at[RATE], is_sine=bool(model.value("sine")))


def _pair_gradient(model: Model, at: Inputs) -> Array:
    """Derivatives [n, 4, 4] of N, ε, γ, α by themselves."""
    rows, count = len(next(iter(at.values()))), len(model.coefficients)
    return np.broadcast_to(np.eye(count), (rows, count, count))


def _triad_gradient(model: Model, at: Inputs) -> Array:
    """Derivatives [n, g, p] of the indications by the sensitivities and, where they are known, the
    biases.
    """
    rates = np.column_stack([at[f"rate_{axis}_dps"] for axis in AXES])
    own = np.eye(sum(c.name.endswith(AXES[0]) for c in model.coefficients if c.name[0] == "S"))
    by_rates = (own[:, :, None] * rates[:, None, None, :]).reshape(len(rates), len(own), -1)
    biases = np.broadcast_to(own, (len(rates), *own.shape))
    return np.concatenate([by_rates, biases], axis=2)[:, :, : len(model.coefficients)]


LINE = Form("gyro-scale/1", _line_gradient, measured={"temp_case": 0.1})
"""Indication [n, 1/s] over the table rate: F = K Ω + F0."""
RESPONSE = Form("gyro-response/1", _response_gradient, _indicated_rate)
"""Indicated rate (F − F0)/K [n, °/s] over the table rate: an odd polynomial, or the sine of an
open-loop gyro.
"""
PAIR = Form("gyro-orthogonality/1", _pair_gradient)
"""N, ε, γ and α [n, 4] of two gyros: its coefficients are its results."""
PAIR_UNITS = {"N": "1", "epsilon": "1", "gamma": "1", "alpha_deg": "deg"}
"""Coefficient of a pair → unit, in the order of their covariance."""
TRIAD = Form("gyro-triad/1", _triad_gradient)
"""Indications [n, g, 1/s] over the rates about three axes: F = S Ω + B."""
FORMS = (LINE, POLYNOMIAL, RESPONSE, PAIR, TRIAD)


@dataclass(frozen=True, slots=True)
class GyroMatrix:
    """Sensitivities S [g, a] and biases B [g] as they stand in the files of a run: F = S Ω + B,
    with rates Ω about a axes.
    """

    gyros: tuple[str, ...]
    outputs: tuple[str, ...]
    """Columns of the rates [a]."""
    model: Model
    """S and B at one temperature, with the ranges that they hold in."""
    names: tuple[str, ...]
    """Coefficients of the model: S row by row, then B."""
    curves: tuple[Model, ...] = ()
    """The same over temperature; empty where they do not vary."""
    response: Model | None = None
    """What bends the response of a gyro about its own axis."""

    @property
    def temperature(self) -> tuple[float, float] | None:
        """Range of temperatures [°C]; None where they were not logged."""
        return (*self.curves, self.model)[0].valid.get(TEMPERATURE)

    @property
    def over_temperature(self) -> bool:
        """Whether a temperature is needed."""
        return any(len(curve.coefficients) > 1 for curve in self.curves)

    @property
    def rate_limits(self) -> tuple[float, float]:
        """Rates [°/s] that a bent response was fitted over; a straight one has no limits."""
        return (-np.inf, np.inf) if self.response is None else self.response.valid[RATE]

    @property
    def reference(self) -> tuple[Array, Array]:
        """S [g, a] and B [g] of the model at one temperature."""
        S, B = replace(self, curves=()).at(np.zeros(1))
        return S[0], B[0]

    def at(self, temperature: Array) -> tuple[Array, Array]:
        """S [n, g, a] and B [n, g] at temperatures [n, °C], clamped to the fitted ones."""
        columns = [np.full(temperature.size, self.model.value(name)) for name in self.names]
        if self.curves:
            held = np.clip(temperature, *self.curves[0].valid[TEMPERATURE])
            columns = [POLYNOMIAL.evaluate(curve, {TEMPERATURE: held}) for curve in self.curves]
        gyros, axes, rows = len(self.gyros), len(self.outputs), np.column_stack(columns)
        return rows[:, : gyros * axes].reshape(-1, gyros, axes), rows[:, gyros * axes :]

    def rates(self, indication: Array, temperature: Array) -> Array:
        """Rates [n, a, °/s] of indications [n, g, 1/s] at temperatures [n, °C]: of a gyro about its
        own axis, zero where it rested on the laboratory's table; about axes of a base by least
        squares where g > a.
        """
        S, B = self.at(temperature)
        above, bent = indication - B, self.response
        if S.shape[1:] != (1, 1):
            across = np.swapaxes(S, 1, 2)
            found = np.linalg.solve(across @ S, across @ above[..., None])
            return np.asarray(found[..., 0], dtype=np.float64)
        if bent is None:
            return np.asarray(above / S[:, 0], dtype=np.float64)
        return response.invert(
            lambda rate: RESPONSE.evaluate(bent, {RATE: rate}), self.rate_limits, above / S[:, 0]
        )

    def require_biases(self, error: type[CalibkitError] = CoefficientError) -> None:
        """Raise an error where the biases are mixed with the earth's rate."""
        if len(self.names) == len(self.gyros) * len(self.outputs):
            raise error(
                "the run does not know the biases of its gyros:"
                " they are mixed with the earth's rate",
                hint="fit with [site] latitude_deg",
            )


def read_matrices(spec: AnyRecipe, records: Mapping[str, Record]) -> tuple[GyroMatrix, ...]:
    """Matrices of a run: of each gyro about its own axis, or of all gyros about three axes; raises
    CoefficientError for a file or model that is not there.
    """
    if isinstance(spec, GyroTriadRecipe):
        return (_read_triad(spec, records),)
    record = _require(records, SCALE_FILE, "a rate table")
    return tuple(
        _read_own_axis(record, gyro, line_name(gyro, spec.own_axis(gyro))) for gyro in spec.gyros
    )


def _require(records: Mapping[str, Record], name: str, procedure: str) -> Record:
    """A file of the run."""
    if name not in records:
        raise CoefficientError(f"the run holds no {name}", hint=f"it is not a run of {procedure}")
    return records[name]


def _read_own_axis(record: Record, gyro: str, name: str) -> GyroMatrix:
    """One gyro about its own axis, by the line of that name and what stands beside it."""
    line = record.model(name)
    curves = _find_curves(record, [curve_name(name, "K"), curve_name(name, "F0")])
    bent = [model for model in record.models if model.name == response_name(name)]
    return GyroMatrix(
        (gyro,), (f"gyro_{gyro}_dps",), line, ("K", "F0"), curves, bent[0] if bent else None
    )


def _read_triad(spec: GyroTriadRecipe, records: Mapping[str, Record]) -> GyroMatrix:
    """Gyros about three axes; the names of their biases are left out where they are unknown."""
    scale, angles = (
        _require(records, name, "gyro_triad") for name in (SCALE_FILE, ORTHOGONALITY_FILE)
    )
    model = angles.model("triad")
    sensitivities, biases = triad_names(spec.gyros)
    known = {c.name for c in model.coefficients}
    names = [*sensitivities, *(name for name in biases if name in known)]
    curves = [curve_name(line_name(gyro, axis), "K") for gyro in spec.gyros for axis in AXES]
    curves += [curve_name(gyro, "bias") for gyro in spec.gyros]
    outputs = tuple(f"rate_{axis}_dps" for axis in AXES)
    return GyroMatrix(spec.gyros, outputs, model, tuple(names), _find_curves(scale, curves))


def _find_curves(record: Record, names: Sequence[str]) -> tuple[Model, ...]:
    """Polynomials over temperature of these names; empty where one of them is missing."""
    models = {model.name: model for model in record.models}
    found = tuple(models[name] for name in names if name in models)
    return found if len(found) == len(names) else ()


def read_earth_rate(
    spec: OwnAxisRecipe, records: Mapping[str, Record], error: type[CalibkitError]
) -> float:
    """What is added to a compensated rate [°/s]: the earth's rate about the laboratory's table axis
    where the recipe leaves it in the result; raises an error where it is unknown.
    """
    if spec.compensation == "laboratory":
        return 0.0
    for condition in records[SCALE_FILE].conditions:
        if condition.name == "earth_rate_about_table_axis":
            return condition.value
    raise error(
        "the run does not know the earth's rate about its table axis",
        hint="fit with [site] latitude_deg",
    )
