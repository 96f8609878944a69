"""Thermal drift of a gyro from one log with several ramps, and from thermometers that the published
regression cannot use.
"""

import pytest

from calibkit.instruments.bias import simulate_fog as fog
from calibkit.records import store
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme

LEGS = ((60.0, 5.0), (-40.0, 8.0), (60.0, 10.0), (-40.0, 3.0), (20.0, 6.0))


def cycle(start_degc, legs, soak_s=1800.0):
    """A programme of ramps to temperatures at rates [°C/min], with soaks."""
    time, degc = [0.0, 600.0], [start_degc] * 2
    for end, rate in legs:
        time.append(time[-1] + abs(end - degc[-1]) / rate * 60.0)
        time.append(time[-1] + soak_s)
        degc += [end, end]
    return Programme(tuple(time), tuple(degc), 1.0)


@pytest.fixture(scope="module")
def columns():
    """Columns of one log with five ramps."""
    device = fog.FogGyro.draw(3)
    runs = {"cycle.csv": cycle(-40.0, LEGS)}
    return dict(fog.logs(device, runs, 3, Chamber())["cycle.csv"].columns)


@pytest.fixture
def fit(tmp_path, calibkit):
    """Fit one log by the shipped recipe and return the outcome and the run's coefficient files."""

    def run(columns, *more):
        (tmp_path / "logs").mkdir()
        decimals = fog.DECIMALS | {"temp_env_degc": 4}
        made = Campaign({"cycle.csv": columns}, decimals, {}).files()["cycle.csv"]
        (tmp_path / "logs" / "cycle.csv").write_bytes(made)
        data = ("--data", tmp_path / "logs", "--serial", "C", "--out", tmp_path / "runs")
        outcome = calibkit("fit", "fog_thermal", *data, *more)
        folder = tmp_path / "runs" / "C" / "r001"
        return outcome, store.load(folder).records if folder.exists() else {}

    return run


def test_ramps_of_one_log_share_one_turn_on_bias(columns, fit):
    """Five ramps in one log: five models in drift.json, a model on levels chosen by leaving each
    ramp out, one turn-on bias, a quarter of the drift left at most.
    """
    outcome, records = fit(columns)
    assert outcome.code == 0, outcome.err
    assert [model.name for model in records["drift.json"].models] == [
        f"cycle:{k}" for k in range(1, 6)
    ]
    figures = {one.name: one.value for one in records["drift_rate.json"].figures}
    turn_on = [name for name in figures if name.startswith("turn_on_bias.")]
    assert turn_on == ["turn_on_bias.cycle"]
    assert figures["drift_left_rms.cycle"] < 0.25 * figures["drift_rms_before.cycle"]


@pytest.mark.parametrize("apart", [0.0, 0.5])
def test_a_rank_deficient_published_regression_blocks_no_other_model(columns, fit, apart):
    """Air logged as the case, or as a constant below it: no a1 and a2, and a lagged model or a bank
    of the case temperature all the same; what was not tested is flagged.
    """
    same = columns | {"temp_env_degc": columns["temp_case_degc"] - apart}
    outcome, records = fit(same)
    assert outcome.code == 0, outcome.err
    assert "gradient_rate: not tested: cycle:1: the data cannot determine" in outcome.out
    assert records["drift.json"].models == ()
    (model,) = records["drift_rate.json"].models
    assert model.form in ("fog-drift-lagged/1", "fog-drift-bank/1")
    figures = {one.name: one.value for one in records["drift_rate.json"].figures}
    assert figures["drift_rms_after.cycle"] < 0.5 * figures["drift_rms_before.cycle"]
