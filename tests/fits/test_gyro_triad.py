"""Any number of gyros over three table axes: sensitivity vectors, angles, misalignment,
temperature.
"""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import coefficient_files, flags
from fits.known_fit import known_fit

SKEWED = np.array(
    [
        [10000.0, 12.0, -30.0],
        [-8.0, 9900.0, 25.0],
        [40.0, -15.0, 10100.0],
        [5773.5, 5773.5, 5773.5],
    ]
)


class InputAxes:
    """Input axes of sensitivities [g, 3] with a covariance, by their figures."""

    def __init__(self, sensitivity, covariance):
        fit = known_fit(np.ravel(sensitivity), covariance)
        self.gyros = "abcdef"[: len(fit.parameters) // 3]
        figures = coefficient_files.of_input_axes(fit, self.gyros)
        self.figures = {figure.name: figure for figure in figures}

    def stated(self, *names):
        """Values and uncertainties of figures."""
        found = [self.figures[name] for name in names]
        return np.array([[one.value, one.standard_uncertainty] for one in found]).T

    def angle(self, g, h):
        """Angle between two axes and its uncertainty [°]."""
        return self.stated(f"angle_deg.{self.gyros[g]}_{self.gyros[h]}")[:, 0]

    @property
    def magnitude(self):
        """Values and uncertainties [2, g]."""
        return self.stated(*(f"scale_factor.{g}" for g in self.gyros))

    @property
    def misalignment(self):
        """Values and uncertainties [2, g, 3]."""
        names = [f"misalignment.{g}{axis}" for g in self.gyros for axis in "xyz"]
        return self.stated(*names).reshape(2, -1, 3)

    @property
    def flags(self):
        """Flags of the axes."""
        return list(flags.of_directions(self.figures, self.gyros))


find = InputAxes


def test_angles_and_magnitudes_are_those_of_the_vectors():
    """Four gyros: lengths, unit vectors and all six angles equal those of a loop over pairs, to
    1e-9°.
    """
    found = find(SKEWED, np.eye(12))
    for g, a in enumerate(SKEWED):
        assert found.magnitude[0][g] == pytest.approx(np.sqrt(sum(x * x for x in a)), rel=1e-12)
        assert found.misalignment[0][g] == pytest.approx(a / np.linalg.norm(a), rel=1e-12)
        for h, b in enumerate(SKEWED[:g]):
            cosine = (
                sum(x * y for x, y in zip(a, b, strict=True))
                / np.linalg.norm(a)
                / np.linalg.norm(b)
            )
            assert found.angle(h, g)[0] == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-9)
    assert found.flags == []


def test_uncertainties_are_the_scatter_of_drawn_sensitivities():
    """With correlated noise, 20,000 draws: uncertainties of lengths, axes and angles agree to 3
    %.
    """
    rng = np.random.default_rng(4)
    mixing = rng.normal(size=(12, 12))
    covariance = mixing @ mixing.T
    found = find(SKEWED, covariance)
    drawn = rng.multivariate_normal(SKEWED.ravel(), covariance, 20_000).reshape(-1, 4, 3)
    size = np.linalg.norm(drawn, axis=2)
    assert found.magnitude[1] == pytest.approx(size.std(axis=0), rel=0.03)
    unit = drawn / size[:, :, None]
    assert found.misalignment[1] == pytest.approx(unit.std(axis=0), rel=0.03)
    for g, h in ((0, 1), (0, 3), (2, 3)):
        angle = np.degrees(np.arccos(np.einsum("na,na->n", unit[:, g], unit[:, h])))
        assert found.angle(g, h)[1] == pytest.approx(angle.std(), rel=0.03)


def test_parallel_gyros_are_flagged():
    """Two gyros on one axis have an angle of 0° that noise alone gives, and three of them do not
    span space.
    """
    found = find(np.array([[10000.0, 0.0, 0.0], [9000.0, 0.0, 0.0], [0.0, 8000.0, 0.0]]), np.eye(9))
    assert found.angle(0, 1)[0] == 0.0
    assert found.angle(0, 1)[1] > 0.0
    assert any("a and b are collinear" in flag for flag in found.flags)
    assert any("do not span" in flag for flag in found.flags)


def test_what_cannot_be_a_triad_is_refused():
    """A gyro without sensitivity and a NaN are refused."""
    with pytest.raises(FitError, match="gyro b senses none"):
        find(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.eye(6))
    with pytest.raises(FitError, match="not finite"):
        find(np.array([[np.nan, 0.0, 0.0]]), np.eye(3))


@given(st.integers(0, 10_000), st.integers(2, 6))
@settings(max_examples=40, deadline=None)
def test_angles_do_not_depend_on_the_axes_of_the_table(seed, count):
    """Turning the table's axes turns the vectors and leaves every angle and length alone, to
    1e-7°.
    """
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(count, 3)) * 1e4
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    plain, turned = (find(v, np.eye(3 * count)) for v in (vectors, vectors @ rotation))
    for g, h in combinations(range(count), 2):
        assert turned.angle(g, h)[0] == pytest.approx(plain.angle(g, h)[0], abs=1e-7)
    assert turned.magnitude[0] == pytest.approx(plain.magnitude[0], rel=1e-12)
