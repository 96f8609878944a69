"""Orthogonality of two gyros from their scale factors about two table axes: N, ε, γ and the angle α
between them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.numeric import gum

NEAR_ONE = 10.0
"""Standard uncertainties of γ from |γ| = 1 within which first-order propagation to α fails."""
ONE_SIDED = 3.0
"""Standard uncertainties of γ from |γ| = 1 within which α may be 0° or 180° and its interval is
one-sided.
"""
IMPOSSIBLE = 0.05
"""Excess of |γ| over 1 that neither noise nor misalignment explains: the logs belong to other axes.
"""
SMALL_SINE = 0.01
"""Sine of the angle between the gyros below which two γ do not tell the error of mounting."""
DRAWS = 200_000
CONSISTENT = 4.0
"""Difference of two results, in standard uncertainties, above which they are inconsistent."""


@dataclass(frozen=True, slots=True)
class GyroPair:
    """Ratios and angle of two gyros, from K_A and K_B about their own axes and K_Ba of gyro B about
    A's axis.
    """

    N: float
    """K_B/K_A."""
    epsilon: float
    """K_Ba/K_A."""
    gamma: float
    """K_Ba/K_B = cos α, within [−1, 1]."""
    alpha_deg: float
    """Angle of B's input axis to A's axis [°], 0 to 180."""
    covariance: Array
    """[4, 4] of N, ε, γ, α [°]; type A."""
    dof: tuple[float, ...]
    """Effective degrees of freedom of N, ε, γ, α."""
    alpha_interval_deg: tuple[float, float]
    """95 % interval of α; where |γ| is within noise of one it is one-sided, from 0° or up to 180°.
    """
    indicated: Value
    """K_Ba/K_B before it was clamped, with its uncertainty to first order."""
    from_a: Value
    """Second estimate of γ, from gyro A about B's axis, with its uncertainty by noise."""

    @property
    def values(self) -> tuple[float, float, float, float]:
        """N, ε, γ, α [°]."""
        return self.N, self.epsilon, self.gamma, self.alpha_deg

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [4] of N, ε, γ, α [°]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def orthogonality_error_deg(self) -> float:
        """Orthogonality error 90° − α [°]."""
        return 90.0 - self.alpha_deg

    @property
    def same_side(self) -> bool:
        """Whether γ ≥ 0 (α ≤ 90°)."""
        return self.gamma >= 0.0


def find(K: Fit, from_a: Value, *, seed: int = 0, draws: int = DRAWS) -> GyroPair:
    """Ratios and angle of two gyros.

    Parameters
    ----------
    K : fit of K_A, K_B about the gyros' own axes and K_Ba of B about A's axis, in one unit.
    from_a : γ from gyro A about B's axis.
    seed, draws : of the Monte Carlo propagation near |γ| = 1.

    Returns
    -------
    GyroPair, after the published method: N = K_B/K_A, ε = K_Ba/K_A = N cos α, γ = ε/N = K_Ba/K_B.
    N and ε share K_A, N and γ share K_B: their errors are correlated, as the covariance states.

    Raises
    ------
    FitError
        A scale factor about its own axis that is zero or not finite, or |γ| too far above one for
        noise.

    """
    K_A, K_B, K_Ba = K.parameters.tolist()
    indicated, covariance = indicate(K), K.total_covariance
    ratios = K.restated(lambda k: np.stack((k[1] / k[0], k[2] / k[0], k[2] / k[1])))
    dof = ratios.of(lambda r: r).dof.tolist()
    u_gamma, gamma = float(indicated.u), float(np.clip(indicated.value, -1.0, 1.0))
    if 1.0 - abs(float(indicated.value)) <= NEAR_ONE * u_gamma:
        full, interval = _by_draws(K.parameters, covariance, np.random.default_rng(seed), draws)
    else:
        # α is monotonic in γ: its interval is that of γ
        half = gum.coverage_factor(float(indicated.dof), probability=0.95) * u_gamma
        ends = np.degrees(np.arccos(np.clip([gamma + half, gamma - half], -1.0, 1.0)))
        with_alpha = ratios.restated(lambda r: np.append(r, np.arccos(r[2]) * 180.0 / np.pi))
        full = with_alpha.total_covariance
        interval = float(ends[0]), float(ends[1])
    return GyroPair(
        N=K_B / K_A,
        epsilon=K_Ba / K_A,
        gamma=gamma,
        alpha_deg=float(np.degrees(np.arccos(gamma))),
        covariance=full,
        dof=(*dof, dof[2]),
        alpha_interval_deg=interval,
        indicated=indicated,
        from_a=from_a,
    )


def indicate(K: Fit) -> Value:
    """γ = K_Ba/K_B as it is indicated; FitError for K_A, K_B, K_Ba that no pair can have."""
    values, (K_A, K_B, K_Ba) = K.parameters, K.parameters.tolist()
    finite = np.isfinite(values).all() and np.isfinite(K.total_covariance).all()
    if not finite or K_A == 0.0 or K_B == 0.0:
        raise FitError(f"scale factors K_A {K_A:g}, K_B {K_B:g}, K_Ba {K_Ba:g} cannot give ratios")
    if abs(K_Ba / K_B) > 1.0 + IMPOSSIBLE:
        raise FitError(
            f"gamma {K_Ba / K_B:g} is far beyond 1: gyro B indicates more about A's axis than"
            " about its own",
            hint="check which log is of which table axis and which column is of which gyro",
        )
    return K.of(lambda k: k[2] / k[1])


def find_mounting(
    indicated: Value, from_a: Value, known: tuple[float, float] | None
) -> tuple[float, float]:
    """Standard deviation [rad] of the angle between a gyro's axis and its table axis, and its
    degrees of freedom: what the two γ of a pair by noise alone differ by, or what is known [°]
    pooled with it.
    """
    cosine = min(abs(float(indicated.value)), 1.0)
    sine = max(float(np.sqrt(1.0 - cosine**2)), SMALL_SINE)
    apart = (float(from_a.value) - float(indicated.value)) ** 2 if sine > SMALL_SINE else 0.0
    if known is None:
        # noise is not taken off: two γ that agree by chance would hide the tilts
        return float(np.sqrt(apart)) / sine, 1.0
    value, dof = np.radians(known[0]), known[1]
    noise = float(from_a.u) ** 2 + float(indicated.u) ** 2
    square = 0.5 * max(apart - noise, 0.0) / sine**2
    pooled = (dof * value**2 + square) / (dof + 1.0) if np.isfinite(dof) else value**2
    return float(np.sqrt(pooled)), dof + 1.0


def _by_draws(
    values: Array, covariance: Array, rng: np.random.Generator, draws: int
) -> tuple[Array, tuple[float, float]]:
    """Covariance [4, 4] and 95 % interval of α [°] by Monte Carlo within |γ| ≤ 1 (JCGM 101).

    Draws with |γ| > 1 are impossible angles and are left out; where nearly all are, the draws are
    moved onto |γ| = 1.
    """
    definite = np.linalg.eigvalsh(covariance)[0] > 1e-12 * np.trace(covariance)
    method: Literal["cholesky", "svd"] = "cholesky" if definite else "svd"
    K_A, K_B, K_Ba = rng.multivariate_normal(values, covariance, draws, method=method).T
    gamma = K_Ba / K_B
    indicated = float(values[2] / values[1])
    sign = 1.0 if indicated > 0.0 else -1.0
    possible = np.abs(gamma) <= 1.0
    if possible.mean() < 0.01:
        gamma = gamma - indicated + sign
        possible = np.abs(gamma) <= 1.0
    limited = np.clip(gamma, -1.0, 1.0)
    drawn = np.vstack((K_B / K_A, K_Ba / K_A, limited, np.degrees(np.arccos(limited))))
    if possible.any():
        # no draw is possible only where there is no uncertainty to draw from: the limit is then the
        # result
        drawn = drawn[:, possible]
    one_sided = 1.0 - abs(indicated) < ONE_SIDED * float(gamma.std())
    quantiles = (0.025, 0.975) if not one_sided else (0.0, 0.95) if sign > 0.0 else (0.05, 1.0)
    low, high = (float(np.quantile(drawn[3], q)) for q in quantiles)
    if one_sided:
        low, high = (0.0, high) if sign > 0.0 else (low, 180.0)
    return np.cov(drawn), (low, high)


def flag(indicated: Value, from_a: Value) -> Iterator[str]:
    """Flags of γ by noise alone, at its limits and against that from A about B's axis."""
    gamma, u = float(indicated.value), float(indicated.u)
    excess = abs(gamma) - 1.0
    if excess > 0.0:
        yield f"|gamma| {abs(gamma):.9g} clamped to 1"
    if excess > CONSISTENT * u:
        yield (
            f"|gamma| exceeds 1 by {excess * 1e6:.0f} ppm, more than noise explains: "
            "gyro B's own table axis is not its input axis, or the runs differ in temperature"
        )
    if -excess < ONE_SIDED * u:
        yield "|gamma| is within noise of 1: the interval of alpha is one-sided, by Monte Carlo"
    if abs(gamma) < 2.0 * u:
        yield "gamma is within noise of 0: its sign does not tell the side"
    expected = float(np.hypot(from_a.u, u))
    difference = float(from_a.value) - gamma
    if abs(difference) > CONSISTENT * expected:
        ratio = abs(difference) / max(expected, np.finfo(np.float64).tiny)
        yield (
            f"gamma from A about B's axis differs by {difference:.2g}, {ratio:.0f} standard"
            " uncertainties: a table axis is not the input axis of its gyro"
        )
