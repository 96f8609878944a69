"""The affine triad over temperature as a list of named parameters, and its evaluation with
derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError

AXES = "xyz"
TILT = ("tilt_north_rad", "tilt_east_rad")
FIXTURE = ("fixture_x_rad", "fixture_y_rad", "fixture_z_rad")


@dataclass(frozen=True, slots=True)
class AffineTerms:
    """Selection of the parameters that are fitted."""

    scale_order: int = 3
    """Highest power of temperature in the diagonal of M."""
    cross_order: int = 1
    """Highest power of temperature off the diagonal of M; −1 leaves M diagonal."""
    bias_order: int = 3
    """Highest power of temperature in b."""
    second_order: bool = False
    """V_i², V_i V_j and V_i V_k of each axis i (IEEE 1293 K₂, K_ip, K_io)."""
    third_order: bool = False
    """V_i³ of each axis i (IEEE 1293 K₃)."""
    tilt: bool = False
    """Two tilts of the table's base."""
    fixture: bool = False
    """Three angles from the triad to the tool, with M lower triangular."""

    def list_entries(self, *, triangular: bool) -> "tuple[Entry, ...]":
        """List the parameters of a model in their order: M row by row, b, higher orders, nuisance
        angles.
        """
        listed: list[Entry] = []
        for i in range(3):
            for j in range(i + 1 if triangular else 3):
                order = self.scale_order if i == j else self.cross_order
                symbol = f"m_{AXES[i]}{AXES[j]}"
                listed += [Entry(symbol, "m", i, (j,), power) for power in range(order + 1)]
        for i in range(3):
            listed += [Entry(f"b_{AXES[i]}", "b", i, (), k) for k in range(self.bias_order + 1)]
        for i in range(3):
            others = ((i, i), *((i, j) for j in range(3) if j != i)) if self.second_order else ()
            for factors in (*others, *(((i, i, i),) if self.third_order else ())):
                symbol = f"n_{AXES[i]}_{''.join(AXES[j] for j in factors)}"
                listed.append(Entry(symbol, "n", i, factors))
        tilt, fixture = TILT if self.tilt else (), FIXTURE if self.fixture else ()
        listed += [Entry(name, "tilt", i, ()) for i, name in enumerate(tilt)]
        listed += [Entry(name, "fixture", i, ()) for i, name in enumerate(fixture)]
        return tuple(listed)


@dataclass(frozen=True, slots=True)
class Entry:
    """One parameter of the model."""

    symbol: str
    """m_xy, b_z, n_x_xx, tilt_north_rad: the name without the power of temperature."""
    kind: Literal["m", "b", "n", "tilt", "fixture"]
    row: int
    """Index of the parameter's axis, or of the nuisance angle."""
    factors: tuple[int, ...]
    """Axes of the indications that the parameter multiplies: one for M, none for b, two or three
    for higher orders.
    """
    power: int = 0
    """Power of temperature."""

    @property
    def name(self) -> str:
        """Name in coefficient files: m_xy1, b_z0, n_x_xx, tilt_north_rad, fixture_x_rad."""
        return f"{self.symbol}{self.power}" if self.kind in ("m", "b") else self.symbol


_ENTRIES = {
    entry.name: entry
    for entry in AffineTerms(
        9, 9, 9, second_order=True, third_order=True, tilt=True, fixture=True
    ).list_entries(
        triangular=False,
    )
}
"""Name → parameter, for every parameter that a coefficient file can hold."""


def find_entry(name: str) -> Entry:
    """Parameter of the affine triad by its name in a coefficient file; raises FitError for an
    unknown name.
    """
    if name not in _ENTRIES:
        raise FitError(
            f"accel-affine has no parameter {name!r}",
            hint="names are m_xx0, b_x0, n_x_xx with axes x, y, z",
        )
    return _ENTRIES[name]


def matrix_and_bias(
    entries: Sequence[Entry], values: Array, temperature: Array
) -> tuple[Array, Array]:
    """M [n, 3, 3] and b [n, 3] at temperatures [n], in the unit of the parameter values: °C, or
    mapped.
    """
    powers = _powers(entries, temperature)
    matrix, bias = np.zeros((len(powers), 3, 3)), np.zeros((len(powers), 3))
    for entry, value in zip(entries, values, strict=True):
        if entry.kind == "m":
            matrix[:, entry.row, entry.factors[0]] += value * powers[:, entry.power]
        elif entry.kind == "b":
            bias[:, entry.row] += value * powers[:, entry.power]
    return matrix, bias


def _powers(entries: Sequence[Entry], temperature: Array) -> Array:
    """Ascending powers [n, k] of temperatures [n]."""
    return np.vander(temperature, 1 + max(entry.power for entry in entries), increasing=True)


def evaluate(
    entries: Sequence[Entry], values: Array, indication: Array, temperature: Array
) -> tuple[Array, Array]:
    """Corrected components [n, 3] and their derivatives [n, 3, p] by the parameters; derivatives by
    nuisance angles are zero.

    `temperature` [n] is in the unit that the values are meant for: °C, or mapped.
    """
    powers = _powers(entries, temperature)
    matrix, bias = matrix_and_bias(entries, values, temperature)
    shifted = indication - bias
    corrected = np.einsum("nij,nj->ni", matrix, shifted)
    slopes = np.zeros((len(indication), 3, len(entries)))
    for column, (entry, value) in enumerate(zip(entries, values, strict=True)):
        if entry.kind == "m":
            slopes[:, entry.row, column] = shifted[:, entry.factors[0]] * powers[:, entry.power]
        elif entry.kind == "b":
            slopes[:, :, column] = -matrix[:, :, entry.row] * powers[:, entry.power, None]
        elif entry.kind == "n":
            slopes[:, entry.row, column] = np.prod(indication[:, entry.factors], axis=1)
            corrected[:, entry.row] += value * slopes[:, entry.row, column]
    return corrected, slopes
