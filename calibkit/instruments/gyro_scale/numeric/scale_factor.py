"""Scale factor of a gyro from plateaus of a rate table: F = K Ω + F0, F0 including the earth's rate
about the table axis.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric.plateau_means import Plateaus
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import LinearFit, linear
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

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
    """Matrix [2, p] from indications to coefficients."""

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
        """Bias (F0 − K ω)/K [°/s] and its standard uncertainty, ω the earth's rate about the table
        axis.

        Parameters
        ----------
        vertical_rate_dps : earth's rate about the table axis [°/s], positive when it turns like
            positive table rates.
        own_K : scale factor about the gyro's own axis, where the run's K is a projection of it.
        """
        divisor = self.K if own_K is None else own_K
        if divisor == 0.0:
            raise FitError("a bias needs a scale factor other than zero")
        value = (self.F0 - self.K * vertical_rate_dps) / divisor
        slope = -self.F0 / divisor**2 if own_K is None else -vertical_rate_dps / divisor
        return value, gum.standard_uncertainty(np.array([slope, 1.0 / divisor]), self.covariance)


@dataclass(frozen=True, slots=True)
class RunScales:
    """Scale factors of m gyros in one run of the table, which have the table's rates in common."""

    gyros: tuple[ScaleFactor, ...]
    K: Array
    """Scale factors [m]."""
    covariance: Array
    """Covariance [m, m] of the scale factors."""


def _scale_factor(
    rate_dps: Array, indication: Array, standard_uncertainty: Array | None = None
) -> ScaleFactor:
    """Fit F = K Ω + F0 to plateau means by least squares with equal weights (GJB 2426A, IEEE Std
    952).

    Parameters
    ----------
    rate_dps : [p] table rates [°/s], of one sign or both.
    indication : [p] means.
    standard_uncertainty : [p] of the means from their noise.

    Returns
    -------
    ScaleFactor. The weights are equal because the standards' K is the slope of the best straight
    line over the rates; F0 is always fitted, so that rates of one sign or unequal rates give the
    same K.

    Raises
    ------
    FitError
        One rate only, or no more plateaus than coefficients and no noise given: nothing tells the
        uncertainty.

    """
    design = np.column_stack([rate_dps, np.ones_like(rate_dps)])
    fit = linear(design, indication, names=TERMS)
    solver = np.linalg.pinv(design)
    covariance, ratio = _covariance(fit, design, solver, standard_uncertainty)
    return ScaleFactor(
        coefficients=fit.coefficients,
        covariance=covariance,
        dof=fit.dof,
        rate_dps=rate_dps,
        indication=indication,
        residuals=fit.residuals,
        residual_rms=fit.residual_rms,
        birge_ratio=ratio,
        solver=solver,
    )


def _covariance(
    fit: LinearFit, design: Array, solver: Array, standard_uncertainty: Array | None
) -> tuple[Array, float]:
    """Covariance of the coefficients and the Birge ratio (Birge 1932, Physical Review 40:207).

    With equal weights and unequal noise, the residuals of plateaus with little noise contain the
    noise of the others: the sum of squares is compared with its expectation for this noise, not
    with the degrees of freedom.
    """
    if standard_uncertainty is None:
        if fit.dof == 0:
            raise FitError(
                f"{fit.residuals.size} plateaus for {fit.coefficients.size} coefficients and no"
                " noise of the plateaus",
                hint="add rates, or give the standard uncertainty of each plateau",
            )
        return fit.covariance, float("nan")
    variance = standard_uncertainty**2
    propagated = (solver * variance) @ solver.T
    if fit.dof == 0:
        return propagated, float("nan")
    if not (variance > 0.0).all():
        return fit.covariance, float("nan")
    remover = (np.eye(variance.size) - design @ solver) * (
        standard_uncertainty / standard_uncertainty[:, None]
    )
    form = remover @ remover.T
    expected, spread = float(np.trace(form)), float(np.sqrt(2.0 * np.sum(form**2)))
    square = float(np.sum(fit.residuals**2 / variance))
    # raised for every square above its expectation, the covariance would be too large for pure
    # noise
    raised = square / expected if square > expected + spread else 1.0
    return propagated * raised, float(np.sqrt(square / expected))


def of_run(plateaus: Plateaus, *, reference: Literal["rate", "angle"] = "rate") -> RunScales:
    """Scale factors of all gyros of one run and the covariance [m, m] of their K, correlated by the
    common table rates.

    The reference is the logged table rate, or the rate that the logged table angle turned by: the
    better one where the rate is noisy or only commanded. Raises FitError as `_scale_factor`, and
    for an angle that was not logged.
    """
    rate = plateaus.rate_dps if reference == "rate" else plateaus.angle_rate_dps
    if not np.isfinite(rate).all():
        raise FitError(
            "the table angle was not logged, it cannot be the reference", hint="use the table rate"
        )
    gyros = tuple(
        _scale_factor(rate, means, uncertainty)
        for means, uncertainty in zip(
            plateaus.indication.T, plateaus.standard_uncertainty.T, strict=True
        )
    )
    slopes = np.array([gyro.solver[0] for gyro in gyros])
    covariance = np.einsum("gp,hp,pgh->gh", slopes, slopes, plateaus.covariance)
    # variances include each gyro's Birge ratio; correlations are those of the noise
    own = np.sqrt(np.diag(covariance))
    stated = np.array([gyro.standard_uncertainty[0] for gyro in gyros])
    correlation = covariance / np.where(np.outer(own, own) > 0.0, np.outer(own, own), 1.0)
    np.fill_diagonal(correlation, 1.0)
    return RunScales(
        gyros, np.array([gyro.K for gyro in gyros]), correlation * np.outer(stated, stated)
    )


def over_temperature(
    K: Array, standard_uncertainty: Array, temp_degc: Array, *, order: int | None = None
) -> TemperaturePolynomial:
    """Fit the scale factors of q runs as a polynomial of temperature.

    Parameters
    ----------
    K, standard_uncertainty, temp_degc : [q].
    order : of the polynomial; by default the one of least leave-one-temperature-out error, at most
        3.

    Raises
    ------
    FitError
        Fewer temperatures than coefficients.

    """
    # all runs at a temperature are left out together
    level = np.round(temp_degc)
    highest = min(polynomial.HIGHEST_ORDER, np.unique(level).size - 2)
    chosen = order
    if chosen is None:
        chosen = polynomial.choose_order(temp_degc, K, highest, groups=level)
    fit, raw, covariance = polynomial.fit_polynomial(temp_degc, K, chosen)
    solver = np.array(
        [polynomial.fit_polynomial(temp_degc, row, chosen)[1] for row in np.eye(temp_degc.size)]
    ).T
    noise = (solver * standard_uncertainty**2) @ solver.T
    # runs repeat less well than their noise: of the two covariances, use the one with the larger
    # trace in K over the range
    columns = polynomial.powers(temp_degc, chosen)
    scatter, stated = (np.sum(gum.variance_along(columns, c)) for c in (covariance, noise))
    larger = np.array(covariance if scatter > stated else noise)
    # errors common to all runs do not average out: the curve is nowhere better known than a single
    # run
    least = float(np.min(gum.variance_along(columns, larger)))
    larger[0, 0] += max(float(np.mean(standard_uncertainty**2)) - least, 0.0)
    return TemperaturePolynomial(
        raw, larger, fit.dof, fit.residual_rms, (float(np.min(temp_degc)), float(np.max(temp_degc)))
    )


def mean_of_runs(K: ArrayLike, standard_uncertainty: ArrayLike) -> tuple[float, float]:
    """Mean of repeated runs and its standard uncertainty: the larger of a run's own and of the
    scatter of the mean.

    A run's own uncertainty is not divided by √n: the table's unevenness and the gyro's departure
    from a straight line are in it, and runs over the same rates repeat them.
    """
    values, noise = (
        np.asarray(K, dtype=np.float64),
        np.asarray(standard_uncertainty, dtype=np.float64),
    )
    shared = rms(noise)
    scatter = float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0
    return float(values.mean()), max(shared, scatter)
