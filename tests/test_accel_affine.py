"""The affine triad over temperature: every entry a polynomial, higher orders and nuisance angles as
options.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import t

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import fit as accelerometer_fit
from calibkit.instruments.accelerometer.numeric import (
    affine,
    affine_model,
    affine_solve,
    k_factor,
    q_factor,
)
from calibkit.instruments.accelerometer.numeric.affine_model import AffineTerms
from calibkit.numeric import attitude

AUTHORITY = json.loads((Path(__file__).parent / "authorities" / "accel_k.json").read_text())
ROWS = np.array(AUTHORITY["rows"])
TEMPERATURE, ANGLES, INDICATION = ROWS[:, 0], ROWS[:, 1:3], ROWS[:, 3:]
ROTATION = accelerometer_fit._tool_rotation(*ANGLES.T)
REFERENCE = ROTATION[:, :, 2]
MIDDLE, HALF = 52.5, 72.5  # °C
NOISE_G = 2e-5
SIZES = {"m": 5e-3, "b": 5e-3, "n": 1e-4, "tilt": 2e-3, "fixture": 1e-2}
EVERYTHING = AffineTerms(2, 1, 2, second_order=True, third_order=True, tilt=True, fixture=True)


def drawn(entries, seed):
    """Parameters in mapped temperature, of the size that triads have."""
    rng = np.random.default_rng(seed)
    return np.array(
        [
            float(e.kind == "m" and e.factors == (e.row,) and e.power == 0)
            + rng.normal() * SIZES[e.kind] * 0.3**e.power
            for e in entries
        ]
    )


def corrected_covariance(fitted, indication, temperature):
    """Covariance [n, 3, 3] of corrected components by the parameters' type A uncertainty."""
    mapped = (temperature - fitted.middle) / fitted.half
    _, slopes = affine_model.evaluate(
        fitted.entries, fitted.mapped_coefficients, indication, mapped
    )
    return slopes @ fitted.mapped_covariance @ np.swapaxes(slopes, 1, 2)


def indications(entries, values, reference):
    """Indications that the model corrects to the reference, by fixed-point iteration."""
    found = reference.copy()
    for _ in range(60):
        found = found - (
            affine_model.evaluate(entries, values, found, (TEMPERATURE - MIDDLE) / HALF)[0]
            - reference
        )
    return found


def corrected(coefficients, indication, temperature):
    """Corrected components [n, 3] from parameters by name, in raw degrees."""
    entries = [affine_model.find_entry(name) for name in coefficients]
    values = np.array(list(coefficients.values()))
    return affine_model.evaluate(entries, values, indication, temperature)[0]


def kind(entries, values, *wanted):
    """Parameters of the wanted kinds."""
    return np.array([v for e, v in zip(entries, values, strict=True) if e.kind in wanted])


def tilted_and_turned(entries, values):
    """What the triad is really exposed to when table base and fixture are crooked."""
    tilt, turn = kind(entries, values, "tilt"), kind(entries, values, "fixture")
    down = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    return (ROTATION @ down) @ affine_solve._rotation(turn)


def scores(fitted, truth):
    """Errors over standard uncertainties in mapped temperature."""
    return (fitted.mapped_coefficients - truth) / np.sqrt(np.diag(fitted.mapped_covariance))


def test_model_is_the_equation_written_out_in_loops():
    """M(t) (V − b(t)) plus products of indications, entry by entry, in raw degrees."""
    coefficients = {
        "m_xx0": 1.01,
        "m_xx1": 2e-5,
        "m_yy0": 0.99,
        "m_zz0": 1.0,
        "m_xy0": 3e-3,
        "m_zx2": 1e-8,
    }
    coefficients |= {
        "b_x0": 1e-3,
        "b_y1": 2e-5,
        "b_z3": 1e-9,
        "n_x_xx": 1e-5,
        "n_y_yz": -2e-5,
        "n_z_zzz": 3e-5,
    }
    twin = []
    for temperature, indicated in zip(TEMPERATURE, INDICATION, strict=True):
        V = dict(zip("xyz", indicated, strict=True))
        b = {
            a: sum(coefficients.get(f"b_{a}{k}", 0.0) * temperature**k for k in range(4))
            for a in "xyz"
        }
        row = []
        for i in "xyz":
            total = 0.0
            for j in "xyz":
                entry = sum(
                    coefficients.get(f"m_{i}{j}{k}", 0.0) * temperature**k for k in range(4)
                )
                total += entry * (V[j] - b[j])
            for name, value in coefficients.items():
                if name.startswith(f"n_{i}_"):
                    total += value * np.prod([V[j] for j in name[4:]])
            row.append(total)
        twin.append(row)
    np.testing.assert_allclose(
        corrected(coefficients, INDICATION, TEMPERATURE), twin, atol=1e-14
    )  # g


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_derivatives_are_those_of_central_differences(seed):
    """The Jacobian of the model agrees with differences to 1e-8."""
    entries = EVERYTHING.list_entries(triangular=True)
    values, mapped = drawn(entries, seed), (TEMPERATURE[:30] - MIDDLE) / HALF
    slopes = affine_model.evaluate(entries, values, INDICATION[:30], mapped)[1]
    numeric = q_factor.differentiate(
        lambda at: affine_model.evaluate(entries, at, INDICATION[:30], mapped)[0].ravel(),
        values,
        scale=np.ones(len(entries)),
    )
    np.testing.assert_allclose(slopes.reshape(numeric.shape), numeric, atol=1e-8)


def test_nuisance_rotations_are_rotations():
    """The fixture's matrix is the rotation by its vector, and the tilt's derivative
    is exact.
    """
    for vector in ([0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -0.2, 0.5], [1.0, 2.0, -1.5]):
        matrix = affine_solve._rotation(np.array(vector))
        np.testing.assert_allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    tilt = np.array([0.2, -0.1])
    tool = ROTATION[:5]
    numeric = q_factor.differentiate(
        lambda at: affine_solve._tilted_gravity(tool, at)[0].ravel(), tilt, scale=np.ones(2)
    )
    np.testing.assert_allclose(
        affine_solve._tilted_gravity(tool, tilt)[1].reshape(15, 2), numeric, atol=1e-9
    )


def test_names_are_read_back():
    """Every parameter that can be fitted has a name that means it."""
    for triangular in (False, True):
        for entry in EVERYTHING.list_entries(triangular=triangular):
            assert affine_model.find_entry(entry.name) == entry
    with pytest.raises(FitError, match="no parameter 'm_xw0'"):
        affine_model.find_entry("m_xw0")


def test_everything_at_once_comes_out_of_one_fit():
    """Polynomial entries, higher orders, tilt and fixture are all within 4 u, and the residual is
    the noise.
    """
    entries = EVERYTHING.list_entries(triangular=True)
    truth = drawn(entries, 1)
    exact = indications(entries, truth, tilted_and_turned(entries, truth))
    indicated = exact + np.random.default_rng(2).normal(0.0, NOISE_G, exact.shape)
    fitted = affine.fit(indicated, TEMPERATURE, REFERENCE, terms=EVERYTHING, tool_rotation=ROTATION)
    assert np.max(np.abs(scores(fitted, truth))) < 4.0
    assert fitted.residual_rms == pytest.approx(NOISE_G, rel=0.06)
    assert fitted.condition < 30.0
    raw = dict(zip(fitted.names, fitted.coefficients, strict=True))
    mapped = affine_model.evaluate(
        entries, fitted.mapped_coefficients, indicated, (TEMPERATURE - MIDDLE) / HALF
    )[0]
    np.testing.assert_allclose(corrected(raw, indicated, TEMPERATURE), mapped, atol=1e-13)  # g


def test_intervals_cover_the_truth():
    """Over simulated sets the 95 % intervals cover 93 to 97 % of the parameters."""
    terms = AffineTerms(2, 1, 2)
    entries = terms.list_entries(triangular=False)
    covered = []
    for seed in range(25):
        truth = drawn(entries, seed)
        exact = indications(entries, truth, REFERENCE)
        indicated = exact + np.random.default_rng(seed).normal(0.0, NOISE_G, exact.shape)
        fitted = affine.fit(indicated, TEMPERATURE, REFERENCE, terms=terms)
        covered.append(np.abs(scores(fitted, truth)) <= t.ppf(0.975, fitted.dof))
    assert 0.93 <= np.mean(covered) <= 0.97


def test_tilt_lands_in_the_cross_axis_terms_unless_it_is_fitted():
    """A base tilted by 0.1° spoils K8 and K9 by far more than their uncertainty; as a nuisance it
    comes out itself.
    """
    truth = np.array([AUTHORITY["expected"][f"accel_{axis}"] for axis in "xyz"])
    tilt = np.array([1.7e-3, -0.9e-3])  # rad
    down = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    exact = k_factor.indications(truth, ROTATION @ down, TEMPERATURE)
    indicated = exact + np.random.default_rng(3).normal(0.0, NOISE_G, exact.shape)
    plain = k_factor.fit(indicated, TEMPERATURE, REFERENCE)
    wrong = [
        np.abs((axis.coefficients - k) / axis.standard_uncertainty)[8:]
        for axis, k in zip(plain, truth, strict=True)
    ]
    assert plain[0].residual_rms > 5.0 * NOISE_G
    assert np.max(wrong) > 2.0
    fitted = affine.fit(
        indicated,
        TEMPERATURE,
        REFERENCE,
        terms=AffineTerms(3, 1, 3, tilt=True),
        tool_rotation=ROTATION,
    )
    assert fitted.residual_rms == pytest.approx(NOISE_G, rel=0.06)
    u = fitted.standard_uncertainty[-2:]
    assert np.all(np.abs(fitted.coefficients[-2:] - tilt) < 4.0 * u)
    assert np.all(u < 1e-5)  # rad


def test_fixture_angles_come_out_however_crooked_the_triad():
    """Mounting and non-orthogonality are told apart: angles to 1e-10 rad from exact dwells."""
    terms = AffineTerms(1, 0, 1, fixture=True)
    entries = terms.list_entries(triangular=True)
    truth = drawn(entries, 4)
    truth[-3:] = [0.05, -0.12, 0.2]
    exact = indications(entries, truth, REFERENCE @ affine_solve._rotation(truth[-3:]))
    fitted = affine.fit(exact, TEMPERATURE, REFERENCE, terms=terms)
    np.testing.assert_allclose(fitted.coefficients[-3:], truth[-3:], atol=1e-10)


def test_a_tilt_without_the_tables_angles_is_refused():
    """A tilt acts before the table turns, so the rotations are needed."""
    with pytest.raises(FitError, match="a tilt needs the table's rotations"):
        affine.fit(INDICATION, TEMPERATURE, REFERENCE, terms=AffineTerms(tilt=True))


def test_q_factor_is_a_special_case_at_every_temperature():
    """Q of the affine fit is that of the axes at that temperature, with an interval that holds
    it.
    """
    q = np.array([-0.0143, 0.00887, -0.0121])
    sensitivity = np.diag([1.01, 0.99, 1.02]) @ q_factor.axes_from_angles(q)
    indicated = REFERENCE @ sensitivity.T + np.random.default_rng(6).normal(
        0.0, NOISE_G, REFERENCE.shape
    )
    found, covariance = affine.fit(indicated, TEMPERATURE, REFERENCE).evaluate_q(80.0)
    u = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(found - q) < 4.0 * u)
    assert np.all(u < 2e-5)  # rad


def test_conditions_that_leave_parameters_open_are_refused_by_name():
    """One temperature, or one cone, leaves entries open: they are named, with the dwells to add."""
    one = TEMPERATURE == 25.0
    with pytest.raises(FitError, match=r"accel_x: b_x1, .*m_xx1.*add dwells at 5 °C"):
        affine.fit(INDICATION[one], TEMPERATURE[one], REFERENCE[one])
    cone = ANGLES[:, 0] == 45.0
    with pytest.raises(FitError, match=r"accel_z: b_z0"):
        affine.fit(INDICATION[cone], TEMPERATURE[cone], REFERENCE[cone])


def test_a_sweep_at_two_attitudes_determines_a_diagonal_model():
    """Scale and bias over temperature come from two opposite attitudes while the temperature
    sweeps.
    """
    terms = AffineTerms(3, -1, 3)
    temperature = np.tile(np.linspace(-20.0, 125.0, 300), 2)
    angles = np.repeat([[54.7, 45.0], [125.3, 225.0]], 300, axis=0)
    reference = attitude.gravity_vector(*angles.T)
    u = (temperature - MIDDLE) / HALF
    scale = 1.0 + 4e-3 * u - 2e-3 * u**2 + 1e-3 * u**3
    bias = 2e-3 - 3e-3 * u + 1e-3 * u**2
    indicated = reference / scale[:, None] + bias[:, None]
    indicated = indicated + np.random.default_rng(7).normal(0.0, NOISE_G, reference.shape)
    fitted = affine.fit(indicated, temperature, reference, terms=terms)
    named = dict(
        zip(fitted.names, scores(fitted, np.tile([1.0, 4e-3, -2e-3, 1e-3], 6)), strict=True)
    )
    assert max(abs(v) for k, v in named.items() if k.startswith("m")) < 4.0


def test_a_wild_dwell_is_named_and_moves_nothing():
    """The robust fit names the dwell, not the rows of its axes, and stays within an uncertainty."""
    terms = AffineTerms(2, 0, 2)
    entries = terms.list_entries(triangular=False)
    truth = drawn(entries, 8)
    indicated = indications(entries, truth, REFERENCE)
    indicated = indicated + np.random.default_rng(9).normal(0.0, NOISE_G, indicated.shape)
    before = affine.fit(indicated, TEMPERATURE, REFERENCE, terms=terms, loss="robust")
    indicated[17] += [0.01, -0.02, 0.3]
    after = affine.fit(indicated, TEMPERATURE, REFERENCE, terms=terms, loss="robust")
    assert after.suspects == (17,)
    assert (
        np.max(np.abs(after.coefficients - before.coefficients) / before.standard_uncertainty) < 1.0
    )
    assert after.residual_rms == pytest.approx(NOISE_G, rel=0.08)


def test_weights_hold_noisy_dwells_back():
    """Weighting by dwell noise shrinks the uncertainty of every parameter."""
    noise = np.where(np.arange(len(ROWS)) % 2, NOISE_G, 20.0 * NOISE_G)
    indicated = (
        INDICATION + np.random.default_rng(10).normal(size=INDICATION.shape) * noise[:, None]
    )
    plain = affine.fit(indicated, TEMPERATURE, REFERENCE)
    for weights in (1.0 / noise**2, np.tile(1.0 / noise**2, (3, 1)).T):
        weighted = affine.fit(indicated, TEMPERATURE, REFERENCE, weights=weights)
        assert np.all(weighted.standard_uncertainty < 0.5 * plain.standard_uncertainty)


def test_covariance_of_the_correction_is_that_of_many_fits():
    """The stated covariance of corrected components matches the scatter over repeated
    calibrations.
    """
    terms = AffineTerms(1, 0, 1)
    entries = terms.list_entries(triangular=False)
    exact = indications(entries, drawn(entries, 11), REFERENCE)
    found, stated = [], 0.0
    for seed in range(60):
        noisy = exact + np.random.default_rng(seed).normal(0.0, NOISE_G, exact.shape)
        fitted = affine.fit(noisy, TEMPERATURE, REFERENCE, terms=terms)
        named = dict(zip(fitted.names, fitted.coefficients, strict=True))
        found.append(corrected(named, exact, TEMPERATURE))
        stated = (
            stated
            + np.mean(
                np.diagonal(corrected_covariance(fitted, exact, TEMPERATURE), axis1=1, axis2=2)
            )
            / 60
        )
    assert np.mean(np.var(found, axis=0, ddof=1)) == pytest.approx(stated, rel=0.12)


def test_lengths_alone_give_scale_and_bias_over_temperature():
    """Without attitudes, a triangular model over temperature is within 4 u of its truth."""
    terms = AffineTerms(2, 0, 2)
    entries = terms.list_entries(triangular=True)
    truth = drawn(entries, 12)
    indicated = indications(entries, truth, REFERENCE)
    indicated = indicated + np.random.default_rng(13).normal(0.0, NOISE_G, indicated.shape)
    fitted = affine.fit_magnitude(indicated, TEMPERATURE, terms=terms)
    assert np.max(np.abs(scores(fitted, truth))) < 4.0
    assert fitted.residuals.shape == (len(ROWS), 1)
    indicated[5] *= 1.5
    assert affine.fit_magnitude(indicated, TEMPERATURE, terms=terms, loss="robust").suspects == (5,)
    with pytest.raises(FitError, match="lengths see no tilt"):
        affine.fit_magnitude(indicated, TEMPERATURE, terms=AffineTerms(tilt=True))
    wandering = 25.0 + np.random.default_rng(14).uniform(-0.2, 0.2, len(ROWS))
    with pytest.raises(FitError, match="1 distinct temperatures do not determine order 2"):
        affine.fit_magnitude(indicated, wandering, terms=terms)


def faces(seed, *, wild):
    """Six faces at seven temperatures, each face set up about 0.01° wrong, the same way every time:
    indications, temperatures, stated references, and the matrix of the triad.
    """
    rng = np.random.default_rng(seed)
    stated = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 7, axis=0)
    turned = Rotation.from_rotvec(np.repeat(rng.normal(0.0, 1.75e-4, (6, 3)), 7, axis=0))
    matrix = np.eye(3) + 1e-3 * rng.normal(size=(3, 3))
    temperature = np.tile(np.linspace(-40.0, 85.0, 7), 6)
    zero = np.outer((temperature - 22.5) / 62.5, 1e-3 * rng.normal(size=3))
    indicated = turned.apply(stated) @ matrix.T + zero + rng.normal(0.0, NOISE_G, (42, 3))
    if wild:
        indicated[11, 1] += 0.05
    return indicated, temperature, stated, matrix


@pytest.mark.parametrize("seed", range(8))
def test_faces_that_are_set_up_wrong_are_kept_and_named_as_what_they_are(seed):
    """The robust fit drops no face: its matrix is within 700 µrad as that of least squares, though
    one wild dwell is among them; that dwell is the first suspect, and hardly another is one.
    """
    for terms in (AffineTerms(1, 0, 1), AffineTerms(3, 1, 3)):
        indicated, temperature, stated, matrix = faces(seed, wild=seed > 3)
        found = affine.fit(indicated, temperature, stated, terms=terms, loss="robust")
        entries = dict(zip(found.names, found.mapped_coefficients, strict=True))
        inverse = np.array([[entries[f"m_{row}{column}0"] for column in "xyz"] for row in "xyz"])
        assert np.max(np.abs(inverse - np.linalg.inv(matrix))) < 7e-4
        assert found.suspects[:1] == ((11,) if seed > 3 else ())
        assert len(found.suspects) <= 2
        assert {error.common for error in found.common_errors} <= {"attitude"}
        assert all(len(error.dwells) == 7 for error in found.common_errors)
        assert max((abs(error.size) for error in found.common_errors), default=0.0) < 7e-4


def test_a_robust_fit_of_exact_dwells_is_exact():
    """Without noise the robust fit comes to rest at the truth, to 12 digits, and accuses nobody."""
    terms = AffineTerms(3, 1, 3)
    truth = drawn(terms.list_entries(triangular=False), 3)
    exact = indications(terms.list_entries(triangular=False), truth, REFERENCE)
    fitted = affine.fit(exact, TEMPERATURE, REFERENCE, terms=terms, loss="robust")
    np.testing.assert_allclose(fitted.mapped_coefficients, truth, rtol=0.0, atol=1e-12)
    assert (fitted.suspects, fitted.common_errors) == ((), ())
