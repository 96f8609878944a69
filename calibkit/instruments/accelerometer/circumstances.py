"""What the dwells of a campaign share, and what a recipe states of it."""

import numpy as np

from calibkit.arrays import Array
from calibkit.fit.shared import Shared
from calibkit.instruments.accelerometer import shared_errors
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import Circumstances
from calibkit.recipe.shared_errors import state_sizes


def find_circumstances(
    dwells: DwellSet, gravity: Array, spec: AccelerometerRecipe
) -> Circumstances:
    """What the dwells of all logs have in common, at gravity vectors [n, 3] [g]."""
    known = spec.reference.kind == "attitude"
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    timed = _tells_time(dwells) and soak.max() > 0
    return Circumstances(
        soak,
        dwells.time / 3600.0 if timed else None,
        gravity,
        dwells.log,
        np.radians(dwells.inclination) if known else None,
        np.radians(dwells.toolface) if known else None,
    )


def state_errors(where: Circumstances, along: Array, spec: AccelerometerRecipe) -> list[Shared]:
    """Errors that the dwells share, with the sizes that the recipe states.

    `along` [n, m, 3] are the directions of the residuals.
    """
    listed = shared_errors.list_errors(where, along)
    # what the recipe makes a parameter is no error
    parameters = {
        "tilt": spec.affine.tilt,
        "second order": spec.affine.second_order,
        "set-up": spec.affine.fixture,
    }
    stated = state_sizes(
        spec.errors,
        [one for one in listed if not (spec.affine.enabled and parameters.get(one.effect))],
    )
    # no dwell tells a set-up from axes that are turned together, nor a scale factor that all dwells
    # share from that of the triad
    alike = {shared_errors.SET_UP} | ({("soak", "scale")} if where.soak.max() == 0 else set())
    return [one for one in stated if (one.group, one.effect) not in alike or one.size is not None]


def warn_of_set_up(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Flag for a set-up in the fixture of which nothing is known: no dwell tells it from axes that
    are turned together.
    """
    stated = [(one.group, one.effect) for one in spec.errors.component]
    angles = [one for one in spec.type_b if one.quantity in {"inclination_deg", "toolface_deg"}]
    known = spec.affine.fixture or angles or shared_errors.SET_UP in stated
    if known or spec.reference.kind != "attitude":
        return ()
    group, effect = shared_errors.SET_UP
    flag = (
        "an error in setting up the triad in its fixture turns every corrected vector, and the"
        f' uncertainties leave it out: state its size in [[errors.component]] group = "{group}",'
        f' effect = "{effect}", or in [[type_b]] of inclination_deg and toolface_deg'
    )
    return (flag,)


def warn_of_order(dwells: DwellSet) -> tuple[str, ...]:
    """Flag for temperatures that only rise or only fall from soak to soak: a zero that drifts with
    time looks like one that follows temperature.
    """
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    level = np.bincount(soak, dwells.temperature) / np.bincount(soak)
    steps = np.sign(np.diff(level))
    if steps.size < 2 or abs(steps.sum()) < steps.size:
        return ()
    cure = "return to the first temperature at the end"
    if _tells_time(dwells):
        flag = (
            "temperature follows time: U of what follows temperature holds any drift of the zero"
            f" that the dwells of a soak allow; {cure}, or state the drift of the session in"
            " [[errors.component]]"
        )
    else:
        flag = (
            "temperature follows the order of the rows and no time_s is logged: a zero that drifts"
            f" would be taken for one that follows temperature; log time_s, and {cure}"
        )
    return (flag,)


def _tells_time(dwells: DwellSet) -> bool:
    """Whether the dwells have one clock; those of several logs have no common start."""
    return bool(dwells.log.max() == 0 and np.isfinite(dwells.time).all())
