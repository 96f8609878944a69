"""The solver under all instruments: sizes of shared errors, uncertainty of results, outliers."""

import numpy as np
import pytest
from scipy import stats

from calibkit.errors import FitError, UsageError
from calibkit.fit import complex_step, likelihood
from calibkit.fit.shared import Shared
from calibkit.fit.solve import predict, solve


def shared(level, loading, **stated):
    """An error of some groups, "run zero"."""
    level, loading = np.asarray(level), np.asarray(loading, dtype=float)
    if loading.ndim == 1:
        loading = loading[:, None]
    return Shared(group="run", effect="zero", level=level, loading=loading, unit="V", **stated)


def straight(x, y):
    """Residual of y = p0 + p1 x."""
    return lambda p: p[0] + p[1] * x - y


@pytest.mark.parametrize(("runs", "rows", "spread"), [(2, 5, 3.0), (6, 8, 1.0)])
def test_the_mean_of_runs_has_the_variance_and_degrees_of_freedom_of_the_analysis_of_variance(
    runs, rows, spread
):
    """Var of the mean is the mean square between runs over all rows, with runs - 1 degrees of
    freedom: two switch-ons give one.
    """
    rng = np.random.default_rng(3)
    run = np.repeat(np.arange(runs), rows)
    y = spread * rng.standard_normal(runs)[run] + rng.standard_normal(runs * rows)
    fit = solve(lambda p: p[0] - y, np.zeros(1), [shared(run, np.ones(run.size))])
    means = y.reshape(runs, rows).mean(axis=1)
    between = rows * np.var(means, ddof=1)
    within = np.sum((y - means[run]) ** 2) / (runs * (rows - 1))
    mean = fit.of(lambda p: p[0])
    assert mean.value == pytest.approx(y.mean(), abs=1e-12)
    assert fit.shared[0].value ** 2 == pytest.approx((between - within) / rows, rel=1e-6)
    assert fit.noise[0] ** 2 == pytest.approx(within, rel=1e-6)
    assert mean.u**2 == pytest.approx(between / y.size, rel=1e-6)
    assert mean.dof == pytest.approx(runs - 1, rel=1e-6)
    assert mean.expanded == pytest.approx(stats.t.ppf(0.97725, mean.dof) * mean.u)


@pytest.mark.parametrize("spread", [1e3, 1e4, 1e5])
def test_runs_that_differ_by_far_more_than_their_noise_have_the_uncertainty_of_their_means(spread):
    """Three runs of a scale factor and a zero, one of them of another gyro: u of the mean is the
    standard deviation of the three over √3, with two degrees of freedom.
    """
    rng = np.random.default_rng(4)
    run, rate = np.repeat(np.arange(3), 12), np.tile(np.linspace(-1.0, 1.0, 12), 3)
    scale = np.array([0.0, spread, 0.0])[run]
    y = (7.0 + scale) * rate + 2.0 + rng.standard_normal(rate.size)
    errors = [shared(run, rate), shared(run, np.ones(rate.size))]
    fit = solve(lambda p: p[0] * rate + p[1] - y, np.zeros(2), errors)
    of_run = [np.polyfit(rate[run == k], y[run == k], 1)[0] for k in range(3)]
    mean = fit.of(lambda p: p[0])
    assert mean.value == pytest.approx(np.mean(of_run), rel=1e-6)
    assert mean.u == pytest.approx(np.std(of_run, ddof=1) / np.sqrt(3.0), rel=1e-4)
    assert mean.dof == pytest.approx(2.0, rel=1e-4)


def test_gyros_without_a_common_coefficient_are_solved_one_by_one_with_the_same_result(
    monkeypatch,
):
    """Two gyros of four runs each, with sizes in common: result, u and degrees of freedom are those
    of one matrix of both.
    """
    rng = np.random.default_rng(5)
    gyro, run = np.repeat([0, 1], 20), np.repeat(np.arange(8), 5)
    x = np.tile(np.linspace(-1.0, 1.0, 5), 8)
    y = 1.0 + gyro + x + rng.standard_normal(8)[run] + 0.2 * rng.standard_normal(40)

    def fitted():
        fit = solve(
            lambda p: p[gyro] + p[2 + gyro] * x - y,
            np.zeros(4),
            [shared(run, np.ones(40))],
            channel=gyro,
        )
        return fit.of(lambda p: p), len(fit.solution.rows.blocks)

    value, count = fitted()
    monkeypatch.setattr(likelihood, "blocks", lambda design: [one_block(design)])
    together, of_all = fitted()
    assert (count, of_all) == (2, 1)
    np.testing.assert_allclose(value.value, together.value, rtol=1e-10)
    np.testing.assert_allclose(value.u, together.u, rtol=1e-6)
    np.testing.assert_allclose(value.dof, together.dof, rtol=1e-5)


def one_block(design):
    """A matrix as one block."""
    return likelihood.DiagonalBlock(*(np.arange(count) for count in design.shape))


def test_the_noise_of_one_sensor_is_in_its_own_uncertainty_alone():
    """Of two sensors fitted together, the u of the one doubles with its noise, of the other not."""
    rng = np.random.default_rng(1)
    channel = np.repeat([0, 1], 40)
    noise = rng.standard_normal(80)

    def u(factor):
        y = noise * np.where(channel == 1, factor, 1.0)
        fit = solve(lambda p: p[channel] - y, np.zeros(2), channel=channel)
        return fit.of(lambda p: p).u

    assert u(2.0) == pytest.approx(u(1.0) * [1.0, 2.0], rel=1e-6)


def test_a_stated_size_replaces_the_estimated_one_and_few_degrees_of_freedom_lie_between():
    """Held at 5, the size is 5; stated with 4 degrees of freedom it moves to what six runs show."""
    run = np.repeat(np.arange(6), 4)
    y = np.random.default_rng(5).standard_normal(6)[run] + 0.1 * np.tile([1.0, -1.0], 12)

    def size(**stated):
        effect = shared(run, np.ones(24), **stated)
        return solve(lambda p: p[0] - y, np.zeros(1), [effect]).shared[0].value

    assert size(size=5.0) == 5.0
    assert size() < size(size=5.0, size_dof=4.0) < 5.0


def test_what_the_rows_cannot_tell_from_the_parameters_has_no_size_unless_one_is_stated():
    """One run: its zero is 0 with 0 degrees of freedom; stated, it is in u."""
    y = np.random.default_rng(2).standard_normal(10)
    run = np.zeros(10, dtype=int)

    def fitted(**stated):
        return solve(lambda p: p[0] - y, np.zeros(1), [shared(run, np.ones(10), **stated)])

    assert (fitted().shared[0].value, fitted().shared[0].dof) == (0.0, 0)
    u = np.std(y, ddof=1) / np.sqrt(10)
    assert fitted(size=2.0).of(lambda p: p[0]).u == pytest.approx(np.hypot(u, 2.0))


def test_an_optional_error_is_kept_where_the_likelihood_asks_for_it():
    """A drift of 5 noises in each run is kept, one of 0 is not."""
    rng = np.random.default_rng(8)
    run, t = np.repeat(np.arange(8), 9), np.tile(np.linspace(-1.0, 1.0, 9), 8)
    noise, drift = rng.standard_normal(72), rng.standard_normal(8)[run] * t
    for size, kept in ((0.0, 0), (5.0, 1)):
        y = noise + size * drift
        fit = solve(lambda p: p[0] - y, np.zeros(1), [shared(run, t, optional=True)])  # noqa: B023
        assert len(fit.shared) == kept


def test_an_error_below_a_bound_is_in_u_and_moves_no_value():
    """u² grows by the square of what the largest such error changes."""
    x = np.linspace(-1.0, 1.0, 9)
    y = 1.0 + 2.0 * x + 0.1 * np.cos(7.0 * x)
    bent = shared(np.zeros(9, dtype=int), x**2, size=0.5, bound=True)
    plain, bounded = (solve(straight(x, y), np.zeros(2), effects) for effects in ((), (bent,)))
    assert np.array_equal(plain.parameters, bounded.parameters)
    off = np.linalg.lstsq(np.column_stack([np.ones(9), x]), 0.5 * x**2)[0]
    u = [fit.of(lambda p: p).u for fit in (plain, bounded)]
    assert u[1] == pytest.approx(np.hypot(u[0], off))


def test_an_outlier_is_left_out_and_a_level_that_stands_apart_is_not():
    """One row of 30 noises goes; a run of 30 noises is an error of the run."""
    rng = np.random.default_rng(4)
    run = np.repeat(np.arange(5), 8)
    y = rng.standard_normal(40) + np.where(run == 2, 30.0, 0.0)
    y[3] += 30.0
    fit = solve(lambda p: p[0] - y, np.zeros(1), [shared(run, np.ones(40))], leave_out=True)
    assert np.flatnonzero(~fit.used).tolist() == [3]


def test_few_faultless_rows_are_hardly_ever_left_out():
    """Of 26 rows and nine parameters, a start without the three largest residuals takes them in
    again in all but one fit in a hundred: over a noise of 14 degrees of freedom they are not far.
    """
    rng = np.random.default_rng(8)
    left_out = 0
    for _ in range(150):
        x, y = rng.standard_normal((26, 9)), rng.standard_normal(26)
        residual = y - x @ np.linalg.lstsq(x, y)[0]
        kept = np.abs(residual) < np.sort(np.abs(residual))[-3]
        fit = solve(lambda p, x=x, y=y: x @ p - y, np.zeros(9), used=kept, leave_out=True)
        left_out += not fit.used.all()
    assert left_out <= 1


def test_an_outlier_alone_in_its_level_stays_left_out():
    """Nothing tells its error from one of the level, of a size that no other level has."""
    rng = np.random.default_rng(4)
    level = np.append(np.repeat(np.arange(12), 4), 12)
    y = rng.standard_normal(49) + np.where(level == 12, 1e3, 0.0)
    fit = solve(
        lambda p: p[0] - y,
        np.zeros(1),
        [shared(level, np.ones(49))],
        used=level < 12,
        leave_out=True,
    )
    assert np.flatnonzero(~fit.used).tolist() == [48]
    assert fit.shared[0].value < 1.0


def test_a_product_of_parameters_is_fitted_as_the_ratio_of_two_lines():
    """Of y = a (1 + b x), b is the slope over the zero of the straight line, with its u."""
    x = np.linspace(0.0, 1.0, 20)
    y = 3.0 * (1.0 + 0.4 * x) + 0.01 * np.sin(50.0 * x)
    fit = solve(lambda p: p[0] * (1.0 + p[1] * x) - y, np.array([1.0, 0.0]))
    line = solve(straight(x, y), np.zeros(2))
    ratio = line.of(lambda p: p[1] / p[0])
    assert fit.converged
    assert fit.parameters[1] == pytest.approx(ratio.value, rel=1e-9)
    assert fit.of(lambda p: p[1]).u == pytest.approx(ratio.u, rel=1e-5)


def test_a_published_form_has_the_errors_of_the_fit_and_its_own_values():
    """Least squares of a line on rows with a shared zero: values of least squares, and the variance
    of the analysis of variance.
    """
    rng = np.random.default_rng(6)
    run, x = np.repeat(np.arange(6), 5), np.tile(np.arange(5.0), 6)
    y = rng.standard_normal(6)[run] + 0.3 * rng.standard_normal(30)
    fit = solve(straight(x, y), np.zeros(2), [shared(run, np.ones(30))])
    P = np.linalg.pinv(np.column_stack([np.ones(30), x]))
    published = fit.linear(P, y)
    assert published.parameters == pytest.approx(P @ y)
    # balanced rows: weighted and plain least squares are the same line
    assert published.covariance == pytest.approx(fit.covariance, rel=1e-2)


def test_many_rows_are_turned_into_few_without_a_change():
    """12,000 rows in three parts that fit in memory one by one give the sizes of their groups."""
    rng = np.random.default_rng(9)
    run = np.arange(12000) % 30
    y = 2.0 * rng.standard_normal(30)[run] + rng.standard_normal(12000)
    fit = solve(lambda p: p[0] - y, np.zeros(1), [shared(run, np.ones(12000))])
    means = np.bincount(run, y) / 400
    assert fit.shared[0].value == pytest.approx(np.std(means, ddof=1), rel=1e-2)
    assert fit.of(lambda p: p[0]).u == pytest.approx(np.std(means, ddof=1) / np.sqrt(30), rel=1e-6)


@pytest.mark.parametrize(
    "function",
    [
        lambda p: complex_step.length(np.stack([p, 2.0 * p], axis=-1)),
        lambda p: complex_step.arctan2(p, 0.3 - p**2),
    ],
)
def test_functions_that_numpy_does_not_continue_have_the_derivative_of_differences(function):
    """Compared with central differences at values on both sides of a kink."""
    p, h = np.array([0.1, 0.5, 0.9]), 1e-6
    steps = np.eye(3) * h
    differences = np.stack([(function(p + s) - function(p - s)) / (2 * h) for s in steps], axis=-1)
    assert complex_step.derivative(function, p) == pytest.approx(differences, abs=1e-8)


def test_a_restated_fit_states_what_the_fit_itself_does():
    """A result of intercept and slope relative to the intercept has value, u and degrees of freedom
    of the same function of the parameters, with a bound error in u.
    """
    rng = np.random.default_rng(8)
    x, run = np.tile(np.linspace(1.0, 2.0, 6), 4), np.repeat(np.arange(4), 6)
    y = 3.0 + 0.5 * x + 0.2 * rng.standard_normal(4)[run] + 0.05 * rng.standard_normal(24)
    bound = shared(np.zeros(24, dtype=int), x, size=0.1, bound=True)
    fit = solve(straight(x, y), np.ones(2), [shared(run, np.ones(24)), bound])
    other = fit.restated(lambda p: np.stack([p[0], p[1] / p[0]]))
    found, same = fit.of(lambda p: p[1] / p[0] + p[0]), other.of(lambda q: q[1] + q[0])
    assert same.value == pytest.approx(found.value, rel=1e-12)
    assert same.u == pytest.approx(found.u, rel=1e-12)
    assert same.dof == pytest.approx(found.dof, rel=1e-9)


def test_sizes_of_errors_beside_a_known_noise_do_not_depend_on_the_unit():
    """Scatter of each row and of three runs beside known noise: both sizes scale with the unit."""
    rng = np.random.default_rng(0)
    run, noise = np.arange(36) % 3, rng.uniform(0.2, 2.0, 36)
    y = rng.standard_normal(36) * noise + 0.5 * rng.standard_normal(36) + 0.3 * run
    errors = [shared(run, np.ones(36)), shared(np.arange(36), np.ones(36))]

    def sizes(unit):
        fit = solve(
            lambda p: p[0] - unit * y, np.zeros(1), errors, noise=unit * noise, estimate_noise=False
        )
        return [size.value / unit for size in fit.shared]

    assert sizes(1e-4) == pytest.approx(sizes(1.0), rel=1e-4)
    assert min(sizes(1.0)) > 0.1


@pytest.mark.parametrize("size", [0.002, 0.1, 5.0])
def test_a_stated_size_that_the_rows_do_not_show_keeps_its_degrees_of_freedom(size):
    """One run cannot show how runs differ: the variance of its mean is that of the noise and of the
    stated size, with degrees of freedom of both (Welch and Satterthwaite).
    """
    y = 2.0 + 0.3 * np.random.default_rng(4).standard_normal(30)
    run = shared(np.zeros(30, dtype=int), np.ones(30), size=size, size_dof=5.0)
    mean = solve(lambda p: p[0] - y, np.zeros(1), [run]).of(lambda p: p[0])
    noise = np.var(y, ddof=1) / 30
    assert mean.u**2 == pytest.approx(noise + size**2, rel=1e-6)
    dof = (noise + size**2) ** 2 / (noise**2 / 29 + size**4 / 5.0)
    assert mean.dof == pytest.approx(min(dof, 29.0), rel=1e-3)


@pytest.mark.parametrize(("runs", "rows"), [(2, 5), (6, 8)])
def test_a_prediction_has_the_degrees_of_freedom_of_the_runs(runs, rows):
    """The mean of runs whose size is as good as unknown has runs - 1, one whose size is known those
    of the statement.
    """
    run = np.repeat(np.arange(runs), rows)

    def mean(size_dof):
        error = shared(run, np.ones(run.size), size=3.0, size_dof=size_dof)
        noise = np.ones(run.size)
        fit = predict(lambda p: p[0] * noise, np.zeros(1), [error], noise=noise)
        return fit.of(lambda p: p[0])

    assert mean(1e-6).u ** 2 == pytest.approx(9.0 / runs + 1.0 / run.size)
    assert mean(1e-6).dof == pytest.approx(runs - 1, rel=1e-3)
    assert mean(1e6).dof == pytest.approx(run.size - 1)


def test_what_imagined_rows_do_not_determine_is_refused_by_name():
    """A column that repeats another one, and an error of no stated size."""
    x, noise = np.linspace(-1.0, 1.0, 9), np.ones(9)
    with pytest.raises(FitError, match="slope"):
        predict(
            lambda p: (p[0] + 2.0 * p[1]) * x, np.zeros(2), noise=noise, names=["scale", "slope"]
        )
    with pytest.raises(UsageError, match="'zero' of group 'run' is not known"):
        predict(straight(x, 0.0), np.zeros(2), [shared(np.arange(9) // 3, noise)], noise=noise)
