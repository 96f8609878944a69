"""How s(T) moves with errors of the latitude, the thermometer, the gyros and the index of the
positions.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit.coefficients import StageResult
from calibkit.instruments.inclinometer import coefficient_files, solve, stations
from calibkit.instruments.inclinometer.forms import TEMPERATURE, ScaleFit
from calibkit.instruments.inclinometer.numeric.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.rows import Rows
from calibkit.sensitivities import InputError, Sensitivity, differentiate, of_thermometer

LATITUDE_STEP_DEG, INDEX_STEP_DEG, SHARE = 1e-3, 1e-3, 1e-5


def find(
    fits: Mapping[Sensor, ScaleFit], rows: Rows, spec: InclinometerRecipe
) -> tuple[Sensitivity, ...]:
    """Sensitivities of s(T) of every gyro, its order held."""
    errors = [
        InputError("latitude_deg", "offset", LATITUDE_STEP_DEG),
        InputError("position_deg", "offset", INDEX_STEP_DEG),
        *(InputError(f"gyro_{axis}_dph", "scale", SHARE) for axis in spec.axes),
    ]
    known = rows.temperature[np.isfinite(rows.temperature)]
    if known.size:
        errors += of_thermometer(TEMPERATURE, float(known.min()), float(known.max()))
    held = {
        order: [axis for axis, fit in fits.items() if fit.model.coefficients.size == order + 1]
        for order in {fit.model.coefficients.size - 1 for fit in fits.values()}
    }

    def refit(moved: Rows, where: InclinometerRecipe) -> list[StageResult]:
        found = []
        for order, axes in held.items():
            scale = where.scale.model_copy(update={"order": order})
            fixed = where.model_copy(update={"scale": scale})
            solved = stations.solve_components(moved, fixed)
            again, seen = solve.fit_scale(solved, fixed)
            own = {axis: again[axis] for axis in axes}
            found.append(coefficient_files.make_result(own, solved, seen, (), fixed, None))
        return found

    def shift(error: InputError) -> list[StageResult]:
        if error.input == "latitude_deg":
            site = spec.site.model_copy(
                update={"latitude_deg": error.shift(spec.site.latitude_deg)}
            )
            return refit(rows, spec.model_copy(update={"site": site}))
        return refit(_shift(rows, error), spec)

    return differentiate(errors, refit(rows, spec), shift)


def _shift(rows: Rows, error: InputError) -> Rows:
    """Rows with an error of the positions, of a gyro or of the thermometer."""
    if error.input == "position_deg":
        return replace(rows, position=error.shift(rows.position))
    if error.input == TEMPERATURE:
        return replace(rows, temperature=error.shift(rows.temperature))
    gyro = {
        axis: error.shift(readings) if error.input == f"gyro_{axis}_dph" else readings
        for axis, readings in rows.gyro.items()
    }
    return replace(rows, gyro=gyro)
