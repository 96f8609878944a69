"""A campaign of a triad that was run by a plan: physical sensors, with the errors that the plan
assumes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.instruments.accelerometer import shared_errors, simulate
from calibkit.instruments.accelerometer.shared_errors import Circumstances
from calibkit.numeric import attitude
from calibkit.recipe.tables import ErrorComponent
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.planning.schedule import Schedule

CHAMBER_DEGC = 0.1
"""Standard deviation of the temperature that is reached about the set point."""
THERMOMETER_DEGC = 0.002
"""Standard deviation of a thermometer reading that is averaged over a dwell."""


def campaign(
    spec: AccelerometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of a campaign by a schedule, and its truth."""
    rng = np.random.default_rng(seed)
    sensors = simulate.draw_triad(rng)
    stated = [ErrorComponent.model_validate(one) for one in document["components"]]
    # these sensors have errors of their own
    components = [one for one in stated if one.group != "sensor"]
    dwells = schedule.recorded("dwell")
    rows, truth = draw_rows(
        rng,
        lambda gravity, degc: simulate.indications(sensors, gravity, degc),
        np.array([(one.inclination_deg, one.toolface_deg) for one in dwells]),
        np.array([one.set_degc for one in dwells]),
        np.array([one.start_s + one.duration_s / 2.0 for one in dwells]),
        document["settings"]["noise_g"],
        components,
    )
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    for axis in simulate.AXES:
        rows[f"accel_{axis}_g"] = sign * rows[f"accel_{axis}_g"]
    names = np.array([one.log for one in dwells])
    logs = {
        name: {column: values[names == name] for column, values in rows.items()}
        for name in dict.fromkeys(names.tolist())
    }
    truth |= {"seed": seed, "plan": document["sha256"], "sensors": simulate.describe(sensors)}
    return Campaign(logs, simulate.DECIMALS, truth)


def draw_rows(
    rng: np.random.Generator,
    indicate: Callable[[Array, Array], Array],
    spots: Array,
    degc: Array,
    time_s: Array,
    noise_g: float,
    components: Sequence[ErrorComponent],
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Canonical columns of dwells at attitudes [n, 2] [°] and temperatures [n] [°C], and the
    shared errors that were drawn.

    Errors of the table and the fixture turn gravity before the sensors see it; those of the
    sensors are added to what they indicate.
    """
    soak = _number_soaks(degc)
    tilt, roll = np.radians(spots).T
    one_log = np.zeros(len(soak), dtype=np.int64)
    gravity = attitude.gravity_vector(*spots.T)
    where = Circumstances(soak, time_s / 3600.0, gravity, one_log, tilt, roll)
    axes = np.broadcast_to(np.eye(3), (len(soak), 3, 3))
    sizes = {
        (one.group, one.effect): one.value_in(shared_errors.UNITS[one.group, one.effect])
        for one in components
    }
    of_gravity, of_sensors = np.zeros((len(soak), 3)), np.zeros((len(soak), 3))
    drawn: dict[str, Any] = {}
    for shared in shared_errors.list_errors(where, axes):
        name = (shared.group, shared.effect)
        error = rng.normal(0.0, 1.0, (shared.levels, shared.width)) * sizes.get(name, 0.0)
        drawn[f"{shared.effect} of the {shared.group}"] = error.tolist()
        turned = shared.unit == "rad"
        (of_gravity if turned else of_sensors)[:] += shared.along(error).reshape(-1, 3)
    seen = where.gravity + of_gravity
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    case = degc + rng.normal(0.0, CHAMBER_DEGC, degc.size)[soak]
    indicated = indicate(seen, case) + of_sensors + rng.normal(0.0, noise_g, seen.shape)
    return {
        "time_s": time_s,
        "temp_case_degc": case + rng.normal(0.0, THERMOMETER_DEGC, degc.size),
        "inclination_deg": spots[:, 0],
        "toolface_deg": spots[:, 1],
        **{f"accel_{name}_g": indicated[:, i] for i, name in enumerate(simulate.AXES)},
    }, {"shared_errors": drawn}


def _number_soaks(degc: Array) -> Integers:
    """Number of the soak of each dwell."""
    return np.cumsum(np.diff(degc, prepend=degc[:1]) != 0.0)
