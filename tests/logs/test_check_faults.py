"""Every fault that a laboratory knows, planted in a healthy simulated log: found, named, located;
and no false alarm.
"""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from conftest import ROOT, slow_after

ALLOWED = {
    "fog_thermal": "ramp_heating_05.csv",
    "rate_table": "room_1.csv",
    "gyro_pair": "table_axis_a.csv",
    "accelerometer": "positions.csv",
    "inclinometer": "stations.csv",
}
"""Procedure → the log that faults are planted in."""


@pytest.fixture(scope="module")
def healthy():
    """Return the columns of one healthy log of every procedure, by procedure, as floats."""
    logs = {}
    for procedure, file in ALLOWED.items():
        text = pipeline.simulated(procedure, 3).files()[file].decode()
        rows = list(csv.reader(io.StringIO(text)))
        data = np.array([[float(field or "nan") for field in row] for row in rows[1:]])
        logs[procedure] = dict(zip(rows[0], data.T, strict=True))
    return logs


def findings(name, columns, tmp_path, log_writer, overrides=()):
    """Return what the procedure's check says of one log."""
    file = ALLOWED[name]
    log_writer(tmp_path / file, **columns)
    spec = instruments.parse_recipe(recipe.find(name, overrides))
    procedure = instruments.find(spec.procedure)
    return list(procedure.faults(spec, procedure.read(spec, tmp_path, file)).findings)


def put(column, rows, value):
    """Return a fault that sets rows of a column; the value may be a function of the old ones."""

    def plant(columns):
        changed = columns[column].copy()
        changed[rows] = value(changed[rows]) if callable(value) else value
        return columns | {column: changed}

    return plant


def scaled(column, factor, offset=0.0):
    """Return a fault that gives a column another unit or sign."""
    return lambda columns: columns | {column: columns[column] * factor + offset}


def cut(start, stop):
    """Return a fault that loses rows."""
    return lambda columns: {
        name: np.delete(values, slice(start, stop)) for name, values in columns.items()
    }


def opened(rows, depth):
    """Return a fault that cools case and air on their way up, and lets them come back."""

    def plant(columns):
        dip = np.zeros(columns["time_s"].size)
        dip[rows] = depth * np.hanning(rows.stop - rows.start)
        return columns | {name: columns[name] - dip for name in ("temp_case_degc", "temp_env_degc")}

    return plant


# fmt: off
FAULTS = {
    "gap too long": ("fog_thermal", cut(2000, 2100), "gap", "refuse", 2002, "a gap of 101 s"),
    "short gap": ("fog_thermal", cut(2000, 2010), "gap", "warn", 2002, "a gap|1 short gap"),
    "dropped value": ("fog_thermal", put("gyro_dph", 1500, np.nan), "missing", "refuse", 1502, "1 missing"),
    "stamp twice": ("fog_thermal", put("time_s", 3000, 2999.0), "clock", "refuse", 3002, "stands still"),
    "one spike": ("fog_thermal", put("gyro_dph", 2500, lambda g: g + 15.0), "spike", "warn", 2502, "1 in the log"),
    "sentinel in a thermometer": ("fog_thermal", put("temp_case_degc", 900, 9999.0), "range", "refuse", 902, "9999"),
    "spike in a thermometer": ("fog_thermal", put("temp_env_degc", 900, lambda t: t + 4.0), "spike", "warn", 902, ""),
    "gyro stuck": ("fog_thermal", put("gyro_dph", slice(3000, 3060), 7.0), "stuck", "warn", 3002, "stuck at 7"),
    "dropout to zero": ("fog_thermal", put("gyro_dph", slice(3000, 3060), 0.0), "saturated", "warn", 3002, "at 0"),
    "chamber thermometer stuck": (
        "fog_thermal", put("temp_env_degc", slice(1200, 1500), lambda t: t[0]), "stuck", "warn", 1202, "300 rows",
    ),
    "chamber opened": ("fog_thermal", opened(slice(1000, 1240), 20.0), "turned_back", "warn", None, "falls by"),
    "gyro clipped": (
        "fog_thermal", lambda c: c | {"gyro_dph": np.minimum(c["gyro_dph"], np.quantile(c["gyro_dph"], 0.98))},
        "saturated", "warn", None, "",
    ),
    "start-up rows": ("fog_thermal", put("gyro_dph", slice(0, 12), 500.0), "start_up", "warn", 2, "12 start-up rows"),
    "bias jump": ("fog_thermal", put("gyro_dph", slice(2700, None), lambda g: g + 4.0), "jump", "warn", 2702, "+4"),
    "coarse steps": (
        "fog_thermal", lambda c: c | {"gyro_dph": np.round(c["gyro_dph"] / 5.0) * 5.0}, "quantisation", "warn", 2, "5 deg/h",
    ),
    "gyro in deg/s": ("fog_thermal", scaled("gyro_dph", 1 / 3600.0), "unit", "warn", 2, "deg/s"),
    "case in kelvin": ("fog_thermal", scaled("temp_case_degc", 1.0, 273.15), "range", "refuse", None, "degC|°C"),
    "case in degF": ("fog_thermal", scaled("temp_case_degc", 1.8, 32.0), "unit", "refuse", None, "degF"),
    "case and air swapped": (
        "fog_thermal", lambda c: c | {"temp_case_degc": c["temp_env_degc"], "temp_env_degc": c["temp_case_degc"]},
        "swapped", "refuse", None, "runs ahead of the chamber air",
    ),
    "case of the wrong sign": ("fog_thermal", scaled("temp_case_degc", -1.0), "sign", "warn", None, "sign = -1"),
    "time in minutes": ("fog_thermal", scaled("time_s", 1 / 60.0), "unit", "warn", None, '"min"'),
    "gyro saturated on the table": (
        "rate_table",
        lambda c: c | {"gyro_x_lsb": np.clip(c["gyro_x_lsb"], -0.6 * c["gyro_x_lsb"].max(), 0.6 * c["gyro_x_lsb"].max())},
        "saturated", "warn", None, "",
    ),
    "gyro against the table": ("rate_table", scaled("gyro_x_lsb", -1.0), "sign", "warn", None, "sign = -1"),
    "triad in m/s²": (
        "accelerometer", lambda c: c | {k: v * 9.80665 for k, v in c.items() if k.startswith("accel")}, "unit", "warn",
        None, "m/s^2",
    ),
    "triad in mg": (
        "accelerometer", lambda c: c | {k: v * 1e3 for k, v in c.items() if k.startswith("accel")}, "range", "refuse", 2, "",
    ),
    "triad of the other convention": (
        "accelerometer", lambda c: c | {k: -v for k, v in c.items() if k.startswith("accel")}, "sign", "refuse", None,
        "reference.convention",
    ),
    "gyros of a tool in deg/s": ("inclinometer", scaled("gyro_x_dph", 1 / 3600.0), "unit", "warn", None, "deg/s"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found_named_and_located(name, healthy, tmp_path, log_writer):
    """Each fault gives a finding of its name and severity at its line, with words that fit."""
    procedure, plant, kind, severity, line, words = FAULTS[name]
    found = findings(procedure, plant(healthy[procedure]), tmp_path, log_writer)
    named = [finding for finding in found if finding.name == kind and finding.severity == severity]
    assert named, [str(finding) for finding in found]
    assert line is None or any(finding.line == line for finding in named), [
        finding.line for finding in named
    ]
    assert any(word in str(finding) for finding in named for word in words.split("|")), [
        str(f) for f in named
    ]


@pytest.mark.parametrize("procedure", ALLOWED)
def test_the_healthy_logs_say_nothing(procedure, healthy, tmp_path, log_writer):
    """The logs that faults are planted in give no finding at all."""
    assert findings(procedure, healthy[procedure], tmp_path, log_writer) == []


@pytest.mark.parametrize("procedure", slow_after(1, instruments.campaigns()))
def test_a_clean_campaign_of_any_procedure_gives_no_finding(procedure, tmp_path):
    """Every log of a simulated campaign is checked without a word: false alarms cost trust."""
    from calibkit.commands import inspection, pipeline

    for name, content in pipeline.simulated(procedure, 11).files().items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    reports = inspection.check(recipe.find(procedure), tmp_path).logs
    assert [str(finding) for report in reports for finding in report.findings] == []


@pytest.mark.parametrize("procedure", instruments.campaigns())
def test_the_sample_logs_give_no_finding(procedure):
    """The data sets that come with calibkit are checked without a word."""
    from calibkit.commands import inspection

    reports = inspection.check(recipe.find(procedure), ROOT / "datasets" / procedure).logs
    assert [str(finding) for report in reports for finding in report.findings] == []
