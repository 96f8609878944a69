"""The inclinometer procedure end to end: station logs in, s(T) out, applied at any latitude,
validated.
"""

import csv
import json

import numpy as np
import pandas as pd
import pytest

import calibkit as api
from calibkit import instruments, recipe
from calibkit.errors import FitError
from calibkit.instruments.inclinometer import (
    simulate as simulator,
    stations as inclinometer_stations,
)
from calibkit.records import store
from calibkit.simulate.campaign import _csv_text
from conftest import AUTHORITIES, ROOT

VECTORS = json.loads((AUTHORITIES / "four_position.json").read_text(encoding="utf-8"))["stations"]
READINGS = ("accel_x_g", "accel_y_g", "gyro_x_dph", "gyro_y_dph")
ANGLES = ("inclination_deg", "toolface_deg", "azimuth_deg")


def wrapped(angle):
    """Angle in [−180, 180)."""
    return np.remainder(np.asarray(angle) + 180.0, 360.0) - 180.0


def vector_rows(vectors, *, sign=1.0, order=(0, 1, 2, 3)):
    """Rows of worked examples, numbered from 1, positions in any order."""
    rows = []
    for number, vector in enumerate(vectors, start=1):
        for k in order:
            reading = dict(vector["readings"][k])
            for name in READINGS[:2]:
                reading[name] = sign * reading[name]
            rows.append({"station": number, **reading})
    return rows


def write_rows(path, rows):
    """Write rows as a log; a text stays as it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [",".join(rows[0]), *(",".join(str(value) for value in row.values()) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read_rows(path):
    """Rows of a written log as texts."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def simulated(folder, seed, *, part=slice(None), references=True, **options):
    """Write stations.csv of a simulated tool, every part-th station, with the true angles as
    reference; return them.
    """
    campaign = simulator.campaign(seed, **options)
    columns = {name: np.asarray(values) for name, values in campaign.logs["stations.csv"].items()}
    truth = campaign.truth["stations"]
    if references:
        columns |= {name: np.repeat(truth[name], 4) for name in ANGLES}
    chosen = np.unique(columns["station"])[part]
    keep = np.isin(columns["station"], chosen)
    folder.mkdir(parents=True, exist_ok=True)
    text = _csv_text(
        {name: values[keep] for name, values in columns.items()},
        {**campaign.decimals, **dict.fromkeys(ANGLES, 9)},
    )
    (folder / "stations.csv").write_text(text, encoding="utf-8")
    return {name: np.asarray(values)[chosen - 1] for name, values in truth.items()}


@pytest.fixture
def command(calibkit, tmp_path):
    """Return fit, apply, validate and check of the shipped recipe with settings."""

    class Commands:
        def settings(self, settings):
            return [part for setting in settings for part in ("--set", setting)]

        def fit(self, data, *settings, runs="runs", source="inclinometer"):
            arguments = ("--data", data, "--serial", "I", "--out", tmp_path / runs)
            outcome = calibkit("fit", source, *arguments, *self.settings(settings))
            run = store.load(store.find("I", tmp_path / runs)) if outcome.code in (0, 1) else None
            return outcome, run

        def apply(self, log, name, *settings, runs="runs"):
            out = tmp_path / name
            arguments = ("--runs", tmp_path / runs, "--data", log, "--out", out)
            outcome = calibkit("apply", "I", *arguments, *self.settings(settings))
            return outcome, (read_rows(out) if outcome.code == 0 else [])

        def validate(self, data, name="validation.json", runs="runs"):
            out = tmp_path / name
            outcome = calibkit("validate", "I", runs=tmp_path / runs, data=data, out=out)
            return outcome, (json.loads(out.read_text(encoding="utf-8")) if out.is_file() else None)

        def check(self, data, *settings):
            return calibkit("check", "inclinometer", "--data", data, *self.settings(settings))

    return Commands()


def compare(rows, vectors):
    """Hold applied rows against the worked examples to 1e-9 (angles modulo 360°), s by the
    corrected rates too.
    """
    for number, vector in enumerate(vectors, start=1):
        own = [row for row in rows if float(row["station"]) == number]
        assert len(own) == 4
        for row in own:
            for name in ANGLES:
                assert abs(wrapped(float(row[name]) - vector["expected"][name])) < 1e-9, (
                    number,
                    name,
                )
            raw = next(
                r for r in vector["readings"] if r["position_deg"] == float(row["position_deg"])
            )
            for name in READINGS[2:]:
                assert float(row[name]) == pytest.approx(
                    vector["expected"]["s"] * raw[name], abs=1e-7
                )


WAYS = {
    "as published": {},
    "specific force": {"sign": -1.0, "settings": ("reference.convention=specific_force",)},
    "another order of positions": {"order": (2, 0, 3, 1)},
    "x pair alone": {"settings": ("stations.pairs=x",), "pairs": "x"},
    "least squares": {"settings": ("stations.method=least_squares",)},
}


CASES = [("as published", k) for k in range(len(VECTORS))] + [(way, 8) for way in list(WAYS)[1:]]


@pytest.mark.parametrize(("way", "k"), CASES, ids=str)
def test_each_worked_example_comes_out_of_fit_and_apply_at_its_latitude(tmp_path, command, way, k):
    """One station fitted and applied alone gives θ, φ, ψ to 1e-9° and its s, by either convention,
    order and method.
    """
    options = WAYS[way]
    vector, settings = VECTORS[k], options.get("settings", ())
    rows = vector_rows(
        [vector], sign=options.get("sign", 1.0), order=options.get("order", (0, 1, 2, 3))
    )
    log = write_rows(tmp_path / "logs" / "stations.csv", rows)
    place = f"site.latitude_deg={vector['latitude_deg']}"
    outcome, run = command.fit(tmp_path / "logs", place, *settings)
    assert outcome.code == 0, outcome.err
    for model in run.records["inclinometer_scale.json"].models:
        assert model.value("s0") == pytest.approx(vector["expected"]["s"], abs=1e-9)
    outcome, written = command.apply(log, "out.csv")
    assert outcome.code == 0, outcome.err
    if options.get("pairs") == "x":
        assert all(
            abs(wrapped(float(row[n]) - vector["expected"][n])) < 1e-9
            for row in written
            for n in ANGLES
        )
    else:
        compare(written, [vector])


def test_the_run_holds_s_over_temperature_of_both_gyros(tmp_path, command):
    """One model per gyro of the contract's form, covariance and scatter; within 4 standard
    uncertainties of the truth.
    """
    truth = simulated(tmp_path / "logs", 5, count=60)
    outcome, run = command.fit(tmp_path / "logs")
    assert outcome.code == 0, outcome.err
    record = run.records["inclinometer_scale.json"]
    assert [model.name for model in record.models] == ["x", "y"]
    assert {figure.name for figure in record.figures} >= {
        "azimuth_rms_before",
        "azimuth_rms_after",
        "stations_refused",
    }
    assert record.conditions[0].name == "latitude"
    degc = truth["temp_case_degc"]
    for model in record.models:
        assert model.form == "inclinometer-scale/1"
        assert [c.name for c in model.coefficients] == [
            f"s{k}" for k in range(len(model.coefficients))
        ]
        covariance = np.array(model.covariance)
        powers = np.vander(degc, len(covariance), increasing=True)
        u = np.sqrt(
            np.einsum("ti,ij,tj->t", powers, covariance, powers) + model.value("scatter") ** 2
        )
        s = powers @ [c.value for c in model.coefficients]
        # 2e-4: the simulated s is a line and a wave of 1e-4, which a polynomial does not follow
        assert (np.abs(s - truth[f"s_{model.name}"]) < 4.0 * u + 2e-4).all()
        assert model.value("gyro_noise") == pytest.approx(0.01, rel=0.4)
        assert model.valid["temp_case_degc"][0] == pytest.approx(degc.min())


def test_a_log_without_temperature_gives_s0_alone(tmp_path, command):
    """Without temp_case_degc there is one coefficient and no range."""
    simulated(tmp_path / "all", 5)
    rows = read_rows(tmp_path / "all" / "stations.csv")
    for row in rows:
        del row["temp_case_degc"]
    write_rows(tmp_path / "logs" / "stations.csv", rows)
    _, run = command.fit(tmp_path / "logs")
    for model in run.records["inclinometer_scale.json"].models:
        assert [c.name for c in model.coefficients] == ["s0"]
        assert model.valid == {}
    outcome, _ = command.apply(tmp_path / "logs" / "stations.csv", "out.csv")
    assert outcome.code == 0


def test_random_stations_are_within_five_hundredths_of_a_degree_on_the_command_line(
    tmp_path, command
):
    """θ 5–50°, 34.2°, 0.01 °/h, unseen stations: rms ≤ 0.05°, 90–99 % in U, none worse than s = 1
    by more than U (k = 2).
    """
    before, after, stated = [], [], []
    for seed in range(2):
        simulated(tmp_path / f"{seed}" / "fit", seed, part=slice(0, None, 2), count=120)
        simulated(tmp_path / f"{seed}" / "new", seed, part=slice(1, None, 2), count=120)
        assert command.fit(tmp_path / f"{seed}" / "fit", runs=f"runs{seed}")[0].code == 0
        outcome, document = command.validate(
            tmp_path / f"{seed}" / "new", f"v{seed}.json", runs=f"runs{seed}"
        )
        assert outcome.code == 0, outcome.err
        log = document["logs"][0]
        assert log["after"]["azimuth_rms_deg"] < 0.05
        assert log["after"]["inclination_rms_deg"] < 0.01
        assert log["worse_than_uncorrected_over_u"] <= 2.0
        for station in log["stations"]:
            before.append(station["azimuth_error_before_deg"])
            after.append(station["azimuth_error_after_deg"])
            stated.append(2.0 * station["azimuth_standard_uncertainty_deg"])
    before, after, stated = (np.abs(values) for values in (before, after, stated))
    assert np.sqrt(np.mean(after**2)) < 0.035
    assert np.sqrt(np.mean(after**2)) < 0.75 * np.sqrt(np.mean(before**2))
    assert (after - before <= stated).all()
    # stations this few leave a turn of the gyros open, which is in U: twice what noise alone gives
    assert np.mean(after < stated) >= 0.90
    assert np.median(stated) < 4.5 * np.sqrt(np.mean(after**2))


def test_the_well_is_not_the_laboratory(tmp_path, command):
    """The same tool at 58.9° is right with --set site.latitude_deg, and says loudly that something
    is wrong without it.
    """
    tool = {"count": 72, "gyro_noise_dph": 0.003}
    simulated(tmp_path / "lab", 6, part=slice(0, None, 2), **tool)
    truth = simulated(tmp_path / "well", 6, part=slice(1, None, 2), latitude_deg=58.9, **tool)
    command.fit(tmp_path / "lab")
    outcome, rows = command.apply(
        tmp_path / "well" / "stations.csv", "out.csv", "site.latitude_deg=58.9"
    )
    assert outcome.code == 0
    error = wrapped([float(row["azimuth_deg"]) for row in rows[::4]] - truth["azimuth_deg"])
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert "contradict" not in outcome.err
    for log, place in (("well", ()), ("lab", ("site.latitude_deg=58.9",))):
        outcome, rows = command.apply(tmp_path / log / "stations.csv", f"wrong_{log}.csv", *place)
        assert outcome.code == 3
        assert "stations contradict s(T); check" in outcome.err
        assert not rows


@pytest.mark.parametrize("choice", ["history", "heading"])
def test_beyond_90_degrees_the_calibration_or_a_heading_chooses_the_root(tmp_path, command, choice):
    """At 60° and inclinations of 35 to 70° both roots are often positive; the right one is taken at
    every station.
    """
    tool = {"count": 60, "gyro_noise_dph": 0.002}
    simulated(tmp_path / "lab", 7, part=slice(0, None, 2), **tool)
    steep = {**tool, "latitude_deg": 60.0, "inclination_deg": (35.0, 70.0)}
    truth = simulated(tmp_path / "well", 7, part=slice(1, None, 2), **steep)
    command.fit(tmp_path / "lab")
    settings = ("site.latitude_deg=60.0", f"root.choice={choice}")
    outcome, rows = command.apply(tmp_path / "well" / "stations.csv", "out.csv", *settings)
    assert outcome.code == 0
    assert "both roots of s are positive" in outcome.err
    error = wrapped([float(row["azimuth_deg"]) for row in rows[::4]] - truth["azimuth_deg"])
    assert np.abs(error).max() < 0.3


def test_the_last_digit_of_a_log_is_found_in_its_own_unit():
    """Two decimals of °/h are 0.01 °/h, four of °/s 0.36 °/h; a single station's closure of zero is
    no proof of no noise.
    """
    source = recipe.find("inclinometer")
    data = np.array([8.25, -3.5, np.nan, 12.0])
    assert inclinometer_stations._resolution(
        data, "gyro_x_dph", instruments.parse_recipe(source)
    ) == pytest.approx(0.01)
    mapped = source.text + '[columns]\ngyro_x_dph = { from = "wx", unit = "deg/s" }\n'
    spec = instruments.parse_recipe(recipe.Source("mapped", mapped))
    data = 3600.0 * np.array([0.0023, -0.0011, 0.004])
    assert inclinometer_stations._resolution(data, "gyro_x_dph", spec) == pytest.approx(0.36)


def spoilt(rows, how):
    """Rows with one fault in station 2."""
    rows = [dict(row) for row in rows]
    if how == "missing":
        return [row for row in rows if (row["station"], row["position_deg"]) != ("2", "90")]
    changes = {
        "twice": ("position_deg", "0"),
        "odd": ("position_deg", "45"),
        "nan": ("gyro_x_dph", "nan"),
        "text": ("accel_y_g", "fault"),
        "m/s^2": ("accel_x_g", "9.7"),
    }
    column, value = changes[how]
    rows[5][column] = value
    return rows


REFUSALS = {
    "missing": (
        "station 2: no row at position 90°",
        "expected one row at each of 0°, 90°, 180°, 270°",
    ),
    "twice": ("stations.csv:7: station 2: position 0° stands 2 times", "least_squares"),
    "odd": ("stations.csv:7: station 2: position 45° is no multiple of 90°", "least_squares"),
    "nan": ("stations.csv:7: column 'gyro_x_dph': 1 missing", "a number in every row"),
    "text": ("stations.csv:7: column 'accel_y_g': found 'fault'", "expected a number"),
    "m/s^2": ("stations.csv:7: column 'accel_x_g': 9.7 g", "state the log's unit"),
}


@pytest.mark.parametrize("how", REFUSALS)
def test_a_spoilt_station_is_refused_with_place_and_next_step(tmp_path, command, how):
    """`fit` and `check` leave with 3 and one line: file, place, found, expected, what to do."""
    simulated(tmp_path / "good", 10, count=6, references=False)
    write_rows(
        tmp_path / "bad" / "stations.csv",
        spoilt(read_rows(tmp_path / "good" / "stations.csv"), how),
    )
    outcome, _ = command.fit(tmp_path / "bad")
    assert outcome.code == 3
    checked = command.check(tmp_path / "bad")
    assert checked.code == 3
    for part in REFUSALS[how]:
        assert part in outcome.err
        assert part in checked.out + checked.err
    assert len(outcome.err.strip().splitlines()) == 1
    assert not (tmp_path / "runs" / "I").exists()


def test_apply_leaves_a_spoilt_station_empty_and_solves_the_others(tmp_path, command):
    """Derived fields of station 2 are empty and its reason is said; the others' azimuths stay as
    they were.
    """
    simulated(tmp_path / "good", 10, count=12, references=False)
    command.fit(tmp_path / "good")
    _, whole = command.apply(tmp_path / "good" / "stations.csv", "whole.csv")
    for how in ("missing", "twice", "odd"):
        bad = write_rows(
            tmp_path / f"{how}.csv", spoilt(read_rows(tmp_path / "good" / "stations.csv"), how)
        )
        outcome, rows = command.apply(bad, f"out_{how}.csv")
        assert outcome.code == 0
        assert "station 2: refused: " in outcome.err
        for row in rows:
            assert (
                (row["azimuth_deg"] == "")
                == (row["inclination_deg"] == "")
                == (row["station"] == "2")
            )
        for number in ("1", "7"):
            one, two = (
                next(float(r["azimuth_deg"]) for r in table if r["station"] == number)
                for table in (whole, rows)
            )
            assert abs(wrapped(one - two)) < 0.02


def test_a_pair_that_lost_a_reading_leaves_the_station_to_the_other(tmp_path, command):
    """A NaN of the x gyro: the azimuth is the y pair's, the flag says so, the missing field stays
    missing.
    """
    simulated(tmp_path / "good", 10, count=12, references=False)
    command.fit(tmp_path / "good")
    bad = write_rows(
        tmp_path / "bad.csv", spoilt(read_rows(tmp_path / "good" / "stations.csv"), "nan")
    )
    outcome, rows = command.apply(bad, "out.csv")
    assert "station 2: x not used: an indication or a position is not finite" in outcome.err
    assert rows[5]["gyro_x_dph"] == ""
    assert [row["status"] for row in rows] == [*[""] * 5, "no gyro_x_dph", *[""] * (len(rows) - 6)]
    assert f"{len(rows) - 1} of {len(rows)} rows corrected" in outcome.err
    _, alone = command.apply(tmp_path / "good" / "stations.csv", "y.csv", "stations.pairs=y")
    assert abs(wrapped(float(rows[5]["azimuth_deg"]) - float(alone[5]["azimuth_deg"]))) < 0.01


def test_a_wrong_unit_or_no_usable_station_is_refused(tmp_path, command):
    """Rates in °/s give no s that a gyro can have; a vertical tool gives no azimuth; both leave
    with 3 and say why.
    """
    simulated(tmp_path / "good", 11, count=8, references=False)
    rows = read_rows(tmp_path / "good" / "stations.csv")
    for row in rows:
        row["gyro_y_dph"] = repr(2.0 * float(row["gyro_y_dph"]))
    write_rows(tmp_path / "unit" / "stations.csv", rows)
    outcome, _ = command.fit(tmp_path / "unit")
    assert outcome.code == 3
    assert "gyro_y_dph" in outcome.err
    assert "check the gyro's unit" in outcome.err
    simulated(tmp_path / "vertical", 11, count=8, references=False, inclination_deg=(0.1, 0.3))
    outcome, _ = command.fit(tmp_path / "vertical")
    assert outcome.code == 3
    assert "toolface and azimuth are not separable" in outcome.err
    outcome, _ = command.fit(tmp_path / "good", "site.latitude_deg=85.0")
    assert outcome.code == 3
    assert "beyond 80°" in outcome.err


def test_a_recipe_without_a_latitude_is_refused(tmp_path, calibkit):
    """No [site], or none with a latitude, is an error of the recipe that names
    site.latitude_deg.
    """
    for site in ("", "[site]\nheight_m = 100.0\n"):
        path = tmp_path / "recipe.toml"
        path.write_text(
            f'procedure = "inclinometer"\n[logs]\nfiles = ["stations.csv"]\n{site}',
            encoding="utf-8",
        )
        outcome = calibkit("check", path, "--data", tmp_path)
        assert outcome.code == 2
        assert "site.latitude_deg" in outcome.err


def test_a_log_of_another_name_is_validated(tmp_path, command, calibkit):
    """The recipe names one file; `--set` names that of another well."""
    simulated(tmp_path / "good", 10, count=12)
    command.fit(tmp_path / "good")
    simulated(tmp_path / "new", 11, count=6)
    (tmp_path / "new" / "stations.csv").rename(tmp_path / "new" / "well.csv")
    where = ("--runs", tmp_path / "runs", "--data", tmp_path / "new", "--out", tmp_path / "v.json")
    refused = calibkit("validate", "I", *where)
    assert refused.code == 3
    assert "--set logs.files" in refused.err
    outcome = calibkit("validate", "I", *where, "--set", 'logs.files=["well.csv"]')
    assert outcome.code in (0, 1), outcome.err
    assert (tmp_path / "v.json").is_file()


def test_a_far_temperature_that_s_is_extrapolated_to_is_named():
    """Five stations at 20 to 28 °C predict no positive s at 90 °C: station, value and cure."""
    log = pd.read_csv(ROOT / "datasets" / "inclinometer" / "stations.csv")
    log = log[log["station"].between(9, 14)].reset_index(drop=True)
    log["temp_case_degc"] = np.repeat([20.0, 22.0, 24.0, 26.0, 28.0, 90.0], 4)
    rng = np.random.default_rng(4)
    for name in ("gyro_x_dph", "gyro_y_dph"):
        log[name] += rng.normal(0.0, 0.1, len(log))
    recipe = api.load_recipe("inclinometer", scale__order=2)
    with pytest.raises(FitError, match=r"for station 14 at 90 °C, expected a positive number"):
        api.fit(recipe, logs={"stations.csv": log}, runs=None, date="2026-11-21")


MISTAKES = {
    "the sign of accel_y_g is turned": lambda rows: rows.assign(accel_y_g=-rows["accel_y_g"]),
    "the sign of gyro_x_dph is turned": lambda rows: rows.assign(gyro_x_dph=-rows["gyro_x_dph"]),
    "gyro_x_dph and gyro_y_dph are exchanged": lambda rows: rows.rename(
        columns={"gyro_x_dph": "gyro_y_dph", "gyro_y_dph": "gyro_x_dph"}
    ),
    "position_deg counts the other way": lambda rows: rows.assign(
        position_deg=-rows["position_deg"] % 360.0
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_turned_sign_or_an_exchange_is_named(mistake, tmp_path):
    """It is the only correction with which the stations agree."""
    rows = pd.read_csv(ROOT / "datasets" / "inclinometer" / "stations.csv", comment="#")
    MISTAKES[mistake](rows).to_csv(tmp_path / "stations.csv", index=False)
    spec = instruments.parse_recipe(recipe.find("inclinometer"))
    with pytest.raises(FitError) as error:
        instruments.find("inclinometer").fit(spec, tmp_path, ["stations.csv"], instruments.silent)
    assert error.value.hint.startswith(f"the stations agree if {mistake}: see ")
    assert " or if " not in error.value.hint
