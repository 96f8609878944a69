"""NIST StRD regression sets: the linear core to nine digits, the nonlinear solvers to seven,
standard deviations too.
"""

import csv
import re

import lmfit
import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import profile
from calibkit.numeric.least_squares import fit, gauss_newton
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


NONLINEAR = {
    "Misra1a": lambda b, x: b[0] * (1.0 - np.exp(-b[1] * x[0])),
    "Chwirut1": lambda b, x: np.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0]),
    "DanWood": lambda b, x: b[0] * x[0] ** b[1],
    "Gauss1": lambda b, x: (
        b[0] * np.exp(-b[1] * x[0])
        + b[2] * np.exp(-((x[0] - b[3]) ** 2) / b[4] ** 2)
        + b[5] * np.exp(-((x[0] - b[6]) ** 2) / b[7] ** 2)
    ),
    "Kirby2": lambda b, x: rational(b, x, 3),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat43": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x[0])) ** (1.0 / b[3]),
    "Thurber": lambda b, x: rational(b, x, 4),
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


@pytest.mark.parametrize(("name", "start"), [case for case in CASES if case != ("Nelson", 0)])
def test_gauss_newton_gives_nine_digits_from_both_starts(name, start):
    """Parameters and standard deviations from NIST's far and near starts, block by block."""
    starts, parameters, deviations, y, x = certified(name)
    model = NONLINEAR[name]

    def residuals(b, rows):
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return (model(b, x) - y)[rows], slopes(model, b, x)[rows]

    fitted = gauss_newton.fit(residuals, starts[start], y.size, block_rows=50)
    np.testing.assert_allclose(fitted.parameters, parameters, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(fitted.covariance)), deviations, rtol=1e-9)


def test_gauss_newton_refuses_rather_than_guess():
    """From Nelson's far start the guarded steps find no minimum: that is said, no number is
    given.
    """
    starts, _, _, y, x = certified("Nelson")
    model = NONLINEAR["Nelson"]

    def residuals(b, rows):
        with np.errstate(over="ignore", invalid="ignore"):
            return (model(b, x) - y)[rows], slopes(model, b, x)[rows]

    with pytest.raises(FitError, match="no convergence"):
        gauss_newton.fit(residuals, starts[0], y.size)


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
        method="leastsq", Dfun=lambda p: slopes(model, values(p), x), **profile.TOLERANCES
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
