"""One campaign in every dialect: the same numbers, so the same coefficients."""

import json
import re
from dataclasses import replace

import pytest

from calibkit import coefficients, instruments, recipe
from calibkit.ingest import logs
from dialects import DIALECTS, Clean

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


def written(folder, campaign, dialect):
    """Write a campaign in a dialect."""
    folder.mkdir(exist_ok=True)
    for name in KEPT:
        log = Clean.of((campaign / name).read_text())
        (folder / name).with_suffix(dialect.suffix).write_bytes(dialect.write(log))
    return folder


def coefficient_files(source, folder):
    """Return the bytes of each coefficient file, with the digests and suffixes of the inputs taken
    out.
    """
    spec = instruments.parse_recipe(source)
    fitted = instruments.find(spec.procedure).fit(
        spec, folder, logs.find_logs(spec, folder), instruments.silent
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
    from pathlib import Path

    return Path(__file__).resolve().parents[1] / "datasets" / "fog_thermal"


@pytest.fixture(scope="module")
def clean(sample, tmp_path_factory):
    """Return the coefficient files of the clean CSV."""
    folder = tmp_path_factory.mktemp("clean")
    for name in KEPT:
        (folder / name).write_bytes((sample / name).read_bytes())
    text = RECIPE.format(suffix=".csv", logs='format = "csv"', tables="")
    return unsealed(coefficient_files(recipe.Source("r.toml", text), folder))


@pytest.mark.parametrize("name", DIALECTS)
def test_a_campaign_in_another_dialect_gives_the_same_coefficient_bytes(
    name, sample, clean, tmp_path
):
    """Every number of every coefficient file equals the clean CSV's, bit for bit."""
    folder = written(tmp_path / "logs", sample, DIALECTS[name])
    assert unsealed(coefficient_files(source(DIALECTS[name]), folder)) == clean
