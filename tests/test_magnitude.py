"""Nine parameters from the length of gravity alone: two solvers, intervals, warnings."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import t

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import magnitude, norms, q_factor
from calibkit.numeric.least_squares import gauss_newton, gram

TRUTH = np.array([1.012, 0.985, 1.004, 0.011, -0.02, 0.007, 0.0043, -0.0087, 0.0121])
NOISE_G = 2e-5


def sphere(count):
    """Evenly spread unit vectors [count, 3] (golden spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.column_stack(
        [np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z]
    )


def indications(vectors, seed=0, *, truth=TRUTH, noise=NOISE_G):
    """Indications of a triad with these nine parameters."""
    exact = truth[:3] * (vectors @ q_factor.axes_from_angles(truth[6:]).T) + truth[3:6]
    return exact + np.random.default_rng(seed).normal(0.0, noise, exact.shape)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_exact_dwells_give_the_parameters_back(seed):
    """Any sane triad comes out of exact dwells to 1e-10, whatever the unit of its indications."""
    rng = np.random.default_rng(seed)
    counts = 10.0 ** rng.uniform(-1.0, 4.5)
    truth = np.concatenate(
        [rng.uniform(0.7, 1.4, 3), rng.uniform(-2.0, 2.0, 3), rng.uniform(-0.08, 0.08, 3)]
    )
    truth[:6] *= counts
    found = magnitude.fit(indications(sphere(30), truth=truth, noise=0.0)).parameters
    np.testing.assert_allclose(found[:6] / counts, truth[:6] / counts, atol=1e-10)
    np.testing.assert_allclose(found[6:], truth[6:], atol=1e-10)  # rad


def test_corrected_vectors_have_the_length_of_gravity_and_the_angles_of_the_truth():
    """In the frame of the triad, corrected components are the vectors that were felt."""
    vectors = sphere(24)
    fitted = magnitude.fit(9.8 * indications(vectors, noise=0.0), 9.80665)
    corrected = (9.8 * indications(vectors, noise=0.0) - fitted.bias) @ fitted.matrix.T
    np.testing.assert_allclose(corrected, 9.80665 * vectors, atol=1e-9)


@pytest.mark.parametrize("noisy", [False, True])
def test_both_solvers_agree(noisy):
    """Blocked Gauss-Newton and bounded lmfit agree to 1e-6 standard uncertainties, uncertainties to
    1e-6.
    """
    noise = np.full(28, NOISE_G) if noisy else None
    fast = magnitude.fit(indications(sphere(28)), noise=noise)
    bounded, intervals = magnitude.fit_bounded(indications(sphere(28)), noise=noise)
    assert np.max(np.abs(bounded.parameters - fast.parameters) / fast.standard_uncertainty) < 1e-6
    np.testing.assert_allclose(bounded.standard_uncertainty, fast.standard_uncertainty, rtol=1e-6)
    assert bounded.flags == fast.flags == ()
    half = np.array([(high - low) / 2.0 for low, high in intervals.values()])
    np.testing.assert_allclose(half, fast.half_width, rtol=2e-3)
    middle = np.array([(high + low) / 2.0 for low, high in intervals.values()])
    assert np.max(np.abs(middle - fast.parameters) / fast.standard_uncertainty) < 0.01


def test_blocks_change_nothing():
    """A set folded in blocks of seven rows gives the fit of one block to rounding."""
    indicated, root = indications(sphere(60)), np.ones(60)

    def residuals(parameters, rows):
        return norms.length_residuals(parameters, indicated[rows], 1.0, root[rows])

    begin = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    whole, cut = (gauss_newton.fit(residuals, begin, 60, block_rows=rows) for rows in (60, 7))
    np.testing.assert_allclose(cut.parameters, whole.parameters, atol=1e-13)
    np.testing.assert_allclose(cut.covariance, whole.covariance, rtol=1e-8, atol=1e-22)
    assert cut.residual_count == 60


def test_large_sets_are_fitted_block_by_block():
    """Thirty thousand raw rows give parameters, residuals and leverages as the closed forms say."""
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(30_000, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    fitted = magnitude.fit(indications(vectors, noise=1e-3))
    assert np.max(np.abs(fitted.parameters - TRUTH) / fitted.standard_uncertainty) < 4.0
    assert np.sum(fitted.leverage) == pytest.approx(9.0)
    corrected = (indications(vectors, noise=1e-3) - fitted.bias) @ fitted.matrix.T
    np.testing.assert_allclose(
        fitted.residuals, np.linalg.norm(corrected, axis=1) - 1.0, atol=1e-13
    )


def test_axes_of_very_different_scale_still_converge():
    """A start from the best sphere is good enough for scale factors in the ratio of three to
    one.
    """
    truth = TRUTH.copy()
    truth[:3] = [3000.0, 1000.0, 1800.0]
    found = magnitude.fit(indications(sphere(40), truth=truth, noise=0.0)).parameters
    np.testing.assert_allclose(found, truth, rtol=1e-9, atol=1e-9)


def test_intervals_cover_the_truth():
    """Over simulated sets the 95 % intervals cover 93 to 97 % of the nine parameters."""
    fits = [magnitude.fit(indications(sphere(18), seed)) for seed in range(150)]
    covered = [
        np.abs(f.parameters - TRUTH) <= t.ppf(0.975, f.dof) * f.standard_uncertainty for f in fits
    ]
    assert 0.93 <= np.mean(covered) <= 0.97
    assert np.mean([f.residual_rms**2 for f in fits]) == pytest.approx(NOISE_G**2, rel=0.1)
    np.testing.assert_allclose(
        fits[0].half_width, t.ppf(0.975, 9) * fits[0].standard_uncertainty, rtol=1e-12
    )


def test_stated_noise_is_a_floor_under_the_uncertainty():
    """Residuals smaller than the stated noise do not shrink the uncertainty, larger ones widen
    it.
    """
    quiet, loud = indications(sphere(20), noise=0.0), indications(sphere(20), noise=10.0 * NOISE_G)
    stated = np.full(20, NOISE_G)
    floor = magnitude.fit(quiet, noise=stated).standard_uncertainty
    assert np.all(floor > 0.3 * NOISE_G)
    assert np.all(magnitude.fit(loud, noise=stated).standard_uncertainty > 3.0 * floor)


def test_a_wild_dwell_is_named_and_moves_nothing():
    """One dwell of thirty-six read while the triad moved is named and left out."""
    indicated = indications(sphere(36))
    before = magnitude.fit(indicated, loss="robust")
    indicated[20] *= 1.01
    after = magnitude.fit(indicated, loss="robust")
    assert after.suspects == (20,)
    assert np.max(np.abs(after.parameters - before.parameters) / before.standard_uncertainty) < 1.0
    plain = magnitude.fit(indicated)
    assert np.max(np.abs(plain.parameters - TRUTH) / before.standard_uncertainty) > 4.0


def test_ten_positions_are_reported_with_a_warning():
    """One degree of freedom, positions near three planes: the flags say so and the intervals are
    wide.
    """
    rng = np.random.default_rng(4)
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    edges = np.array([[0, 0.7, 0.7], [0, -0.6, 0.8], [-0.9, 0, 0.45], [0.5, 0, 0.87]])
    vectors = np.concatenate([faces, edges]) + rng.normal(0.0, 0.03, (10, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    fitted = magnitude.fit(indications(vectors, noise=3e-4))
    said = " ".join(fitted.flags)
    assert "leave 1 degrees of freedom" in said
    assert "Q3 is known to ±" in said
    assert np.degrees(fitted.half_width[8]) > 1.0


def test_too_few_dwells_are_refused():
    """Eight dwells cannot give nine parameters, nine cannot be judged unless their noise is
    stated.
    """
    with pytest.raises(FitError, match="8 dwells for 9 parameters"):
        magnitude.fit(indications(sphere(8)))
    with pytest.raises(FitError, match="leave no residual"):
        magnitude.fit(indications(sphere(9)))
    nine = magnitude.fit(indications(sphere(9)), noise=np.full(9, NOISE_G))
    assert "leave 0 degrees of freedom" in nine.flags[0]


def test_dwells_on_one_circle_are_refused():
    """A triad turned about one horizontal axis only says nothing about the third."""
    turn = np.linspace(0.0, 2.0 * np.pi, 30, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(30)])
    with pytest.raises(FitError, match="cannot determine"):
        magnitude.fit(indications(circle))


def test_a_missing_value_is_refused():
    """NaN is said to be there, not fitted."""
    indicated = indications(sphere(20))
    indicated[3, 1] = np.nan
    with pytest.raises(FitError, match="not finite"):
        magnitude.fit(indicated)


def test_many_rows_by_their_moments_have_the_numbers_of_a_factorisation(monkeypatch):
    """Parameters to 1e-12, uncertainties, leverages and condition to 1e-9, though 100,000 rows
    start from a sample of them.
    """
    rng = np.random.default_rng(11)
    direction = rng.normal(size=(100_000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    axes = np.array([[1.0, 0.0, 0.0], [0.01, 1.0, 0.0], [-0.02, 0.015, 1.0]])
    indication = (
        direction @ axes.T * [1.01, 0.99, 1.02]
        + [0.01, -0.02, 0.03]
        + rng.normal(0.0, 1e-3, direction.shape)
    )
    indication.flags.writeable = False
    found = magnitude.fit(indication)
    monkeypatch.setattr(gram, "TALL", 10**9)
    monkeypatch.setattr(magnitude, "ENOUGH_TO_START", 10**9)
    expected = magnitude.fit(indication)
    np.testing.assert_allclose(found.parameters, expected.parameters, atol=1e-12)
    np.testing.assert_allclose(found.standard_uncertainty, expected.standard_uncertainty, rtol=1e-9)
    np.testing.assert_allclose(found.leverage, expected.leverage, rtol=1e-8)
    np.testing.assert_allclose(found.residuals, expected.residuals, atol=1e-11)
    assert found.condition == pytest.approx(expected.condition, rel=1e-6)


def test_many_rows_on_one_cone_are_refused():
    """Twenty thousand rows at one inclination cannot tell nine parameters, noise or not."""
    turn = np.linspace(0.0, 2.0 * np.pi, 21_000)
    cone = np.column_stack(
        [0.5 * np.cos(turn), 0.5 * np.sin(turn), np.full(turn.size, np.sqrt(0.75))]
    )
    with pytest.raises(FitError, match="cannot determine"):
        magnitude.fit(cone)
    with pytest.raises(FitError, match="no convergence"):
        magnitude.fit(cone + np.random.default_rng(12).normal(0.0, 1e-4, cone.shape))


def test_a_sample_that_determines_nothing_leaves_the_start_as_it_is():
    """Where every evenly spread row is the same one, the fit of all begins where it was to
    begin.
    """
    rng = np.random.default_rng(13)
    direction = rng.normal(size=(1000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction[::5] = [0.6, 0.0, 0.8]
    indication = direction * 1.02 + 0.01 + rng.normal(0.0, 1e-4, direction.shape)
    begin = gauss_newton.fit_some_rows(
        lambda at, rows: norms.length_residuals(
            at, indication[rows], 1.0, np.ones(len(indication[rows]))
        ),
        np.ones(9),
        1000,
        enough=200,
    )
    assert (begin == np.ones(9)).all()
