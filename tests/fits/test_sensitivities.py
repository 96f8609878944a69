"""Sensitivities of results to errors of their inputs, against fits of logs that were shifted."""

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CoefficientError
from calibkit.instruments import silent
from calibkit.logs import log_files
from calibkit.numeric import earth
from calibkit.records import sensitivities
from calibkit.records.sensitivities import InputError
from conftest import ROOT
from sample_runs import sample_logs

SHIFTS = [
    ("rate_table", "table_rate_dps", "scale", 1e-4),
    ("rate_table", "table_rate_dps", "offset", 1e-4),
    ("rate_table", "temp_case_degc", "offset", 0.1),
    ("gyro_pair", "table_rate_dps", "scale", 1e-4),
    ("gyro_triad", "table_rate_dps", "scale", 1e-4),
    ("accelerometer", "toolface_deg", "offset", 0.003),
    ("accelerometer", "inclination_deg", "offset", -0.0003),
    ("accelerometer", "temp_case_degc", "offset", 0.2),
    ("inclinometer", "temp_case_degc", "offset", 0.2),
    ("inclinometer", "gyro_x_dph", "scale", 1e-4),
    ("inclinometer", "position_deg", "offset", 0.01),
    ("bias_temperature", "temp_case_degc", "offset", 0.2),
    ("bias_temperature", "gyro_dph", "scale", 1e-4),
    ("bias_temperature", "gyro_dph", "offset", 0.01),
    ("bias_temperature", "temp_case_degc", "span", 0.2),
    ("gyro_noise", "gyro_dph", "scale", 1e-4),
    ("inclinometer", "gyro_y_dph", "scale", 1e-4),
    ("inclinometer", "temp_case_degc", "span", 0.2),
    ("inclinometer", "latitude_deg", "offset", 0.002),
    ("rate_table", "temp_case_degc", "span", 0.1),
    ("rate_table", "time_s", "scale", 1e-4),
    ("rate_table", "latitude_deg", "offset", 0.002),
    ("gyro_pair", "time_s", "scale", 1e-4),
    ("gyro_pair", "latitude_deg", "offset", 0.002),
    ("gyro_triad", "table_rate_dps", "offset", 1e-4),
    ("gyro_triad", "time_s", "scale", 1e-4),
    ("gyro_triad", "temp_case_degc", "span", 0.1),
    ("gyro_triad", "latitude_deg", "offset", 0.002),
    ("accelerometer", "temp_case_degc", "span", 0.2),
    ("accelerometer", "gravity_mps2", "offset", 1e-4),
    ("fog_thermal", "temp_case_degc", "span", 0.01),
    ("fog_thermal", "temp_env_degc", "span", 0.01),
    ("fog_thermal", "temp_env_degc", "offset", 0.02),
    ("fog_thermal", "gyro_dph", "scale", 1e-4),
]
LATITUDE, GRAVITY = "site.latitude_deg=34.2", "site.gravity_mps2=9.7967"
OVERRIDES = {
    "rate_table": (LATITUDE,),
    "gyro_pair": (LATITUDE,),
    "gyro_triad": (LATITUDE,),
    "gravity_mps2": (
        GRAVITY,
        *(f'columns.accel_{a}_g={{from="accel_{a}_g", unit="m/s^2", scale=9.7967}}' for a in "xyz"),
    ),
}
"""What the recipes state besides, so that the input enters."""
SITE = {"latitude_deg": 34.2, "gravity_mps2": 9.7967}


def shifted(frame, error):
    """A log with an input off; counts per second are off with the clock that they are made by."""
    if error.input == "time_s":
        counts = [column for column in frame if column.endswith("_lsb")]
        return frame.assign(**{column: error.shift(frame[column]) for column in counts})
    own = [error.input] if error.input in frame else []
    return frame.assign(**{column: error.shift(frame[column]) for column in own})


def fit(name, folder, *overrides):
    """Fit of a procedure's logs."""
    source = recipe.find(str(ROOT / "recipes" / f"{name}.toml"), overrides)
    spec = instruments.parse_recipe(source)
    files = log_files.find_logs(spec, folder)
    return instruments.find(spec.procedure).fit(spec, folder, files, silent)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder of a procedure's logs and their fit, made once."""
    made = {}

    def of(name, overrides):
        if (name, overrides) not in made:
            folder = sample_logs(tmp_path_factory, name)
            made[name, overrides] = folder, fit(name, folder, *overrides)
        return made[name, overrides]

    return of


@pytest.mark.parametrize(("name", "column", "kind", "step"), SHIFTS)
def test_a_refit_of_shifted_logs_moves_every_result_as_predicted(
    fitted, tmp_path, name, column, kind, step
):
    """Within 5 % of the shift or 0.02 U: logs written again with one column off, or the place
    stated wrong, fitted anew.
    """
    stated = OVERRIDES.get(column, OVERRIDES.get(name, ()))
    folder, base = fitted(name, stated)
    frames = {path.name: pd.read_csv(path) for path in folder.glob("*.csv")}
    readings = np.concatenate([f.get(column, pd.Series([0.0, 1.0])) for f in frames.values()])
    error = InputError(column, kind, step, (readings.min(), readings.max()))
    (tmp_path / "logs").mkdir()
    for path, frame in frames.items():
        shifted(frame, error).to_csv(tmp_path / "logs" / path, index=False, float_format="%.12g")
    off = (f"site.{column}={error.shift(SITE[column])}",) if column in SITE else ()
    moved = fit(name, tmp_path / "logs", *stated, *off)
    derivatives = merged(base.sensitivities, column, kind)
    before, after = (sensitivities._values(one.results) for one in (base, moved))
    models = {
        f"{stage.stage}.{model.name}.{c.name}"
        for stage in base.results
        for model in stage.models
        for c in model.coefficients
    }
    assert derivatives or column == "position_deg"
    for key in models | {*derivatives}:
        value, u = before[key]
        shift, predicted = after[key][0] - value, step * derivatives.get(key, 0.0)
        allowed = max(0.05 * abs(predicted), 0.04 * u, 1e-9 * abs(value))
        assert abs(shift - predicted) <= allowed, (key, shift, predicted, u)


def merged(sensitivities, column, kind):
    """Derivatives by one error of an input, of all models."""
    return {
        key: value
        for one in sensitivities
        if (one.input, one.error) == (column, kind)
        for key, value in one.derivatives.items()
    }


def test_a_clock_that_is_off_moves_terms_of_rates_and_lags_as_predicted(tmp_path):
    """Logs whose clock is 1 % fast, fitted anew on the same blocks of samples: terms of rates and
    lags within 5 % of the shift or 0.02 U.
    """
    folder, logs = ROOT / "datasets" / "fog_thermal", tmp_path / "logs"
    logs.mkdir()
    for path in folder.glob("*.csv"):
        frame = pd.read_csv(path)
        frame["time_s"] = 1.01 * frame["time_s"]
        frame.to_csv(logs / path.name, index=False, float_format="%.12g")
    base = fit("fog_thermal", folder, "drift.interval_s=10.0")
    moved = fit("fog_thermal", logs, "drift.interval_s=10.1")
    before, after = (sensitivities._values(one.results) for one in (base, moved))
    derivatives = merged(base.sensitivities, "time_s", "scale")
    assert len(derivatives) == 4
    for key, slope in derivatives.items():
        value, u = before[key]
        shift = after[key][0] - value
        assert abs(shift - 0.01 * slope) <= max(0.05 * abs(0.01 * slope), 0.04 * u), (key, u)


def test_the_axis_of_a_gyro_moves_its_bias_by_the_earths_rate():
    """Derivatives of the earth's rate along the axis, by elevation and azimuth."""
    for latitude, elevation, azimuth in (
        (34.2, 20.0, 75.0),
        (-50.0, -60.0, 200.0),
        (0.0, 0.0, 0.0),
    ):
        slopes = earth.along_axis_slopes(latitude, elevation, azimuth)[1:]
        for slope, (el, az) in zip(slopes, ((1e-4, 0.0), (0.0, 1e-4)), strict=True):
            up, down = (
                float(earth.along_axis(latitude, elevation + way * el, azimuth + way * az))
                for way in (1.0, -1.0)
            )
            assert slope == pytest.approx((up - down) / 2e-4, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    "entry",
    [
        {"input": 3, "error": "offset", "derivatives": {}},
        {"input": "time_s", "error": "twist", "derivatives": {}},
        {"input": "time_s", "error": "scale", "derivatives": {"K": "1"}},
        "time_s",
    ],
)
def test_what_is_no_sensitivity_is_refused_with_its_file(entry):
    """A run.json that was changed by hand, with a digest that is right."""
    with pytest.raises(CoefficientError, match=r"run\.json: not a list of sensitivities: 0"):
        sensitivities.loads([entry], "run.json")
