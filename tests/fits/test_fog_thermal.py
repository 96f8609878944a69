"""The thermal-drift pipeline end to end: logs in, run folder out, used again."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.errors import FitError
from calibkit.instruments.bias import fog_thermal as instrument, simulate_fog as simulator
from calibkit.records import store
from conftest import AUTHORITIES, ROOT, slow_after
from sample_runs import sample_run

CAMPAIGN = ROOT / "datasets" / "fog_thermal"
VECTOR = json.loads((AUTHORITIES / "fog_drift.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a runs folder in which S-1 was fitted with the shipped recipe."""
    return sample_run(tmp_path_factory, "fog_thermal").folder.parents[1]


@pytest.fixture
def fit(tmp_path, calibkit):
    """Return the command that fits logs as S below tmp_path / "runs", with settings of the
    recipe.
    """

    def run(*settings, data=CAMPAIGN, options=()):
        stated = [word for setting in settings for word in ("--set", setting)]
        where = ("--data", data, "--serial", "S", "--out", tmp_path / "runs")
        return calibkit("fit", "fog_thermal", *where, *stated, *options)

    return run


def records(tmp_path):
    """Coefficient files of the run that `fit` wrote."""
    return store.load(tmp_path / "runs" / "S" / "r001").records


def table(path):
    """Header and rows of a CSV as texts."""
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


def column(path, name):
    """One column of a CSV as numbers."""
    header, rows = table(path)
    return np.array([float(row[header.index(name)]) for row in rows])


def vector_logs(folder, log_writer):
    """Write the vector's ramps as logs at its 10 s interval; the chamber is at the ramp's set
    point.
    """
    for ramp in VECTOR["ramps"]:
        gradient = np.array(ramp["gradient_degc"])
        time = np.arange(gradient.size) * float(VECTOR["interval_s"])
        air = -40.0 + ramp["ramp_degc_min"] * time / 60.0
        log_writer(
            folder / f"ramp_{ramp['ramp_degc_min']:g}.csv",
            time_s=time,
            temp_case_degc=air + gradient,
            temp_env_degc=air,
            gyro_dph=np.array(ramp["gyro_dph"]),
        )


PINNED = [
    "drift.order=3",
    "denoise.enabled=false",
    "drift.rates_degc_min={ramp_1=1.0,ramp_5=5.0,ramp_8=8.0,ramp_10=10.0}",
]


@pytest.mark.parametrize("estimate", ["levels", "increments"])
def test_the_vector_comes_out_of_the_whole_pipeline(estimate, tmp_path, fit, log_writer):
    """With the order pinned to 3, denoising off and the rates given, c_jm come out of the files to
    1e-9 relative.
    """
    vector_logs(tmp_path / "logs", log_writer)
    outcome = fit(*PINNED, f"drift.estimate={estimate}", data=tmp_path / "logs")
    assert outcome.code == 0, outcome.err
    run = store.load(tmp_path / "runs" / "S" / "r001")
    model = run.records["drift_rate.json"].model("heating")
    for j in range(3):
        for m in range(4):
            # the temperatures went through a CSV, so that the gradient is known to 1e-14 °C of its
            # 60 °C
            assert model.value(f"c{j}{m}") == pytest.approx(VECTOR["c"][j][m], rel=1e-9)
    assert model.dof == 0
    assert any("zero degrees of freedom" in flag for flag in run.document["flags"])


def test_every_drift_figure_stands_beside_its_rate_gain(runs):
    """Recursive gain is 1.000 ± 0.001 and one_step gain 0.000 ± 0.001 on every log."""
    figures = {
        figure.name: figure.value
        for figure in store.load(runs / "S-1" / "r001").records["drift_rate.json"].figures
    }
    logs = [name.partition(".")[2] for name in figures if name.startswith("drift_rms_after.")]
    assert len(logs) == 8
    for log in logs:
        assert figures[f"rate_gain_recursive.{log}"] == pytest.approx(1.0, abs=1e-3)
        assert figures[f"rate_gain_one_step.{log}"] == pytest.approx(0.0, abs=1e-3)


def test_validation_improves_withheld_ramps_and_keeps_the_rate(runs, tmp_path, calibkit):
    """On ±3 °C/min ramps that were not fitted the drift rms falls, the gain is 1.000 ± 0.001, the
    digest is right.
    """
    out = tmp_path / "validation.json"
    outcome = calibkit("validate", "S-1", runs=runs, data=CAMPAIGN / "withheld", out=out)
    assert outcome.code == 0, outcome.err
    document = json.loads(out.read_text(encoding="utf-8"))
    assert [log["name"] for log in document["logs"]] == [
        "ramp_cooling_03.csv",
        "ramp_heating_03.csv",
    ]
    for log in document["logs"]:
        assert log["drift_rms_after"] < log["drift_rms_before"]
        assert log["rate_gain"] == pytest.approx(1.0, abs=1e-3)
        assert log["one_step"]["rate_gain"] == pytest.approx(0.0, abs=1e-3)
        deviation = log["allan_deviation"]
        at = {tau: k for k, tau in enumerate(deviation["tau_s"])}
        # 0.01 °/√h of angle random walk is 0.6 °/h at 1 s, which compensation leaves alone; the
        # drift is in the long times
        assert deviation["after"][at[1.0]] == pytest.approx(0.6, rel=0.03)
        assert deviation["after"][at[1024.0]] < 0.5 * deviation["before"][at[1024.0]]
    assert calibkit("verify", out).code == 0


def test_validation_on_fitted_logs_is_refused(runs, tmp_path, calibkit):
    """Logs that were fitted prove nothing: validation on them alone is refused and writes
    nothing.
    """
    call = ("validate", "S-1", "--runs", runs, "--data", CAMPAIGN)
    outcome = calibkit(*call, "--out", tmp_path / "v.json")
    assert outcome.code == 3
    assert "every log here was fitted by S-1@r001" in outcome.err
    assert not (tmp_path / "v.json").exists()


def test_apply_writes_every_row_and_column_and_moves_only_the_gyro(runs, tmp_path, calibkit):
    """All other fields keep their numbers; the drift over the log falls; the mean rate stays within
    the drift.
    """
    log, out = CAMPAIGN / "withheld" / "ramp_heating_03.csv", tmp_path / "out.csv"
    assert calibkit("apply", "S-1", "--runs", runs, "--data", log, "--out", out).code == 0
    (header, before), (after_header, after) = table(log), table(out)
    assert header == after_header
    assert len(before) == len(after)
    keep = [k for k, name in enumerate(header) if name != "gyro_dph"]
    fields = [np.array([[float(row[k]) for k in keep] for row in rows]) for rows in (before, after)]
    assert np.array_equal(*fields)
    raw, compensated = column(log, "gyro_dph"), column(out, "gyro_dph")
    means = [
        np.std(x[: x.size // 100 * 100].reshape(-1, 100).mean(axis=1)) for x in (raw, compensated)
    ]
    assert means[1] < 0.7 * means[0]
    assert abs(compensated.mean() - raw.mean()) < np.ptp(raw)


def test_a_rate_added_to_a_log_comes_out_of_apply_unchanged(runs, tmp_path, calibkit, log_writer):
    """7.5 °/h added to the indication moves every compensated row by 7.5 °/h, to 1e-9 °/h."""
    source = CAMPAIGN / "withheld" / "ramp_cooling_03.csv"
    columns = {name: column(source, name) for name in table(source)[0]}
    outputs = []
    for rate in (0.0, 7.5):
        log = log_writer(
            tmp_path / f"{rate}" / "log.csv", **(columns | {"gyro_dph": columns["gyro_dph"] + rate})
        )
        out = tmp_path / f"{rate}.csv"
        assert calibkit("apply", "S-1", "--runs", runs, "--data", log, "--out", out).code == 0
        outputs.append(column(out, "gyro_dph"))
    assert outputs[1] - outputs[0] == pytest.approx(np.full(outputs[0].size, 7.5), abs=1e-9)


def test_a_log_at_rest_at_the_reference_temperature_is_left_as_it_is(
    runs, tmp_path, calibkit, log_writer
):
    """At rest at 25 °C there is no drift: the output is the indication to 1e-9 °/h; at −30 °C it is
    not.
    """
    time = np.arange(900.0)
    for degc, expected in ((25.0, 0.0), (-30.0, None)):
        held = np.full(900, degc)
        log = log_writer(
            tmp_path / f"{degc}.csv",
            time_s=time,
            temp_case_degc=held,
            temp_env_degc=held,
            gyro_dph=np.full(900, 8.4),
        )
        out = tmp_path / f"out{degc}.csv"
        assert calibkit("apply", "S-1", "--runs", runs, "--data", log, "--out", out).code == 0
        moved = column(out, "gyro_dph") - 8.4
        assert np.ptp(moved) < 1e-9
        assert (abs(moved[0]) < 1e-9) == (expected == 0.0)


def test_apply_refuses_another_interval(runs, tmp_path, calibkit):
    """Coefficients per 10 s are not used at 5 s."""
    log = CAMPAIGN / "withheld" / "ramp_heating_03.csv"
    call = ("apply", "S-1", "--runs", runs, "--data", log, "--out", tmp_path / "o.csv")
    outcome = calibkit(*call, "--set", "drift.interval_s=5.0")
    assert outcome.code == 3
    assert "the coefficients are per 10 s" in outcome.err


@pytest.mark.parametrize("seed", slow_after(1, [101, 103, 105, 107]))
@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_withheld_ramps_never_come_out_above_raw(seed, scale, fit, tmp_path, calibkit):
    """Fitted on ±1, 5, 8, 10 °C/min with the default recipe, ±3 °C/min is never above raw,
    drift-free gyros included.
    """
    gyro = simulator.FogGyro.draw(seed).scale_drift(drift_scale=scale)
    for name, content in simulator.campaign(seed, gyro).files().items():
        (tmp_path / "logs" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "logs" / name).write_bytes(content)
    logs, runs = tmp_path / "logs", tmp_path / "runs"
    fitted = fit(data=logs, options=["--json"]).json
    calibkit("validate", "S", runs=runs, data=logs / "withheld", out=tmp_path / "v.json")
    document = json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))
    for log in document["logs"]:
        assert log["drift_rms_after"] <= log["drift_rms_before"]
        assert log["rate_gain"] == pytest.approx(1.0, abs=1e-3)
    models = store.load(runs / "S" / "r001").records["drift_rate.json"].models
    assert bool(models) != any("no drift term" in flag for flag in fitted["flags"])


@pytest.mark.parametrize("model", ["gradient_rate", "level", "lagged"])
def test_each_drift_model_improves_the_withheld_ramps_it_is_asked_for(
    model, tmp_path_factory, tmp_path
):
    """The recipe can ask for one model; the file names its form, and ±3 °C/min improves at least by
    half.
    """
    run = sample_run(tmp_path_factory, "fog_thermal", (f"drift.model={model}",))
    forms = {found.form for found in run.records["drift_rate.json"].models}
    expected = {
        "gradient_rate": "fog-drift-rate/1",
        "level": "fog-drift-level/1",
        "lagged": "fog-drift-lagged/1",
    }
    assert forms == {expected[model]}
    seen = pipeline.validate(run, CAMPAIGN / "withheld", tmp_path / "v.json", instruments.silent)
    for log in seen[0]["logs"]:
        assert log["drift_rms_after"] < log["drift_rms_before"] / 2.0
        assert log["rate_gain"] == pytest.approx(1.0, abs=1e-3)


def test_ramps_of_one_direction_are_flagged_by_fit_and_apply(runs, fit, tmp_path, calibkit):
    """Heating alone: the fit names what was not measured, and a cooling log says how much of it
    that is.
    """
    data = tmp_path / "heating"
    data.mkdir()
    for path in CAMPAIGN.glob("*heating*.csv"):
        (data / path.name).write_bytes(path.read_bytes())
    outcome = fit(data=data)
    assert "every ramp heats: cooling was not measured" in outcome.err + outcome.out
    (model,) = records(tmp_path)["drift_rate.json"].models
    low, high = model.valid["temp_rate_degc_min"]
    assert (low > -0.5, high > 5.0) == (True, True)
    run, cooling = tmp_path / "runs" / "S" / "r001", min(CAMPAIGN.glob("*cooling*.csv"))
    applied = calibkit("apply", run, "--data", cooling, "--out", tmp_path / "out.csv")
    assert "in a direction in which no ramp was fitted" in applied.err + applied.out
    both = store.load(runs / "S-1" / "r001").document["flags"]
    assert not any("was not measured" in flag for flag in both)


def test_noise_that_cannot_be_separated_from_drift_judges_no_limit():
    """A drift that is left beside a noise of 0 has no finite ratio: refused with what to do, as
    JSON holds no infinity; where nothing is left, the ratio is 0.
    """
    spec = instruments.parse_recipe(recipe.find("fog_thermal", ()))
    limits = spec.acceptance.model_copy(
        update={"min_reduction": None, "max_drift_rms_dph": None, "max_residual_over_noise": 5.0}
    )
    spec = spec.model_copy(update={"acceptance": limits})

    def judged(left, noise):
        """Criteria of one log without a drift term."""
        log = SimpleNamespace(after=left, split=SimpleNamespace(noise=noise))
        model = SimpleNamespace(mode="recursive", exported=False)
        return instrument.judge(spec, model, [log], None)

    with pytest.raises(FitError, match=r"that is left, 0.3 deg/h rms, expected .* = 5"):
        judged(0.3, 0.0)
    (criterion,) = judged(0.0, 0.0)
    assert criterion.value == 0.0
    assert criterion.passed
