"""A log on disk is fitted like one in memory: the same numbers, and nothing left behind."""

import tempfile
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import instruments, pipeline, recipe, store
from calibkit.check import chunked, thermometers
from calibkit.errors import OutputError, RecipeError, UsageError
from calibkit.frame import Log, values
from calibkit.ingest import logs, logs_on_disk
from calibkit.instruments.fog_thermal import ramps
from calibkit.instruments.gyro_scale import dropouts
from calibkit.numeric import anomalies, chunks, intervals, level_changes, order_statistics, segments
from calibkit.numeric.thermal import occupancy
from calibkit.numeric.wavelet import denoise, extension
from conftest import ROOT

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
    monkeypatch.setenv(logs_on_disk.SETTING, "0")
    monkeypatch.setattr(logs_on_disk, "ROWS", 700)
    monkeypatch.setattr(chunked, "CHUNK", 1000)


def prepared(folder, overrides=()):
    """Read and prepare the log; returns both."""
    spec = instruments.parse_recipe(recipe.find("fog_thermal", overrides))
    log = logs.read_log(spec, folder / FILE, FILE, ramps.COLUMNS)
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


def test_a_log_on_disk_comes_out_bit_for_bit_as_in_memory(folder, on_disk, monkeypatch):
    """Block means, denoised indication, ramps and digests are equal; the columns do lie in mapped
    files.
    """
    log, there = prepared(folder)
    assert log.on_disk
    monkeypatch.setenv(logs_on_disk.SETTING, "1000")
    whole, here = prepared(folder)
    assert not whole.on_disk
    same(there, here)
    assert there.noise == here.noise
    assert log.frame.equals(whole.frame)


def test_the_length_of_spans_does_not_matter(folder, on_disk, monkeypatch):
    """Spans of 257 rows and blocks of 37 pairs, that cut windows, intervals and wavelets
    anywhere: the same to 1e-10.
    """
    _, usual = prepared(folder)
    monkeypatch.setattr(chunks, "ROWS", 257)
    monkeypatch.setattr(order_statistics, "COLLECTED", 100)
    monkeypatch.setattr(denoise, "BLOCK", 37)
    _, cut = prepared(folder)
    same(usual, cut, rtol=1e-10)


def test_a_fit_from_disk_has_the_coefficients_of_one_in_memory(
    folder, on_disk, calibkit, monkeypatch, tmp_path
):
    """The command line gives the same coefficient files, byte for byte."""
    for name, setting in (("disk", "0"), ("memory", "1000")):
        monkeypatch.setenv(logs_on_disk.SETTING, setting)
        options = ("--serial", "S", "--date", "2026-01-01", "--out", tmp_path / name)
        pinned = ("--set", "drift.model=gradient_rate", "--set", "drift.order=0")  # of one ramp
        assert calibkit("fit", "fog_thermal", "--data", folder, *options, *pinned).code in (0, 1)
    for stage in ("denoise.json", "drift.json", "drift_rate.json"):
        disk, memory = (
            (tmp_path / name / "S" / "r001" / stage).read_bytes() for name in ("disk", "memory")
        )
        assert disk == memory


def test_every_shipped_procedure_works_along_logs_on_disk():
    """None of them takes a long log into memory."""
    assert all(instruments.find(name).Recipe.along_chunks for name in instruments.SHIPPED)


@pytest.mark.parametrize("procedure", ["gyro_pair", "gyro_triad"])
def test_gyros_about_several_axes_are_fitted_from_disk_as_in_memory(
    procedure, on_disk, calibkit, monkeypatch, tmp_path
):
    """The run folders are the same, byte for byte."""
    for name, setting in (("disk", "0"), ("memory", "1000")):
        monkeypatch.setenv(logs_on_disk.SETTING, setting)
        options = ("--serial", "S", "--date", "2026-01-01", "--out", tmp_path / name)
        data = ROOT / "datasets" / procedure
        assert calibkit("fit", procedure, "--data", data, *options).code == 0
    disk, memory = (
        {path.name: path.read_bytes() for path in (tmp_path / name / "S" / "r001").iterdir()}
        for name in ("disk", "memory")
    )
    assert disk == memory


def test_ranges_are_left_out_of_a_log_on_disk_too(folder, on_disk, monkeypatch):
    """The rows left out are counted once over all pieces, and a range without a row is refused."""
    whole = 'exclude=[{log="ramp_heating_05", to_s=800.0, reason="warm-up", person="A. Tester"}]'
    log, there = prepared(folder, (whole,))
    monkeypatch.setenv(logs_on_disk.SETTING, "1000")
    in_memory, here = prepared(folder, (whole,))
    assert log.notes == in_memory.notes
    assert log.frame.index.equals(in_memory.frame.index)
    same(there, here)
    monkeypatch.setenv(logs_on_disk.SETTING, "0")
    with pytest.raises(RecipeError, match="no row from 1000000 s"):
        prepared(folder, (whole.replace("to_s=800.0", "from_s=1e6"),))


def test_a_fault_in_a_log_on_disk_stops_the_fit(folder, on_disk, calibkit, tmp_path):
    """A clock that runs backwards in a later piece is refused with its line, and leaves no scratch
    file.
    """
    lines = (folder / FILE).read_text("utf-8").splitlines()
    lines[3000], lines[3001] = lines[3001], lines[3000]
    (tmp_path / FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    before = set(Path(tempfile.gettempdir()).glob("calibkit-*"))
    outcome = calibkit(
        "fit", "fog_thermal", "--data", tmp_path, "--serial", "S", "--out", tmp_path / "runs"
    )
    assert outcome.code != 0
    assert f"{FILE}:3002: column 'time_s': time runs backwards" in outcome.err
    assert set(Path(tempfile.gettempdir()).glob("calibkit-*")) == before


def test_a_full_disk_is_an_error_that_says_where(monkeypatch):
    """More scratch than any disk has is refused before anything is written."""
    with pytest.raises(OutputError, match="no room for"):
        logs_on_disk._allocate_column(1 << 52)


def test_a_setting_that_is_no_number_is_refused(folder, monkeypatch):
    """The environment variable is named."""
    monkeypatch.setenv(logs_on_disk.SETTING, "many")
    with pytest.raises(UsageError, match="CALIBKIT_LARGEST_LOG_MB=many"):
        prepared(folder)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, chunks.ROWS - 1, chunks.ROWS, chunks.ROWS + 6])
def test_one_value_that_is_not_finite_is_seen_in_any_span(bad, row):
    """First, last and over the edge of a span; infinities of both signs, and sums that overflow, do
    not hide or feign one.
    """
    column = np.ones(chunks.ROWS + 7)
    assert chunks.all_finite(column)
    assert chunks.all_finite(np.full(chunks.ROWS + 7, 1e308))
    column[row] = bad
    assert not chunks.all_finite(column)
    column[3] = -bad
    assert not chunks.all_finite(column)
    assert chunks.all_finite(column[:0])


@given(
    st.lists(st.floats(-5.0, 5.0).map(lambda x: round(x, 1)), min_size=1, max_size=300),
    st.integers(1, 40),
)
@settings(max_examples=150, deadline=None)
def test_the_median_in_spans_is_that_of_numpy(values, rows):
    """Ties, even and odd numbers, spans and samples of any length: the same number to the last
    bit.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "ROWS", rows)
        patch.setattr(order_statistics, "COLLECTED", 7)
        assert order_statistics.median(np.array(values)) == np.median(values)


@given(
    st.lists(st.integers(0, 2), min_size=1, max_size=120), st.integers(2, 14), st.integers(1, 50)
)
@settings(max_examples=150, deadline=None)
def test_equal_runs_are_those_of_a_loop(values, shortest, rows):
    """Every run of at least so many equal values, and nothing else, wherever spans cut them."""
    expected, start = [], 0
    for k in range(1, len(values) + 1):
        if k == len(values) or values[k] != values[start]:
            if k - start >= shortest:
                expected.append([start, k])
            start = k
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "ROWS", rows)
        found = anomalies.equal_runs(np.array(values, dtype=float), shortest)
        assert found.tolist() == expected
        driver = np.array(values, dtype=float).cumsum()
        moved = [[a, b] for a, b in expected if np.ptp(driver[a : min(b, driver.size - 1)]) > 15.0]
        assert anomalies.stuck_against(driver, 15.0, found).tolist() == moved


@pytest.fixture
def long_log(monkeypatch):
    """Return a log of 1,000,000 rows of a warmed gyro with its columns on disk, and work on it in
    small pieces.
    """
    monkeypatch.setattr(chunks, "ROWS", 1 << 13)
    monkeypatch.setattr(order_statistics, "COLLECTED", 1 << 13)
    time = np.arange(1_000_000) / 100.0
    case = 25.0 + 20.0 * np.sin(time / 2000.0) + RNG.normal(0.0, 0.01, time.size)
    made = {"time_s": time, "temp_case_degc": case, "temp_env_degc": case + 0.1}
    made["gyro_dph"] = 0.1 * case + RNG.normal(0.0, 1.0, time.size)
    columns = {}
    for name, column in made.items():
        columns[name] = logs_on_disk._allocate_column(column.size)
        columns[name][:] = column
    frame = pd.DataFrame(columns, copy=False)
    return Log("a", "a.csv", "", len(frame), frame, allocate=logs_on_disk._allocate_column)


@pytest.mark.parametrize(
    "work",
    [
        lambda log: thermometers.check_steps(log, "temp_case_degc"),
        lambda log: extension.find_end(values(log.frame, "gyro_dph"), "trend", 1 << 19),
    ],
    ids=["steps", "ends"],
)
def test_what_looks_along_a_log_on_disk_holds_pieces_of_it(long_log, work):
    """Beside pieces, and an end of a signal, nothing is in memory."""
    work(long_log)  # imports
    tracemalloc.start()
    work(long_log)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 12 * len(long_log.frame)


@pytest.mark.skipif(
    not Path("/proc/self/smaps").exists(), reason="only Linux lists the memory of a process"
)
@pytest.mark.parametrize(
    "work",
    [
        lambda log: log.measured_conditions(),
        lambda log: dropouts_of(log),  # noqa: PLW0108 (it stands below)
        lambda log: level_changes.jumps(values(log.frame, "gyro_dph"), 2000),
        lambda log: long_intervals(log).means(values(log.frame, "gyro_dph")),
    ],
    ids=["conditions", "dropouts", "jumps", "means"],
)
def test_what_looks_along_a_log_on_disk_lets_go_of_its_pages(long_log, work):
    """A tenth of a column at most is left in memory."""
    chunks.release(*(values(long_log.frame, str(name)) for name in long_log.frame.columns))
    before = resident_scratch()
    work(long_log)
    assert resident_scratch() - before < len(long_log.frame)


def resident_scratch():
    """Bytes of scratch files that are in memory."""
    lines = Path("/proc/self/smaps").read_text("utf-8").splitlines()
    mapped, total = False, 0
    for line in lines:
        if not line.split()[0].endswith(":"):
            mapped = "(deleted)" in line
        elif mapped and line.startswith("Rss:"):
            total += 1024 * int(line.split()[1])
    return total


def long_intervals(log):
    """Intervals of a log that are each longer than a chunk."""
    return intervals.Intervals.find(values(log.frame, "time_s"), 200.0)


def dropouts_of(log):
    """Dropouts of a gyro in two held rates."""
    held = SimpleNamespace(
        span=np.array([[0, 500_000], [500_000, 1_000_000]]), rate_dps=np.array([1.0, 2.0])
    )
    return list(dropouts.find(log, held, ["gyro_dph"]))


def test_a_log_on_disk_is_validated_in_memory_for_some_chunks(folder, long_log, calibkit, tmp_path):
    """Compensation, its uncertainty and both Allan deviations of a run of another log."""
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
    assert peak < 12 * len(long_log.frame)


def test_mapped_arrays_let_go_of_their_pages_and_keep_their_values():
    """Released pages are read again from the file: nothing written is lost."""
    column = logs_on_disk._allocate_column(300_000)
    column[:] = np.arange(300_000.0)
    chunks.release(column, column[1000:2000], np.zeros(3))
    assert column.sum() == 299_999 * 150_000
    held = intervals.Intervals.find(np.arange(300_000.0), 10.0)
    assert held.means(column)[-1] == 299_994.5
    assert occupancy.spikes(column, held).size == 0
    noisy = logs_on_disk._allocate_column(40_000)
    noisy[:] = RNG.normal(0.0, 1.0, 40_000)
    kept = denoise.denoise(noisy, allocate=logs_on_disk._allocate_column)
    assert np.array_equal(kept.signal, denoise.denoise(np.array(noisy)).signal)
    time = np.arange(300_000.0)
    slope = segments.causal_slope(time, column, 60.0, allocate=logs_on_disk._allocate_column)
    assert np.array_equal(slope, segments.causal_slope(time, np.array(column), 60.0))
