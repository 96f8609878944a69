"""Errors that observations share, pooled from earlier runs of one type of device."""

import numpy as np
import pytest

from calibkit.numeric import attitude
from calibkit.records import store

SPOTS = [(0, 0), *((i, j) for i in (45, 90, 135) for j in range(0, 360, 90)), (180, 0)]


@pytest.fixture
def fitted(tmp_path, calibkit, log_writer):
    """Fit of a triad whose zeros differ by 15 µg from soak to soak: outcome and run."""

    def fit(serial, seed, *settings):
        rng = np.random.default_rng(seed)
        soak = np.repeat(np.arange(6), len(SPOTS))
        angle = np.tile(np.array(SPOTS, dtype=float), (6, 1))
        shown = 1.002 * attitude.gravity_vector(*angle.T) + 3e-3
        shown += 15e-6 * rng.normal(size=(6, 3))[soak] + 20e-6 * rng.normal(size=shown.shape)
        columns = dict(zip(("accel_x_g", "accel_y_g", "accel_z_g"), shown.T, strict=True))
        columns |= {"inclination_deg": angle[:, 0], "toolface_deg": angle[:, 1]}
        columns |= {"temp_case_degc": 20.0 * soak}
        log_writer(tmp_path / serial / "positions.csv", **columns)
        settings = ("affine.enabled=false", "compensation=k", *settings)
        outcome = calibkit(
            *("fit", "accelerometer", "--data", tmp_path / serial, "--serial", serial),
            *("--out", tmp_path / "runs"),
            *(word for one in settings for word in ("--set", one)),
        )
        run = store.load(store.find(serial, tmp_path / "runs")) if outcome.code in (0, 1) else None
        return outcome, run

    return fit


def test_components_of_other_devices_of_the_type_narrow_the_intervals(fitted):
    """Three runs of type QA are pooled, one of type QB, one of the same logs, and a run that was
    pooled are not; run.json lists them with digests.
    """
    earlier = [fitted(f"QA-{k}", k, "type=QA")[1] for k in range(3)]
    fitted("QB-1", 8, "type=QB")
    _, alone = fitted("N", 9, "type=QA")
    outcome, run = fitted("N", 9, "type=QA", "errors.from=history")
    assert outcome.code in (0, 1), outcome.err
    assert [entry["serial"] for entry in run.document["pooled"]] == ["QA-0", "QA-1", "QA-2"]
    digests = [entry["sha256"] for entry in run.document["pooled"]]
    assert digests == [one.document["sha256"] for one in earlier]
    assert "pooled from 3 runs of type 'QA'" in " ".join(run.document["flags"])
    zero, own = (
        each.records["accel_k.json"].models[0].coefficients[4].effective_dof
        for each in (run, alone)
    )
    assert zero > 1.5 * own
    _, last = fitted("M", 10, "type=QA", "errors.from=history")
    counted = [(entry["serial"], entry["revision"]) for entry in last.document["pooled"]]
    assert counted == [("N", 1), ("QA-0", 1), ("QA-1", 1), ("QA-2", 1)]


def test_history_needs_a_type(fitted):
    """Exit 2, and what is missing."""
    outcome, _ = fitted("A", 1, "errors.from=history")
    assert outcome.code == 2
    assert "needs type" in outcome.err


def test_an_earlier_calibration_of_the_device_itself_counts_where_its_logs_are_others(fitted):
    """A device that was calibrated twice, and its second calibration fitted again."""
    _, first = fitted("N", 1, "type=QA")
    fitted("N", 2, "type=QA")
    _, again = fitted("N", 2, "type=QA", "errors.from=history")
    assert [(one["serial"], one["revision"]) for one in again.document["pooled"]] == [("N", 1)]
    assert again.document["pooled"][0]["sha256"] == first.document["sha256"]
