"""Gyros over three table axes end to end: sensitivities, angles and misalignment over temperature,
rates about the base.
"""

import json

import numpy as np
import pytest

from calibkit import recipe
from calibkit.certificate import conformity
from calibkit.instruments import silent
from calibkit.instruments.gyro_scale import simulate
from calibkit.recipe import type_b
from calibkit.records import store
from calibkit.results import comparison, evaluation

LATITUDE = "site.latitude_deg=34.2"
VERTICAL_DPS = 15.041067 / 3600.0 * np.sin(np.radians(34.2))
RATES = (5.0, 20.0, 60.0, 100.0, -5.0, -20.0, -60.0, -100.0)
HELD = 30
"""Rows of a held rate in the hand-made logs, one a second."""
TETRAD = (
    np.array([[1.0, 0.01, -0.02], [0.0, 1.1, 0.03], [0.02, 0.0, 0.9], [0.58, 0.57, 0.59]]) * 1e4
)
BIAS = np.array([12.0, -7.0, 3.0, 20.0])
GYROS = ("p", "q", "r", "s")


def write(folder, campaign):
    """Write a campaign's files and return its truth."""
    for name, content in campaign.files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return json.loads((folder / "truth.json").read_text(encoding="utf-8"))


def exact(
    folder, log_writer, sensitivity, bias, gyros, *, skew=0.0, name="about_{}.csv", degc=None
):
    """Noise-free logs about three axes; a tenth of a millionth of a count of dither keeps no column
    constant.
    """
    rate = np.repeat(np.array(RATES), HELD)
    dither = 1e-7 * (-1.0) ** np.arange(rate.size)
    for axis, letter in enumerate("xyz"):
        turning = np.zeros((rate.size, 3))
        turning[:, axis] = rate + VERTICAL_DPS
        counts = turning @ (sensitivity + skew).T + bias
        columns = {f"gyro_{g}_lsb": counts[:, k] + dither for k, g in enumerate(gyros)}
        temperature = (
            {}
            if degc is None
            else {"temp_case_degc": np.full(rate.size, degc) + 1e-3 * dither * 1e7}
        )
        time = np.arange(rate.size) * 1.0
        log_writer(
            folder / name.format(letter), time_s=time, table_rate_dps=rate, **temperature, **columns
        )
    return folder


def fit(calibkit, folder, out, *settings, code=0):
    """Fit the shipped recipe and return the run."""
    arguments = [part for setting in settings for part in ("--set", setting)]
    outcome = calibkit("fit", "gyro_triad", *arguments, data=folder, serial="G", out=out)
    assert outcome.code == code, outcome.err
    return store.load(store.find("G", out)) if code in {0, 1} else outcome


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Return folder and truth of simulated gyros (seed 1) at four temperatures, and withheld at a
    fifth.
    """
    folder = tmp_path_factory.mktemp("triad")
    return folder, write(folder, simulate.triad(1))


@pytest.fixture(scope="module")
def fitted(campaign, tmp_path_factory):
    """Return the runs' folder of that campaign's fit, figures drawn."""
    from calibkit.commands import pipeline

    out = tmp_path_factory.mktemp("runs")
    pipeline.fit(
        recipe.find("gyro_triad", (LATITUDE,)), campaign[0], "G", out, "2026-11-21", silent
    )
    return out


def test_sensitivities_and_angles_are_the_simulated_ones_at_every_temperature(campaign, fitted):
    """Four temperatures: own scale factors within 3 ppm, angles within 4 standard uncertainties and
    0.2 millidegrees.
    """
    record = store.load(store.find("G", fitted)).records["gyro_orthogonality.json"]
    figures = {figure.name: figure for figure in record.figures}
    for degc, truth in campaign[1]["at"].items():
        if degc == "40":
            continue
        suffix = "" if degc == "25" else f".at_{degc}"
        model = record.model(f"triad{suffix}")
        for g, gyro in enumerate("xyz"):
            assert model.value(f"S_{gyro}{gyro}") == pytest.approx(
                truth["sensitivity"][g][g], rel=3e-6
            )
            for h in range(g + 1, 3):
                angle = figures[f"angle_deg.{gyro}_{'xyz'[h]}{suffix}"]
                error = angle.value - truth["angles_deg"][g][h]
                assert abs(error) < 4.0 * angle.standard_uncertainty
                assert abs(error) < 2e-4


def test_unseen_runs_at_an_unseen_temperature_come_out_right(calibkit, campaign, fitted, tmp_path):
    """Withheld at 40 °C: along and across the turned axis within 10 ppm of full scale,
    uncompensated 1000.
    """
    outcome = calibkit(
        "validate", "G", runs=fitted, data=campaign[0] / "withheld", out=tmp_path / "v.json"
    )
    assert outcome.code == 0, outcome.err
    for log in json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))["logs"]:
        assert log["before"]["cross_axis_max_ppm_of_full_scale"] > 1000.0
        assert log["after"]["cross_axis_max_ppm_of_full_scale"] < 10.0
        assert log["after"]["rate_error_max_ppm_of_full_scale"] < 10.0
        assert log["rate_gain"] == pytest.approx(1.0, abs=3e-6)


def test_a_compensated_log_holds_the_rates_about_the_base(calibkit, campaign, fitted, tmp_path):
    """Every row and column stays; held rates come out along y with the earth's, nothing along x and
    z, to 1 millidegree/s.
    """
    log = campaign[0] / "withheld" / "about_y_40.csv"
    outcome = calibkit("apply", "G", "--runs", fitted, "--data", log, "--out", tmp_path / "o.csv")
    assert outcome.code == 0, outcome.err
    before, after = (np.genfromtxt(path, delimiter=",") for path in (log, tmp_path / "o.csv"))
    assert np.array_equal(before[1:], after[1:, : before.shape[1]])
    table = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)
    still = np.abs(table["table_rate_dps"] - 10.0) < 1e-3
    assert still.sum() > 30
    assert np.mean(table["rate_y_dps"][still]) == pytest.approx(10.0 + VERTICAL_DPS, abs=1e-3)
    assert np.mean(table["rate_x_dps"][still]) == pytest.approx(0.0, abs=1e-3)
    assert np.mean(table["rate_z_dps"][still]) == pytest.approx(0.0, abs=1e-3)


def test_four_gyros_in_skewed_axes_are_solved_exactly(calibkit, tmp_path, log_writer):
    """Without noise: sensitivities to 1e-9, biases to 1e-6 counts/s, rates about the base to 1e-8
    °/s.
    """
    (tmp_path / "logs").mkdir()
    exact(tmp_path / "logs", log_writer, TETRAD, BIAS, GYROS)
    run = fit(calibkit, tmp_path / "logs", tmp_path / "runs", LATITUDE, "gyros=['p','q','r','s']")
    model = run.records["gyro_orthogonality.json"].model("triad")
    for g, gyro in enumerate(GYROS):
        for axis, letter in enumerate("xyz"):
            assert model.value(f"S_{gyro}{letter}") == pytest.approx(TETRAD[g, axis], abs=1e-5)
        assert model.value(f"B_{gyro}") == pytest.approx(BIAS[g], abs=1e-6)
    log = tmp_path / "logs" / "about_z.csv"
    calibkit("apply", "G", "--runs", tmp_path / "runs", "--data", log, "--out", tmp_path / "o.csv")
    table = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)
    assert table["rate_z_dps"] == pytest.approx(table["table_rate_dps"] + VERTICAL_DPS, abs=1e-8)
    assert np.max(np.abs(table["rate_x_dps"])) < 1e-8


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("axes.x=['about_*.csv']", "a log of the table axes x and y"),
        ("axes.y=['elsewhere.csv']", "about_y.csv: a log of no table axis"),
        ("logs.files=['about_x.csv','about_y.csv']", "no log about table axis z"),
        ("gyros=['x','x']", "a gyro stands twice"),
        ("response='auto'", "response"),
    ],
)
def test_logs_that_are_not_of_three_axes_are_refused_by_name(
    calibkit, tmp_path, log_writer, setting, named
):
    """One line, a usage or data exit code, nothing written."""
    (tmp_path / "logs").mkdir()
    exact(tmp_path / "logs", log_writer, TETRAD[:3], BIAS[:3], ("x", "y", "z"))
    outcome = calibkit(
        "fit", "gyro_triad", data=tmp_path / "logs", serial="G", out=tmp_path / "r", set=setting
    )
    assert outcome.code in {2, 3}
    assert named in outcome.err
    assert not (tmp_path / "r").exists()


def test_exchanged_logs_are_refused_in_fit_and_in_validation(calibkit, tmp_path, log_writer):
    """About x and about y under each other's names: gyro x senses axis y most; in `validate` the
    rate is not the table's.
    """
    for name in ("good", "exchanged", "new"):
        (tmp_path / name).mkdir()
        exact(
            tmp_path / name,
            log_writer,
            TETRAD[:3] * (1.0 if name != "new" else 1.001),
            BIAS[:3],
            ("x", "y", "z"),
        )
    for name in ("exchanged", "new"):
        x, y = (tmp_path / name / f"about_{axis}.csv" for axis in "xy")
        first, second = x.read_bytes(), y.read_bytes()
        x.write_bytes(second)
        y.write_bytes(first)
    outcome = fit(calibkit, tmp_path / "exchanged", tmp_path / "r", LATITUDE, code=3)
    assert "gyro x senses table axis y most" in outcome.err
    fit(calibkit, tmp_path / "good", tmp_path / "runs", LATITUDE)
    outcome = calibkit(
        "validate", "G", runs=tmp_path / "runs", data=tmp_path / "new", out=tmp_path / "v.json"
    )
    assert outcome.code == 3
    assert "the rate about x comes out" in outcome.err
    assert not (tmp_path / "v.json").exists()


def test_a_temperature_without_a_run_about_each_axis_is_refused(calibkit, tmp_path, log_writer):
    """Three axes at 25 °C and two of them at 60 °C: the missing one is named with its
    temperature.
    """
    (tmp_path / "logs").mkdir()
    for degc in (25.0, 60.0):
        name = f"about_{{}}_{degc:.0f}.csv"
        exact(
            tmp_path / "logs",
            log_writer,
            TETRAD[:3],
            BIAS[:3],
            ("x", "y", "z"),
            name=name,
            degc=degc,
        )
    (tmp_path / "logs" / "about_y_60.csv").unlink()
    outcome = fit(calibkit, tmp_path / "logs", tmp_path / "runs", LATITUDE, code=3)
    assert "no log about table axis y near 60.0 °C" in outcome.err


MOUNTING = 'errors.component=[{group="mounting",effect="angle",value=0.003,unit="deg",dof=10.0}]'
FIXTURE = type_b.TypeB(name="table axes", quantity="angle_deg", unit="deg", half_width=0.003)


@pytest.mark.parametrize("by", ["nothing", "recipe", "profile"])
def test_no_limit_on_an_angle_is_decided_while_its_mounting_is_not_stated(calibkit, tmp_path, by):
    """Limits on angles, unit vectors and rates across accept nothing, a specification gets no
    statement and a comparison no answer, where nothing tells how a mounting repeats; one that is
    exceeded rejects.
    """
    runs = tmp_path / "runs"
    statement = MOUNTING if by == "recipe" else "errors.component=[]"
    limits = "acceptance={max_angle_uncertainty_deg=0.02,max_orthogonality_error_deg=1.0}"
    for noise in (1, 2):
        logs = simulate.triad(1, temperatures_degc=(25.0,), withheld_degc=(), noise_lsb=noise)
        write(tmp_path / str(noise), logs)
        run = fit(calibkit, tmp_path / str(noise), runs, statement, limits)
    names = {criterion["name"] for criterion in run.document["acceptance"]}
    angles = {"orthogonality error", "standard uncertainty of an angle"}
    assert names & angles == (angles if by == "recipe" else set())
    flags = run.records["gyro_orthogonality.json"].flags
    assert any("error of mounting again" in flag for flag in flags) == (by != "recipe")
    found = evaluation.RunResults.read(run, (FIXTURE,) if by == "profile" else ())
    by_name = {quantity.name: quantity for quantity in found.quantities}
    for name in ("angle_deg.x_y", "K_x_about_y"):
        result = found.state(by_name[name], {"temp_case_degc": 25.0})
        verdict, _ = conformity._judge(result, -1e9, 1e9, "guarded")
        assert (verdict == "pass") == (by != "nothing"), name
    before, after = (store.load(store.find(f"G@r00{k}", runs)) for k in (1, 2))
    compared = comparison.compare(before, after, limits={"angle_deg.x_y": (1.0, "deg")}).compared
    answers = {of_result.quantity.name: of_result.answer for of_result in compared}
    assert answers["angle_deg.x_y"] == ("yes" if by == "recipe" else "cannot tell")
    strict = "acceptance={max_orthogonality_error_deg=1e-6}"
    run = fit(calibkit, tmp_path / "1", runs, statement, strict, code=1)
    assert run.document["verdict"] == "rejected"
