"""Restricted likelihood of the variances of errors that rows share (Patterson & Thompson 1971),
from matrices of the size of the groups.

V = σ² I + Σ_g θ_g Z_g Z_gᵀ for weighted rows; M = I − X (Xᵀ X)⁻¹ Xᵀ projects onto what the
coefficients leave; P = V⁻¹ − V⁻¹ X (Xᵀ V⁻¹ X)⁻¹ Xᵀ V⁻¹.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask

ITERATIONS = 60
HALVINGS = 30
TOLERANCE = 1e-9
"""Change of the deviance that ends the iteration."""
DETERMINED = 1e-6
"""Share of an effect's square that must be left beside the coefficients for a level to count."""
LEAST_NOISE = 1e-10
"""Share of the residual variance below which the variance of the noise is not sought."""
CUT_AT_ZERO = float(np.sqrt(0.5 - 0.5 / np.pi))
"""Standard deviation of a normal estimate about 0 that is cut off there, relative to that of one
that is not.
"""
RANK = 1e-15
"""Eigenvalue of the scaled information, over its largest, below which a combination of variances is
not determined.
"""
LARGEST_RATIO = 1e10
"""Variance of an effect over that of the noise of a level, above which no digit changes but those
lost to rounding.
"""


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a variance θ before the fit: ν s²/θ is distributed as χ² with ν degrees of
    freedom.
    """

    square: float = 0.0
    """s²."""
    dof: float = 0.0
    """ν; 0 where nothing is known, infinite where the variance is held at s²."""

    def deviance(self, theta: float) -> float:
        """−2 × logarithm of the likelihood of θ, up to a constant."""
        if self.dof in (0.0, np.inf):
            return 0.0
        return float(self.dof * (np.log(theta) + self.square / theta)) if theta > 0.0 else np.inf

    def information(self, theta: float) -> tuple[float, float]:
        """Score and expected information of θ."""
        if self.dof in (0.0, np.inf):
            return 0.0, 0.0
        return -0.5 * self.dof * (1.0 - self.square / theta) / theta, 0.5 * self.dof / theta**2


@dataclass(frozen=True, slots=True)
class Solution:
    """Coefficients at the most likely variances."""

    coefficients: Array
    """[p]."""
    covariance: Array
    """[p, p], with what the estimation of the variances adds (Kenward & Roger 1997)."""
    shared: Array
    """Predicted shared errors [q]."""
    variances: Array
    """σ² and θ [1 + g]."""
    deviance: float
    """−2 × logarithm of the likelihood, up to a constant."""
    slopes: Array
    """Derivatives [1 + g, p, p] of (Xᵀ V⁻¹ X)⁻¹ by σ² and θ."""
    variance_covariance: Array
    """Covariance [1 + g, 1 + g] of the estimated variances; zero for one that is held."""


@dataclass(frozen=True, slots=True)
class _Point:
    """The likelihood at some variances."""

    variances: Array
    """σ² and θ [1 + g]."""
    deviance: float
    """−2 × logarithm of the likelihood, up to a constant."""
    ratio: Array
    """λ = θ/σ² of each column [q]."""
    inverse: Array
    """A = (I + S Λ)⁻¹ [q, q]; A S is symmetric."""
    u: Array
    """A Zᵀ M y [q]."""


@dataclass(frozen=True, slots=True)
class Reduced:
    """Weighted rows reduced to matrices of the size of the levels."""

    whole: Array
    """Diagonal [q] of Zᵀ Z."""
    between: Array
    """S = Zᵀ M Z [q, q]."""
    target: Array
    """Zᵀ M y [q]."""
    square: float
    """yᵀ M y."""
    spare: int
    """n − p."""
    member: Integers
    """[q], number of the effect of each column of Z."""
    into: Array
    """F = (Xᵀ X)⁻¹ Xᵀ Z [p, q]."""
    basis: Array
    """(Xᵀ X)⁻¹ [p, p]."""
    least: float
    """Least σ²: below, rounding errors of the indications rule the likelihood."""

    def degrees(self, number: int) -> int:
        """Degrees of freedom that the coefficients leave between the levels of an effect."""
        at = self.member == number
        whole = float(np.max(self.whole[at], initial=0.0))
        values = np.linalg.eigvalsh(self.between[np.ix_(at, at)])
        return int(np.sum(values > DETERMINED * whole))

    def maximise(self, priors: Sequence[Prior], near: Array | None = None) -> "_Point":
        """The variances that maximise the restricted likelihood times that of what is known, by
        Fisher's scoring from a small and from a large start, or from variances [1 + g] that are
        near.
        """
        noise = max(self.square / self.spare, self.least)
        start = np.array([noise, *(prior.square for prior in priors)])
        if near is not None:
            start = np.where(_free(priors), near, start)
            start[0] = max(start[0], self.least)
            return self._ascend(priors, start)
        unknown = [g for g, prior in enumerate(priors) if not prior.dof]
        found = []
        for size in (0.1, 10.0) if unknown else (1.0,):
            for g in unknown:
                start[g + 1] = size * noise / np.mean(self.whole[self.member == g])
            found.append(self._ascend(priors, start.copy()))
        return min(found, key=lambda each: each.deviance)

    def _ascend(self, priors: Sequence[Prior], start: Array) -> "_Point":
        """Where Fisher's scoring from a start [1 + g] ends."""
        free, at = _free(priors), self._point(priors, start)
        least = max(LEAST_NOISE * self.square / self.spare, self.least)
        for _ in range(ITERATIONS):
            score, information = self._information(priors, at)
            moved = free & ((at.variances > 0.0) | (score > 0.0))
            step = np.where(moved, _inverse(information, moved) @ np.where(moved, score, 0.0), 0.0)
            for halving in range(HALVINGS):
                tried = np.maximum(at.variances + step * 0.5**halving, 0.0)
                tried[0] = max(tried[0], 0.1 * at.variances[0], least)
                reached = self._point(priors, tried)
                if reached.deviance <= at.deviance:
                    break
            else:
                break
            gain, at = at.deviance - reached.deviance, reached
            if gain < TOLERANCE:
                break
        return at

    def _point(self, priors: Sequence[Prior], variances: Array) -> "_Point":
        """The likelihood at σ² and θ [1 + g]."""
        from scipy.linalg import lapack

        ratio = (variances[1:] / variances[0])[self.member]
        ratio = np.minimum(ratio, LARGEST_RATIO / np.max(self.whole, initial=1e-200))
        unit = np.eye(len(ratio))
        if len(ratio):
            factors, _, inverse, _ = lapack.dgesv(unit + self.between * ratio, unit)
        else:
            factors = inverse = unit
        logarithm = float(np.sum(np.log(np.abs(np.diag(factors)))))
        u = inverse @ self.target
        left = self.square - float((self.target * ratio) @ u)
        known = sum(p.deviance(float(t)) for p, t in zip(priors, variances[1:], strict=True))
        noise = variances[0]
        deviance = float(self.spare * np.log(noise) + logarithm + left / noise) + known
        return _Point(variances, deviance, ratio, inverse, u)

    def _information(self, priors: Sequence[Prior], at: "_Point") -> tuple[Array, Array]:
        """Score [1 + g] and expected information [1 + g, 1 + g] of σ² and θ, what is known
        included.
        """
        variances, noise, inner = at.variances, at.variances[0], at.inverse @ self.between
        of = (self.member == np.arange(len(variances) - 1)[:, None]).astype(np.float64)
        shared = at.ratio * at.u
        free = self.spare - len(at.ratio)
        # yᵀ P Z Zᵀ P y and tr(Zᵀ P Z) with the powers of σ² in them; for σ² itself Z is I
        square = np.array([self.square - shared @ (self.target + at.u), *(of @ at.u**2)])
        trace = np.array([free + np.trace(at.inverse), *(of @ np.diag(inner))])
        score = 0.5 * (square / noise - trace) / noise
        information = np.empty((len(variances), len(variances)))
        # where effects can explain every row, rounding is left: one degree of freedom at least
        information[0, 0] = max(free + np.sum(at.inverse * at.inverse.T), 1.0)
        information[0, 1:] = of @ np.sum(at.inverse * inner.T, axis=1)
        information[1:, 0] = information[0, 1:]
        information[1:, 1:] = of @ inner**2 @ of.T
        information *= 0.5 / noise**2
        for g, prior in enumerate(priors, start=1):
            slope, curvature = prior.information(float(variances[g]))
            score[g] += slope
            information[g, g] += curvature
        return score, information

    def solve(
        self, coefficients: Array, priors: Sequence[Prior], near: Array | None = None
    ) -> Solution:
        """Generalised least squares at the most likely variances; `coefficients` [p] are those of
        ordinary least squares, `near` as for `maximise`.
        """
        at = self.maximise(priors, near)
        variances, ratio, inverse, u = at.variances, at.ratio, at.inverse, at.u
        noise, theta, inner = variances[0], variances[1:], inverse @ self.between
        # Φ Xᵀ V⁻¹ = (Xᵀ X)⁻¹ Xᵀ − pull Zᵀ M, and its products with the Z_g; Φ = (Xᵀ V⁻¹ X)⁻¹
        pull = (self.into * ratio) @ inverse
        onto = self.into @ inverse.T
        groups = [self.member == g for g in range(len(theta))]
        slopes = np.empty((len(variances), *self.basis.shape))
        cross = np.empty((len(variances), *slopes.shape))
        slopes[0] = self.basis + pull @ self.between @ pull.T
        cross[0, 0] = pull @ inner @ pull.T / noise
        for g, own in enumerate(groups, start=1):
            slopes[g] = onto[:, own] @ onto[:, own].T
            cross[0, g] = -pull @ inner[:, own] @ onto[:, own].T / noise
            cross[g, 0] = cross[0, g].T
            for h, beside in enumerate(groups, start=1):
                part = inner[np.ix_(own, beside)] / noise
                cross[g, h] = onto[:, own] @ part @ onto[:, beside].T
        spread = _inverse(self._information(priors, at)[1], _free(priors))
        # a variance at zero is on average above the true one: what it adds is in the estimate
        inside = np.where(np.outer(variances, variances) > 0.0, spread, 0.0)
        covariance = np.tensordot(variances, slopes, 1) + 2.0 * np.tensordot(inside, cross, 2)
        cut = np.where(variances > 0.0, 1.0, CUT_AT_ZERO)
        found = coefficients - self.into @ (ratio * u)
        return Solution(
            found,
            covariance,
            ratio * u,
            variances,
            at.deviance,
            slopes,
            spread * np.outer(cut, cut),
        )


def _free(priors: Sequence[Prior]) -> Mask:
    """Which of σ² and θ [1 + g] the data have a say in."""
    return np.array([True, *(prior.dof < np.inf for prior in priors)])


def _inverse(information: Array, free: Mask) -> Array:
    """Inverse [m, m] of the information of the free variances, zero elsewhere."""
    size = np.sqrt(np.where(free, np.diag(information), 1.0))
    both = free & free[:, None]
    values, vectors = np.linalg.eigh(
        np.where(both, information / np.outer(size, size), np.eye(len(size)))
    )
    determined = values > RANK * values[-1]
    vectors = vectors[:, determined] / size[:, None]
    return np.where(both, vectors / values[determined] @ vectors.T, 0.0)
