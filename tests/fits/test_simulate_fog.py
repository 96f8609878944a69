"""The simulated gyro, chamber and files: heat balances, Shupe effect, hysteresis, logs that a
laboratory could have.
"""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from calibkit.instruments.bias import simulate_fog as fog
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import (
    Chamber,
    Programme,
    _controlled,
)

CALM = Chamber(cycling_degc=0.0, turbulence_degc=0.0, reading_noise_degc=0.0)
NOISELESS = {"N": 0.0, "B": 0.0, "K": 0.0, "resolution_dph": 1e-6}


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


def still(degc):
    """Return a gyro that went through temperatures so slowly that it was always in equilibrium."""
    rest = np.zeros(len(degc))
    return fog.Heat(degc, degc, degc, rest, rest)


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


def test_a_step_of_the_air_is_answered_as_the_matrix_exponential_says():
    """With constant conductances the integration agrees with the exact solution of the three heat
    balances.
    """
    device = linear(fog.FogGyro.draw(2))
    matrix = np.column_stack([fog._flows(device, 0.0, unit) for unit in np.eye(3)])
    heat = device.heat_flow(np.full(2001, 10.0), 0.0)
    for second in (0, 1, 37, 600, 2000):
        exact = 10.0 - expm(matrix * second) @ np.full(3, 10.0)
        nodes = (heat.case[second], heat.outer[second], heat.inner[second])
        assert nodes == pytest.approx(exact, abs=1e-4)  # °C


def test_the_heat_that_flows_in_is_the_heat_that_is_stored():
    """With every nonlinearity the stored heat is the time integral of what comes from the air and
    the electronics.
    """
    device = fog.FogGyro.draw(3)
    _, set_degc = Programme.ramp(
        -40.0, 60.0, 10.0, soak_before_s=100.0, soak_after_s=900.0
    ).set_points()
    air_degc = _controlled(CALM, set_degc)
    heat = device.heat_flow(air_degc, -40.0)
    difference = air_degc - heat.case
    inflow = (
        difference * (1.0 + device.convection_per_degc * np.abs(difference))
        + device.self_heating_degc
    ) / device.tau_case_s
    coil, inside = device.coil_share, device.coil_share * device.inner_share
    stored = (1.0 - coil) * heat.case + (coil - inside) * heat.outer + inside * heat.inner
    assert stored[-1] - stored[0] == pytest.approx(
        np.trapezoid(inflow), abs=2e-3
    )  # °C of the whole, of 99


def test_a_gyro_at_rest_is_warmer_than_the_air_by_its_own_heat_and_stays_so():
    """In still air nothing moves, and the heat given off is the heat made."""
    device = fog.FogGyro.draw(5)
    heat = device.heat_flow(np.full(3600, -40.0), -40.0)
    above = heat.case[0] + 40.0
    assert 0.4 < above < device.self_heating_degc
    assert above * (1.0 + device.convection_per_degc * above) == pytest.approx(
        device.self_heating_degc, rel=1e-12
    )
    for degc in (heat.case, heat.outer, heat.inner):
        assert np.ptp(degc) < 1e-9  # °C


# bias


def test_drift_is_zero_in_equilibrium_at_the_reference_temperature():
    """A coil that rests at 25 °C has no drift."""
    assert fog.FogGyro.draw(6).drift(still(np.full(3, 25.0))) == pytest.approx(
        [0.0, 0.0, 0.0], abs=1e-15
    )


def test_without_hysteresis_drift_is_a_function_of_the_thermal_state():
    """The same temperatures and rates give the same drift, whatever came before."""
    device = fog.FogGyro.draw(7).scale_drift(hysteresis_scale=0.0)
    there = np.linspace(-40.0, 60.0, 201)
    path = np.concatenate((there, there[::-1]))
    heat = fog.Heat(path, path + 1.0, path - 2.0, np.full(402, 0.02), np.full(402, 0.01))
    drift = device.drift(heat)
    assert drift[:201] == pytest.approx(drift[:200:-1], abs=1e-15)


def test_with_hysteresis_cooling_is_above_heating_by_its_width():
    """On a loop over the whole range the branches are apart by hysteresis_dph in the middle and
    meet at the end.
    """
    device = replace(fog.FogGyro.draw(7), hysteresis_dph=0.04)
    there = np.linspace(-40.0, 60.0, 201)
    drift = device.drift(still(np.concatenate((there, there[::-1]))))
    apart = drift[:200:-1] - drift[:201]
    assert apart[100] == pytest.approx(0.04, abs=1e-12)  # °/h, at 10 °C
    assert apart[200] == pytest.approx(0.0, abs=1e-12)  # °/h, at 60 °C


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


def test_the_shupe_effect_of_the_gradient_shows_where_a_ramp_begins():
    """The gradient term alone swings while the gradient builds up, and integrates to it."""
    device = replace(
        linear(fog.FogGyro.draw(9)).scale_drift(hysteresis_scale=0.0),
        static_dph=(0.0,),
        shupe_per_degc=0.0,
        shupe_rate=0.0,
        shupe_gradient_rate=0.1,
    )
    heat = device.heat_flow(5.0 / 60.0 * np.arange(20_000), 0.0)
    drift = device.drift(heat)
    assert drift[-1] == pytest.approx(0.0, abs=1e-9)  # °/h
    assert np.trapezoid(drift) / 60.0 == pytest.approx(
        0.1 * (heat.outer[-1] - heat.inner[-1]), abs=1e-5
    )


def test_the_indication_is_rotation_bias_and_drift_when_noise_is_taken_away():
    """Without noise the log holds the earth's rate, the bias, that of this turn-on and the drift to
    a pulse.
    """
    device = replace(fog.FogGyro.draw(12), **NOISELESS)
    runs = {"ramp.csv": fog.programmes()["ramp_cooling_10.csv"]}
    logged = fog.logs(device, runs, 0, CALM)["ramp.csv"]
    assert abs(logged.turn_on_dph) > 0.001
    expected = device.input_rate_dph + device.bias_dph + logged.turn_on_dph + logged.drift
    assert device.input_rate_dph == pytest.approx(15.041067 * np.sin(np.radians(34.2)))
    assert logged.columns["gyro_dph"] == pytest.approx(expected, abs=3e-6)  # °/h, two pulses


# chamber


def test_the_chamber_reaches_the_rate_it_is_set_to(campaign):
    """In the second half of every ramp the logged air climbs or falls at the set rate within 2
    %.
    """
    for name, columns in campaign.logs.items():
        truth = campaign.truth["logs"][name]
        _, start, end, _ = truth["set_time_s"]
        ramping = slice(int((start + end) / 2.0), int(end))
        slope = (
            np.polyfit(columns["time_s"][ramping], columns["temp_env_degc"][ramping], 1)[0] * 60.0
        )
        assert slope == pytest.approx(truth["set_rate_degc_per_min"], rel=0.02), name


# logs and files


def test_the_campaign_holds_eight_ramps_and_two_withheld_ones(campaign):
    """Heating and cooling at 1, 5, 8, 10 °C/min, and ±3 °C/min in a folder of their own."""
    rates = {name: campaign.truth["logs"][name]["set_rate_degc_per_min"] for name in campaign.logs}
    assert rates == {
        "ramp_cooling_01.csv": -1.0,
        "ramp_cooling_05.csv": -5.0,
        "ramp_cooling_08.csv": -8.0,
        "ramp_cooling_10.csv": -10.0,
        "ramp_heating_01.csv": 1.0,
        "ramp_heating_05.csv": 5.0,
        "ramp_heating_08.csv": 8.0,
        "ramp_heating_10.csv": 10.0,
        "withheld/ramp_cooling_03.csv": -3.0,
        "withheld/ramp_heating_03.csv": 3.0,
    }


def test_the_thermometers_read_in_steps_of_their_resolution(files):
    """The case is logged in steps of 0.0625 °C, the chamber in 0.1 °C, the gyro in pulses."""
    _, numbers = rows(files["ramp_heating_05.csv"])
    for column, resolution in ((1, 0.0625), (2, 0.1), (3, 0.01)):
        steps = numbers[:, column] / resolution
        assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(files):
    """Everything is drawn from the seed."""
    assert fog.campaign(11).files() == files
    other = fog.campaign(12).files()
    assert other.keys() == files.keys()
    assert all(other[name] != files[name] for name in files)


def test_another_log_changes_none_of_the_others(files):
    """A log draws from a stream of its own, so rates and steps can be added to a campaign."""
    more = fog.campaign(11, runs=fog.programmes(withheld=(3.0, 6.0), steps=True)).files()
    assert set(more) - set(files) == {
        "withheld/ramp_heating_06.csv",
        "withheld/ramp_cooling_06.csv",
        "steps_heating.csv",
        "steps_cooling.csv",
    }
    assert all(more[name] == files[name] for name in files if name != "truth.json")


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


def test_the_true_drift_is_the_static_one_in_the_first_soak(campaign):
    """Before a ramp, at rest, drift is the static polynomial and the hysteresis of having come from
    25 °C.
    """
    device = replace(fog.FogGyro.draw(11), hysteresis_dph=0.0)
    log = campaign.truth["logs"]["ramp_heating_05.csv"]
    coil = log["coil_inner_degc"][5]
    static = sum(
        factor * (coil - 25.0) ** power for power, factor in enumerate(device.static_dph, start=1)
    )
    assert log["drift_dph"][5] == pytest.approx(
        static + fog.FogGyro.draw(11).hysteresis_dph / 2.0, abs=0.01
    )  # °/h


# the record that every simulation returns


def test_a_campaign_writes_no_negative_zero_and_leaves_a_gap_empty():
    """−0.0004 to three digits is 0.000, a NaN is an empty field, integers have no point."""
    columns = {
        "time_s": np.arange(3),
        "x": np.array([-0.0004, np.nan, -1.2345]),
        "y": np.array([0.25, -0.0, 1e6]),
    }
    made = Campaign({"a/b.csv": columns}, {"x": 3, "y": 1}, {"note": "°", "b": [1]}).files()
    assert made["a/b.csv"] == b"time_s,x,y\n0,0.000,0.2\n1,,0.0\n2,-1.234,1000000.0\n"
    assert made["truth.json"] == '{\n "b": [\n  1\n ],\n "note": "°"\n}\n'.encode()


@pytest.mark.parametrize(
    ("columns", "truth", "says"),
    [
        ({"x": np.zeros(2), "y": np.zeros(3)}, {}, "length"),
        ({"x": np.array([np.inf])}, {}, "x holds an infinite"),
        ({"x": np.zeros(2)}, {"k": float("nan")}, "JSON"),
    ],
)
def test_a_campaign_refuses_what_a_log_cannot_hold(columns, truth, says):
    """Columns of unequal length, infinities and a truth that is not JSON are errors."""
    with pytest.raises(ValueError, match=says):
        Campaign({"a.csv": columns}, {"x": 1, "y": 1}, truth).files()
