"""A log on disk is fitted like one in memory: the same numbers, and nothing left behind."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import instruments, recipe
from calibkit.check import examination
from calibkit.commands import pipeline
from calibkit.instruments.bias import ramps
from calibkit.logs import log_files, write_back
from calibkit.numeric import anomalies
from calibkit.readers import scratch_files
from calibkit.records import store
from calibkit.records.frame import Log
from sample_runs import DATE, SERIAL, sample_logs, sample_run

FILE = "ramp_heating_05.csv"
RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write one simulated ramp."""
    made = tmp_path_factory.mktemp("logs")
    (made / FILE).write_bytes(pipeline.simulated("fog_thermal", 3).files()[FILE])
    return made


@pytest.fixture
def on_disk(monkeypatch):
    """Put every log on disk, and read, look at and work on it in small pieces."""
    in_pieces(monkeypatch)


def prepared(folder, overrides=()):
    """Read and prepare the log; returns both."""
    spec = instruments.parse_recipe(recipe.find("fog_thermal", overrides))
    log = log_files.read_log(spec, folder / FILE, FILE, ramps.COLUMNS)
    return log, ramps.prepare(log, spec, ramps.find_faults(log, spec))


def same(one, other, rtol=0.0):
    """Whether what later stages need of two logs is equal."""
    for name in ("raw", "denoised"):
        for field in ("time", "case", "gradient", "indication", "rate"):
            a, b = (getattr(getattr(part, name), field) for part in (one, other))
            # sums over a minute at 1 Hz are some 1e-9 °C/min off wherever spans begin
            np.testing.assert_allclose(
                a, b, rtol=rtol, atol=(1e-8 if field == "rate" else 1e-12) * bool(rtol)
            )
    np.testing.assert_allclose(one.thermal.indication, other.thermal.indication, rtol=rtol)
    assert [(r.start, r.stop) for r in one.ramps] == [(r.start, r.stop) for r in other.ramps]
    np.testing.assert_allclose(
        [r.rate for r in one.ramps], [r.rate for r in other.ramps], rtol=10.0 * rtol
    )
    assert one.source == other.source


def test_a_log_on_disk_comes_out_bit_for_bit_as_in_memory(folder, on_disk, is_mapped, monkeypatch):
    """Block means, denoised indication, ramps and digests are equal; the columns do lie in mapped
    files.
    """
    log, there = prepared(folder)
    assert is_mapped(log)
    monkeypatch.setenv(scratch_files.SETTING, "1000")
    whole, here = prepared(folder)
    assert not is_mapped(whole)
    same(there, here)
    assert there.noise == here.noise
    assert log.frame.equals(whole.frame)


def files_of(folder):
    """Content of each file of a run folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def in_pieces(monkeypatch):
    """Put every log on disk, and read, look at and work on it in small pieces."""
    monkeypatch.setenv(scratch_files.SETTING, "0")


FIELD = {
    "accelerometer_magnitude": "withheld/tumble.csv",
    "bias_temperature": "warm.csv",
    "fog_thermal": "withheld/ramp_heating_03.csv",
    "gyro_pair": "table_axis_a.csv",
    "gyro_triad": "withheld/about_x_40.csv",
    "inclinometer": "withheld/stations.csv",
    "rate_table": "at_0.csv",
    "thermal": "sweep.csv",
}
"""Recipe → a log that its run compensates."""


@pytest.mark.drawn
@pytest.mark.parametrize("name", sorted({*FIELD, "accelerometer", "gyro_noise"}))
def test_a_run_from_disk_is_that_of_logs_in_memory(
    name, calibkit, monkeypatch, tmp_path, tmp_path_factory
):
    """Every file of the run folder, and a compensated log with its flags, byte for byte."""
    settings = ("site.latitude_deg=34.2",) if name == "gyro_triad" else ()
    memory = sample_run(tmp_path_factory, name, settings)
    data = sample_logs(tmp_path_factory, name)
    written = []
    for place in ("memory", "disk"):
        out = tmp_path / f"{place}.csv"
        if name in FIELD:
            outcome = calibkit("apply", memory.folder, data=data / FIELD[name], out=out)
            assert outcome.code == 0, outcome.err
            written.append((out.read_bytes(), outcome.err))
        in_pieces(monkeypatch)
        monkeypatch.setattr(write_back, "ROWS", 50)
    assert written[:1] == written[1:]
    pipeline.fit(recipe.find(name, settings), data, SERIAL, tmp_path, DATE, instruments.silent)
    assert files_of(tmp_path / SERIAL / "r001") == files_of(memory.folder)


def test_check_tells_of_a_log_on_disk_what_it_tells_of_one_in_memory(folder, monkeypatch):
    """Facts, held conditions and findings are equal: it looks at the log that a fit would."""
    spec = instruments.parse_recipe(recipe.find("fog_thermal"))
    reports = []
    for megabytes in ("1000", "0"):
        monkeypatch.setenv(scratch_files.SETTING, megabytes)
        examined = examination.examine_log(instruments.find("fog_thermal"), spec, folder, FILE)
        reports.append(examined.report)
    assert reports[0] == reports[1]
    assert reports[0].held


@given(st.lists(st.integers(0, 2), min_size=1, max_size=120), st.integers(2, 14))
@settings(max_examples=150, deadline=None)
def test_equal_runs_are_those_of_a_loop(values, shortest):
    """Every run of at least so many equal values, and nothing else."""
    expected, start = [], 0
    for k in range(1, len(values) + 1):
        if k == len(values) or values[k] != values[start]:
            if k - start >= shortest:
                expected.append([start, k])
            start = k
    found = anomalies.equal_runs(np.array(values, dtype=float), shortest)
    assert found.tolist() == expected
    driver = np.array(values, dtype=float).cumsum()
    moved = [[a, b] for a, b in expected if np.ptp(driver[a : min(b, driver.size - 1)]) > 15.0]
    assert anomalies.stuck_against(driver, 15.0, found).tolist() == moved


@pytest.fixture
def long_log():
    """Return a log of 1,000,000 rows of a warmed gyro with its columns on disk."""
    time = np.arange(1_000_000) / 100.0
    case = 25.0 + 20.0 * np.sin(time / 2000.0) + RNG.normal(0.0, 0.01, time.size)
    made = {"time_s": time, "temp_case_degc": case, "temp_env_degc": case + 0.1}
    made["gyro_dph"] = 0.1 * case + RNG.normal(0.0, 1.0, time.size)
    columns = {}
    for name, column in made.items():
        columns[name] = scratch_files.allocate_column(column.size)
        columns[name][:] = column
    frame = pd.DataFrame(columns, copy=False)
    return Log("a", "a.csv", "", len(frame), frame)


def test_a_log_on_disk_is_validated_in_memory_for_some_columns(
    folder, long_log, calibkit, tmp_path
):
    """Compensation, its uncertainty and both Allan deviations take less than eight columns."""
    pinned = ("--set", "drift.model=gradient_rate", "--set", "drift.order=0")  # of one ramp
    options = ("--serial", "S", "--date", "2026-01-01", "--out", tmp_path)
    assert calibkit("fit", "fog_thermal", "--data", folder, *options, *pinned).code in (0, 1)
    run = store.load(tmp_path / "S" / "r001")
    spec = instruments.parse_recipe(recipe.find("fog_thermal", ()))
    validate = instruments.find("fog_thermal").validate
    validate(spec, run.records, [long_log])  # imports
    tracemalloc.start()
    validate(spec, run.records, [long_log])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 8 * 8 * len(long_log.frame)
