"""What the dwells of a campaign share, and what a recipe states of it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calibkit.coefficients import Component
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.numeric import shared_errors
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric.least_squares.components import Effect, Known
from calibkit.recipe.shared_errors import state_effects

SHARED_UNITS = {
    ("soak", "zero"): "g",
    ("soak", "scale"): "1",
    ("session", "drift"): "g/h",
    ("attitude", "index"): "rad",
    shared_errors.SET_UP: "rad",
    ("table", "tilt"): "rad",
    ("table", "eccentricity"): "rad",
    ("sensor", "second order"): "1/g",
}
"""Errors that dwells share and the units of their standard deviations."""


def refine_with(
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    *,
    affine: bool = False,
    held: Sequence[Component] | None = None,
) -> Refine:
    """Fit with the errors that dwells share; of an affine triad the recipe makes some of them
    coefficients. `held` are the errors of a fit before, whose sizes are kept.
    """
    own = {
        "tilt": spec.affine.tilt,
        "second order": spec.affine.second_order,
        "set-up": spec.affine.fixture,
    }
    known = spec.reference.kind == "attitude"
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    timed = _tells_time(dwells) and soak.max() > 0
    where = shared_errors.Circumstances(
        soak,
        dwells.time / 3600.0 if timed else None,
        dwells.reference if known else dwells.indication,
        np.radians(dwells.inclination) if known else None,
        np.radians(dwells.toolface) if known else None,
    )

    def state(
        effects: Sequence[Effect], candidates: Sequence[Effect]
    ) -> tuple[Sequence[Effect], Sequence[Effect]]:
        if held is not None:
            sizes = {(one.group, one.effect): Known(one.value) for one in held}
            named = [(one, sizes.get((one.group, one.effect))) for one in (*effects, *candidates)]
            return [replace(one, known=size) for one, size in named if size is not None], ()
        tried = [one for one in candidates if not (affine and own.get(one.effect))]
        sure, perhaps = state_effects(spec.errors, effects, tried, SHARED_UNITS)
        return sure, [one for one in perhaps if (one.group, one.effect) != shared_errors.SET_UP]

    return partial(shared_errors.refine, where=where, state=state)


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
