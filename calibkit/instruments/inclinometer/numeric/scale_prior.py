"""Prior of s at a station: from the history of the stations before it, or from s(T) over a
calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric.root_choice import (
    DEFAULT_LIMITS,
    Estimates,
    Limits,
    Prior,
    Solution,
    estimate_roots,
    solve,
)
from calibkit.instruments.inclinometer.published import Components
from calibkit.numeric import gum
from calibkit.numeric.least_squares import polynomial


@dataclass(frozen=True, slots=True)
class History:
    """Initial state and process noise of s along the stations, per unit of the abscissa: hours, or
    stations.
    """

    s: float = 1.0
    standard_uncertainty: float = 0.01
    rate: float = 0.0
    """Change of s per unit."""
    rate_uncertainty: float = 1e-3
    rate_walk: float = 1e-3
    """Random walk of the rate, per unit and square root of unit."""


DEFAULT_HISTORY = History()


def predict_scale(
    coefficients: Array,
    covariance: Array,
    scatter: float,
    valid_degc: tuple[float, float],
    temp_degc: ArrayLike,
) -> Prior:
    """Prior [n] of s at temperatures [n] [°C] from the s(T) of a coefficient file.

    Temperatures are clamped to the fitted range; the uncertainty then grows by what the slope at
    its end would add.
    """
    degc = np.atleast_1d(np.asarray(temp_degc, dtype=np.float64))
    clamped = np.clip(degc, *valid_degc)
    powers = polynomial.powers(clamped, coefficients.size - 1)
    variance = gum.variance_along(powers, covariance)
    slope = powers[:, :-1] @ (coefficients[1:] * np.arange(1, coefficients.size))
    beyond = slope * (degc - clamped)
    return Prior(powers @ coefficients, np.sqrt(np.maximum(variance, 0.0) + scatter**2 + beyond**2))


def history_prior(
    found: Estimates,
    elapsed: Array,
    *,
    start: History = DEFAULT_HISTORY,
    heading_deg: Array | None = None,
) -> Prior:
    """Prior of s at each station from the stations before it: value and rate of change (step D), by
    a Kalman filter.

    Parameters
    ----------
    found : both roots at n stations in their order.
    elapsed : [n], not decreasing: hours, or the number of the station.
    start : before the first station.
    heading_deg : [n], outside headings that choose the root; NaN where there is none.

    Notes
    -----
    State (s, ds/dt), its rate a random walk; a root that is not usable, or is as likely as the
    other, does not change the state.

    """
    if (
        elapsed.size != len(found.status)
        or not np.isfinite(elapsed).all()
        or (np.diff(elapsed) < 0.0).any()
    ):
        raise FitError(
            "the stations' times decrease or are not finite", hint="sort the stations by time"
        )
    forced = found.choose_by_heading(heading_deg)
    state = np.array([start.s, start.rate])
    covariance = np.diag([start.standard_uncertainty**2, start.rate_uncertainty**2])
    value, spread = np.empty_like(elapsed), np.empty_like(elapsed)
    for k in range(elapsed.size):
        state, covariance = _predict_state(
            state, covariance, float(elapsed[k] - elapsed[max(k - 1, 0)]), start.rate_walk
        )
        # the filter's prediction may be zero or negative; the prior must be a positive scale factor
        value[k], spread[k] = max(float(state[0]), 1e-3), float(np.sqrt(covariance[0, 0]))
        here = slice(k, k + 1)
        columns, ambiguous = found.choose_root(Prior(value[here], spread[here]), forced[here], here)
        root = k, int(columns[0])
        if not found.status[k] and found.usable[root] and not ambiguous[0]:
            state, covariance = _update_state(
                state, covariance, float(found.s[root]), float(found.uncertainty[root])
            )
    return Prior(value, spread)


def _predict_state(
    state: Array, covariance: Array, step: float, walk: float
) -> tuple[Array, Array]:
    """State and covariance predicted one step ahead."""
    move = np.array([[1.0, step], [0.0, 1.0]])
    added = walk**2 * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
    return move @ state, gum.propagate(move, covariance) + added


def _update_state(
    state: Array, covariance: Array, s: float, uncertainty: float
) -> tuple[Array, Array]:
    """State and covariance updated by a root of s."""
    gain = (
        covariance[:, 0] / (covariance[0, 0] + uncertainty**2)
        if covariance[0, 0] > 0.0
        else np.zeros(2)
    )
    return state + gain * (s - state[0]), covariance - np.outer(gain, covariance[0])


def predict_in_sequence(
    parts: Components,
    latitude_deg: ArrayLike,
    elapsed: Array,
    *,
    start: History = DEFAULT_HISTORY,
    heading_deg: Array | None = None,
    latitude_uncertainty_deg: float = 0.0,
    refused: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> Solution:
    """Solve n stations in order; s of each from its own root and the history of the stations
    before; see `solve`.
    """
    found = estimate_roots(parts, latitude_deg, refused=refused, limits=limits)
    prior = history_prior(found, elapsed, start=start, heading_deg=heading_deg)
    return solve(
        parts,
        latitude_deg,
        prior,
        heading_deg=heading_deg,
        latitude_uncertainty_deg=latitude_uncertainty_deg,
        refused=refused,
        limits=limits,
    )
