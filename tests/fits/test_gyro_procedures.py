"""The rate-table procedures end to end: logs in, scale factors, N, γ and α out, used again."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from calibkit import instruments, recipe
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.commands import pipeline
from calibkit.instruments import silent
from calibkit.instruments.gyro_scale import (
    certificate,
    fit as gyro_fit,
    simulate,
    table_runs,
)
from calibkit.records import store
from calibkit.records.forms import POLYNOMIAL
from calibkit.records.frame import Log
from conftest import AUTHORITIES, ROOT
from outputs.firmware_log import chain_of, correct
from sample_runs import sample_run

CASES = json.loads((AUTHORITIES / "gyro_orthogonality.json").read_text(encoding="utf-8"))["cases"]
RATES = (1.0, 2.0, 5.0, 10.0, 50.0, 100.0, -1.0, -2.0, -5.0, -10.0, -50.0, -100.0)
HELD = 40
"""Rows of a held rate in the hand-made logs, one a second."""
VERTICAL_DPS = 15.041067 / 3600.0 * np.sin(np.radians(34.2))


def held_rates(rates=RATES):
    """Time and table rate of a log that steps from rate to rate."""
    rate = np.repeat(np.array(rates), HELD)
    return np.arange(rate.size) * 1.0, rate


def exact_pair(folder, case, log_writer, rates=RATES):
    """Noise-free logs of a worked example; a tenth of a millionth of a count of dither keeps no
    column constant.
    """
    time, rate = held_rates(rates)
    dither = 1e-7 * (-1.0) ** np.arange(rate.size)
    for axis, K_a, K_b in (
        ("a", case["K_A"], case["K_Ba"]),
        ("b", case["gamma"] * case["K_A"], case["K_B"]),
    ):
        log_writer(
            folder / f"table_axis_{axis}.csv",
            time_s=time,
            table_rate_dps=rate,
            gyro_a_lsb=K_a * rate + 20.0 + dither,
            gyro_b_lsb=K_b * rate - 7.0 + dither,
        )
    return folder


def write(folder, campaign):
    """Write a campaign's files and return its truth."""
    folder.mkdir(parents=True)
    for name, content in campaign.files().items():
        (folder / name).write_bytes(content)
    return json.loads((folder / "truth.json").read_text(encoding="utf-8"))


def fit(calibkit, procedure, folder, out, *settings, code=0):
    """Fit a shipped recipe to a folder and return the run."""
    arguments = [part for setting in settings for part in ("--set", setting)]
    outcome = calibkit("fit", procedure, *arguments, data=folder, serial="G", out=out)
    assert outcome.code == code, outcome.err
    return store.load(store.find("G", out))


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Return folder, truth and runs of a simulated pair (seed 1), fitted with its latitude."""
    root = tmp_path_factory.mktemp("pair")
    truth = write(root / "logs", simulate.pair(1))
    source = recipe.find("gyro_pair", ("site.latitude_deg=34.2",))
    pipeline.fit(source, root / "logs", "G", root / "runs", "2026-11-21", silent)
    return root, truth


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return folder and truth of simulated runs (seed 3); all but room_3 and at_0 are fitted."""
    root = tmp_path_factory.mktemp("table")
    truth = write(root / "logs", simulate.rate_table(3))
    (root / "unseen").mkdir()
    for name in ("room_3.csv", "at_0.csv"):
        (root / "logs" / name).rename(root / "unseen" / name)
    pipeline.fit(recipe.find("rate_table"), root / "logs", "G", root / "runs", "2026-11-21", silent)
    return root, truth


def record(root, stage):
    """Coefficient record of a stage of the newest run."""
    return store.load(store.find("G", root / "runs")).records[f"{stage}.json"]


def figures(found):
    """Figures of a record by name."""
    return {figure.name: figure for figure in found.figures}


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"alpha {case['alpha_deg']:g}")
def test_the_worked_examples_come_out_of_the_shipped_recipe(case, tmp_path, calibkit, log_writer):
    """N, ε, γ and α of noise-free logs to 1e-9 of the published values (of one where they are
    zero).
    """
    run = fit(
        calibkit, "gyro_pair", exact_pair(tmp_path / "logs", case, log_writer), tmp_path / "runs"
    )
    orthogonality = run.records["gyro_orthogonality.json"]
    assert {model.form for model in orthogonality.models} == {"gyro-orthogonality/1"}
    for name in ("N", "epsilon", "gamma", "alpha_deg"):
        for value in (orthogonality.model("pair").value(name), figures(orthogonality)[name].value):
            assert value == pytest.approx(case[name], rel=1e-9, abs=1e-9)
    scales = run.records["gyro_scale.json"]
    for name, key in (("a_about_a", "K_A"), ("b_about_b", "K_B"), ("b_about_a", "K_Ba")):
        assert scales.model(name).form == "gyro-scale/1"
        assert scales.model(name).value("K") == pytest.approx(case[key], rel=1e-9, abs=1e-8)
    assert scales.model("a_about_a").value("F0") == pytest.approx(20.0, abs=1e-6)


def test_the_simulated_pair_comes_out_within_3_ppm_and_4_standard_uncertainties(pair):
    """K of both gyros within 3 ppm of truth; N, ε, γ, α within 4 standard uncertainties; γ again
    from the other run.
    """
    root, truth = pair
    scales, orthogonality = record(root, "gyro_scale"), record(root, "gyro_orthogonality")
    full = truth["models"]["a_about_a"]["K"]
    for name, expected in truth["models"].items():
        assert abs(scales.model(name).value("K") - expected["K"]) < 3e-6 * full
    for c in orthogonality.model("pair").coefficients:
        assert abs(c.value - truth[c.name]) < 4.0 * c.standard_uncertainty
        assert 0.0 < c.standard_uncertainty < (2e-4 if c.name == "alpha_deg" else 2e-6)
    covariance = np.array(orthogonality.model("pair").covariance)
    assert covariance.shape == (4, 4)
    # N and epsilon share K_A and B's runs: the covariance is not diagonal
    assert abs(covariance[2, 3]) > 0.9 * np.sqrt(covariance[2, 2] * covariance[3, 3])
    other = figures(orthogonality)["gamma_from_a_about_b"]
    assert abs(other.value - truth["gamma"]) < 4.0 * other.standard_uncertainty
    assert figures(orthogonality)["side"].value == (1.0 if truth["side"] == "same" else -1.0)
    low, high = (figures(orthogonality)[f"alpha_{end}_95_deg"].value for end in ("low", "high"))
    assert low < truth["alpha_deg"] < high


def test_the_latitude_tells_the_bias_from_the_earths_rate(pair, tmp_path, calibkit):
    """F0 is K times bias and earth's rate to 5 standard uncertainties; positive down turns the
    earth's share over.
    """
    root, truth = pair
    found = figures(record(root, "gyro_scale"))
    for gyro in ("a", "b"):
        bias = found[f"bias.{gyro}_about_{gyro}"]
        model = truth["models"][f"{gyro}_about_{gyro}"]
        expected = (model["F0"] / model["K"] - VERTICAL_DPS) * 3600.0
        assert bias.unit == "deg/h"
        assert abs(bias.value - expected) < 5.0 * bias.standard_uncertainty < 0.6
    down = fit(
        calibkit,
        "gyro_pair",
        root / "logs",
        tmp_path / "down",
        "site.latitude_deg=34.2",
        "table.axis=down",
    ).records["gyro_scale.json"]
    shift = figures(down)["bias.a_about_a"].value - found["bias.a_about_a"].value
    assert shift == pytest.approx(2.0 * VERTICAL_DPS * 3600.0, rel=1e-3)
    without = fit(calibkit, "gyro_pair", root / "logs", tmp_path / "without").records[
        "gyro_scale.json"
    ]
    assert not [name for name in figures(without) if name.startswith("bias.")]
    assert without.conditions == ()


UNITS = {
    "deg/h": ("table_rate", 3600.0, 1.0, ("columns.table_rate_dps.unit=deg/h",)),
    "rad/s": ("table_rate", np.pi / 180.0, 1.0, ("columns.table_rate_dps.unit=rad/s",)),
    "clockwise": ("table_rate", -1.0, 1.0, ("columns.table_rate_dps.sign=-1",)),
    "counts per sample": (
        "table_rate_dps",
        1.0,
        0.5,
        ("columns.gyro_x_lsb.scale=2.0", "columns.gyro_x_lsb.from=counts"),
    ),
}


@pytest.mark.parametrize("name", UNITS)
def test_units_and_signs_are_mapped_by_the_recipe(name, tmp_path, calibkit, log_writer):
    """The same table in °/h, rad/s, clockwise, or counts per half-second sample gives the same K to
    1e-12 as in canonical units.
    """
    column, factor, counts, settings = UNITS[name]
    time, rate = held_rates()
    gyro = "counts" if counts != 1.0 else "gyro_x_lsb"
    shown = 10000.0 * rate + 23.0 + np.sin(time)
    log_writer(tmp_path / "plain" / "run.csv", time_s=time, table_rate_dps=rate, gyro_x_lsb=shown)
    plain = fit(calibkit, "rate_table", tmp_path / "plain", tmp_path / "r")
    columns = {"time_s": time, column: factor * rate, gyro: counts * shown}
    log_writer(tmp_path / "logs" / "run.csv", **columns)
    mapped = () if column == "table_rate_dps" else ("columns.table_rate_dps.from=table_rate",)
    run = fit(calibkit, "rate_table", tmp_path / "logs", tmp_path / "runs", *mapped, *settings)
    for one in ("gyro_x", "gyro_x.run"):
        K, expected = (
            found.records["gyro_scale.json"].model(one).value("K") for found in (run, plain)
        )
        assert pytest.approx(expected, rel=1e-12) == K


def test_a_figure_of_a_run_has_the_uncertainty_of_its_coefficient(tmp_path_factory):
    """K stands in two tables with one U; a repeatability, a standard deviation over three runs, has
    the interval of the chi-square distribution.
    """
    run = sample_run(tmp_path_factory, "rate_table")
    stated = Stated(run.records, TypeBTerms(()), (), 25.0)
    tables = [table for block in certificate.blocks(stated) for table in block.tables]
    rows = [row for table in tables for row in getattr(table, "cells", ())]
    results = [cell for row in rows for cell in row if cell is not None]
    K = [r for r in results if r.unit == "1/deg" and abs(r.value - 9974.459) < 0.001]
    assert len(K) == 2
    assert pytest.approx(K[1].U, rel=1e-12) == K[0].U
    (repeatability,) = (r for r in results if "repeatability" in r.quantity)
    low, high = 2.0 / chi2.ppf([0.977249868, 0.022750132], 2)
    expected = repeatability.value * np.sqrt([low, high])
    np.testing.assert_allclose(repeatability.interval, expected, rtol=1e-4)


def test_runs_repeat_and_follow_temperature(runs):
    """K(T) within 3 ppm of each run's truth; sensitivity within 0.1 ppm/°C of the simulated;
    repeatability under 3 ppm.
    """
    root, truth = runs
    scales = record(root, "gyro_scale")
    curve = scales.model("gyro_x.K_over_temperature")
    assert curve.form == "polynomial/1"
    powers = [c.value for c in curve.coefficients]
    for log in truth["logs"].values():
        at = np.polynomial.polynomial.polyval(log["temp_case_degc"], powers)
        assert at == pytest.approx(log["gyro_x_lsb"]["K"], rel=3e-6)
    found = figures(scales)
    slope = found["temperature_sensitivity.IEEE Std 952.gyro_x"]
    assert slope.value == pytest.approx(truth["gyro"]["K_per_degc"] * 1e6, abs=0.1)
    assert found["temperature_sensitivity.GJB 2426A.gyro_x"].value == pytest.approx(
        abs(slope.value), abs=0.1
    )
    assert 0.0 < found["repeatability.GJB 2426A.gyro_x"].value < 3.0
    # 0.6 ppm of K over 25 °C, and runs that are 3 ppm off the curve at most
    assert found["temperature_sensitivity.GJB 2426A.gyro_x"].standard_uncertainty < 0.1
    assert curve.residual_rms < 3e-6 * curve.coefficients[0].value
    assert {"gyro_x", "gyro_x.room_1", "gyro_x.at_-40"} <= {
        m.name for m in scales.models if m.form == "gyro-scale/1"
    }


def test_validation_holds_unseen_runs_against_the_frozen_scale_factor(runs, tmp_path, calibkit):
    """One K for all temperatures is off by what the gyro changes to 0 °C, K(T) by less than 3 ppm;
    the gain is 1.
    """
    root, truth = runs
    out = tmp_path / "v.json"
    outcome = calibkit("validate", "G", runs=root / "runs", data=root / "unseen", out=out)
    assert outcome.code == 0, outcome.err
    logs = {
        log["name"]: log["gyros"][0] for log in json.loads(out.read_text(encoding="utf-8"))["logs"]
    }
    for name, stand in logs.items():
        assert stand["K"] == pytest.approx(truth["logs"][name]["gyro_x_lsb"]["K"], rel=3e-6)
        assert abs(stand["scale_factor_error_ppm"]) < 3.0
        assert abs(stand["after"]["scale_factor_error_ppm"]) < 3.0
        assert stand["rate_gain"] == pytest.approx(1.0, abs=3e-6)
        assert stand["nonlinearity_full_scale_ppm"] < 10.0
    cold = truth["gyro"]["K_per_degc"] * (0.0 - 25.0) * 1e6
    assert logs["at_0.csv"]["before"]["scale_factor_error_ppm"] == pytest.approx(cold, abs=3.0)
    assert calibkit("verify", out).code == 0


@pytest.mark.parametrize(
    ("ratio", "scale", "turn"), [("N", 40e-6, 0.0), ("gamma", 0.0, 40e-6)], ids=["N", "gamma"]
)
def test_another_pair_is_rejected_by_its_ratios(
    pair, tmp_path, calibkit, log_writer, ratio, scale, turn
):
    """Runs of which gyro B has 40 ppm more counts, or of gyros 40 µrad nearer to each other: N or
    γ of the unseen runs differs by far more than its uncertainty where it is stated that scale
    factors repeat to 1 ppm, and nothing is decided of N where it is not.
    """
    root, _ = pair
    stated = 'errors.component=[{group="run",effect="scale",value=1.0,unit="ppm",dof=20.0}]'
    fit(calibkit, "gyro_pair", root / "logs", tmp_path / "runs", "site.latitude_deg=34.2", stated)
    campaign = simulate.pair(1, noise_lsb=5.0)
    write(tmp_path / "again", campaign)
    for axis, other in (("a", "b"), ("b", "a")):
        path = tmp_path / "again" / f"table_axis_{axis}.csv"
        raw = np.genfromtxt(path, delimiter=",", names=True)
        columns = {name: raw[name] for name in raw.dtype.names}
        columns[f"gyro_{other}_lsb"] += 1e4 * turn * columns["table_rate_dps"]
        columns["gyro_b_lsb"] *= 1.0 + scale
        log_writer(path, **columns)
    out = tmp_path / "v.json"
    data = ("--data", tmp_path / "again", "--out", out)
    assert calibkit("validate", "G", "--runs", root / "runs", *data).code in {0, 1}
    undecided = {entry["name"] for entry in json.loads(out.read_text())["acceptance"]}
    assert "pair: error of gamma over its u" in undecided
    assert "pair: error of N over its u" not in undecided
    out.unlink()
    outcome = calibkit("validate", "G", "--runs", tmp_path / "runs", *data)
    assert outcome.code == 1, outcome.out
    judged = {entry["name"]: entry for entry in json.loads(out.read_text())["acceptance"]}
    passed = {
        name: judged[f"pair: error of {name} over its u"]["passed"] for name in ("N", "gamma")
    }
    assert passed == {"N": ratio != "N", "gamma": ratio != "gamma"}


def test_what_is_known_of_the_table_is_in_the_uncertainty_of_k(runs, tmp_path, calibkit):
    """A run 50 ppm off is rejected, and accepted where the table's rate is known to 100 ppm."""
    root, _ = runs
    text = (ROOT / "recipes" / "rate_table.toml").read_text(encoding="utf-8")
    text += '\n[[type_b]]\nname = "rate"\nquantity = "table_rate_dps"\nunit = "ppm"\n'
    (tmp_path / "table.toml").write_text(text + "standard_uncertainty = 100.0\n")
    fit(calibkit, tmp_path / "table.toml", root / "logs", tmp_path / "runs")
    log = root / "unseen" / "at_0.csv"
    lines = log.read_text(encoding="utf-8").splitlines()
    at = lines[0].split(",").index("gyro_x_lsb")
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = repr(float(row[at]) * (1.0 + 50e-6))
    (tmp_path / "other").mkdir()
    shifted = "\n".join([lines[0], *map(",".join, rows)])
    (tmp_path / "other" / log.name).write_text(shifted, encoding="utf-8")
    codes = [
        calibkit(
            *("validate", "G", "--runs", folder, "--data", tmp_path / "other"),
            *("--out", tmp_path / f"{number}.json"),
        ).code
        for number, folder in enumerate((root / "runs", tmp_path / "runs"))
    ]
    assert codes == [1, 0]


def rows_of(path):
    """Header and rows of a CSV as texts."""
    header, *rows = (line.split(",") for line in path.read_text(encoding="utf-8").splitlines())
    return header, rows


def test_apply_adds_the_compensated_rate_and_keeps_every_number(runs, tmp_path, calibkit):
    """The mean of each held rate of an unseen cold log is the table's within 5 ppm; all other
    fields keep their numbers.
    """
    root, _ = runs
    log, out = root / "unseen" / "at_0.csv", tmp_path / "out.csv"
    outcome = calibkit("apply", "G", "--runs", root / "runs", "--data", log, "--out", out)
    assert outcome.code == 0, outcome.err
    assert "the earth's rate there is taken out" in outcome.err
    (before, old), (after, new) = rows_of(log), rows_of(out)
    assert after == [*before, "gyro_x_dps"]
    assert [list(map(float, row[:-1])) for row in new] == [list(map(float, row)) for row in old]
    found = np.array([float(row[-1]) for row in new])
    table = np.array([float(row[before.index("table_rate_dps")]) for row in new])
    fast = np.abs(table - 100.0) < 0.01
    settled = np.flatnonzero(fast)[3:-3]
    assert found[settled].mean() == pytest.approx(table[settled].mean(), rel=5e-6)


def test_inertial_compensation_leaves_the_earths_rate_in(pair, tmp_path, calibkit):
    """It differs from the laboratory's by ω_e sin φ in every row, and is refused without a
    latitude.
    """
    root, _ = pair
    log = root / "logs" / "table_axis_a.csv"
    results = []
    for name, extra in (("lab.csv", ()), ("inertial.csv", ("--set", "compensation=inertial"))):
        calibkit("apply", "G", *extra, runs=root / "runs", data=log, out=tmp_path / name)
        results.append(np.genfromtxt(tmp_path / name, delimiter=",", names=True))
    for column in ("gyro_a_dps", "gyro_b_dps"):
        assert results[1][column] - results[0][column] == pytest.approx(VERTICAL_DPS, rel=1e-6)
    refused = calibkit(
        "fit",
        "gyro_pair",
        data=root / "logs",
        serial="X",
        out=tmp_path,
        set="compensation=inertial",
    )
    assert refused.code == 2
    assert "latitude_deg" in refused.err


def test_apply_clamps_the_temperature_and_needs_it_where_k_follows_it(
    runs, tmp_path, calibkit, log_writer
):
    """90 °C is said to be clamped; a log without temperature, or with neither gyro, exits with
    3.
    """
    root, _ = runs
    hot = log_writer(tmp_path / "hot.csv", temp_case_degc=[90.0, 25.0], gyro_x_lsb=[1e4, 2e4])
    outcome = calibkit("apply", "G", runs=root / "runs", data=hot, out=tmp_path / "o.csv")
    assert outcome.code == 0, outcome.err
    assert "over 50.0 % of the rows, clamped" in outcome.err
    curves = [
        record(root, "gyro_scale").model(f"gyro_x.{letter}_over_temperature")
        for letter in ("K", "F0")
    ]
    held = curves[0].valid["temp_case_degc"][1]
    K, F0 = (
        np.polynomial.polynomial.polyval(held, [c.value for c in curve.coefficients])
        for curve in curves
    )
    assert np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)["gyro_x_dps"][
        0
    ] == pytest.approx((1e4 - F0) / K, rel=1e-9)
    bare = log_writer(tmp_path / "bare.csv", time_s=[0.0, 1.0], gyro_x_lsb=[1e4, 2e4])
    outcome = calibkit("apply", "G", runs=root / "runs", data=bare, out=tmp_path / "p.csv")
    assert (outcome.code, "column 'temp_case_degc' is missing" in outcome.err) == (3, True)
    other = log_writer(tmp_path / "other.csv", time_s=[0.0, 1.0], gyro_q_lsb=[1e4, 2e4])
    outcome = calibkit("apply", "G", runs=root / "runs", data=other, out=tmp_path / "q.csv")
    assert (outcome.code, "column 'gyro_x_lsb' is missing" in outcome.err) == (3, True)


def healthy():
    """Columns of a small healthy log."""
    time, rate = held_rates()
    wobble = np.sin(time)
    return {"time_s": time, "table_rate_dps": rate, "gyro_x_lsb": 1e4 * rate + 20.0 + wobble}


def changed(name, rows, value):
    """Return healthy columns with some values of one replaced."""
    columns = healthy()
    columns[name] = columns[name].copy()
    columns[name][rows] = value
    return columns


def one_rate(rates):
    """Return healthy columns of a log that holds these rates alone."""
    time, rate = held_rates(rates)
    return {"time_s": time, "table_rate_dps": rate, "gyro_x_lsb": 1e4 * rate + 20.0 + np.sin(time)}


BAD = {
    "missing column": (
        lambda: {("rate" if k == "table_rate_dps" else k): v for k, v in healthy().items()},
        ("run.csv:1: column 'table_rate_dps' is missing", "[columns.table_rate_dps]"),
    ),
    "table at rest with noise": (
        lambda: changed("table_rate_dps", slice(None), 1e-5 * np.cos(np.arange(480.0))),
        (
            "run.csv: the table never turns",
            "expected held rates of the table",
            "rates other than zero",
        ),
    ),
    "too few rates": (
        lambda: one_rate([10.0, -10.0, 10.0]),
        (
            "run.csv: 2 held rates (-10, 10 °/s) on 3 plateaus, expected at least 3 different ones",
            "plateaus.shortest_s",
        ),
    ),
    "never held": (
        lambda: changed("table_rate_dps", slice(None), np.linspace(-100.0, 100.0, 480)),
        ("run.csv: no held rate of 2 s", "expected held rates of the table"),
    ),
    "another unit": (
        lambda: healthy() | {"table_rate_dps": 3600.0 * healthy()["table_rate_dps"]},
        (
            "run.csv:122: column 'table_rate_dps': 36000 °/s",
            "state the log's unit in [columns.table_rate_dps]",
        ),
    ),
    "angle of another sign": (
        lambda: (
            (slow := one_rate([1.0, 5.0, 20.0, -5.0]))
            | {"table_angle_deg": -np.cumsum(slow["table_rate_dps"])}
        ),
        (
            "run.csv: column 'table_angle_deg': it turns -1 times as fast as 'table_rate_dps' says",
            "state sign = -1",
        ),
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_an_unusable_log_is_refused_by_check_and_fit(name, tmp_path, calibkit, log_writer):
    """Exit code 3, one line that names place, found, expected and advice, and nothing is
    written.
    """
    make, fragments = BAD[name]
    log_writer(tmp_path / "logs" / "run.csv", **make())
    fitted = calibkit(
        "fit", "rate_table", data=tmp_path / "logs", serial="S", out=tmp_path / "runs"
    )
    assert fitted.code == 3, fitted.err
    assert len(fitted.err.strip().splitlines()) == 1
    checked = calibkit("check", "rate_table", "--data", tmp_path / "logs")
    assert checked.code == 3
    for fragment in fragments:
        assert fragment in fitted.err
        assert fragment in checked.out + checked.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("setting", "code", "fragment"),
    [
        ("acceptance.max_repeatability_ppm=5.0", 3, "these logs cannot show that figure"),
        (
            "acceptance.max_temperature_sensitivity_ppm_degc=5.0",
            3,
            "these logs cannot show that figure",
        ),
        ("gyros=['x', 'x']", 2, "a gyro stands twice"),
        ("plateaus.shortest=3.0", 2, "did you mean 'shortest_s'?"),
        ("nominal_scale_factor=0.0", 2, "turns no count into a rate"),
        ("table.reference=angle", 3, "column 'table_angle_deg' is missing"),
    ],
)
def test_what_cannot_be_shown_or_meant_is_refused(
    setting, code, fragment, tmp_path, calibkit, log_writer
):
    """A limit on a figure that one run cannot show exits with 3 and is never passed; recipe faults
    exit with 2.
    """
    log_writer(tmp_path / "logs" / "run.csv", **healthy())
    outcome = calibkit(
        "fit", "rate_table", data=tmp_path / "logs", serial="S", out=tmp_path / "r", set=setting
    )
    assert outcome.code == code, outcome.err
    assert fragment in outcome.err
    assert not (tmp_path / "r").exists()


def test_a_pair_without_one_of_its_logs_or_with_swapped_columns_is_refused(
    tmp_path, calibkit, log_writer
):
    """An excluded axis is a recipe fault (2); B indicating more about A's axis than about its own
    is unusable data (3).
    """
    folder = exact_pair(tmp_path / "logs", CASES[1], log_writer)
    exclude = "exclude=[{log='table_axis_b', reason='r', person='p'}]"
    arguments = (
        "fit",
        "gyro_pair",
        "--data",
        folder,
        "--serial",
        "S",
        "--out",
        tmp_path / "r",
        "--set",
    )
    outcome = calibkit(*arguments, exclude)
    assert (outcome.code, "no log about table axis b" in outcome.err) == (2, True)
    outcome = calibkit(*arguments, "pair={axis_a='table_axis_b.csv', axis_b='table_axis_a.csv'}")
    assert (outcome.code, "far beyond 1" in outcome.err) == (3, True)
    outcome = calibkit(*arguments, "pair.axis_b=table_axis_a.csv")
    assert (outcome.code, "each table axis has its own log" in outcome.err) == (2, True)
    assert not (tmp_path / "r").exists()


def test_the_set_points_of_a_calibration_are_inside_its_range(tmp_path, calibkit):
    """The runs at −40 °C and 60 °C that were fitted are not clamped, by apply nor by firmware:
    their soaks are the range.
    """
    runs, data = tmp_path / "runs", ROOT / "datasets" / "rate_table"
    assert calibkit("fit", "rate_table", "--data", data, "--serial", "S", "--out", runs).code in (
        0,
        1,
    )
    chain = chain_of(runs / "S/r001")
    flag = 1 << chain.structure.flags.index("TEMP_CLAMPED")

    def clamped(log):
        return correct(chain, log)[1] & flag != 0

    for name in ("at_-40", "at_60", "room_1"):
        out = tmp_path / f"{name}.csv"
        done = calibkit("apply", "S", "--runs", runs, "--data", data / f"{name}.csv", "--out", out)
        assert done.code == 0
        assert "temperature outside" not in done.err
        assert not clamped(pd.read_csv(data / f"{name}.csv")).any()
    warm = pd.read_csv(data / "at_60.csv")
    warm["temp_case_degc"] += 3.0
    warm.to_csv(tmp_path / "warm.csv", index=False)
    call = ("apply", "S", "--runs", runs, "--data", tmp_path / "warm.csv", "--out")
    assert "temperature outside" in calibkit(*call, tmp_path / "w0.csv").err
    assert clamped(warm).all()


def one_row_log(name, slope, degc, rng):
    """Log of rows that are means over a held rate each."""
    rate = np.array(RATES)
    shown = slope * rate + rng.normal(0.0, 0.3, rate.size)
    columns = {"table_rate_dps": rate, "gyro_x_lsb": shown, "temp_case_degc": degc}
    frame = pd.DataFrame(columns)
    return Log(name, f"{name}.csv", name, len(frame), frame)


def test_room_runs_on_both_sides_of_half_a_degree_are_one_temperature():
    """Runs at 24.4 and 24.6 °C tell no third power of temperature: U of K(T) stays below 10 ppm
    between the temperatures.
    """
    temperature = np.array([24.45, 24.55, 24.6, -40.0, -40.1, 60.0])
    spec = instruments.parse_recipe(recipe.find("rate_table", ("plateaus.one_row=true",)))
    rng = np.random.default_rng(5)
    K = 12345.6 * (1.0 + 1e-6 * rng.standard_normal(temperature.size))
    runs = [
        table_runs.fit_run(spec, one_row_log(f"run_{k}", slope, degc, rng))
        for k, (slope, degc) in enumerate(zip(K, temperature, strict=True))
    ]
    (gyro,) = gyro_fit.fit_campaign(spec, {"": runs}).channels
    u = POLYNOMIAL.standard_uncertainty(gyro.curves[0], {"temp_case_degc": np.array([-10.0])})
    assert u[0] < 5e-6 * 12345.6


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_temperature_sensitivity_has_the_sign_of_the_relative_change(sign):
    """A scale factor whose size grows by 13 ppm/°C has that sensitivity, whatever its sign."""
    spec = instruments.parse_recipe(recipe.find("rate_table", ("plateaus.one_row=true",)))
    rng = np.random.default_rng(6)
    runs = []
    for k, degc in enumerate((25.0, 25.1, -40.0, -10.0, 60.0)):
        K = sign * 12345.6 * (1.0 + 13e-6 * (degc - 25.0))
        runs.append(table_runs.fit_run(spec, one_row_log(f"run_{k}", K, degc, rng)))
    (gyro,) = gyro_fit.fit_campaign(spec, {"": runs}).channels
    found = {figure.name: figure for figure in gyro.figures}
    for standard in ("IEEE Std 952", "GJB 2426A"):
        figure = found[f"temperature_sensitivity.{standard}.gyro_x"]
        assert figure.value == pytest.approx(13.0, abs=0.5)


def test_the_orthogonality_error_has_the_uncertainty_of_the_angle(pair):
    """90° − α with u and degrees of freedom of α, the indicated γ with those of γ: without them U
    was that of the model's, a third too small.
    """
    found = figures(record(pair[0], "gyro_orthogonality"))
    for name, source in (("orthogonality_error_deg", "alpha_deg"), ("gamma_indicated", "gamma")):
        one, other = found[name], found[source]
        assert (one.standard_uncertainty, one.effective_dof) == (
            other.standard_uncertainty,
            other.effective_dof,
        )
        assert one.effective_dof < 10.0
