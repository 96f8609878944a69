"""The simulated gyro, chamber and files: heat balances, Shupe effect, hysteresis, logs that a
laboratory could have.
"""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from calibkit.instruments.bias import simulate_fog as fog


@pytest.fixture(scope="module")
def campaign():
    """One campaign as shipped."""
    return fog.campaign(11)


@pytest.fixture(scope="module")
def files(campaign):
    """Return its files."""
    return campaign.files()


def linear(device):
    """Return the gyro with conductances that depend on nothing, and no heat of its own."""
    return replace(device, convection_per_degc=0.0, conduction_per_degc=0.0, self_heating_degc=0.0)


def rows(text):
    """Return header and numbers of a CSV."""
    header, *lines = csv.reader(io.StringIO(text.decode()))
    return header, np.array(lines, dtype=float)


# heat


@pytest.mark.parametrize("rate", [1.0, -5.0])
def test_on_a_steady_ramp_each_difference_is_rate_times_time_constant(rate):
    """Long after the start of an endless ramp case, outer and inner layers are behind by r τ
    each.
    """
    device = linear(fog.FogGyro.draw(1))
    air_degc = 20.0 + rate / 60.0 * np.arange(40_000)
    heat = device.heat_flow(air_degc, 20.0)
    per_s = rate / 60.0
    assert air_degc[-1] - heat.case[-1] == pytest.approx(per_s * device.tau_case_s, abs=1e-6)  # °C
    assert heat.case[-1] - heat.outer[-1] == pytest.approx(
        per_s * device.tau_outer_s, abs=1e-6
    )  # °C
    assert heat.outer[-1] - heat.inner[-1] == pytest.approx(
        per_s * device.tau_inner_s, abs=1e-6
    )  # °C


# bias


@pytest.mark.parametrize("rate", [3.0, -3.0])
def test_the_shupe_effect_of_a_steady_ramp_is_its_coefficient_times_the_rate(rate):
    """Without static drift and hysteresis, a steady ramp shows the rate term alone, the gradient
    being steady.
    """
    device = replace(
        linear(fog.FogGyro.draw(9)).scale_drift(hysteresis_scale=0.0),
        static_dph=(0.0,),
        shupe_per_degc=0.0,
        shupe_rate=0.07,
    )
    drift = device.drift(device.heat_flow(rate / 60.0 * np.arange(20_000), 0.0))
    assert drift[-1] == pytest.approx(0.07 * rate, abs=1e-9)  # °/h


# chamber


# logs and files


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(files):
    """Everything is drawn from the seed."""
    assert fog.campaign(11).files() == files
    other = fog.campaign(12).files()
    assert other.keys() == files.keys()
    assert all(other[name] != files[name] for name in files)


def test_the_truth_says_what_the_logs_were_made_from(files):
    """truth.json holds the gyro and, every minute of each log, temperatures and drift that follow
    from it.
    """
    truth = json.loads(files["truth.json"])
    fields = truth["gyro"]
    device = fog.FogGyro(
        **{key: tuple(value) if isinstance(value, list) else value for key, value in fields.items()}
    )
    assert device == fog.FogGyro.draw(11)
    for name, log in truth["logs"].items():
        _, numbers = rows(files[name])
        assert log["time_s"] == numbers[::60, 0].tolist()
        assert {
            len(log[key]) for key in ("air_degc", "case_degc", "coil_inner_degc", "drift_dph")
        } == {len(log["time_s"])}
        assert log["case_degc"] == pytest.approx(
            numbers[::60, 1], abs=0.12
        )  # °C: resolution and four sigma
        expected = (
            device.input_rate_dph + device.bias_dph + log["turn_on_dph"] + np.mean(log["drift_dph"])
        )
        assert np.mean(numbers[:, 3]) == pytest.approx(expected, abs=0.06)  # °/h


# the record that every simulation returns
