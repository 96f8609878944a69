"""What a fit did not use, as facts from the fit to the certificate: counted, with its cause, in a
customer's words.
"""

import datetime as dt
import json
import tomllib

import jsonschema
import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit import instruments
from calibkit.certificate import circumstances, content, profile, run_files, sheet
from calibkit.errors import CoefficientError
from calibkit.records import left_out
from calibkit.records.left_out import LeftOut
from conftest import ROOT
from sample_runs import fitted
from written_logs import sample_logs

SCHEMA = json.loads((ROOT / "docs" / "schemas" / "calibkit-run-2.schema.json").read_text())
ISSUED = dt.date(2026, 11, 21)


def stated(run, name):
    """Facts of a run, and the rows on its certificate that state them."""
    jsonschema.validate(run.document, SCHEMA)
    files = run_files.RunFiles.read(run)
    found = profile.load(ROOT / "reports" / "profiles" / f"{name}.toml")
    made = content.build(files, instruments.certificate_layout, *found, None, ISSUED)
    rows = [text for label, text in sheet.sheet(made, "en")["method"] if label == "Left out"]
    return made.run.left_out, rows


def test_positions_that_are_outliers_are_counted(tmp_path):
    """Five of 378 positions a hundred times off: five of 378 on the certificate."""
    folder = tmp_path / "logs"
    folder.mkdir()
    log = pd.read_csv(ROOT / "datasets" / "accelerometer" / "positions.csv")
    log.loc[[20, 90, 160, 230, 300], "accel_x_g"] += 0.02
    log.to_csv(folder / "positions.csv", index=False)
    run = fitted(tmp_path / "runs", "accelerometer", data=folder, overrides=('loss="robust"',))
    facts, rows = stated(run, "accelerometer")
    assert facts == (LeftOut("positions", 5, 378, "outlier"),)
    why = "because they differ from the others by far more than noise"
    assert rows == [f"5 of 378 positions were excluded {why}."]


def test_rows_that_a_person_excludes_or_that_lack_a_value_are_counted(tmp_path):
    """One log with an [[exclude]] of ten rows and three rows without an indication."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for path in (ROOT / "datasets" / "rate_table").glob("*.csv"):
        log = pd.read_csv(path)
        if path.name == "room_1.csv":
            log.loc[[5, 6, 7], "gyro_x_lsb"] = np.nan
        log.to_csv(folder / path.name, index=False)
    why = 'exclude=[{log="room_1.csv", rows=["21-30"], reason="knock", person="A"}]'
    overrides = (why, 'logs.missing="drop"')
    run = fitted(tmp_path / "runs", "rate_table", data=folder, overrides=overrides)
    facts, rows = stated(run, "rate_table")
    size = len(log)
    assert {(f.count, f.cause, f.where) for f in facts} == {
        (10, "excluded", "room_1.csv"),
        (3, "incomplete", "room_1.csv"),
    }
    assert {f.of for f in facts} == {size}
    assert rows[0] == "room_1.csv rows 21-30: knock (A)"
    assert f"3 of {size} rows of room_1.csv were excluded because a value that is needed is" in (
        " ".join(rows)
    )


@pytest.mark.parametrize("what", ["rows", "samples", "positions", "stations"])
@pytest.mark.parametrize("cause", ["excluded", "incomplete", "missing", "outlier", "unsolved"])
def test_every_fact_has_words_in_both_languages(what, cause):
    """With its numbers, where it is of one log or sensor with its name; one was, two were."""
    for count, were in ((1, "was"), (2, "were")):
        words = circumstances.describe_left_out(LeftOut(what, count, 40, cause, "x"))
        assert words.en.startswith(f"{count} of 40 {what} of ")
        assert f" {were} " in words.en
        assert str(count) in words.zh
        assert "40" in words.zh
        assert not set(words.zh) & set("abcdefghij")


@pytest.mark.parametrize(
    "entry", [{"what": "rows"}, dict.fromkeys(("what", "count", "of", "cause"), "x"), 3]
)
def test_what_is_no_fact_is_refused(entry):
    """A run.json that was changed by hand."""
    with pytest.raises(CoefficientError, match=r"run\.json: not a list of what was left out: 0"):
        left_out.loads([entry], "run.json")


QUICK = {
    "accelerometer": {},
    "accelerometer_magnitude": {},
    "bias_temperature": {},
    "fog_thermal": {"drift": {"model": "gradient_rate", "order": 1}, "denoise": {"enabled": False}},
    "gyro_noise": {},
    "gyro_pair": {},
    "gyro_triad": {},
    "inclinometer": {},
    "rate_table": {},
    "thermal": {"thermal": {"channels": ["gyro_x_dph"], "model": "level"}},
}
"""Recipes of every procedure, and tables that make their fits quick."""


@pytest.mark.parametrize("name", QUICK)
def test_excluded_rows_leave_the_numbers_of_a_log_that_was_cut(name):
    """Rows excluded at the start, within and at the end of the first log: coefficients,
    uncertainties and criteria are those of the log without these rows, digit by digit.
    """
    logs = sample_logs(name)
    file, log = next(iter(logs.items()))
    # four rows each, from a multiple of four: they are whole stations of an inclinometer
    rows, middle = len(log), len(log) // 8 * 4
    cut = log.drop(index=[*range(4), *range(middle, middle + 4), *range(rows - 4, rows)])
    ranges = ["1-4", f"{middle + 1}-{middle + 4}", f"{rows - 3}-{rows}"]
    exclude = [{"log": file, "rows": ranges, "reason": "knock", "person": "A"}]
    recipe = tomllib.loads((ROOT / "recipes" / f"{name}.toml").read_text(encoding="utf-8"))
    recipe |= {table: recipe[table] | keys for table, keys in QUICK[name].items()}
    numbers = []
    for tables, frames in ((recipe | {"exclude": exclude}, logs), (recipe, logs | {file: cut})):
        run = calibkit.fit(tables, logs=frames, runs=None, date="2026-11-21")
        stages = {stage: record.document() for stage, record in run.records.items()}
        kept = [(stage, file["models"], file["figures"]) for stage, file in stages.items()]
        numbers.append(json.dumps([kept, run.document["acceptance"]]))
    assert numbers[0] == numbers[1]
