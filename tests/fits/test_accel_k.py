"""K-factor: scale factor, zero offset and cross-axis terms of a triad over temperature, ten
coefficients an axis.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.equation import name_terms
from calibkit.instruments.accelerometer.fit import list_results
from calibkit.instruments.accelerometer.triad import solve_triad
from calibkit.numeric import attitude
from fits.triad_dwells import WHITE, collect, fit_triad, recipe, uncertainties, values

AUTHORITY = json.loads((Path(__file__).parents[1] / "authorities" / "accel_k.json").read_text())
ROWS = np.array(AUTHORITY["rows"])
TEMPERATURE, ANGLES, INDICATION = ROWS[:, 0], ROWS[:, 1:3], ROWS[:, 3:]
REFERENCE = attitude.gravity_vector(*ANGLES.T)
TRUTH = np.array([AUTHORITY["expected"][f"accel_{axis}"] for axis in "xyz"])
NOISE_G = 2e-5
GRID_DEGC = (-20, -5, 10, 25, 45, 65, 85, 105, 125)
PLAIN = recipe(loss="least_squares", errors=WHITE)


def indications_of_k(coefficients, reference, temperature):
    """Indications [n, 3] that the coefficients K [3, 10] correct to the reference [n, 3]."""
    powers = np.vander(temperature, 4, increasing=True)
    matrix = np.zeros((len(temperature), 3, 3))
    target = np.empty((len(temperature), 3, 1))
    for i, (first, second) in enumerate(published.CROSS):
        matrix[:, i, i] = powers @ coefficients[i, :4]
        matrix[:, i, first], matrix[:, i, second] = -coefficients[i, 8], -coefficients[i, 9]
        target[:, i, 0] = reference[:, i] + powers @ coefficients[i, 4:8]
    return np.linalg.solve(matrix, target)[:, :, 0]


def corrected_by(k, indication, temperature):
    """Corrected components [n, 3] by K0 … K9 [3, 10]."""
    parts = [published.columns(indication, temperature, i) @ k[i] for i in range(3)]
    return np.column_stack(parts)


def simulated(seed, *, truth=TRUTH, noise=NOISE_G, temperature=TEMPERATURE, reference=REFERENCE):
    """Indications of the K model with white noise."""
    rng = np.random.default_rng(seed)
    return indications_of_k(truth, reference, temperature) + rng.normal(0.0, noise, reference.shape)


def grid(temperatures, angles):
    """Temperatures [n] and attitudes [n, 2] of every attitude at every temperature."""
    angle = np.tile(np.array(angles, dtype=float), (len(temperatures), 1))
    return np.repeat(np.array(temperatures, dtype=float), len(angles)), angle


def gravity(angle):
    """Reference vectors [n, 3] at attitudes [n, 2]."""
    return attitude.gravity_vector(*np.transpose(angle))


def measured(seed, temperature, angle, **options):
    """Dwells of a triad of the K model."""
    indicated = simulated(seed, temperature=temperature, reference=gravity(angle), **options)
    return collect(indicated, temperature, angle)


def scores(fitted, truth=TRUTH):
    """Errors [3, 10] of K over their standard uncertainties, 0 where not fitted."""
    u = np.array([uncertainties(model) for model in fitted.k])
    error = np.array([values(model) for model in fitted.k]) - truth
    return np.divide(error, u, out=np.zeros_like(u), where=u > 0.0)


def test_correction_is_the_published_sum_term_by_term():
    """The corrected components equal the equation written out with loops and letters, and the
    reference.
    """
    twin = np.empty_like(INDICATION)
    for row, (temperature, indicated) in enumerate(zip(TEMPERATURE, INDICATION, strict=True)):
        x, y, z = indicated
        for axis, (own, first, second) in enumerate(((x, y, z), (y, z, x), (z, x, y))):
            K = TRUTH[axis]
            scale = sum(K[k] * temperature**k for k in range(4))
            zero = sum(K[4 + k] * temperature**k for k in range(4))
            twin[row, axis] = own * scale - zero - K[8] * first - K[9] * second
    corrected = corrected_by(TRUTH, INDICATION, TEMPERATURE)
    np.testing.assert_allclose(corrected, twin, atol=1e-15)  # g
    np.testing.assert_allclose(corrected, REFERENCE, atol=1e-14)  # g


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_indications_and_correction_undo_each_other(seed):
    """For any small K, correcting what the model indicates gives the reference back."""
    truth = np.random.default_rng(seed).normal(0.0, 1e-2, (3, 10)) * np.array(
        [1, 1e-2, 1e-4, 1e-6] * 2 + [1, 1]
    )
    truth[:, 0] += 1.0
    indicated = indications_of_k(truth, REFERENCE, TEMPERATURE)
    np.testing.assert_allclose(
        corrected_by(truth, indicated, TEMPERATURE), REFERENCE, atol=1e-13
    )  # g


@pytest.mark.parametrize(
    ("angles", "loose"),
    [
        ([(45, 0), (45, 120)], "accel_x: K8, K9"),
        ([(45, 0), (45, 120), (135, 0)], "accel_x: K8; accel_y: K9; accel_z: K9"),
        (
            [(45, roll) for roll in range(0, 360, 45)],
            "accel_x: K9; accel_y: K8; accel_z: K4, K5, K6, K7",
        ),
    ],
)
def test_sweeps_at_too_few_attitudes_are_refused_by_name(angles, loose):
    """A continuous sweep at two attitudes leaves two coefficients of x open, at three, or any on
    one cone, one.
    """
    temperature, angle = grid(np.linspace(-20.0, 125.0, 200), angles)
    with pytest.raises(FitError) as refused:
        fit_triad(measured(0, temperature, angle), PLAIN)
    assert loose in refused.value.message
    assert "add dwells on the six faces" in refused.value.hint


def test_every_coefficient_lies_within_four_uncertainties_and_the_residual_is_the_noise():
    """With 20 µg noise and exact angles all K are within 4 u and the residual rms within 5 % of the
    noise.
    """
    spots = [
        (0, 0),
        *((tilt, roll) for tilt in (30, 60, 90, 120, 150) for roll in range(0, 360, 45)),
        (180, 0),
    ]
    for seed in range(3):
        fitted = fit_triad(measured(seed, *grid(GRID_DEGC, spots)), PLAIN)
        assert np.max(np.abs(scores(fitted))) < 4.0
        rms = np.sqrt(np.mean([model.residual_rms**2 for model in fitted.k]))
        assert rms == pytest.approx(NOISE_G, rel=0.05)


def robust_k(dwells):
    """The triad by its robust fit, and K of its axes."""
    terms = name_terms((3,) * 3, (3,) * 3, (1,) * 3)
    triad = solve_triad(dwells, terms, recipe(), loss="robust")
    return triad, list_results(triad, dwells, recipe())[0].models


@pytest.fixture(scope="module")
def clean():
    """Dwells without an outlier, and K of their axes."""
    dwells = measured(10, *grid(GRID_DEGC, ANGLES[:20]))
    return dwells, robust_k(dwells)[1]


@pytest.mark.parametrize("size_g", [2e-4, 1e-3, 0.05, 1.0, 50.0])
def test_one_wild_dwell_in_a_hundred_moves_no_coefficient_by_its_uncertainty(clean, size_g):
    """A dwell that is spoilt by ten sigmas or more is named and moves nothing by more than a
    standard uncertainty.
    """
    dwells, untouched = clean
    rng = np.random.default_rng([11, int(1e4 * size_g)])
    outliers = rng.choice(len(dwells.place), len(dwells.place) // 100 + 1, replace=False)
    indicated = dwells.indication.copy()
    indicated[outliers] += size_g * rng.choice([-1.0, 1.0], (outliers.size, 3))
    triad, k = robust_k(replace(dwells, indication=indicated))
    for before, after in zip(untouched, k, strict=True):
        assert np.max(np.abs(values(after) - values(before)) / uncertainties(before)) < 1.0
    assert set(outliers.tolist()) <= set(triad.suspects)


def test_dwells_that_leave_no_residual_are_refused():
    """Without a residual nothing judges the fit, and zero is no uncertainty."""
    temperature, angle = grid((-20, 30, 80, 125), [(0, 0), (90, 0), (90, 90)])
    with pytest.raises(FitError, match="12 dwells for 36 parameters"):
        fit_triad(measured(0, temperature, angle), recipe(k={"enabled": False}))
