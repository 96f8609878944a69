"""Errors that observations share, pooled from earlier runs of one type of device."""

import numpy as np
import pytest
from scipy.special import stdtrit

from calibkit.fit.shared import Shared
from calibkit.fit.solve import solve
from calibkit.history import pooling
from calibkit.numeric import attitude
from calibkit.records import store
from calibkit.records.coefficients import Component

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


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.0, 0.5, 1.0, 3.0])
def test_intervals_by_pooled_components_cover_and_are_narrow(size):
    """100 campaigns of seven soaks and a cubic, zeros that differ by this many dwell noises, three
    earlier campaigns: 92 to 98 %, and at most 1.15 times what known components give, within what
    100 campaigns of four coefficients tell.
    """
    soak = np.repeat(np.arange(7), 13)
    design = np.vander(np.linspace(-1.0, 1.0, 7), 4, increasing=True)[soak]
    rng, inside, width = np.random.default_rng(5), [], []
    whole = np.eye(soak.size) + size**2 * (soak[:, None] == soak)
    exact = 1.96 * np.sqrt(np.diag(np.linalg.inv(design.T @ np.linalg.solve(whole, design))))

    def campaign(**stated):
        shown = size * rng.normal(size=7)[soak] + rng.normal(size=soak.size)
        loading = np.ones((soak.size, 1))
        zero = Shared(group="soak", effect="zero", level=soak, loading=loading, unit="g", **stated)
        return solve(lambda p: shown - design @ p, np.zeros(4), [zero])

    for _ in range(100):
        earlier = [campaign().shared[0] for _ in range(3)]
        pooled = pooling._pool(
            [Component("soak", "zero", one.value, "g", one.u, one.error.levels) for one in earlier]
        )
        found = campaign(size=pooled.value, size_dof=pooled.dof)
        u = np.sqrt(np.diag(found.covariance))
        half = stdtrit(found.dof_along(np.eye(4)), 0.975) * u
        inside.append(np.abs(found.parameters) <= half)
        width.append(half / exact)
    assert 0.90 < np.mean(inside) < 0.99
    assert np.mean(width) < 1.18
