"""Procedures that work along logs on disk: the coefficient files of logs in memory, byte for byte,
whatever the spans.
"""

import json
from itertools import pairwise

import numpy as np
import pytest

from calibkit.check import chunked
from calibkit.ingest import logs_on_disk, write_back
from calibkit.numeric import attitude, chunks
from calibkit.readers import clean


@pytest.fixture
def small(monkeypatch):
    """Read, look at and work on logs in pieces and spans that cut them anywhere."""
    monkeypatch.setattr(logs_on_disk, "ROWS", 700)
    monkeypatch.setattr(chunked, "CHUNK", 1000)
    shorten(monkeypatch)


def shorten(monkeypatch):
    """Spans of 257 rows."""
    monkeypatch.setattr(chunks, "ROWS", 257)


@pytest.fixture
def both(calibkit, monkeypatch, tmp_path):
    """Fit logs from disk and in memory; returns the stage's files of both."""

    def fit(recipe, data, stages, serial="S", options=()):
        found = []
        for name, setting in (("disk", "0"), ("memory", "1000")):
            monkeypatch.setenv(logs_on_disk.SETTING, setting)
            given = ("--serial", serial, "--date", "2026-01-01", "--out", tmp_path / name, *options)
            outcome = calibkit("fit", recipe, "--data", data, *given)
            assert outcome.code in (0, 1), outcome.err
            found.append(
                [
                    (tmp_path / name / serial / "r001" / f"{stage}.json").read_bytes()
                    for stage in stages
                ]
            )
        return found

    return fit


def numbers(entry):
    """Every number of a JSON document, in order."""
    if isinstance(entry, dict):
        return [number for key in sorted(entry) for number in numbers(entry[key])]
    if isinstance(entry, list):
        return [number for member in entry for number in numbers(member)]
    return [float(entry)] if isinstance(entry, int | float) and not isinstance(entry, bool) else []


def warm_up(folder, log_writer, seed, rows=4000):
    """Write a static gyro's warm-up whose noise is autocorrelated."""
    rng = np.random.default_rng(seed)
    time = np.arange(float(rows))
    temperature = 60.0 - 80.0 * np.exp(-time / 1500.0) + rng.normal(0.0, 0.01, rows)
    wander = np.convolve(rng.normal(0.0, 0.01, rows + 49), np.ones(50), "valid")
    gyro = 0.02 * temperature - 1e-4 * temperature**2 + rng.normal(0.0, 0.05, rows) + wander
    log_writer(
        folder / f"warmup_{seed}.csv", time_s=time, temp_case_degc=temperature, gyro_dph=gyro
    )


@pytest.mark.parametrize("logs", [1, 2])
def test_a_bias_over_temperature_comes_out_byte_for_byte(logs, small, both, log_writer, tmp_path):
    """One log, and two that are joined on disk, give bias.json as in memory."""
    for seed in range(logs):
        warm_up(tmp_path / "logs", log_writer, seed)
    disk, memory = both("bias_temperature", tmp_path / "logs", ["bias"])
    assert disk == memory


def test_a_gap_and_a_spike_of_a_log_on_disk_are_told(
    small, calibkit, log_writer, monkeypatch, tmp_path
):
    """A spike of any channel is flagged with its line, and a long gap refused, from disk as from
    memory.
    """
    warm_up(tmp_path / "logs", log_writer, 1)
    path = tmp_path / "logs" / "warmup_1.csv"
    lines = path.read_text("utf-8").splitlines()
    lines[2500] = ",".join([*lines[2500].split(",")[:2], "12.5"])
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    torn = tmp_path / "torn" / path.name
    torn.parent.mkdir()
    torn.write_text("\n".join(lines[:1000] + lines[1100:]) + "\n", encoding="utf-8")
    gaps = []
    for setting in ("0", "1000"):
        monkeypatch.setenv(logs_on_disk.SETTING, setting)
        options = ("--serial", "S", "--out", tmp_path / setting)
        spiked = calibkit("fit", "bias_temperature", "--data", tmp_path / "logs", *options)
        assert "warmup_1.csv:2501: column 'gyro_dph': a spike: 12.5 deg/h" in spiked.out
        gaps.append(calibkit("fit", "bias_temperature", "--data", torn.parent, *options).err)
    assert "warmup_1.csv:1001: column 'time_s': a gap of 101 s" in gaps[0]
    assert gaps[0] == gaps[1]


@pytest.fixture
def applied(calibkit, monkeypatch, tmp_path):
    """Compensate a log from disk and in memory; returns the bytes of both."""

    def apply(run, log, *settings):
        found = []
        for number, setting in enumerate(("0", "1000")):
            monkeypatch.setenv(logs_on_disk.SETTING, setting)
            out = tmp_path / f"{len(settings)}_{number}.csv"
            options = [word for entry in settings for word in ("--set", entry)]
            outcome = calibkit("apply", run, "--data", log, "--out", out, *options)
            assert outcome.code == 0, outcome.err
            found.append((out.read_bytes(), outcome.err))
        return found

    return apply


def test_a_compensated_bias_is_the_same_from_disk(
    small, calibkit, applied, log_writer, monkeypatch, tmp_path
):
    """Every byte and flag of a log that goes beyond the fitted temperatures, written a few lines at
    a time.
    """
    warm_up(tmp_path / "logs", log_writer, 1, rows=2000)
    warm_up(tmp_path / "longer", log_writer, 2)
    calibkit("fit", "bias_temperature", data=tmp_path / "logs", serial="S", out=tmp_path)
    log = tmp_path / "longer" / "warmup_2.csv"
    whole = applied(tmp_path / "S" / "r001", log)
    assert whole[0] == whole[1]
    assert "clamped" in whole[0][1]
    monkeypatch.setattr(write_back, "BLOCK", 500)
    assert applied(tmp_path / "S" / "r001", log, "title=''")[0] == whole[0]


def test_line_ends_and_a_mark_are_written_as_before(applied, calibkit, log_writer, tmp_path):
    """A log with a byte-order mark and CRLF gives the bytes of the plain one, and so does one
    without a last line end.
    """
    warm_up(tmp_path / "logs", log_writer, 1, rows=500)
    calibkit("fit", "bias_temperature", data=tmp_path / "logs", serial="S", out=tmp_path)
    text = (tmp_path / "logs" / "warmup_1.csv").read_bytes()
    written = []
    for data in (text, b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n"), text[:-1]):
        log = tmp_path / str(len(written)) / "log.csv"
        log.parent.mkdir()
        log.write_bytes(data)
        written.append(
            [
                content
                for content, _ in applied(
                    tmp_path / "S" / "r001", log, *["title=''"] * len(written)
                )
            ]
        )
    assert written[0] == written[1] == written[2]


@pytest.mark.parametrize("row", [b"9999,20,0.1\n", b"9999,20\n"])
def test_a_log_that_grows_while_it_is_compensated_is_refused(
    row, calibkit, log_writer, monkeypatch, tmp_path
):
    """A row that comes between two readings of a log is an error, and nothing is written."""
    warm_up(tmp_path / "logs", log_writer, 1, rows=500)
    calibkit("fit", "bias_temperature", data=tmp_path / "logs", serial="S", out=tmp_path)
    log = tmp_path / "logs" / "warmup_1.csv"
    scanned = clean.scan_file

    def then_grows(path, file):
        found = scanned(path, file)
        with path.open("ab") as stream:
            stream.write(row)
        return found

    monkeypatch.setattr(clean, "scan_file", then_grows)
    (tmp_path / "out").mkdir()
    outcome = calibkit("apply", tmp_path / "S" / "r001", data=log, out=tmp_path / "out" / "o.csv")
    assert outcome.code == 3
    assert "it changed while it was read" in outcome.err
    assert list((tmp_path / "out").iterdir()) == []


def turned(folder, log_writer, seed, *, angle=True):
    """Write a run of a rate table over seven rates, held for more and less than a revolution, with
    a noisy tachometer.
    """
    rng = np.random.default_rng(seed)
    rates = [0.0, -40.0, -15.0, -5.0, 5.0, 15.0, 40.0]
    rate = np.concatenate(
        [np.append(np.linspace(a, b, 9)[1:], np.full(400, b)) for a, b in pairwise([0.0, *rates])]
    )
    time = np.arange(rate.size) * 0.1
    way = np.cumsum(rate) * 0.1
    counts = 2000.0 * (rate + 0.004 * np.cos(np.radians(way)) + 0.01) + rng.normal(
        0.0, 3.0, rate.size
    )
    columns = {
        "time_s": time,
        "table_rate_dps": rate + rng.normal(0.0, 2e-4, rate.size),
        "gyro_x_lsb": counts,
    }
    columns |= {"gyro_y_lsb": 0.01 * counts + rng.normal(0.0, 3.0, rate.size)}
    columns |= {"temp_case_degc": 25.0 + rng.normal(0.0, 0.01, rate.size)}
    if angle:
        columns["table_angle_deg"] = np.remainder(way, 360.0)
    return log_writer(folder / f"run_{seed}.csv", **columns)


@pytest.mark.parametrize(("angle", "gyros"), [(True, 'gyros=["x"]'), (False, 'gyros=["x", "y"]')])
def test_a_rate_table_comes_out_byte_for_byte(
    angle, gyros, small, both, applied, log_writer, tmp_path
):
    """Scale factors of runs with and without a table angle, of one gyro and of two, and the rates
    compensated with them.
    """
    for seed in range(2):
        log = turned(tmp_path / "logs", log_writer, seed, angle=angle)
    disk, memory = both("rate_table", tmp_path / "logs", ["gyro_scale"], options=("--set", gyros))
    assert disk == memory
    found = applied(tmp_path / "memory" / "S" / "r001", log)
    assert found[0] == found[1]


DWELLS = (
    "dwells.mode=series",
    "logs.files=['*.csv']",
    "k.scale_order=1",
    "k.zero_order=1",
    "k.cross=false",
)
AFFINE = (
    "affine.scale_order=1",
    "affine.cross_order=0",
    "affine.bias_order=1",
    "compensation=affine",
)


def held(folder, log_writer, seed, *, quantum=0.0):
    """Write a triad at fourteen attitudes, each held for thirty seconds, over a slow change of
    temperature.
    """
    rng = np.random.default_rng(seed)
    places = [
        (0.0, 0.0),
        *((i, t) for i in (45.0, 90.0, 135.0) for t in (0.0, 90.0, 180.0, 270.0)),
        (180.0, 0.0),
    ]
    angles = np.repeat(places, 300, axis=0)
    time = np.arange(len(angles)) * 0.1
    case = 30.0 + 10.0 * np.sin(time / 60.0)
    shown = (
        attitude.gravity_vector(*angles.T)
        @ np.array([[1.0, 0.0, 0.0], [2e-3, 1.0, 0.0], [-1e-3, 3e-3, 1.0]]).T
    )
    shown = shown * (1.001 + 1e-5 * (case - 25.0))[:, None] + rng.normal(0.0, 1e-4, shown.shape)
    shown[np.arange(len(time)) % 300 < 20] += rng.normal(0.0, 0.05, shown.shape)[
        np.arange(len(time)) % 300 < 20
    ]
    if quantum:
        shown = np.round(shown / quantum) * quantum
    columns = dict(zip(("accel_x_g", "accel_y_g", "accel_z_g"), shown.T, strict=True))
    columns |= {
        "temp_case_degc": case,
        "inclination_deg": angles[:, 0],
        "toolface_deg": angles[:, 1],
    }
    return log_writer(folder / f"triad_{seed}.csv", time_s=time, **columns)


@pytest.mark.parametrize("quantum", [0.0, 0.002])
def test_a_triad_comes_out_byte_for_byte(quantum, small, both, applied, log_writer, tmp_path):
    """K, Q and the affine triad of dwells found in a continuous log, fine or coarse, and the log
    compensated with them.
    """
    log = held(tmp_path / "logs", log_writer, 1, quantum=quantum)
    options = [word for entry in (*DWELLS, *AFFINE) for word in ("--set", entry)]
    disk, memory = both(
        "accelerometer", tmp_path / "logs", ["accel_k", "accel_q", "accel_affine"], options=options
    )
    assert disk == memory
    found = applied(tmp_path / "memory" / "S" / "r001", log)
    assert found[0] == found[1]


def test_dwells_do_not_depend_on_the_length_of_spans(both, log_writer, tmp_path, monkeypatch):
    """Coefficients from spans of 257 rows and from one span agree to 1e-10 of the largest of their
    model.
    """
    held(tmp_path / "logs", log_writer, 1)
    options = [word for entry in (*DWELLS, *AFFINE) for word in ("--set", entry)]
    _, (whole,) = both("accelerometer", tmp_path / "logs", ["accel_k"], options=options)
    shorten(monkeypatch)
    _, (cut,) = both("accelerometer", tmp_path / "logs", ["accel_k"], serial="T", options=options)
    for one, other in zip(json.loads(whole)["models"], json.loads(cut)["models"], strict=True):
        values = [
            [coefficient["value"] for coefficient in model["coefficients"]]
            for model in (one, other)
        ]
        np.testing.assert_allclose(*values, rtol=1e-10, atol=1e-14)
