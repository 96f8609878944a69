"""The triad from the length of gravity alone: nine parameters, intervals, warnings."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import profile_intervals, published
from calibkit.instruments.accelerometer.equation import name_terms
from calibkit.instruments.accelerometer.triad import solve_triad
from fits.triad_dwells import collect, fit_triad, nine, recipe

TRUTH = np.array([1.012, 0.985, 1.004, 0.011, -0.02, 0.007, 0.0043, -0.0087, 0.0121])
NOISE_G = 2e-5
WITHOUT_ERRORS = {
    "component": [
        {"group": group, "effect": effect, "value": 0.0, "unit": unit, "dof": 1000.0}
        for group, effect, unit in (("soak", "zero", "g"), ("sensor", "second order", "1/g"))
    ]
}


def lengths(**tables):
    """Recipe of a triad that is turned by hand, at one temperature."""
    reference = {"kind": "magnitude"} | tables.pop("reference", {})
    orders = {"scale_order": 0, "bias_order": 0, "cross_order": 0}
    return recipe(reference=reference, affine=orders, errors=WITHOUT_ERRORS, **tables)


PLAIN = lengths(loss="least_squares")
TERMS = name_terms((0,) * 3, (0,) * 3, (0,) * 3, triangular=True)


def sphere(count):
    """Evenly spread unit vectors [count, 3] (golden spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.column_stack(
        [np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z]
    )


def indications(vectors, seed=0, *, truth=TRUTH, noise=NOISE_G):
    """Indications of a triad with these nine parameters."""
    exact = truth[:3] * (vectors @ published.axes_from_angles(truth[6:]).T) + truth[3:6]
    return exact + np.random.default_rng(seed).normal(0.0, noise, exact.shape)


def fitted(indicated, spec=PLAIN, *, noise=None, loss="least_squares"):
    """Nine parameters [9] of dwells, with 95 % half-widths."""
    return nine(solve_triad(collect(indicated, noise=noise), TERMS, spec, loss=loss))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_exact_dwells_give_the_parameters_back(seed):
    """Any sane triad comes out of exact dwells to 1e-10, whatever the unit of its indications."""
    rng = np.random.default_rng(seed)
    counts = 10.0 ** rng.uniform(-1.0, 4.5)
    truth = np.concatenate(
        [rng.uniform(0.7, 1.4, 3), rng.uniform(-2.0, 2.0, 3), rng.uniform(-0.08, 0.08, 3)]
    )
    truth[:6] *= counts
    parameters, _ = fitted(indications(sphere(30), truth=truth, noise=0.0))
    np.testing.assert_allclose(parameters[:6] / counts, truth[:6] / counts, atol=1e-10)
    np.testing.assert_allclose(parameters[6:], truth[6:], atol=1e-10)  # rad


@pytest.mark.parametrize("noisy", [False, True])
def test_both_solvers_agree(noisy):
    """Profile intervals of lmfit hold the values of the triad in their middle and are as wide, to
    0.2 %.
    """
    noise = np.full(28, NOISE_G) if noisy else None
    dwells = collect(indications(sphere(28)), noise=noise)
    triad = solve_triad(dwells, TERMS, PLAIN, loss="least_squares")
    parameters, half_width = nine(triad)
    figures, _ = profile_intervals.find_intervals(triad, dwells)
    low, high = np.reshape([figure.value for figure in figures], (9, 2)).T
    # of lmfit the stated noise is the least
    floor = max(1.0, NOISE_G / triad.noise[0]) if noisy else 1.0
    np.testing.assert_allclose((high - low) / 2.0, floor * half_width, rtol=2e-3)
    assert np.max(np.abs((high + low) / 2.0 - parameters) / half_width) < 0.005


@pytest.mark.parametrize(("seed", "set_up_deg"), [*((n, 2.0) for n in range(6)), (21, 1.0)])
def test_six_faces_at_several_sessions_do_not_run_away(seed, set_up_deg):
    """Lengths in six positions set up by hand see no angles: biases come out beside a zero of each
    soak, within U, the angles are said to be poorly known, and no error is taken by chance of which
    the parameters leave next to nothing (of second order it moved a bias by 3.7 U).
    """
    rng = np.random.default_rng(seed)
    faces = np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (4, 1))
    vectors = faces + np.cross(rng.normal(0.0, np.radians(set_up_deg), faces.shape), faces)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    session = np.repeat(np.arange(4), 6)
    indicated = indications(vectors, seed) + 1e-4 * rng.normal(size=(4, 3))[session]
    spec = recipe(
        loss="least_squares",
        reference={"kind": "magnitude"},
        affine={"scale_order": 0, "bias_order": 0, "cross_order": 0},
    )
    six = fit_triad(collect(indicated, log=session), spec)
    parameters, half_width = nine(six.triad)
    assert np.max(np.abs(parameters - TRUTH)[3:6]) < 4e-4  # g
    assert np.all(np.abs(parameters - TRUTH)[3:6] < half_width[3:6])
    assert not any(size.error.optional for size in six.triad.fit.shared)


def test_too_few_dwells_are_refused():
    """Eight dwells cannot give nine parameters, and nine leave nothing to judge them by."""
    with pytest.raises(FitError, match="8 dwells for 9 parameters"):
        fit_triad(collect(indications(sphere(8))), PLAIN)
    with pytest.raises(FitError, match="leave no residual"):
        fit_triad(collect(indications(sphere(9))), PLAIN)


def test_dwells_on_one_circle_are_refused():
    """A triad turned about one horizontal axis only says nothing about the third."""
    turn = np.linspace(0.0, 2.0 * np.pi, 30, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(30)])
    with pytest.raises(FitError, match="cannot determine"):
        fitted(indications(circle))
