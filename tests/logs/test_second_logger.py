"""Chamber log and gyro log of one run: joined by their clocks, and refused where nothing relates
them.
"""

import hashlib
import json

import numpy as np
import pytest

import calibkit as calibkit_api
from calibkit import instruments, recipe
from calibkit.instruments.bias import simulate_fog as simulate

OFFSET_S = 17.3
CHAMBER = """
[chamber]
files = ["chamber_{log}.csv"]
provides = ["temp_env_degc"]
%s
[chamber.columns]
time_s = { from = "Time" }
temp_env_degc = { from = "PV", unit = "degC" }
"""
ESTIMATE = (
    'clock = "estimate"\nshared = "temp_env_degc"\nlog_column = { from = "air probe", unit ='
    ' "degC" }'
)
LOG = "ramp_heating_05"


@pytest.fixture(scope="module")
def columns():
    """Return the columns of one simulated ramp."""
    return {
        name: np.asarray(values) for name, values in simulate.campaign(3).logs[f"{LOG}.csv"].items()
    }


def write(folder, columns, log_writer, *, keep=slice(None, None, 5), probe=True):
    """Write a gyro log with its own air probe and a chamber log of every fifth row on a clock 17.3
    s behind.
    """
    rng = np.random.default_rng(1)
    air = columns["temp_env_degc"]
    own = {name: columns[name].astype(float) for name in ("time_s", "temp_case_degc", "gyro_dph")}
    if probe:
        own["air probe"] = np.round(air + rng.normal(0.0, 0.05, air.size) + 0.4, 2)
    log_writer(folder / f"{LOG}.csv", **own)
    time = columns["time_s"].astype(float)
    log_writer(
        folder / f"chamber_{LOG}.csv", Time=(time - OFFSET_S)[keep], PV=air[keep].astype(float)
    )


def text(table):
    """Return the shipped recipe's text with a chamber table behind it."""
    shipped = recipe.find("fog_thermal").text.replace('files = ["*.csv"]', 'files = ["ramp*.csv"]')
    one_ramp = {'model = "auto"': 'model = "gradient_rate"', 'order = "auto"': "order = 0"}
    for before, after in one_ramp.items():
        assert before in shipped
        shipped = shipped.replace(before, after, 1)
    return shipped + CHAMBER % table


def joined(folder, table=ESTIMATE):
    """Return the joined log."""
    spec = instruments.parse_recipe(recipe.Source("r.toml", text(table)))
    return instruments.find(spec.procedure).read(spec, folder, f"{LOG}.csv")


def test_a_chamber_log_is_joined_on_the_estimated_clock(tmp_path, columns, log_writer):
    """The air on the log's rows is that of one logger within the thermometer's 0.1 °C steps; offset
    within 3 u of 17.3 s.
    """
    write(tmp_path, columns, log_writer)
    log = joined(tmp_path)
    clock = next(line for line in log.reading if line.startswith("clock of"))
    offset, u = (float(clock.split(word)[1].split()[0]) for word in ("offset", "uncertainty"))
    assert 0.0 < u < 0.2
    assert abs(offset - OFFSET_S) < 3.0 * u
    time = log.frame["time_s"].to_numpy()
    true = np.interp(time, columns["time_s"], columns["temp_env_degc"])
    assert np.sqrt(np.mean((log.frame["temp_env_degc"].to_numpy() - true) ** 2)) < 0.12  # °C
    assert any("sha256" in line and "linear between its rows" in line for line in log.reading)
    assert any("rows without a value of chamber" in note for note in log.notes)


def test_a_fit_records_the_clock(tmp_path, columns, log_writer, calibkit):
    """run.json holds offset, uncertainty and the chamber log's digest beside the log's."""
    write(tmp_path / "logs", columns, log_writer)
    (tmp_path / "r.toml").write_text(text(ESTIMATE), encoding="utf-8")
    made = calibkit(
        "fit", tmp_path / "r.toml", data=tmp_path / "logs", serial="S", out=tmp_path / "runs"
    )
    assert made.code in (0, 1), made.err
    document = json.loads(
        (tmp_path / "runs" / "S" / "r001" / "run.json").read_text(encoding="utf-8")
    )
    assert "clock of chamber" in json.dumps(document["inputs"])
    chamber = (tmp_path / "logs" / f"chamber_{LOG}.csv").read_bytes()
    digest = hashlib.sha256(chamber).hexdigest()
    assert document["inputs"][0]["second_logger_sha256"] == digest
    clock = next(line for line in document["inputs"][0]["reading"] if line.startswith("clock of"))
    paths = sorted((tmp_path / "runs" / "S" / "r001").glob("d*.json"))
    assert "drift_rate.json" in [path.name for path in paths]
    for path in paths:
        stated = {c.name: c for c in calibkit_api.load_coefficients(path).conditions}[
            f"second_logger_clock_offset.{LOG}.csv"
        ]
        assert stated.unit == "s"
        assert f"offset {stated.value:+.3f} s" in clock
        # at the worse end: the drift's part is in it
        middle = float(clock.split("uncertainty")[1].split()[0])
        assert middle < stated.standard_uncertainty < 3.0 * middle


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('clock = "estimate"', "needs a quantity that both loggers measured"),
        ('clock = "stated"\noffset_s = 3.0', "standard_uncertainty_s"),
        ('clock = "same"\noffset_s = 3.0', "contradicts itself"),
    ],
)
def test_a_clock_that_says_too_little_is_a_recipe_error(table, words, tmp_path, calibkit):
    """Exit 2 with the line of the table."""
    (tmp_path / "r.toml").write_text(text(table), encoding="utf-8")
    outcome = calibkit("check", tmp_path / "r.toml", "--data", tmp_path)
    assert outcome.code == 2
    assert words in outcome.err
    assert "r.toml:" in outcome.err


def test_a_case_thermometer_is_not_taken_for_the_air(tmp_path, columns, log_writer, calibkit):
    """Estimating against the case, which lags, is refused: no offset is claimed."""
    write(tmp_path / "logs", columns, log_writer, probe=False)
    table = ESTIMATE.replace("air probe", "temp_case_degc")
    (tmp_path / "r.toml").write_text(text(table), encoding="utf-8")
    outcome = calibkit("check", tmp_path / "r.toml", "--data", tmp_path / "logs")
    assert outcome.code == 3, outcome.out
    assert (
        "the best clock offset lies at the end of the search" in outcome.out
        or "do not show one quantity" in outcome.out
    )
