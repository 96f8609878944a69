"""Orthogonality of two gyros from their scale factors about two table axes: N, ε, γ and the angle α
between them.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric.scale_factor import RunScales
from calibkit.numeric import gum

Side = Literal["same", "opposite"]

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
class OneTemperature:
    """What brings the scale factors of both runs to one temperature."""

    warmer_degc: tuple[float, float]
    """From the temperature of the run about A's axis, and of that about B's, to the common one."""
    coefficients: Array
    """Relative change of the scale factors of A and B [2] [1/°C]."""
    covariance: Array
    """[2, 2] of the coefficients."""


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
    alpha_interval_deg: tuple[float, float]
    """95 % interval of α; where |γ| is within noise of one it is one-sided, from 0° or up to 180°.
    """
    side: Side
    """`same` for γ ≥ 0 (α ≤ 90°), `opposite` for γ < 0."""
    clamped: bool
    """Whether noise gave |γ| > 1."""
    gamma_indicated: float
    """K_Ba/K_B before it was clamped."""
    flags: tuple[str, ...]
    gamma_from_a: tuple[float, float] = (float("nan"), float("nan"))
    """Second estimate of γ, from gyro A about B's axis, and its standard uncertainty by noise; NaN
    where A was not turned about B's axis.
    """
    noise_of_gamma: float = float("nan")
    """Standard uncertainty of γ by noise alone."""
    mounting_deg: tuple[float, float] = (0.0, float("inf"))
    """Standard deviation of the angle between a gyro's axis and the table axis that is nominally
    its own, and its degrees of freedom.
    """
    dof: tuple[float, ...] = (float("inf"),) * 4
    """Effective degrees of freedom of N, ε, γ, α."""

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


def _pair(
    K_A: float,
    K_B: float,
    K_Ba: float,
    covariance: Array,
    *,
    seed: int = 0,
    draws: int = DRAWS,
    dof: float = float("inf"),
) -> GyroPair:
    """Ratios and angle of two gyros with their full covariance.

    Parameters
    ----------
    K_A, K_B : scale factors of A and B about their own axes, in one unit.
    K_Ba : scale factor of B about A's axis, in the same unit.
    covariance : [3, 3] of K_A, K_B, K_Ba; K_A and K_Ba of one table run are correlated by what the
        run shares.
    seed, draws : of the Monte Carlo propagation near |γ| = 1.
    dof : effective degrees of freedom of γ.

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
    values = np.array([K_A, K_B, K_Ba])
    _require_ratios(values, covariance)
    indicated = K_Ba / K_B
    jacobian = _ratios_jacobian(K_A, K_B, K_Ba)
    ratios = jacobian @ covariance @ jacobian.T
    u_gamma = float(np.sqrt(ratios[2, 2]))
    gamma = float(np.clip(indicated, -1.0, 1.0))
    alpha = float(np.degrees(np.arccos(gamma)))
    near = 1.0 - abs(indicated) <= NEAR_ONE * u_gamma
    if near:
        full, interval = _by_draws(values, covariance, np.random.default_rng(seed), draws)
    else:
        factor = gum.coverage_factor(dof, probability=0.95)
        full, interval = _first_order(ratios, gamma, alpha, factor)
    return GyroPair(
        N=K_B / K_A,
        epsilon=K_Ba / K_A,
        gamma=gamma,
        alpha_deg=alpha,
        covariance=full,
        alpha_interval_deg=interval,
        side="same" if gamma >= 0.0 else "opposite",
        clamped=abs(indicated) > 1.0,
        gamma_indicated=indicated,
        flags=_flags(indicated, u_gamma),
    )


def _require_ratios(values: Array, covariance: Array) -> None:
    """Raise FitError for K_A, K_B, K_Ba that no pair can have."""
    K_A, K_B, K_Ba = values.tolist()
    if (
        not (np.isfinite(values).all() and np.isfinite(covariance).all())
        or K_A == 0.0
        or K_B == 0.0
    ):
        raise FitError(f"scale factors K_A {K_A:g}, K_B {K_B:g}, K_Ba {K_Ba:g} cannot give ratios")
    if abs(K_Ba / K_B) > 1.0 + IMPOSSIBLE:
        raise FitError(
            f"gamma {K_Ba / K_B:g} is far beyond 1: gyro B indicates more about A's axis than"
            " about its own",
            hint="check which log is of which table axis and which column is of which gyro",
        )


def from_runs(
    about_a: RunScales,
    about_b: RunScales,
    *,
    one_temperature: OneTemperature | None = None,
    mounting_deg: tuple[float, float] | None = None,
    seed: int = 0,
) -> GyroPair:
    """Pair from the table runs about A's reference axis and about B's own axis; gyro A is first and
    B second in both.

    K_A and K_Ba come from the first run and share its noise, K_B from the second; gyro A in the
    second run checks γ. What the two γ differ by is the error of mounting, with one degree of
    freedom; `mounting_deg` gives what is known of it, a standard deviation and its degrees of
    freedom.
    """
    values, covariance = _scale_factors(about_a, about_b, one_temperature)
    K_A, K_B, K_Ba, K_Ab = values.tolist()
    noise = _pair(K_A, K_B, K_Ba, covariance[:3, :3], seed=seed)
    gamma, uncertainty, flags = _cross_check(noise, K_A, K_Ab, covariance[np.ix_((0, 3), (0, 3))])
    tilt, tilt_dof = _mounting(noise, gamma, uncertainty, mounting_deg)
    # a cosine is lost about a gyro's own axis, a sine about the other's
    across = np.sin(np.radians(noise.alpha_deg))
    mounted = np.array([K_A * tilt**2, K_B * tilt**2, K_B * tilt * across]) ** 2
    shares = _ratios_jacobian(K_A, K_B, K_Ba) ** 2 @ mounted
    # the degrees of freedom of noise are not counted: they are many
    dof = np.full(3, np.inf)
    held = shares > 0.0
    dof[held] = tilt_dof * ((np.diag(noise.covariance)[:3] + shares)[held] / shares[held]) ** 2
    found = _pair(
        K_A, K_B, K_Ba, covariance[:3, :3] + np.diag(mounted), seed=seed, dof=float(dof[2])
    )
    return replace(
        found,
        flags=(*noise.flags, *flags),
        gamma_from_a=(gamma, uncertainty),
        noise_of_gamma=float(noise.standard_uncertainty[2]),
        mounting_deg=(float(np.degrees(tilt)), tilt_dof),
        dof=(*dof.tolist(), float(dof[2])),
    )


def _scale_factors(
    about_a: RunScales, about_b: RunScales, one_temperature: OneTemperature | None
) -> tuple[Array, Array]:
    """K_A, K_B, K_Ba and K_Ab of two runs at one temperature, and their covariance [4, 4]."""
    if about_a.K.size != 2 or about_b.K.size != 2:
        raise FitError(
            f"{about_a.K.size} and {about_b.K.size} gyros in the runs of a pair",
            hint="give two columns",
        )
    values = np.array([about_a.K[0], about_b.K[1], about_a.K[1], about_b.K[0]])
    covariance = np.zeros((4, 4))
    covariance[np.ix_((0, 2), (0, 2))] = about_a.covariance
    covariance[np.ix_((3, 1), (3, 1))] = about_b.covariance
    if one_temperature is not None:
        # gyro and run of each
        warmer = np.array(one_temperature.warmer_degc)[[0, 1, 0, 1]]
        slopes = (values * warmer)[:, None] * np.eye(2)[[0, 1, 1, 0]]
        values = values + slopes @ one_temperature.coefficients
        covariance = covariance + slopes @ one_temperature.covariance @ slopes.T
    return values, covariance


def _mounting(
    noise: GyroPair, gamma: float, uncertainty: float, known: tuple[float, float] | None
) -> tuple[float, float]:
    """Standard deviation [rad] of the angle between a gyro's axis and its table axis, and its
    degrees of freedom: what two γ differ by, or what is known [°] pooled with it.
    """
    sine = float(np.sin(np.radians(noise.alpha_deg)))
    apart = (gamma - noise.gamma_indicated) ** 2 if sine > SMALL_SINE else 0.0
    if known is None:
        # noise is not taken off: two γ that agree by chance would hide the tilts
        return float(np.sqrt(apart)) / max(sine, SMALL_SINE), 1.0
    value, dof = np.radians(known[0]), known[1]
    by_noise = uncertainty**2 + float(noise.standard_uncertainty[2]) ** 2
    square = 0.5 * max(apart - by_noise, 0.0) / max(sine, SMALL_SINE) ** 2
    pooled = (dof * value**2 + square) / (dof + 1.0) if np.isfinite(dof) else value**2
    return float(np.sqrt(pooled)), dof + 1.0


def _ratios_jacobian(K_A: float, K_B: float, K_Ba: float) -> Array:
    """Derivatives [3, 3] of N, ε, γ with respect to K_A, K_B, K_Ba."""
    return np.array(
        [
            [-K_B / K_A**2, 1.0 / K_A, 0.0],
            [-K_Ba / K_A**2, 0.0, 1.0 / K_A],
            [0.0, -K_Ba / K_B**2, 1.0 / K_B],
        ]
    )


def _first_order(
    ratios: Array, gamma: float, alpha_deg: float, factor: float
) -> tuple[Array, tuple[float, float]]:
    """Covariance [4, 4] of N, ε, γ, α by dα = −dγ/sin α, and the 95 % interval of α [°] from the
    interval of γ.
    """
    extend = np.vstack((np.eye(3), [0.0, 0.0, -np.degrees(1.0 / np.sqrt(1.0 - gamma**2))]))
    u_gamma = float(np.sqrt(ratios[2, 2]))
    low, high = np.degrees(
        np.arccos(np.clip([gamma + factor * u_gamma, gamma - factor * u_gamma], -1.0, 1.0))
    )
    return np.asarray(extend @ ratios @ extend.T), (
        min(float(low), alpha_deg),
        max(float(high), alpha_deg),
    )


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


def _flags(indicated: float, u_gamma: float) -> tuple[str, ...]:
    """Flags of γ and its angle."""
    flags = []
    excess = abs(indicated) - 1.0
    if excess > 0.0:
        flags.append(f"|gamma| {abs(indicated):.9g} clamped to 1")
    if excess > CONSISTENT * u_gamma:
        flags.append(
            f"|gamma| exceeds 1 by {excess * 1e6:.0f} ppm, more than noise explains: "
            "gyro B's own table axis is not its input axis, or the runs differ in temperature"
        )
    if -excess < ONE_SIDED * u_gamma:
        flags.append(
            "|gamma| is within noise of 1: the interval of alpha is one-sided, by Monte Carlo"
        )
    if abs(indicated) < 2.0 * u_gamma:
        flags.append("gamma is within noise of 0: its sign does not tell the side")
    return tuple(flags)


def _cross_check(
    result: GyroPair, K_A: float, K_Ab: float, covariance: Array
) -> tuple[float, float, tuple[str, ...]]:
    """Second estimate of γ, K_Ab/K_A from gyro A turned about B's axis, compared with the first.

    Parameters
    ----------
    result : the pair.
    K_A, K_Ab : scale factors of A about its own and about B's axis.
    covariance : [2, 2] of K_A, K_Ab.

    Returns
    -------
    γ, its standard uncertainty, and a flag where both differ by more than their uncertainties
    explain.

    """
    gamma = K_Ab / K_A
    gradient = np.array([-K_Ab / K_A**2, 1.0 / K_A])
    uncertainty = float(np.sqrt(gradient @ covariance @ gradient))
    expected = float(np.hypot(uncertainty, result.standard_uncertainty[2]))
    difference = gamma - result.gamma_indicated
    if abs(difference) <= CONSISTENT * expected:
        return gamma, uncertainty, ()
    ratio = abs(difference) / max(expected, np.finfo(np.float64).tiny)
    flag = (
        f"gamma from A about B's axis differs by {difference:.2g}, {ratio:.0f} standard"
        " uncertainties: a table axis is not the input axis of its gyro"
    )
    return gamma, uncertainty, (flag,)
