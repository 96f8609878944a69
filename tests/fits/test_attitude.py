"""Inclination, toolface and local gravity: conventions, errors, uncertainty."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.shared_errors import angle_slopes
from calibkit.numeric import attitude, earth
from fits.triad_dwells import recipe

AUTHORITIES = Path(__file__).parents[1] / "authorities"
SITE = json.loads((AUTHORITIES / "site.json").read_text())["gravity"]

inclinations = st.floats(0.5, 179.5)
toolfaces = st.floats(-180.0, 180.0)


def passive(axis, angle_deg):
    """Passive rotation matrix about one axis, written out."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    if axis == "z":
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


@given(inclinations, toolfaces)
def test_gravity_vector_is_the_product_of_passive_rotations(inclination, toolface):
    """R_z(φ) R_y(θ) (0, 0, 1) in the NED convention, and the tool's rotation is that product."""
    product = passive("z", toolface) @ passive("y", inclination)
    one, two = np.array([inclination]), np.array([toolface])
    np.testing.assert_allclose(attitude.tool_rotation(one, two)[0], product, atol=1e-15)
    np.testing.assert_allclose(
        attitude.gravity_vector(one, two)[0], product @ [0.0, 0.0, 1.0], atol=1e-15
    )


@given(inclinations, toolfaces, st.floats(0.5, 400.0))
def test_angles_come_back_from_their_gravity_vector(inclination, toolface, length):
    """Inclination and toolface return, whatever the length of the vector, to 1e-9 degrees."""
    vector = length * attitude.gravity_vector(np.array([inclination]), np.array([toolface]))
    assert attitude.inclination(vector)[0] == pytest.approx(inclination, abs=1e-9)
    assert attitude.wrapped(attitude.toolface(vector) - toolface)[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "expected"), [(-180.0, 180.0), (180.0, 180.0), (540.0, 180.0), (-190.0, 170.0)]
)
def test_angles_are_brought_into_the_half_open_turn(angle, expected):
    """The result lies in (−180, 180]."""
    assert attitude.wrapped(np.array([angle]))[0] == expected


@pytest.mark.parametrize("range_deg", [(0.0, 90.0), (10.0, 180.0), (50.0, 40.0)])
def test_a_range_that_reaches_the_vertical_is_refused(range_deg):
    """There is no toolface at 0° and 180°."""
    with pytest.raises(ValueError, match="toolface_range_deg"):
        recipe(toolface_range_deg=range_deg)


@pytest.mark.parametrize("inclination", [5.0, 45.0, 90.0, 150.0])
def test_propagated_uncertainty_is_that_of_many_readings(inclination):
    """First-order uncertainty agrees with 20,000 noisy readings to 3 %, correlation included, and
    grows as 1/sin.
    """
    covariance = 1e-8 * np.array([[4.0, 1.5, 0.5], [1.5, 2.0, -0.3], [0.5, -0.3, 1.0]])
    vector = attitude.gravity_vector(np.array([inclination]), np.array([25.0]))
    slopes = np.stack(angle_slopes(np.radians([inclination]), np.radians([25.0])))[:, 0]
    u_inclination, u_toolface_sin = np.degrees(np.sqrt(np.diag(slopes @ covariance @ slopes.T)))
    noisy = vector + np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, 20000)
    assert u_inclination == pytest.approx(np.std(attitude.inclination(noisy)), rel=0.03)
    u_toolface = u_toolface_sin / np.sin(np.radians(inclination))
    assert u_toolface == pytest.approx(np.std(attitude.toolface(noisy)), rel=0.03)


@pytest.mark.parametrize("site", SITE, ids=lambda site: f"{site['latitude_deg']}")
def test_local_gravity_is_that_of_the_worked_examples(site):
    """Somigliana's formula with the free-air gradient, to 1e-12 relative."""
    assert earth.local_gravity(site["latitude_deg"], site["height_m"]) == pytest.approx(
        site["g_mps2"], rel=1e-12
    )


@pytest.mark.parametrize(
    ("latitude", "height"), [(91.0, 0.0), (float("nan"), 0.0), (45.0, float("inf"))]
)
def test_no_gravity_beyond_the_poles(latitude, height):
    """Latitudes beyond ±90° and values that are no numbers are refused."""
    with pytest.raises(FitError, match="no gravity"):
        earth.local_gravity(latitude, height)
