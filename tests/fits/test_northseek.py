"""The published four-position scheme: worked examples, an independent forward model, conventions,
degenerate attitudes.
"""

import json

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.instruments.inclinometer import published, stations as station_steps
from calibkit.numeric import earth
from calibkit.numeric.constants import EARTH_RATE_DPH
from conftest import AUTHORITIES
from fits.stations import FOUR, components_of, forward, vector_components, wrapped

STATIONS = json.loads((AUTHORITIES / "four_position.json").read_text(encoding="utf-8"))["stations"]


@pytest.mark.parametrize("sensor", ["x", "y"])
@pytest.mark.parametrize(
    "station", STATIONS, ids=lambda station: f"theta {station['expected']['inclination_deg']:g}"
)
def test_the_worked_examples_come_out_by_either_sensor(station, sensor):
    """θ, φ, both roots, ψ and C to 1e-9 (angles modulo 360°), from the x sensor alone and from the
    y sensor alone.
    """
    expected, latitude = station["expected"], station["latitude_deg"]
    parts = vector_components(station, sensor)
    found = published.attitude(parts.accel_x, parts.accel_y)
    plus, minus, _ = published.scale_roots(parts.gyro_x, parts.gyro_y, found, latitude)
    s = expected["s"]
    psi = published.azimuth(
        parts.accel_x, parts.accel_y, s * parts.gyro_x, s * parts.gyro_y, latitude
    )
    assert np.degrees(found.inclination[0]) == pytest.approx(expected["inclination_deg"], abs=1e-9)
    assert abs(wrapped(np.degrees(found.toolface[0]) - expected["toolface_deg"])) < 1e-9
    assert abs(wrapped(np.degrees(psi[0]) - expected["azimuth_deg"])) < 1e-9
    assert (plus[0], minus[0]) == pytest.approx(
        (expected["root_plus"], expected["root_minus"]), abs=1e-9
    )
    assert published.root_label(found.inclination, psi, latitude)[0] == pytest.approx(
        expected["C"], abs=1e-9
    )
    assert (min(plus[0], minus[0]) > 0.0) == expected["both_roots_positive"]


ATTITUDES = st.tuples(
    st.floats(1.0, 84.0),
    st.floats(-180.0, 180.0),
    st.floats(0.0, 360.0),
    st.floats(-75.0, 75.0),
    st.floats(0.9, 1.1),
)


@given(ATTITUDES)
@settings(max_examples=200, deadline=None)
def test_any_attitude_comes_back_through_the_root_that_c_labels(attitude):
    """θ, φ to 1e-6°, and s, ψ from the root of the sign of C as exactly as C allows, from readings
    made by matrices.
    """
    theta, phi, psi, latitude, s = attitude
    gravity, rate = forward(theta, phi, psi, latitude, s)
    x, y = (np.array([v]) for v in gravity[:2])
    found = published.attitude(x, y)
    assert np.degrees(found.inclination[0]) == pytest.approx(theta, abs=1e-6)
    assert abs(wrapped(np.degrees(found.toolface[0]) - phi)) < 1e-6
    C = published.root_label(np.radians([theta]), np.radians([psi]), latitude)[0]
    if abs(C) < 0.01:
        return
    plus, minus, _ = published.scale_roots(rate[:1], rate[1:2], found, latitude)
    root = (plus if C > 0.0 else minus)[0]
    assert root == pytest.approx(s, abs=1e-9 / abs(C))
    back = published.azimuth(x, y, root * rate[:1], root * rate[1:2], latitude)
    assert abs(wrapped(np.degrees(back[0]) - psi)) < 1e-6 / abs(C)


@pytest.mark.parametrize("sensor", ["x", "y"])
def test_four_differences_cancel_a_constant_bias(sensor):
    """Readings of one sensor in four positions, by matrices, with a bias: the components of the
    start frame to 1e-15.
    """
    axis = 0 if sensor == "x" else 1
    readings = np.array(
        [[forward(30.0, 40.0, 70.0, 34.2, position=p)[1][axis] + 0.3 for p in (0, 90, 180, 270)]]
    )
    parts = components_of(0.0 * readings, readings, sensor)
    assert (parts.gyro_x[0], parts.gyro_y[0]) == pytest.approx(
        tuple(forward(30.0, 40.0, 70.0, 34.2)[1][:2]), abs=1e-12
    )


def test_the_closure_of_four_positions_tells_the_noise():
    """5000 stations of noise 0.01 on any signal and bias: 0.01 to 3 %; a constant bias is not in
    it.
    """
    rng = np.random.default_rng(1)
    x, y, bias = rng.normal(size=(3, 5000))
    readings = np.column_stack((x, y, -x, -y)) + bias[:, None] + 0.01 * rng.normal(size=(5000, 4))
    station, position = np.repeat(np.arange(5000), 4), np.tile(FOUR, 5000)
    fits = station_steps.fit_stations(station, position, readings.ravel(), readings.ravel(), "x")
    assert (fits.dofs == 1).all()
    assert np.sqrt(fits.squares.mean(axis=0)) == pytest.approx(0.01, rel=0.03)


def test_accelerations_beyond_gravity_are_clamped_and_marked():
    """√(g_x² + g_y²) of 1.001 is 90° of inclination, marked, with a finite azimuth and no
    warning.
    """
    x, y = np.array([-1.0009, 0.1]), np.array([0.05, 0.0])
    found = published.attitude(x, y)
    assert found.clamped.tolist() == [True, False]
    assert np.degrees(found.inclination[0]) == 90.0
    assert np.isfinite(published.azimuth(x, y, np.ones(2), np.ones(2), 34.2)).all()


def test_a_negative_discriminant_is_clamped_and_marked():
    """Noise that turns the discriminant negative gives a double root, marked, never a NaN."""
    gravity, _ = forward(80.0, 20.0, 90.0, 34.2)
    found = published.attitude(gravity[:1], gravity[1:2])
    B = np.array([10.0])
    phi = found.toolface
    plus, minus, clamped = published.scale_roots(B * np.sin(phi), B * np.cos(phi), found, 34.2)
    assert clamped[0]
    assert plus[0] == minus[0]
    assert np.isfinite(plus[0])


@pytest.mark.parametrize(("toolface", "azimuth"), [(10.0, 30.0), (-170.0, 200.0), (90.0, 350.0)])
def test_a_vertical_tool_shows_the_sum_of_toolface_and_azimuth(toolface, azimuth):
    """At θ = 0 neither angle is defined and their sum is, to 1e-9°."""
    _, rate = forward(0.0, toolface, azimuth, 34.2)
    found = np.degrees(published.toolface_plus_azimuth(rate[:1], rate[1:2]))[0]
    assert abs(wrapped(found - toolface - azimuth)) < 1e-9


def test_the_azimuth_error_of_a_wrong_scale_factor_is_as_published():
    """An excess e of s ω errs by −e tan α tan θ sin ψ to first order: 1e-4 at four attitudes, to 1
    % of the largest.
    """
    e = 1e-4
    for theta, psi in ((10.0, 30.0), (40.0, 90.0), (60.0, 250.0), (30.0, 180.0)):
        gravity, rate = forward(theta, 25.0, psi, 34.2)
        x, y = gravity[:1], gravity[1:2]
        found = published.azimuth(x, y, (1.0 + e) * rate[:1], (1.0 + e) * rate[1:2], 34.2)[0]
        expected = (
            -e * np.tan(np.radians(34.2)) * np.tan(np.radians(theta)) * np.sin(np.radians(psi))
        )
        assert np.radians(wrapped(np.degrees(found) - psi)) == pytest.approx(expected, abs=2e-6)


def test_the_earths_rate_has_the_components_of_the_latitude():
    """Vertical rate of the published table to 1e-9 °/h; horizontal and vertical make the whole."""
    for latitude, value in (
        (0.0, 0.0),
        (34.2, 8.454333745860213),
        (51.0784, 11.702045738052043),
        (90.0, 15.041067),
    ):
        assert float(earth.vertical_rate(latitude)) == pytest.approx(value, abs=1e-9)
        whole = np.linalg.norm(earth.north_east_down(latitude))
        assert float(whole) == pytest.approx(15.041067, abs=1e-12)
    # WGS 84, NIMA TR8350.2, table 3.1
    assert np.degrees(7.292115e-5) * 3600.0 == pytest.approx(EARTH_RATE_DPH, rel=2e-8)
