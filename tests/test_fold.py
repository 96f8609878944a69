"""Least squares folded block by block."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit, fold


def test_triangle_has_the_gram_matrix_of_the_rows():
    """RᵀR is the rows' Gram matrix, whatever the blocks, also for fewer rows than columns."""
    rows = np.random.default_rng(0).normal(size=(500, 7))
    for size in (3, 64, 1000):
        triangle = fold.triangle(lambda part: rows[part], 500, size)
        np.testing.assert_allclose(triangle.T @ triangle, rows.T @ rows, atol=1e-11)
    assert fold.triangle(lambda part: rows[part], 4).shape == (4, 7)


@pytest.mark.parametrize("weighted", [False, True])
def test_folded_fit_is_the_fit(weighted):
    """Coefficients, covariance, residuals and rms equal those of the whole design, weights
    included.
    """
    rng = np.random.default_rng(1)
    design = np.vander(rng.uniform(-1.0, 1.0, 9000), 6)
    indication = design @ rng.normal(size=6) + rng.normal(size=9000)
    weights = rng.uniform(0.1, 10.0, 9000) if weighted else None
    whole = fit.linear(design, indication, weights=weights)
    folded = fold.linear(lambda part: design[part], indication, weights=weights)
    np.testing.assert_allclose(folded.coefficients, whole.coefficients, rtol=1e-11)
    np.testing.assert_allclose(folded.covariance, whole.covariance, rtol=1e-10)
    np.testing.assert_allclose(folded.residuals, whole.residuals, atol=1e-12)
    assert folded.residual_rms == pytest.approx(whole.residual_rms, rel=1e-12)
    assert folded.dof == whole.dof
    assert folded.condition == pytest.approx(whole.condition, rel=0.5)


def test_dependent_columns_are_refused_by_name():
    """The triangle knows what the rows leave open."""
    design = np.random.default_rng(2).normal(size=(5000, 3))
    design[:, 2] = design[:, 0] - design[:, 1]
    with pytest.raises(FitError, match="first, second, third"):
        fold.linear(lambda part: design[part], design[:, 0], names=("first", "second", "third"))
