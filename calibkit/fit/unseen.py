"""Whether errors on logs that were not fitted are as large as their stated uncertainty: a χ² test
that knows which part of the uncertainty the errors share.

    mean (e/u)² ~ F(ν, ν_u),   ν = n²/‖R‖²       e errors, u² = diag(S Sᵀ) + variances of rows

R is the correlation matrix of the errors (Satterthwaite 1946), ν_u the degrees of freedom of u.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array

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
    row_variance: Array | float = 0.0,
    *,
    dof: tuple[float, float] = (np.inf, np.inf),
) -> Unseen:
    """Errors of corrected rows that were not fitted against their covariance S Sᵀ +
    diag(row_variance).

    Parameters
    ----------
    error : [n], in one unit.
    shared : [n, k], what each error that the rows share makes of them, as large as its standard
        uncertainty: coefficients of the file, type B terms, levels that rows have in common.
    row_variance : [n], variances of what each row has alone.
    dof : degrees of freedom of the shared part and of that of the rows.

    Raises
    ------
    FitError : an uncertainty of 0.

    Notes
    -----
    The mean of (e/u)² is taken as F with ν = n²/‖R‖² degrees of freedom, R the correlation matrix
    (Satterthwaite 1946), over those of u, which combine those of both parts after Welch and
    Satterthwaite.
    """
    from scipy.special import chdtri, fdtri

    variance = np.sum(shared**2, axis=1) + row_variance
    if not (variance > 0.0).all():
        raise FitError("an error without an uncertainty", hint="state the uncertainty of the log")
    # R = C Cᵀ + diag(a), of unit diagonal; ‖R‖² and the shares of both parts without a matrix n × n
    C, a = shared / np.sqrt(variance)[:, None], row_variance / variance
    CC = C.T @ C
    norm2 = float(np.sum(CC**2) + np.sum(a * (a + 2.0 * np.sum(C**2, axis=1))))
    shares = float(np.trace(CC)) / error.size, float(a.mean())
    nu = error.size**2 / norm2
    inverse_of_u = sum(share**2 / count for share, count in zip(shares, dof, strict=True))
    if inverse_of_u:
        square = fdtri(nu, 1.0 / inverse_of_u, 1.0 - FALSE_ALARM)
    else:  # u is known: F is χ²/ν
        square = chdtri(nu, FALSE_ALARM) / nu
    ratio = float(np.sqrt(np.mean(error**2 / variance)))
    return Unseen(ratio, max(float(np.sqrt(square)), TOLERATED))
