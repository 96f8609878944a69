"""What the dwells of a campaign share, and what a recipe states of it."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.numeric import shared_errors
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric.least_squares.components import Effect
from calibkit.recipe.shared_errors import state_effects

SHARED_UNITS = {
    ("soak", "zero"): "g",
    ("soak", "scale"): "1",
    ("session", "drift"): "g/h",
    ("attitude", "index"): "rad",
    ("table", "tilt"): "rad",
    ("table", "eccentricity"): "rad",
    ("sensor", "second order"): "1/g",
}
"""Errors that dwells share and the units of their standard deviations."""


def refine_with(dwells: DwellSet, spec: AccelerometerRecipe, *, affine: bool = False) -> Refine:
    """Fit with the errors that dwells share; of an affine triad the recipe makes some of them
    coefficients.
    """
    own = {
        "tilt": spec.affine.tilt,
        "second order": spec.affine.second_order,
    }
    known = spec.reference.kind == "attitude"
    soak = shared_errors.number_soaks(dwells.temperature, dwells.log)
    # the clocks of several logs have no common start
    timed = dwells.log.max() == 0 and np.isfinite(dwells.time).all() and soak.max() > 0
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
        tried = [one for one in candidates if not (affine and own.get(one.effect))]
        return state_effects(spec.errors, effects, tried, SHARED_UNITS)

    return partial(shared_errors.refine, where=where, state=state)
