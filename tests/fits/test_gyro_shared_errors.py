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


SWEEP_DPS = 151.0


def sweeps(seed, *, count=18, one_way=False, by_temperature=False):
    """Logs of one-way sweeps of a MEMS gyro whose response is bent by 3 %, its indication and its
    relative slope over temperature; the directions alternate, or go with the temperature.
    """
    rng = np.random.default_rng([seed, 151])
    K, per_degc, bias = 14.3 * (1.0 + 0.02 * rng.normal()), -404e-6, 2.0 * rng.normal()
    even = rng.normal()

    def indication(rate, degc, scale=1.0):
        share = rate / SWEEP_DPS
        bent = rate + 4.5 * share**3 + even * share**2
        return scale * K * (1.0 + per_degc * (degc - 25.0)) * (bent + bias + 0.02 * (degc - 25.0))

    logs = {}
    for number in range(count):
        degc = rng.uniform(15.0, 45.0)
        positive = one_way or (degc < 30.0 if by_temperature else number % 2 == 0)
        rate = np.repeat(np.linspace(8.0, SWEEP_DPS, 12) * (1.0 if positive else -1.0), 20)
        time = np.arange(rate.size) * 1.0
        case = degc + 0.3 * time / time[-1]
        scale = 1.0 + 50e-6 * rng.normal()
        logs[f"sweep_{number}"] = {
            "time_s": time,
            "table_rate_dps": rate,
            "gyro_x_lsb": indication(rate, case, scale) + rng.normal(0.0, 0.05, time.size),
            "temp_case_degc": np.round(case + rng.normal(0.0, 0.02, time.size), 2),
        }
    return logs, indication, per_degc


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seeds", "by_temperature"),
    [(20, False), (20, True)],
    ids=["alternating", "by temperature"],
)
def test_one_way_sweeps_of_a_bent_response_share_their_line(seeds, by_temperature):
    """18 sweeps of ±151 °/s: the slope of K over temperature covers −404 ppm/°C within 20 ppm/°C,
    and `apply` is no worse than the best straight line by more than a tenth.
    """
    rate = np.concatenate([np.linspace(-SWEEP_DPS, -8.0, 30), np.linspace(8.0, SWEEP_DPS, 30)])
    covered, worse = [], []
    for seed in range(seeds):
        logs, indication, per_degc = sweeps(seed, by_temperature=by_temperature)
        found = fit(logs)
        slope = figure(found, "temperature_sensitivity.IEEE Std 952.gyro_x")
        covered.append(abs(slope.value - per_degc * 1e6) <= 2.0 * slope.standard_uncertainty)
        assert slope.standard_uncertainty < 10.0
        at = [
            np.polynomial.polynomial.polyval(
                30.0,
                [c.value for c in model(found, f"gyro_x.{name}_over_temperature").coefficients],
            )
            for name in ("K", "F0")
        ]
        shown = indication(rate, 30.0)
        best = np.polyfit(rate, shown, 1)
        errors = [np.max(np.abs((shown - zero) / K - rate)) for K, zero in (at, best)]
        worse.append(errors[0] / errors[1])
    assert np.mean(covered) >= LEAST
    assert max(worse) < 1.1


@pytest.mark.slow
def test_sweeps_of_one_direction_alone_do_not_tell_the_zero():
    """Positive sweeps of a bent response: a warning that names it, and F0 covers the gyro's true
    zero.
    """
    covered = []
    for seed in range(20):
        logs, indication, _ = sweeps(seed, one_way=True)
        found = fit(logs)
        assert any("every run turns one way" in flag for flag in found.flags)
        line = model(found, "gyro_x")
        F0 = line.coefficients[1]
        truth = indication(np.zeros(1), line.value("temp_case"))[0]
        covered.append(inside(F0.value, F0.standard_uncertainty, line.dof_of(F0), truth))
    assert np.mean(covered) >= LEAST


@pytest.mark.slow
def test_an_error_of_each_side_of_the_table_is_found_and_is_in_the_uncertainty():
    """Zeros that differ by 0.6 °/h from direction to direction, anew in every run: the component is
    stated in 18 of 20 campaigns, and K covers the gyro's in 18.
    """
    stated, covered = [], []
    for seed in range(20):
        gyro, logs = campaign(seed, degc=np.linspace(-35.0, 85.0, 7), ripple_dps=0.0)
        rng = np.random.default_rng([seed, 17])
        for log in logs.values():
            ahead, back = gyro.K * 0.6 / DPH_PER_DPS * rng.normal(size=2)
            rate = log["table_rate_dps"]
            log["gyro_x_lsb"] = log["gyro_x_lsb"] + np.where(rate > 0.0, ahead, back) * (rate != 0)
        found = fit(logs)
        parts = model(found, "gyro_x").components
        stated.append(any((p.group, p.effect, p.unit) == ("side", "zero", "deg/h") for p in parts))
        covered.append(scale_covers(found, gyro))
    assert sum(stated) >= 18
    assert sum(covered) >= 18
