"""Uncertainties of rate tables in a real laboratory: runs that repeat less well than their noise,
gyros that warm or drift during a run, asymmetry, runs of one direction.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibkit.instruments.gyro_scale import (
    coefficient_files,
    fit as gyro_fit,
    simulate,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
from calibkit.numeric import gum
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.records.frame import Log
from conftest import slow_after

SEEDS = range(24)
LEAST = 0.88
"""Share of campaigns that the stated interval must cover."""
RATES = simulate.both_ways((2.0, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0))
SPEC = RateTableRecipe(
    procedure="rate_table", logs={"files": ["*.csv"]}, site={"latitude_deg": 34.2}
)


def fit(logs, spec=SPEC):
    """Coefficient file of logs, name → columns, of one gyro."""
    runs = [
        table_runs.fit_run(
            spec, Log(name, f"{name}.csv", name, len(columns["time_s"]), pd.DataFrame(columns))
        )
        for name, columns in logs.items()
    ]
    (found,) = coefficient_files.list_results(gyro_fit.fit_campaign(spec, {"": runs}), spec)
    return found


def model(found, name):
    """Model of a result by its name."""
    return next(entry for entry in found.models if entry.name == name)


def figure(found, name):
    """Figure of a result by its name."""
    return next(entry for entry in found.figures if entry.name == name)


def inside(value, u, dof, truth):
    """Whether the truth lies within the expanded uncertainty."""
    return abs(value - truth) <= gum.coverage_factor(dof) * u


def scale_covers(found, gyro, name="gyro_x"):
    """Whether K of a model covers that of the gyro's best line at the temperature it states."""
    line = model(found, name)
    K = line.coefficients[0]
    truth, _ = gyro.best_line(simulate.TurnedTable(), RATES, line.value("temp_case"))
    return inside(K.value, K.standard_uncertainty, line.dof_of(K), truth)


def bias_covers(found, gyro, name):
    """Whether the bias of a run covers the gyro's."""
    bias, line = figure(found, f"bias.gyro_x.{name}"), model(found, f"gyro_x.{name}")
    warmer = line.value("temp_case") - simulate.REFERENCE_DEGC
    truth = (gyro.bias_dps + gyro.bias_dps_per_degc * warmer) * DPH_PER_DPS
    return inside(bias.value, bias.standard_uncertainty, bias.effective_dof, truth)


def campaign(seed, *, degc=(25.0,), repeat=0.0, drift_dph_per_h=0.0, warming=0.2, **constants):
    """Gyro and logs of runs at temperatures; K repeats from run to run to `repeat` (relative), the
    zero drifts with time.
    """
    rng = np.random.default_rng([seed, 16])
    gyro = replace(simulate.RateGyro.draw(rng), **constants)
    table = simulate.TurnedTable(
        interval_s=1.0, warming_degc=warming, start_angle_deg=rng.uniform(0.0, 360.0)
    )
    logs = {}
    for number, start in enumerate(degc):
        drawn = replace(gyro, K=gyro.K * (1.0 + repeat * rng.normal()))
        log = simulate.run({"gyro_x_lsb": drawn}, table, RATES, start, rng)
        hours = (log["time_s"] - np.mean(log["time_s"][[0, -1]])) / 3600.0
        log["gyro_x_lsb"] = log["gyro_x_lsb"] + gyro.K * drift_dph_per_h / DPH_PER_DPS * hours
        logs[f"run_{number}"] = log
    return gyro, logs


@pytest.mark.parametrize(
    "degc",
    [
        (25.0, -40.0, 0.0, 60.0),
        pytest.param((25.0, 25.0, 25.0, -40.0, 0.0, 60.0), marks=pytest.mark.slow),
    ],
    ids=["one", "three"],
)
def test_one_run_at_25_degc_is_no_better_known_than_runs_repeat(degc):
    """Runs that repeat to 10 ppm: K at 25 °C and K(T) cover the gyro's, and the component is stated
    in ppm.
    """
    covered, sizes = [], []
    for seed in SEEDS:
        gyro, logs = campaign(seed, degc=degc, repeat=10e-6)
        found = fit(logs)
        line, curve = model(found, "gyro_x"), model(found, "gyro_x.K_over_temperature")
        scale = next(entry for entry in line.components if entry.effect == "scale")
        assert (scale.group, scale.unit, scale.groups) == ("run", "ppm", len(degc))
        sizes.append(scale.value)
        powers = 25.0 ** np.arange(len(curve.coefficients))
        value = powers @ [c.value for c in curve.coefficients]
        u = np.sqrt(powers @ np.array(curve.covariance) @ powers)
        truth, _ = gyro.best_line(simulate.TurnedTable(), RATES, 25.0)
        covered.append((scale_covers(found, gyro), inside(value, u, curve.dof, truth)))
    assert np.mean(covered, axis=0).min() >= LEAST
    assert 5.0 < np.sqrt(np.mean(np.square(sizes))) < 15.0


def test_a_single_run_says_what_it_does_not_know_and_takes_what_is_stated():
    """One run of a gyro that repeats to 10 ppm: a warning; with the component stated it covers, and
    warns of nothing.
    """
    stated = SPEC.model_copy(
        update={
            "errors": RateTableRecipe.model_validate(
                SPEC.model_dump(exclude={"errors"})
                | {
                    "errors": {
                        "component": [
                            {
                                "group": "run",
                                "effect": effect,
                                "value": value,
                                "unit": unit,
                                "dof": 20.0,
                            }
                            for effect, value, unit in (
                                ("scale", 10.0, "ppm"),
                                ("zero", 0.1, "deg/h"),
                            )
                        ]
                    }
                }
            ).errors
        }
    )
    covered = []
    for seed in SEEDS:
        gyro, logs = campaign(seed, repeat=10e-6)
        found = fit(logs, stated)
        assert not any("how runs repeat" in flag for flag in found.flags)
        covered.append(scale_covers(found, gyro))
    assert np.mean(covered) >= LEAST
    assert any("one run does not show how runs repeat" in flag for flag in fit(logs).flags)


@pytest.mark.parametrize(
    "errors",
    slow_after(
        1,
        [
            {"warming": 5.0, "K_per_degc": 30e-6},
            {"asymmetry": 5e-6},
            {"drift_dph_per_h": 2.0},
            {"warming": 2.0, "K_per_degc": 30e-6, "asymmetry": 5e-6, "drift_dph_per_h": 2.0},
            {"warming": 0.4, "K_per_degc": 30e-6, "asymmetry": 1e-6, "drift_dph_per_h": 0.3},
        ],
    ),
    ids=["warms", "asymmetry", "drift", "all", "all, small"],
)
def test_what_changes_during_a_run_is_taken_out_or_in_the_uncertainty(errors):
    """Gyro that warms by 5 °C at 30 ppm/°C, asymmetry of 5 ppm, zero drift of 2 °/h per h: K and
    bias cover the gyro's.
    """
    covered = []
    for seed in SEEDS:
        gyro, logs = campaign(seed, **errors)
        found = fit(logs)
        covered.append(
            (scale_covers(found, gyro, "gyro_x.run_0"), bias_covers(found, gyro, "run_0"))
        )
    assert np.mean(covered, axis=0).min() >= LEAST


def test_a_run_that_changed_is_named_with_what_changed():
    """A gyro of 30 ppm/°C that warms by 5 °C, and one whose zero drifts by 20 °/h per h: flags with
    file, size and unit; a quiet gyro has none.
    """
    for errors, words in (
        ({"warming": 5.0, "K_per_degc": 30e-6}, ("run_0.csv", "ppm/°C", "taken out")),
        ({"drift_dph_per_h": 20.0}, ("run_0.csv", "its zero by +19 (°/h)/h")),
    ):
        flags = [flag for flag in fit(campaign(3, **errors)[1]).flags if "changed during" in flag]
        assert len(flags) == 1
        assert all(word in flags[0] for word in words)
    noticed = [
        flag for seed in SEEDS for flag in fit(campaign(seed)[1]).flags if "changed during" in flag
    ]
    assert len(noticed) <= 2
