"""gyro_scale.json → compensated rates of a log, and how frozen coefficients stand on runs they have
not seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit import check
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import CoefficientError
from calibkit.frame import refuse, require, values
from calibkit.ingest import logs
from calibkit.instruments.gyro_scale import shape as gyro_shape
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.runs import TEMPERATURE, column
from calibkit.numeric import chunks
from calibkit.numeric.dispersion import rms

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.arrays import Array
    from calibkit.coefficients import Record
    from calibkit.frame import Log
    from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
    from calibkit.instruments.gyro_scale.runs import TableRun


PPM = 1e6
TEMPERATURE_SLACK = 5.0
"""Kelvin beyond the fitted temperatures at which one K for all of them is still used without a
flag.
"""


@dataclass(frozen=True, slots=True)
class Frozen:
    """Coefficients of one gyro as they leave the file: K and F0 as powers of temperature, the shape
    of its response.
    """

    gyro: str
    K: Array
    F0: Array
    K_covariance: Array
    temperature: tuple[float, float] | None
    reference: tuple[float, float]
    shape: gyro_shape.Shape | None

    @property
    def over_temperature(self) -> bool:
        """Whether a temperature is needed."""
        return self.K.size > 1 or self.F0.size > 1

    def line(self, temperature: Array) -> tuple[Array, Array]:
        """K [n] and F0 [n] at temperatures [n], clamped to the fitted ones."""
        held = (
            np.clip(temperature, *self.temperature)
            if self.temperature
            else np.zeros_like(temperature)
        )
        polyval = np.polynomial.polynomial.polyval
        return np.asarray(polyval(held, self.K)), np.asarray(polyval(held, self.F0))

    def u_K(self, temperature: float) -> float:  # noqa: N802 - the letter of the standards
        """Standard uncertainty of K at a temperature, clamped to the fitted ones."""
        held = (
            min(max(temperature, self.temperature[0]), self.temperature[1])
            if self.temperature
            else 0.0
        )
        powers = held ** np.arange(self.K.size) if self.K.size > 1 else np.ones(1)
        return float(np.sqrt(powers @ self.K_covariance @ powers))

    def rate(self, indication: Array, temperature: Array) -> Array:
        """Rate [n, °/s] of indications [n, 1/s], zero where the gyro rested on the laboratory's
        table.
        """
        K, F0 = self.line(temperature)
        indicated = (indication - F0) / K
        return self.shape.inverse(indicated) if self.shape else indicated


def frozen(records: Mapping[str, Record], gyro: str, name: str) -> Frozen:
    """Coefficients of a gyro from the model of that name and what stands beside it: K and F0 over
    temperature, response.
    """
    if "gyro_scale.json" not in records:
        raise CoefficientError(
            "the run holds no gyro_scale.json", hint="it is not a run of a rate table"
        )
    record = records["gyro_scale.json"]
    models = {model.name: model for model in record.models}
    line = record.model(name)
    reference = (line.value("K"), line.value("F0"))
    shape = (
        gyro_shape.shape_of(models[f"{name}.response"]) if f"{name}.response" in models else None
    )
    over_K, over_F0 = (models.get(f"{name}.{letter}_over_temperature") for letter in ("K", "F0"))
    if over_K is None or over_F0 is None:
        K, F0 = (np.array([value]) for value in reference)
        covariance = np.array(line.covariance)[:1, :1]
        return Frozen(gyro, K, F0, covariance, line.valid.get(TEMPERATURE), reference, shape)
    K, F0 = (np.array([c.value for c in model.coefficients]) for model in (over_K, over_F0))
    return Frozen(
        gyro, K, F0, np.array(over_K.covariance), over_K.valid[TEMPERATURE], reference, shape
    )


def earth_rate(records: Mapping[str, Record], spec: OwnAxisRecipe) -> float:
    """What is added to the compensated rate [°/s]: the laboratory's earth rate about the table
    axis, or nothing.
    """
    if spec.compensation == "laboratory":
        return 0.0
    for condition in records["gyro_scale.json"].conditions:
        if condition.name == "earth_rate_about_table_axis":
            return condition.value
    raise CoefficientError(
        "the run does not know the earth's rate about its table axis",
        hint="fit with [site] latitude_deg",
    )


def read(spec: GyroRecipe, data: Path, coefficients: Sequence[Frozen]) -> Log:
    """One log to be compensated: those gyros that it has, and the temperature where it is
    logged.
    """
    columns = [column(one.gyro) for one in coefficients]
    log = logs.read_log(spec, data, data.name, (), ("time_s", TEMPERATURE, *columns))
    if not set(columns) & set(log.frame.columns):
        log = logs.read_log(spec, data, data.name, columns[:1], ())
    refuse(
        [*check.find_too_few_rows(log, 1), *check.find_missing_values(log, list(log.frame.columns))]
    )
    if TEMPERATURE in log.frame.columns:
        refuse(check.find_implausible_temperatures(log, [TEMPERATURE]))
    return log


def compensated(
    log: Log, coefficients: Sequence[Frozen], added_dps: float
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Derived columns gyro_<axis>_dps of the gyros that a log has, and what must be said of
    them.
    """
    derived, flags = {}, []
    for one in coefficients:
        if column(one.gyro) not in log.frame.columns:
            flags.append(f"{log.file}: no column '{column(one.gyro)}', gyro {one.gyro} is left out")
            continue
        if one.over_temperature:
            require(log.file, log.frame.columns, [TEMPERATURE])
        known = TEMPERATURE in log.frame.columns
        temperature = (
            values(log.frame, TEMPERATURE) if known else np.broadcast_to(0.0, len(log.frame))
        )
        derived[f"gyro_{one.gyro}_dps"], beyond = _rates(log, one, temperature, added_dps)
        flags += _temperature_flags(log, one, temperature if known else None)
        flags += _rate_flags(log, one, beyond)
    if added_dps == 0.0:
        flags.append(
            "rates are zero where the gyro rested on the laboratory's table: the earth's rate there"
            " is taken out with the bias (compensation = 'inertial' leaves it in)"
        )
    return derived, tuple(dict.fromkeys(flags))


def _rates(log: Log, one: Frozen, temperature: Array, added_dps: float) -> tuple[Array, float]:
    """Compensated rates [n, °/s] of one gyro, and the share of them beyond those of its
    response.
    """
    indication, made, beyond = values(log.frame, column(one.gyro)), log.room(temperature.size), 0
    low, high = one.shape.limits if one.shape else (-np.inf, np.inf)
    for a, b in chunks.ranges_along(indication, temperature, made):
        rate = one.rate(indication[a:b], temperature[a:b])
        beyond += int(np.count_nonzero((rate < low) | (rate > high)))
        made[a:b] = rate + added_dps
    return made, beyond / temperature.size


def _temperature_flags(log: Log, one: Frozen, temperature: Array | None) -> list[str]:
    """Temperatures that are clamped, or at which one K for all temperatures was not found."""
    if temperature is None or one.temperature is None:
        return []
    slack = 0.0 if one.over_temperature else TEMPERATURE_SLACK
    low, high = one.temperature
    beyond = chunks.count(temperature, lambda part: (part < low - slack) | (part > high + slack))
    outside = 100.0 * beyond / temperature.size
    if outside == 0.0:
        return []
    what = "clamped" if one.over_temperature else "but K and F0 are taken as constant"
    return [
        (
            f"{log.file}: temperature outside {low:.1f} … {high:.1f} °C over {outside:.1f} % of the"
            f" rows, {what}"
        )
    ]


def _rate_flags(log: Log, one: Frozen, beyond: float) -> list[str]:
    """Share of rates beyond those of the response."""
    if one.shape is None or beyond == 0.0:
        return []
    low, high = one.shape.limits
    said = f"{log.file}: gyro {one.gyro} beyond the fitted {low:g} to {high:g} °/s"
    return [f"{said} over {100.0 * beyond:.1f} % of the rows"]


def stand(run: TableRun, one: Frozen, spec: GyroRecipe) -> dict[str, object]:
    """JSON object: one gyro of a run that was not fitted, under its frozen coefficients and without
    them.
    """
    line, noise = run.scale(one.gyro), run.noise(one.gyro)
    temperature = (
        run.plateaus.temp_degc if np.isfinite(run.temp_degc) else np.zeros_like(line.rate_dps)
    )
    if one.over_temperature and not np.isfinite(run.temp_degc):
        require(run.log.file, run.log.frame.columns, [TEMPERATURE])
    K = float(one.line(np.array([temperature.mean()]))[0][0])
    u_frozen, u_found = one.u_K(float(temperature.mean())), float(line.standard_uncertainty[0])
    after = one.rate(line.indication, temperature)
    K_before, F0_before = one.reference
    if spec.nominal_scale_factor is not None:
        K_before, F0_before = spec.nominal_scale_factor, 0.0
    before = (line.indication - F0_before) / K_before
    gain = float(line.solver[0] @ after)
    asymmetry = {f.name: f.value for f in gjb_figures.figures(line, noise) if f.unit == "ppm"}
    return {
        "gyro": one.gyro,
        "K": line.K,
        "K_standard_uncertainty": u_found,
        "K_frozen": K,
        "K_frozen_standard_uncertainty": u_frozen,
        "scale_factor_error_ppm": (line.K / K - 1.0) * PPM,
        "scale_factor_error_standard_uncertainty_ppm": (
            float(np.hypot(u_found, u_frozen) / abs(K)) * PPM
        ),
        "zero_error_dph": (
            (line.F0 / line.K - float(one.line(temperature)[1].mean()) / K) * DPH_PER_DPS
        ),
        "rate_gain": gain,
        "before_is": (
            "nominal scale factor"
            if spec.nominal_scale_factor is not None
            else "K and F0 of the mean model"
        ),
        "before": _errors(before, line.rate_dps, line.solver[0]),
        "after": _errors(after, line.rate_dps, line.solver[0]),
        **{f"{name}_ppm": value for name, value in asymmetry.items()},
    }


def _errors(rate: Array, reference: Array, slope: Array) -> dict[str, float]:
    """How rates [p] stand against the table's: slope error, rms and largest error over full
    scale.
    """
    error = rate - reference
    full = float(np.max(np.abs(reference)))
    return {
        "scale_factor_error_ppm": (float(slope @ rate) - 1.0) * PPM,
        "rate_error_rms_dps": rms(error),
        "rate_error_max_ppm_of_full_scale": float(np.max(np.abs(error))) / full * PPM,
    }


def run_flags(run: TableRun, one: Frozen) -> list[str]:
    """Temperatures of an unseen run that the coefficients do not cover."""
    return _temperature_flags(
        run.log, one, run.plateaus.temp_degc if np.isfinite(run.temp_degc) else None
    )
