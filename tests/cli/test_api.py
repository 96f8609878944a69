"""The public interface: twenty names that do what the commands do, loaded when they are asked
for.
"""

import contextlib
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import calibkit
from calibkit.instruments.inclinometer import instrument
from conftest import ROOT
from sample_runs import sample_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the run of a fit of the sample triad through the public interface."""
    fitted = sample_run(tmp_path_factory, "gyro_triad", ("site.latitude_deg=34.2",))
    return calibkit.find_run("S-1", fitted.folder.parents[1])


def test_every_public_name_is_there_with_a_docstring():
    """Twenty names, each documented, and dir() lists them."""
    assert len(calibkit.__all__) == 20
    assert set(calibkit.__all__) < set(dir(calibkit))
    for name in calibkit.__all__:
        assert getattr(calibkit, name).__doc__, name


def test_importing_the_package_imports_no_numpy():
    """The public names cost nothing until they are used."""
    code = "import calibkit, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_log_is_read_in_canonical_columns():
    """Every column that the recipe knows, as numbers."""
    frame = calibkit.read_log("gyro_pair", ROOT / "datasets" / "gyro_pair" / "table_axis_a.csv")
    assert {"time_s", "table_rate_dps", "gyro_a_lsb", "gyro_b_lsb"} <= set(frame.columns)
    assert len(frame) > 100


def test_rows_carry_the_number_of_their_held_condition():
    """The segments are those that check lists, by time; rows between held rates have none, and a
    record at rest has no column.
    """
    folder = ROOT / "datasets" / "gyro_pair"
    frame = calibkit.read_log("gyro_pair", folder / "table_axis_a.csv")
    held = next(
        r for r in calibkit.examine("gyro_pair", folder) if r.file == "table_axis_a.csv"
    ).held
    spans = [
        (part["time_s"].iloc[0], part["time_s"].iloc[-1], len(part))
        for _, part in frame.groupby("segment")
    ]
    assert spans == [(part.first, part.last, part.rows) for part in held]
    assert sorted(frame["segment"].dropna().unique()) == [k + 1.0 for k in range(len(held))]
    assert 0 < frame["segment"].isna().sum() < len(frame) / 2
    assert (
        "segment"
        not in calibkit.read_log(
            "gyro_noise", ROOT / "datasets" / "gyro_noise" / "static.csv"
        ).columns
    )


def test_the_numeric_core_s_functions_are_the_core_s(tmp_path):
    """Simulated logs carry their truth; denoising keeps the length; a missing file is a
    CalibkitError.
    """
    campaign = calibkit.simulated("gyro_pair", 1)
    assert campaign.truth["procedure"] == "gyro_pair"
    noisy = np.sin(np.arange(4000) / 500.0) + np.random.default_rng(0).normal(0.0, 0.3, 4000)
    assert np.std(calibkit.denoise(noisy).signal - np.sin(np.arange(4000) / 500.0)) < 0.06
    assert calibkit.allan_deviation(noisy, 1.0).deviation.size > 5
    with pytest.raises(calibkit.CalibkitError, match="cannot be read"):
        calibkit.load_coefficients(tmp_path / "none.json")


def pool_sizes():
    """Threads of each library of linear algebra."""
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.parametrize("succeeds", [True, False])
def test_linear_algebra_runs_on_one_thread_during_a_call(succeeds, monkeypatch):
    """Two threads that a program has set are one during a fit, also of fits side by side, and two
    after it, also where it fails.
    """
    during, both = [], threading.Barrier(2, timeout=60.0)
    read = instrument.copies.refuse_copies

    def watched(logs):
        both.wait()
        during.extend(pool_sizes())
        if not succeeds:
            raise calibkit.CalibkitError("no fit", hint="none")
        return read(logs)

    def fit():
        with contextlib.nullcontext() if succeeds else pytest.raises(calibkit.CalibkitError):
            calibkit.fit("inclinometer", ROOT / "datasets" / "inclinometer", runs=None)

    monkeypatch.setattr(instrument.copies, "refuse_copies", watched)
    with threadpool_limits(limits=2, user_api="blas"), ThreadPoolExecutor(2) as threads:
        before = pool_sizes()
        list(threads.map(lambda _: fit(), range(2)))
        assert pool_sizes() == before
    assert set(before) == {2}
    assert set(during) == {1}
