"""A log that was compensated before is told: in check, in a fit, and when it is to be compensated
again.
"""

import csv

import numpy as np
import pytest

from calibkit.check import magnitude
from sample_runs import sample_run


def test_a_drift_that_is_not_there_is_flagged_and_one_that_is_or_is_too_small_is_not():
    """Gain near 1 says nothing, gain near 0 or -1 is flagged, noise above the drift is no
    evidence.
    """
    rng = np.random.default_rng(1)
    predicted = np.linspace(-1.0, 1.0, 5000) ** 2
    noise = rng.normal(0.0, 0.5, 5000)
    assert magnitude.flag_missing_drift("a", predicted, 0.9 * predicted + noise) == []
    for gain, said in ((0.0, "compensated before"), (-1.0, "its sign is the other")):
        (flag,) = magnitude.flag_missing_drift("a", predicted, gain * predicted + noise)
        assert said in flag
    assert magnitude.flag_missing_drift("a", 0.001 * predicted, noise) == []
    assert magnitude.flag_missing_drift("a", np.ones(5000), noise) == []


def test_a_compensated_log_among_raw_ones_is_found_and_not_compensated_in_silence(
    campaign, tmp_path, tmp_path_factory, calibkit
):
    """One ramp of a campaign replaced by its compensated self: check names it, apply to it flags
    it, raw logs pass.
    """
    run = sample_run(tmp_path_factory, "fog_thermal")
    assert not any("compensated before" in flag for flag in run.document["flags"])
    logs = tmp_path / "logs"
    logs.mkdir()
    for path in campaign.glob("ramp_*.csv"):
        (logs / path.name).write_bytes(path.read_bytes())
    target = logs / "ramp_heating_05.csv"
    raw = tmp_path / "raw.csv"
    target.rename(raw)
    done = calibkit("apply", run.folder, "--data", raw, "--out", target)
    assert "compensated before" not in done.err
    said = calibkit("check", "fog_thermal", "--data", logs, "--json").json
    named = {
        log["log"]
        for log in said["logs"]
        for finding in log["findings"]
        if finding["name"] == "double_compensation"
    }
    assert named == {target.name}
    again = calibkit("apply", run.folder, data=target, out=tmp_path / "twice.csv")
    assert "compensated before" in again.err


@pytest.mark.parametrize(
    "name", ["gyro compensated (deg/h)", "陀螺补偿后(°/h)", "corrected rate", "Rate_comp"]
)
def test_a_column_that_says_it_was_corrected_is_told(name, campaign, tmp_path, calibkit):
    """A mapping to a column whose name says compensated or corrected is flagged."""
    with (campaign / "ramp_heating_05.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    rows[0][3] = name
    text = "\n".join(",".join(row) for row in rows) + "\n"
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    settings = (f"columns.gyro_dph={{from='{name}'}}", "drift.model=gradient_rate", "drift.order=0")
    said = calibkit(
        "check", "fog_thermal", *(f"--set={setting}" for setting in settings), data=tmp_path
    )
    assert said.code == 0
    assert "must not be compensated twice" in said.out
