"""Scale factor of a gyro from plateaus of a rate table: F = K Ω + F0, the earth's rate about the
table axis in F0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.numeric.plateau_means import Plateaus
    from calibkit.numeric.least_squares.fit import LinearFit


TERMS = ("K", "F0", "K_temp", "F0_temp")
"""Scale factor [1/s/(°/s)], zero intercept [1/s], and their changes with temperature [per °C]."""
HIGHEST_ORDER = 3
"""Of the polynomials of temperature that are compared."""


@dataclass(frozen=True, slots=True)
class ScaleFactor:
    """Best straight line of the indication over the rates of one run."""

    names: tuple[str, ...]
    """Of the coefficients: K, F0, and with temperature terms K_temp, F0_temp."""
    coefficients: Array
    covariance: Array
    """Type A [q, q]: noise of the plateaus, raised by the square of the Birge ratio where that
    exceeds chance.
    """
    dof: int
    rate_dps: Array
    indication: Array
    residuals: Array
    """F − F̂ [p] in the unit of the indication."""
    residual_rms: float
    birge_ratio: float
    """Residuals over what the noise of the plateaus lets expect; NaN where no noise was given."""
    solver: Array
    """Matrix [q, p] from indications to coefficients."""
    temp_degc: float
    """Mean temperature of the plateaus, to which K and F0 belong; NaN where none was logged."""

    @property
    def K(self) -> float:  # noqa: N802 - the letter of the standards
        """Scale factor: slope of the best straight line, [indication/(°/s)]."""
        return float(self.coefficients[0])

    @property
    def F0(self) -> float:  # noqa: N802 - the letter of the standards
        """Zero intercept: bias and the earth's rate about the table axis, in the unit of the
        indication.
        """
        return float(self.coefficients[1])

    @property
    def standard_uncertainty(self) -> Array:
        """Of the coefficients [q]."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True)
class RunScales:
    """Scale factors of m gyros in one run of the table, which share its rates."""

    gyros: tuple[ScaleFactor, ...]
    K: Array
    """[m]."""
    covariance: Array
    """Of the m scale factors [m, m]."""


def scale_factor(
    rate_dps: Array,
    indication: Array,
    standard_uncertainty: Array | None = None,
    *,
    temp_degc: Array | None = None,
    temperature_terms: bool = False,
) -> ScaleFactor:
    """Fit F = K Ω + F0 to plateau means by least squares with equal weights (GJB 2426A, IEEE Std
    952).

    Parameters
    ----------
    rate_dps : [p] table rates [°/s], of one sign or both.
    indication : [p] means.
    standard_uncertainty : [p] of the means from their noise.
    temp_degc : [p] [°C].
    temperature_terms : also fit K_temp Ω (T − T̄) + F0_temp (T − T̄); K and F0 then belong to the
        mean temperature T̄.

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
    columns = [rate_dps, np.ones_like(rate_dps)]
    mean_degc = float("nan") if temp_degc is None else float(np.mean(temp_degc))
    if temperature_terms:
        if temp_degc is None or not np.isfinite(temp_degc).all():
            raise FitError(
                "temperature terms of the scale factor without temperatures",
                hint="log the case temperature",
            )
        columns += [rate_dps * (temp_degc - mean_degc), temp_degc - mean_degc]
    design, names = np.column_stack(columns), TERMS[: len(columns)]
    fit = linear(design, indication, names=names)
    solver = np.linalg.pinv(design)
    covariance, ratio = _covariance(fit, design, solver, standard_uncertainty)
    return ScaleFactor(
        names=names,
        coefficients=fit.coefficients,
        covariance=covariance,
        dof=fit.dof,
        rate_dps=rate_dps,
        indication=indication,
        residuals=fit.residuals,
        residual_rms=fit.residual_rms,
        birge_ratio=ratio,
        solver=solver,
        temp_degc=mean_degc,
    )


def _covariance(
    fit: LinearFit, design: Array, solver: Array, standard_uncertainty: Array | None
) -> tuple[Array, float]:
    """Covariance of the coefficients and the Birge ratio (Birge 1932, Physical Review 40:207).

    With equal weights and unequal noise the residuals of the quiet plateaus carry the noise of the
    loud ones: the sum of squares is compared with what it then is expected to be, not with the
    degrees of freedom.
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
    # raised for every square above its expectation, the intervals of pure noise would cover too
    # often
    raised = square / expected if square > expected + spread else 1.0
    return propagated * raised, float(np.sqrt(square / expected))


def of_run(
    plateaus: Plateaus,
    *,
    reference: Literal["rate", "angle"] = "rate",
    temperature_terms: bool = False,
) -> RunScales:
    """Scale factors of all gyros of one run with the covariance of their K [m, m], which share
    table and time.

    The reference is the logged table rate, or the rate that the logged table angle turned by: the
    better one where the rate is noisy or only commanded. Raises FitError as `scale_factor`, and for
    an angle that was not logged.
    """
    rate = plateaus.rate_dps if reference == "rate" else plateaus.angle_rate_dps
    if not np.isfinite(rate).all():
        raise FitError(
            "the table angle was not logged, it cannot be the reference", hint="use the table rate"
        )
    uncertainty = plateaus.standard_uncertainty
    known = plateaus.temp_degc if np.isfinite(plateaus.temp_degc).all() else None
    gyros = tuple(
        scale_factor(
            rate,
            plateaus.indication[:, g],
            uncertainty[:, g],
            temp_degc=known,
            temperature_terms=temperature_terms,
        )
        for g in range(plateaus.indication.shape[1])
    )
    slopes = np.array([gyro.solver[0] for gyro in gyros])
    covariance = np.einsum("gp,hp,pgh->gh", slopes, slopes, plateaus.covariance)
    # each gyro's own variance already carries its Birge ratio; the correlation is that of the noise
    own = np.sqrt(np.diag(covariance))
    stated = np.array([gyro.standard_uncertainty[0] for gyro in gyros])
    correlation = covariance / np.where(np.outer(own, own) > 0.0, np.outer(own, own), 1.0)
    np.fill_diagonal(correlation, 1.0)
    return RunScales(
        gyros, np.array([gyro.K for gyro in gyros]), correlation * np.outer(stated, stated)
    )


def bias_dps(
    scale: ScaleFactor, vertical_rate_dps: float, *, own_K: float | None = None
) -> tuple[float, float]:
    """Bias [°/s] and its standard uncertainty: what is left of F0 without the earth's rate about
    the table axis.

    Parameters
    ----------
    scale : of one run.
    vertical_rate_dps : earth's rate about the table axis [°/s], positive when it turns like
        positive table rates.
    own_K : scale factor about the gyro's own axis, where the run's K is a projection of it.

    """
    divisor = scale.K if own_K is None else own_K
    if divisor == 0.0:
        raise FitError("a bias needs a scale factor other than zero")
    value = (scale.F0 - scale.K * vertical_rate_dps) / divisor
    slope = -scale.F0 / divisor**2 if own_K is None else -vertical_rate_dps / divisor
    gradient = np.array([slope, 1.0 / divisor])
    return value, gum.standard_uncertainty(gradient, scale.covariance[:2, :2])


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
    chosen = _least_error_order(K, temp_degc) if order is None else order
    fit, raw, covariance = polynomial.fit_polynomial(temp_degc, K, chosen)
    noise = _raw_noise(standard_uncertainty, temp_degc, chosen)
    # runs repeat less well than their noise: the larger of both covariances, by the trace in K over
    # the range
    columns = polynomial.powers(temp_degc, chosen)
    scatter, stated = (np.sum(gum.variance_along(columns, c)) for c in (covariance, noise))
    larger = np.array(covariance if scatter > stated else noise)
    # what the runs share does not average: nowhere is the curve better known than a run of its own
    # would tell it
    least = float(np.min(gum.variance_along(columns, larger)))
    larger[0, 0] += max(float(np.mean(standard_uncertainty**2)) - least, 0.0)
    limits = (float(np.min(temp_degc)), float(np.max(temp_degc)))
    return TemperaturePolynomial(raw, larger, fit.dof, fit.residual_rms, limits)


def _least_error_order(K: Array, temp_degc: Array) -> int:
    """Order of least error at temperatures left out, all runs at a temperature together."""
    level = np.round(temp_degc)
    highest = min(HIGHEST_ORDER, np.unique(level).size - 2)
    return polynomial.choose_order(temp_degc, K, highest, groups=level)


def _raw_noise(standard_uncertainty: Array, temp_degc: Array, order: int) -> Array:
    """Covariance of raw polynomial coefficients from the uncertainty of the points alone."""
    solver = np.array(
        [polynomial.fit_polynomial(temp_degc, row, order)[1] for row in np.eye(temp_degc.size)]
    ).T
    return np.asarray((solver * standard_uncertainty**2) @ solver.T, dtype=np.float64)


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
