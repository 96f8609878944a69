"""The accelerometer procedure end to end: dwells in, three coefficient files out, used again."""

import json

import numpy as np
import pytest

from calibkit.instruments.accelerometer import simulate as simulator
from calibkit.numeric import attitude
from calibkit.records import store
from conftest import AUTHORITIES

VECTOR = json.loads((AUTHORITIES / "accel_k.json").read_text(encoding="utf-8"))
COLUMNS = (
    "temp_case_degc",
    "inclination_deg",
    "toolface_deg",
    "accel_x_g",
    "accel_y_g",
    "accel_z_g",
)


def vector_columns():
    """Columns of the published-form vector: 120 noise-free dwells."""
    return dict(zip(VECTOR["columns"], np.array(VECTOR["rows"], dtype=float).T, strict=True))


def simulated(folder, seed, log_writer, *, sign=1.0, rows=None, **conditions):
    """Write a simulated campaign's dwells as positions.csv."""
    columns = simulator.campaign(seed, **conditions).logs["positions.csv"]
    kept = slice(None) if rows is None else rows
    changed = {name: np.asarray(columns[name])[kept] for name in COLUMNS}
    for axis in COLUMNS[3:]:
        changed[axis] = sign * changed[axis]
    return log_writer(folder / "positions.csv", **changed)


def fit(calibkit, folder, out, *settings):
    """Fit the shipped recipe to a folder and return outcome and run."""
    arguments = [part for setting in settings for part in ("--set", setting)]
    outcome = calibkit("fit", "accelerometer", *arguments, data=folder, serial="A", out=out)
    return outcome, (store.load(store.find("A", out)) if outcome.code in (0, 1) else None)


def test_the_vector_comes_out_of_the_shipped_recipe(tmp_path, calibkit, log_writer):
    """K0 … K9 of the three axes equal the vector's to 1e-9 relative, K3 and K7 included."""
    log_writer(tmp_path / "logs" / "positions.csv", **vector_columns())
    outcome, run = fit(calibkit, tmp_path / "logs", tmp_path / "runs")
    assert outcome.code == 0, outcome.err
    for name, expected in VECTOR["expected"].items():
        model = run.records["accel_k.json"].model(name)
        assert model.form == "accel-k/1"
        assert [c.name for c in model.coefficients] == [f"K{k}" for k in range(10)]
        assert [c.value for c in model.coefficients] == pytest.approx(expected, rel=1e-9)


def test_too_few_temperatures_name_the_coefficients_and_the_dwells_to_add(
    tmp_path, calibkit, log_writer
):
    """With three temperatures K3 and K7 are named, the reason is given, and dwells to add are
    proposed; exit code 3.
    """
    columns = vector_columns()
    keep = np.isin(columns["temp_case_degc"], np.unique(columns["temp_case_degc"])[:3])
    log_writer(
        tmp_path / "logs" / "positions.csv",
        **{name: values[keep] for name, values in columns.items()},
    )
    outcome, _ = fit(calibkit, tmp_path / "logs", tmp_path / "runs")
    assert outcome.code == 3
    assert "K3" in outcome.err
    assert "K7" in outcome.err
    assert "temperature" in outcome.err
    assert "add" in outcome.err
    lowered = ("k.scale_order=2", "k.zero_order=2", "affine.scale_order=2", "affine.bias_order=2")
    lowered += ("compensation=k",)  # these dwells are of its form, without noise
    outcome, run = fit(calibkit, tmp_path / "logs", tmp_path / "runs", *lowered)
    assert outcome.code == 0, outcome.err
    assert any("K3, K7 not fitted" in flag for flag in run.records["accel_k.json"].flags)


def test_a_table_within_a_hundredth_of_a_degree_gives_the_attitude_within_the_limits(
    tmp_path, calibkit, log_writer
):
    """Against true angles: inclination within 0.05°, toolface within 0.1°/sin(inclination), on
    dwells that were not fitted.
    """
    simulated(tmp_path / "logs", 5, log_writer)
    outcome, _ = fit(calibkit, tmp_path / "logs", tmp_path / "runs")
    assert outcome.code == 0, outcome.err
    # the same instrument again: other dwells, exact table, so that the errors are those of the
    # coefficients
    conditions = {
        "table_noise_deg": 0.0,
        "inclinations_deg": (20.0, 45.0, 75.0, 110.0, 160.0),
        "toolfaces": 5,
        "temperatures_degc": (-10.0, 50.0, 115.0),
    }
    columns = simulator.campaign(5, **conditions).logs["positions.csv"]
    log = log_writer(
        tmp_path / "new" / "positions.csv", **{name: columns[name] for name in COLUMNS}
    )
    out = tmp_path / "out.csv"
    applied = calibkit("apply", "A", "--runs", tmp_path / "runs", "--data", log, "--out", out)
    assert applied.code == 0, applied.err
    found = np.genfromtxt(out, delimiter=",", names=True)
    tilt = found["inclination_deg"] - found["reference_inclination_deg"]
    roll = attitude.wrapped(found["toolface_deg"] - found["reference_toolface_deg"])
    inside = (found["reference_inclination_deg"] > 1.0) & (
        found["reference_inclination_deg"] < 179.0
    )
    assert np.abs(tilt).max() <= 0.05
    assert (np.abs(roll) * np.sin(np.radians(found["reference_inclination_deg"])))[
        inside
    ].max() <= 0.1


def test_either_sign_convention_gives_the_same_coefficients(tmp_path, calibkit, log_writer):
    """The same dwells as specific force give the same K to 1e-12 with their recipe; without it the
    fit is refused.
    """
    simulated(tmp_path / "gravity", 2, log_writer)
    simulated(tmp_path / "force", 2, log_writer, sign=-1.0)
    _, first = fit(calibkit, tmp_path / "gravity", tmp_path / "a")
    _, second = fit(
        calibkit, tmp_path / "force", tmp_path / "b", "reference.convention=specific_force"
    )
    for name in ("accel_x", "accel_y", "accel_z"):
        one, two = (run.records["accel_k.json"].model(name) for run in (first, second))
        assert [c.value for c in one.coefficients] == pytest.approx(
            [c.value for c in two.coefficients], rel=1e-12
        )
    wrong, _ = fit(calibkit, tmp_path / "force", tmp_path / "c")
    assert wrong.code == 3
    assert "accel_x_g shows −x, accel_y_g shows −y, accel_z_g shows −z" in wrong.err


def test_a_wild_dwell_is_named_with_its_line(tmp_path, calibkit, log_writer):
    """A dwell that is 5 mg off is named by file and line, and no K moves by more than its standard
    uncertainty.
    """
    columns = {
        name: np.array(values)
        for name, values in simulator.campaign(4).logs["positions.csv"].items()
    }
    log_writer(tmp_path / "clean" / "positions.csv", **{name: columns[name] for name in COLUMNS})
    columns["accel_y_g"] = columns["accel_y_g"].copy()
    columns["accel_y_g"][100] += 5e-3
    log_writer(tmp_path / "outliers" / "positions.csv", **{name: columns[name] for name in COLUMNS})
    _, clean = fit(calibkit, tmp_path / "clean", tmp_path / "a")
    _, outliers = fit(calibkit, tmp_path / "outliers", tmp_path / "b")
    assert any(
        "triad: suspect dwell positions.csv:102" in flag for flag in outliers.document["flags"]
    )
    for name in ("accel_x", "accel_y", "accel_z"):
        one, two = (run.records["accel_k.json"].model(name) for run in (clean, outliers))
        for a, b in zip(one.coefficients, two.coefficients, strict=True):
            assert abs(a.value - b.value) <= a.standard_uncertainty


def test_si_units_need_and_use_the_site_gravity(tmp_path, calibkit, log_writer):
    """A log in m/s² gives the same K with the site's latitude, and is refused without it."""
    columns = vector_columns()
    gravity = 9.806197769373233  # latitude 45°, height 0 (Somigliana)
    for axis in ("accel_x_g", "accel_y_g", "accel_z_g"):
        columns[axis] = columns[axis] * gravity
    log_writer(tmp_path / "logs" / "positions.csv", **columns)
    units = [f'columns.accel_{a}_g={{from="accel_{a}_g", unit="m/s^2"}}' for a in "xyz"]
    refused, _ = fit(calibkit, tmp_path / "logs", tmp_path / "runs", *units)
    assert refused.code == 2
    assert "local gravity" in refused.err
    outcome, run = fit(
        calibkit, tmp_path / "logs", tmp_path / "runs", *units, "site.latitude_deg=45.0"
    )
    assert outcome.code == 0, outcome.err
    expected = VECTOR["expected"]["accel_x"]
    found = [c.value for c in run.records["accel_k.json"].model("accel_x").coefficients]
    assert found == pytest.approx(expected, rel=1e-7)
    assert run.records["accel_k.json"].conditions[0].value == pytest.approx(gravity, rel=1e-12)


def test_held_positions_of_a_continuous_log_calibrate_from_magnitude_alone(
    tmp_path, calibkit, log_writer
):
    """Twenty held positions in a continuous log give Q within 0.2 mrad, scale factors within 100
    ppm, at 100 µg noise.
    """
    rng = np.random.default_rng(12)
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    axes = np.array([[1.0, 0.0, 0.0], [0.012, np.sqrt(1 - 0.012**2), 0.0], [-0.008, 0.014, 0.0]])
    axes[2, 2] = np.sqrt(1.0 - axes[2, 0] ** 2 - axes[2, 1] ** 2)
    scale, bias = np.array([1.01, 0.99, 1.02]), np.array([0.01, -0.02, 0.005])
    pieces = []
    for k, direction in enumerate(directions):
        held = np.tile(direction, (400, 1))
        after = directions[(k + 1) % 20]
        moving = direction + (after - direction) * np.linspace(0.0, 1.0, 200)[:, None]
        pieces += [held, moving + 0.05 * rng.normal(size=(200, 3))]
    gravity = np.concatenate(pieces)
    triad = scale * (gravity @ axes.T) + bias + rng.normal(0.0, 1e-4, gravity.shape)
    log_writer(
        tmp_path / "logs" / "tumble.csv",
        time_s=np.arange(len(triad)) * 0.01,
        accel_x_g=triad[:, 0],
        accel_y_g=triad[:, 1],
        accel_z_g=triad[:, 2],
    )
    arguments = ("--data", tmp_path / "logs", "--serial", "M", "--out", tmp_path / "runs")
    outcome = calibkit("fit", "accelerometer_magnitude", *arguments)
    assert outcome.code == 0, outcome.err
    run = store.load(tmp_path / "runs" / "M" / "r001")
    q = [c.value for c in run.records["accel_q.json"].model("triad").coefficients]
    assert q == pytest.approx([-0.014, 0.012 * 0.014 + 0.008, -0.012], abs=2e-4)
    triad_model = run.records["accel_affine.json"].model("triad")
    assert triad_model.value("k_x0") == pytest.approx(1.0 / 1.01, rel=1e-4)
    assert triad_model.value("z_y0") == pytest.approx(-0.02 / 0.99, abs=1e-4)
    outcome = calibkit("fit", "accelerometer_magnitude", *arguments, set="reference.solver=lmfit")
    assert outcome.code == 0, outcome.err
    record = store.load(tmp_path / "runs" / "M" / "r002").records["accel_q.json"]
    bounds = {figure.name: figure.value for figure in record.figures if figure.name.endswith("_95")}
    again = [c.value for c in record.model("triad").coefficients]
    assert again == pytest.approx(q, abs=2e-5)  # a fifth of their standard uncertainty
    assert bounds["Q1_low_95"] < again[0] < bounds["Q1_high_95"]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("compensation=kq", "expected 'affine' or 'k'"),
        ("k.groups=log", "remove it"),
        ("affine.cross_order=2", "linear in temperature at most"),
    ],
)
def test_what_0_2_offered_and_is_no_more_is_refused_by_name(
    tmp_path, calibkit, log_writer, setting, words
):
    """A recipe of 0.2 with it is still read, and not fitted."""
    log_writer(tmp_path / "logs" / "positions.csv", **vector_columns())
    outcome, _ = fit(calibkit, tmp_path / "logs", tmp_path / "runs", setting)
    assert outcome.code in (2, 3)
    assert setting.split("=")[0] in outcome.err
    assert words in outcome.err
    assert not (tmp_path / "runs").exists()


def test_coefficients_of_another_unit_fail_their_validation(tmp_path, calibkit, log_writer):
    """Errors far beyond their uncertainty reject the run, also where they are smaller than those of
    the raw indication.
    """
    simulated(tmp_path / "logs", 6, log_writer)
    simulated(tmp_path / "other", 7, log_writer)
    fit(calibkit, tmp_path / "logs", tmp_path / "runs")
    outcome = calibkit(
        "validate", "A", runs=tmp_path / "runs", data=tmp_path / "other", out=tmp_path / "v.json"
    )
    assert outcome.code == 1
    assert "positions.csv: rms error over its u" in outcome.out
