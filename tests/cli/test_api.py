"""The public interface: twenty names that do what the commands do, loaded when they are asked
for.
"""

import contextlib
import subprocess
import sys
import threading
import typing
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
import scipy.linalg
import scipy.special
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_info, threadpool_limits

import calibkit
from calibkit.instruments.inclinometer import instrument
from conftest import ROOT
from sample_runs import sample_run

DATA = ROOT / "datasets" / "gyro_triad"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the run of a fit of the sample triad through the public interface."""
    fitted = sample_run(tmp_path_factory, "gyro_triad", ("site.latitude_deg=34.2",))
    return calibkit.find_run("S-1", fitted.folder.parents[1])


def test_every_public_name_is_there_with_a_docstring():
    """Twenty names, each documented, and dir() lists them."""
    assert len(calibkit.__all__) == 20
    assert set(calibkit.__all__) < set(dir(calibkit))
    for name in calibkit.__all__:
        assert getattr(calibkit, name).__doc__, name


def test_importing_the_package_imports_no_numpy():
    """The public names cost nothing until they are used."""
    code = "import calibkit, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_run_is_fitted_found_and_trusted(run):
    """The run that fit returns is the one that is found by serial; its files verify and load."""
    assert run.document["accepted"] is True
    assert calibkit.find_run("S-1", run.folder.parents[1]).document == run.document
    assert calibkit.verify(run.folder) == "run S-1@r001, 4 files"
    record = calibkit.load_coefficients(run.folder / "gyro_orthogonality.json")
    assert record.model("triad").value("S_xx") == pytest.approx(1e4, rel=0.05)


def test_a_log_is_examined_compensated_and_validated(run, tmp_path):
    """What the commands write, the functions write: a compensated log, a validation, findings."""
    withheld = DATA / "withheld"
    assert [report.refused for report in calibkit.examine("gyro_triad", withheld)] == [False] * 3
    calibkit.compensate(run, withheld / "about_x_40.csv", tmp_path / "x.csv")
    header = (tmp_path / "x.csv").read_text(encoding="utf-8").partition("\n")[0]
    assert header.endswith("rate_x_dps,rate_y_dps,rate_z_dps")
    document = calibkit.validate(run.folder, withheld, tmp_path / "v.json")
    assert max(log["after"]["rate_error_max_ppm_of_full_scale"] for log in document["logs"]) < 10.0


def test_a_recipe_s_settings_reach_it():
    """A double underscore is the dot; text, numbers, truth values and lists become TOML."""
    source = calibkit.load_recipe(
        "gyro_triad", site__latitude_deg=58.9, gyros=["a", "b"], title="it's"
    )
    assert source.overrides == ("site.latitude_deg=58.9", 'gyros=["a", "b"]', 'title="it\'s"')
    with pytest.raises(calibkit.CalibkitError, match="drfit"):
        calibkit.load_recipe("fog_thermal", drfit__model="auto")


def test_a_log_is_read_in_canonical_columns():
    """Every column that the recipe knows, as numbers."""
    frame = calibkit.read_log("gyro_pair", ROOT / "datasets" / "gyro_pair" / "table_axis_a.csv")
    assert {"time_s", "table_rate_dps", "gyro_a_lsb", "gyro_b_lsb"} <= set(frame.columns)
    assert len(frame) > 100


def test_rows_carry_the_number_of_their_held_condition():
    """The segments are those that check lists, by time; rows between held rates have none, and a
    record at rest has no column.
    """
    folder = ROOT / "datasets" / "gyro_pair"
    frame = calibkit.read_log("gyro_pair", folder / "table_axis_a.csv")
    held = next(
        r for r in calibkit.examine("gyro_pair", folder) if r.file == "table_axis_a.csv"
    ).held
    spans = [
        (part["time_s"].iloc[0], part["time_s"].iloc[-1], len(part))
        for _, part in frame.groupby("segment")
    ]
    assert spans == [(part.first, part.last, part.rows) for part in held]
    assert sorted(frame["segment"].dropna().unique()) == [k + 1.0 for k in range(len(held))]
    assert 0 < frame["segment"].isna().sum() < len(frame) / 2
    assert (
        "segment"
        not in calibkit.read_log(
            "gyro_noise", ROOT / "datasets" / "gyro_noise" / "static.csv"
        ).columns
    )


def test_stated_segments_and_a_log_s_own_are_numbered_as_they_are(tmp_path):
    """A pinned ramp replaces the found ones, soak around it; a log's own column stays, and a log
    too short to fit has none.
    """
    log = ROOT / "datasets" / "fog_thermal" / "ramp_heating_05.csv"
    pin = '\n[[segment]]\nlog = "ramp_heating_05"\nkind = "ramp"\nfrom_s = 640.0\nto_s = 1800.0\n'
    (tmp_path / "r.toml").write_text(
        calibkit.load_recipe("fog_thermal").text + pin, encoding="utf-8"
    )
    frame = calibkit.read_log(tmp_path / "r.toml", log)
    assert frame.loc[frame["time_s"].between(640.0, 1800.0), "segment"].unique().tolist() == [2.0]
    assert frame["segment"].iloc[[0, -1]].tolist() == [1.0, 3.0]
    lines = log.read_text(encoding="utf-8").splitlines()
    own = [lines[0] + ",segment", *(f"{line},{7 + (k > 500)}" for k, line in enumerate(lines[1:]))]
    (tmp_path / "own.csv").write_text("\n".join(own) + "\n", encoding="utf-8")
    assert set(calibkit.read_log("fog_thermal", tmp_path / "own.csv")["segment"]) == {7.0, 8.0}
    (tmp_path / "short.csv").write_text("\n".join(lines[:20]) + "\n", encoding="utf-8")
    assert "segment" not in calibkit.read_log("fog_thermal", tmp_path / "short.csv").columns


def test_the_numeric_core_s_functions_are_the_core_s(tmp_path):
    """Simulated logs carry their truth; denoising keeps the length; a missing file is a
    CalibkitError.
    """
    campaign = calibkit.simulated("gyro_pair", 1)
    assert campaign.truth["procedure"] == "gyro_pair"
    noisy = np.sin(np.arange(4000) / 500.0) + np.random.default_rng(0).normal(0.0, 0.3, 4000)
    assert np.std(calibkit.denoise(noisy).signal - np.sin(np.arange(4000) / 500.0)) < 0.06
    assert calibkit.allan_deviation(noisy, 1.0).deviation.size > 5
    with pytest.raises(calibkit.CalibkitError, match="cannot be read"):
        calibkit.load_coefficients(tmp_path / "none.json")


def test_a_model_of_a_run_is_evaluated_with_its_uncertainty(tmp_path):
    """s(T) of the sample inclinometer at two temperatures is the polynomial of its coefficients."""
    run = calibkit.fit(
        "inclinometer",
        ROOT / "datasets" / "inclinometer",
        date="2026-11-21",
        serial="I-1",
        runs=tmp_path,
    )
    value, u = calibkit.evaluate(run, "x", temp_case_degc=[30.0, 60.0])
    model = run.records["inclinometer_scale.json"].model("x")
    powers = np.vander([30.0, 60.0], len(model.coefficients), increasing=True)
    np.testing.assert_allclose(value, powers @ [c.value for c in model.coefficients], rtol=1e-14)
    expected = np.sqrt(np.diag(powers @ np.array(model.covariance) @ powers.T))
    np.testing.assert_allclose(u, expected, rtol=1e-9)
    dof = min(c.effective_dof for c in model.coefficients)
    U = run.model("x").evaluate(temp_case_degc=[30.0, 60.0]).expanded_uncertainty
    np.testing.assert_allclose(U, scipy.special.stdtrit(dof, 0.97725) * u, rtol=1e-9)
    with pytest.raises(calibkit.CalibkitError, match="no model is called 'z'; there are: "):
        calibkit.evaluate(run, "z", temp_case_degc=30.0)
    for inputs, found in (
        ({}, "'x' needs 'temp_case_degc'"),
        ({"temp_case_degc": 30.0, "temp_degc": 30.0}, "no input temp_degc; its inputs are"),
        ({"temp_case_degc": "warm"}, "x.: temp_case_degc holds warm"),
    ):
        with pytest.raises(calibkit.CalibkitError, match=found):
            calibkit.evaluate(run, "x", **inputs)


def test_functions_on_arrays_take_whatever_numpy_takes():
    """Lists, Series and narrow floats give what arrays of doubles give, and types say so."""
    rate = np.random.default_rng(0).normal(size=64).astype(np.float32)
    double = rate.astype(np.float64)
    for one in (rate, pd.Series(rate), rate.tolist()):
        found = calibkit.allan_deviation(one, 1.0, tau_s=np.array([1.0, 2.0]))
        known = calibkit.allan_deviation(double, 1.0, tau_s=[1.0, 2.0])
        np.testing.assert_array_equal(found.deviation, known.deviation)
        np.testing.assert_array_equal(calibkit.denoise(one).signal, calibkit.denoise(double).signal)
    parts = [calibkit.UncertaintyComponent(name, 0.0, 1.0, "A") for name in "ab"]
    whole = calibkit.combine_uncertainty(parts, correlation=[[1, 1], [1, 1]])
    assert whole.standard_uncertainty == pytest.approx(2.0)
    for function, names in (
        (calibkit.allan_deviation, ("rate", "tau_s")),
        (calibkit.denoise, ("signal",)),
        (calibkit.combine_uncertainty, ("correlation",)),
        (calibkit.regress, ("x", "y", "start")),
    ):
        hints = typing.get_type_hints(function)
        wide = set(typing.get_args(ArrayLike))
        assert [name for name in names if not wide <= set(typing.get_args(hints[name]))] == []


def pool_sizes():
    """Threads of each library of linear algebra."""
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.parametrize("succeeds", [True, False])
def test_linear_algebra_runs_on_one_thread_during_a_call(succeeds, monkeypatch):
    """Two threads that a program has set are one during a fit, also of fits side by side, and two
    after it, also where it fails.
    """
    during, both = [], threading.Barrier(2, timeout=60.0)
    read = instrument.copies.refuse_copies

    def watched(logs):
        both.wait()
        during.extend(pool_sizes())
        if not succeeds:
            raise calibkit.CalibkitError("no fit", hint="none")
        return read(logs)

    def fit():
        with contextlib.nullcontext() if succeeds else pytest.raises(calibkit.CalibkitError):
            calibkit.fit("inclinometer", ROOT / "datasets" / "inclinometer", runs=None)

    monkeypatch.setattr(instrument.copies, "refuse_copies", watched)
    with threadpool_limits(limits=2, user_api="blas"), ThreadPoolExecutor(2) as threads:
        before = pool_sizes()
        list(threads.map(lambda _: fit(), range(2)))
        assert pool_sizes() == before
    assert set(before) == {2}
    assert set(during) == {1}
