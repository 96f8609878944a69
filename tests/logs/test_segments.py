"""Soaks, ramps and the measured temperature rate."""

import numpy as np
import pytest

from calibkit.numeric import segments


def ramp_log(rate, *, soak=600.0, span=40.0, step=1.0):
    """Time [s] and air temperature [°C] of soak, ramp and soak; the ramp lasts span/|rate|
    minutes.
    """
    duration = span / abs(rate) * 60.0
    time = np.arange(0.0, 2 * soak + duration, step)
    air = 20.0 + rate / 60.0 * np.clip(time - soak, 0.0, duration)
    return time, air


def test_the_slope_equals_a_loop_of_straight_line_fits():
    """The running sums give what polyfit gives window by window, to 1e-9 °C/min, on irregular time
    too.
    """
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.5, 2.0, 300))
    value = np.cumsum(rng.normal(size=300))
    slope = segments.causal_slope(time, value, 30.0)
    for k in range(60, 300, 7):
        window = (time >= time[k] - 30.0 * (1 + 1e-9)) & (time <= time[k])
        assert slope[k] == pytest.approx(
            60.0 * np.polyfit(time[window] - time[k], value[window], 1)[0], abs=1e-9
        )


def test_the_slope_knows_nothing_of_the_future():
    """Changing the samples after an instant changes nothing up to it, bit for bit."""
    time, air = ramp_log(5.0)
    changed = air.copy()
    changed[700:] += 9.0 - changed[700:].mean() + air[700:].mean() - 9.0
    changed[700:] = changed[700:][::-1]
    before = segments.causal_slope(time, air, 60.0)[:700]
    after = segments.causal_slope(time, changed, 60.0)[:700]
    assert np.abs(before - after).max() < 1e-9


def test_a_quantised_thermometer_does_not_fake_a_rate():
    """A 0.0625 °C step differenced at 1 s is 3.75 °C/min; over a minute's window it stays under 0.1
    °C/min.
    """
    time = np.arange(600.0)
    air = np.where(time < 300.0, 20.0, 20.0625)
    assert np.abs(segments.causal_slope(time, air, 60.0)).max() < 0.1


def test_a_log_is_cut_into_soak_ramp_soak_that_cover_every_row():
    """The pieces follow each other without a hole, and the ramp's rate is the measured one."""
    time, air = ramp_log(-5.0)
    slope = segments.causal_slope(time, air, 60.0)
    cut = segments.segments(slope, air, ramp_min=0.3, min_span=5.0, merge=60)
    assert [piece.kind for piece in cut] == ["soak", "ramp", "soak"]
    assert [piece.start for piece in cut] == [0, *[piece.stop for piece in cut[:-1]]]
    assert cut[-1].stop == time.size
    assert cut[1].rate == pytest.approx(-5.0, abs=1e-6)
    assert abs(time[cut[1].start] - 600.0) < 40.0


def coarse_ramp(rate, step, phase=0.0):
    """Time [s], air of one ramp of 60 °C between soaks with a compressor's cycling, read in coarse
    steps, and where it ends.
    """
    time = np.arange(0.0, 1200.0 + 60.0 / rate * 60.0 + 1800.0)
    air = (
        20.0
        + np.clip((time - 600.0) * rate / 60.0, 0.0, 60.0)
        + 0.15 * np.sin(2.0 * np.pi * time / 90.0)
    )
    return time, np.round((air + phase) / step) * step, 600.0 + 60.0 / rate * 60.0


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0, 5.0, 10.0])
@pytest.mark.parametrize("step", [0.5, 1.0])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.7])
def test_a_thermometer_of_one_degree_gives_the_rate_of_a_ramp(rate, step, phase):
    """One ramp is found, at the set rate within 5 % (1 % of slow ones in steps of 1 °C), and over
    within 5 minutes.
    """
    time, air, end = coarse_ramp(rate, step, phase)
    slope = segments.measured_slope(time, air, 60.0)
    (ramp,) = [
        s
        for s in segments.segments(slope, air, ramp_min=0.3, min_span=5.0, merge=60)
        if s.kind == "ramp"
    ]
    slow = step == 1.0 and rate <= 1.0
    assert ramp.rate == pytest.approx(rate, rel=0.01 if slow else 0.05)
    assert 500.0 < ramp.start < 950.0
    assert ramp.stop < end + 300.0
