"""Plans of static instruments, inclinometers, pairs of gyros and records of noise."""

import json

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe
from calibkit.commands import inspection, pipeline, plans
from calibkit.instruments.inclinometer import root_choice, simulate
from calibkit.instruments.inclinometer.plan import azimuth_slopes
from calibkit.instruments.inclinometer.published import Components
from calibkit.numeric import earth
from calibkit.planning import document, equipment, search
from calibkit.planning.bench import Task
from calibkit.results.evaluation import RunResults
from conftest import ROOT, load_script

WISHES = {
    "accelerometer_magnitude": "component<=6e-5 g",
    "bias_temperature": "drift<=0.06 deg/h",
    "gyro_pair": "N<=2.1 ppm",
    "gyro_noise": "bias instability<=0.015 deg/h",
    "inclinometer": "azimuth<=0.1 deg",
}
"""Procedure → a wish that a small campaign meets."""
NEAR = {"inclinometer": 0.3, "accelerometer": 0.3}
"""How far U of measured logs may be off, where their noise is that of few closures or samples."""


@pytest.fixture(scope="module", params=list(WISHES))
def planned(request, tmp_path_factory):
    """Folder of the plan of each procedure."""
    out = tmp_path_factory.mktemp(request.param) / "plan"
    source = recipe.find(
        request.param,
        load_script(ROOT / "benchmarks" / "planned_campaigns.py").ORDERS.get(request.param, ()),
    )
    plans.plan(source, out, wishes=(WISHES[request.param],))
    return out


@pytest.fixture(scope="module")
def logs(planned, tmp_path_factory):
    """Logs of a campaign that was run by the plan."""
    out = tmp_path_factory.mktemp("logs") / "logs"
    plans.simulate(planned, out, 5)
    return out


def test_a_plan_meets_its_wish_and_its_logs_are_judged_as_it_predicted(planned, logs):
    """`check` finds nothing missing, and U is within a tenth, or what the noise is known to."""
    source = recipe.find(str(planned / "recipe.toml"))
    found = inspection.check(source, logs, planned=document.beside(planned / "recipe.toml"))
    assert not any(report.refused for report in found.logs)
    lacks = [one for one in found.judgement.lacks if "plans what is missing" not in one]
    assert not lacks
    stated = json.loads((planned / "plan.json").read_text())
    assert [one["met"] for one in stated["results"] if one["wanted"]] == [True]
    plan, spec = document.load_plan(planned), instruments.parse_recipe(source)
    instrument = instruments.find(spec.procedure)
    names = {one.log for one in plan.schedule.actions if one.log and "withheld" not in one.log}
    have = tuple(instrument.read(spec, logs, name) for name in sorted(names))
    task = Task(equipment.read_equipment(None), range_degc=stated["range_degc"], have=have)
    bench = instruments.optional(spec.procedure, "prepare_plan")(spec, task)
    judged = {one.name: one.expanded for one in search.judge(bench)}
    predicted = {one["name"]: one["expanded_uncertainty"] for one in stated["results"]}
    assert judged == pytest.approx(predicted, rel=NEAR.get(spec.procedure, 0.1))


def test_stations_of_another_day_are_added_and_fitted_with_the_first_ones(tmp_path):
    """One soak is measured: the others are planned, and both logs are fitted by the recipe."""
    request = {"wishes": (WISHES["inclinometer"],)}
    source = recipe.find("inclinometer", ("scale.order=2",))
    plans.plan(source, tmp_path / "whole", **request)
    logs = tmp_path / "logs"
    plans.simulate(tmp_path / "whole", logs, 7)
    rows = (logs / "stations.csv").read_text().splitlines()
    (logs / "stations.csv").write_text("\n".join(rows[:13]) + "\n")
    first = recipe.find(str(tmp_path / "whole" / "recipe.toml"))
    plans.plan(first, tmp_path / "rest", **{**request, "have": logs})
    plans.simulate(tmp_path / "rest", tmp_path / "added", 7)
    for path in (tmp_path / "added").glob("added_*.csv"):
        path.rename(logs / path.name)
    both = recipe.find(str(tmp_path / "rest" / "recipe.toml"))
    judged = inspection.check(both, logs).judgement
    assert judged.verdict == "accepted"
    assert not judged.lacks


@pytest.mark.parametrize(
    ("procedure", "logged"),
    [
        ("gyro_pair", True),
        ("inclinometer", True),
        ("gyro_noise", False),
        ("accelerometer_magnitude", True),
    ],
)
def test_check_states_uncertainties_of_the_fit_on_trial(procedure, logged):
    """With the temperature at which each is largest, where the result depends on it."""
    found = inspection.check(recipe.find(procedure), ROOT / "datasets" / procedure).judgement
    assert found.reached
    assert not found.predicted
    assert any("°C" in str(result) for result in found.reached) == logged


def test_check_of_few_soaks_states_what_the_fit_does(tmp_path):
    """Four soaks leave one degree of freedom to errors that a soak shares: k is 14, which a plan,
    that knows their sizes, leaves out.
    """
    rows = pd.read_csv(ROOT / "datasets" / "accelerometer" / "positions.csv", comment="#")
    soaks = np.round(rows["temp_case_degc"], -1)
    few = rows[np.isin(soaks, (-20.0, 30.0, 80.0, 130.0))].groupby(soaks).head(42)
    few.to_csv(tmp_path / "positions.csv", index=False)
    source = recipe.find("accelerometer")
    found = inspection.check(source, tmp_path).judgement
    out = tmp_path / "runs"
    run = pipeline.fit(source, tmp_path, "ACC-9", out, "2026-11-21", instruments.silent).run
    results = RunResults.read(run)
    for letter, result in zip("xyz", found.reached, strict=True):
        (corrected,) = (q for q in results.quantities if q.name == f"corrected_{letter}")
        largest = max(results.state(corrected, point).U for point in corrected.spread())
        assert result.expanded_uncertainty == pytest.approx(largest, rel=1e-12)
        assert result.coverage_factor > 10.0


def test_the_azimuth_of_a_plan_moves_with_s_and_a_turn_as_that_of_a_station_does():
    """At 45° of inclination and an azimuth of 90°, by the derivatives of the station's solution."""
    attitude = np.array([[45.0, 0.0, 90.0]])
    gravity = simulate.rotated(attitude, np.array([0.0, 0.0, 1.0])).T
    rate = simulate.rotated(attitude, earth.north_east_down(34.2)).T
    parts = Components(*gravity[:2], *rate[:2], np.zeros((1, 4, 4)))
    one = np.ones(1)
    # s = 1, whatever the root of the station
    _, slopes = root_choice.seek_with_slopes(parts, 34.2 * one, one > 0.0, 0.0 * one, one)
    of_azimuth = slopes[:, root_choice.AZIMUTH]
    by_turn, _ = root_choice.mounting_slopes(parts, of_azimuth[:, :4])
    expected = [np.degrees(of_azimuth[0, -1]), by_turn[0]]
    np.testing.assert_allclose(azimuth_slopes(34.2), expected, rtol=1e-9)
