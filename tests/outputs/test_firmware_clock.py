"""A drift chain by the clock: gaps, missing numbers, jumps, wrong intervals and starts, against the
float64 model at the true case temperature, within what the header states.
"""

import re

import numpy as np
import pytest

from calibkit.firmware import bounds, formats, twin
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.numeric import bank
from conftest import slow_after
from outputs.firmware_log import run_by_the_clock, words

INTERVAL = 10.0
INTERVAL_MS = 10_000
NOISE = 1e-11
"""Rounding of the float64 model itself [°/h]."""


def along(quantised, case, elapsed):
    """Drift [n, °/h] and statuses [n] of calls so many milliseconds [n] after one another."""
    heard = words(quantised, {"temp_case_degc": case})
    found = run_by_the_clock(quantised, heard, np.asarray(elapsed))
    drift = [float(one.outputs["drift_dph"][0]) for one in found]
    return np.array(drift), np.array([int(one.status[0]) for one in found])


def truth(this, time, case):
    """Drift [n, °/h] of the float64 model along a case temperature."""
    model = forms.read_thermal(this.record("drift_rate.json").model("drift"))
    return bank.evaluate(model, time, case, case, this.spec.reference_temp_degc).drift


def largest_rate(this):
    """Largest fitted rate [°C/min]."""
    model = this.record("drift_rate.json").models[0]
    return max(map(abs, model.valid["temp_rate_degc_min"]))


def wandering(rate, size, seed, low=-30.0, high=55.0):
    """Case temperature [size, °C] every INTERVAL that turns at random and is never faster than a
    rate [°C/min].
    """
    rng = np.random.default_rng(seed)
    pace = np.repeat(rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], size), 6)[:size] * rate
    case = np.empty(size)
    now = 20.0
    for k in range(size):
        step = pace[k] * INTERVAL / 60.0
        now = now + step if low <= now + step <= high else now
        case[k] = now
    return case


def stated(this, head):
    """Errors [°/h] that a line of the header states."""
    (line,) = (text for text in this.chain.timing if text.startswith(head))
    return [float(x) for x in re.findall(r"([\d.e-]+) deg/h", line)]


def bits(chain):
    """Status → bit."""
    return {flag: 1 << k for k, flag in enumerate(chain.structure.flags)} | {
        "INVALID": twin.INVALID
    }


@pytest.mark.parametrize("number", ["f32", "f64"])
@pytest.mark.parametrize("name", slow_after(1, ["lagged", "bank", "grown", "level"]))
def test_apply_and_firmware_agree_from_minus_55_to_90_degrees(name, number, runs):
    """Far beyond the fitted range and back, at the largest fitted rate: the lags follow the case
    in both, and both use the ends of the fitted range.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find(number))
    bound = bounds.find_bounds(this.chain, quantised)["drift_dph"]
    turns = np.array([20.0, -55.0, -55.0, 90.0, 90.0, 20.0])
    times = np.concatenate(
        [[0.0], np.cumsum(np.abs(np.diff(turns)) / largest_rate(this) * 60 + 90)]
    )
    time = np.arange(0.0, times[-1], INTERVAL)
    case = np.rint(np.interp(time, times, turns) * 64.0) / 64.0
    if name == "level":
        heard = words(quantised, {e.name: case for e in quantised.structure.inputs})
        found = run_by_the_clock(quantised, heard, np.full(time.size, INTERVAL_MS))
        drift = [float(one.outputs["drift_dph"][0]) for one in found]
    else:
        drift, _ = along(quantised, case, np.full(time.size, INTERVAL_MS))
    assert np.abs(drift - truth(this, time, case)).max() <= bound + NOISE


@pytest.mark.parametrize("name", slow_after(1, ["lagged", "bank", "grown"]))
def test_gaps_up_to_the_longest_are_bridged_as_apply_bridges_them(name, runs):
    """Calls that do not come, and numbers that are none: behind each the drift is that of `apply`
    to the rows that are left, and that of the whole log within what the header states.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find("f64"))
    bound = bounds.find_bounds(this.chain, quantised)["drift_dph"]
    (allowed,) = stated(this, "gap")
    worst = 0.0
    for seed in range(20):
        case = wandering(largest_rate(this), 400, seed)
        time = np.arange(400) * INTERVAL
        rng = np.random.default_rng(seed + 100)
        kept = np.ones(400, dtype=bool)
        for start in range(40, 380, 200):
            kept[start : start + rng.integers(1, 6)] = False
        late = np.diff(np.flatnonzero(kept), prepend=0) * INTERVAL_MS
        drift, status = along(quantised, case[kept], late)
        line = np.interp(time, time[kept], case[kept])
        assert np.abs(drift - truth(this, time, line)[kept]).max() <= bound + NOISE
        heard = np.where(kept, case, np.nan)
        again, seen = along(quantised, heard, np.full(400, INTERVAL_MS))
        np.testing.assert_array_equal(again[kept], drift)
        assert (seen[~kept] == twin.INVALID).all()
        assert (status[1:][late[1:] > INTERVAL_MS] & bits(this.chain)["INTERVAL"]).all()
        worst = max(worst, np.abs(drift - truth(this, time, case)[kept]).max())
    assert 0.02 * allowed < worst <= allowed


@pytest.mark.parametrize("name", slow_after(1, ["lagged", "bank"]))
def test_a_reset_on_a_ramp_is_flagged_until_its_error_is_what_the_header_states(name, runs):
    """On the fastest fitted ramp: the error is within the first figure, STARTING stands while it
    is above the second.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find("f64"))
    at_first, then = stated(this, "start")
    rate = largest_rate(this)
    settled = int(this.chain.tables["pace"][0])
    for sign in (1.0, -1.0):
        # long on the ramp before the reset; the model without limits of range has no end to it
        size = 60 + min(settled, int(85.0 / rate * 60 / INTERVAL))
        case = 12.0 + sign * rate * (np.arange(size) - 60) * INTERVAL / 60.0 / (size / 60.0)
        time = np.arange(size) * INTERVAL
        drift, status = along(quantised, case[60:], np.full(size - 60, INTERVAL_MS))
        error = np.abs(drift - truth(this, time, case)[60:])
        assert error.max() <= at_first
        starting = status & bits(this.chain)["STARTING"] != 0
        assert starting[: min(settled, starting.size)].all()
    rest = np.full(settled + 5, 20.0)
    _, status = along(quantised, rest, np.full(rest.size, INTERVAL_MS))
    starting = status & bits(this.chain)["STARTING"] != 0
    assert starting[:settled].all()
    assert not starting[settled:].any()
    assert then <= 0.011 * at_first


@pytest.mark.parametrize("name", slow_after(1, ["lagged", "bank"]))
def test_an_hour_without_numbers_starts_anew_and_says_so(name, runs):
    """The case moved by 40 °C meanwhile: held with INVALID, then STARTING until the lags have
    settled, and right after that.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find("f32"))
    settled = int(this.chain.tables["pace"][0])
    before, after = np.full(100, 10.0), np.full(settled + 200, 50.0)
    lost = np.concatenate([before, np.full(360, np.nan), after])
    real = np.concatenate([before, np.linspace(10, 50, 360), after])
    time = np.arange(real.size) * INTERVAL
    drift, status = along(quantised, lost, np.full(real.size, INTERVAL_MS))
    flags, expected = bits(this.chain), truth(this, time, real)
    assert (status[100:460] == twin.INVALID).all()
    assert np.ptp(drift[99:460]) == 0.0
    begun = status[460 : 460 + settled]
    assert (begun & flags["STARTING"]).all()
    assert begun[0] & flags["INTERVAL"]
    clear = status & ~flags["TEMP_CLAMPED"] == 0
    clear[:100] = False
    assert np.abs(drift - expected)[clear].max() <= stated(this, "start")[1]


@pytest.mark.parametrize("number", ["f32", "f64"])
@pytest.mark.parametrize("name", ["lagged", "bank"])
def test_a_glitch_is_not_used(name, number, runs):
    """One reading of 85 °C, and three of 0 °C: the drift is held, and behind them as if there had
    been none; a step that stays is a start.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find(number))
    flags, size = bits(this.chain), 900
    case = wandering(largest_rate(this) / 2, size, 3, 5.0, 40.0)
    heard = case.copy()
    heard[600], heard[700:703] = 85.0, -10.0
    drift, status = along(quantised, heard, np.full(size, INTERVAL_MS))
    assert (status[[600, 700, 701, 702]] == flags["JUMPED"]).all()
    kept = np.ones(size, dtype=bool)
    kept[[600, 700, 701, 702]] = False
    late = np.diff(np.flatnonzero(kept), prepend=0) * INTERVAL_MS
    without, _ = along(quantised, case[kept], late)
    np.testing.assert_array_equal(drift[kept], without)
    stays = np.concatenate([np.full(600, 0.0), np.full(200, 60.0)])
    _, status = along(quantised, stays, np.full(stays.size, INTERVAL_MS))
    jumped = status[600:] & flags["JUMPED"] != 0
    assert jumped[:6].all()
    assert not jumped[6:].any()
    assert (status[606:650] & flags["STARTING"]).all()


@pytest.mark.parametrize("name", ["lagged", "bank"])
@pytest.mark.parametrize("called_s", slow_after(1, [5.0, 8.0, 9.5, 12.0, 25.0]))
def test_calls_at_another_interval_are_right_by_the_clock(name, called_s, runs):
    """Half an interval to two and a half: flagged, and the drift stays within what the header
    states for a gap, where an update without the clock is wrong by the ratio of the intervals.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find("f32"))
    size = round(4000.0 / called_s)
    time = np.arange(size) * called_s
    grid = np.arange(401) * INTERVAL
    whole = wandering(largest_rate(this), 401, 7)
    case = np.interp(time, grid, whole)
    drift, status = along(quantised, case, np.full(size, round(1000 * called_s)))
    error = np.abs(drift - truth(this, time, case))
    assert error.max() <= stated(this, "gap")[0]
    off = status[1:] & bits(this.chain)["INTERVAL"] != 0
    assert off.all() == (called_s != 9.5)
    assert off.mean() < 0.3 or called_s != 9.5
