"""Sensitivities of results to errors of their inputs, against fits of logs that were shifted."""

import shutil

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe, sensitivities
from calibkit.errors import CoefficientError
from calibkit.ingest import logs as ingest
from calibkit.instruments import silent
from calibkit.sensitivities import InputError
from conftest import ROOT

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
]


def warm_up(folder):
    """Write a log of a gyro that warms up."""
    rng, t = np.random.default_rng(4), np.linspace(20.0, 60.0, 4000)
    rate = 2.0 + 0.05 * t - 4e-4 * t**2 + 2e-6 * t**3 + 0.01 * rng.standard_normal(4000)
    frame = pd.DataFrame({"time_s": np.arange(4000.0), "temp_case_degc": t, "gyro_dph": rate})
    folder.mkdir()
    frame.to_csv(folder / "warm.csv", index=False, float_format="%.9g")
    return folder


def fit(name, folder):
    """Fit of a procedure's logs."""
    spec = instruments.parse_recipe(recipe.find(str(ROOT / "recipes" / f"{name}.toml")))
    files = ingest.find_logs(spec, folder)
    return instruments.find(spec.procedure).fit(spec, folder, files, silent)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder of a procedure's logs and their fit, made once."""
    made = {}

    def of(name):
        if name not in made:
            folder = ROOT / "datasets" / name
            if name == "bias_temperature":
                folder = warm_up(tmp_path_factory.mktemp("bias") / "logs")
            made[name] = folder, fit(name, folder)
        return made[name]

    return of


@pytest.mark.parametrize(("name", "column", "kind", "step"), SHIFTS)
def test_a_refit_of_shifted_logs_moves_every_result_as_predicted(
    fitted, tmp_path, name, column, kind, step
):
    """Within 5 % of the shift or 0.02 U: logs written again with one column off, fitted anew."""
    (folder, base), error = fitted(name), InputError(column, kind, step)
    shutil.copytree(folder, tmp_path / "logs")
    for path in (tmp_path / "logs").glob("*.csv"):
        frame = pd.read_csv(path)
        frame[column] = error.shift(frame[column])
        frame.to_csv(path, index=False, float_format="%.12g")
    moved = fit(name, tmp_path / "logs")
    (found,) = [s for s in base.sensitivities if (s.input, s.kind) == (column, kind)]
    before, after = (sensitivities._values(one.results) for one in (base, moved))
    models = {
        f"{stage.stage}.{model.name}.{c.name}"
        for stage in base.results
        for model in stage.models
        for c in model.coefficients
    }
    assert found.derivatives or column == "position_deg"
    for key in models:
        value, u = before[key]
        shift, predicted = after[key][0] - value, step * found.derivatives.get(key, 0.0)
        allowed = max(0.05 * abs(predicted), 0.04 * u, 1e-9 * abs(value))
        assert abs(shift - predicted) <= allowed, (key, shift, predicted, u)


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
    with pytest.raises(CoefficientError, match=r"run\.json: sensitivities"):
        sensitivities.loads([entry], "run.json")
