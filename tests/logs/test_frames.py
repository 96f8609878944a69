"""Frames in place of log files: what they may hold, and what is refused, with the reason."""

import re

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit import recipe
from conftest import ROOT

PAIR = ROOT / "datasets" / "gyro_pair"
DATE = "2026-11-21"


@pytest.fixture(scope="module")
def logs():
    """Return the sample logs of a pair as frames."""
    return {path.stem: pd.read_csv(path) for path in sorted(PAIR.glob("*.csv"))}


@pytest.fixture(scope="module")
def run(logs):
    """Return the run of the pair, of which nothing is written."""
    return fitted(logs)


def fitted(logs, **options):
    """Run of frames of the pair."""
    return calibkit.fit("gyro_pair", logs=logs, runs=None, **{"date": DATE, **options})


@pytest.mark.parametrize("date", ["yesterday", "2026-13-01", pd.Timestamp("2026-11-21"), 20261121])
def test_a_date_is_refused_that_no_run_could_be_read_with(logs, date):
    """As the command refuses it, before anything is fitted."""
    with pytest.raises(calibkit.CalibkitError, match="not a date"):
        fitted(logs, date=date)


def test_a_column_that_the_recipe_maps_and_no_log_has_is_named(logs):
    """A temperature by a name that is mistyped: the pair was fitted without it, without a word."""
    source = recipe.find("gyro_pair", ('columns.temp_case_degc.from="Tcas"',))
    found = calibkit.fit(source, logs=logs, runs=None, date=DATE)
    named = "no column 'Tcas', which the recipe maps: temp_case_degc is not read"
    assert any(named in flag for flag in found.document["flags"])


@pytest.mark.parametrize(
    ("value", "found"),
    [("abc", "abc"), ("7,66", "7,66"), (None, ""), (1.0 + 2.0j, "(1+2j)"), (True, "True")],
)
def test_what_is_no_number_is_named_with_its_row(logs, value, found):
    """A text, a truth value or a complex number among the counts of a gyro."""
    name, frame = next(iter(logs.items()))
    column = frame["gyro_a_lsb"].astype(object)
    column.iloc[7] = value
    if value is True:
        column = frame["gyro_a_lsb"] > 0.0
        column.iloc[0] = True
    with pytest.raises(calibkit.CalibkitError) as error:
        fitted(logs | {name: frame.assign(gyro_a_lsb=column)})
    row = 2 if value is True else 9
    assert f"{name}.csv:{row}: column 'gyro_a_lsb': found '{found}'" in error.value.message


class _Other:
    """A frame of another library."""

    def to_pandas(self):
        """Return a frame."""


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([1], r"logs: found list"),
        ("folder", r"logs: found str"),
        (pd.DataFrame({"time_s": [0.0]}), r"logs: found pandas\..*DataFrame"),
        ({"table_axis_a": None}, r"table_axis_a.csv: found NoneType, expected a frame"),
        ({"table_axis_a": _Other()}, r"expected a frame: give frame.to_pandas\(\)"),
        ({5: pd.DataFrame({"time_s": [0.0]})}, r"'5' is none of the logs"),
    ],
)
def test_what_is_no_frame_is_refused_by_its_type(given, said):
    """With what to give in its place."""
    with pytest.raises(calibkit.CalibkitError) as error:
        fitted(given)
    assert re.search(said, f"{error.value.message}: {error.value.hint}")


def test_a_compensated_frame_states_the_units_that_its_columns_have():
    """A mapped column keeps the log's own unit, under whatever name, and can be given back."""
    folder = ROOT / "datasets" / "fog_thermal"
    logs = {path.stem: pd.read_csv(path) for path in sorted(folder.glob("*.csv"))}
    for own in ("gyro_dph", "rate"):
        frames = {name: frame.rename(columns={"gyro_dph": own}) for name, frame in logs.items()}
        for frame in frames.values():
            frame[own] /= 3600.0
        recipe = calibkit.load_recipe(
            "fog_thermal", columns__gyro_dph__from=own, columns__gyro_dph__unit="deg/s"
        )
        run = calibkit.fit(recipe, logs=frames, runs=None, date=DATE)
        frame = next(iter(frames.values()))
        made = run.apply(frame)
        assert made.attrs["units"][own] == "deg/s"
        assert np.abs(made[own].mean()) < 0.01  # deg/s
        assert run.apply(made.drop(columns="status", errors="ignore")).shape[0] == len(frame)
