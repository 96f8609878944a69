"""Magnitude-only fit with errors that dwells share."""

from dataclasses import replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.instruments.accelerometer.numeric import magnitude
from calibkit.instruments.accelerometer.numeric.magnitude import MagnitudeFit
from calibkit.instruments.accelerometer.numeric.norms import length_residuals, lower_matrix
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine, Residuals


def fit(
    indication: Array,
    gravity: float = 1.0,
    *,
    noise: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
    refine: Refine | None,
) -> MagnitudeFit:
    """Fit the nine parameters, then again with errors that dwells share.

    Parameters
    ----------
    indication, gravity, noise, loss
        As for `magnitude.fit`.
    refine
        `shared_errors.refine` with the circumstances of the dwells; None leaves the first fit.

    Raises
    ------
    FitError
        As `magnitude.fit`.

    """
    found = magnitude.fit(indication, gravity, noise=noise, loss=loss)
    if refine is None or found.dof <= 0:
        return found
    triangle = magnitude.to_triangle(found.parameters)
    root = np.ones(len(indication)) if noise is None else 1.0 / noise

    def linearised(values: Array, dwells: Integers) -> tuple[Array, Array]:
        return length_residuals(values, indication[dwells], gravity, np.ones(len(dwells)))

    refined = refine(
        linearised,
        triangle,
        at=Residuals.of_lengths((indication - triangle[6:]) @ lower_matrix(triangle[:6]).T),
        weights=root**2,
        used=~np.isin(np.arange(len(indication)), found.suspects),
        leave_out=loss == "robust",
        names=magnitude.TRIANGLE_NAMES,
    )
    mixed = refined.shared.found
    at = refined.parameters, mixed.covariance, indication, gravity, root
    finished = magnitude.complete_fit(*at, (mixed.condition, None), kept=refined.used)
    suspects = tuple(np.flatnonzero(~refined.used).tolist())
    slopes = magnitude.parameter_slopes(refined.parameters, gravity)
    return replace(
        finished,
        suspects=suspects,
        left_out=suspects,
        effective_dof=mixed.effective_dof_of(slopes),
        mixed=mixed,
        lack_of_fit=refined.lack_of_fit,
        flags=(*finished.flags, *refined.flags),
    )
