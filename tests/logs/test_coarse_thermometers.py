"""Gyros logged with thermometers of one degree, and chambers that climb in steps of one: ramps,
rates, and what is left.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from calibkit.instruments.bias import simulate_fog as simulator


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """Return a folder with a gyro on ramps and on stairs of 1 °C, both thermometers read in whole
    degrees.
    """
    folder = tmp_path_factory.mktemp("coarse")
    gyro = replace(simulator.FogGyro.draw(801), case_resolution_degc=1.0)
    runs = simulator.programmes((1.0, 5.0, 10.0), (3.0,), steps=True)
    made = simulator.campaign(801, gyro, runs)
    logs = {
        name: {**log, "temp_env_degc": np.round(log["temp_env_degc"])}
        for name, log in made.logs.items()
    }
    for name, content in simulator.Campaign(logs, made.decimals, made.truth).files().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def test_ramps_and_stairs_read_in_whole_degrees_are_fitted_and_generalise(
    coarse, calibkit, tmp_path
):
    """Rates within 5 % of the set ones (stairs: 0.5 °C/min), thermometers named, withheld ±3 °C/min
    a third of raw.
    """
    fit = calibkit("fit", "fog_thermal", "--data", coarse, "--serial", "C", "--out", tmp_path)
    assert fit.code == 0, fit.err
    drift = json.loads((tmp_path / "C/r001/drift.json").read_text(encoding="utf-8"))
    rates = {
        m["name"]: {p["name"]: p["value"] for p in m["parameters"]}["rate"] for m in drift["models"]
    }
    for name, rate in rates.items():
        size = 0.5 if name.startswith("steps") else float(name.rsplit("_", 1)[1])
        assert abs(rate) == pytest.approx(size, rel=0.05), name
    assert any("temp_env_degc is read in steps of 1 °C" in flag for flag in drift["flags"])
    assert any("temp_case_degc is read in steps of 1 °C" in flag for flag in drift["flags"])
    done = calibkit(
        "validate", "C", "--json", runs=tmp_path, data=coarse / "withheld", out=tmp_path / "v.json"
    )
    assert done.code == 0
    truth = json.loads((coarse / "truth.json").read_text(encoding="utf-8"))["logs"]
    for log in done.json["logs"]:
        assert log["drift_rms_after"] < log["drift_rms_before"] / 3.0
        assert log["uncertainty"]["share_within_expanded_uncertainty"] > 0.85
        assert truth[f"withheld/{log['name']}"]["set_rate_degc_per_min"] in (-3.0, 3.0)
