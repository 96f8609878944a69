"""How s(T) moves with errors of the latitude, the thermometer, the gyros and the index of the
positions.
"""

from dataclasses import replace

import numpy as np

from calibkit.coefficients import StageResult
from calibkit.instruments.inclinometer import coefficient_files, solve, stations
from calibkit.instruments.inclinometer.forms import TEMPERATURE
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.rows import Rows
from calibkit.sensitivities import InputError, Sensitivity, differentiate, of_thermometer

LATITUDE_STEP_DEG, INDEX_STEP_DEG, SHARE = 1e-3, 1e-3, 1e-5


def find(rows: Rows, spec: InclinometerRecipe) -> tuple[Sensitivity, ...]:
    """Sensitivities of s(T) of every gyro."""
    errors = [
        InputError("latitude_deg", "offset", LATITUDE_STEP_DEG),
        InputError("position_deg", "offset", INDEX_STEP_DEG),
        *(InputError(f"gyro_{axis}_dph", "scale", SHARE) for axis in spec.axes),
    ]
    known = rows.temperature[np.isfinite(rows.temperature)]
    if known.size:
        errors += of_thermometer(TEMPERATURE, float(known.min()), float(known.max()))

    def refit(moved: Rows, where: InclinometerRecipe) -> list[StageResult]:
        solved = stations.solve_components(moved, where)
        fits, seen = solve.fit_scale(solved, where)
        return [coefficient_files.make_result(fits, solved, seen, (), where, None)]

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
