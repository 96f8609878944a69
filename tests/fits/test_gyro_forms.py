"""Model forms of gyros on a rate table: derivatives are those of the result, and matrices that are
read back give the rates that the indications came from.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibkit.errors import CoefficientError
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.records.coefficients import Coefficient, Model, Parameter, Record

RATES = np.linspace(-90.0, 90.0, 7)
AT = {
    forms.RATE: RATES,
    "rate_x_dps": RATES,
    "rate_y_dps": RATES[::-1] / 3.0,
    "rate_z_dps": np.full(7, 2.0),
    forms.TEMPERATURE: np.linspace(-40.0, 60.0, 7),
}
SENSITIVITY = np.array([[1e4, 12.0, -7.0], [3.0, 9.9e3, 20.0], [-15.0, 4.0, 1.01e4]])
BIAS = np.array([20.0, -11.0, 3.0])


def model(form, values, *, parameters=(), valid=None):
    """Model of a form with these values by name."""
    return Model(
        "one",
        form.name,
        tuple(Coefficient(name, value, "1", 0.0) for name, value in values.items()),
        (),
        3,
        0.0,
        "1",
        valid or {},
        parameters,
    )


def response(values, *, sine):
    """Response over rate within ±100 °/s, as calibkit 0.2 wrote it."""
    parameters = (Parameter("sine", float(sine), "1"),)
    limits = {forms.RATE: (-100.0, 100.0)}
    return model(forms.RESPONSE_1, values, parameters=parameters, valid=limits)


def bent(values):
    """Response within ±100 °/s and from −40 to 60 °C."""
    limits = {forms.RATE: (-100.0, 100.0), forms.TEMPERATURE: (-40.0, 60.0)}
    units = {"fastest_dps": 100.0, "temp_middle_degc": 10.0, "temp_half_degc": 50.0}
    parameters = tuple(Parameter(name, value, "1") for name, value in units.items())
    return model(forms.RESPONSE, values, parameters=parameters, valid=limits)


def triad():
    """Three gyros with their biases."""
    names, biases = forms.triad_names(("x", "y", "z"))
    values = dict(zip([*names, *biases], [*SENSITIVITY.ravel(), *BIAS], strict=True))
    return model(forms.TRIAD, values, valid={forms.RATE: (-100.0, 100.0)})


ODD = response({"F0": 0.01, "K1": 1.0001, "K3": 2e-9}, sine=False)
SINE = response({"F0": 0.01, "K": 0.9999, "rate_scale_dps": 200.0}, sine=True)
BENT = bent(
    {"K0": 1e4, "K1": -40.0, "F0": 20.0, "F1": 1.0, "c3": -3e4, "c5": 400.0, "d3": 90.0, "d5": 7.0}
)
MODELS = {
    "line": (forms.LINE, model(forms.LINE, {"K": 1e4, "F0": 20.0})),
    "odd": (forms.RESPONSE_1, ODD),
    "sine": (forms.RESPONSE_1, SINE),
    "bent": (forms.RESPONSE, BENT),
    "triad": (forms.TRIAD, triad()),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_gradient_is_the_derivative_of_the_result(name):
    """Every coefficient a little larger and smaller, by central differences."""
    form, one = MODELS[name]
    gradient = form.gradient(one, AT)
    for column, coefficient in enumerate(one.coefficients):
        step = 1e-4 * max(abs(coefficient.value), 1e-6)
        moved = []
        for value in (coefficient.value + step, coefficient.value - step):
            others = list(one.coefficients)
            others[column] = replace(coefficient, value=value)
            moved.append(form.evaluate(replace(one, coefficients=tuple(others)), AT))
        slope = (moved[0] - moved[1]) / (2.0 * step)
        np.testing.assert_allclose(
            gradient[..., column], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max()
        )


def test_a_triad_gives_the_indications_of_its_gyros():
    """F = S Ω + B written out."""
    rates = np.column_stack([AT[f"rate_{axis}_dps"] for axis in "xyz"])
    found = forms.TRIAD.evaluate(triad(), AT)
    np.testing.assert_allclose(found, rates @ SENSITIVITY.T + BIAS, rtol=1e-12)


def test_rates_of_a_base_come_back_from_the_indications_of_its_gyros():
    """S and B of a run's files, read and inverted."""
    rates = np.column_stack([AT[f"rate_{axis}_dps"] for axis in "xyz"])
    spec = GyroTriadRecipe.model_construct(gyros=("x", "y", "z"))
    record = Record("s", "S-1", 1, "", "", "", "", ())
    records = {
        forms.SCALE_FILE: record,
        forms.ORTHOGONALITY_FILE: replace(record, models=(replace(triad(), name="triad"),)),
    }
    (matrix,) = forms.read_matrices(spec, records)
    found = matrix.rates(forms.TRIAD.evaluate(triad(), AT), np.zeros(7))
    np.testing.assert_allclose(found, rates, atol=1e-10)


@pytest.mark.parametrize("bent", [None, ODD, SINE, BENT], ids=["line", "odd", "sine", "bent"])
def test_the_rate_of_a_gyro_comes_back_from_its_indication(bent):
    """A straight line, and responses that are turned around, at temperatures of their own."""
    line = model(forms.LINE, {"K": 1e4, "F0": 20.0})
    matrix = forms.GyroMatrix(("x",), ("gyro_x_dps",), line, ("K", "F0"), response=bent)
    if bent is BENT:
        indication = forms.RESPONSE.evaluate(bent, AT)
    else:
        indication = 20.0 + 1e4 * (RATES if bent is None else forms.RESPONSE_1.evaluate(bent, AT))
    found = matrix.rates(indication[:, None], AT[forms.TEMPERATURE])
    np.testing.assert_allclose(found[:, 0], RATES, atol=1e-9)


def test_the_indication_of_a_bent_response_is_the_formula():
    """F = K(T) Ω + Σ (c_k + d_k x) (Ω/Ω_max)^k + F0(T) written out."""
    x = (AT[forms.TEMPERATURE] - 10.0) / 50.0
    share = RATES / 100.0
    expected = (1e4 - 40.0 * x) * RATES + 20.0 + x
    expected += (-3e4 + 90.0 * x) * share**3 + (400.0 + 7.0 * x) * share**5
    np.testing.assert_allclose(forms.RESPONSE.evaluate(BENT, AT), expected, rtol=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"K0": 1e4, "F0": 20.0, "c3": -2e6},
        {"K0": 1e4, "K1": 0.0, "K2": 0.0, "F0": 20.0, "F1": 0.0, "F2": 0.0}
        | {"c3": -2e6, "d3": 0.0, "e3": 2e6},
    ],
    ids=["everywhere", "in the middle of the temperatures"],
)
def test_a_response_that_falls_with_the_rate_has_no_rates(values):
    """A cubic that turns back within the fitted rates is refused by name, also where it rises at
    both ends of the temperature.
    """
    falling = bent(values)
    line = model(forms.LINE, {"K": 1e4, "F0": 20.0})
    matrix = forms.GyroMatrix(("x",), ("gyro_x_dps",), line, ("K", "F0"), response=falling)
    with pytest.raises(CoefficientError, match="not monotonic"):
        matrix.rates(np.zeros((3, 1)), np.zeros(3))
