"""What a message advises is the thing to do: signs, names of columns, sentinels, and what a JSON
document says of a refusal.
"""

import numpy as np
import pandas as pd
import pytest

from conftest import ROOT, write_log

TABLE = ROOT / "datasets" / "rate_table"


def table(path, change, count=6):
    """Write sample runs of the table, changed."""
    for log in sorted(TABLE.glob("*.csv"))[:count]:
        frame = pd.read_csv(log)
        (path / log.name).parent.mkdir(parents=True, exist_ok=True)
        change(frame).to_csv(path / log.name, index=False)
    return path


def test_overload_marks_among_the_counts_of_a_table_are_refused_by_row(tmp_path, calibkit):
    """±9e9 are counts that a counter could reach, but not beside a million: before, K was known to
    1800 % and nobody said why.
    """

    def spiked(frame):
        frame.loc[[500, 900], "gyro_x_lsb"] = 9e9, -9e9
        return frame

    data = table(tmp_path / "logs", spiked, count=1)
    outcome = calibkit("check", "rate_table", "--data", data)
    assert outcome.code == 3
    assert ":502: column 'gyro_x_lsb': 9e+09 1/s (2 such rows)" in outcome.out


def held(tmp_path, step_s, angle=lambda rate: rate):
    """A table run of ±20, ±60, ±100 °/s for two minutes each, a row every `step_s` seconds."""
    rates = np.array([0.0, 20.0, 60.0, 100.0, -20.0, -60.0, -100.0])
    rate = np.repeat(rates, round(120.0 / step_s))
    time = step_s * np.arange(1.0, rate.size + 1.0)
    turned = np.cumsum(angle(rate) * step_s)
    noise = np.random.default_rng(2).normal(0.0, 2.0, rate.size)
    columns = {
        "time_s": time,
        "table_rate_dps": rate,
        "table_angle_deg": np.remainder(turned, 360.0),
    }
    write_log(tmp_path / "run.csv", **columns, gyro_x_lsb=1e4 * rate + 30.0 + noise)
    return tmp_path


def test_a_table_rate_off_its_angle_is_said_in_ppm(tmp_path, calibkit):
    """An angle that turns 50 ppm faster than the logged rate is flagged, and one that agrees or is
    the reference itself is not.
    """
    folder = held(tmp_path / "a", 1.0, lambda rate: (1.0 + 50e-6) * rate)
    off = calibkit("check", "rate_table", "--data", folder)
    assert off.code == 0
    assert "it turns at a rate +50 ± " in off.out
    by_angle = ("--set", "table.reference=angle")
    assert "it turns at" not in calibkit("check", "rate_table", "--data", folder, *by_angle).out
    agrees = calibkit("check", "rate_table", "--data", held(tmp_path / "b", 1.0))
    assert "it turns at" not in agrees.out


@pytest.mark.parametrize("procedure", ["gyro_pair", "gyro_triad"])
def test_a_refused_log_is_an_error_in_the_json_of_check(procedure, tmp_path, calibkit):
    """Not ok, and error says code, message and hint, as for every other failure; the logs stand
    beside it.
    """
    for path in (ROOT / "datasets" / procedure).glob("*.csv"):
        frame = pd.read_csv(path)
        if path.name.startswith(("table_axis_b", "about_y")):
            frame.loc[10, "table_rate_dps"] = np.nan
        frame.to_csv(tmp_path / path.name, index=False)
    document = calibkit("check", procedure, "--data", tmp_path, "--json").json
    assert document["ok"] is False
    assert document["error"]["code"] == "frame"
    assert ":12: column 'table_rate_dps': 1 missing" in document["error"]["message"]
    assert document["error"]["hint"]
    assert len(document["logs"]) == len(list(tmp_path.glob("*.csv")))
    healthy = calibkit("check", procedure, "--data", ROOT / "datasets" / procedure, "--json").json
    assert healthy["ok"] is True
    assert "error" not in healthy
