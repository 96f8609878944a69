"""One log in every dialect: the same numbers."""

import pytest

from calibkit import instruments, recipe
from calibkit.logs import log_files
from calibkit.records.frame import values
from conftest import ROOT
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
LOG = "ramp_heating_05.csv"


def source(dialect):
    """Return a recipe that reads a dialect."""
    return recipe.Source(
        "r.toml", RECIPE.format(suffix=dialect.suffix, logs=dialect.logs, tables=dialect.tables)
    )


def written(folder, campaign, dialect):
    """Write a log of a campaign in a dialect."""
    folder.mkdir(exist_ok=True)
    log = Clean.of((campaign / LOG).read_text())
    (folder / LOG).with_suffix(dialect.suffix).write_bytes(dialect.write(log))
    return folder


@pytest.fixture(scope="module")
def sample():
    """Return the folder of a sample campaign."""
    return ROOT / "datasets" / "fog_thermal"


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
    clean = recipe.Source("r.toml", RECIPE.format(suffix=LOG, logs='format = "csv"', tables=""))
    folder = written(tmp_path / "logs", sample, DIALECTS[name])
    assert columns_of(source(DIALECTS[name]), folder) == columns_of(clean, sample)
