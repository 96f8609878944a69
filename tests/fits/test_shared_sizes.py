"""Least squares with errors that rows share: published fits, a twin on whole matrices, coverage."""

import numpy as np
import pytest
from scipy import linalg, optimize

from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import solve
from calibkit.numeric.least_squares import fit as least_squares

DYESTUFF = np.array(
    [
        [1545, 1440, 1440, 1520, 1580],
        [1540, 1555, 1490, 1560, 1495],
        [1595, 1550, 1605, 1510, 1560],
        [1445, 1440, 1595, 1465, 1545],
        [1595, 1630, 1515, 1635, 1625],
        [1520, 1455, 1450, 1480, 1445],
    ],
    dtype=float,
)
"""Yield of dyestuff [g], six batches of five (Davies & Goldsmith 1972, table 6.4)."""


def share(group, effect, level, loading, **stated):
    """An error that rows of a level share."""
    return Shared(group=group, effect=effect, level=level, loading=loading, unit="ug", **stated)


def soak_zero(labels, **stated):
    """A zero [µg] that rows of a soak share."""
    return share("soak", "zero", labels, np.ones((len(labels), 1)), **stated)


def fit_of(design, y, shared, weights=None):
    """Fit y = design · β with errors that rows share."""
    noise = None if weights is None else 1.0 / np.sqrt(weights)
    return solve(lambda p: y - design @ p, np.zeros(design.shape[1]), shared, noise=noise)


def u_of(fit):
    """Standard uncertainties [p] of the parameters."""
    return np.sqrt(np.diag(fit.covariance))


def dof_of(fit):
    """Effective degrees of freedom [p] of the parameters."""
    return fit.dof_along(np.eye(len(fit.parameters)))


def campaign(seed, *, zero, soaks=7, noise=20.0, axes=3):
    """Cubic zero and scale factor of three axes: design, indication [µg], soaks of the stacked
    rows.
    """
    rng = np.random.default_rng(seed)
    down = np.random.default_rng(1).normal(size=(26, 3))
    down = np.tile(down / np.linalg.norm(down, axis=1)[:, None], (soaks, 1))
    soak = np.repeat(np.arange(soaks), 26)
    powers = np.vander(np.linspace(-1.0, 1.0, soaks)[soak], 4, increasing=True)
    designs = [np.column_stack([down[:, [i]] * powers, powers]) for i in range(axes)]
    labels = np.concatenate([soak + soaks * i for i in range(axes)])
    shared = zero * rng.normal(size=soaks * axes)[labels]
    return linalg.block_diag(*designs), shared + noise * rng.normal(size=len(labels)), labels


def test_dyestuff_batches_have_the_published_components():
    """REML of lme4's documentation: batch 42.00 g, residual 49.51 g, mean 1527.5 g ± 19.38 g with
    five degrees of freedom.
    """
    labels = np.repeat(np.arange(6), 5)
    found = fit_of(np.ones((30, 1)), DYESTUFF.ravel(), [soak_zero(labels)])
    batch = found.shared[0]
    assert (batch.error.levels, batch.dof) == (6, 5)
    assert round(batch.value, 2) == 42.00
    assert round(found.noise[0], 2) == 49.51
    assert found.parameters == pytest.approx([1527.5])
    assert u_of(found) == pytest.approx([19.38], abs=5e-3)
    assert dof_of(found) == pytest.approx([5.0], rel=1e-6)


def test_two_crossed_effects_equal_a_twin_on_whole_matrices():
    """Restricted likelihood maximised over V [n, n] itself: variances to 1e-4, coefficients and
    their plain uncertainty to 1e-5.
    """
    rng = np.random.default_rng(5)
    soak, face = np.repeat(np.arange(7), 12), np.tile(np.arange(12), 7)
    design = np.column_stack([np.vander(np.linspace(-1, 1, 7)[soak], 3), rng.normal(size=84)])
    slopes = rng.normal(size=(12, 2))[face]
    index = rng.normal(size=(12, 2))
    y = 2.0 * rng.normal(size=7)[soak] + 1.5 * np.sum(slopes * index[face], 1) + rng.normal(size=84)
    weights = rng.uniform(0.5, 2.0, 84)
    effects = [soak_zero(soak), share("attitude", "index", face, slopes)]
    found = fit_of(design, y, effects, weights)

    spread = [np.eye(7)[soak], (np.eye(12)[face][:, :, None] * slopes[:, None]).reshape(84, -1)]

    def whole(logs):
        noise, *theta = np.exp(logs)
        v = noise * np.diag(1.0 / weights)
        return v + sum(t * z @ z.T for t, z in zip(theta, spread, strict=True))

    def deviance(logs):
        v = whole(logs)
        information = design.T @ np.linalg.solve(v, design)
        beta = np.linalg.solve(information, design.T @ np.linalg.solve(v, y))
        left = y - design @ beta
        logarithms = np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1]
        return logarithms + left @ np.linalg.solve(v, left)

    best = optimize.minimize(deviance, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-7})
    v = whole(best.x)
    plain = np.linalg.inv(design.T @ np.linalg.solve(v, design))
    assert [size.value for size in found.shared] == pytest.approx(np.exp(best.x[1:] / 2), rel=1e-4)
    beta = plain @ design.T @ np.linalg.solve(v, y)
    assert found.parameters == pytest.approx(beta, abs=1e-5)
    # the correction for estimated variances only widens, and here by little
    ratio = u_of(found) / np.sqrt(np.diag(plain))
    assert np.all((ratio > 0.9999) & (ratio < 1.05))


def test_a_component_that_is_given_weighs_as_if_it_were_exact():
    """Generalised least squares with the whole V, with the degrees of freedom of the noise."""
    design, y, labels = campaign(3, zero=15.0, axes=1)
    found = fit_of(design, y, [soak_zero(labels, size=15.0)])
    v = found.noise[0] ** 2 * np.eye(len(y)) + 15.0**2 * (labels[:, None] == labels)
    covariance = np.linalg.inv(design.T @ np.linalg.solve(v, design))
    expected = covariance @ design.T @ np.linalg.solve(v, y)
    assert found.parameters == pytest.approx(expected, rel=1e-8)
    assert u_of(found) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-3)
    assert np.all(dof_of(found) > 100.0)


def test_a_component_pooled_from_earlier_runs_counts_with_its_degrees_of_freedom():
    """Three degrees of freedom of seven soaks and twenty from before."""
    design, y, labels = campaign(3, zero=15.0, axes=1)
    alone = fit_of(design, y, [soak_zero(labels)])
    pooled = fit_of(design, y, [soak_zero(labels, size=15.0, size_dof=20.0)])
    assert dof_of(alone)[4:8] == pytest.approx(3.0, abs=0.5)
    assert np.all((dof_of(pooled)[4:8] > 18.0) & (dof_of(pooled)[4:8] < 26.0))


def test_without_a_shared_error_of_known_size_0_nothing_changes():
    """Ordinary least squares, and its u to ten digits: the noise is searched for."""
    design, y, labels = campaign(8, zero=0.0)
    plain = least_squares.linear(design, y)
    found = fit_of(design, y, [soak_zero(labels, size=0.0)])
    assert found.parameters == pytest.approx(plain.coefficients, rel=1e-12)
    assert u_of(found) == pytest.approx(plain.standard_uncertainty, rel=1e-10)
    assert dof_of(found) == pytest.approx(plain.dof)


def test_exact_data_have_no_shared_errors():
    """Rounding is no error of a soak."""
    design, _, labels = campaign(8, zero=0.0)
    truth = np.linspace(1.0, 2.0, design.shape[1])
    found = fit_of(design, design @ truth, [soak_zero(labels)])
    assert found.parameters == pytest.approx(truth, rel=1e-12)
    assert found.shared[0].value == 0.0


def test_an_effect_that_is_a_coefficient_too_has_no_degrees_of_freedom():
    """One zero per soak is fitted already: the data cannot tell how soaks differ."""
    _, y, labels = campaign(8, zero=15.0, axes=1)
    found = fit_of(np.eye(7)[labels], y, [soak_zero(labels)])
    assert found.shared[0].dof == 0
    assert found.shared[0].value == 0.0


def test_no_spare_row_is_refused():
    """Three rows for three coefficients."""
    with pytest.raises(FitError, match="leave no residual"):
        fit_of(np.eye(3), np.ones(3), [])
