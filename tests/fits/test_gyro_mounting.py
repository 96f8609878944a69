"""Pairs and triads in a real laboratory: runs at two temperatures, input axes off the table axis,
mountings that do not repeat. Gyros are input axes in space; the table turns them about another one.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibkit.certificate.fit_tables import UNNAMED
from calibkit.errors import RecipeError
from calibkit.instruments import parse_recipe
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    corrections,
    fit,
    simulate,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe, GyroTriadRecipe
from calibkit.numeric import gum
from calibkit.recipe import find
from calibkit.records.frame import Log

SEEDS = range(50)
LEAST = 0.88
"""Share of campaigns that the stated interval must cover."""
RATES = simulate.both_ways((10.0, 20.0, 40.0, 60.0, 80.0, 100.0))
LOGS = {"files": ["*.csv"]}


def across(axis, rng):
    """Two unit vectors across an axis, in a direction drawn about it."""
    first = np.cross(axis, rng.normal(size=3))
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def run_about(name, table_axis, gyros, axes, start_degc, spec, rng):
    """Run of a table that turns gyros, name → constants, with input axes in space about an axis."""
    x, y = across(table_axis, rng)
    seen = {
        f"gyro_{g}_lsb": replace(
            gyro, axis=tuple(float(axes[g] @ one) for one in (x, y, table_axis))
        )
        for g, gyro in gyros.items()
    }
    table = simulate.TurnedTable(interval_s=1.0, start_angle_deg=rng.uniform(0.0, 360.0))
    columns = simulate.run(seen, table, RATES, start_degc, rng)
    log = Log(name, f"{name}.csv", name, len(columns["time_s"]), pd.DataFrame(columns))
    return table_runs.fit_run(spec, log)


def tilted(axis, size_rad, rng):
    """Axis off by an angle in a direction drawn about it."""
    first, _ = across(axis, rng)
    return np.cos(size_rad) * axis + np.sin(size_rad) * first


def pair(seed, spec, *, apart_degc=0.0, per_degc=None, off_deg=0.0):
    """Model of a pair, flags, and the true N at the middle temperature and angle between the
    gyros [°].
    """
    rng = np.random.default_rng([seed, 2])
    alpha = 90.0 + 0.3 * rng.normal()
    axes = {
        "a": np.array([0.0, 0.0, 1.0]),
        "b": np.array([np.sin(np.radians(alpha)), 0.0, np.cos(np.radians(alpha))]),
    }
    gyros = {g: simulate.RateGyro.draw(rng) for g in axes}
    if per_degc is not None:
        gyros = {g: replace(gyro, K_per_degc=per_degc) for g, gyro in gyros.items()}
    runs = [
        run_about(g, tilted(axes[g], np.radians(off_deg), rng), gyros, axes, degc, spec, rng)
        for g, degc in (("a", 25.0), ("b", 25.0 + apart_degc))
    ]
    fitted = fit.fit_campaign(spec, {"a": (runs[0],), "b": (runs[1],)})
    degc = np.mean([run.temp_degc for run in runs])
    table = simulate.TurnedTable()
    K = {g: gyro.best_line(table, RATES, degc)[0] for g, gyro in gyros.items()}
    _, angles = coefficient_files.list_results(fitted, spec)
    return angles.models[0], fitted.flags, K["b"] / K["a"], alpha


def inside(model, name, truth):
    """Whether the truth lies within the expanded uncertainty of a coefficient."""
    (c,) = (c for c in model.coefficients if c.name == name)
    return abs(c.value - truth) <= gum.coverage_factor(model.dof_of(c)) * c.standard_uncertainty


PAIR = GyroPairRecipe(procedure="gyro_pair", logs=LOGS)


def test_the_ratio_of_runs_at_two_temperatures_carries_what_they_are_apart():
    """1.9 °C apart at 60 ppm/°C: N covers, and the flag names N with its size; at one temperature u
    stays below 3 ppm.
    """
    covered = []
    for seed in SEEDS:
        model, flags, N, _ = pair(seed, PAIR, apart_degc=1.9, per_degc=60e-6)
        covered.append(inside(model, "N", N))
    assert np.mean(covered) >= LEAST
    assert any("1.9 °C apart" in flag and "u of N holds 1.1e+02 ppm" in flag for flag in flags)
    model, flags, N, _ = pair(0, PAIR, per_degc=60e-6)
    assert inside(model, "N", N)
    assert model.coefficients[0].standard_uncertainty < 3e-6
    assert not any("apart" in flag for flag in flags)


def component(group, effect, value, unit):
    """A known error of a recipe."""
    return {"group": group, "effect": effect, "value": value, "unit": unit, "dof": 20.0}


@pytest.mark.parametrize("stated", [False, True], ids=["unknown", "stated"])
def test_an_unseen_run_in_another_mounting_contradicts_no_scale_factor(stated):
    """A run whose mounting is 60″ off: where the recipe does not say how mountings repeat, K across
    the turned axis is not held against the fit; where it does, its u holds both mountings.
    """
    components = [component("run", "scale", 2.0, "ppm")]
    if stated:
        components.append(component("mounting", "angle", 60.0 / 3600.0, "deg"))
    spec = GyroTriadRecipe(
        procedure="gyro_triad",
        logs=LOGS,
        site={"latitude_deg": 34.2},
        errors={"component": components},
    )
    rng = np.random.default_rng(11)
    axes = dict(zip("xyz", np.eye(3), strict=True))
    gyros = {g: simulate.RateGyro.draw(rng) for g in axes}
    about = (gyros, axes, 25.0, spec, rng)
    runs = {g: (run_about(f"about_{g}", axis, *about),) for g, axis in axes.items()}
    stages = coefficient_files.list_results(fit.fit_campaign(spec, runs), spec)
    records = {stage.file: stage.as_record(UNNAMED, "") for stage in stages}
    off = tilted(axes["x"], np.radians(60.0 / 3600.0), rng)
    unseen = run_about("about_x_again", off, *about).log
    _, summary = corrections.validate(spec, records, [replace(unseen, file="about_x_again.csv")])
    (of_K,) = (criterion for criterion in summary.criteria if "error of K" in criterion.name)
    assert of_K.passed


@pytest.mark.parametrize(
    ("group", "effect", "unit"),
    [("mounting", "angle", "ppm"), ("mounting", "scale", "ppm"), ("run", "zero", "deg/h")],
)
def test_a_component_in_another_unit_or_of_another_effect_is_refused(group, effect, unit):
    """Of a pair, the angle of mounting and how scale factors repeat can be stated, nothing else;
    units of angles are named.
    """
    settings = (
        f'errors.component=[{{group="{group}",effect="{effect}",value=1.0,unit="{unit}",dof=9.0}}]',
    )
    with pytest.raises(
        RecipeError, match=r"expected angle in deg|state it in deg, .*arcsec|expected mounting"
    ):
        parse_recipe(find("gyro_pair", settings))
