"""Noise of gyros and accelerometers at rest by the command line: figures, gaps, what is not
observable, limits, logs that cannot be used.
"""

import allantools
import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.certificate.stated import Stated
from calibkit.certificate.tables import format_result
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.commands import pipeline
from calibkit.instruments.gyro_noise import certificate, simulate
from calibkit.numeric.noise import allan
from calibkit.numeric.noise.allan_fit import LAWS
from calibkit.records import store
from calibkit.simulate import noise


@pytest.fixture(scope="module")
def white(tmp_path_factory):
    """Return a folder with one record of white noise of 0.01 °/√h at 2 Hz, and its rate."""
    from conftest import write_log

    folder = tmp_path_factory.mktemp("white")
    rate = 8.0 + noise.angle_random_walk(0.01, 8000, np.random.default_rng(5), interval_s=0.5)
    write_log(folder / "still.csv", time_s=np.arange(8000) * 0.5, gyro_dph=rate)
    return folder, rate


def fitted(calibkit, folder, out, *more):
    """Run of a fit, its outcome."""
    outcome = calibkit("fit", "gyro_noise", "--data", folder, "--serial", "G", "--out", out, *more)
    return outcome, (store.load(out / "G" / "r001") if outcome.code in (0, 1) else None)


def figures(run):
    """Figures of the run by name."""
    return {figure.name: figure for figure in run.records["gyro_noise.json"].figures}


def test_the_deviations_in_the_file_are_those_of_the_peer(calibkit, white, tmp_path):
    """Overlapping Allan deviation at every averaging time equals allantools' to 1e-9 relative."""
    folder, rate = white
    outcome, run = fitted(calibkit, folder, tmp_path)
    assert outcome.code == 0, outcome.err
    found = {
        float(n.split("_")[2]): f.value
        for n, f in figures(run).items()
        if n.startswith("allan_deviation")
    }
    taus, peer, _, _ = allantools.oadev(
        rate, rate=2.0, data_type="freq", taus=np.array(sorted(found))
    )
    assert taus.tolist() == sorted(found)
    assert [found[tau] for tau in taus] == pytest.approx(peer, rel=1e-9)


def test_white_noise_shows_its_angle_random_walk_and_nothing_else(calibkit, white, tmp_path):
    """N is 0.01 °/√h within three of its standard uncertainties; B, K, R, Q are said not to be
    observable, without a number.
    """
    outcome, run = fitted(calibkit, white[0], tmp_path, "--details")
    found = figures(run)
    walk = found["angle_random_walk.still"]
    assert abs(walk.value - 0.01) < 3.0 * walk.standard_uncertainty < 0.0005
    for name in ("bias_instability", "rate_random_walk", "rate_ramp", "quantization"):
        assert not any(figure.startswith(name) for figure in found)
        assert any(
            name in flag and "not observable" in flag
            for flag in run.records["gyro_noise.json"].flags
        )
    assert outcome.out.count("not observable") >= 4


def test_a_gap_in_time_and_a_missing_rate_are_gaps(calibkit, white, tmp_path, log_writer):
    """Rows left out, or empty, are counted and the curve is that of the record with holes; nothing
    is closed up.
    """
    rate, time = white[1].copy(), np.arange(8000) * 0.5
    kept = np.ones(8000, dtype=bool)
    kept[3000:3100] = False
    path = log_writer(tmp_path / "d/still.csv", time_s=time[kept], gyro_dph=rate[kept])
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[101] = lines[101].split(",")[0] + ","
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    outcome, run = fitted(calibkit, tmp_path / "d", tmp_path)
    assert outcome.code == 0, outcome.err
    rate[3000:3100] = np.nan
    rate[100] = np.nan
    expected = allan.overlapping(rate, 0.5)
    found = [f.value for n, f in figures(run).items() if n.startswith("allan_deviation")]
    assert found == pytest.approx(expected.deviation, rel=1e-9)
    assert any("101 of 8000 samples (1.3%) are missing" in flag for flag in run.document["flags"])


def test_a_limit_on_a_term_that_is_not_observable_is_held_against_what_it_can_be_at_most(
    calibkit, white, tmp_path
):
    """Of white noise the rate random walk is bounded by the curve: a limit above the bound passes,
    one below fails.
    """
    folder, rate = white
    bound = allan.overlapping(rate, 0.5)
    law = next(law for law in LAWS if law.symbol == "K")
    most = float(np.min(law.scale * bound.upper / np.sqrt(bound.tau_s)))
    for limit, code in ((1.01 * most, 0), (0.99 * most, 1)):
        outcome, _ = fitted(
            calibkit,
            folder,
            tmp_path / str(code),
            "--set",
            f"acceptance.max_rate_random_walk={limit!r}",
        )
        assert outcome.code == code
    assert "(not observable: at most)" in outcome.out


def test_a_noise_run_compensates_nothing(calibkit, white, tmp_path):
    """Apply of a noise run is refused with exit 2 and a word on what to apply."""
    fitted(calibkit, white[0], tmp_path)
    done = calibkit(
        "apply", "G", runs=tmp_path, data=white[0] / "still.csv", out=tmp_path / "a.csv"
    )
    assert (done.code, "nothing to compensate with" in done.err) == (2, True)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("uneven", "still.csv:502: a step of 0.7 s, expected a multiple of 0.5 s"),
        ("short", "200 rows"),
        ("constant", "gyro_dph"),
        ("backwards", "runs backwards"),
        ("infinite", "some infinite"),
    ],
)
def test_a_record_that_has_no_deviation_is_refused_with_its_place(
    calibkit, white, tmp_path, log_writer, change, said
):
    """Uneven sampling, too few rows, a rate that never changes, time that runs backwards, infinite
    rates: exit 3.
    """
    time, rate = np.arange(8000) * 0.5, white[1].copy()
    if change == "uneven":
        time[500:] += 0.2
    if change == "short":
        time, rate = time[:200], rate[:200]
    if change == "constant":
        rate[:] = 8.0
    if change == "backwards":
        time[500] = 10.0
    if change == "infinite":
        rate[7] = np.inf
    log_writer(tmp_path / "d/still.csv", time_s=time, gyro_dph=rate)
    outcome, _ = fitted(calibkit, tmp_path / "d", tmp_path)
    assert (outcome.code, said in outcome.err) == (3, True), outcome.err
    assert calibkit("check", "gyro_noise", "--data", tmp_path / "d").code == 3


def test_the_simulated_record_shows_its_noise_terms(calibkit, tmp_path):
    """Of the simulated gyro N and B are within three standard uncertainties of the truth, the gap
    notwithstanding.
    """
    made = simulate.campaign(3)
    path = tmp_path / "d" / "static.csv"
    path.parent.mkdir()
    path.write_bytes(made.files()["static.csv"])
    outcome, run = fitted(calibkit, tmp_path / "d", tmp_path)
    assert outcome.code == 0, outcome.err
    terms = made.truth["terms"]
    for symbol, name in (("N", "angle_random_walk"), ("B", "bias_instability")):
        figure = figures(run)[f"{name}.static"]
        assert (
            abs(figure.value - terms[symbol])
            < 3.0 * figure.standard_uncertainty
            < 0.3 * terms[symbol]
        )
    assert (run.folder / "report.html").read_bytes().startswith(b"<!DOCTYPE html>")


def states(run):
    """Tables and figures of a run on its certificate."""
    stated = Stated(run.records, TypeBTerms(()), (), 25.0)
    (block,) = certificate.blocks(stated)
    return block


@pytest.mark.parametrize("probability", [0.95, 0.8])
def test_limits_are_the_same_in_table_figure_and_certificate(white, tmp_path, probability):
    """Of the Allan and of the wavelet deviation, at every averaging time, with the probability of
    the recipe.
    """
    folder, rate = white
    source = recipe.find("gyro_noise", (f"noise.probability={probability}",))
    outcome = pipeline.fit(source, folder, "G", tmp_path, "2026-11-21", instruments.silent)
    curves = (
        allan.overlapping(rate, 0.5, probability=probability),
        allan.wavelet_deviation(rate, 0.5, probability=probability),
    )
    block = states(outcome.run)
    grid, plot = block.tables[1], block.figures[0]
    report = (outcome.run.folder / "report.txt").read_text(encoding="utf-8")
    for k, curve in enumerate(curves):
        expected = np.column_stack([curve.lower, curve.upper])
        stated = [row[k].interval for row in grid.cells if row[k] is not None]
        np.testing.assert_allclose(stated, expected, rtol=1e-9)
        drawn = np.column_stack([plot.series[k].low, plot.series[k].high])
        np.testing.assert_allclose(drawn, expected, rtol=1e-9)
        assert all(row[k].uncertainty.probability == probability for row in grid.cells if row[k])
        printed = (format_result(row[k])[1] for row in grid.cells if row[k] is not None)
        assert all(interval in report for interval in printed)


@pytest.fixture(scope="module")
def acceleration():
    """Return three hours of an accelerometer at rest in g at 1 Hz, z up: 80 µg/√Hz."""
    rng = np.random.default_rng(12)
    return {
        f"accel_{axis}_g": level + 80e-6 * rng.standard_normal(10_800)
        for axis, level in (("x", 0.002), ("y", -0.001), ("z", 1.001))
    }


COLUMNS = 'noise.columns=["accel_x_g", "accel_y_g", "accel_z_g"]'


def test_noise_of_accelerometers_is_stated_in_their_units(
    calibkit, acceleration, tmp_path, log_writer
):
    """Velocity random walk in µg/√Hz, mean and deviations in mg, in file, table, certificate and
    figure; what is not observable has the names of accelerometers.
    """
    log_writer(tmp_path / "d/still.csv", time_s=np.arange(10_800.0), **acceleration)
    outcome, run = fitted(calibkit, tmp_path / "d", tmp_path, "--set", COLUMNS, "--details")
    assert outcome.code == 0, outcome.err
    found = figures(run)
    for axis in "xyz":
        column = f"accel_{axis}_g"
        walk = found[f"velocity_random_walk.{column}.still"]
        assert walk.unit == "ug/sqrt(Hz)"
        assert abs(walk.value - 80.0) < 3.0 * walk.standard_uncertainty < 3.0
        mean = found[f"mean_acceleration.{column}.still"]
        assert (mean.value, mean.unit) == (pytest.approx(1e3 * acceleration[column].mean()), "mg")
        deviation = found[f"allan_deviation_1_s.{column}.still"]
        assert (deviation.value, deviation.unit) == (pytest.approx(0.08, rel=0.05), "mg")
    assert "acceleration_random_walk (K) not observable" in " ".join(run.document["flags"])
    assert "Allan deviation [mg]" in outcome.out
    assert not any(word in outcome.out for word in ("deg", "°", "angle", "rate random walk"))
    block = states(run)
    assert block.figures[0].y_label.en == "σ [mg]"
    assert block.tables[1].units == ("mg", "mg")
    made = calibkit("certify", "G", "--runs", tmp_path, "--out", tmp_path / "c.pdf")
    assert made.code == 0, made.err
    assert "\\hertz" in (tmp_path / "c.xml").read_text(encoding="utf-8")
