"""How the coefficients of a triad move with errors of the table's angles, the thermometer and local
gravity.
"""

from dataclasses import replace

from calibkit.coefficients import StageResult
from calibkit.instruments.accelerometer import coefficient_files
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.fit import TriadFit, list_models
from calibkit.instruments.accelerometer.forms import COMPONENTS, TEMPERATURE
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.sensitivities import (
    InputError,
    Sensitivity,
    differentiate,
    of_thermometer,
)

FIELDS = {
    "inclination_deg": "inclination",
    "toolface_deg": "toolface",
    TEMPERATURE: "temperature",
    "gravity_mps2": "indication",
}
"""Input → array of the dwells that its error shifts."""
ANGLE_STEP_DEG, GRAVITY_STEP = 1e-3, 1e-5


def find(fitted: TriadFit, dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Sensitivity, ...]:
    """Sensitivities of the coefficients of a fit to `dwells`."""
    errors = [*of_thermometer(TEMPERATURE, *dwells.valid[TEMPERATURE])]
    if spec.reference.kind == "attitude":
        names = ("inclination_deg", "toolface_deg")
        errors += [InputError(name, "offset", ANGLE_STEP_DEG) for name in names]
    gravity = spec.site.local_gravity()
    if gravity is not None and any(
        name in spec.columns and spec.columns[name].unit == "m/s^2" for name in COMPONENTS
    ):
        errors.append(InputError("gravity_mps2", "offset", GRAVITY_STEP * gravity))

    def shift(error: InputError) -> DwellSet:
        field = FIELDS[error.input]
        values = getattr(dwells, field)
        if error.input == "gravity_mps2":  # what is logged in m/s² is divided by it
            assert gravity is not None  # noqa: S101 (no such error otherwise)
            return replace(dwells, indication=values / (1.0 + error.step / gravity))
        return replace(dwells, **{field: error.shift(values)})

    def models(shifted: DwellSet, triad: Triad) -> tuple[StageResult, ...]:
        k, _, q, affine = list_models(shifted, spec, triad)
        moved = replace(fitted, k=k, q=q, affine=affine, intervals=())
        return coefficient_files.list_results(moved, shifted, gravity, ())

    shifted = [shift(error) for error in errors]
    triads = fitted.triad.shifted(dwells, shifted)
    results = dict(zip(errors, map(models, shifted, triads), strict=True))
    return differentiate(errors, models(dwells, fitted.triad), results.__getitem__)
