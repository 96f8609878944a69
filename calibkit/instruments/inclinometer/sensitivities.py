"""How s(T) moves with errors of the latitude, the thermometer, the gyros and the index of the
positions: the roots of shifted stations, with the weights of the fit.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.inclinometer import mounting, published, stations
from calibkit.instruments.inclinometer.forms import TEMPERATURE, ScaleFit
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.rows import Rows
from calibkit.sensitivities import ROUNDING, InputError, Sensitivity, of_thermometer

LATITUDE_STEP_DEG, INDEX_STEP_DEG, SHARE = 1e-3, 1e-3, 1e-5


def find(
    fits: Mapping[Sensor, ScaleFit], rows: Rows, spec: InclinometerRecipe
) -> tuple[Sensitivity, ...]:
    """Sensitivities of s(T) of every gyro, by differences on both sides."""
    errors = [
        InputError("latitude_deg", "offset", LATITUDE_STEP_DEG),
        InputError("position_deg", "offset", INDEX_STEP_DEG),
        *(InputError(f"gyro_{axis}_dph", "scale", SHARE) for axis in spec.axes),
    ]
    known = rows.temperature[np.isfinite(rows.temperature)]
    if known.size:
        errors += of_thermometer(TEMPERATURE, float(known.min()), float(known.max()))
    sensitivities = []
    for error in errors:
        up = _changes(fits, *_shift(rows, spec, error))
        down = _changes(fits, *_shift(rows, spec, replace(error, step=-error.step)))
        derivatives: dict[str, float] = {}
        for axis, fit in fits.items():
            change = up[axis] - down[axis]
            at, model = spec.reference_temp_degc, fit.model
            powers = np.clip(at, *(model.valid or (at, at))) ** np.arange(change.size)
            values = {f"{axis}.s{k}": float(part) for k, part in enumerate(change)}
            values[f"s_{axis}"] = float(powers @ change)
            least = ROUNDING * np.append(np.abs(model.coefficients), abs(model.coefficients[0]))
            derivatives |= {
                f"inclinometer_scale.{name}": value / (2.0 * error.step)
                for (name, value), rounding in zip(values.items(), least, strict=True)
                if abs(value) > rounding
            }
        sensitivities.append(Sensitivity(error.input, error.kind, derivatives))
    return tuple(sensitivities)


def _changes(
    fits: Mapping[Sensor, ScaleFit], rows: Rows, spec: InclinometerRecipe
) -> dict[Sensor, Array]:
    """Changes of the coefficients by the stations of shifted rows."""
    shifted = stations.solve_components(rows, spec)
    changes = {}
    for axis, fit in fits.items():
        parts = shifted.components[axis]
        attitude = published.attitude(parts.accel_x, parts.accel_y)
        roots = published.scale_roots(parts.gyro_x, parts.gyro_y, attitude, spec.site.latitude_deg)
        # of both roots the one that was fitted
        before = np.ones(fit.used.size)
        before[fit.used] = fit.model.coefficients[0] if fit.over is None else fit.over.roots.s
        nearer = np.abs(roots.plus - before) <= np.abs(roots.minus - before)
        s = np.where(nearer, roots.plus, roots.minus)
        if fit.over is None:
            changes[axis] = s[fit.used] - before[fit.used]
            continue
        turn = mounting.turn_slopes(nearer, shifted, spec, axis)
        changes[axis] = fit.over.shifted(s, turn, np.nan_to_num(shifted.temperature))
    return changes


def _shift(
    rows: Rows, spec: InclinometerRecipe, error: InputError
) -> tuple[Rows, InclinometerRecipe]:
    """Rows and recipe with an error of the latitude, the positions, a gyro or the thermometer."""
    if error.input == "latitude_deg":
        site = spec.site.model_copy(update={"latitude_deg": error.shift(spec.site.latitude_deg)})
        return rows, spec.model_copy(update={"site": site})
    if error.input == "position_deg":
        return replace(rows, position=error.shift(rows.position)), spec
    if error.input == TEMPERATURE:
        return replace(rows, temperature=error.shift(rows.temperature)), spec
    gyro = {
        axis: error.shift(readings) if error.input == f"gyro_{axis}_dph" else readings
        for axis, readings in rows.gyro.items()
    }
    return replace(rows, gyro=gyro), spec
