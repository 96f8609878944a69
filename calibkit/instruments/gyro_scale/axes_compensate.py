"""gyro_orthogonality.json of gyros over three axes → rates about the axes of their base, and how
they stand on unseen runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit import check
from calibkit.errors import CoefficientError, FrameError
from calibkit.frame import refuse, values
from calibkit.ingest import logs
from calibkit.instruments.gyro_scale.axes import AXES
from calibkit.instruments.gyro_scale.runs import TEMPERATURE, column

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.arrays import Array, Mask
    from calibkit.coefficients import Record
    from calibkit.frame import Log
    from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
    from calibkit.instruments.gyro_scale.runs import TableRun


PPM = 1e6
LARGEST_CONDITION = 1e3
"""Of the unit vectors of the input axes: beyond it noise of the gyros comes out a thousand times
larger.
"""
OTHER_AXIS = 0.1
"""Departure of a rate gain from 1 that no drift of a scale factor makes."""
TEMPERATURE_SLACK = 5.0
"""Kelvin beyond the fitted temperatures at which one matrix for all of them is still used without a
flag.
"""


@dataclass(frozen=True, slots=True)
class Base:
    """Sensitivities S [3 g] and biases B [g] as they leave the files, each a polynomial of
    temperature.
    """

    gyros: tuple[str, ...]
    sensitivity: tuple[Array, ...]
    """3 g arrays of powers of temperature, gyro by gyro."""
    bias: tuple[Array, ...]
    temperature: tuple[float, float] | None
    reference: Array
    """[g, 3] at the reference temperature."""

    @property
    def over_temperature(self) -> bool:
        """Whether a temperature is needed."""
        return any(powers.size > 1 for powers in (*self.sensitivity, *self.bias))

    def at(self, temperature: Array) -> tuple[Array, Array]:
        """S [n, g, 3] and B [n, g] at temperatures [n], clamped to the fitted ones."""
        held = (
            np.clip(temperature, *self.temperature)
            if self.temperature
            else np.zeros_like(temperature)
        )
        polyval = np.polynomial.polynomial.polyval
        S: Array = np.column_stack([polyval(held, c) for c in self.sensitivity])
        B: Array = np.column_stack([polyval(held, c) for c in self.bias])
        return S.reshape(-1, len(self.gyros), len(AXES)), B

    def rates(self, indication: Array, temperature: Array) -> Array:
        """Rates about the axes of the base [n, 3, °/s] of indications [n, g, 1/s], by least squares
        where g > 3.
        """
        S, B = self.at(temperature)
        across = np.swapaxes(S, 1, 2)
        right = across @ (indication - B)[..., None]
        return np.asarray(np.linalg.solve(across @ S, right)[..., 0], dtype=np.float64)


def base(records: Mapping[str, Record], spec: GyroTriadRecipe) -> Base:
    """Coefficients of a run; raises CoefficientError where they do not give rates about three
    axes.
    """
    for name in ("gyro_scale.json", "gyro_orthogonality.json"):
        if name not in records:
            raise CoefficientError(f"the run holds no {name}", hint="it is not a run of gyro_triad")
    triad = records["gyro_orthogonality.json"].model("triad")
    known = {c.name: c.value for c in triad.coefficients}
    if f"B_{spec.gyros[0]}" not in known:
        raise CoefficientError(
            "the run does not know the biases of its gyros: they are mixed with the earth's rate",
            hint="fit with [site] latitude_deg",
        )
    entries = [(gyro, axis) for gyro in spec.gyros for axis in AXES]
    reference = np.array([known[f"S_{gyro}{axis}"] for gyro, axis in entries]).reshape(
        -1, len(AXES)
    )
    unit = reference / np.linalg.norm(reference, axis=1, keepdims=True)
    if len(unit) < len(AXES) or not np.linalg.cond(unit) < LARGEST_CONDITION:
        raise CoefficientError(
            f"the gyros {', '.join(spec.gyros)} do not sense three axes: rates about them cannot"
            " be had",
            hint="log a gyro of the missing direction too",
        )
    models = {model.name: model for model in records["gyro_scale.json"].models}
    curves = [models.get(f"{gyro}_about_{axis}.K_over_temperature") for gyro, axis in entries]
    biases = [models.get(f"{gyro}.bias_over_temperature") for gyro in spec.gyros]
    present = [model for model in (*curves, *biases) if model is not None]
    if len(present) == len(curves) + len(biases):
        powers = [np.array([c.value for c in model.coefficients]) for model in present]
        limits = present[0].valid[TEMPERATURE]
        return Base(
            spec.gyros,
            tuple(powers[: len(curves)]),
            tuple(powers[len(curves) :]),
            limits,
            reference,
        )
    constant = tuple(np.array([value]) for value in reference.ravel())
    bias = tuple(np.array([known[f"B_{gyro}"]]) for gyro in spec.gyros)
    return Base(spec.gyros, constant, bias, triad.valid.get(TEMPERATURE), reference)


def read(spec: GyroTriadRecipe, data: Path, known: Base) -> Log:
    """One log to be compensated, with every gyro, and the temperature where it is needed or
    logged.
    """
    needed = tuple(map(column, spec.gyros))
    if known.over_temperature:
        log = logs.read_log(spec, data, data.name, (*needed, TEMPERATURE), ())
    else:
        log = logs.read_log(spec, data, data.name, needed, (TEMPERATURE,))
    refuse(
        [*check.find_too_few_rows(log, 1), *check.find_missing_values(log, list(log.frame.columns))]
    )
    if TEMPERATURE in log.frame.columns:
        refuse(check.find_implausible_temperatures(log, [TEMPERATURE]))
    return log


def compensated(log: Log, known: Base) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Derived columns rate_x_dps, rate_y_dps, rate_z_dps about the axes of the base, and what must
    be said of them.
    """
    logged = TEMPERATURE in log.frame.columns
    temperature = values(log.frame, TEMPERATURE) if logged else np.zeros(len(log.frame))
    rates = known.rates(
        np.column_stack([values(log.frame, column(g)) for g in known.gyros]), temperature
    )
    flags = _temperature_flags(log.file, known, temperature) if logged else []
    return {f"rate_{axis}_dps": rates[:, a] for a, axis in enumerate(AXES)}, tuple(flags)


def _temperature_flags(file: str, known: Base, temperature: Array) -> list[str]:
    """Temperatures that are clamped, or at which one matrix for all temperatures was not found."""
    if known.temperature is None:
        return []
    slack = 0.0 if known.over_temperature else TEMPERATURE_SLACK
    low, high = known.temperature
    outside = 100.0 * float(np.mean((temperature < low - slack) | (temperature > high + slack)))
    what = (
        "clamped"
        if known.over_temperature
        else "but sensitivities and biases are taken as constant"
    )
    flag = (
        f"{file}: temperature outside {low:.1f} … {high:.1f} °C over {outside:.1f} % of the rows,"
        f" {what}"
    )
    return [flag] if outside else []


def stand(
    run: TableRun, axis: str, known: Base, vertical_dps: float
) -> tuple[dict[str, object], list[str]]:
    """JSON object: compensated rates of an unseen run about one axis and across it, and without
    compensation; and flags.

    Without compensation each gyro stands for the axis that it senses most, with its scale factor
    about that alone.
    """
    held = run.plateaus
    temperature = held.temp_degc if np.isfinite(run.temp_degc) else np.zeros(held.rate_dps.size)
    if known.over_temperature and not np.isfinite(run.temp_degc):
        raise CoefficientError(
            f"{run.log.file}: no column '{TEMPERATURE}'",
            hint="the coefficients are over temperature",
        )
    rates = known.rates(held.indication, temperature)
    _, B = known.at(temperature)
    main = np.argmax(np.abs(known.reference), axis=1)
    alone = (held.indication - B) / known.reference[np.arange(main.size), main]
    a = AXES.index(axis)
    true = np.zeros_like(rates)
    true[:, a] = held.rate_dps + vertical_dps
    flags = (
        _temperature_flags(run.log.file, known, temperature) if np.isfinite(run.temp_degc) else []
    )
    gain = float(np.polyfit(held.rate_dps, rates[:, a], 1)[0])
    if not abs(gain - 1.0) < OTHER_AXIS:
        raise FrameError(
            f"{run.log.file}: the rate about {axis} comes out {gain:.4f} times the table's,"
            " expected about 1",
            hint=(
                "it turns about another axis ([axes]), is in another unit or sign, or is of another"
                " unit's gyros"
            ),
        )
    return {
        "axis": axis,
        "before_is": "each gyro by its scale factor about the axis that it senses most",
        "before": _errors(alone - true[:, main], main == a, held.rate_dps),
        "after": _errors(rates - true, np.arange(len(AXES)) == a, held.rate_dps),
        "rate_gain": gain,
    }, flags


def _errors(error: Array, along: Mask, rate_dps: Array) -> dict[str, float]:
    """Largest errors [n, m] along the turned axis and across it, of full scale; zero where no
    column is of that kind.
    """
    full = float(np.max(np.abs(rate_dps))) / PPM
    return {
        "rate_error_max_ppm_of_full_scale": (
            float(np.max(np.abs(error[:, along]), initial=0.0)) / full
        ),
        "cross_axis_max_ppm_of_full_scale": (
            float(np.max(np.abs(error[:, ~along]), initial=0.0)) / full
        ),
    }


def worst(stands: Sequence[Mapping[str, object]], key: str) -> float:
    """Largest error after compensation of a kind over runs."""
    found = []
    for one in stands:
        after = one["after"]
        assert isinstance(after, dict)  # noqa: S101 (narrows the JSON object that `stand` made)
        found.append(float(after[key]))
    return max(found)
