"""Dwells of a triad that physics contradicts: named with place, value and expectation, and never
among the fitted.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from calibkit.fit.value import Value
from calibkit.instruments.accelerometer import simulate as simulator
from calibkit.instruments.accelerometer.fit import choose_fit
from calibkit.records import store

AXES = ("accel_x_g", "accel_y_g", "accel_z_g")


@pytest.fixture
def columns():
    """26 attitudes at five temperatures: 130 dwells of a sensor with 3 % and 50 mg of its own."""
    conditions = {
        "temperatures_degc": (-20.0, 20.0, 50.0, 85.0, 125.0),
        "inclinations_deg": (45.0, 90.0, 135.0),
        "table_noise_deg": 0.001,
    }
    logged = simulator.campaign(3, **conditions).logs["positions.csv"]
    names = ("temp_case_degc", "inclination_deg", "toolface_deg", *AXES)
    logged = {name: np.array(logged[name]) for name in names}
    warm = logged["temp_case_degc"] - 25.0
    for axis, scale, bias in zip(AXES, (1.03, 0.97, 1.02), (0.05, -0.04, 0.05), strict=True):
        logged[axis] = logged[axis] * (scale + 1e-4 * warm) + bias + 3e-4 * warm
    return logged


@pytest.fixture
def fitted(tmp_path, calibkit, log_writer):
    """Fit of columns by the shipped recipe: outcome, and run where there is one."""

    def fit(name, logged, *settings):
        log_writer(tmp_path / name / "positions.csv", **logged)
        arguments = [part for setting in settings for part in ("--set", setting)]
        outcome = calibkit(
            *("fit", "accelerometer", "--data", tmp_path / name, "--serial", name),
            *("--out", tmp_path / "runs", *arguments),
        )
        run = store.load(store.find(name, tmp_path / "runs")) if outcome.code in (0, 1) else None
        return outcome, run

    return fit


def about_dwells(run):
    """Flags of a run that name a dwell."""
    return [flag for flag in run.document["flags"] if "positions.csv:" in flag]


def same_within_u(run, other):
    """Whether the affine coefficients of two runs agree within their standard uncertainties."""
    pairs = zip(
        *(one.records["accel_affine.json"].models[0].coefficients for one in (run, other)),
        strict=True,
    )
    return all(abs(a.value - b.value) <= b.standard_uncertainty for a, b in pairs)


def test_an_uncalibrated_sensor_is_plausible(columns, fitted):
    """3 % of scale factor and 50 mg of bias, both with temperature, are what is calibrated."""
    outcome, run = fitted("A", columns)
    assert outcome.code == 0, outcome.err
    assert about_dwells(run) == []


def test_a_shifted_decimal_point_is_named_and_moves_nothing(columns, fitted):
    """One value ten times too large among 130 dwells: its row, value and expectation are printed,
    and the coefficients are those of the other dwells.
    """
    row = int(np.flatnonzero(columns["inclination_deg"] == 180.0)[1])
    _, clean = fitted("A", columns)
    columns["accel_z_g"][row] *= 10.0
    outcome, run = fitted("B", columns)
    assert outcome.code == 0, outcome.err
    (flag,) = about_dwells(run)
    assert flag.startswith(f"positions.csv:{row + 2}: accel_z_g reads -9.")
    assert "expected -0.9" in flag
    assert "a fit leaves it out" in flag
    assert same_within_u(run, clean)


def test_least_squares_refuses_a_dwell_far_from_one_g(columns, fitted, calibkit, tmp_path):
    """Where the recipe leaves no dwell out, the fit is refused and the row named; `check` says it
    before.
    """
    columns["accel_z_g"][40] = 9.81
    outcome, _ = fitted("A", columns, "loss=least_squares")
    assert outcome.code == 3
    assert "positions.csv:42: accel_z_g reads 9.81 g" in outcome.err
    assert "take them out of the log" in outcome.err
    seen = calibkit("check", "accelerometer", "--data", tmp_path / "A")
    assert "positions.csv:42: accel_z_g reads 9.81 g" in seen.out


def test_a_wrong_row_of_the_reference_is_named_with_the_attitude_that_the_triad_shows(
    columns, fitted
):
    """Inclination 90° written as 135°: both are printed, and no coefficient moves."""
    row = int(np.flatnonzero(columns["inclination_deg"] == 90.0)[9])
    _, clean = fitted("A", columns)
    columns["inclination_deg"][row] = 135.0
    outcome, run = fitted("B", columns)
    assert outcome.code == 0, outcome.err
    (flag,) = [flag for flag in run.document["flags"] if "positions.csv" in flag]
    assert flag.startswith(
        f"positions.csv:{row + 2}: the triad shows about inclination 89°, toolface 45°"
    )
    assert "expected inclination 135°" in flag
    assert same_within_u(run, clean)


def test_an_attitude_that_is_wrong_at_every_temperature_is_refused(columns, fitted):
    """All dwells of one attitude disagree: the table of attitudes is wrong, leaving them out would
    hide it.
    """
    wrong = (columns["inclination_deg"] == 45.0) & (columns["toolface_deg"] == 90.0)
    columns["toolface_deg"] = np.where(wrong, 80.0, columns["toolface_deg"])
    outcome, _ = fitted("A", columns)
    assert outcome.code == 3
    assert "all dwells at inclination 45°, toolface 80°" in outcome.err


@pytest.mark.parametrize(
    ("order", "sign", "said"),
    [
        ((0, 1, 2), (1, -1, 1), "accel_y_g shows −y"),
        ((1, 0, 2), (1, 1, 1), "accel_y_g shows x, accel_x_g shows y"),
        ((1, 2, 0), (1, 1, 1), "accel_z_g shows x, accel_x_g shows y, accel_y_g shows z"),
    ],
)
def test_reversed_and_exchanged_axes_are_named(columns, fitted, order, sign, said):
    """The message says which column shows which component; three axes exchanged in turn are
    right-handed, and were fitted as if they were misaligned by 90°.
    """
    logged = [columns[AXES[k]] * s for k, s in zip(order, sign, strict=True)]
    columns |= dict(zip(AXES, logged, strict=True))
    outcome, _ = fitted("A", columns)
    assert outcome.code == 3
    assert said in outcome.err


def stub(residual, value, suspects=()):
    """A triad whose residuals are all of one size, of ten coefficients with u = 1e-3."""
    values = np.full(10, value)
    fit = SimpleNamespace(
        parameters=values,
        of=lambda function: Value(function(values), np.full(10, 1e-3), np.full(10, 40.0)),
    )
    return SimpleNamespace(
        residuals=np.full((20, 1), residual),
        suspects=suspects,
        fit=fit,
        to_degrees=np.eye(10),
        terms=SimpleNamespace(names=[f"K{k}" for k in range(10)]),
    )


def chosen(robust_fit, plain_fit, before, loss="robust"):
    """Fit that is exported, and its flags."""
    robust_fit = robust_fit if loss == "robust" else None
    return choose_fit(robust_fit, plain_fit, "", np.full(20, before))


def test_a_robust_fit_that_fits_most_dwells_worse_is_not_exported():
    """More than 10 % above least squares, or above no correction: least squares is used, and said;
    within 10 % or rounding, and where it kept all dwells, the robust fit is exported.
    """
    plain = stub(1e-4, 1.0)
    worse, alike = stub(1.2e-4, 1.0, suspects=(3,)), stub(1.05e-4, 1.0, suspects=(3,))
    found, flags = chosen(worse, plain, 1e-2)
    assert found is plain
    assert "1.20e-04 g, least squares 1.00e-04 g" in flags[0]
    all_kept = stub(1.2e-4, 1.0)
    assert chosen(all_kept, all_kept, 1e-2) == (all_kept, ())
    assert chosen(alike, plain, 1e-2) == (alike, ())
    exact, rounded = stub(1e-16, 1.0), stub(1e-12, 1.0, suspects=(3,))
    assert chosen(rounded, exact, 1e-2) == (rounded, ())
