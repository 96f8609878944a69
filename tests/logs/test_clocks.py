"""Two clocks: offset and drift come out within their uncertainty, and nothing is claimed that the
logs do not show.
"""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.logs import clocks
from calibkit.simulate import chamber, noise


def two_logs(seed, *, rate=5.0, soak=600.0, every=5.0):
    """Air on a chamber ramp by two thermometers on two clocks: both logs, and the true offset [s],
    drift, middle [s].
    """
    rng = np.random.default_rng(seed)
    programme = chamber.Programme.ramp(
        -40.0, 60.0, rate, soak_before_s=soak, soak_after_s=2.0 * soak
    )
    time, points = programme.set_points()
    air = chamber.Chamber().air(points, rng)
    offset, drift = rng.uniform(-30.0, 30.0), rng.normal(0.0, 50e-6)
    time_a = time[50:-50]
    a = noise.reading(np.interp(time_a, time, air), 0.0625, 0.05, rng)
    true_b = np.arange(20.0, time[-1] - 20.0, every) + rng.uniform(-0.5, 0.5)
    b = noise.reading(np.interp(true_b, time, air), 0.1, 0.05, rng)
    middle = float(np.median(true_b - offset))
    return (time_a, a, (true_b - offset + drift * middle) / (1.0 + drift), b), (
        offset,
        drift,
        middle,
    )


def test_offset_and_drift_hold_their_uncertainty():
    """Over 40 pairs of logs with offsets to ±30 s, the errors in standard uncertainties scatter by
    0.8 to 1.3.
    """
    z = []
    for seed in range(40):
        logs, (offset, drift, middle) = two_logs(seed)
        found = clocks.estimate_clock(*logs)
        u = found.standard_uncertainty
        z.append(
            (
                (found.offset_s - offset - drift * (found.middle_s - middle)) / u[0],
                (found.drift - drift) / u[1],
            )
        )
        assert u[0] < 0.2  # s
        assert u[1] < 3e-4
        assert found.gain == pytest.approx(1.0, abs=0.002)
    assert np.all((np.std(z, axis=0) > 0.8) & (np.std(z, axis=0) < 1.3))
    assert np.abs(z).max() < 4.0


def test_the_joined_time_is_the_line_through_offset_and_drift():
    """At the middle the offset alone counts; the uncertainty is least there and largest at an
    end.
    """
    logs, _ = two_logs(1)
    found = clocks.estimate_clock(*logs)
    assert found.on_a(np.array([found.middle_s]))[0] == pytest.approx(
        found.middle_s + found.offset_s, abs=1e-9
    )
    time = logs[2]
    assert found.largest_uncertainty(time) > found.standard_uncertainty[0]
    assert (found.on_a(time + 1000.0) - found.on_a(time))[0] == pytest.approx(
        1000.0 * (1.0 + found.drift), abs=1e-6
    )


def test_a_straight_ramp_alone_does_not_show_an_offset():
    """Without a corner an offset is another level of the sensor: refused, or an uncertainty of tens
    of seconds.
    """
    rng = np.random.default_rng(1)
    time = np.arange(2000.0)
    a, b = (5.0 / 60.0 * time + rng.normal(0.0, 0.05, time.size) for _ in range(2))
    try:
        found = clocks.estimate_clock(time, a, time, b)
    except FitError:
        return
    assert found.standard_uncertainty[0] > 10.0


def test_a_periodic_quantity_has_many_offsets_and_is_refused():
    """A compressor's cycle of 90 s explains the logs at every 90 s."""
    rng = np.random.default_rng(2)
    time = np.arange(4000.0)
    air = 20.0 + np.sin(2.0 * np.pi * time / 90.0)
    with pytest.raises(FitError, match="explain the two logs alike"):
        clocks.estimate_clock(
            time,
            air + rng.normal(0, 0.02, 4000),
            time + 13.0,
            air + rng.normal(0, 0.02, 4000),
            search_s=200,
        )


def test_a_faster_log_is_averaged_about_each_time():
    """Means over the interval about each time, as a loop finds them; none where half of the rows
    are missing.
    """
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 100.0, 0.1)
    value = rng.normal(size=time.size)
    at = np.arange(2.0, 90.0, 1.0)
    time, value = np.delete(time, slice(300, 340)), np.delete(value, slice(300, 340))
    found = clocks.average(time, value, at)
    for t, mean in zip(at, found, strict=True):
        inside = (time >= t - 0.5) & (time < t + 0.5)
        assert (
            np.isnan(mean)
            if inside.sum() < 5
            else mean == pytest.approx(value[inside].mean(), abs=1e-12)
        )
