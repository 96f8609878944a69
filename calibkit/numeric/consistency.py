"""Whether errors on logs that were not fitted are as large as their stated uncertainty: a χ² test
that knows which part of the uncertainty the errors share.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError

FALSE_ALARM = 1e-3
"""Chance that errors as large as stated fail in a validation."""
TOLERATED = 1.25
"""Errors, in what is stated, that never fail: U = 2 u still covers 89 %."""


@dataclass(frozen=True, slots=True)
class Consistency:
    """Root mean square of errors over their standard uncertainties, and its limit."""

    ratio: float
    limit: float
    """What errors as large as stated exceed with probability FALSE_ALARM; at least TOLERATED."""


def compare_errors(
    error: Array,
    shared: Array,
    own: Array,
    *,
    dof: tuple[float, float] = (np.inf, np.inf),
    tests: int = 1,
) -> Consistency:
    """Errors [n] against their covariance S Sᵀ + diag(own), S [n, k] and own [n], in one unit.

    The mean of (e/u)² is taken as F with ν = n²/‖R‖² degrees of freedom, R the correlation matrix
    (Satterthwaite 1946), over those of u, which combine `dof`, of the shared and of the own part,
    after Welch and Satterthwaite. `tests` tests share the chance of a false alarm. Raises FitError
    for an uncertainty of 0.
    """
    variance = np.sum(shared**2, axis=1) + own
    if not (variance > 0.0).all():
        raise FitError("an error without an uncertainty", hint="state the uncertainty of the log")
    common, alone = shared / np.sqrt(variance)[:, None], own / variance
    inner = common.T @ common
    correlation = np.sum(inner**2) + np.sum(alone * (alone + 2.0 * np.sum(common**2, axis=1)))
    parts = np.trace(inner) / error.size, float(alone.mean())
    inverse = sum(part**2 / count for part, count in zip(parts, dof, strict=True))
    return Consistency(
        float(np.sqrt(np.mean(error**2 / variance))),
        _limit(error.size**2 / float(correlation), 1.0 / inverse if inverse else np.inf, tests),
    )


def compare_coefficients(
    difference: Array, covariance: Array, *, dof: float = np.inf, tests: int = 1
) -> Consistency:
    """Differences [p] of coefficients against their covariance [p, p]: the root of the squared
    distance over p, F with p over `dof` degrees of freedom.
    """
    u, size = np.sqrt(np.diag(covariance)), difference.size
    scaled = difference / u
    distance2 = float(scaled @ np.linalg.solve(covariance / np.outer(u, u), scaled))
    return Consistency(float(np.sqrt(distance2 / size)), _limit(float(size), dof, tests))


def _limit(dof: float, of_u: float, tests: int) -> float:
    """Root of the quantile of F for one of so many tests."""
    from scipy.special import chdtri, fdtri

    chance = FALSE_ALARM / tests
    square = chdtri(dof, chance) / dof if np.isinf(of_u) else fdtri(dof, of_u, 1.0 - chance)
    return max(float(np.sqrt(square)), TOLERATED)
