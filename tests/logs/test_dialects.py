"""One campaign in every dialect: the same numbers, so the same coefficients."""

import json
import re
from dataclasses import replace

import pytest

from calibkit import instruments, recipe
from calibkit.logs import log_files
from calibkit.records import coefficients
from calibkit.records.frame import values
from conftest import ROOT, slow_after
from logs.dialects import DIALECTS, NAMES, Clean

RECIPE = """procedure = "fog_thermal"

[checks]
min_rows = 20

[drift]
model = "gradient_rate"
order = 1

[denoise]
levels = 4

[logs]
files = ["*{suffix}"]
{logs}
{tables}
"""
KEPT = ("ramp_heating_05.csv", "ramp_heating_10.csv", "ramp_cooling_05.csv", "ramp_cooling_10.csv")


def source(dialect):
    """Return a recipe that reads a dialect."""
    return recipe.Source(
        "r.toml", RECIPE.format(suffix=dialect.suffix, logs=dialect.logs, tables=dialect.tables)
    )


def written(folder, campaign, dialect, names=KEPT):
    """Write a campaign in a dialect."""
    folder.mkdir(exist_ok=True)
    for name in names:
        log = Clean.of((campaign / name).read_text())
        (folder / name).with_suffix(dialect.suffix).write_bytes(dialect.write(log))
    return folder


def coefficient_files(source, folder):
    """Return the bytes of each coefficient file, with the digests and suffixes of the inputs taken
    out.
    """
    spec = instruments.parse_recipe(source)
    fitted = instruments.find(spec.procedure).fit(
        spec, folder, log_files.find_logs(spec, folder), instruments.silent
    )
    inputs = tuple(
        replace(entry, name=re.sub(r"\..*", "", entry.name), sha256="") for entry in fitted.inputs
    )
    identity = coefficients.Identity("S", 1, "2026-11-21", "calibkit", "", inputs)
    return {
        result.file: re.sub(
            r"(ramp_\w+)\.\w+: ",
            r"\1: ",
            result.as_record(identity, "").dumps(),
        )
        for result in fitted.results
    }


def unsealed(files):
    """Return the files without their own digest, which covers the suffixes that were taken out
    behind it.
    """
    return {
        name: {k: v for k, v in json.loads(text).items() if k != "sha256"}
        for name, text in files.items()
    }


@pytest.fixture(scope="module")
def sample():
    """Return the folder of a sample campaign."""
    return ROOT / "datasets" / "fog_thermal"


@pytest.fixture(scope="module")
def clean(sample, tmp_path_factory):
    """Return the coefficient files of the clean CSV."""
    folder = tmp_path_factory.mktemp("clean")
    for name in KEPT:
        (folder / name).write_bytes((sample / name).read_bytes())
    text = RECIPE.format(suffix=".csv", logs='format = "csv"', tables="")
    return unsealed(coefficient_files(recipe.Source("r.toml", text), folder))


def columns_of(source, folder):
    """Columns of the first log that a recipe reads, as bytes; times since its first row."""
    spec = instruments.parse_recipe(source)
    name = log_files.find_logs(spec, folder)[0]
    frame = instruments.find(spec.procedure).read(spec, folder, name).frame
    columns = {column: values(frame, column) for column in NAMES}
    columns["time_s"] = columns["time_s"] - columns["time_s"][0]
    return {name: column.tobytes() for name, column in columns.items()}


@pytest.mark.parametrize("name", DIALECTS)
def test_a_log_in_another_dialect_has_the_same_numbers(name, sample, tmp_path):
    """Every number of the four columns equals the clean CSV's, bit for bit."""
    one = KEPT[:1]
    clean = recipe.Source("r.toml", RECIPE.format(suffix=one[0], logs='format = "csv"', tables=""))
    folder = written(tmp_path / "logs", sample, DIALECTS[name], one)
    assert columns_of(source(DIALECTS[name]), folder) == columns_of(clean, sample)


@pytest.mark.parametrize("name", slow_after(2, DIALECTS))
def test_a_campaign_in_another_dialect_gives_the_same_coefficient_bytes(
    name, sample, clean, tmp_path
):
    """Every number of every coefficient file equals the clean CSV's, bit for bit."""
    folder = written(tmp_path / "logs", sample, DIALECTS[name])
    assert unsealed(coefficient_files(source(DIALECTS[name]), folder)) == clean
