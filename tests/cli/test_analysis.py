"""A run in Python: fitted to frames without a disk, its models, residuals, figures, and frames that
are compensated and validated as the commands do.
"""

import doctest
import re

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit import api
from calibkit.commands import analysis
from calibkit.errors import UsageError
from calibkit.readers import in_memory
from conftest import ROOT

FOG = ROOT / "datasets" / "fog_thermal"
DATE = "2026-11-21"


def frames(procedure, folder):
    """Logs of a folder as frames by their names without suffix."""
    return {path.stem: calibkit.read_log(procedure, path) for path in sorted(folder.glob("*.csv"))}


def simulated(procedure, seed):
    """Simulated logs as frames, without those to validate on."""
    logs = calibkit.simulated(procedure, seed).logs
    return {name: pd.DataFrame(dict(one)) for name, one in logs.items() if "/" not in name}


@pytest.fixture(scope="module")
def logs():
    """Return the sample ramps as frames."""
    return frames("fog_thermal", FOG)


@pytest.fixture(scope="module")
def run(logs):
    """Return the run of the sample ramps, of which nothing is written."""
    return calibkit.fit("fog_thermal", logs=logs, runs=None, date=DATE)


def test_frames_give_the_numbers_of_their_files_and_touch_no_disk(run, logs, tmp_path, monkeypatch):
    """Models, figures and verdict of frames are those of the files that they were read from; no
    file and no folder is made.
    """
    monkeypatch.chdir(tmp_path)
    again = calibkit.fit("fog_thermal", logs=logs, runs=None, date=DATE)
    assert list(tmp_path.iterdir()) == []
    disk = calibkit.fit("fog_thermal", FOG, serial="unsaved", date=DATE, runs=tmp_path / "runs")
    for name, record in disk.records.items():
        assert record.models == run.records[name].models
        assert record.figures == run.records[name].figures
        assert record.flags == run.records[name].flags
    names = [[entry["name"] for entry in one.document["inputs"]] for one in (run, disk)]
    assert names[0] == names[1]
    assert again.outcome.files == run.outcome.files
    assert in_memory._HELD == {}


def test_a_model_is_evaluated_with_its_covariance(run):
    """Value and uncertainty are those of `evaluate`; the covariance has their squares on its
    diagonal and between two inputs that of the coefficients.
    """
    at = {"temp_case_degc": [0.0, 20.0, 40.0], "temp_rate_degc_min": 5.0}
    found = run.model("drift").evaluate(**at)
    value, u = calibkit.evaluate(run, "drift", **at)
    np.testing.assert_array_equal(found.value, value)
    np.testing.assert_array_equal(found.standard_uncertainty, u)
    np.testing.assert_allclose(np.diag(found.covariance), u**2, rtol=1e-12)
    one = run.model("drift")
    at_n = {name: np.broadcast_to(values, 3) for name, values in at.items()}
    gradient = one.form.gradient(one.model, at_n)
    between = gradient[0] @ np.array(one.model.covariance) @ gradient[2]
    np.testing.assert_allclose(found.covariance[0, 2], between, rtol=1e-10)  # terms that cancel
    assert found.covariance[0, 2] < u[0] * u[2]
    with pytest.raises(calibkit.CalibkitError, match="no input temp_degc"):
        run.model("drift").evaluate(temp_case_degc=1.0, temp_degc=2.0)


def test_a_run_without_a_drift_term_says_why_it_has_none(logs):
    """Where noise is all there is, the fit's reason and the models there are stand in the error."""
    noise = np.random.default_rng(0).normal
    still = {name: log.assign(gyro_dph=noise(0.0, 1.0, len(log))) for name, log in logs.items()}
    run = calibkit.fit("fog_thermal", logs=still, runs=None, date=DATE)
    assert "things to check: run.flags>" in repr(run)
    with pytest.raises(calibkit.CalibkitError) as caught:
        run.model("drift")
    said = "no model is called 'drift': no drift term exported: gradient_rate heating: not exported"
    assert said in str(caught.value)
    assert caught.value.hint.startswith("there are: drift.ramp_cooling_01, ")


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (pd.date_range("2026-01-01", periods=2), r"2026-01-01T.* \(datetime64\)"),
        (np.array([1.0 + 1j, 2.0]), r"\(1\+1j\) \(complex128\)"),
        (None, r"None \(NoneType\)"),
        ([1.0, np.nan], r"nan \(float64\)"),
        (True, r"True \(bool_?\)"),
        (np.zeros((2, 2)), r"numbers of shape \(2, 2\)"),
    ],
    ids=str,
)
def test_an_input_that_is_no_finite_real_number_is_refused(run, given, found):
    """The message names the input, what it holds and what is expected."""
    with pytest.raises(calibkit.CalibkitError) as caught:
        run.model("drift").evaluate(temp_case_degc=given)
    assert isinstance(caught.value, UsageError)
    assert re.search(
        f"temp_case_degc holds {found}, expected finite real numbers", str(caught.value)
    )
    assert "in degC" in caught.value.hint


def test_residuals_are_a_tidy_frame_with_units(run):
    """One row per model interval, each log about its mean, rms as the report prints it."""
    left = run.residuals()
    assert list(left.columns) == ["run", "time_s", "temp_case_degc", "gyro_dph", "residual_dph"]
    assert left.attrs["units"]["residual_dph"] == "deg/h"
    assert left["run"].nunique() == 8
    assert abs(left.groupby("run")["residual_dph"].mean()).max() < 1e-12


@pytest.mark.parametrize(
    ("procedure", "column"),
    [
        ("gyro_pair", "residual_ppm"),
        ("rate_table", "residual_ppm"),
        ("accelerometer", "residual_x_g"),
        ("inclinometer", "standard_uncertainty_deg"),
        ("gyro_noise", "residual"),
        ("thermal", "residual_gyro_x_dph"),
    ],
)
def test_every_procedure_fits_frames_and_states_its_residuals(procedure, column):
    """Simulated logs as they are, no disk; figures have names of their own."""
    run = calibkit.fit(procedure, logs=simulated(procedure, 7), runs=None, date=DATE)
    left = run.residuals()
    assert np.isfinite(left[column]).all()
    assert len(left) > 10
    assert len(run.figures) == len(run.outcome.drawn.figures)
    assert all(run.figure(name).axes for name in run.figures)
    assert {"value", "unit", "standard_uncertainty"} < set(run.numbers().columns)


def test_a_frame_is_compensated_as_its_file(run, logs, tmp_path):
    """The same numbers as `calibkit apply` writes, on the frame's own index, with units."""
    path = FOG / "withheld" / "ramp_heating_03.csv"
    frame = pd.read_csv(path).set_index(pd.Index(range(7, 7 + len(pd.read_csv(path)))))
    made = run.apply(frame)
    calibkit.compensate(run, path, tmp_path / "out.csv")
    np.testing.assert_array_equal(made["gyro_dph"], pd.read_csv(tmp_path / "out.csv")["gyro_dph"])
    assert made.index.equals(frame.index)
    assert made.attrs["units"]["gyro_dph"] == "deg/h"
    assert made.attrs["flags"] == []
    holed = frame.assign(temp_case_degc=frame["temp_case_degc"].where(frame.index != 20))
    empty, kept = run.apply(holed), run.apply(holed, uncorrected="keep")
    assert np.isnan(empty.loc[20, "gyro_dph"])
    assert kept.loc[20, "gyro_dph"] == frame.loc[20, "gyro_dph"]
    assert empty.loc[20, "status"] == kept.loc[20, "status"] != ""
    assert set(empty.drop(index=20)["status"]) == {""}


def test_frames_are_validated_as_their_files(run, logs, tmp_path):
    """The figures of `calibkit validate`; what the run was fitted to is left out or refused."""
    unseen = frames("fog_thermal", FOG / "withheld")
    found = run.validate(unseen)
    written = calibkit.validate(run, FOG / "withheld", tmp_path / "v.json")
    assert found["verdict"] == written["verdict"] == "accepted"
    entries = [
        [{key: value for key, value in log.items() if key != "sha256"} for log in one["logs"]]
        for one in (found, written)
    ]
    assert entries[0] == entries[1]
    with pytest.raises(calibkit.CalibkitError, match="every log here was fitted"):
        run.validate({"again": logs["ramp_heating_05"]})


def test_a_run_of_a_folder_holds_no_residuals_and_says_how_to_have_them(tmp_path):
    """`find_run` gives models and the page; residuals and figures need the fit."""
    logs = simulated("gyro_pair", 7)
    made = calibkit.fit("gyro_pair", logs=logs, serial="P-1", runs=tmp_path, date=DATE)
    found = calibkit.find_run("P-1", tmp_path)
    assert found.model("a_about_a").model == made.model("a_about_a").model
    assert found._repr_html_() == made._repr_html_().replace(made.name, found.name)
    for ask in (found.residuals, lambda: found.figures, lambda: found.figure("gamma")):
        with pytest.raises(calibkit.CalibkitError, match="was read from its folder"):
            ask()


def test_a_recipe_is_a_dictionary_too():
    """It is the text of its tables, as strict as a file; run.json states it."""
    tables = {
        "procedure": "fog_thermal",
        "title": 'a "b" \\ ü',
        "logs": {"files": ["*"]},
        "columns": {"gyro_dph": {"from": 'rate "x"', "unit": "deg/s", "sign": -1}},
        "drift": {"rates_degc_min": {"ramp 5": np.float64(5.0)}},
        "exclude": [{"log": "a", "from_s": 1.0, "to_s": 2, "reason": "r", "person": "p"}],
    }
    source = calibkit.load_recipe(tables)
    spec = api.instruments.parse_recipe(source)
    assert spec.title == tables["title"]
    assert spec.columns["gyro_dph"].source == 'rate "x"'
    assert spec.drift.rates_degc_min == {"ramp 5": 5.0}
    assert spec.exclude[0].person == "p"
    with pytest.raises(calibkit.CalibkitError, match=r"recipe:3: unknown key 'drfit'"):
        calibkit.load_recipe({**{k: tables[k] for k in ("procedure",)}, "drfit": {}})
    with pytest.raises(calibkit.CalibkitError, match="NoneType, expected text"):
        calibkit.load_recipe(tables | {"title": None})


@pytest.mark.parametrize("module", [api, analysis], ids=lambda module: module.__name__)
def test_the_examples_of_docstrings_run_as_they_stand(module):
    """What an example prints is what it says."""
    found = doctest.testmod(module)
    assert found.attempted > 0
    assert found.failed == 0
