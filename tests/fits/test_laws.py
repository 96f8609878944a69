"""Laws that hold for every instrument whose equation is fitted by the core: what a log is called,
and in which unit it is, says nothing of the instrument.
"""

import importlib
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from calibkit import api
from calibkit.certificate.quantities import dof_along
from calibkit.fit.value import COVERAGE
from calibkit.records.forms import Form
from conftest import ROOT


@pytest.fixture(scope="module")
def physics():
    """Simulators of campaigns, which import nothing of the instruments."""
    folder = str(ROOT / "benchmarks")
    sys.path.insert(0, folder)
    yield {
        name: importlib.import_module(f"intervals.physics.{name}")
        for name in ("accelerometer", "gyro", "inclinometer")
    }
    sys.path.remove(folder)


CAMPAIGNS = {
    "accelerometer": lambda of, rng: of["accelerometer"].on_table(rng, quantities=()),
    "rate_table": lambda of, rng: of["gyro"]._curve(rng, 50.0),
    "gyro_pair": lambda of, rng: of["gyro"]._pair(rng, 2.0),
    "gyro_triad": lambda of, rng: of["gyro"]._twelve_runs(rng),
    "inclinometer": lambda of, rng: of["inclinometer"]._slope(rng, 1.0),
}


@pytest.fixture(scope="module", params=CAMPAIGNS)
def campaign(request, physics):
    """A small campaign of one procedure."""
    return CAMPAIGNS[request.param](physics, np.random.default_rng(7))


@pytest.fixture(scope="module")
def stated(campaign):
    """What its fit states."""
    return numbers(campaign)


def numbers(campaign):
    """Coefficients of a fit with their standard uncertainties."""
    run = api.fit(campaign.recipe, logs=campaign.logs, runs=None, date="2026-11-26")
    table = run.numbers()
    table = table[table["kind"] == "coefficient"].set_index(["stage", "model", "name"])
    return table[["value", "standard_uncertainty"]].astype(float).sort_index()


def assert_same(found, expected, share):
    """Coefficients of models that no log gives its name differ by at most a share of their
    standard uncertainty.
    """
    common = expected.index.intersection(found.index)
    assert len(common) >= 4
    found, expected = found.loc[common], expected.loc[common]
    u = expected["standard_uncertainty"].to_numpy()
    apart = np.abs(found.to_numpy() - expected.to_numpy()) / np.where(u > 0.0, u, np.inf)[:, None]
    assert np.max(apart) < share


@pytest.mark.parametrize("campaign", ["rate_table", "gyro_triad"], indirect=True)
def test_the_names_and_the_order_of_logs_do_not_matter(campaign, stated):
    """Logs under names that sort the other way give the same coefficients."""
    names = sorted(campaign.logs)
    turned = {}
    for number, name in enumerate(names):
        stem = name.removesuffix(".csv")
        kept = stem[: stem.rindex("_")] if "about" in stem else "run"
        turned[f"{kept}_{len(names) - number:02d}.csv"] = campaign.logs[name]
    assert_same(numbers(replace(campaign, logs=turned)), stated, 1e-6)


def test_the_unit_of_the_thermometer_does_not_matter(campaign, stated):
    """Logs in kelvin give the coefficients in °C."""
    logs = {
        name: frame.assign(temp_case_degc=frame["temp_case_degc"] + 273.15)
        for name, frame in campaign.logs.items()
    }
    columns = {"temp_case_degc": {"from": "temp_case_degc", "unit": "K"}}
    recipe = {**campaign.recipe, "columns": columns}
    assert_same(numbers(replace(campaign, recipe=recipe, logs=logs)), stated, 1e-6)


@pytest.mark.parametrize(
    ("campaign", "sensor", "noise", "own"),
    [
        ("accelerometer", "accel_z_g", 20e-6, r"[kz]_{}\d"),
        ("gyro_triad", "gyro_z_lsb", 0.5, "S_{}."),
    ],
    indirect=["campaign"],
)
def test_noise_of_one_sensor_widens_its_own_results_alone(campaign, stated, sensor, noise, own):
    """Twice the noise of one sensor: u of its coefficients grows to twice the value, those of the
    others stay.
    """
    rng = np.random.default_rng(11)
    logs = {
        name: frame.assign(**{sensor: frame[sensor] + rng.normal(0.0, 3**0.5 * noise, len(frame))})
        for name, frame in campaign.logs.items()
    }
    noisy = numbers(replace(campaign, logs=logs))["standard_uncertainty"]
    model = stated.index.get_level_values("model") == "triad"
    names = stated.index.get_level_values("name").str
    ratio = noisy / stated["standard_uncertainty"]
    its_own = ratio[model & names.fullmatch(own.format("z"))]
    others = ratio[model & names.fullmatch(own.format("x"))]
    assert len(its_own) == len(others) > 2
    assert its_own.median() == pytest.approx(2.0, rel=0.2)
    assert others.median() == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(
    ("recipe", "stated", "least"),
    [("rate_table", True, 0.98), ("gyro_triad", False, 0.98), ("gyro_triad", True, 0.95)],
    ids=["rate_table", "gyro_triad", "gyro_triad, mounting"],
)
def test_a_file_states_nearly_the_coverage_factor_of_the_fit(recipe, stated, least, monkeypatch):
    """Of any sum of coefficients: a file has their degrees of freedom, not those of each sum; a
    stated mounting, which some sums have and others not, has its own.
    """
    ratios = []
    write_fit = Form.write_fit

    def write_and_compare(form, name, fit, *names, **facts):
        model = write_fit(form, name, fit, *names, **facts)
        u = np.sqrt(np.diag(fit.covariance))
        if not u.any():  # a refit for sensitivities states values alone
            return model
        sums = np.random.default_rng(len(ratios)).normal(size=(200, len(u))) / u
        of_file = [dof_along(model, weights) for weights in sums]
        ratios.append(stdtrit(of_file, COVERAGE) / stdtrit(fit.dof_along(sums), COVERAGE))
        return model

    monkeypatch.setattr(Form, "write_fit", write_and_compare)
    keys = tomllib.loads((ROOT / f"recipes/{recipe}.toml").read_text(encoding="utf-8"))
    if not stated:
        keys.pop("errors")
    api.fit(keys, ROOT / f"datasets/{recipe}", serial="G1", runs=None)
    assert len(ratios) > 3
    assert np.min(ratios) > least
    assert np.max(ratios) < 1.08
