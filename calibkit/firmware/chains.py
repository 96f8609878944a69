"""Which chain a run's coefficient files make."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.errors import OutputError
from calibkit.firmware import scale_chain
from calibkit.instruments.accelerometer import firmware as triad_chain
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.fog_thermal import firmware
from calibkit.instruments.gyro_scale import axes_firmware
from calibkit.instruments.gyro_scale.recipe import (
    GyroPairRecipe,
    GyroTriadRecipe,
    OwnAxisRecipe,
    RateTableRecipe,
)
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.recipe import BiasTemperatureRecipe, FogThermalRecipe

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.coefficients import Record
    from calibkit.firmware.chain import Chain
    from calibkit.recipe import Recipe


def files(spec: Recipe) -> tuple[str, ...]:
    """Coefficient files that the chain of a run takes its numbers from."""
    if isinstance(spec, AccelerometerRecipe):
        by_compensation = {
            "affine": ("accel_affine",),
            "k": ("accel_k",),
            "kq": ("accel_k", "accel_q"),
        }
        stages: tuple[str, ...] = by_compensation[spec.compensation]
    else:
        stages = {
            "fog_thermal": ("drift_rate",),
            "inclinometer": ("inclinometer_scale",),
            "bias_temperature": ("bias",),
            "gyro_pair": ("gyro_scale", "gyro_orthogonality"),
            "gyro_triad": ("gyro_scale", "gyro_orthogonality"),
            "rate_table": ("gyro_scale",),
        }.get(spec.procedure, ())
    return tuple(f"{stage}.json" for stage in stages)


def of(spec: Recipe, records: Mapping[str, Record]) -> Chain:  # noqa: PLR0911 (one return a procedure)
    """Chain of a run: the correction that its recipe chose, with the numbers of its coefficient
    files.
    """
    if isinstance(spec, FogThermalRecipe):
        record = _record(records, "drift_rate.json", spec)
        mode, window = spec.drift.compensation, spec.segments.slope_window_s
        return firmware.chain(record.models, spec.reference_temp_degc, mode, window)
    if isinstance(spec, AccelerometerRecipe):
        return triad_chain.chain(records, spec.compensation, spec.reference.convention)
    if isinstance(spec, InclinometerRecipe):
        return scale_chain.inclinometer(_record(records, "inclinometer_scale.json", spec))
    if isinstance(spec, BiasTemperatureRecipe):
        return scale_chain.bias(_record(records, "bias.json", spec), spec.reference_temp_degc)
    if isinstance(spec, GyroPairRecipe):
        scale, angle = (
            _record(records, f"gyro_{name}.json", spec) for name in ("scale", "orthogonality")
        )
        return scale_chain.gyro(
            scale, angle, (("a", "a_about_a"), ("b", "b_about_b")), _earth_rate(scale, spec)
        )
    if isinstance(spec, RateTableRecipe):
        scale = _record(records, "gyro_scale.json", spec)
        return scale_chain.gyro(
            scale, None, [(g, f"gyro_{g}") for g in spec.gyros], _earth_rate(scale, spec)
        )
    if isinstance(spec, GyroTriadRecipe):
        scale, angle = (
            _record(records, f"gyro_{name}.json", spec) for name in ("scale", "orthogonality")
        )
        return axes_firmware.chain(scale, angle, spec.gyros)
    raise OutputError(
        f"procedure '{spec.procedure}' has no firmware form", hint="nothing can be exported"
    )


def _record(records: Mapping[str, Record], name: str, spec: Recipe) -> Record:
    """A coefficient file of the run."""
    if name not in records:
        raise OutputError(f"the run holds no {name}", hint=f"it is not a run of {spec.procedure}")
    return records[name]


def _earth_rate(record: Record, spec: OwnAxisRecipe) -> float:
    """Earth's rate about the laboratory's table axis [°/s], where the recipe leaves it in the
    result.
    """
    if spec.compensation == "laboratory":
        return 0.0
    for condition in record.conditions:
        if condition.name == "earth_rate_about_table_axis":
            return condition.value
    raise OutputError(
        "the run does not know the earth's rate about its table axis",
        hint="fit with [site] latitude_deg",
    )
