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
class Unseen:
    """Root mean square of errors over their standard uncertainties, and its limit."""

    ratio: float
    limit: float
    """What errors as large as stated exceed with probability FALSE_ALARM; at least TOLERATED."""

    def to_object(self) -> dict[str, float]:
        """Keys of a validation.json."""
        return {
            "rms_error_over_uncertainty": self.ratio,
            "largest_rms_error_over_uncertainty": self.limit,
        }


def unseen(
    error: Array,
    shared: Array,
    own: Array | float = 0.0,
    *,
    dof: tuple[float, float] = (np.inf, np.inf),
) -> Unseen:
    """Errors of corrected rows that were not fitted against their covariance S Sᵀ + diag(own).

    Parameters
    ----------
    error : [n], in one unit.
    shared : [n, k], what each error that the rows share makes of them, as large as its standard
        uncertainty: coefficients of the file, type B terms, levels that rows have in common.
    own : [n], variances of what each row has alone.
    dof : degrees of freedom of the shared and of the own part.

    Raises
    ------
    FitError : an uncertainty of 0.

    Notes
    -----
    The mean of (e/u)² is taken as F with ν = n²/‖R‖² degrees of freedom, R the correlation matrix
    (Satterthwaite 1946), over those of u, which combine those of both parts after Welch and
    Satterthwaite.
    """
    variance = np.sum(shared**2, axis=1) + own
    if not (variance > 0.0).all():
        raise FitError("an error without an uncertainty", hint="state the uncertainty of the log")
    common, alone = shared / np.sqrt(variance)[:, None], own / variance
    inner = common.T @ common
    correlation = np.sum(inner**2) + np.sum(alone * (alone + 2.0 * np.sum(common**2, axis=1)))
    parts = np.trace(inner) / error.size, float(alone.mean())
    inverse = sum(part**2 / count for part, count in zip(parts, dof, strict=True))
    return Unseen(
        float(np.sqrt(np.mean(error**2 / variance))),
        _limit(error.size**2 / float(correlation), 1.0 / inverse if inverse else np.inf),
    )


def _limit(dof: float, of_u: float) -> float:
    """Root of the quantile of F."""
    from scipy.special import chdtri, fdtri

    square = (
        chdtri(dof, FALSE_ALARM) / dof if np.isinf(of_u) else fdtri(dof, of_u, 1.0 - FALSE_ALARM)
    )
    return max(float(np.sqrt(square)), TOLERATED)
