"""Runs of two gyros about two table axes → N, ε, γ and the angle between the gyros.

K_A and K_B are scale factors about the gyros' own axes, K_Ba that of B about A's axis, K_Ab that of
A about B's:

    N = K_B/K_A,   ε = K_Ba/K_A,   γ = K_Ba/K_B = cos α,   second γ = K_Ab/K_A

Each is a function of the four (`Fit.of`), whose covariance holds in turn: errors of the held rates
and how runs repeat; the difference between the runs' temperatures; how a gyro's axis is off its
table axis.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.frame import Remark
from calibkit.instruments.gyro_scale import (
    contradictions,
    forms,
    lines,
    ordering,
    over_runs,
    table_runs,
)
from calibkit.instruments.gyro_scale.campaign import Campaign, Channel, GyroPair, stated_components
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
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
OPPOSITE = 20.0
"""Standard uncertainties: two γ that differ by more than this, while their sum is within it, count
as equal and opposite.
"""
OWN_AND_CROSS = [0, 3, 2, 1]
"""Places of K_A, K_B, K_Ba, K_Ab among the lines of A about a, A about b, B about a, B about b."""
CHANNELS = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""Gyro and table axis of each line, own axes first."""
FLAGGED_DEGC = 0.2
"""Difference between the two runs' temperatures [°C] from which it is flagged."""


def fit_pair(
    spec: GyroPairRecipe,
    runs: Mapping[str, tuple[table_runs.TableRun, ...]],
    near: Campaign | None = None,
) -> Campaign:
    """Fit N, ε, γ and α to the runs about both table axes; the covariance holds the errors of held
    rates, how runs repeat, the difference between the runs' temperatures, and the mounting. `near`
    is a fit of nearly the same runs.
    """
    about = [(k, run) for k, axis in enumerate("ab") for run in runs[axis]]
    run_lines = lines.Lines.of([about], near.run_lines if near else None)
    if near:
        run_lines = replace(
            run_lines, fit=replace(near.run_lines.fit, parameters=run_lines.fit.parameters)
        )
    known = spec.known_errors()
    run_scale = run_lines.run_scale(known.get("scale"))
    # K [4], then F0 [4], of A about a, A about b, B about a, B about b: means over the runs
    means = np.kron(
        np.eye(2), run_lines.means(np.ones(run_lines.gyro_of.size, dtype=np.bool_)).reshape(4, -1)
    )
    mean_lines = run_lines.combined(*np.hsplit(means, 2)).widened_by(
        [run_scale] if run_scale else []
    )
    degc = {axis: float(np.mean([run.temp_degc for run in runs[axis]])) for axis in "ab"}
    apart = degc["b"] - degc["a"]
    K = mean_lines.weighted(np.eye(8)[OWN_AND_CROSS])
    if np.isfinite(apart):
        K = _at_one_temperature(K, apart, spec)
    from_a = K.of(lambda k: k[3] / k[0])
    K = K.weighted(np.eye(3, 4))
    by_noise = indicate(K)
    _refuse_opposite(by_noise, from_a)
    tilt, tilt_dof = find_mounting(by_noise, from_a, known.get("angle"))
    # about the other gyro's axis a gyro loses its sine, K sin α per radian
    sine = np.sqrt(max(1.0 - float(by_noise.value) ** 2, 0.0))
    K_A, K_B = K.parameters[:2] * sine
    across = np.array([[[0.0], [K_A]], [[K_B], [0.0]]])
    mounting = run_lines.mounting(across, (float(np.degrees(tilt)), tilt_dof))
    K = K.widened_by([mounting])
    # about its own axis either gyro alone loses K (1 - cos tilt) at most, taken as large as K tilt²
    cosine = np.vstack((np.diag(K.parameters[:2] * tilt**2), np.zeros(2)))
    K = replace(K, bounds=np.column_stack((K.bounds, cosine)))
    pair = find_ratios(K, from_a)
    channels = []
    for number, (gyro, axis) in enumerate(CHANNELS):
        line_at = 2 * "ab".index(gyro) + "ab".index(axis)
        near_response = near.channels[number].over if near else None
        channels.append(
            Channel(
                gyro,
                axis,
                own=gyro == axis,
                runs=runs[axis],
                repeated=runs[axis],
                line=mean_lines.weighted(np.eye(8)[[line_at, line_at + 4]]),
                over=over_runs.fit_response(spec, gyro, runs[axis], near_response)
                if gyro == axis
                else None,
                components=stated_components(run_scale),
            )
        )
    flags: list[str] = []
    if not near:
        flags = [flag for _, run in about for flag in run.flags]
        flags += run_lines.flag_drifts()
        flags += flag_gamma(by_noise, from_a)
        flags += _flag_temperatures(apart, spec)
        if run_scale is None:
            flags.append(Remark(f"N: {lines.WITHIN}"))
        if tilt > 0.0 and "angle" not in known:
            flags += _flag_mounting(mounting, pair.dof[2])
        flags += _flag_lines(runs, run_lines)
    return Campaign(
        tuple(channels),
        run_lines,
        tuple(dict.fromkeys(flags)),
        stated_components(run_scale, mounting),
        pair=pair,
    )


def _flag_mounting(mounting: Shared, gamma_dof: float) -> Iterator[str]:
    """Flag for a mounting error that only the two γ tell."""
    yield (
        f"the two runs show a mounting error of {mounting.size:.2g}°, which is in u of gamma"
        f" and alpha with {gamma_dof:.2g} degrees of freedom (k ="
        f" {gum.coverage_factor(gamma_dof):.3g}): state how well a mounting repeats in"
        ' [[errors.component]] group = "mounting", effect = "angle"'
    )


def _flag_lines(
    runs: Mapping[str, tuple[table_runs.TableRun, ...]], run_lines: lines.Lines
) -> Iterator[str]:
    """Flags of scale factors about the own axes: time, doubtful runs, runs that contradict the
    others.
    """
    for change in run_lines.in_time:
        name = forms.line_name("ab"[change.gyro])
        yield from ordering.flag(name, change.decided, run_lines.K[change.lines].mean())
    for gyro in "ab":
        name = forms.line_name(gyro, gyro)
        K = run_lines.of_runs(runs[gyro], gyro)
        yield from table_runs.flag_uncertain([name] * len(runs[gyro]), K)
        yield from contradictions.flag_runs(name, runs[gyro], K)


def _refuse_opposite(by_noise: Value, from_a: Value) -> None:
    """Raise FitError for two γ that are equal and opposite."""
    one, other = float(by_noise.value), float(from_a.value)
    limit = OPPOSITE * float(np.hypot(by_noise.u, from_a.u))
    if abs(other - one) > limit > abs(other + one):
        raise FitError(
            f"gamma is {one:.6g} from B about A's axis and {other:.6g} from A"
            " about B's: equal and opposite",
            hint=(
                "one gyro, or the table, has opposite signs in the two logs; state the sign in"
                " [columns]"
            ),
        )


def _at_one_temperature(K: Fit, apart_degc: float, spec: GyroPairRecipe) -> Fit:
    """K_A, K_B, K_Ba and K_Ab at the temperature in the middle of both runs, by the stated
    temperature coefficients of the gyros, or by a coefficient of zero within the largest one that
    is possible, alike for both.
    """
    gyro, half, stated = [0, 1, 1, 0], apart_degc / 2.0, spec.pair.temperature_coefficients_ppm_degc
    warmer = np.array([half, -half, half, -half])
    if stated is None:
        coefficients = np.zeros(2)
        limit = spec.pair.largest_temperature_coefficient_ppm_degc / gjb_figures.PPM
        unknown = np.full((2, 1), limit / np.sqrt(3.0))
    else:
        coefficients = np.array([stated.a, stated.b]) / gjb_figures.PPM
        u = spec.pair.temperature_coefficient_uncertainty_ppm_degc / gjb_figures.PPM
        unknown = u * np.eye(2)
    by_coefficient = (K.parameters * warmer)[:, None] * unknown[gyro]
    found = K.restated(lambda k: k * (1.0 + warmer * coefficients[gyro]))
    return replace(found, bounds=np.column_stack((found.bounds, by_coefficient)))


def _flag_temperatures(apart_degc: float, spec: GyroPairRecipe) -> Iterator[str]:
    """Flag for runs at two temperatures, with what N carries of it."""
    if np.isnan(apart_degc):
        yield ("temperature is not logged: N carries no difference between the runs' temperatures")
    elif abs(apart_degc) > FLAGGED_DEGC and spec.pair.temperature_coefficients_ppm_degc is None:
        limit = spec.pair.largest_temperature_coefficient_ppm_degc
        carried = limit * abs(apart_degc) / np.sqrt(3.0)
        yield (
            f"the two runs are {abs(apart_degc):.1f} °C apart: u of N holds {carried:.2g} ppm for"
            f" scale factors that change by up to {limit:g} ppm/°C, gamma that of K_B; run both at"
            " one temperature, or state pair.temperature_coefficients_ppm_degc"
        )


def find_ratios(K: Fit, from_a: Value, *, seed: int = 0, draws: int = DRAWS) -> GyroPair:
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


def flag_gamma(indicated: Value, from_a: Value) -> Iterator[str]:
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
