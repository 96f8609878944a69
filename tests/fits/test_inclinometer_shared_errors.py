"""Inclinometers whose gyros are turned against the accelerometers, whose scale factors differ from
log to log, and whose positions have index errors.
"""

import json

import numpy as np
import pandas as pd
import pytest

from calibkit.errors import FitError
from calibkit.instruments.inclinometer import (
    forms,
    simulate,
    solve,
    stations as inclinometer_stations,
)
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import earth
from calibkit.records.frame import Log, Remark

LEAST = 0.88
"""Share of campaigns, or of stations, that the stated interval must cover."""
UNSEEN = "withheld/stations.csv"


def recipe(**tables):
    """Recipe with the tables stated."""
    start = {"procedure": "inclinometer", "logs": {"files": ["*.csv"]}}
    start["site"] = {"latitude_deg": 34.2}
    return InclinometerRecipe.model_validate(start | tables, strict=False)


PLAIN = recipe()


def turned(columns, deg, relative=0.0):
    """Columns of a log whose gyros are turned about the tool axis by an angle [°], and whose s is
    larger by a share.
    """
    angle, found = np.radians(deg), dict(columns)
    for axis in "xy":
        gyro = np.asarray(columns[f"gyro_{axis}_dph"]).reshape(-1, 4)
        across = np.roll(gyro, -1, axis=1)
        both = (np.cos(angle) * gyro + np.sin(angle) * across) / (1.0 + relative)
        found[f"gyro_{axis}_dph"] = np.round(both, 5).ravel()
    return found


def log_of(columns, name="stations"):
    """Log of columns."""
    frame = pd.DataFrame({key: np.asarray(value, float) for key, value in columns.items()})
    return Log(name, f"{name}.csv", "", len(frame), frame)


def stations_of(logs, spec, noise=None):
    """Stations of logs."""
    admitted, _ = inclinometer_stations.admit_logs(logs, spec)
    rows = inclinometer_stations.gather_rows(admitted, spec.on_site())
    return inclinometer_stations.solve_components(rows, spec, noise)


def fit(logs, spec=PLAIN):
    """s(T) of both gyros."""
    return solve.fit_scale(stations_of(logs, spec), spec)[0]


def compare(fits, log, spec=PLAIN):
    """Angle errors of unseen stations."""
    models = {axis: scale.model for axis, scale in fits.items()}
    noise = {axis: model.noise for axis, model in models.items()}
    stations = stations_of([log], spec, noise)
    return solve.seek_north(stations, models, spec).errors


def covered(found):
    """Share of the azimuths within U, k = 2."""
    over = np.abs(found.after[found.known]) / found.standard_uncertainty[found.known]
    return float(np.mean(over <= 2.0))


def test_a_noisier_second_gyro_does_not_widen_the_azimuth():
    """Gyro y of ten times the noise, whose turn nobody can tell, in 12 tools: U of both pairs is at
    most 1.2 times that of pair x alone, and the azimuths are within it.
    """
    ratios, inside = [], []
    alone = recipe(stations={"pairs": "x"})
    for seed in range(200, 212):
        rng = np.random.default_rng(seed)
        made = simulate.campaign(seed)
        noisy = {
            name: log | {"gyro_y_dph": log["gyro_y_dph"] + 0.1 * rng.standard_normal(4 * 36)}
            for name, log in made.logs.items()
        }
        log, unseen = log_of(noisy["stations.csv"]), log_of(noisy[UNSEEN], "unseen")
        both = compare(fit([log]), unseen)
        one = compare(fit([log], alone), unseen, alone)
        ratios.append(np.median(both.standard_uncertainty) / np.median(one.standard_uncertainty))
        inside.append(covered(both))
    assert np.max(ratios) <= 1.2
    assert np.mean(inside) >= LEAST


def test_the_turn_is_a_result_that_survives_the_file():
    """0.3° of both gyros, with its standard uncertainty, in the components of the models."""
    fits = fit([log_of(turned(simulate.campaign(3).logs["stations.csv"], 0.3))])
    for axis, scale in fits.items():
        model = scale.write(axis)
        one = next(part for part in model.components if part.group == "mounting")
        assert (one.name, one.unit) == ("gyro turn of the mounting", "deg")
        assert abs(one.value - 0.3) < 3.0 * one.standard_uncertainty < 0.15
        assert forms.ScaleModel.read(model).turn_deg == one.value


def test_mounting_and_index_errors_are_stated_and_widen_the_azimuth():
    """A turn of 0.1° by [[errors.component]], 0.1° of the azimuth and 0.4° of positions by type
    B.
    """
    made = simulate.campaign(5)
    log, unseen = log_of(made.logs["stations.csv"]), log_of(made.logs[UNSEEN], "unseen")
    fitted = fit([log])
    plain = compare(fitted, unseen)
    seen = max(scale.model.turn_deg for scale in fitted.values())
    turn = {"group": "mounting", "effect": "gyro turn", "value": 0.1, "unit": "deg", "dof": 50.0}
    term = {"name": "mounting", "unit": "deg", "standard_uncertainty": 0.1}
    tables = {
        "turn": {"errors": {"component": [turn]}},
        "turn in arcmin": {"errors": {"component": [turn | {"value": 6.0, "unit": "arcmin"}]}},
        "azimuth": {"type_b": [term | {"quantity": "azimuth_deg"}]},
        "index": {"type_b": [term | {"quantity": "position_deg", "standard_uncertainty": 0.4}]},
    }
    for name, table in tables.items():
        spec = recipe(**table)
        found = compare(fit([log], spec), unseen, spec)
        wide = found.standard_uncertainty
        assert np.all(found.stated <= wide)
        assert found.turn()[1] > plain.turn()[1]
        added = np.sqrt(wide**2 - plain.standard_uncertainty**2)
        if name == "azimuth":
            assert added == pytest.approx(0.1, rel=1e-6)
        elif name.startswith("turn"):
            assert added == pytest.approx(
                np.sqrt(0.1**2 - seen**2) * np.abs(plain.by_turn), rel=0.05
            )
        else:
            assert 0.01 < np.median(added) < 0.4


@pytest.mark.parametrize("shift", [0.0, 1e-3])
def test_stations_of_two_logs_at_other_temperatures_have_a_prior_without_their_own_root(shift):
    """Six tools with a cold and a hot log whose s differ by up to 1e-3: s(T) without a station is
    within 4 of its standard uncertainties, which are below 1 %.
    """
    for seed in range(6):
        made = simulate.campaign(seed, count=40, ideal=True)
        columns = {name: np.asarray(v) for name, v in made.logs["stations.csv"].items()}
        hot = columns["temp_case_degc"] > np.median(columns["temp_case_degc"])
        logs = [
            log_of(turned({k: v[part] for k, v in columns.items()}, 0.0, relative), name)
            for name, part, relative in (("cold", ~hot, 0.0), ("hot", hot, shift))
        ]
        found = fit(logs, recipe(scale={"order": 2}))["x"].left_out
        truth = np.asarray(made.truth["stations"]["s_x"])
        order = [*dict.fromkeys(columns["station"][~hot]), *dict.fromkeys(columns["station"][hot])]
        off = found.s - truth[np.array(order, int) - 1]
        assert np.all(np.abs(off) < 4.0 * found.standard_uncertainty)
        assert np.all(found.standard_uncertainty < 0.01)


def test_logs_that_coincide_with_temperature_are_refused():
    """Two logs, each at one temperature, and a straight line s(T)."""
    columns = {k: np.asarray(v) for k, v in simulate.campaign(2).logs["stations.csv"].items()}
    logs = []
    for number, degc in enumerate((30.0, 90.0)):
        part = columns["station"] % 2 == number
        own = {name: values[part] for name, values in columns.items()}
        logs.append(log_of(own | {"temp_case_degc": np.full(part.sum(), degc)}, f"log_{number}"))
    with pytest.raises(FitError, match="scale of each log cannot be separated from s0, s1"):
        fit(logs, recipe(scale={"order": 1}))


def test_validate_rejects_and_says_what_turns_the_azimuths(tmp_path, calibkit, log_writer):
    """Exit 1 without limits of the recipe, the angle in a flag."""
    made = simulate.campaign(7)
    for folder, name in (("fit", "stations.csv"), ("new", UNSEEN)):
        log_writer(tmp_path / folder / "stations.csv", **turned(made.logs[name], 0.3))
    arguments = ("--serial", "I", "--out", tmp_path / "runs")
    assert calibkit("fit", "inclinometer", "--data", tmp_path / "fit", *arguments).code == 0
    runs, out = tmp_path / "runs", tmp_path / "v.json"
    outcome = calibkit("validate", "I", "--runs", runs, "--data", tmp_path / "new", "--out", out)
    assert outcome.code == 1
    assert json.loads(out.read_text(encoding="utf-8"))["accepted"] is False
    assert "the azimuths are turned together by 0.2" in outcome.err + outcome.out


def in_one_fixture(seed):
    """Log of 24 stations of one attitude over 20 to 120 °C, s = 1 + 1e-5 T."""
    rng, count = np.random.default_rng(seed), 24
    attitudes = np.full((count, 3), (30.0, 20.0, 60.0))
    gravity = simulate.rotated(attitudes, np.array([0.0, 0.0, 1.0]))
    rate = simulate.rotated(attitudes, earth.north_east_down(34.2))
    degc, turned = np.linspace(20.0, 120.0, count), np.tile(simulate.POSITIONS_DEG, (count, 1))
    columns = {
        "station": np.repeat(np.arange(1, count + 1), 4),
        "position_deg": turned.ravel(),
        "temp_case_degc": np.repeat(degc, 4),
    }
    for axis, angle in (("x", 0.0), ("y", 90.0)):
        accel = simulate.resolve_along(gravity, turned + angle, 0.0)
        gyro = simulate.resolve_along(rate, turned + angle, 0.0) / (1.0 + 1e-5 * degc[:, None])
        columns[f"accel_{axis}_g"] = (accel + 2e-5 * rng.standard_normal(accel.shape)).ravel()
        columns[f"gyro_{axis}_dph"] = (gyro + 0.01 * rng.standard_normal(gyro.shape)).ravel()
    return log_of(columns)


def test_stations_in_one_fixture_measure_no_turn_and_do_not_contradict_themselves():
    """Ten tools: s at 70 °C within 4 u, no station contradicts s(T), and a remark says why no turn
    is measured.
    """
    for seed in range(10):
        stations = stations_of([in_one_fixture(seed)], PLAIN)
        fits, seen = solve.fit_scale(stations, PLAIN)
        assert "standard uncertainties from its prior" not in str(seen.combined.flags)
        assert not seen.refused.any()
        for scale in fits.values():
            prior = scale.model.prior(np.array([70.0]))
            assert abs(prior.s[0] - 1.0007) < 4.0 * prior.standard_uncertainty[0] < 4e-3
            assert scale.model.turn_deg == 0.0
            assert [type(flag) for flag in scale.flags if "one attitude" in flag] == [Remark]
