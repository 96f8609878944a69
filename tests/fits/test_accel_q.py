"""Q-factor: non-orthogonality of a triad, exact and small-angle."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.equation import name_terms
from calibkit.numeric import attitude
from fits.triad_dwells import collect, fit_triad, recipe, values

AUTHORITY = json.loads((Path(__file__).parents[1] / "authorities" / "accel_q.json").read_text())
AXES = np.array(AUTHORITY["axes"])
EXACT = published.exact_matrix(published.small_angles(AXES))
SPOTS = np.array(
    [(0, 0), (180, 0), *((tilt, roll) for tilt in (45, 90, 135) for roll in range(0, 360, 60))],
    float,
)
REFERENCE = attitude.gravity_vector(*SPOTS.T)
Q = np.array([-0.0143, 0.00887303, -0.0121])  # rad

small = st.floats(-0.1, 0.1)


def turned(angles):
    """Rotation by three angles about x, y, z, one after the other."""
    matrix = np.eye(3)
    for axis, angle in enumerate(angles):
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        part = np.eye(3)
        part[i, i] = part[j, j] = np.cos(angle)
        part[i, j], part[j, i] = -np.sin(angle), np.sin(angle)
        matrix = part @ matrix
    return matrix


def small_angle_matrix(coefficients):
    """Small-angle Q [3, 3] of the source: G_y' = Q3 G_x + G_y; G_z' = Q2 G_x + Q1 G_y + G_z."""
    q1, q2, q3 = coefficients
    return np.array([[1.0, 0.0, 0.0], [q3, 1.0, 0.0], [q2, q1, 1.0]])


def fit_q(indicated, spots=SPOTS, *, noise=None):
    """Q of a triad at one temperature, and the constant triad."""
    orders = {"scale_order": 0, "bias_order": 0, "cross_order": 0}
    spec = recipe(loss="least_squares", k={"enabled": False}, affine=orders)
    fitted = fit_triad(collect(indicated, 0.0, spots, noise=noise), spec)
    return fitted.q, {one.name: one.value for one in fitted.affine.coefficients}


def test_published_matrices_come_out_of_the_axes():
    """Exact and small-angle Q of the worked example agree to 1e-12."""
    np.testing.assert_allclose(EXACT, AUTHORITY["Q_exact"], atol=1e-12)
    q = published.small_angles(AXES)
    np.testing.assert_allclose(q, [AUTHORITY[name] for name in published.Q_NAMES], rtol=1e-12)
    np.testing.assert_allclose(small_angle_matrix(q), AUTHORITY["Q_small_angle"], atol=1e-12)


def test_exact_form_is_the_published_recursion():
    """The matrix does what v1, v2, v3 say, line by line."""
    for m in np.array(AUTHORITY["measured"]):
        _, y, z = AXES
        v1 = m[0]
        v2 = (m[1] - y[0] * v1) / y[1]
        v3 = (m[2] - z[0] * v1 - z[1] * v2) / z[2]
        np.testing.assert_allclose(EXACT @ m, [v1, v2, v3], atol=1e-14)


@given(st.tuples(small, small, small))
def test_axes_and_small_angles_say_the_same(q):
    """Q1, Q2, Q3 give axes of unit length that give Q1, Q2, Q3 back."""
    axes = published.axes_from_angles(np.array(q))
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(published.small_angles(axes), q, atol=1e-15)


@given(st.tuples(small, small, small), st.tuples(*[st.floats(-3, 3)] * 3))
def test_q_is_the_same_in_any_mounting(q, angles):
    """A turn of the triad changes none of its angles."""
    turned_axes = published.axes_from_angles(np.array(q)) @ turned(angles)
    np.testing.assert_allclose(published.small_angles(turned_axes), q, atol=1e-13)


def test_fit_recovers_a_triad_in_a_fixture():
    """Scale, zero, mounting and Q come out together from exact dwells, Q to 1e-12 rad."""
    rotation, scale, bias = (
        turned((0.01, -0.02, 0.03)),
        np.array([1.01, 0.98, 1.003]),
        np.array([1e-3, -2e-3, 3e-3]),
    )
    axes = published.axes_from_angles(Q)
    q, triad = fit_q(scale * (REFERENCE @ (axes @ rotation).T) + bias)
    names = "xyz"
    cross = np.array([[triad.get(f"c_{i}{j}", 0.0) for j in names] for i in names])
    k, z = (np.array([triad[f"{kind}_{i}0"] for i in names]) for kind in "kz")
    sensitivity = np.linalg.inv((np.eye(3) - cross) * k)
    turned_axes = sensitivity / np.linalg.norm(sensitivity, axis=1)[:, None]
    np.testing.assert_allclose(values(q), Q, atol=1e-12)
    np.testing.assert_allclose(turned_axes, axes @ rotation, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(sensitivity, axis=1), scale, rtol=1e-12)
    np.testing.assert_allclose(z / k, bias, atol=1e-12)


def test_a_reversed_axis_is_refused():
    """A triad with one sign wrong is left-handed, and said to be."""
    with pytest.raises(FitError, match="left-handed"):
        fit_q(REFERENCE * [1.0, -1.0, 1.0])


def test_axes_in_one_plane_are_refused():
    """The axis of z, by its cross-axis term, along that of y."""
    terms = name_terms((0,) * 3, (0,) * 3, (0,) * 3)
    p = terms.start()
    p[terms.names.index("c_zy")] = 1e5
    with pytest.raises(FitError, match="one plane"):
        terms.at_temperature(p, 0.0)


def test_attitudes_on_one_cone_are_refused():
    """Toolfaces at one inclination do not separate the zero from the sensitivity."""
    cone = SPOTS[:, 0] == 45.0
    with pytest.raises(FitError, match=r"accel_z: .*z_z0|accel_z: c_zx"):
        fit_q(REFERENCE[cone], SPOTS[cone])
