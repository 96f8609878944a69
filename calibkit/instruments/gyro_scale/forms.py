"""Model forms of gyros on a rate table, and what their models and figures are called."""

import re
from typing import NamedTuple

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model
from calibkit.forms import POLYNOMIAL, Form, Inputs
from calibkit.instruments.gyro_scale.numeric import response
from calibkit.instruments.gyro_scale.numeric.gjb_figures import GJB, IEEE

SCALE_FILE, ORTHOGONALITY_FILE = "gyro_scale.json", "gyro_orthogonality.json"
RATE, TEMPERATURE = "table_rate_dps", "temp_case_degc"
AXES = ("x", "y", "z")
"""Axes of the base that the table turns a triad about."""
_FIGURE = re.compile(rf"(\w+)\.(?:({GJB}|{IEEE})\.)?(.+)")


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


def is_cross(name: str) -> bool:
    """Whether a line or a curve of one is of a gyro about another's axis."""
    gyro, about, axis = name.partition(".")[0].partition("_about_")
    return bool(about) and gyro != axis


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
TRIAD = Form("gyro-triad/1", _triad_gradient)
"""Indications [n, g, 1/s] over the rates about three axes: F = S Ω + B."""
FORMS = (LINE, POLYNOMIAL, RESPONSE, PAIR, TRIAD)
