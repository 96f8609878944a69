"""What the compensated rate of a gyro is said to be uncertain by: in the fit's report, along a log,
and in a validation.
"""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.errors import FitError
from calibkit.instruments.bias import compensate, compensate as uncertainty, forms
from calibkit.instruments.bias.numeric import bank
from calibkit.instruments.bias.numeric.published import DriftBlocks
from calibkit.numeric import gum
from calibkit.numeric.thermal import evaluate
from calibkit.recipe import TypeB
from calibkit.records import store
from calibkit.records.coefficients import Coefficient, Model, StageResult
from calibkit.report import budget
from outputs.firmware_runs import cached

TERMS = """
[[type_b]]
name = "thermometer"
quantity = "temp_case_degc"
unit = "K"
standard_uncertainty = 0.2
dof = 5
[[type_b]]
name = "scale"
quantity = "gyro_dph"
unit = "deg/h"
half_width = 0.003
[[type_b]]
name = "elsewhere"
quantity = "gravity_mps2"
unit = "m/s^2"
half_width = 0.001
"""


@pytest.fixture(scope="module")
def run(campaign, tmp_path_factory):
    """Return the run of a fit with type B terms, and its folder of runs."""
    from calibkit.instruments import silent

    folder = tmp_path_factory.mktemp("runs")
    source = recipe.Source(
        "mine.toml",
        recipe.find("fog_thermal").text.replace('model = "auto"', 'model = "lagged"') + TERMS,
    )
    outcome = pipeline.fit(source, campaign, "F", folder, "2026-11-21", silent)
    return store.load(outcome.run.folder), folder


def thermal(found):
    """Thermal model of a run."""
    (model,) = found.records["drift_rate.json"].models
    return forms.read_thermal(model)


# files


def test_a_file_of_before_the_degrees_of_freedom_is_read_with_infinite_ones_and_flagged(run):
    """Without model_error_dof the model is the same but for infinite degrees of freedom and a flag
    that says so.
    """
    (whole,) = run[0].records["drift_rate.json"].models
    older = replace(
        whole, parameters=tuple(p for p in whole.parameters if p.name != "model_error_dof")
    )
    new, old = forms.read_thermal(whole), forms.read_thermal(older)
    assert (new.model_error_dof, new.flags) == (whole.value("model_error_dof"), ())
    assert math.isfinite(new.model_error_dof)
    assert (old.model_error_dof, old.flags) == (math.inf, (forms.UNKNOWN_DOF,))
    assert (old.model_error, old.coefficients.tolist()) == (
        new.model_error,
        new.coefficients.tolist(),
    )


# numbers


def test_expansion_along_a_log_is_the_combination_at_each_point():
    """Three contributions at 40 points: u, effective degrees of freedom and U as `combine` gives
    them, to 1e-12.
    """
    rng = np.random.default_rng(1)
    values, dof = rng.exponential(1.0, (3, 40)), np.array([4.0, 12.0, np.inf])
    values[:, 0] = 0.0
    found = np.array(gum.expand_along(values, dof)).T
    for point, column in zip(found[1:], values.T[1:], strict=True):
        parts = [
            gum.UncertaintyComponent("x", 0.0, u, "A", dof=d)
            for u, d in zip(column, dof, strict=True)
        ]
        one = gum.combine(parts)
        assert point == pytest.approx(
            (one.standard_uncertainty, one.effective_dof, one.expanded_uncertainty), rel=1e-12
        )
    assert found[0].tolist() == [0.0, math.inf, 0.0]


def test_expansion_along_a_log_refuses_less_than_one_degree_of_freedom():
    """An interval cannot be stated from less than one effective degree of freedom."""
    with pytest.raises(FitError, match="effective degrees of freedom"):
        gum.expand_along(np.ones((1, 2)), np.array([0.5]))


def test_a_thermometer_that_is_off_moves_the_compensated_rate_by_the_drift_s_slope(run):
    """The type B part of the thermometer is the change of the drift where the case reads 0.2 K
    more, within 2 %.
    """
    model = thermal(run[0])
    time = np.arange(0.0, 4000.0, 10.0)
    case = np.interp(time, [600.0, 3000.0], [-10.0, 40.0])
    (term,) = instruments.parse_recipe(
        recipe.Source("r", recipe.find("fog_thermal").text + TERMS)
    ).type_b[:1]
    still = np.zeros_like(time)
    drift_model = compensate.DriftModel((), model, 10.0, "recursive", 25.0)
    blocks = DriftBlocks(time, case, still, still, still)
    found = uncertainty.along_blocks(drift_model, blocks, (term,))
    moved, still = (bank.evaluate(model, time, case + by, case).drift for by in (0.2, 0.0))
    values = np.array([part for _, _, part, _ in found.contributions])
    assert values[-1] == pytest.approx(np.abs(moved - still), rel=0.02, abs=1e-5)
    assert found.standard == pytest.approx(np.sqrt(np.sum(values**2, axis=0)), rel=1e-12)


def test_a_coefficient_that_a_term_names_gets_a_combined_uncertainty():
    """K with 3 ppm type A of 8 degrees of freedom and 4 ppm of the table: 5 ppm, 8 · 5⁴/3⁴ = 61.7
    degrees, k = 2.
    """
    model = Model(
        "a", "gyro-scale/1", (Coefficient("K", 2.0, "1", 6e-6),), ((3.6e-11,),), 8, 0.0, "1", {}
    )
    term = TypeB(name="table", quantity="K", unit="ppm", standard_uncertainty=4.0)
    (entry,) = budget.combine_results([StageResult("gyro_scale", models=(model,))], [term], ())
    assert entry["standard_uncertainty"] == pytest.approx(1e-5, rel=1e-12)
    assert entry["effective_dof"] == pytest.approx(8.0 * 5.0**4 / 3.0**4, rel=1e-12)
    assert entry["expanded_uncertainty"] == pytest.approx(2e-5, rel=1e-12)
    assert entry["result"] == "gyro_scale: a.K"


# what a run says


def test_a_run_states_every_component_of_the_drift_it_takes_off(run):
    """run.json: u² is the sum of the squared components, U = k u, and k is Student's where degrees
    of freedom are few.
    """
    document = run[0].document
    entries = document["uncertainty"]
    assert len(entries) >= 6 + len(document["inputs"])
    for entry in entries:
        parts = [part["standard_uncertainty"] for part in entry["components"]]
        assert entry["standard_uncertainty"] == pytest.approx(math.hypot(*parts), rel=1e-12)
        assert entry["expanded_uncertainty"] == pytest.approx(
            entry["coverage_factor"] * entry["standard_uncertainty"], rel=1e-12
        )
        dof = math.inf if entry["effective_dof"] is None else entry["effective_dof"]
        assert entry["coverage_factor"] == pytest.approx(
            gum.coverage_factor(dof) if dof < 30 else 2.0, rel=1e-9
        )
    names = {part["name"] for part in entries[0]["components"]}
    assert {"coefficients", "model error on ramps left out", "thermometer", "scale"} <= names
    assert any("do not enter the compensated rate: elsewhere" in flag for flag in document["flags"])


# along a log


def rows_of(path):
    """Rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_apply_adds_the_uncertainty_where_it_is_asked_for(run, calibkit, campaign, tmp_path):
    """Without the key the columns are those of the log; with it one more, which the type B terms
    are in.
    """
    log, runs = campaign / "withheld/ramp_heating_03.csv", run[1]
    for name, more in (("plain", []), ("more", ["--set", "output.rate_uncertainty=true"])):
        done = calibkit("apply", "F", *more, runs=runs, data=log, out=tmp_path / f"{name}.csv")
        assert done.code == 0
    plain, more = rows_of(tmp_path / "plain.csv"), rows_of(tmp_path / "more.csv")
    assert list(plain[0]) == list(rows_of(log)[0])
    assert list(more[0]) == [*plain[0], "gyro_standard_uncertainty_dph"]
    assert [row["gyro_dph"] for row in plain] == [row["gyro_dph"] for row in more]
    u = np.array([float(row["gyro_standard_uncertainty_dph"]) for row in more])
    assert np.all((u > 0.003 / math.sqrt(3.0)) & (u < 0.1))
    assert u.max() > 1.3 * u.min()


# validation


def test_at_rest_a_hysteresis_is_in_its_middle_and_its_spread_in_every_uncertainty(
    tmp_path_factory,
):
    """Warm-up over, play operators in the middle: the same drift in the table of the run, from the
    file and by `at_rest`; U covers both ends of the hysteresis.
    """
    fitted = cached("grown", tmp_path_factory)
    (written,) = fitted.record("drift_rate.json").models
    model = forms.read_thermal(written)
    spread = abs(sum(c.value for c in written.coefficients if c.name.startswith("h")))
    ends = model.valid.temperature
    drift_model = compensate.DriftModel.read(fitted.run.records, fitted.spec)
    stated = uncertainty.state_along_logs(drift_model, [], ())
    assert {one["temp_case_degc"] for one in stated} >= set(ends)
    for one in stated:
        degc = one["temp_case_degc"]
        expected = bank.at_rest(model, degc)[0] - bank.at_rest(model, 25.0)[0]
        at = {forms.CASE: np.array([degc])}
        assert one["value"] == pytest.approx(expected, abs=1e-12)
        assert one["expanded_uncertainty"] > spread
        assert forms.BANK.standard_uncertainty(written, at)[0] > spread / math.sqrt(3.0)
    turned = forms.BANK.standard_uncertainty(written, at | {forms.RATE: np.ones(1)})[0]
    assert turned == pytest.approx(model.model_error, abs=spread / 50.0)


def test_what_a_hysteresis_was_before_a_log_is_unknown_until_it_has_turned(tmp_path_factory):
    """Ramps up and down by 50 °C: half the spread at first, nothing after the full width."""
    model = forms.read_thermal(
        cached("grown", tmp_path_factory).record("drift_rate.json").models[0]
    )
    time = np.arange(0.0, 6000.0, 10.0)
    case = 30.0 + 25.0 * np.sin(time / 950.0)
    found = bank.evaluate(model, time, case, case)
    spread = model.bank.hysteresis(model.coefficients)
    assert spread > 0.01  # °/h
    assert found.unknown_start[0] == pytest.approx(spread)
    assert found.unknown_start[-1] == 0.0
    parts = {name: values for name, _, values, _ in evaluate.contributions(model, found)}
    assert parts["hysteresis of what was before"][0] == pytest.approx(spread / math.sqrt(3.0))
    starts = [
        bank.evaluate(model, np.arange(-9e4, 6000.0, 10.0), np.concatenate([came, case]), case)
        for came in (np.linspace(60.0, 30.0, 9000), np.linspace(-40.0, 30.0, 9000))
    ]
    apart = np.abs(starts[0].drift[9000:] - starts[1].drift[9000:])
    assert apart[0] > spread / 10.0
    assert np.all(apart <= 2.0 * found.unknown_start + 0.05)


def test_a_log_s_coverage_is_stated_about_its_mean_and_absolutely(
    run, calibkit, campaign, tmp_path
):
    """A withheld log as it is lies within U both ways; with 0.5 °/h added to every row it is within
    U about its mean alone, and the offset is flagged.
    """
    _, folder = run
    log = min((campaign / "withheld").glob("*.csv"))
    header, *rows = log.read_text().splitlines()
    place = header.split(",").index("gyro_dph")
    moved = tmp_path / "moved"
    moved.mkdir()
    lines = [row.split(",") for row in rows]
    for row in lines:
        row[place] = f"{float(row[place]) + 0.5:.6f}"
    (moved / log.name).write_text("\n".join([header, *map(",".join, lines)]) + "\n")
    found, said = [], []
    for data in (campaign / "withheld", moved):
        out = tmp_path / f"{data.name}.json"
        done = calibkit("validate", "F", runs=str(folder), data=str(data), out=str(out))
        entries = {log["name"]: log["uncertainty"] for log in json.loads(out.read_text())["logs"]}
        found.append(entries[log.name])
        said.append(done.out + done.err)
    right, wrong = found
    same = "share_within_expanded_uncertainty"
    assert right[same] == pytest.approx(wrong[same])
    assert right["share_within_absolutely"] > 0.9 > wrong["share_within_absolutely"]
    assert wrong["offset"] - right["offset"] == pytest.approx(0.5, abs=1e-4)
    assert "off the rate at rest of the fit" in said[1]
    assert "off the rate at rest of the fit" not in said[0]
