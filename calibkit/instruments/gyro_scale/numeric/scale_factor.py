"""Scale factor of a gyro from plateaus of a rate table: F = K Ω + F0, F0 including the earth's rate
about the table axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.numeric.plateau_means import Plateaus
from calibkit.numeric import gum
from calibkit.numeric.least_squares.fit import LinearFit, linear

TERMS = ("K", "F0")
"""Scale factor [1/s/(°/s)] and zero intercept [1/s]."""


@dataclass(frozen=True, slots=True)
class ScaleFactor:
    """Best straight line of the indication over the rates of one run."""

    coefficients: Array
    """K and F0 [2]."""
    covariance: Array
    """Covariance [2, 2], type A: noise of the plateaus, multiplied by the squared Birge ratio where
    that exceeds chance.
    """
    dof: int
    rate_dps: Array
    indication: Array
    residuals: Array
    """F − F̂ [p] in the unit of the indication."""
    residual_rms: float
    birge_ratio: float
    """Residuals relative to those expected from the noise of the plateaus; NaN where no noise was
    given.
    """
    solver: Array
    """Matrix [2, p] from raw indications to coefficients."""
    rest: float
    """Indication at rest [unit of the indication]: of held zero rates, else of the line with a
    term for asymmetry where the residuals ask for it.
    """
    rest_covariance: Array
    """Covariance [2, 2] of K and `rest`."""
    left_out: Array
    """Change [2] of K and F0 by the term, of those that are not included, that would change K
    most.
    """
    terms: Mapping[str, tuple[float, ...]]
    """Terms beside the line that the residuals ask for, with their coefficients; what time and
    temperature add is taken out of `indication`.
    """

    @property
    def K(self) -> float:  # noqa: N802 - the letter of the standards
        """Scale factor: slope of the best straight line, [indication/(°/s)]."""
        return float(self.coefficients[0])

    @property
    def F0(self) -> float:  # noqa: N802 - the letter of the standards
        """Zero intercept in the unit of the indication: bias and the earth's rate about the table
        axis.
        """
        return float(self.coefficients[1])

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [2] of the coefficients."""
        return np.sqrt(np.diag(self.covariance))

    def bias_dps(
        self, vertical_rate_dps: float, *, own_K: float | None = None
    ) -> tuple[float, float]:
        """Bias (F at rest − K ω)/K [°/s] and its standard uncertainty, ω the earth's rate about the
        table axis.

        Parameters
        ----------
        vertical_rate_dps : earth's rate about the table axis [°/s], positive when it turns like
            positive table rates.
        own_K : scale factor about the gyro's own axis, where the run's K is a projection of it.
        """
        divisor = self.K if own_K is None else own_K
        if divisor == 0.0:
            raise FitError("a bias needs a scale factor other than zero")
        value = (self.rest - self.K * vertical_rate_dps) / divisor
        slope = -self.rest / divisor**2 if own_K is None else -vertical_rate_dps / divisor
        return value, gum.standard_uncertainty(
            np.array([slope, 1.0 / divisor]), self.rest_covariance
        )


def _scale_factor(
    rate_dps: Array,
    indication: Array,
    standard_uncertainty: Array | None = None,
    candidates: Mapping[str, Array] = MappingProxyType({}),
) -> ScaleFactor:
    """Fit F = K Ω + F0 to plateau means by least squares with equal weights (GJB 2426A, IEEE Std
    952).

    Parameters
    ----------
    rate_dps : [p] table rates [°/s], of one sign or both.
    indication : [p] means.
    standard_uncertainty : [p] of the means from their noise.
    candidates : terms of time and temperature that are included where the residuals ask for them,
        name → columns [p, k].

    Returns
    -------
    ScaleFactor. The weights are equal because the standards' K is the slope of the best straight
    line over the rates; F0 is always fitted, so that rates of one sign or unequal rates give the
    same K. What the largest term that is not included would change is in the covariance.

    Raises
    ------
    FitError
        One rate only, or no more plateaus than coefficients and no noise given: nothing tells the
        uncertainty.

    """
    chosen = line_terms.choose(rate_dps, indication, candidates)
    corrected = indication - chosen.solved.taken_out @ indication
    fit = linear(np.column_stack([rate_dps, np.ones_like(rate_dps)]), corrected, names=TERMS)
    full = linear(chosen.solved.design, indication)
    results = chosen.solved.results
    covariance, ratio = _covariance(full, chosen, indication, standard_uncertainty)
    # an effect too small to be found is still there; what the model explains changes nothing
    shifts = [np.zeros(4)]
    shifts += [(other.results - results) @ full.residuals for other in chosen.left_out]
    largest = max(shifts, key=lambda shift: abs(float(shift[0])))
    covariance += np.outer(largest, largest)
    # of the model, or of the held zero rates where these know it better
    rest = 3 if covariance[3, 3] < covariance[2, 2] else 2
    return ScaleFactor(
        coefficients=fit.coefficients,
        covariance=covariance[:2, :2],
        dof=full.dof,
        rate_dps=rate_dps,
        indication=corrected,
        residuals=fit.residuals,
        residual_rms=fit.residual_rms,
        birge_ratio=ratio,
        solver=results[:2],
        rest=float(results[rest] @ indication),
        rest_covariance=covariance[np.ix_((0, rest), (0, rest))],
        left_out=largest[:2],
        terms=chosen.terms,
    )


def _covariance(
    fit: LinearFit,
    chosen: line_terms.Chosen,
    indication: Array,
    standard_uncertainty: Array | None,
) -> tuple[Array, float]:
    """Covariance [4, 4] of K, F0 and both indications at rest, and the Birge ratio (Birge 1932,
    Physical Review 40:207).

    With equal weights and unequal noise, the residuals of plateaus with little noise contain the
    noise of the others: the sum of squares is compared with its expectation for this noise, not
    with the degrees of freedom.
    """
    results = chosen.solved.results
    noise = standard_uncertainty
    if noise is None and fit.dof == 0:
        raise FitError(
            f"{fit.residuals.size} plateaus for {fit.coefficients.size} coefficients and no"
            " noise of the plateaus",
            hint="add rates, or give the standard uncertainty of each plateau",
        )
    if noise is None or (fit.dof and not (noise > 0.0).all()):
        spread = float(np.sqrt(np.sum(fit.residuals**2) / fit.dof))
        raised, ratio, noise = np.ones(4), float("nan"), np.full(fit.residuals.size, spread)
    else:
        ratio, excess = _birge(fit, chosen.solved, noise)
        # what is held at rest has no part in the residuals of the line
        raised = np.array([excess, excess, excess, 1.0])
    covariance = (results * noise**2) @ results.T * np.outer(raised, raised)
    if not line_terms.turns_both_ways(chosen.solved.design[:, 0]):
        # one direction alone: nothing tells the line of the other one from a bend of the response
        bend = float((chosen.solved.solver[1] - results[1]) @ indication)
        covariance[1, 1] += bend**2
    return covariance, ratio


def _birge(fit: LinearFit, solved: line_terms.Solved, noise: Array) -> tuple[float, float]:
    """Residuals relative to those expected from noise [p], NaN without degrees of freedom, and the
    factor that they raise standard uncertainties by.
    """
    if fit.dof == 0:
        return float("nan"), 1.0
    remover = (np.eye(noise.size) - solved.design @ solved.solver) * (noise / noise[:, None])
    form = remover @ remover.T
    expected, spread = float(np.trace(form)), float(np.sqrt(2.0 * np.sum(form**2)))
    square = float(np.sum(fit.residuals**2 / noise**2))
    ratio = float(np.sqrt(square / expected))
    # raised for every square above its expectation, the covariance would be too large for pure
    # noise
    return ratio, ratio if square > expected + spread else 1.0


def of_run(
    plateaus: Plateaus, *, reference: Literal["rate", "angle"] = "rate"
) -> tuple[ScaleFactor, ...]:
    """Scale factors of all gyros of one run.

    The reference is the logged table rate, or the rate that the logged table angle turned by: the
    better one where the rate is noisy or only commanded. Raises FitError as `_scale_factor`, and
    for an angle that was not logged.
    """
    rate = plateaus.rate_dps if reference == "rate" else plateaus.angle_rate_dps
    if not np.isfinite(rate).all():
        raise FitError(
            "the table angle was not logged, it cannot be the reference", hint="use the table rate"
        )
    courses = line_terms.courses(plateaus)
    shown = zip(plateaus.indication.T, plateaus.standard_uncertainty.T, strict=True)
    return tuple(_scale_factor(rate, means, noise, courses) for means, noise in shown)
