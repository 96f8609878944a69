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
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError, StoppedError
from calibkit.fleet import device, files, keys, local, run, server, table
from calibkit.instruments.bias import figures
from calibkit.records import atomic, clock, store
from cli import quick_device
from cli.fleet_units import DAY, RECIPE, fit, fleet_logs, left_over, tree, unit_log
from conftest import ROOT, slow_after, write_log
from sample_runs import sample_run


@pytest.fixture
def quick(monkeypatch):
    """Units are fitted without their figures, here and in other processes."""
    monkeypatch.setattr(figures, "draw", figures.draw)  # restored after the test
    monkeypatch.setattr(run, "fit_device", quick_device.outcome)


def coefficients(out, serial, revision=1):
    """p0 and p1 of a unit's run, whose digests are checked on the way."""
    record = store.load(out / serial / f"r{revision:03d}").records["bias.json"]
    return [entry.value for entry in record.model("gyro_dph").coefficients]


@pytest.mark.slow
def test_a_fleet_survives_killed_processes(tmp_path, quick):
    """With a process killed after 10 and after 40 units all 60 have one run, correct, and nothing
    is half written.
    """
    logs = fleet_logs(tmp_path / "units", 60)

    def killing(items, what):
        for number, item in enumerate(items):
            if number in {10, 40}:
                os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)
            yield item

    done = fit(tmp_path / "units", tmp_path / "runs", jobs=2, progress=killing)
    assert [entry.serial for entry in done.table.entries] == sorted(logs)
    assert {entry.run for entry in done.table.entries} == {"r001"}
    assert done.exit_code == 0
    for serial, (temperature, gyro) in logs.items():
        names = {path.name for path in (tmp_path / "runs" / serial).iterdir()}
        unfinished = {name for name in names if name.startswith(atomic.UNFINISHED)}
        assert names - unfinished == {".highest-r001", "r001"}
        # powers of a temperature around 40 °C lose 3 digits of 16
        np.testing.assert_allclose(
            coefficients(tmp_path / "runs", serial),
            np.polynomial.polynomial.polyfit(temperature, gyro, 1),
            rtol=1e-11,
        )


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


def test_processes_that_share_a_machine_take_one_thread_each(tmp_path, monkeypatch):
    """Whatever the environment says, a process of the fleet multiplies with one thread; the
    environment stays.
    """
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    plan = device.DeviceTask(recipe.Source("bias.toml", RECIPE), tmp_path, tmp_path, DAY)
    assert [
        said.message for said in local.fit_devices(quick_device.threads, plan, ["A", "B"], 2)
    ] == [
        "1",
        "1",
    ]
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"


@pytest.mark.skipif(not server.COPIES, reason="processes begin anew on this system")
def test_processes_begin_with_what_they_need_and_with_this_calibkit(tmp_path):
    """A process, copied of one that has a single thread, has imported what draws figures from the
    code that hired it.
    """
    plan = device.DeviceTask(recipe.Source("bias.toml", RECIPE), tmp_path, tmp_path, DAY)
    said = [
        outcome.message for outcome in local.fit_devices(quick_device.imported, plan, ["A", "B"], 2)
    ]
    assert said == [f"True {atomic.__file__} 1"] * 2


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


def test_a_fleet_without_a_date_takes_that_of_the_logs(tmp_path):
    """The last row of each unit's logs; today where logs carry no dates; a second call fits
    nothing again, and fleet.json states the latest date.
    """
    for number, first in enumerate(("2024-05-01", "2024-06-01", None)):
        folder = tmp_path / "units" / f"U{number:03d}"
        unit_log(folder, number)
        if first:
            head, *rows = (folder / "warmup.csv").read_text().splitlines()
            stamped = [
                f"{first} 08:00:{k:02d},{row.split(',', 1)[1]}" for k, row in enumerate(rows)
            ]
            (folder / "warmup.csv").write_text("\n".join([head, *stamped, ""]))
    text = RECIPE.replace("[polynomials]", 'format = "text"\n[polynomials]')
    done = fit(tmp_path / "units", tmp_path / "runs", text=text, date="")
    dates = [store.load(tmp_path / "runs" / f"U{k:03d}" / "r001") for k in range(3)]
    found = [run.document["effective_from"] for run in dates]
    assert found == ["2024-05-01", "2024-06-01", clock.date_or_today(None)]
    assert json.loads((done.folder / "fleet.json").read_text())["effective_from"] == found[2]
    assert fit(tmp_path / "units", tmp_path / "runs", text=text, date="").before == 3


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


def test_a_unit_that_two_take_up_at_once_is_fitted_once(tmp_path, quick):
    """The second waits for the first and finds its run, as when a worker that was taken for dead is
    not.
    """
    fleet_logs(tmp_path / "units", 1)
    plan = device.DeviceTask(
        recipe.Source("bias.toml", RECIPE), tmp_path / "units", tmp_path / "runs", DAY
    )
    plan.out.mkdir()
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(quick_device.outcome, [plan, plan], ["U000", "U000"]))
    assert sorted((row.run, row.before) for row in found) == [("r001", False), ("r001", True)]


def broken(data, serial):
    """Make a unit whose log cannot be read."""
    (data / serial).mkdir(parents=True)
    (data / serial / "warmup.csv").write_text(
        "time_s,temp_case_degc,gyro_dph\n1,2\n", encoding="utf-8"
    )


def test_bad_data_end_a_fleet_with_the_units_own_error(tmp_path, quick):
    """Without --keep-going the first unit that cannot be fitted is named, with its code; no table
    is written.
    """
    fleet_logs(tmp_path / "units", 2)
    broken(tmp_path / "units", "A-1")
    with pytest.raises(CalibkitError, match=r"A-1: warmup.csv:2: .*--keep-going") as stopped:
        fit(tmp_path / "units", tmp_path / "runs")
    assert stopped.value.exit_code == 3
    assert not (tmp_path / "runs" / store.FLEETS).exists()


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


@pytest.mark.skipif(sys.platform == "win32", reason="no groups of processes to interrupt")
def test_the_keyboard_ends_a_fleet_that_has_just_begun_with_one_line(tmp_path):
    """Interrupted while its processes still import, all of them at once as by a terminal, the
    command alone says so.
    """
    fleet_logs(tmp_path / "units", 2)
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    arguments = ["fleet", "bias.toml", "--data", "units", "--jobs", "2", "--verbose"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [sys.executable, "-m", "calibkit", *arguments],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        while not (tmp_path / "runs").exists():
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.005)
        os.killpg(process.pid, signal.SIGINT)
        said = process.stderr.read()
        assert process.wait() == 130
    assert len(said.strip().splitlines()) == 1, said
    assert "interrupted" in said
    assert left_over(tmp_path / "runs") == []


@pytest.mark.skipif(not server.COPIES, reason="processes are not copies of one here")
def test_a_process_whose_parent_sends_it_no_task_ends_in_silence():
    """Interrupted between the request for a process and its task, the parent alone says so."""
    script = """if __name__ == "__main__":
    import os
    from multiprocessing import forkserver
    from calibkit.fleet import server

    context, pipes = server.context(), []

    def interrupted(descriptors, connect=forkserver.connect_to_new_process):
        pipes.extend(connect(descriptors))
        raise KeyboardInterrupt

    forkserver.connect_to_new_process = interrupted
    try:
        context.Process(target=print).start()
    except KeyboardInterrupt:
        os.close(pipes[1])
    print(forkserver.read_signed(pipes[0]) > 0, forkserver.read_signed(pipes[0]))
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=True,
        text=True,
    )
    assert (done.stdout, done.stderr) == ("True 1\n", "")


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


def test_a_copied_folder_with_other_line_ends_is_seen_too(tmp_path, quick):
    """The values are the same, the bytes are not: copied logs; a unit of which one log of two is
    another's is none.
    """
    fleet_logs(tmp_path / "units", 3)
    text = (tmp_path / "units" / "U001" / "warmup.csv").read_text(encoding="utf-8")
    (tmp_path / "units" / "U009").mkdir()
    (tmp_path / "units" / "U009" / "warm.csv").write_bytes(text.replace("\n", "\r\n").encode())
    shutil.copy(
        tmp_path / "units" / "U000" / "warmup.csv", tmp_path / "units" / "U002" / "second.csv"
    )
    done = fit(tmp_path / "units", tmp_path / "runs")
    verdicts = {entry.serial: entry.verdict for entry in done.table.entries}
    assert verdicts == {
        "U000": "no verdict",
        "U001": "copied logs",
        "U002": "no verdict",
        "U009": "copied logs",
    }
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


RATES = """procedure = "rate_table"
gyros = ["x"]
[logs]
files = ["*.csv"]
[acceptance]
max_nonlinearity_ppm = 1000.0
"""


def test_a_rejected_unit_makes_exit_code_1(tmp_path, calibkit):
    """A gyro that loses 1 % at its highest rate is rejected, the other accepted; the fleet says so
    with exit code 1.
    """
    for serial, loss in (("G-1", 0.0), ("G-2", 0.01)):
        rate = np.repeat([-50.0, -20.0, -10.0, 10.0, 20.0, 50.0], 30)
        counts = 1000.0 * rate * (1.0 - loss * (rate == 50.0)) + np.tile([0.0, 1.0, -1.0], 60)
        write_log(
            tmp_path / "units" / serial / "run.csv",
            time_s=np.arange(rate.size) * 1.0,
            table_rate_dps=rate,
            gyro_x_lsb=counts,
        )
    (tmp_path / "rates.toml").write_text(RATES, encoding="utf-8")
    out = calibkit(
        "fleet", tmp_path / "rates.toml", data=tmp_path / "units", out=tmp_path / "r", jobs=1
    )
    assert out.code == 1, out.err
    assert "2 devices: 1 accepted, 1 rejected" in out.out
    assert "rejected: G-2@r001" in out.out
    assert "G-1@" not in out.out


def test_a_dry_run_finds_what_the_fleet_will_and_writes_nothing(tmp_path, quick):
    """Every unit, digest, verdict and outlier is that of the run that follows; no folder, no lock,
    nothing is there.
    """
    fleet_logs(tmp_path / "units", 12)
    unit_log(tmp_path / "units" / "U007", 7, offset=2.0)
    broken(tmp_path / "units", "A-1")
    shutil.copytree(tmp_path / "units" / "U001", tmp_path / "units" / "U020")
    before = tree(tmp_path)
    rehearsed = fit(tmp_path / "units", tmp_path / "runs", jobs=2, keep_going=True, dry_run=True)
    assert not (tmp_path / "runs").exists()
    assert tree(tmp_path) == before
    done = fit(tmp_path / "units", tmp_path / "runs", jobs=2, keep_going=True)
    assert rehearsed.table.entries == done.table.entries
    assert [(outlier.serial, outlier.figure) for outlier in rehearsed.table.outliers] == [
        (outlier.serial, outlier.figure) for outlier in done.table.outliers
    ]
    assert len(done.table.outliers) > 0
    assert (
        (rehearsed.exit_code, rehearsed.folder) == (done.exit_code, done.folder) == (3, done.folder)
    )


def test_a_dry_run_of_a_fleet_that_is_finished_in_part_says_what_is_left(tmp_path, quick, calibkit):
    """What was fitted before, what would be fitted, with which recipe, to which logs; a whole fleet
    is told as it is.
    """
    data, out = tmp_path / "units", tmp_path / "runs"
    fleet_logs(data, 2)
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    call = [
        "fleet",
        tmp_path / "bias.toml",
        "--data",
        data,
        "--out",
        out,
        "--date",
        DAY,
        "--jobs",
        1,
        "--dry-run",
    ]
    fit(data, out)
    assert calibkit(*call).out.splitlines()[-1] == str(out / "_fleet" / "r001")
    unit_log(data / "U001", 77)
    unit_log(data / "U002", 2)
    before = tree(out)
    told = calibkit(*call)
    assert told.code == 0
    assert told.out.splitlines() == [
        "3 devices: 3 no verdict; 1 fitted before",
        "U000@r001: was fitted before to warmup.csv",
        "U001@r002: would be fitted with bias.toml to warmup.csv",
        "U002@r001: would be fitted with bias.toml to warmup.csv",
        # one warm-up cannot show how turn-on biases differ
        "3 flags in 3 runs: see their reports",
        f"{out / '_fleet' / 'r002'} (dry run: not written)",
    ]
    said = calibkit(*call, "--json").json
    assert said["dry_run"] is True
    assert [(entry["logs"], entry["before"]) for entry in said["units"]] == [
        (["warmup.csv"], True),
        (["warmup.csv"], False),
        (["warmup.csv"], False),
    ]
    assert tree(out) == before
    broken(data, "A-1")
    stopped = calibkit(*call)
    assert stopped.code == 3
    assert "nothing was written; --keep-going" in stopped.err
    assert calibkit(*call, "--out", data / "U000" / "warmup.csv" / "runs").code == 2
    assert calibkit(*call, "--out", tmp_path / "bias.toml" / "runs").code == 4


def test_json_names_the_units_that_failed(tmp_path, calibkit):
    """One document on stdout, with an error where a unit has no calibration."""
    fleet_logs(tmp_path / "units", 1)
    broken(tmp_path / "units", "A-1")
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    call = (
        "fleet",
        tmp_path / "bias.toml",
        "--data",
        tmp_path / "units",
        "--out",
        tmp_path / "r",
        "--jobs",
        1,
        "--json",
    )
    stopped = calibkit(*call)
    assert (stopped.code, stopped.json["error"]["code"]) == (3, "log_format")
    kept = calibkit(*call, "--keep-going")
    assert kept.code == 3
    assert kept.json["ok"] is False
    assert kept.json["error"]["message"] == "1 of 2 devices have no calibration of their own"
    assert [entry["verdict"] for entry in kept.json["units"]] == ["failed", "no verdict"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--data", "none"], 2, "no such folder"),
        (["--data", "empty"], 3, "holds no sub-folder"),
        (["--data", "units", "--out", "units/runs"], 2, "lies in --data"),
        (["--data", "units", "--out", "units"], 2, "lies in --data"),
        (
            ["--data", "units", "--jobs", "2", "--cluster", "tcp://127.0.0.1:1"],
            2,
            "one or the other",
        ),
        (["--data", "units", "--jobs", "0"], 2, "jobs"),
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


def test_every_procedure_has_key_figures():
    """A procedure that is new must say what is compared from unit to unit."""
    assert [
        name for name in instruments.SHIPPED if not instruments.optional(name, "KEY_FIGURES")
    ] == []


@pytest.mark.parametrize("procedure", ["accelerometer", "gyro_pair", "inclinometer", "rate_table"])
def test_the_key_figures_of_a_procedure_are_there(tmp_path, calibkit, procedure):
    """Each pattern of a procedure names something in the run of its sample logs."""
    logs = ROOT / "datasets" / procedure
    assert calibkit("fit", procedure, "--data", logs, "--serial", "S", "--out", tmp_path).code in {
        0,
        1,
    }
    patterns = instruments.optional(procedure, "KEY_FIGURES")
    names = [
        figure.name
        for figure in keys.select_key_figures(store.load(tmp_path / "S" / "r001"), patterns, 25.0)
    ]
    for pattern in patterns:
        assert any(keys.re.fullmatch(pattern, name) for name in names), pattern


def test_figures_of_different_forms_or_units_are_not_compared():
    """A coefficient of another form, or in another unit, is another column that says so."""
    rows = [
        device.Row(
            f"S{k}",
            "r001",
            "",
            "no verdict",
            (keys.KeyFigure("drift.b0", form, unit_of, None, float(k), 0.1),),
            ({"name": f"{k}.csv", "sha256": str(k)},),
            (),
            0,
            before=False,
        )
        for k, (form, unit_of) in enumerate(
            [("level/1", "deg/h"), ("lagged/1", "deg/h"), ("level/1", "deg/s")]
        )
    ]
    made = table.build_table(rows[::-1], ROOT)
    assert [chart.name for chart in made.charts] == [
        "drift.b0 (level/1)",
        "drift.b0 (lagged/1)",
        "drift.b0 (level/1)",
    ]
    assert [chart.unit for chart in made.charts] == ["deg/h", "deg/h", "deg/s"]
    assert [chart.values.size for chart in made.charts] == [1, 1, 1]
    assert len(set(files._flat_table(made).to_csv().splitlines()[0].split(","))) == 12


@pytest.mark.slow
def test_the_screen_of_200_devices_names_who_stands_out_and_the_page_has_them_all(
    tmp_path, quick, calibkit
):
    """At most 25 lines: totals, the outlier with its worst key value in units beside the others;
    fleet.html has a line per device and a mark per device and key value, and loads nothing.
    """
    fleet_logs(tmp_path / "units", 200)
    unit_log(tmp_path / "units" / "U007", 7, offset=2.0)
    for number in range(40):
        broken(tmp_path / "units", f"A-{number}")
    (tmp_path / "bias.toml").write_text(RECIPE, encoding="utf-8")
    call = ("fleet", tmp_path / "bias.toml", "--data", tmp_path / "units", "--out", tmp_path / "r")
    out = calibkit(*call, "--date", DAY, "--jobs", 1, "--keep-going")
    lines = out.out.splitlines()
    assert len(lines) <= 25
    assert lines[0].startswith("240 devices: 40 failed, 200 no verdict")
    assert "36 more: --details" in lines
    (named,) = [line for line in lines if line.startswith("U007: ")]
    assert re.search(
        r"key values stand out, worst bias\.gyro_dph\S* .*deg/h, others [-\d.]+ to [-\d.]+$", named
    )
    page = (tmp_path / "r" / "_fleet" / "r001" / "fleet.html").read_text(encoding="utf-8")
    assert f"Report: {tmp_path / 'r' / '_fleet' / 'r001' / 'fleet.html'}" in lines
    assert all(f">U{number:03d}</th>" in page for number in range(200))
    assert "U007: 2 key values" in page or named in page
    assert re.findall(r"https?:|url\(|<link|<img", page) == []
    full = calibkit(*call, "--date", DAY, "--jobs", 1, "--keep-going", "--details").out
    assert full.count("failed: A-") == 40


def test_key_values_stand_in_one_order_however_a_run_is_read(tmp_path_factory):
    """A run that was just fitted has its files in the order of stages, one that is read in that of
    their names: the table of a fleet was another the second time.
    """
    run = store.load(sample_run(tmp_path_factory, "gyro_pair").folder)
    turned = replace(run, records=dict(reversed(run.records.items())))
    names = [
        [figure.name for figure in keys.select_key_figures(one, (".+",), 25.0)]
        for one in (run, turned)
    ]
    assert names[0] == names[1]
