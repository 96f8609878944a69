"""NIST StRD regression sets: the linear core to nine digits, the nonlinear solvers to seven,
standard deviations too.
"""

import csv
import math
import re

import lmfit
import numpy as np
import pytest

import calibkit
from calibkit.errors import FitError
from calibkit.fit.solve import solve
from calibkit.instruments.accelerometer import profile_intervals
from calibkit.numeric.least_squares import fit
from conftest import NIST

LINEAR = {
    "norris": (0, 1),
    "pontius": (0, 1, 2),
    "noint1": (1,),
    "noint2": (1,),
    "wampler1": range(6),
    "wampler2": range(6),
}
"""Set, to the powers of x in its model."""


def rational(b, x, numerator):
    """Quotient of polynomials whose denominator starts with 1."""
    top = sum(c * x[0] ** k for k, c in enumerate(b[:numerator]))
    return top / (1.0 + sum(c * x[0] ** (k + 1) for k, c in enumerate(b[numerator:])))


def gauss(b, x):
    """A decaying exponential and two bells."""
    bells = (b[k] * np.exp(-((x[0] - b[k + 1]) ** 2) / b[k + 2] ** 2) for k in (2, 5))
    return b[0] * np.exp(-b[1] * x[0]) + sum(bells)


def exponentials(b, x):
    """Sum of three decaying exponentials."""
    return sum(b[k] * np.exp(-b[k + 1] * x[0]) for k in (0, 2, 4))


def periods(b, x):
    """A mean and waves of a year and of two unknown periods."""
    turn = 2.0 * np.pi * x[0]
    waves = ((12.0, 1, 2), (b[3], 4, 5), (b[6], 7, 8))
    return b[0] + sum(b[i] * np.cos(turn / p) + b[j] * np.sin(turn / p) for p, i, j in waves)


def chwirut(b, x):
    """Response of an ultrasonic block."""
    return np.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


NONLINEAR = {
    "Misra1a": lambda b, x: b[0] * (1.0 - np.exp(-b[1] * x[0])),
    "Chwirut1": chwirut,
    "DanWood": lambda b, x: b[0] * x[0] ** b[1],
    "Gauss1": gauss,
    "Kirby2": lambda b, x: rational(b, x, 3),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat43": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x[0])) ** (1.0 / b[3]),
    "Thurber": lambda b, x: rational(b, x, 4),
}
ALL_NONLINEAR = NONLINEAR | {
    "Bennett5": lambda b, x: b[0] * (b[1] + x[0]) ** (-1.0 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1.0 - np.exp(-b[1] * x[0])),
    "Chwirut2": chwirut,
    "ENSO": periods,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x[0] - b[2]) / b[1]) ** 2),
    "Gauss2": gauss,
    "Gauss3": gauss,
    "Lanczos1": exponentials,
    "Lanczos2": exponentials,
    "Lanczos3": exponentials,
    "MGH09": lambda b, x: b[0] * (x[0] ** 2 + x[0] * b[1]) / (x[0] ** 2 + x[0] * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x[0] + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x[0] * b[3]) + b[2] * np.exp(-x[0] * b[4]),
    "Misra1b": lambda b, x: b[0] * (1.0 - (1.0 + b[1] * x[0] / 2.0) ** -2),
    "Misra1c": lambda b, x: b[0] * (1.0 - (1.0 + 2.0 * b[1] * x[0]) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x[0] / (1.0 + b[1] * x[0]),
    "Rat42": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x[0])),
    "Roszman1": lambda b, x: b[0] - b[1] * x[0] - np.arctan(b[2] / (x[0] - b[3])) / np.pi,
}
CASES = [(name, start) for name in NONLINEAR for start in (0, 1)]


def certified(name):
    """Starts [2, p], certified parameters and standard deviations, response, predictors of a
    nonlinear set.
    """
    lines = (NIST / f"nonlinear_{name}.dat").read_text().splitlines()
    rows = [re.match(r"\s*b\d+\s*=\s*(.*)", line) for line in lines[:60]]
    table = np.array([[float(v) for v in row[1].split()] for row in rows if row])
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()])
    # Nelson's model is for the logarithm of the response
    response = np.log(data[:, 0]) if name == "Nelson" else data[:, 0]
    return table[:, :2].T, table[:, 2], table[:, 3], response, data[:, 1:].T


def slopes(model, b, x):
    """Exact derivatives [n, p] by complex steps."""
    columns = []
    for j, value in enumerate(b):
        moved = b.astype(complex)
        moved[j] += 1e-30j * (abs(value) or 1.0)
        columns.append(model(moved, x.astype(complex)).imag / (1e-30 * (abs(value) or 1.0)))
    return np.column_stack(columns)


@pytest.mark.parametrize("name", LINEAR)
def test_linear_sets_come_out_to_nine_digits(name):
    """Estimates and standard errors of the certified sets are reproduced, the exact ones
    exactly.
    """
    data = np.genfromtxt(
        NIST / f"linear_{name}.csv", delimiter=",", names=True, encoding="utf-8-sig"
    )
    with (NIST / "linear_certified_15digits.csv").open(encoding="utf-8") as opened:
        rows = [row for row in csv.DictReader(opened) if row["dataset"] == name]
    expected = np.array([[float(row["estimate"]), float(row["std_err"])] for row in rows])
    design = np.column_stack([data["x"] ** power for power in LINEAR[name]])
    fitted = fit.linear(design, data["y"])
    np.testing.assert_allclose(fitted.coefficients, expected[:, 0], rtol=1e-9)
    # Wampler's polynomials are exact: their standard errors are zero, and rounding must stay far
    # below the estimates
    np.testing.assert_allclose(fitted.standard_uncertainty, expected[:, 1], rtol=1e-9, atol=1e-12)
    assert fitted.dof == int(rows[0]["dof"])


@pytest.mark.parametrize(("name", "start"), [case for case in CASES if case != ("Rat43", 0)])
def test_the_solver_finds_the_certified_values_from_both_starts(name, start):
    """Parameters within a thousandth of their standard deviations, these to three digits, from
    NIST's far and near starts.
    """
    starts, parameters, deviations, y, x = certified(name)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        fitted = solve(lambda b: NONLINEAR[name](b, x) - y, starts[start])
    assert fitted.converged
    assert np.max(np.abs(fitted.parameters - parameters) / deviations) < 1e-3
    np.testing.assert_allclose(fitted.of(lambda p: p).u, deviations, rtol=1e-3)


def test_the_solver_says_where_it_found_no_minimum():
    """From the far start of Rat43 halved steps end away from the minimum."""
    starts, _, _, y, x = certified("Rat43")
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        fitted = solve(lambda b: NONLINEAR["Rat43"](b, x) - y, starts[0])
    assert not fitted.converged


@pytest.mark.parametrize("name", NONLINEAR)
def test_lmfit_as_the_magnitude_fit_calls_it_gives_seven_digits(name):
    """With exact derivatives and the magnitude fit's tolerances, bounded lmfit gives seven digits
    and more.
    """
    starts, parameters, deviations, y, x = certified(name)
    model = NONLINEAR[name]
    named = lmfit.Parameters()
    for j, value in enumerate(starts[1]):
        named.add(
            f"b{j}",
            value=value,
            min=min(0.2 * value, 5.0 * value),
            max=max(0.2 * value, 5.0 * value),
        )

    def values(p):
        return np.array([p[f"b{j}"].value for j in range(len(parameters))])

    result = lmfit.Minimizer(lambda p: model(values(p), x) - y, named).minimize(
        method="leastsq", Dfun=lambda p: slopes(model, values(p), x), **profile_intervals.TOLERANCES
    )
    found = np.array([result.params[f"b{j}"].value for j in range(len(parameters))])
    np.testing.assert_allclose(found, parameters, rtol=1e-7)
    inverse = np.linalg.inv(np.linalg.qr(slopes(model, found, x), mode="r"))
    spread = np.sqrt(
        np.sum(inverse**2, axis=1) * np.sum(result.residual**2) / (y.size - len(parameters))
    )
    np.testing.assert_allclose(spread, deviations, rtol=2e-7)
    np.testing.assert_allclose(
        [result.params[f"b{j}"].stderr for j in range(len(parameters))], deviations, rtol=1e-6
    )


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", ALL_NONLINEAR)
def test_regress_gives_six_digits_of_all_sets_from_both_starts(name, start):
    """Parameters to 6 digits; standard deviations too, but where residuals are rounding."""
    starts, parameters, deviations, y, x = certified(name)
    found = calibkit.regress(lambda x, *b: ALL_NONLINEAR[name](b, x), x, y, starts[start])
    np.testing.assert_allclose(found.parameters, parameters, rtol=1e-6)
    if name != "Lanczos1":
        np.testing.assert_allclose(found.standard_uncertainty, deviations, rtol=1e-6)


@pytest.mark.parametrize(
    ("model", "start", "match"),
    [
        (lambda x, a, b: (a + b) * x, (1.0, 2.0), "do not determine"),
        (lambda x, a, b: a * np.exp(-b * x) + 1e4, (1.0, 1e6), "do not determine|no minimum"),
        (lambda x, a: a, (1.0,), "the model gives"),
        (lambda x, a: a * x, (np.nan,), "not all finite"),
        (lambda x, *p: np.polyval(p, x), np.ones(20), "values for 20 parameters"),
    ],
)
def test_regress_refuses_what_is_no_answer(model, start, match):
    """Parameters that data do not determine, a wrong shape, numbers that are none, too many."""
    x = np.linspace(0.0, 1.0, 20)
    with pytest.raises(FitError, match=match):
        calibkit.regress(model, x, 1e4 + x, start)


def test_regress_takes_names_and_models_without_complex_numbers():
    """Parameters by name; a model of real functions alone gives the same to seven digits."""
    starts, parameters, _, y, x = certified("Misra1a")
    begin = dict(zip(("a", "b"), starts[1], strict=True))
    found = calibkit.regress(
        lambda x, a, b: [a * (1.0 - math.exp(-b * each)) for each in x[0]], x, y, begin
    )
    assert found.names == ("a", "b")
    np.testing.assert_allclose(found.parameters, parameters, rtol=1e-7)
    assert (found.half_width_95 > 2.0 * found.standard_uncertainty).all()
