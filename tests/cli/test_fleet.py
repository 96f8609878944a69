"""Fleets: every unit once, whatever dies on the way; the same table whoever fitted it; who is not
like the others.
"""

import csv
import io
import json
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from calibkit.errors import StoppedError
from calibkit.fleet import device, run
from calibkit.instruments.bias import figures
from calibkit.records import atomic, store
from cli import quick_device
from cli.fleet_units import DAY, RECIPE, fit, fleet_logs, left_over, tree, unit_log
from conftest import ROOT, slow_after


@pytest.fixture
def quick(monkeypatch):
    """Units are fitted without their figures, here and in other processes."""
    monkeypatch.setattr(figures, "draw", figures.draw)  # restored after the test
    monkeypatch.setattr(run, "fit_device", quick_device.outcome)


def coefficients(out, serial, revision=1):
    """p0 and p1 of a unit's run, whose digests are checked on the way."""
    record = store.load(out / serial / f"r{revision:03d}").records["bias.json"]
    return [entry.value for entry in record.model("gyro_dph").coefficients]


def test_a_unit_killed_while_its_run_is_written_is_written_whole_by_another(
    tmp_path, quick, monkeypatch
):
    """Killed between files and rename, a run is neither there in part nor lost; its remains go the
    day after.
    """
    fleet_logs(tmp_path / "units", 6)
    monkeypatch.setattr(run, "fit_device", quick_device.killed_while_writing)
    done = fit(tmp_path / "units", tmp_path / "runs", jobs=2)
    assert (tmp_path / "units" / "U003.killed").exists()
    assert {entry.run for entry in done.table.entries} == {"r001"}
    (left,) = left_over(tmp_path / "runs")
    assert left.name.startswith(atomic.UNFINISHED)
    assert store.load(tmp_path / "runs" / "U003" / "r001").name == "U003@r001"


def test_a_unit_that_kills_every_process_is_given_up_and_the_others_are_not(
    tmp_path, quick, monkeypatch
):
    """After three processes a unit is failed, with exit code 70; the others have their runs."""
    fleet_logs(tmp_path / "units", 5)
    monkeypatch.setattr(run, "fit_device", quick_device.poisonous)
    done = fit(tmp_path / "units", tmp_path / "runs", jobs=2, keep_going=True)
    verdicts = {entry.serial: entry.verdict for entry in done.table.entries}
    assert verdicts == {f"U{k:03d}": "failed" if k == 2 else "no verdict" for k in range(5)}
    assert done.exit_code == 70


@pytest.mark.slow
@pytest.mark.drawn
def test_a_killed_fleet_goes_on_where_it_was(tmp_path, calibkit):
    """Killed (-9) as a whole and called again, it fits what is missing, nothing twice, and ends as
    if never killed.
    """
    fleet_logs(tmp_path / "units", 8)
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    out = tmp_path / "killed"
    call = ["fleet", tmp_path / "bias.toml", "--data", tmp_path / "units", "--date", DAY]
    command = [sys.executable, "-m", "calibkit", *map(str, call), "--out", str(out), "--jobs", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE) as process:
        while not len(list(out.glob("U*/r001"))) >= 3:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.01)
        process.kill()
    finished = {path: path.stat().st_ino for path in out.glob("U*/r001")}
    assert 3 <= len(finished) < 8
    again = calibkit(*call, "--out", out, "--jobs", "1", "--json")
    assert again.code == 0, again.out
    assert again.json["fitted_before"] >= len(finished)
    assert {path: path.stat().st_ino for path in finished} == finished
    whole = tmp_path / "whole"
    assert calibkit(*call, "--out", whole, "--jobs", "2").code == 0
    assert tree(out) == tree(whole)


@pytest.mark.drawn
def test_a_unit_of_a_fleet_is_to_the_byte_what_a_fit_of_it_alone_writes(tmp_path, calibkit):
    """Coefficients, reports and digests of two units by two processes are those of `calibkit fit`,
    one after the other.
    """
    fleet_logs(tmp_path / "units", 2)
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    fit(tmp_path / "units", tmp_path / "fleet", jobs=2)
    for serial in ("U000", "U001"):
        call = (
            "--data",
            tmp_path / "units" / serial,
            "--serial",
            serial,
            "--out",
            tmp_path / "alone",
            "--date",
            DAY,
        )
        assert calibkit("fit", tmp_path / "bias.toml", *call).code == 0
        assert tree(tmp_path / "fleet" / serial) == tree(tmp_path / "alone" / serial)


def test_a_finished_fleet_called_again_writes_nothing(tmp_path, quick):
    """Every unit is found as it was fitted, and the table that is there already is not written
    again.
    """
    fleet_logs(tmp_path / "units", 3)
    first = fit(tmp_path / "units", tmp_path / "runs")
    before = tree(tmp_path / "runs")
    (tmp_path / "runs" / "U001" / f"{atomic.UNFINISHED}killed").mkdir()
    second = fit(tmp_path / "units", tmp_path / "runs")
    assert (first.before, second.before) == (0, 3)
    assert second.folder == first.folder
    assert tree(tmp_path / "runs") == before


@pytest.mark.parametrize(
    "changed", slow_after(2, ["recipe", "date", "a log", "another log", "the run", "the software"])
)
def test_a_unit_is_fitted_again_when_anything_it_rests_on_has_changed(
    tmp_path, quick, monkeypatch, changed
):
    """Another recipe, date, log or software makes r002 of the units concerned; a run that was
    touched is not believed.
    """
    fleet_logs(tmp_path / "units", 3)
    fit(tmp_path / "units", tmp_path / "runs")
    text, date, again = RECIPE, DAY, {"U000", "U001", "U002"}
    if changed == "recipe":
        text = RECIPE.replace("order = 1", "order = 2")
    elif changed == "date":
        date = "2026-11-22"
    elif changed == "the software":
        monkeypatch.setattr(device, "SOFTWARE", "calibkit 99")
    elif changed == "the run":
        path, again = tmp_path / "runs" / "U001" / "r001" / "run.json", set()
        path.write_text(
            path.read_text(encoding="utf-8").replace("Bias of many", "Bias of none"),
            encoding="utf-8",
        )
    else:
        again = {"U001"}
        unit_log(tmp_path / "units" / "U001", 77)
        if changed == "another log":
            (tmp_path / "units" / "U001" / "warmup.csv").rename(
                tmp_path / "units" / "U001" / "second.csv"
            )
            unit_log(tmp_path / "units" / "U001", 1)
    done = fit(tmp_path / "units", tmp_path / "runs", text=text, date=date, keep_going=True)
    if changed == "the run":
        assert {entry.serial for entry in done.table.entries if entry.verdict == "failed"} == {
            "U001"
        }
        assert done.exit_code == 4
    assert {path.parent.name for path in (tmp_path / "runs").glob("U*/r002")} == again


def broken(data, serial):
    """Make a unit whose log cannot be read."""
    (data / serial).mkdir(parents=True)
    (data / serial / "warmup.csv").write_text(
        "time_s,temp_case_degc,gyro_dph\n1,2\n", encoding="utf-8"
    )


def test_keep_going_fits_the_others_and_tells_what_is_wrong_with_each(tmp_path, quick):
    """A unit with bad data, one without logs and one whose folder is no serial are rows of the
    table; exit code 3.
    """
    data = tmp_path / "units"
    fleet_logs(data, 3)
    broken(data, "A-1")
    (data / "A-2").mkdir()
    (data / "bad name").mkdir()
    (data / ".hidden").mkdir()
    done = fit(data, tmp_path / "runs", jobs=2, keep_going=True)
    rows = list(
        csv.DictReader(io.StringIO((done.folder / "fleet.csv").read_text(encoding="utf-8")))
    )
    assert [row["serial"] for row in rows] == ["A-1", "A-2", "U000", "U001", "U002", "bad name"]
    assert [row["verdict"] for row in rows] == ["failed", "failed", *["no verdict"] * 3, "failed"]
    errors = [row["error"] for row in rows]
    assert errors[0].startswith("log_format: warmup.csv:2")
    assert errors[1].startswith("frame: A-2: no log matches")
    assert errors[5].startswith("usage: serial 'bad name'")
    assert str(tmp_path) not in "".join(errors)
    assert done.exit_code == 3


def test_an_interrupted_fleet_says_how_far_it_came(tmp_path, quick):
    """The keyboard ends a fleet with code 130; what was finished stays, and no process does."""
    fleet_logs(tmp_path / "units", 6)

    def interrupted(items, what):
        yield items[0]
        yield items[1]
        raise KeyboardInterrupt

    with pytest.raises(StoppedError, match="interrupted after 2 of 6 devices") as stopped:
        fit(tmp_path / "units", tmp_path / "runs", jobs=2, progress=interrupted)
    assert stopped.value.exit_code == 130
    assert len(list((tmp_path / "runs").glob("U*/r001"))) >= 2
    assert left_over(tmp_path / "runs") == []
    assert multiprocessing.active_children() == []


def test_a_copied_folder_of_logs_is_nobodys_calibration(tmp_path, quick):
    """Two units with the same bytes: one has the other's coefficients, so neither verdict is
    believed; exit code 3.
    """
    fleet_logs(tmp_path / "units", 3)
    shutil.copytree(tmp_path / "units" / "U001", tmp_path / "units" / "U009")
    done = fit(tmp_path / "units", tmp_path / "runs")
    verdicts = {entry.serial: (entry.verdict, entry.error[-4:]) for entry in done.table.entries}
    assert verdicts["U001"] == ("copied logs", "U009")
    assert verdicts["U009"] == ("copied logs", "U001")
    assert verdicts["U000"] == ("no verdict", "")
    assert done.exit_code == 3


def test_the_unit_that_is_not_like_the_others_is_named_everywhere(tmp_path, quick):
    """One gyro 2 °/h off among 20 is the outlier of the table, of the record and of the chart; the
    others are not.
    """
    fleet_logs(tmp_path / "units", 20)
    unit_log(tmp_path / "units" / "U007", 7, offset=2.0)
    done = fit(tmp_path / "units", tmp_path / "runs")
    named = [(outlier.serial, outlier.figure) for outlier in done.table.outliers]
    assert named == [("U007", "bias.gyro_dph at 25 degC"), ("U007", "bias.gyro_dph.p0")]
    rows = list(
        csv.DictReader(io.StringIO((done.folder / "fleet.csv").read_text(encoding="utf-8")))
    )
    assert [row["serial"] for row in rows if row["outlier_in"]] == ["U007"]
    record = json.loads((done.folder / "fleet.json").read_text(encoding="utf-8"))
    schema = json.loads(
        (ROOT / "docs" / "schemas" / "calibkit-fleet-2.schema.json").read_text(encoding="utf-8")
    )
    pytest.importorskip("jsonschema").Draft202012Validator(schema).validate(record)
    at_reference = record["figures"][0]
    values = np.array([float(row["bias.gyro_dph at 25 degC [deg/h]"]) for row in rows])
    assert at_reference["centre"] == np.median(values)
    assert at_reference["sigma"] == pytest.approx(
        np.median(np.abs(values - np.median(values))) / 0.6744897501960817, rel=1e-12
    )
    assert [outlier["serial"] for outlier in at_reference["outliers"]] == ["U007"]
    page = (done.folder / "fleet.html").read_text(encoding="utf-8")
    assert re.search(r"<h3[^>]*>Control charts</h3>.*<svg.*</svg>", page, re.DOTALL)


def test_the_table_holds_what_the_coefficient_files_hold(tmp_path, quick):
    """CSV gives every number of the files to the last bit, with its unit and uncertainty."""
    fleet_logs(tmp_path / "units", 3)
    done = fit(tmp_path / "units", tmp_path / "runs")
    rows = list(
        csv.DictReader(io.StringIO((done.folder / "fleet.csv").read_text(encoding="utf-8")))
    )
    for row in rows:
        record = store.load(tmp_path / "runs" / row["serial"] / row["run"]).records["bias.json"]
        for entry in record.model("gyro_dph").coefficients:
            name = f"bias.gyro_dph.{entry.name}"
            assert float(row[f"{name} [{entry.unit}]"]) == entry.value
            assert float(row[f"u({name}) [{entry.unit}]"]) == entry.standard_uncertainty


def test_verify_says_whether_a_fleets_files_are_what_they_were(tmp_path, quick, calibkit):
    """The folder verifies as it was written; with one byte changed, one file more or one less it
    does not.
    """
    fleet_logs(tmp_path / "units", 2)
    folder = fit(tmp_path / "units", tmp_path / "runs").folder
    found = calibkit("verify", folder)
    assert (found.code, "fleet of 2 devices" in found.out) == (0, True)
    table_of, charts = folder / "fleet.csv", folder / "fleet.html"
    before = table_of.read_bytes()
    table_of.write_bytes(before.replace(b"no verdict", b"accepted!"))
    assert calibkit("verify", folder).code == 4
    table_of.write_bytes(before)
    (folder / "note.txt").touch()
    assert calibkit("verify", folder).code == 4
    (folder / "note.txt").unlink()
    assert calibkit("verify", folder).code == 0
    charts.unlink()
    assert calibkit("verify", folder).code == 4


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--data", "none"], 2, "no such folder"),
        (["--data", "empty"], 3, "holds no sub-folder"),
        (["--data", "units", "--out", "units"], 2, "lies in --data"),
        (
            ["--data", "units", "--jobs", "2", "--cluster", "tcp://127.0.0.1:1"],
            2,
            "one or the other",
        ),
        (["--data", "units", "--set", "polynomials.bias=3"], 2, "polynomials.bias"),
        (["--data", "named"], 2, "serial '-x' cannot name a folder"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_is_fitted(
    tmp_path, calibkit, monkeypatch, arguments, code, said
):
    """Absent folders, runs among the units, misspelt recipes and impossible serials."""
    monkeypatch.chdir(tmp_path)
    fleet_logs(tmp_path / "units", 1)
    fleet_logs(tmp_path / "named", 1)
    (tmp_path / "named" / "-x").mkdir()
    (tmp_path / "empty").mkdir()
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    outcome = calibkit("fleet", "bias.toml", *arguments)
    assert outcome.code == code
    assert said in outcome.err
    assert not list(tmp_path.rglob("r001"))
