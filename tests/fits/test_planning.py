"""Information of a planned campaign, the search for designs, and the files of a plan."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from calibkit import instruments, recipe
from calibkit.cli import cli
from calibkit.commands import inspection, plans
from calibkit.errors import CoefficientError, RecipeError, UsageError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import predict
from calibkit.planning import (
    bench as planning_bench,
    document,
    equipment,
    schedule,
    search,
)
from calibkit.planning.bench import Design, Predicted, Task
from calibkit.planning.exchange import Pool
from calibkit.planning.schedule import Action, Clock, Schedule
from calibkit.planning.search import choose, find_front
from conftest import ROOT, load_script

SCHEMA = json.loads((ROOT / "docs" / "schemas" / "calibkit-plan-1.schema.json").read_text())
LOW_ORDERS = (
    *("affine.scale_order=1", "affine.cross_order=0", "affine.bias_order=1"),
    *("k.scale_order=1", "k.zero_order=1"),
)
"""A triad of few coefficients, whose plan is found in a second."""


def quadratic(levels):
    """Information [c, 3, 3] of single readings of a parabola."""
    rows = np.vander(levels, 3, increasing=True)
    return np.einsum("ci,cj->cij", rows, rows)


def load_benchmark(name):
    """Module of a benchmark."""
    return load_script(ROOT / "benchmarks" / f"{name}.py")


def judge(folder, campaigns, run):
    """Predicted over actual u, its standard error and the coverage, by the benchmark."""
    benchmark = load_benchmark("planned_campaigns")
    plan = document.load_plan(folder)
    return benchmark.judge(plan, campaigns, getattr(benchmark, run), first=100)


@pytest.fixture
def rng():
    """Random numbers of a stated seed."""
    return np.random.default_rng(23)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The sample bench with dwells of one length, so that a search is short, with gyros of the
    order that simulated ones have, and with the 18 directions to the faces and edges of a cube.
    """
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    spots = [[0, 0], [180, 0], *([90, roll] for roll in range(0, 360, 45))]
    spots += [[tilt, roll] for tilt in (45, 135) for roll in range(0, 360, 90)]
    text = equipment.sample_text()
    for found, made in (("dwell_s = [60, 120, 300]", "dwell_s = [60]"), ("order = 2", "order = 1")):
        assert found in text
        text = text.replace(found, made)
    text += f"\n[attitudes.cube]\nmove_s = 60.0\nspots = {spots}\n"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def planned(tmp_path_factory, bench):
    """Folder of a small plan."""
    out = tmp_path_factory.mktemp("planned") / "plan"
    request = {
        "wishes": ("inclination<=0.012 deg",),
        "range_degc": (-20.0, 60.0),
        "attitudes": "cube",
        "equipment": bench,
    }
    plans.plan(recipe.find("accelerometer", LOW_ORDERS), out, **request)
    return out


def soak_errors(labels, loading, size, effect="zero"):
    """An error that rows of a soak share."""
    loading = np.asarray(loading).reshape(len(labels), -1)
    return Shared(
        group="soak", effect=effect, level=labels, loading=loading, unit="g", size=size, size_dof=20
    )


def test_a_prediction_is_that_of_generalised_least_squares(rng):
    """With V written out, (Xᵀ V⁻¹ X)⁻¹ is the same, and the shares of all sources add up to it."""
    design = rng.normal(size=(30, 4))
    labels = np.arange(30) // 6
    shared = [
        soak_errors(labels, np.ones(30), 0.7),
        soak_errors(labels, rng.normal(size=(30, 2)), 0.2, "scale"),
    ]
    unknown = replace(shared[0], effect="unknown", size=None, optional=True)
    noise = np.full(30, 0.3)
    fit = predict(lambda p: design @ p, np.zeros(4), [*shared, unknown], noise=noise)
    variance = np.diag(noise**2)
    for error in shared:
        same = error.level[:, None] == error.level
        variance += error.size**2 * same * (error.loading @ error.loading.T)
    expected = np.linalg.inv(design.T @ np.linalg.solve(variance, design))
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-9)
    slopes = rng.normal(size=(7, 4))
    parts = planning_bench.split_variance(fit, slopes)
    assert set(parts) == {"noise", "zero of the soak", "scale of the soak"}
    np.testing.assert_allclose(
        planning_bench.total_variance(parts),
        np.einsum("mp,pq,mq->m", slopes, expected, slopes),
        rtol=1e-9,
    )


def test_the_search_is_as_good_as_trying_every_design(rng):
    """Parabola, four of nine levels: at least 0.98 of the best of all 126 designs."""
    levels = np.linspace(-1.0, 1.0, 9)
    parts = quadratic(levels)
    pool = Pool(np.zeros((3, 3)), parts, parts.mean(axis=0))
    best = min(pool.criterion(one) for one in itertools.combinations(range(9), 4))
    chosen, value = pool.search(4, rng, 3)
    assert len(set(chosen)) == 4
    assert best / value >= 0.98


def test_the_search_is_as_good_as_the_designs_of_a_library(rng):
    """By the mean variance: D-optimal designs of pyDOE3 for a cubic surface of two factors."""
    doe = pytest.importorskip("pyDOE3.doe_optimal")
    grid = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 7), repeat=2)))
    rows = doe.build_design_matrix(grid, 3)
    design, _ = doe.optimal_design(grid, 14, 3, "D", "fedorov")
    theirs = doe.build_design_matrix(design, 3)
    parts = np.einsum("ci,cj->cij", rows, rows)
    pool = Pool(np.zeros((10, 10)), parts, parts.mean(axis=0), most_uses=14)
    value = pool.search(14, rng, 5)[1]
    variance = np.sum(np.linalg.inv(theirs.T @ theirs) * pool.target)
    assert variance / value >= 1.0 - 1e-9


def test_the_sample_bench_is_an_equipment_file():
    """What --print-equipment prints is read, and its soaks are those of the longest lag."""
    bench = equipment.read_equipment(None)
    device = bench.known_device("accelerometer")
    assert bench.fastest(device) == 3.0
    # 1080 s ln(54 °C (1 − e^(−55/18)) / 0.3 °C), in whole minutes
    assert bench.soak_s(device, 165.0, 3.0) == 5580.0
    assert bench.soak_s(device, 0.0, 3.0) == 0.0


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ("high_degc = 180.0", "high_degc = 10.0"),
        ('component = [\n  { group = "soak"', 'component = [\n  { grup = "soak"'),
        ("move_s = 40.0", "move_s = -1.0"),
    ],
)
def test_a_fault_of_an_equipment_file_is_named(found, expected):
    """Strict, as a recipe."""
    text = equipment.sample_text()
    assert found in text
    with pytest.raises(RecipeError, match=r"bench\.toml"):
        equipment.read_equipment(recipe.Source("bench.toml", text.replace(found, expected)))


def test_mounting_takes_its_hours_before_the_first_action():
    """At room temperature, with a person; an empty schedule mounts nothing."""
    table = equipment.read_equipment(None)
    person = table.operator.model_copy(update={"mount_h": 1.5})
    table = table.model_copy(update={"operator": person})
    assert Clock(table).schedule().actions == ()
    clock = Clock(table)
    clock.ramp(-40.0, 3.0)
    found = clock.schedule()
    assert [(one.action, one.start_s) for one in found.actions] == [("mount", 0), ("ramp", 5400)]
    assert found.actions[0].set_degc == 25.0
    assert found.operator_h == 1.5


def test_the_choice_is_the_cheapest_that_meets_the_wishes_or_the_best_within_hours():
    """And where none meets them, the one that comes nearest."""
    tried = [
        Design(
            str(h),
            Schedule((Action(0.0, "wait", 25.0, duration_s=3600.0 * h),)),
            (),
            None,
            results={"a": Predicted("a", "g", u, 2.0 * u, {})},
        )
        for h, u in ((1, 9), (2, 5), (3, 6), (4, 3))
    ]
    assert choose(tried, {"a": 10.0}, None, "a").hours == 2
    assert choose(tried, {}, 3.5, "a").hours == 2
    assert choose(tried, {"a": 1.0}, 3.0, "a").hours == 2
    assert [one.hours for one in find_front(tried, "a")] == [1, 2, 4]


def test_a_plan_can_be_carried_out_and_judged(planned):
    """Whole degrees, one temperature more than the order needs, a return to the first one, and
    attitudes that are withheld.
    """
    found = document.load_plan(planned)
    soaks = [one.set_degc for one in found.schedule.actions if one.action == "soak"]
    assert soaks[0] == soaks[-1]
    assert len(set(soaks)) == 3
    assert all(degc == round(degc) for degc in soaks)
    logs = {one.log for one in found.schedule.recorded("dwell")}
    assert logs == {"positions.csv", "withheld/positions.csv"}
    starts = [one.start_s for one in found.schedule.actions]
    ends = [one.end_s for one in found.schedule.actions]
    assert all(b >= a - 1e-6 for a, b in zip(ends, starts[1:], strict=False))


def test_plan_json_is_as_its_schema_says_and_sealed(planned, tmp_path):
    """A changed schedule is refused, and so is a changed document."""
    text = (planned / "plan.json").read_text(encoding="utf-8")
    Draft202012Validator(SCHEMA).validate(json.loads(text))
    result = json.loads(text)["results"][0]
    assert result["met"]
    assert sum(one["share"] for one in result["limits"]) == pytest.approx(1.0)
    assert CliRunner().invoke(cli, ["verify", str(planned / "plan.json")]).exit_code == 0
    for name in document.PLAN, document.SCHEDULE, document.RECIPE:
        (tmp_path / name).write_bytes((planned / name).read_bytes())
    changed = (tmp_path / "schedule.csv").read_text().replace("60,positions", "61,positions")
    (tmp_path / "schedule.csv").write_text(changed)
    with pytest.raises(CoefficientError, match=r"schedule\.csv"):
        document.load_plan(tmp_path)


def test_the_logs_of_a_plan_are_fitted_by_its_recipe(planned, tmp_path):
    """What the fit states is what was predicted, within a third: few dwells show their noise."""
    logs, runs = tmp_path / "logs", tmp_path / "runs"
    plans.simulate(planned, logs, 3)
    arguments = ["fit", str(planned / "recipe.toml"), "--data", str(logs), "--serial", "A-1"]
    done = CliRunner().invoke(cli, [*arguments, "--out", str(runs)], standalone_mode=False)
    assert done.return_value == 0, done.output
    made = json.loads((runs / "A-1" / "r001" / "accel_affine.json").read_text(encoding="utf-8"))
    fitted = {one["name"]: one["standard_uncertainty"] for one in made["models"][0]["coefficients"]}
    plan = json.loads((planned / "plan.json").read_text(encoding="utf-8"))
    ratio = [fitted[one["name"]] / one["standard_uncertainty"] for one in plan["coefficients"]]
    assert 0.75 < np.median(ratio) < 1.33


def test_a_wish_that_cannot_be_met_exits_1_with_what_can(tmp_path):
    """Noise and turn-on biases are larger, whatever the ramps."""
    arguments = ["plan", "fog_thermal", "--want", "drift<=0.001 deg/h", f"--out={tmp_path / 'p'}"]
    done = CliRunner().invoke(cli, arguments, standalone_mode=False)
    assert done.return_value == 1, done.output
    lines = done.output.splitlines()
    assert lines[1].startswith("cannot be met: U of drift 0.0")
    assert len(lines) <= 25
    assert not json.loads((tmp_path / "p" / "plan.json").read_text())["results"][0]["met"]


@pytest.mark.parametrize(
    ("procedure", "options", "expected"),
    [
        ("thermal", {}, "campaigns of 'thermal' are not planned"),
        ("accelerometer", {"range_degc": (60.0, -20.0)}, "--range"),
        ("accelerometer", {"attitudes": "crane"}, "no [attitudes.crane]"),
        ("accelerometer", {"wishes": ("azimuth<=1 deg",)}, "no result 'azimuth'"),
        ("accelerometer", {"wishes": ("component<=1 rpm",)}, "'rpm' is no unit of 'component'"),
        ("fog_thermal", {"have": Path("no_such_folder")}, "--have no_such_folder: no such folder"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line(procedure, options, expected, tmp_path):
    """Before anything is searched."""
    with pytest.raises(UsageError) as refused:
        plans.plan(recipe.find(procedure), tmp_path / "plan", **options)
    assert expected in refused.value.message
    assert "\n" not in refused.value.message
    assert not (tmp_path / "plan").exists()


@pytest.fixture(scope="module")
def planned_runs(tmp_path_factory, bench):
    """Folder of a plan of a rate table."""
    out = tmp_path_factory.mktemp("planned") / "plan"
    request = {
        "wishes": ("scale factor<=1.5 ppm",),
        "range_degc": (-40.0, 60.0),
        "equipment": bench,
    }
    plans.plan(recipe.find("rate_table"), out, **request)
    return out


def test_a_plan_of_a_rate_table_spans_the_rates_and_the_range(planned_runs):
    """Both ways, one temperature more than the order needs, a return, a withheld run."""
    plan = document.load_plan(planned_runs)
    Draft202012Validator(SCHEMA).validate(dict(plan.document))
    held = plan.schedule.recorded("rate")
    fitted = [one for one in held if not one.log.startswith("withheld")]
    rates = sorted({one.table_rate_dps for one in fitted})
    assert rates == [-rate for rate in reversed(rates)]
    assert rates[-1] == 100.0
    assert len(rates) >= 10
    degc = list(dict.fromkeys((one.log, one.set_degc) for one in fitted))
    temperatures = [one for _, one in degc]
    assert temperatures[0] == temperatures[-1] == -40.0
    assert set(temperatures) >= {-40.0, 25.0, 60.0}
    assert len(set(temperatures)) == plan.document["device"]["order"] + 2
    assert {one.log for one in held} - {one.log for one in fitted}


def test_runs_of_a_plan_are_fitted_by_its_recipe(planned_runs, tmp_path):
    """What the fit states of K is what was predicted, within a third."""
    logs, runs = tmp_path / "logs", tmp_path / "runs"
    plans.simulate(planned_runs, logs, 3)
    arguments = ["fit", str(planned_runs / "recipe.toml"), "--data", str(logs), "--serial", "G-1"]
    done = CliRunner().invoke(cli, [*arguments, "--out", str(runs)], standalone_mode=False)
    assert done.return_value == 0, done.output
    model = json.loads((runs / "G-1" / "r001" / "gyro_scale.json").read_text())["models"][0]
    K = model["coefficients"][0]
    plan = json.loads((planned_runs / "plan.json").read_text(encoding="utf-8"))
    predicted = plan["coefficients"][0]["standard_uncertainty"]
    assert 0.75 < 1e6 * K["standard_uncertainty"] / K["value"] / predicted < 1.33


def test_what_is_measured_counts_and_the_cheapest_addition_is_planned(planned, bench, tmp_path):
    """A campaign that was stopped after two of its temperatures."""
    logs = tmp_path / "logs"
    plans.simulate(planned, logs, 3)
    lines = (logs / "positions.csv").read_text().splitlines()
    (logs / "positions.csv").write_text("\n".join(lines[: 1 + 2 * (len(lines) // 4)]) + "\n")
    request = {
        "wishes": ("inclination<=0.012 deg",),
        "range_degc": (-20.0, 60.0),
        "attitudes": "cube",
        "equipment": bench,
        "have": logs,
    }
    source = recipe.find("accelerometer", LOW_ORDERS)
    found = plans.plan(source, tmp_path / "plan", **request).proposal
    whole = document.load_plan(planned)
    assert found.campaign.hours < 0.75 * whole.schedule.hours
    assert found.campaign.expanded("inclination") <= 0.012


def test_errors_that_dwells_share_are_no_noise_of_a_plan_from_their_run(planned, tmp_path):
    """Residuals hold both; the plan assumes the shared errors beside the noise."""
    plans.simulate(planned, tmp_path / "logs", 4)
    spec = instruments.parse_recipe(recipe.find(str(planned / "recipe.toml")))
    fitted = instruments.find("accelerometer").fit(
        spec, tmp_path / "logs", ["positions.csv"], instruments.silent
    )
    earlier = {f"{one.stage}.json": one for one in fitted.results}
    (triad,) = earlier["accel_affine.json"].models
    noise = [one.value for one in triad.parameters if one.name.startswith("noise_")]
    task = Task(equipment.read_equipment(None), earlier=earlier)
    device = instruments.optional("accelerometer", "prepare_plan")(spec, task).device
    assert device.noise == pytest.approx(np.sqrt(np.mean(np.square(noise))))
    assert device.noise < triad.residual_rms


def test_check_holds_logs_against_the_schedule_beside_the_recipe(planned, tmp_path):
    """Two dwells and the withheld log are missing."""
    logs, path = tmp_path / "logs", planned / "recipe.toml"
    plans.simulate(planned, logs, 4)
    found = document.beside(path)
    assert found is not None
    source = recipe.find(str(path))
    before = inspection.check(source, logs, planned=found).judgement.lacks
    assert not any("dwell" in lack for lack in before)
    lines = (logs / "positions.csv").read_text().splitlines(keepends=True)
    (logs / "positions.csv").write_text("".join([*lines[:3], *lines[4:-1]]))
    (logs / "withheld" / "positions.csv").unlink()
    lacks = inspection.check(source, logs, planned=found).judgement.lacks[len(before) :]
    assert len(lacks) == 3
    assert all("dwell" in lack for lack in lacks)
    assert lacks[2].startswith("withheld/positions.csv: planned, with ")
    assert document.beside(tmp_path / "recipe.toml") is None


@pytest.fixture(scope="module")
def planned_ramps(tmp_path_factory):
    """Folder of a plan of ramps."""
    out = tmp_path_factory.mktemp("planned") / "plan"
    plans.plan(recipe.find("fog_thermal"), out, within_h=7.0)
    return out


def test_a_plan_of_ramps_keeps_its_hours_and_withholds_one(planned_ramps):
    """Each log is a soak, a ramp and a soak, heating and cooling by turns."""
    plan = document.load_plan(planned_ramps)
    Draft202012Validator(SCHEMA).validate(dict(plan.document))
    assert plan.schedule.hours <= 7.0
    logs = dict.fromkeys(one.log for one in plan.schedule.actions if one.log)
    senses = []
    for log in logs:
        own = [one for one in plan.schedule.actions if one.log == log]
        assert [one.action for one in own] == ["soak", "ramp", "soak"]
        senses.append(own[1].ramp_degc_per_min > 0.0)
    assert senses == [k % 2 == 0 for k in range(len(senses))]
    assert [log for log in logs if log.startswith("withheld/")] == [list(logs)[-1]]


def test_angles_over_three_axes_are_predicted_with_their_mountings(tmp_path):
    """Each axis is a mounting in working hours; what the fit states is what was predicted."""
    folder = tmp_path / "plan"
    plans.plan(recipe.find("gyro_triad"), folder, wishes=("angle<=0.002 deg",))
    plan = document.load_plan(folder)
    mountings = [one.start_s / 3600.0 for one in plan.schedule.actions if one.action == "remount"]
    assert len(mountings) == 2
    assert all(hour % 24.0 <= 8.5 for hour in mountings)
    predicted = {one["name"]: one["standard_uncertainty"] for one in plan.document["coefficients"]}
    assert min(predicted.values()) > np.sqrt(2.0) * 0.0005
    near = [one for one in plan.schedule.actions if one.set_degc == 25.0]
    near = schedule.Schedule(tuple(one for one in near if not one.log.startswith("withheld")))
    spec = instruments.parse_recipe(plan.source)
    simulate = instruments.optional("gyro_triad", "simulate_plan")
    made = simulate(spec, near, plan.device, 3)
    for name, content in made.files().items():
        (tmp_path / name).write_bytes(content)
    found = instruments.find("gyro_triad").fit(
        spec, tmp_path, sorted(made.logs), instruments.silent
    )
    figures = [one for result in found.results for one in result.figures]
    u = {one.name: one.standard_uncertainty for one in figures}
    for name, size in predicted.items():
        assert u[name] == pytest.approx(size, rel=0.05)


def run_cli(*arguments):
    """Output of a command that succeeds, or the exit code that is asked for."""
    return CliRunner().invoke(cli, [*map(str, arguments)], standalone_mode=False)


def copy_logs(names, source, out):
    """Copy some of the sample logs."""
    out.mkdir(exist_ok=True)
    for name in names:
        (out / Path(name).name).write_bytes((ROOT / "datasets" / source / name).read_bytes())
    return out


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """Runs of the sample logs of a gyro in a chamber and on a rate table."""
    runs = tmp_path_factory.mktemp("runs")
    for procedure, serial in (("fog_thermal", "FOG-0001"), ("rate_table", "GYRO-0001")):
        data = ROOT / "datasets" / procedure
        done = run_cli("fit", procedure, "--data", data, "--serial", serial, "--out", runs)
        assert done.return_value == 0, done.output
    return runs


def test_a_plan_of_ramps_takes_noise_and_turn_on_biases_from_an_earlier_run(earlier, tmp_path):
    """The simulated gyro has 0.6 °/h over 1 s, turn-on biases of 0.02 °/h, a drift of 0.4 °/h."""
    asked = {"within_h": 8.0, "earlier": "FOG-0001", "runs": earlier}
    found = plans.plan(recipe.find("fog_thermal"), tmp_path / "plan", **asked).proposal
    size = {one.effect: one.value for one in found.bench.device.component}
    assert found.bench.device.noise == pytest.approx(0.6, rel=0.05)
    assert size["drift"] == pytest.approx(0.4, rel=0.1)
    assert size["turn-on"] == pytest.approx(0.02, rel=0.6)
    assert found.campaign.hours <= 8.0


def test_a_triad_is_completed_about_each_axis(tmp_path):
    """Each temperature needs a run about each axis: of y one is missing, of z all are."""
    names = [f"about_x_{degc}.csv" for degc in (-40, 0, 25, 60)]
    names += [f"about_y_{degc}.csv" for degc in (-40, 0, 25)]
    logs = copy_logs(names, "gyro_triad", tmp_path / "logs")
    asked = {"wishes": ("angle<=0.004 deg",), "have": logs}
    found = plans.plan(recipe.find("gyro_triad"), tmp_path / "plan", **asked).proposal
    held = {one.log: one.set_degc for one in found.campaign.schedule.recorded("rate")}
    fitted = {log: degc for log, degc in held.items() if "withheld" not in log}
    about = {axis: {d for log, d in fitted.items() if f"_{axis}_" in log} for axis in "xyz"}
    assert about == {"x": set(), "y": {60.0}, "z": {-40.0, 0.0, 25.0, 60.0}}
    spec = instruments.parse_recipe(recipe.find(str(tmp_path / "plan" / "recipe.toml")))
    assert {spec.find_axis(log) for log in fitted} == {"y", "z"}
    # a pattern that matches no log would be refused
    assert spec.logs.files[-2:] == ("added_about_y_*.csv", "added_about_z_*.csv")


@pytest.mark.parametrize("procedure", ["accelerometer", "inclinometer"])
def test_dwells_of_a_plan_of_0_2_have_the_noise_that_it_states(procedure):
    """Of the mean over a dwell, whatever its length."""
    plan = document.load_plan(ROOT / "tests" / "golden" / "0.2" / procedure / "plan")
    settings, dwell = plan.document["settings"], plan.schedule.recorded("dwell")[0]
    stated = settings.get("noise_g", settings.get("noise_dph"))
    assert plan.device.noise_of(dwell.duration_s) == pytest.approx(stated)


@pytest.mark.parametrize("procedure", ["accelerometer", "fog_thermal", "rate_table", "gyro_triad"])
def test_check_states_the_uncertainty_of_each_planned_procedure(procedure):
    """By the fit on trial."""
    found = inspection.check(recipe.find(procedure), ROOT / "datasets" / procedure).judgement
    assert found.reached
    assert all(one.expanded_uncertainty > 0.0 for one in found.reached)


def test_simulated_logs_have_the_columns_that_the_recipe_maps(bench, tmp_path):
    """Name, unit and sign; what is no plain CSV is refused."""
    path = tmp_path / "mine.toml"
    path.write_text(
        'procedure = "rate_table"\ngyros = ["x"]\n[logs]\nfiles = ["*.csv"]\n'
        '[columns.table_rate_dps]\nfrom = "rate (deg/h)"\nsign = -1\n'
        '[columns.temp_case_degc]\nfrom = "T"\nunit = "K"\n'
    )
    plans.plan(recipe.find(str(path)), tmp_path / "plan", equipment=bench)
    logs = tmp_path / "logs"
    plans.simulate(tmp_path / "plan", logs, 3)
    beside = document.beside(tmp_path / "plan" / "recipe.toml")
    source = recipe.find(str(tmp_path / "plan" / "recipe.toml"))
    found = inspection.check(source, logs, planned=beside)
    assert not any(report.refused for report in found.logs)
    assert not any("rate" in lack for lack in found.judgement.lacks)
    binary = recipe.find(str(path), ("logs.rate_hz=1",))
    plans.plan(binary, tmp_path / "other", equipment=bench)
    with pytest.raises(UsageError, match=r"\[logs\] rate_hz"):
        plans.simulate(tmp_path / "other", tmp_path / "none", 3)


@pytest.mark.parametrize("folder", ["planned", "planned_runs", "planned_ramps"])
def test_a_plan_is_judged_by_its_logs_as_it_predicted(folder, bench, request, tmp_path):
    """With the same assumed errors, of what was run as planned: within a tenth."""
    path = request.getfixturevalue(folder)
    plan, logs = document.load_plan(path), tmp_path / "logs"
    plans.simulate(path, logs, 6)
    spec = instruments.parse_recipe(plan.source)
    instrument = instruments.find(spec.procedure)
    names = [name for name in sorted({one.log for one in plan.schedule.actions}) if name]
    have = [instrument.read(spec, logs, name) for name in names if "withheld" not in name]
    text = bench.read_text(encoding="utf-8")
    table = equipment.read_equipment(recipe.Source("bench.toml", text))
    task = Task(table, range_degc=tuple(plan.document["range_degc"]), have=tuple(have))
    bench = instruments.optional(spec.procedure, "prepare_plan")(spec, task)
    judged = {one.name: one.expanded for one in search.judge(bench)}
    predicted = {one["name"]: one["expanded_uncertainty"] for one in plan.document["results"]}
    assert judged == pytest.approx(predicted, rel=0.1)
