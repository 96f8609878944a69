"""Real logs under check: what is said of them is right, and healthy ones give no false alarm."""

import numpy as np
import pytest

from calibkit import recipe
from calibkit.commands import inspection
from conftest import REAL

pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="the real measurements are not beside this checkout"
)

XSENS = """
procedure = "accelerometer"
loss = "robust"
[logs]
files = ["xsens_acc.mat"]
format = "text"
names = ["t", "x", "y", "z"]
[reference]
kind = "magnitude"
[dwells]
mode = "series"
[affine]
enabled = false
[columns]
time_s = { from = "t" }
accel_x_g = { from = "x", offset = -33123.0, scale = %s }
accel_y_g = { from = "y", offset = -33276.0, scale = %s }
accel_z_g = { from = "z", offset = -32360.0, scale = %s }
"""


def check(text, folder):
    """Return the reports of a recipe's text."""
    return inspection.check(recipe.Source("r.toml", text), REAL / folder).logs


def test_the_warm_up_log_has_its_gaps_and_nothing_else():
    """Irregular 17 ms sampling with 378 steps above 2.5 of them, counted independently, is all that
    is flagged.
    """
    (report,) = inspection.check(recipe.find("mpu6050_warmup"), REAL / "mpu6050_warmup").logs
    time = np.loadtxt(REAL / "mpu6050_warmup" / "Tempdata01-02-14.csv", delimiter=",", skiprows=1)
    names = (
        (REAL / "mpu6050_warmup" / "Tempdata01-02-14.csv")
        .read_text(encoding="utf-8")
        .split("\n")[0]
        .split(",")
    )
    step = np.diff(time[:, [name.strip() for name in names].index("Time")])
    assert int(np.sum(step > 2.5 * np.median(step))) == report.facts.gaps == 378
    assert [finding.name for finding in report.findings] == ["gap"]


def test_a_hand_held_tumble_is_healthy_and_its_dwells_are_one_g():
    """51,175 rows at 100 Hz without a finding; every hold has 1 g within 1.5 % by the factory's
    scale and offsets alone.
    """
    scale = [repr(1.0 / (k * 9.81744)) for k in (415.0, 413.0, 415.0)]
    # canonical = scale · value + offset: the offset is in g
    text = XSENS % tuple(scale)
    for k, offset in zip(scale, (33123.0, 33276.0, 32360.0), strict=True):
        text = text.replace(f"offset = -{offset}", f"offset = {-offset * float(k)!r}")
    (report,) = check(text, "xsens_tumble")
    assert report.findings == ()
    assert report.facts.rows == 51_175
    assert report.facts.rate_hz == pytest.approx(100.0, rel=1e-3)
    levels = [held.level for held in report.held]
    assert len(levels) > 30
    assert np.abs(np.array(levels) - 1.0).max() < 0.015  # g
