"""`calibkit init`: from the logs themselves a recipe that reads them, and nothing invented."""

import tomllib

import numpy as np
import pytest

import dialects
from calibkit import procedures, recipe
from calibkit.simulate import campaigns
from conftest import ROOT

SHIPPED = ("accelerometer", "fog_thermal", "gyro_pair", "inclinometer", "rate_table")
READ = (
    "semicolons and decimal commas",
    "Windows-1252 and German units",
    "Excel Unicode text",
    "UTF-16 without a mark",
    "Chinese names and units in GB18030",
    "a mark, CRLF and bracketed units",
    "blanks, and a blank behind the sign",
    "preamble, names and units on two lines",
    "trailing tabs",
    "rows that end with a tab",
    "three hundred columns with alarms",
    "comma before the milliseconds",
    "dd.MM.yyyy",
    "time of day past midnight",
    "milliseconds by the header",
    "nineteen digits",
    "elapsed hours",
    "quotes",
    "bars and blank lines at the end",
    "Chinese dates",
    "Excel",
    "TDMS",
    "MATLAB v7.3",
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
    text = campaigns.of("fog_thermal")(3).files()["ramp_heating_05.csv"].decode()
    lines = text.split("\n")[:1200]
    folder = tmp_path_factory.mktemp("clean")
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    spec = recipe.parse(recipe.find("fog_thermal"))
    return dialects.Clean.of("\n".join(lines)), procedures.of(spec).read(spec, folder, "a.csv").frame


@pytest.mark.parametrize("name", READ)
def test_a_proposed_recipe_reads_the_log_as_it_is(name, clean, tmp_path, calibkit):
    """Written in each dialect that names its columns, a log gives the numbers of the clean one without a word of recipe."""
    fields, frame = clean
    dialect = dialects.DIALECTS[name]
    written = dialect.write(fields)
    for file, content in (written if isinstance(written, dict) else {f"a{dialect.suffix}": written}).items():
        (tmp_path / file).write_bytes(content)
    text = proposed(calibkit, tmp_path)
    spec = recipe.parse(recipe.Source("proposed.toml", text))
    assert spec.procedure == "fog_thermal"
    shipped = recipe.parse(recipe.find("fog_thermal"))
    assert spec.model_copy(update={"logs": shipped.logs, "columns": {}}) == shipped
    file = next(path.name for path in sorted(tmp_path.iterdir()))
    found = procedures.of(spec).read(spec, tmp_path, file).frame
    for column in frame.columns:
        start = found[column].to_numpy() - (found["time_s"].iloc[0] if column == "time_s" else 0.0)
        np.testing.assert_allclose(start, frame[column].to_numpy(), rtol=0, atol=1e-9)


def test_units_by_name_are_stated_and_findings_are_comments(tmp_path, calibkit, log_writer):
    """Names that end in a unit get it; what check finds stands above the recipe, each line a comment."""
    time = np.arange(0.0, 600.0, 0.01)
    rng = np.random.default_rng(1)
    axes = {f"a{axis}_mps2": 9.81 * (axis == "z") + rng.normal(0, 0.01, time.size) for axis in "xyz"}
    log_writer(tmp_path / "a.csv", t_s=time, **axes)
    spec = tomllib.loads(proposed(calibkit, tmp_path))
    assert spec["columns"]["accel_z_g"] == {"from": "az_mps2", "unit": "m/s^2"}
    assert spec["columns"]["time_s"]["from"] == "t_s"


def test_nothing_is_proposed_where_the_columns_say_nothing(tmp_path, calibkit):
    """No log, a log without names, and names that mean nothing: an error with exit code 3 that shows what is there."""
    assert calibkit("init", "--from", tmp_path / "none").code == 2
    assert calibkit("init", "--from", tmp_path).code == 3
    (tmp_path / "a.csv").write_text("foo,bar\n1,2\n3,4\n5,6\n", encoding="utf-8")
    outcome = calibkit("init", "--from", tmp_path)
    assert outcome.code == 3
    assert "foo, bar" in outcome.err
    (tmp_path / "a.csv").write_text("".join(f"{k},2.0,3.0\n" for k in range(50)), encoding="utf-8")
    outcome = calibkit("init", "--from", tmp_path)
    assert outcome.code == 3
    assert "names" in outcome.err


def test_two_temperatures_without_a_word_are_told_from_each_other_aloud(tmp_path, calibkit, log_writer):
    """Of two columns that could be the case both are mapped, and a comment says what else could be."""
    time = np.arange(100.0)
    log_writer(tmp_path / "a.csv", time=time, T1=20.0 + time / 10, T2=20.0 + time / 9, gyro=1.0 + 0.1 * np.sin(time))
    text = proposed(calibkit, tmp_path)
    spec = tomllib.loads(text)
    assert {spec["columns"][name]["from"] for name in ("temp_case_degc", "temp_env_degc")} == {"T1", "T2"}
    assert "Check every unit, sign and column" in text
