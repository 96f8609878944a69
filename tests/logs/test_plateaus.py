"""Held rates of a rate-table log: found, freed of acceleration, averaged over whole revolutions."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import held_rates, simulate
from calibkit.instruments.gyro_scale.recipe import PlateauSpec

LEVEL_DPS = 15.041067 / 3600.0 * np.cos(np.radians(34.2))
K = 10000.0


def table_log(rates, *, axis=(0.0, 0.0, 1.0), noise=3.0, seed=1, **table):
    """Log of a straight-line gyro without bias on the simulated table, and the motion."""
    rng = np.random.default_rng(seed)
    gyro = simulate.RateGyro(K, axis, 0.0, 0.0, 50.0, 0.0, 0.0, 0.0, noise, 0.05)
    stand = simulate.TurnedTable(warming_degc=0.0, **table)
    return simulate.run({"gyro_x_lsb": gyro}, stand, rates, 25.0, rng)


RULES = PlateauSpec()


def find(time, rate, angle=None, rules=RULES):
    """Rows of the held rates of a log."""
    return held_rates.find(held_rates.Motion.of(time, rate, angle), rules)


def means(time, rate, indication, angle=None, temp_degc=None):
    """Means over the held rates of columns."""
    motion = held_rates.Motion.of(time, rate, angle)
    held = held_rates.find(motion, RULES)
    return held_rates.average(motion, indication.reshape(time.size, -1), held, temp_degc)


def averaged(log, *, angle=True):
    """Means of a log, with or without its angle."""
    return means(
        log["time_s"],
        log["table_rate_dps"],
        log["gyro_x_lsb"],
        log["table_angle_deg"] if angle else None,
    )


def samples(found):
    """Number of rows of each held rate."""
    return np.diff(found.span)[:, 0]


def staircase(levels, held=40, slope=5, interval=0.1):
    """Times and rates [°/s] of held levels joined by linear accelerations of some samples."""
    rate = [0.0]
    for level in levels:
        rate += np.linspace(rate[-1], level, slope + 1)[1:].tolist() + [level] * held
    return np.arange(len(rate)) * interval, np.array(rate)


def test_every_held_rate_is_found_once():
    """The 22 rates of the simulated table come back in order, within 2 ppm of what was set,
    whatever the unevenness.
    """
    found = averaged(table_log(simulate.both_ways()))
    assert found.rate_dps == pytest.approx(np.array(simulate.both_ways()), rel=2e-6)


def test_no_sample_of_an_acceleration_is_used():
    """Every used row has the held rate to 0.1 %, and the row before it too: its interval holds no
    acceleration.
    """
    time, rate = staircase([10.0, 20.0, -20.0, 0.5, 0.502])
    spans = find(time, rate)
    assert len(spans) == 5
    for (first, stop), level in zip(spans, (10.0, 20.0, -20.0, 0.5, 0.502), strict=True):
        assert np.abs(rate[first - 1 : stop] / level - 1.0).max() <= 1e-3


def test_the_angle_shows_an_acceleration_that_the_commanded_rate_hides():
    """A commanded rate steps at once: with the angle logged, 10 s of acceleration are dropped all
    the same.
    """
    log = table_log((50.0, 100.0), acceleration_dps2=5.0)
    measured = log["table_rate_dps"]
    commanded = np.select([measured < 0.01, measured < 50.01], [0.0, 50.0], 100.0)
    spans = find(log["time_s"], commanded, angle=log["table_angle_deg"])
    for first, stop in spans:
        assert np.ptp(measured[first:stop]) < 0.01


def test_whole_revolutions_average_the_horizontal_earth_rate_away():
    """A gyro across the axis sees no rate to 0.2 counts over whole revolutions, and 124 counts peak
    within them.
    """
    log = table_log((5.0, -5.0), axis=(1.0, 0.0, 0.0), noise=0.3, unevenness=0.0)
    found = averaged(log)
    assert (found.revolutions == 1).all()
    assert np.abs(found.indication).max() < 0.2 < 0.005 * K * LEVEL_DPS * 1e3


@pytest.mark.parametrize("angle", [True, False])
def test_whole_revolutions_are_cut_to_a_fraction_of_a_sample(angle):
    """At 47 °/s and 2 Hz, 23.5° a sample, 100 counts of modulation average to 0.3 counts, which
    whole samples miss.
    """
    interval, rate = 0.5, 47.0
    count = 40
    time = np.arange(1, count + 1) * interval
    # mean of 100 cos over each interval, exactly
    modulated = (
        100.0
        * np.diff(np.sin(np.radians(rate * np.arange(count + 1) * interval)))
        / np.radians(rate * interval)
    )
    found = means(
        time,
        np.full(count, rate),
        modulated,
        angle=(rate * time) % 360.0 if angle else None,
    )
    first, stop = found.span[0]
    assert found.revolutions[0] == 2
    assert abs(found.indication[0, 0]) < 0.3 < abs(modulated[first:stop].mean())


def test_the_correction_of_a_partial_turn_is_in_its_uncertainty():
    """60 logs with one plateau at rest: its error scatters by its stated uncertainty to 25 %, ten
    times its own noise.
    """
    errors, stated = [], []
    for seed in range(60):
        log = table_log((20.0, -20.0), axis=(0.6, 0.0, 0.8), noise=3.0, seed=seed, unevenness=0.0)
        rng = np.random.default_rng(seed)
        still = {name: np.concatenate([np.repeat(v[:1], 2000), v]) for name, v in log.items()}
        still["time_s"] = np.arange(still["time_s"].size) * 0.5
        at_rest = K * 0.8 * 15.041067 / 3600.0 * np.sin(np.radians(34.2))
        seen = at_rest + K * 0.6 * LEVEL_DPS * np.cos(np.radians(log["table_angle_deg"][0]))
        still["gyro_x_lsb"][:2000] = seen + 3.0 * rng.normal(size=2000)
        found = averaged(still)
        assert abs(found.rate_dps[0]) < 1e-3
        errors.append(found.indication[0, 0] - at_rest)
        stated.append(found.standard_uncertainty[0, 0])
    assert np.std(errors) == pytest.approx(np.mean(stated), rel=0.25)
    assert np.mean(stated) > 5.0 * 3.0 / np.sqrt(2000)


def test_less_than_a_revolution_is_corrected_where_the_angle_is_logged():
    """Plateaus of a quarter turn have the horizontal earth rate taken out to 4 of their standard
    uncertainties.
    """
    rates = (0.5, 1.0, 2.0, 5.0, 20.0, -0.5, -1.0, -2.0, -5.0, -20.0)
    log = table_log(rates, axis=simulate.tilted(60.0, 30.0), noise=0.5)
    short = {name: values[: np.searchsorted(log["time_s"], 900.0)] for name, values in log.items()}
    found = averaged(short)
    partial = found.revolutions == 0
    assert partial.any()
    expected = K * 0.5 * (found.rate_dps + 15.041067 / 3600.0 * np.sin(np.radians(34.2)))
    error = (found.indication[:, 0] - expected) / found.standard_uncertainty[:, 0]
    assert np.abs(error).max() < 4.0
    assert any("fitted and taken out" in flag for flag in found.flags)


def test_plateaus_at_rest_without_an_angle_are_left_out():
    """At rest the share of the earth's horizontal rate is unknown: kept and corrected with the
    angle, else left out.
    """
    log = table_log((5.0, 20.0, -5.0, -20.0))
    still = {name: np.concatenate([np.repeat(v[:1], 40), v]) for name, v in log.items()}
    still["time_s"] = np.arange(still["time_s"].size) * 0.5
    still["gyro_x_lsb"] = still["gyro_x_lsb"] + np.random.default_rng(0).normal(
        0.0, 1.0, still["time_s"].size
    )
    assert np.abs(averaged(still).rate_dps).min() < 1e-3
    without = averaged(still, angle=False)
    assert np.abs(without.rate_dps).min() > 1.0
    assert any("at rest left out" in flag for flag in without.flags)


def test_the_stated_noise_of_the_means_covers_their_errors():
    """Over 880 plateaus of white noise 93 to 97 % of the errors are within 1.96 standard
    uncertainties.
    """
    errors = []
    rates = simulate.both_ways()
    for seed in range(40):
        found = averaged(
            table_log(rates, seed=seed, interval_s=1.0, shortest_hold_s=20.0, unevenness=0.0)
        )
        expected = K * (found.rate_dps + 15.041067 / 3600.0 * np.sin(np.radians(34.2)))
        errors.append((found.indication[:, 0] - expected) / found.standard_uncertainty[:, 0])
    assert 0.93 < np.mean(np.abs(np.concatenate(errors)) < 1.96) < 0.97


def test_each_gyro_of_a_log_has_the_noise_of_its_own_column():
    """A column of twice the noise has twice the uncertainty, of whatever scale factor."""
    time, rate = staircase([10.0, 20.0, -10.0], held=600)
    noise = np.random.default_rng(0).normal(0.0, 3.0, rate.size)
    columns = np.column_stack((K * rate + noise, 2.0 * K * rate + 2.0 * noise))
    u = means(time, rate, columns).standard_uncertainty
    assert u[:, 1] == pytest.approx(2.0 * u[:, 0], rel=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"table_rate_dps": np.linspace(0.0, 500.0, 100)}, "no held rate"),
        ({"table_rate_dps": np.zeros(100)}, "never turns"),
    ],
)
def test_what_cannot_be_averaged_is_refused(change, words):
    """Each fault is a FitError that says what is wrong."""
    log = {
        "time_s": np.arange(100) * 0.5,
        "table_rate_dps": np.full(100, 10.0),
        "gyro_x_lsb": np.full(100, 1e5),
    }
    log["table_angle_deg"] = None
    log |= change
    with pytest.raises(FitError, match=words):
        means(
            log["time_s"],
            log["table_rate_dps"],
            log["gyro_x_lsb"],
            angle=log["table_angle_deg"],
        )
