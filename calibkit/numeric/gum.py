"""Uncertainty after the GUM: combination, coverage, linear propagation, the interval
of a Monte Carlo propagation, rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array

Distribution = Literal["normal", "rectangular", "triangular", "arcsine"]

TWO_SIGMA = 0.9545
"""Coverage probability of k = 2 for a normal distribution, which "approximately 95 %" stands for
(EA-4/02).
"""
FEW_DOF = 30.0
"""Effective degrees of freedom below which the coverage factor is Student's instead of 2."""
HALF_WIDTH = {"rectangular": 3.0**0.5, "triangular": 6.0**0.5, "arcsine": 2.0**0.5}
"""Half-widths in standard uncertainties of the distributions that have limits (JCGM 100 4.3.7 and
4.3.9, JCGM 101 6.4.6).
"""


@dataclass(frozen=True, slots=True)
class UncertaintyComponent:
    """An input of a measurement: estimate and standard uncertainty in its own unit, sensitivity to
    the result's.
    """

    name: str
    estimate: float
    standard_uncertainty: float
    kind: Literal["A", "B"]
    sensitivity: float = 1.0
    dof: float = np.inf
    distribution: Distribution = "normal"

    def __post_init__(self) -> None:
        numbers = (self.estimate, self.standard_uncertainty, self.sensitivity)
        if not np.isfinite(numbers).all() or self.standard_uncertainty < 0.0 or not self.dof > 0.0:
            raise FitError(
                f"component '{self.name}': estimate {self.estimate!r}, sensitivity"
                f" {self.sensitivity!r}, standard uncertainty {self.standard_uncertainty!r},"
                f" {self.dof!r} degrees of freedom",
                hint=(
                    "expected finite numbers, an uncertainty of at least 0 and more than 0 degrees"
                    " of freedom"
                ),
            )


@dataclass(frozen=True, slots=True)
class _Expanded:
    """A combined and expanded uncertainty, in the unit of the result, and how it was expanded."""

    standard_uncertainty: float
    effective_dof: float
    coverage_factor: float
    expanded_uncertainty: float
    probability: float


def combine(
    components: Sequence[UncertaintyComponent],
    *,
    correlation: ArrayLike | None = None,
    probability: float = TWO_SIGMA,
) -> _Expanded:
    """Combine components into one standard uncertainty and expand it.

    Each estimate times its sensitivity has the unit of the result; inputs are independent without a
    correlation [n, n]. Raises FitError for no components, a matrix that is not one of correlations,
    less than one effective degree of freedom.

    u_c² = Σ_i Σ_j c_i c_j u_i u_j r_ij (JCGM 100 eq. 16; eq. 10 when independent); effective
    degrees of freedom from Welch and Satterthwaite (eq. G.2b). That formula wants independent
    contributions: inputs tied by a correlation enter as one contribution with the fewest degrees of
    freedom among them, which never promises more than they hold.
    """
    if not components:
        raise FitError("no components to combine", hint="state at least one")
    size = len(components)
    matrix = np.eye(size) if correlation is None else np.asarray(correlation, dtype=np.float64)
    # rounding of a computed correlation is allowed for, nothing more
    if correlation is not None and (
        matrix.shape != (size, size)
        or not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12)
        or not np.allclose(np.diag(matrix), 1.0, rtol=0.0, atol=1e-12)
        or float(np.linalg.eigvalsh(matrix)[0]) < -1e-10 * size
    ):
        raise FitError(
            f"not a correlation matrix of {size} inputs (shape {matrix.shape})",
            hint="expected a symmetric, positive semidefinite matrix with ones on the diagonal",
        )
    contributions = np.array([part.sensitivity * part.standard_uncertainty for part in components])
    # fourth powers of what is left neither over- nor underflow
    largest = float(np.max(np.abs(contributions))) or 1.0
    pairwise = np.outer(contributions / largest, contributions / largest) * matrix
    variance = max(float(pairwise.sum()), 0.0)
    dof = _welch_satterthwaite(
        variance, pairwise, matrix, np.array([part.dof for part in components])
    )
    combined = largest * float(np.sqrt(variance))
    factor = coverage_factor(dof, probability=probability)
    return _Expanded(combined, dof, factor, factor * combined, probability)


MOST_SELECTED = 12
"""Contributions of which every selection is tried for the largest expanded uncertainty."""


def combine_cautiously(components: Sequence[UncertaintyComponent]) -> _Expanded:
    """Combine independent components as `combine` does, but with the largest expanded uncertainty
    of every selection of them: no further component lowers U.

    Beside a badly known contribution (one degree of freedom, k = 14) a well-known one raises the
    effective degrees of freedom of Welch and Satterthwaite, and U falls to a third, although the
    first one is as badly known as before. The factor is then U/u_c. Raises FitError as `combine`.
    """
    combined = combine(components)
    parts = sorted(
        ((part.sensitivity * part.standard_uncertainty) ** 2, part.dof) for part in components
    )
    square, dof = np.array(parts).T
    if dof.min() >= FEW_DOF or not square[-1] > 0.0:
        return combined
    while square.size > MOST_SELECTED:  # the two smallest count as one
        square = np.array([square[0] + square[1], *square[2:]])
        dof = np.array([min(dof[0], dof[1]), *dof[2:]])
    square = square / square[-1]
    # every selection of contributions as the bits of a number
    selections = (np.arange(1, 2**square.size)[:, None] >> np.arange(square.size) & 1).astype(float)
    variance, total = selections @ square, selections @ (square**2 / dof)
    effective = np.divide(variance**2, total, out=np.full_like(total, np.inf), where=total > 0.0)
    kinds, number = np.unique(np.floor(effective[effective >= 1.0] + 1e-9), return_inverse=True)
    factors = np.array([coverage_factor(float(kind)) for kind in kinds])
    largest = float(np.max(factors[number] * np.sqrt(variance[effective >= 1.0] / square.sum())))
    # k is U/u_c, so that k u_c is the largest U of all selections
    factor = max(combined.coverage_factor, largest)
    expanded = factor * combined.standard_uncertainty
    return replace(combined, coverage_factor=factor, expanded_uncertainty=expanded)


def _welch_satterthwaite(variance: float, pairwise: Array, correlation: Array, dof: Array) -> float:
    """ν_eff = u_c⁴ / Σ u_g⁴/ν_g over groups of inputs that a chain of correlations links (JCGM 100
    eq. G.2b).
    """
    # inputs that a chain of correlations links get one number
    tied = np.arange(dof.size)
    for i, j in np.argwhere(correlation != 0.0):
        tied[tied == tied[i]] = tied[j]
    total = 0.0
    for group in np.unique(tied):
        inside = tied == group
        total += float(pairwise[np.ix_(inside, inside)].sum()) ** 2 / float(dof[inside].min())
    return variance**2 / total if total > 0.0 else float("inf")


def degrees_of_freedom(weights: Array, covariance: Array, dof: Array) -> float:
    """Effective degrees of freedom of Σ w_i x_i from those [n] of the x_i with covariance [n, n],
    as `combine` finds them; 0 where one that takes part has none.
    """
    takes_part = weights != 0.0
    used_covariance = covariance[np.ix_(takes_part, takes_part)]
    pairwise = np.outer(weights[takes_part], weights[takes_part]) * used_covariance
    if not (dof[takes_part] > 0.0).all():
        return 0.0
    return _welch_satterthwaite(
        max(float(pairwise.sum()), 0.0), pairwise, used_covariance, dof[takes_part]
    )


def coverage_factor(effective_dof: float, *, probability: float = TWO_SIGMA) -> float:
    """Coverage factor: Student's quantile below 30 degrees of freedom, from there on 2 (for the
    default probability).

    Degrees of freedom are truncated to a whole number (JCGM 100 G.4.1, table G.2; EA-4/02 annex E),
    below one refused.
    """
    whole_dof = np.floor(effective_dof + 1e-9)  # one less a rounding error is one
    if not whole_dof >= 1.0:
        raise FitError(
            f"{effective_dof:.2g} effective degrees of freedom",
            hint="repeat the measurement more often",
        )
    if not 0.0 < probability < 1.0:
        raise FitError(
            f"coverage probability {probability!r}", hint="expected a number between 0 and 1"
        )
    # "approximately 95 %" is k = 2, not 1.9999
    if whole_dof >= FEW_DOF and probability == TWO_SIGMA:
        return 2.0
    from scipy.special import (  # scipy.stats has the same quantiles and takes a second to import
        ndtri,
        stdtrit,
    )

    quantile = (1.0 + probability) / 2.0
    return float(ndtri(quantile) if np.isinf(effective_dof) else stdtrit(whole_dof, quantile))


def widening(effective_dof: float) -> float:
    """Factor by which few degrees of freedom widen an uncertainty: their coverage factor for 95 %
    over that of a normal distribution.

    Raises FitError as `coverage_factor` does.
    """
    return coverage_factor(effective_dof, probability=0.95) / coverage_factor(
        np.inf, probability=0.95
    )


def expand_along(contributions: Array, dof: Array) -> tuple[Array, Array, Array]:
    """Combined standard uncertainty, effective degrees of freedom and expanded uncertainty [n each]
    of results along a log.

    Contributions [m, n] of m independent inputs, each its sensitivity times its standard
    uncertainty, with degrees of freedom [m]: what `combine` does at one point. Raises FitError as
    `coverage_factor` does.
    """
    square = contributions**2
    combined = square.sum(axis=0)
    largest = np.where(combined > 0.0, combined, 1.0)
    total = np.sum((square / largest) ** 2 / dof[:, None], axis=0)
    effective = np.divide(1.0, total, out=np.full(combined.size, np.inf), where=total > 0.0)
    # factors differ by whole degrees of freedom, from FEW_DOF on not at all
    whole_dof = np.where(effective >= FEW_DOF, np.inf, np.floor(effective + 1e-9))
    kinds, number = np.unique(whole_dof, return_inverse=True)
    factors = np.array([coverage_factor(float(kind)) for kind in kinds])
    standard = np.sqrt(combined)
    return standard, effective, np.asarray(factors[number] * standard, dtype=np.float64)


def propagate(jacobian: Array, covariance: Array) -> Array:
    """Covariance [..., m, m] of m results from the covariance [..., n, n] of n inputs: J C Jᵀ
    (JCGM 102 6.2.1.3), J [..., m, n].
    """
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), dtype=np.float64)


def variance_along(jacobian: Array, covariance: Array) -> Array:
    """Variances [n] of results along a log: the diagonal of J C Jᵀ without the n × n matrix, J
    [n, p] and C [p, p] or, one per result, [n, p, p].
    """
    if covariance.ndim == 2:
        return np.asarray(np.einsum("ij,ij->i", jacobian @ covariance, jacobian))
    return np.asarray(np.einsum("ni,nij,nj->n", jacobian, covariance, jacobian))


def uncertainty_along(jacobian: Array, covariance: Array) -> Array:
    """Standard uncertainties [n] of results along a log: roots of `variance_along`."""
    return np.sqrt(np.maximum(variance_along(jacobian, covariance), 0.0))


def square_root(covariance: Array) -> Array:
    """Matrix R [n, n] with R Rᵀ = covariance [n, n], whatever the units of its rows."""
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # of the correlations: coefficients of T³ and of 1 differ by many decades
    scale = np.where(u > 0.0, u, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def shortest_interval(results: Array, *, probability: float = 0.95) -> tuple[float, float]:
    """Shortest coverage interval of the equally probable results [trials] of a Monte Carlo
    propagation (JCGM 101 5.3.4, 7.7).

    Raises FitError for a result that is not finite, or fewer than 100/(1 − probability) trials
    (7.2.2 asks for 10⁴/(1 − p)).
    """
    ascending, trials = np.sort(results), results.size
    if not np.isfinite(results).all():
        raise FitError("a result of a trial is not finite", hint="expected a finite one each")
    if trials * (1.0 - probability) < 100.0:
        raise FitError(
            f"{trials} trials for a coverage probability of {probability:g}", hint="draw more"
        )
    inside = min(int(probability * trials + 0.5), trials - 1)
    start = int(np.argmin(ascending[inside:] - ascending[: trials - inside]))
    return float(ascending[start]), float(ascending[start + inside])


def rounded(value: float, uncertainty: float, *, digits: int = 2) -> tuple[str, str]:
    """Value and uncertainty as a certificate prints them (JCGM 100 7.2.6): 0.0996 becomes 0.10, the
    value follows.

    The uncertainty is rounded half up to the given significant digits, once, from its shortest
    decimal form, the value to the same decimal place. Raises FitError for an uncertainty not finite
    and positive, or a value not finite.
    """
    if not (np.isfinite([value, uncertainty]).all() and uncertainty > 0.0):
        raise FitError(
            f"cannot round {value!r} ± {uncertainty!r}",
            hint="expected a finite value and uncertainty > 0",
        )
    exact = Decimal(repr(float(uncertainty)))
    # rounding can carry into a new leading digit, 0.0996 to 0.100, which would print a digit too
    # many
    place = _at_place(exact, exact.adjusted() - digits + 1).adjusted() - digits + 1
    rounded_value = _at_place(Decimal(repr(float(value))), place)
    return (
        f"{abs(rounded_value) if rounded_value == 0 else rounded_value:f}",
        f"{_at_place(exact, place):f}",
    )


def _at_place(number: Decimal, place: int) -> Decimal:
    """Number rounded half up (away from zero) to the decimal place 10^place."""
    return number.quantize(
        Decimal(1).scaleb(place), rounding=ROUND_HALF_UP, context=Context(prec=700)
    )
