"""gyro_scale.json and gyro_orthogonality.json → sensitivities of g gyros about a axes: one model
for gyros about their own axes (1 by 1 each) and for gyros about three axes of their base.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model, Record
from calibkit.errors import CalibkitError, CoefficientError
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale.forms import (
    AXES,
    ORTHOGONALITY_FILE,
    RATE,
    RESPONSE,
    SCALE_FILE,
    TEMPERATURE,
    curve_name,
    line_name,
    response_name,
    triad_names,
)
from calibkit.instruments.gyro_scale.numeric import response
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe, OwnAxisRecipe


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
        return self._shaped(np.array([[self.model.value(name) for name in self.names]]), 0)

    def _shaped(self, rows: Array, row: int | slice) -> tuple[Array, Array]:
        """S and B of rows of coefficients in the order of the names."""
        size = (len(self.gyros), len(self.outputs))
        split = size[0] * size[1]
        return rows[:, :split].reshape(-1, *size)[row], rows[:, split:][row]

    def at(self, temperature: Array) -> tuple[Array, Array]:
        """S [n, g, a] and B [n, g] at temperatures [n, °C], clamped to the fitted ones."""
        if not self.curves:
            S, B = self.reference
            return np.broadcast_to(S, (temperature.size, *S.shape)), np.broadcast_to(
                B, (temperature.size, *B.shape)
            )
        held = np.clip(temperature, *self.curves[0].valid[TEMPERATURE])
        columns = [POLYNOMIAL.evaluate(curve, {TEMPERATURE: held}) for curve in self.curves]
        return self._shaped(np.column_stack(columns), slice(None))

    def rates(self, indication: Array, temperature: Array) -> Array:
        """Rates [n, a, °/s] of indications [n, g, 1/s] at temperatures [n, °C]: of a gyro about its
        own axis, zero where it rested on the laboratory's table; about axes of a base by least
        squares where g > a.
        """
        S, B = self.at(temperature)
        above = indication - B
        if S.shape[1:] == (1, 1):
            return self._unbent(above / S[:, 0])
        across = np.swapaxes(S, 1, 2)
        right = across @ above[..., None]
        return np.asarray(np.linalg.solve(across @ S, right)[..., 0], dtype=np.float64)

    def _unbent(self, indicated: Array) -> Array:
        """Rates [n, °/s] of indicated rates [n, °/s]."""
        bent = self.response
        if bent is None:
            return indicated
        return response.invert(
            lambda rate: RESPONSE.evaluate(bent, {RATE: rate}), self.rate_limits, indicated
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


def require_biases(matrix: GyroMatrix, error: type[CalibkitError] = CoefficientError) -> None:
    """Raise an error where the biases are mixed with the earth's rate."""
    if len(matrix.names) == len(matrix.gyros) * len(matrix.outputs):
        raise error(
            "the run does not know the biases of its gyros: they are mixed with the earth's rate",
            hint="fit with [site] latitude_deg",
        )


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
