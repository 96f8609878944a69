"""An equation that is changed in one place changes all that calibkit says: shown by an instrument
that states it once.
"""

import json
import sys

import numpy as np
import pytest

from calibkit import api, instruments
from fits import turned_sensor

RECIPE = """procedure = "turned_sensor"

[logs]
files = ["turns*.csv"]
"""
EQUIPMENT = """
[device.turned_sensor]
lags_s = [600.0]
fastest_degc_per_min = 5.0
noise = 0.002
noise_unit = "deg"
component = [{group = "stop", effect = "index", value = 0.005, unit = "deg", dof = 10}]
"""


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    """The instrument stands among those of calibkit."""
    monkeypatch.setitem(sys.modules, "calibkit.instruments.turned_sensor", turned_sensor)
    monkeypatch.setitem(instruments.SHIPPED, "turned_sensor", "turned_sensor")
    monkeypatch.setattr(instruments, "REGISTRY", instruments.Registry())


def turns(seed):
    """Log of a sensor whose error is a sine of the angle, on a table with errors of its stops."""
    rng = np.random.default_rng(seed)
    index = rng.normal(0.0, 0.005, 12)
    stop = np.array([(k, m) for k in range(12) for m in range(12) if k != m])
    angle = 30.0 * (stop[:, 1] - stop[:, 0]) + index[stop[:, 1]] - index[stop[:, 0]]
    sensor = (angle - 0.1) / 1.002 + rng.normal(0.0, 0.002, angle.size)
    rows = np.column_stack([30.0 * stop, sensor]).tolist()
    lines = [f"{a:.1f},{b:.1f},{c:.5f}" for a, b, c in rows]
    return "\n".join(["from_stop_deg,to_stop_deg,sensor_deg", *lines]) + "\n"


def use(folder, calibkit):
    """What is said of one campaign by everything that is made of it."""

    def run(*arguments):
        outcome = calibkit(*map(str, arguments))
        assert outcome.code in {0, 1}, outcome.err
        return outcome.out

    for name, seed in (("lab", 1), ("later", 2)):
        (folder / name).mkdir(parents=True)
        (folder / name / "turns.csv").write_text(turns(seed), encoding="utf-8")
    recipe, bench = folder / "recipe.toml", folder / "bench.toml"
    recipe.write_text(RECIPE, encoding="utf-8")
    bench.write_text(run("plan", "--print-equipment") + EQUIPMENT, encoding="utf-8")
    named, made = ("T-1", "--runs", folder / "runs"), ("--date", "2026-11-26", "--out")
    data, serial = ("--data", folder / "lab"), ("--serial", "T-1")
    run("fit", recipe, *data, *serial, *made, folder / "runs")
    (said,) = json.loads(run("evaluate", *named, "sensor=200", "--json"))["values"]
    later, unseen = folder / "later", folder / "validation.json"
    run("validate", *named, "--data", later, "--out", unseen)
    pdf = folder / "certificate.pdf"
    issued = api.certify(folder / "runs/T-1/r001", pdf, date="2026-11-26")
    run("plan", recipe, "--equipment", bench, "--out", folder / "plan")
    run("export", *named, "--target", "c", "--out", folder / "c")
    run("apply", *named, "--data", later / "turns.csv", "--out", folder / "corrected.csv")
    record = json.loads((folder / "runs/T-1/r001/turned_sensor.json").read_text(encoding="utf-8"))
    plan = json.loads((folder / "plan" / "plan.json").read_text(encoding="utf-8"))
    judged = json.loads(unseen.read_text(encoding="utf-8"))
    corrected = np.genfromtxt(folder / "corrected.csv", delimiter=",", names=True)
    return {
        "coefficients": [c["value"] for c in record["models"][0]["coefficients"]],
        "index error": record["models"][0]["components"][0]["value"],
        "value": said["value"],
        "U": said["expanded_uncertainty"],
        "unseen": judged["rms_error_over_uncertainty"],
        "limit": judged["largest_rms_error_over_uncertainty"],
        "certificate": [(r.quantity, r.value, r.uncertainty) for r in issued.certificate.results],
        "plan": plan["results"][0]["expanded_uncertainty"],
        "applied": corrected["sensor_deg"].tolist(),
    }


def test_it_is_fitted_planned_validated_certified_and_exported(tmp_path, calibkit):
    """The line and the size of the errors of the stops come out of turns between them."""
    says = use(tmp_path, calibkit)
    assert says["coefficients"] == pytest.approx([0.1, 1.002], abs=0.005)
    assert says["index error"] == pytest.approx(0.005, rel=0.6)
    assert says["value"] == pytest.approx(0.1 + 1.002 * 200.0, abs=says["U"])
    assert says["unseen"] < says["limit"]
    assert says["plan"] < 0.02
    assert "turned_sensor.sensor.angle" in {quantity for quantity, *_ in says["certificate"]}
    assert (tmp_path / "c").is_dir()


def test_an_equation_that_is_changed_in_one_place_changes_all_that_is_said(
    tmp_path, calibkit, monkeypatch
):
    """With a bent scale in `corrected` alone: coefficients, value, U, unseen test, certificate,
    corrected log and plan are others.
    """
    before = use(tmp_path / "line", calibkit)
    bent = lambda p, indication: p[0] + p[1] * indication * (1.0 + 1e-4 * indication)  # noqa: E731
    monkeypatch.setattr(turned_sensor, "corrected", bent)
    after = use(tmp_path / "bent", calibkit)
    assert [key for key in before if before[key] == after[key]] == []
    assert after["U"] > 10.0 * before["U"]
