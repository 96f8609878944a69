"""`calibkit init`: from the logs themselves a recipe that reads them, and nothing invented."""

import tomllib

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.logs.column_names import LogColumn, assign_columns
from conftest import ROOT
from logs import dialects

SHIPPED = (
    "accelerometer",
    "fog_thermal",
    "gyro_noise",
    "gyro_pair",
    "gyro_triad",
    "inclinometer",
    "rate_table",
)
READ = (
    "semicolons and decimal commas",
    "Windows-1252 and German units",
    "Excel Unicode text",
    "Chinese names and units in GB18030",
    "preamble, names and units on two lines",
    "time of day past midnight",
    "nineteen digits",
    "bars and blank lines at the end",
    "Excel",
    "TDMS",
    "Parquet",
)
"""Dialects whose logs name their columns, so that a recipe can be proposed."""


def proposed(calibkit, folder):
    """Return the text that init prints."""
    outcome = calibkit("init", "--from", folder)
    assert outcome.code == 0, outcome.err
    return outcome.out


@pytest.mark.parametrize("name", SHIPPED)
def test_of_a_shipped_procedure_only_the_log_mapping_differs(name, calibkit):
    """For the shipped data sets the proposed recipe is the shipped one but for comments."""
    text = proposed(calibkit, ROOT / "datasets" / name)
    assert tomllib.loads(text) == tomllib.loads(recipe.find(name).text)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Return a clean log's fields and its frame."""
    text = pipeline.simulated("fog_thermal", 3).files()["ramp_heating_05.csv"].decode()
    lines = text.split("\n")[:1200]
    folder = tmp_path_factory.mktemp("clean")
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    spec = instruments.parse_recipe(recipe.find("fog_thermal"))
    return (
        dialects.Clean.of("\n".join(lines)),
        instruments.find(spec.procedure).read(spec, folder, "a.csv").frame,
    )


@pytest.mark.parametrize("name", READ)
def test_a_proposed_recipe_reads_the_log_as_it_is(name, clean, tmp_path, calibkit):
    """Written in each dialect that names its columns, a log gives the numbers of the clean one
    without a word of recipe.
    """
    fields, frame = clean
    dialect = dialects.DIALECTS[name]
    written = dialect.write(fields)
    for file, content in (
        written if isinstance(written, dict) else {f"a{dialect.suffix}": written}
    ).items():
        (tmp_path / file).write_bytes(content)
    text = proposed(calibkit, tmp_path)
    spec = instruments.parse_recipe(recipe.Source("proposed.toml", text))
    assert spec.procedure == "fog_thermal"
    shipped = instruments.parse_recipe(recipe.find("fog_thermal"))
    assert spec.model_copy(update={"logs": shipped.logs, "columns": {}}) == shipped
    file = next(path.name for path in sorted(tmp_path.iterdir()))
    found = instruments.find(spec.procedure).read(spec, tmp_path, file).frame
    for column in frame.columns:
        start = found[column].to_numpy() - (found["time_s"].iloc[0] if column == "time_s" else 0.0)
        np.testing.assert_allclose(start, frame[column].to_numpy(), rtol=0, atol=1e-9)


def test_units_by_name_are_stated_and_findings_are_comments(tmp_path, calibkit, log_writer):
    """Names that end in a unit get it; what check finds stands above the recipe, each line a
    comment.
    """
    time = np.arange(0.0, 600.0, 0.01)
    rng = np.random.default_rng(1)
    axes = {
        f"a{axis}_mps2": 9.81 * (axis == "z") + rng.normal(0, 0.01, time.size) for axis in "xyz"
    }
    log_writer(tmp_path / "a.csv", t_s=time, **axes)
    spec = tomllib.loads(proposed(calibkit, tmp_path))
    assert spec["columns"]["accel_z_g"] == {"from": "az_mps2", "unit": "m/s^2"}
    assert spec["columns"]["time_s"]["from"] == "t_s"


def test_nothing_is_proposed_where_the_columns_say_nothing(tmp_path, calibkit):
    """No log is an error with exit code 3; names and numbers that mean nothing get a skeleton that
    shows what is there.
    """
    assert calibkit("init", "--from", tmp_path / "none").code == 2
    assert calibkit("init", "--from", tmp_path).code == 3
    (tmp_path / "a.csv").write_text("foo,bar\n1,2\n3,4\n5,6\n", encoding="utf-8")
    text = proposed(calibkit, tmp_path)
    assert "# No procedure was recognised" in text
    assert "The log states no unit of foo, bar." in text
    (tmp_path / "a.csv").write_text("".join(f"{k},2.0,3.0\n" for k in range(50)), encoding="utf-8")
    outcome = calibkit("init", "--from", tmp_path)
    assert outcome.code == 0
    assert "# No procedure was recognised: put canonical names into [logs] names" in outcome.out
    assert tomllib.loads(outcome.out)["logs"]["names"] == ["time_s", "column 2", "column 3"]


def triad_log(write, path, **names):
    """Write a table run of three gyros with other axis names."""
    rate = np.repeat([0.0, 2.0, -2.0, 5.0, -5.0], 20)
    noise = np.random.default_rng(len(path.name)).normal(0.0, 3.0, (3, rate.size))
    gyros = {
        name: gain * rate + row for (name, gain), row in zip(names.items(), noise, strict=True)
    }
    write(path, time_s=np.arange(1.0, rate.size + 1.0), table_rate_dps=rate, **gyros)


def test_gyros_over_three_named_table_axes_are_a_triad_with_its_axes(
    tmp_path, calibkit, log_writer
):
    """The letter in a log's name is its table axis; without one in each name the logs are runs of a
    rate table.
    """
    for name in ("run1_X", "run2_X", "run1_Y", "run1_Z"):
        triad_log(
            log_writer,
            tmp_path / f"{name}.csv",
            gyro_a_lsb=9000.0,
            gyro_b_lsb=20.0,
            gyro_c_lsb=-30.0,
        )
    spec = tomllib.loads(proposed(calibkit, tmp_path))
    assert spec["procedure"] == "gyro_triad"
    assert spec["gyros"] == ["a", "b", "c"]
    assert spec["axes"] == {"x": ["run*_X.csv"], "y": ["run1_Y.csv"], "z": ["run1_Z.csv"]}
    (tmp_path / "run1_Z.csv").rename(tmp_path / "run1_last.csv")
    assert tomllib.loads(proposed(calibkit, tmp_path))["procedure"] == "rate_table"


@pytest.mark.parametrize(
    ("rows", "step_s", "moved_degc", "procedure"),
    [
        (2000, 1.0, 0.5, "gyro_noise"),
        (2000, 1.0, 5.0, "bias_temperature"),
        (900, 1.0, 0.5, "bias_temperature"),
        (2000, 0.01, 0.5, "bias_temperature"),
    ],
)
def test_a_long_record_at_one_temperature_is_one_of_noise(
    rows, step_s, moved_degc, procedure, tmp_path, calibkit, log_writer
):
    """Rows and minutes enough within two degrees are noise; a ramp, a short record and ten quick
    seconds are not.
    """
    rng = np.random.default_rng(4)
    case = 25.0 + moved_degc * np.linspace(0.0, 1.0, rows)
    rate = {f"gyro_{axis}_dph": 8.0 + rng.normal(0.0, 0.2, rows) for axis in "xy"}
    log_writer(tmp_path / "a.csv", time_s=step_s * np.arange(rows), temp_case_degc=case, **rate)
    text = proposed(calibkit, tmp_path)
    spec = tomllib.loads(text)
    assert spec["procedure"] == procedure
    assert (procedure == "gyro_noise") == ("a log cannot show it" in text)
    if procedure == "gyro_noise":
        assert spec["noise"]["columns"] == ["gyro_x_dph", "gyro_y_dph"]


def imu(rows=400):
    """Columns of a static log: time, accelerations in m/s², one rate, one temperature."""
    rng = np.random.default_rng(18)
    time = 0.5 * np.arange(rows)
    axes = [9.80665 * (k == 2) + rng.normal(0.0, 0.01, rows) for k in range(3)]
    return time, *axes, 9.0 + rng.normal(0.0, 0.3, rows), np.linspace(-20.0, 60.0, rows)


def test_a_log_without_names_gets_names_from_its_numbers(tmp_path, calibkit):
    """Time, gravity, temperature and a rate are known by their numbers; the recipe says that it
    guessed, and check accepts it.
    """
    time, *_, rate, case = imu()
    rows = (f"{t:.1f} {g:.4f} {c:.3f}" for t, g, c in zip(time, rate, case, strict=True))
    (tmp_path / "a.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    text = proposed(calibkit, tmp_path)
    spec = tomllib.loads(text)
    assert spec["logs"]["names"] == ["time_s", "gyro_dph", "temp_case_degc"]
    assert "[logs] names was guessed from their numbers" in text
    assert "# Procedure: bias_temperature, because the logs hold a gyro beside one temp" in text
    (tmp_path / "r.toml").write_text(text, encoding="utf-8")
    assert calibkit("check", tmp_path / "r.toml", "--data", tmp_path).code == 0


@pytest.mark.parametrize(
    ("names", "canonical"),
    [
        (("Rate (deg/s)", "Counts (1/s)"), {"table_rate_dps", "gyro_lsb"}),
        (("Speed [deg/s]", "Pulses"), {"table_rate_dps", "gyro_lsb"}),
        (("角速度(°/s)", "脉冲数"), {"table_rate_dps", "gyro_lsb"}),
        (("Gyro rate (deg/s)", "Counts"), {"gyro_dph"}),
        (("Rate (deg/h)", "Counts"), {"gyro_dph"}),
    ],
)
def test_a_rate_beside_counts_is_that_of_the_table(names, canonical):
    """Where no name says table or gyro; a gyro at rest is logged in deg/h."""
    assert assign_columns([LogColumn(name, "") for name in names])[0].keys() == canonical


@pytest.mark.parametrize("timed", [True, False])
def test_rates_and_counts_without_a_word_of_the_table_are_a_rate_table(
    timed, tmp_path, calibkit, log_writer
):
    """As rows over time, or as one row for each held rate."""
    rate = np.array([-100.0, -30.0, -3.0, 3.0, 30.0, 100.0])
    columns = {"Rate (deg/s)": np.repeat(rate, 400) if timed else rate}
    columns["Counts (1/s)"] = 4123.4 * columns["Rate (deg/s)"] + 55.0
    if timed:
        columns = {"Time (s)": 0.1 * np.arange(2400)} | columns
    log_writer(tmp_path / "a.csv", **columns)
    spec = tomllib.loads(proposed(calibkit, tmp_path))
    assert spec["procedure"] == "rate_table"
    assert spec["columns"]["table_rate_dps"] == {"from": "Rate (deg/s)"}
    assert spec["columns"]["gyro_x_lsb"] == {"from": "Counts (1/s)"}
    assert ("rate_hz" in spec["logs"]) == (not timed)


@pytest.mark.parametrize(
    ("inclination", "toolface"),
    [("Neigung [°]", "Lage [°]"), ("Pos. 1 [°]", "Pos. 2 [°]"), ("Lage 2", "Lage 1")],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_attitudes_are_found_by_the_gravity_that_they_explain(
    inclination, toolface, sign, tmp_path, calibkit
):
    """Names in any language: of the columns of angles those are taken that say where gravity is."""
    table = pd.read_csv(ROOT / "datasets" / "accelerometer" / "positions.csv")
    axes = [f"accel_{axis}_g" for axis in "xyz"]
    table[axes] *= sign
    names = {"inclination_deg": inclination, "toolface_deg": toolface}
    table = table.rename(columns=names)
    table.insert(0, "Nr", np.arange(len(table)) % 7)
    table.to_csv(tmp_path / "log.csv", index=False)
    text = proposed(calibkit, tmp_path)
    assert "Procedure: accelerometer, because" in text
    columns = tomllib.loads(text)["columns"]
    assert {name: columns[name]["from"] for name in names} == names
