"""Bias of a static instrument against one thermometer: what is chosen, how large its error is,
which power-ons are found, and what ordinary bad input is told.
"""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

import calibkit
from calibkit.instruments.bias import power_ons, simulate
from calibkit.instruments.bias.numeric import choice
from calibkit.numeric import intervals
from calibkit.numeric.thermal import evaluate, pooled_fit
from calibkit.records import store
from calibkit.results.evaluation import RunResults, answer
from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber
from conftest import slow_after
from outputs.firmware_log import chain_of, correct

RECIPE = """
procedure = "thermal"
[logs]
files = ["*.csv"]
[thermal]
channels = ["gyro_x_dph"]
"""
SWEEP = simulate._programme()
WHITE, FLICKER = 2.0, 0.1  # °/h: of a second, and the level


def lag(values, tau_s):
    """Values at 1 Hz behind a first-order lag, from equilibrium."""
    share = 1.0 - np.exp(-1.0 / tau_s)
    return np.asarray(lfilter([share], [1.0, share - 1.0], values - values[0])) + values[0]


def board(programme, rng):
    """Times and board temperatures of a programme."""
    time, set_degc = programme.set_points()
    return time, lag(Chamber().air(set_degc, rng), 250.0)


def two_lags(case, tau_outer, tau_inner):
    """Columns of the lumped plant: static powers, rate, rate times temperature, and gradient."""
    outer = lag(case, tau_outer)
    z, rate = (outer - 25.0) / 50.0, 60.0 * np.gradient(outer)
    gradient = (outer - lag(outer, tau_inner)) / 10.0
    return np.column_stack([np.ones_like(z), z, z**2, z**3, rate, rate * z, gradient])


def wall(case, diffusion_s):
    """Columns of a wall that heat diffuses through: static powers, rate, stress across it."""
    layers = simulate._layers(case, diffusion_s)
    mean = layers.mean(axis=1)
    z, rate = (mean - 25.0) / 50.0, 60.0 * np.gradient(mean)
    stress = (layers[:, 0] - layers[:, -1]) / 10.0
    return np.column_stack([np.ones_like(z), z, z**2, z**3, rate, stress])


PLANTS = {"two lags": (two_lags, 2), "diffusion": (wall, 1)}
SIZES = (3.0, 10.0, 5.0, 2.0, 2.0, 1.0, 4.0)


def draw(plant, rng):
    """Return time constants and coefficients of a plant."""
    _, count = PLANTS[plant]
    taus = rng.uniform(80.0, 300.0, 1) if count == 2 else rng.uniform(300.0, 1500.0, 1)
    taus = np.append(taus, rng.uniform(300.0, 1200.0, 1)) if count == 2 else taus
    size = SIZES if count == 2 else (*SIZES[:5], SIZES[6])
    return taus, rng.normal(0.0, 1.0, len(size)) * size


def simulated(plant, seed):
    """Return times, board temperatures, plant, and the indication of a sweep."""
    rng = np.random.default_rng([seed, 1852])
    time, case = board(SWEEP, rng)
    taus, coefficients = draw(plant, rng)
    drift = PLANTS[plant][0](case, *taus) @ coefficients
    indication = drift + rng.normal(0.0, WHITE, time.size) + noise.flicker(FLICKER, time.size, rng)
    read = noise.reading(case, 0.0625, 0.02, rng)
    return time, case, read, (taus, coefficients), indication


def true_family_rms(plant, case, taus, held, indication, out):
    """Rms that the plant's own equations leave on blocks that are not fitted, all their constants
    fitted to the others.
    """

    def fit(logs):
        whole = PLANTS[plant][0](case, *np.exp(logs))
        design = np.column_stack([held.means(column) for column in whole.T])
        found, *_ = np.linalg.lstsq(design[~out], indication[~out], rcond=None)
        return indication - design @ found

    best = minimize(
        lambda logs: float(np.sum(fit(logs)[~out] ** 2)),
        np.log(taus),
        method="Nelder-Mead",
        options={"maxfev": 80, "initial_simplex": None},
    )
    return float(np.sqrt(np.mean(fit(best.x)[out] ** 2)))


@pytest.mark.parametrize("plant", slow_after(1, PLANTS))
@pytest.mark.parametrize("seed", range(40, 44))
def test_a_left_out_quarter_is_left_as_by_the_true_family(plant, seed):
    """A sweep 52 → −18 → 74 → 36 °C with one thermometer: the rms on a quarter that is not
    fitted is at most 1.2 of what the plant's own equations leave there.
    """
    time, case, read, (taus, _), indication = simulated(plant, seed)
    held = intervals.Intervals.find(time, 10.0)
    quarter = (0, 2, 3)[seed % 3]
    log = averaged(time, read, indication)
    edges = time[-1] / 4.0 * quarter, time[-1] / 4.0 * (quarter + 1)
    out = (log.time >= edges[0]) & (log.time < edges[1])
    one = power_on(log, ~out)
    found = choice.choose_terms(pooled_fit.Stack.of_logs([one.of_channel("y")]), figure_blocks=10)
    left = log.indication - evaluate.evaluate_wide(found.model, one.blocks, 25.0).drift
    rms = float(np.sqrt(np.mean((left[out] - left[~out].mean()) ** 2)))
    assert rms <= 1.2 * true_family_rms(plant, case, taus, held, log.indication, out)


def averaged(time, read, indication):
    """Block means of 10 s of one log."""
    held = intervals.Intervals.find(time, 10.0)
    means = (held.means(np.asarray(values, dtype=np.float64)) for values in (time, read, read))
    return pooled_fit.thermal_blocks("log", held, means, indication)


def power_on(log, fitted):
    """One power-on of one channel, cut into stretches."""
    blocks = replace(log, fitted=fitted, starts=((0, 0.0),))
    one = power_ons.PowerOn(blocks, {"y": log.indication}, ~fitted, fitted, (), ())
    (cut,), _ = power_ons.cut_stretches([one], 10.0)
    return cut


# logs


def write_log(path, time, case, **columns):
    """Write a log."""
    names = ["time_s", "temp_case_degc", *columns]
    rows = np.column_stack([time, case, *columns.values()])
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, rows, fmt="%.6f", delimiter=",", header=",".join(names), comments="")


def sweep(rows=6000, step=2.0, seed=3, level=0.0, turn=1.0):
    """Times, temperatures and indications of ramps up and down, in one power-on."""
    rng = np.random.default_rng(seed)
    time = step * np.arange(rows)
    slow, fast = (np.sin(2.0 * np.pi * time / period) for period in (6000.0, 1700.0))
    case = 25.0 + turn * (26.0 * slow + 8.0 * fast)
    bias = 5.0 + level + 0.3 * (lag(case, 200.0 / step) - 25.0)
    return time, case, bias + rng.normal(0.0, 0.5, rows)


@pytest.fixture
def fit(tmp_path, calibkit):
    """Fit logs of a folder by a recipe."""

    def run(text=RECIPE, *more):
        (tmp_path / "recipe.toml").write_text(text)
        return calibkit(
            "fit",
            tmp_path / "recipe.toml",
            *more,
            data=tmp_path / "logs",
            serial="I-1",
            out=tmp_path / "runs",
        )

    return run


def model_of(tmp_path, revision=1):
    """The first model of a run."""
    return (
        store.load(tmp_path / "runs" / "I-1" / f"r{revision:03d}").records["thermal.json"].models[0]
    )


def test_the_clock_that_begins_anew_is_a_power_on(tmp_path, fit):
    """A reboot in the middle, after which the bias is 4 °/h higher, costs the model nothing and is
    the turn-on bias; so is a gap, and so are two logs whose clocks do not go on.
    """
    time, case, gyro = sweep()
    half = time.size // 2
    gyro[half:] += 4.0
    reboot = np.where(np.arange(time.size) < half, time, time - time[half] + 1.0)
    write_log(tmp_path / "logs" / "a.csv", reboot, case, gyro_x_dph=gyro)
    assert fit().code == 0
    gap = np.where(np.arange(time.size) < half, time, time + 300.0)
    write_log(tmp_path / "logs" / "a.csv", gap, case, gyro_x_dph=gyro)
    assert fit().code == 0
    for name, rows in (("a", slice(0, half)), ("b", slice(half, None))):
        write_log(
            tmp_path / "logs" / f"{name}.csv",
            time[rows] - time[rows][0],
            case[rows],
            gyro_x_dph=gyro[rows],
        )
    assert fit().code == 0
    for revision in (1, 2, 3):
        model = model_of(tmp_path, revision)
        (component,) = model.components
        assert component.groups == 2
        assert component.value == pytest.approx(4.0 / np.sqrt(2.0), abs=0.4)
        assert model.value("tau_outer") == pytest.approx(200.0, rel=0.15)


def test_apply_adds_what_is_asked_for_and_flags_what_was_not_fitted(tmp_path, fit, calibkit):
    """Drift and its uncertainty beside each channel; temperatures far beyond the fitted range are
    held and flagged, and the uncertainty there is larger.
    """
    time, case, gyro = sweep()
    write_log(tmp_path / "logs" / "a.csv", time, case, gyro_x_dph=gyro)
    assert fit().code == 0
    time, case, gyro = sweep(turn=2.5, seed=5)
    write_log(tmp_path / "unseen" / "wide.csv", time, case, gyro_x_dph=gyro)
    out = tmp_path / "out.csv"
    done = calibkit(
        "apply",
        tmp_path / "runs" / "I-1" / "r001",
        "--data",
        tmp_path / "unseen" / "wide.csv",
        "--out",
        out,
        "--set",
        "output.drift=true",
        "--set",
        "output.rate_uncertainty=true",
    )
    assert done.code == 0, done.err
    assert "temperature outside the fitted range" in done.out + done.err
    head, *_ = out.read_text().splitlines()
    assert (
        head == "time_s,temp_case_degc,gyro_x_dph,gyro_x_drift_dph,gyro_x_standard_uncertainty_dph"
    )
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert rows[:, 2] + rows[:, 3] == pytest.approx(gyro, abs=1e-5)
    inside = np.abs(case - 25.0) < 25.0
    assert rows[~inside, 4].max() > 3.0 * np.median(rows[inside, 4])
    assert np.std(rows[inside, 2]) < 0.2 * np.std(gyro[inside])


def test_validate_compares_errors_with_their_uncertainty(tmp_path, fit, calibkit):
    """An unseen log of the same instrument is accepted, one of another instrument is not."""
    time, case, gyro = sweep()
    write_log(tmp_path / "logs" / "a.csv", time, case, gyro_x_dph=gyro)
    assert fit().code == 0
    for name, factor, code in (("same", 1.0, 0), ("other", 1.5, 1)):
        time, case, gyro = sweep(seed=9)
        write_log(
            tmp_path / name / "b.csv", time, case, gyro_x_dph=gyro + (factor - 1.0) * 0.3 * case
        )
        out = tmp_path / f"{name}.json"
        done = calibkit(
            "validate", tmp_path / "runs" / "I-1" / "r001", data=tmp_path / name, out=out
        )
        assert done.code == code, done.out + done.err
        (entry,) = json.loads(out.read_text())["logs"]
        assert entry["channels"][0]["unit"] == "deg/h"


def test_firmware_follows_every_channel(tmp_path, calibkit):
    """Six channels in one chain: what the exported doubles take off is what `apply` does, one
    interval later.
    """
    calibkit("simulate", "thermal", "--out", tmp_path / "c", "--seed", "7")
    (tmp_path / "logs").mkdir()
    (tmp_path / "c" / "sweep.csv").rename(tmp_path / "logs" / "sweep.csv")
    run = tmp_path / "runs" / "I-1" / "r001"
    outcome = calibkit(
        "fit", "thermal", data=tmp_path / "logs", serial="I-1", out=tmp_path / "runs"
    )
    assert outcome.code == 0, outcome.err
    data = ("--data", tmp_path / "logs" / "sweep.csv")
    assert calibkit("apply", run, *data, "--out", tmp_path / "a.csv").code == 0
    raw, applied = pd.read_csv(tmp_path / "logs" / "sweep.csv"), pd.read_csv(tmp_path / "a.csv")
    by_firmware, _ = correct(chain_of(run), raw)
    for column in raw.columns[2:8]:
        assert np.std(applied[column] - by_firmware[column]) < 0.03 * np.std(raw[column])
    assert calibkit("export", run, "--target", "c", "--out", tmp_path / "fw").code == 0
    assert calibkit("certify", run, "--out", tmp_path / "cert.pdf").code == 0


@pytest.mark.parametrize(
    ("change", "text", "code", "words"),
    [
        (lambda t, c, g: (t, c * 0.0 + 25.0, g), RECIPE, 3, "constant"),
        (lambda t, c, g: (t[:150], c[:150], g[:150]), RECIPE, 3, "expected at least 200"),
        (lambda t, c, g: (t[:230], c[:230] * 2.0, g[:230]), RECIPE, 3, "to leave stretches out"),
        (None, RECIPE.replace("gyro_x_dph", "gyro_z_dph"), 3, "'gyro_z_dph' is missing"),
        (None, RECIPE.replace("gyro_x_dph", "temp_case_degc"), 2, "is a thermometer or a clock"),
        (None, RECIPE + 'sessions = [["b.csv"]]\n', 2, "b.csv"),
        (None, RECIPE + "order = 3\n", 2, "order"),
    ],
)
def test_ordinary_bad_input_is_told_in_one_line(tmp_path, fit, change, text, code, words):
    """What is wrong, where, and what was expected: no traceback, no run."""
    log = sweep()
    time, case, gyro = change(*log) if change else log
    write_log(tmp_path / "logs" / "a.csv", time, case, gyro_x_dph=gyro)
    outcome = fit(text)
    assert (outcome.code, words in outcome.err) == (code, True), outcome.err
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "runs" / "I-1").exists()


def evaluated_at_25(power_ons, seed, tmp_path, **errors):
    """Bias at 25 °C, where the truth is 5 °/h, by a run of power-ons with turn-on biases of 1 °/h,
    and its uncertainty.
    """
    rng = np.random.default_rng([seed, power_ons])
    logs = {}
    for number in range(power_ons):
        time = np.arange(0.0, 3600.0, 2.0)
        degc = 20.0 + 30.0 * np.sin(2.0 * np.pi * time / time[-1])
        gyro = 5.0 + 0.05 * (degc - 25.0) + rng.normal() + rng.normal(0.0, 0.3, time.size)
        columns = {"time_s": time, "temp_case_degc": degc, "gyro_x_dph": gyro}
        logs[f"on_{number}.csv"] = pd.DataFrame(columns)
    recipe = {
        "procedure": "thermal",
        "logs": {"files": ["*.csv"]},
        "thermal": {"channels": ["gyro_x_dph"], "model": "level"},
        **errors,
    }
    runs = tmp_path / f"{power_ons}_{seed}"
    calibkit.fit(recipe, logs=logs, runs=runs, serial="T1", date="2026-11-27")
    run = RunResults.read(store.load(runs / "T1" / "r001"))
    (value, *_), _ = answer(run, ["temp_case_degc=25"], [], "bias")
    return value.result.value, value.result.uncertainty


@pytest.mark.parametrize(("power_ons", "k"), [(2, 13.97), (3, 4.53)])
def test_few_power_ons_tell_little_of_the_turn_on_bias(power_ons, k, tmp_path):
    """Two have one degree of freedom, three have two, however many rows: U holds the truth."""
    stated = [evaluated_at_25(power_ons, seed, tmp_path) for seed in range(12)]
    factors = [uncertainty.coverage_factor for _, uncertainty in stated]
    assert np.median(factors) == pytest.approx(k, abs=0.01)
    inside = [abs(value - 5.0) <= u.expanded_uncertainty for value, u in stated]
    assert sum(inside) >= 11


def test_a_stated_turn_on_bias_replaces_the_estimated_one(tmp_path):
    """Four power-ons leave half of the stated size as u, whatever their scatter."""
    size = {"group": "power-on", "effect": "turn-on bias", "value": 1.0, "unit": "deg/h"}
    errors = {"component": [{**size, "dof": 50.0}]}
    for seed in range(3):
        _, uncertainty = evaluated_at_25(4, seed, tmp_path, errors=errors)
        assert uncertainty.standard_uncertainty == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("warm_up", [0.0, 60.0])
def test_a_warm_up_that_the_temperature_does_not_explain_is_left_out(warm_up):
    """A gyro that settles by 60 °/h after power-on is modelled as well as one that does not, and
    the fit and `apply` say how long it takes.
    """
    time, case, read, (taus, coefficients), indication = simulated("two lags", 71)
    seen = indication + warm_up * np.exp(-time / 500.0)
    frame = pd.DataFrame({"time_s": time, "temp_case_degc": read, "gyro_x_dph": seen})
    recipe = {"procedure": "thermal", "logs": {"files": ["*.csv"]}}
    recipe["thermal"] = {"channels": ["gyro_x_dph"]}
    run = calibkit.fit(recipe, logs={"a.csv": frame}, runs=None, date="2026-11-28")
    said = [flag for flag in run.flags if "this warm-up is left out" in flag]
    assert len(said) == bool(warm_up)
    corrected = run.apply(frame)
    left = corrected["gyro_x_dph"] - (indication - two_lags(case, *taus) @ coefficients)
    assert np.std(left[time > 4000.0]) < 0.5
    notes = [flag for flag in corrected.attrs["flags"] if "does not hold the warm-up" in flag]
    assert len(notes) == len(said)
