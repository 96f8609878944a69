"""Stations of any number and sequence of positions: sinusoid, bias and ramp by least squares."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from calibkit.errors import FitError
from calibkit.instruments.inclinometer import (
    published,
    root_choice,
    stations,
)
from fits.stations import forward, wrapped

UNIT = published.Noise(1.0, 1.0, 0)
"""Noise of readings whose covariance is that of the fit alone."""
ATTITUDE = (30.0, 40.0, 70.0)
LATITUDE = 34.2
FOUR = (0.0, 90.0, 180.0, 270.0)


def log_of(
    positions,
    *,
    attitude=ATTITUDE,
    ramp_per_dwell=0.0,
    gyro_bias=0.3,
    accel_bias=1e-3,
    dwell_s=60.0,
    number=1,
):
    """Columns of one station: both sensors in a sequence of positions, made by rotation
    matrices.
    """
    readings = [forward(*attitude, LATITUDE, position=position) for position in positions]
    steps = np.arange(len(positions))
    columns = {
        "station": np.full(steps.size, float(number)),
        "position": np.array(positions),
        "time": steps * dwell_s,
    }
    for k, axis in enumerate("xy"):
        columns[f"accel_{axis}"] = np.array([gravity[k] for gravity, _ in readings]) + accel_bias
        columns[f"gyro_{axis}"] = (
            np.array([rate[k] for _, rate in readings]) + gyro_bias + ramp_per_dwell * steps
        )
    return columns


def fit(columns, sensor="x", *, gyro_ramp=False):
    """Fitted stations of one sensor pair."""
    return stations.fit_stations(
        pd.factorize(columns["station"])[0],
        columns["position"],
        columns[f"accel_{sensor}"],
        columns[f"gyro_{sensor}"],
        sensor,
        ramp_time_s=columns["time"] if gyro_ramp else None,
    )


def azimuth_of(components):
    """Azimuth [°] of components with s = 1."""
    return np.degrees(
        published.azimuth(
            components.accel_x, components.accel_y, components.gyro_x, components.gyro_y, LATITUDE
        )
    )


@pytest.mark.parametrize("sensor", ["x", "y"])
@pytest.mark.parametrize(
    "positions",
    [FOUR, (0.0, 120.0, 240.0), (10.0, 55.0, 200.0, 305.0, 120.0), tuple(range(0, 360, 30))],
)
def test_any_sequence_of_positions_gives_the_components_of_the_start_frame(positions, sensor):
    """Components to 1e-12 and bias to 1e-12, whatever the positions, from either sensor."""
    found = fit(log_of(positions), sensor)
    gravity, rate = forward(*ATTITUDE, LATITUDE)
    parts = found.components(UNIT)
    assert (parts.accel_x[0], parts.accel_y[0]) == pytest.approx(tuple(gravity[:2]), abs=1e-12)
    assert (parts.gyro_x[0], parts.gyro_y[0]) == pytest.approx(tuple(rate[:2]), abs=1e-11)
    assert found.coefficients[0, 1, 2] == pytest.approx(0.3, abs=1e-11)
    assert found.coefficients[0, 0, 2] == pytest.approx(1e-3, abs=1e-13)
    assert found.status == ("",)


@pytest.mark.parametrize("sensor", ["x", "y"])
def test_four_positions_are_the_four_differences(sensor):
    """At 0°, 90°, 180°, 270° least squares without a ramp gives halved differences, of half the
    variance of a reading.
    """
    columns = log_of(FOUR)
    noise = np.random.default_rng(0).normal(size=(2, 4))
    columns[f"gyro_{sensor}"] += 0.01 * noise[0]
    columns[f"accel_{sensor}"] += 2e-5 * noise[1]
    found = fit(columns, sensor).components(UNIT)
    # half differences of opposite positions; at 90° x lies where y was, y where −x was
    readings = np.array([columns[f"accel_{sensor}"], columns[f"gyro_{sensor}"]])
    first, second = (readings[:, :2] - readings[:, 2:]).T / 2.0
    x, y = (first, second) if sensor == "x" else (-second, first)
    expected = {"accel_x": x[0], "accel_y": y[0], "gyro_x": x[1], "gyro_y": y[1]}
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-9, abs=1e-15)
    assert found.covariance[0] == pytest.approx(np.eye(4) / 2.0, abs=1e-15)


def test_a_bias_ramp_costs_four_positions_what_is_published():
    """0.05 °/h a dwell costs up to 0.32° at 34° for θ → 0 and 0.51° at θ = 50°, over all azimuths
    and toolfaces.
    """
    worst = {}
    for theta in (1.0, 50.0):
        errors = []
        for psi in np.arange(0.0, 360.0, 30.0):
            for phi in np.arange(45.0, 405.0, 90.0):
                columns = log_of(FOUR, attitude=(theta, phi, psi), ramp_per_dwell=0.05)
                errors.append(abs(wrapped(azimuth_of(fit(columns).components(UNIT))[0] - psi)))
        worst[theta] = max(errors)
    assert worst[1.0] == pytest.approx(0.32, abs=0.01)
    assert worst[50.0] == pytest.approx(0.51, abs=0.01)


@pytest.mark.parametrize("positions", [(*FOUR, 0.0), (*FOUR, 270.0, 180.0, 90.0, 0.0), FOUR])
def test_a_fitted_ramp_leaves_no_error(positions):
    """The same ramp, fitted: azimuth to 1e-9° and the ramp of 3 °/h² to 1e-9, with five, eight and
    even four positions.
    """
    columns = log_of(positions, ramp_per_dwell=0.05)
    found = fit(columns, gyro_ramp=True)
    assert abs(wrapped(azimuth_of(found.components(UNIT))[0] - ATTITUDE[2])) < 1e-9
    assert 3600.0 * found.coefficients[0, 1, 3] == pytest.approx(0.05 * 60.0, abs=1e-9)
    assert (
        abs(wrapped(azimuth_of(fit(columns).components(UNIT))[0] - ATTITUDE[2])) > 1e-6
        or len(positions) == 8
    )


def many(count, positions, rng, noise=0.01):
    """Columns of many stations of one attitude with noise."""
    made = [log_of(positions, number=k) for k in range(count)]
    columns = {name: np.concatenate([log[name] for log in made]) for name in made[0]}
    columns["gyro_x"] = columns["gyro_x"] + noise * rng.normal(size=columns["gyro_x"].size)
    columns["accel_x"] = columns["accel_x"] + 2e-5 * rng.normal(size=columns["gyro_x"].size)
    return columns


def test_the_noise_comes_from_the_residuals_of_all_stations():
    """100 stations of six positions: the standard deviation of a reading to 10 %."""
    columns = many(100, (*FOUR, 45.0, 135.0), np.random.default_rng(1))
    found = fit(columns)
    accel, gyro = np.sqrt(found.squares.sum(axis=0) / found.dofs.sum(axis=0))
    assert gyro == pytest.approx(0.01, rel=0.1)
    assert accel == pytest.approx(2e-5, rel=0.1)
    assert found.dofs.sum(axis=0).tolist() == [300, 300]


def test_the_covariance_is_the_scatter_of_the_stations():
    """1000 stations of five unequal positions with a ramp: covariance of the rates agrees to 10 %
    of the variances.
    """
    columns = many(1000, (0.0, 60.0, 150.0, 200.0, 310.0), np.random.default_rng(2))
    found = fit(columns, gyro_ramp=True).components(UNIT)
    drawn = np.cov(np.vstack((found.gyro_x, found.gyro_y)))
    stated = 0.01**2 * found.covariance[0, 2:, 2:]
    size = np.sqrt(np.diag(stated))
    assert np.abs((drawn - stated) / np.outer(size, size)).max() < 0.1


def test_a_station_that_cannot_be_fitted_has_its_reason_and_the_others_are_solved():
    """Two readings, two positions, a NaN and a ramp hidden by the positions are named; the good
    station is solved.
    """
    logs = [
        log_of(FOUR, number=5),
        log_of((0.0, 90.0), number=4),
        log_of((0.0, 180.0, 0.0, 180.0, 0.0), number=3),
        log_of(FOUR, number=2),
    ]
    logs[3]["gyro_x"][1] = np.nan
    columns = {name: np.concatenate([log[name] for log in logs]) for name in logs[0]}
    found = fit(columns)
    assert found.status[0] == ""
    assert found.status[1] == "2 readings for 3 coefficients"
    assert "cannot determine" in found.status[2]
    assert "not finite" in found.status[3]
    assert np.isnan(found.components(UNIT).gyro_x[1:]).all()
    prior = root_choice.ScalePrior(np.ones(4), np.full(4, 0.01))
    roots = root_choice.estimate_roots(found.components(UNIT), LATITUDE, refused=found.status)
    solved = root_choice.solve(roots, prior)
    assert solved.status == found.status
    assert abs(wrapped(solved.azimuth_deg[0] - ATTITUDE[2])) < 1e-6


def test_what_cannot_be_fitted_at_all_is_refused():
    """No noise and no degree of freedom, no station at all."""
    columns = log_of((0.0, 120.0, 240.0))
    found = fit(columns)
    auto = SimpleNamespace(accel_noise_g="auto", gyro_noise_dph="auto")
    spec = SimpleNamespace(stations=auto)
    with pytest.raises(FitError, match="no station tells the noise"):
        stations.decide_noise(found.squares, found.dofs, published.NO_NOISE, (0.0, 0.0), spec, "x")
    with pytest.raises(FitError, match="none of 1 stations"):
        fit(log_of((0.0, 90.0)))
