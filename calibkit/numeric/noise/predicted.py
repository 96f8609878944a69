"""What a record of a length will tell of its noise terms.

Allan variances are drawn about σ²(τ) = Σ_j c_j τ^exponent_j with the covariance that the noise
gives them, and fitted as those of a record are (`allan_fit`).
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.noise import allan_fit
from calibkit.numeric.noise.allan import DeviationCurve, Spacing, averaging_factors
from calibkit.numeric.noise.laws import LAWS

DRAWS, SEED = 400, 1
"""Curves of which a prediction is made, and of their random numbers."""


def predict_terms(
    coefficients: Sequence[float],
    samples: int,
    interval_s: float,
    *,
    spacing: Spacing = "octave",
    points: int = 1,
) -> Array:
    """Predicted standard uncertainties [5] of the square roots of coefficients [5] of the laws that
    a record without gaps will show.

    The coefficients cannot be negative, so that errors do not propagate linearly: they are the rms
    error of fits to DRAWS curves, with normal errors of the covariance that the noise has.
    """
    true = np.asarray(coefficients, dtype=np.float64)
    factor = averaging_factors(samples, spacing=spacing, points=points)
    tau = np.asarray(factor * interval_s, dtype=np.float64)
    variance = tau[:, None] ** np.array([float(law.exponent) for law in LAWS]) @ true
    unit_dof, deviation = np.ones(tau.size), np.sqrt(variance)
    curve = DeviationCurve(
        *("overlapping Allan", interval_s, samples, factor, tau, deviation),
        *(samples - 2 * factor + 1, (), unit_dof, deviation, deviation, 0.0),
    )
    design, covariance, spread = allan_fit.weigh(curve, true)
    drawn = np.random.default_rng(SEED).multivariate_normal(variance, covariance, DRAWS)
    active = np.ones(true.size, dtype=np.bool_)
    fitted = [allan_fit.non_negative(design, curve, spread, active) for curve in drawn]
    return np.asarray(np.sqrt(np.mean((np.sqrt(fitted) - np.sqrt(true)) ** 2, axis=0)))
