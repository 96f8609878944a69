"""Any number of gyros over three table axes: sensitivity vectors, angles, misalignment,
temperature.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric import scale_factor, triad

SKEWED = np.array(
    [
        [10000.0, 12.0, -30.0],
        [-8.0, 9900.0, 25.0],
        [40.0, -15.0, 10100.0],
        [5773.5, 5773.5, 5773.5],
    ]
)


def test_angles_and_magnitudes_are_those_of_the_vectors():
    """Four gyros: lengths, unit vectors and all six angles equal those of a loop over pairs, to
    1e-9°.
    """
    found = triad._triad(SKEWED, np.eye(12))
    for g, a in enumerate(SKEWED):
        assert found.magnitude[g] == pytest.approx(np.sqrt(sum(x * x for x in a)), rel=1e-12)
        assert found.misalignment[g] == pytest.approx(a / np.linalg.norm(a), rel=1e-12)
        for h, b in enumerate(SKEWED):
            cosine = (
                sum(x * y for x, y in zip(a, b, strict=True))
                / np.linalg.norm(a)
                / np.linalg.norm(b)
            )
            expected = 0.0 if g == h else np.degrees(np.arccos(cosine))
            assert found.angles_deg[g, h] == pytest.approx(expected, abs=1e-9)
    assert found.flags == ()


def test_an_ideal_triad_has_the_identity_for_misalignment():
    """Three orthogonal gyros: identity and 90° between all."""
    found = triad._triad(np.diag([10000.0, 9900.0, 10100.0]), np.eye(9))
    assert (found.misalignment == np.eye(3)).all()
    assert found.angles_deg[0, 1] == pytest.approx(90.0, abs=1e-12)


def test_uncertainties_are_the_scatter_of_drawn_sensitivities():
    """With correlated noise, 20,000 draws: uncertainties of lengths, axes and angles agree to 3
    %.
    """
    rng = np.random.default_rng(4)
    mixing = rng.normal(size=(12, 12))
    covariance = mixing @ mixing.T
    found = triad._triad(SKEWED, covariance)
    drawn = rng.multivariate_normal(SKEWED.ravel(), covariance, 20_000).reshape(-1, 4, 3)
    size = np.linalg.norm(drawn, axis=2)
    assert found.magnitude_uncertainty == pytest.approx(size.std(axis=0), rel=0.03)
    unit = drawn / size[:, :, None]
    assert found.misalignment_uncertainty == pytest.approx(unit.std(axis=0), rel=0.03)
    for g, h in ((0, 1), (0, 3), (2, 3)):
        angle = np.degrees(np.arccos(np.einsum("na,na->n", unit[:, g], unit[:, h])))
        assert found.angle_uncertainty_deg[g, h] == pytest.approx(angle.std(), rel=0.03)


def test_parallel_gyros_are_flagged():
    """Two gyros on one axis have an angle of 0° that noise alone gives, and three of them do not
    span space.
    """
    found = triad._triad(
        np.array([[10000.0, 0.0, 0.0], [9000.0, 0.0, 0.0], [0.0, 8000.0, 0.0]]), np.eye(9)
    )
    assert found.angles_deg[0, 1] == 0.0
    assert found.angle_uncertainty_deg[0, 1] > 0.0
    assert any("1 and 2 are collinear" in flag for flag in found.flags)
    assert any("do not span" in flag for flag in found.flags)


def run(K, covariance):
    """Run with these scale factors."""
    scale = scale_factor._scale_factor(
        np.array([-1.0, 0.5, 1.0]), np.array([-1.0, 0.5, 1.0]), np.ones(3)
    )
    return scale_factor.RunScales((scale,) * len(K), np.array(K), np.array(covariance))


def test_three_runs_make_a_triad_and_keep_what_gyros_of_one_run_share():
    """Columns are the runs; the covariance of two gyros in one run is kept, that of two runs is
    zero.
    """
    shared = [[4.0, 1.0], [1.0, 9.0]]
    found = triad.from_runs(
        run([1.0, 2.0], shared), run([3.0, 4.0], shared), run([5.0, 6.0], shared)
    )
    assert (found.sensitivity == [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]).all()
    assert found.covariance[0, 1, 1, 1] == 1.0
    assert found.covariance[0, 0, 1, 1] == 0.0
    with pytest.raises(FitError, match="three axes have"):
        triad.from_runs(run([1.0, 2.0], shared), run([3.0] * 3, np.eye(3)), run([5.0, 6.0], shared))


def test_what_cannot_be_a_triad_is_refused():
    """A gyro without sensitivity and a NaN are refused."""
    with pytest.raises(FitError, match="gyro 2 senses none"):
        triad._triad(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.eye(6))
    with pytest.raises(FitError, match="not finite"):
        triad._triad(np.array([[np.nan, 0.0, 0.0]]), np.eye(3))


def test_sensitivities_over_temperature_come_back_at_any_temperature():
    """Axes that turn by 0.001°/°C: angles at 40 °C to 1e-6° of the truth, known as by one run;
    beyond clamped and flagged.
    """

    def at(temperature):
        turn = np.radians(0.001 * temperature)
        return 1e4 * np.array([[np.cos(turn), np.sin(turn), 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    temperature = np.array([-40.0, -10.0, 25.0, 60.0, 85.0])
    over = triad.over_temperature(
        [triad._triad(at(t), np.eye(9)) for t in temperature], temperature, order=2
    )
    found = over.at(40.0)
    assert found.angles_deg[0, 1] == pytest.approx(90.0 - 0.04, abs=1e-6)
    assert (
        0.95 < found.magnitude_uncertainty[1] < 1.2
    )  # nowhere better known than one run, whose own is 1
    beyond = over.at(120.0)
    assert beyond.angles_deg[0, 1] == over.at(85.0).angles_deg[0, 1]
    assert any("clamped" in flag for flag in beyond.flags)


@given(st.integers(0, 10_000), st.integers(2, 6))
@settings(max_examples=40, deadline=None)
def test_angles_do_not_depend_on_the_axes_of_the_table(seed, count):
    """Turning the table's axes turns the vectors and leaves every angle and length alone, to
    1e-7°.
    """
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(count, 3)) * 1e4
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    plain, turned = (triad._triad(v, np.eye(3 * count)) for v in (vectors, vectors @ rotation))
    assert turned.angles_deg == pytest.approx(plain.angles_deg, abs=1e-7)
    assert turned.magnitude == pytest.approx(plain.magnitude, rel=1e-12)
