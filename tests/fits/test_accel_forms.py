"""Model forms of a triad: what is written is read back, and derivatives are those of the result."""

from dataclasses import replace

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.instruments.accelerometer import forms, published

RNG = np.random.default_rng(17)
INDICATION = RNG.uniform(-1.0, 1.0, (7, 3))
TEMPERATURE = RNG.uniform(-20.0, 125.0, 7)
AT = forms.inputs(INDICATION, TEMPERATURE)
K_OF_AXES = RNG.normal(0.0, 1.0, (3, 10)) * [
    1,
    1e-4,
    1e-7,
    1e-9,
    1e-2,
    1e-5,
    1e-7,
    1e-9,
    1e-2,
    1e-2,
]
SMALL_ANGLES = np.array([0.011, -0.007, 0.004])
AFFINE_NAMES = (
    *("m_xx0", "m_xx1", "m_yy0", "m_zz0", "m_xy0", "m_zx2", "b_x0", "b_y1", "b_z3"),
    *("n_x_xx", "n_y_yz", "n_z_zzz"),
)
AFFINE_VALUES = np.array([1.01, 2e-5, 0.99, 1.0, 3e-3, 1e-8, 1e-3, 2e-5, 1e-9, 1e-5, -2e-5, 3e-5])
TRIAD_NAMES = ("k_x0", "k_x1", "k_y0", "k_z0", "z_x0", "z_y1", "c_xy", "d_xy", "c_zx", "n_x_xy")
TRIAD_VALUES = np.array([1.01, 2e-5, 0.99, 1.0, 1e-3, 2e-5, 3e-3, 1e-6, -2e-3, 3e-5])


def written(form, name, names, values, units):
    """Model of a form with a covariance of random correlations."""
    root = np.random.default_rng(3).normal(0.0, 1e-5, (len(values), len(values)))
    return form.write(
        name,
        list(zip(names, np.asarray(values).tolist(), units, strict=True)),
        root @ root.T,
        dof=20,
        residual_rms=2e-5,
        residual_unit="g",
        valid={forms.TEMPERATURE: (-20.0, 125.0)},
    )


MODELS = {
    **{
        name: (forms.K, written(forms.K, name, published.K_NAMES, values, published.K_UNITS))
        for name, values in zip(forms.K_MODELS, K_OF_AXES, strict=True)
    },
    "q": (forms.Q, written(forms.Q, "triad", published.Q_NAMES, SMALL_ANGLES, ["rad"] * 3)),
    "affine": (
        forms.AFFINE,
        written(
            forms.AFFINE,
            "triad",
            AFFINE_NAMES,
            AFFINE_VALUES,
            ["1"] * len(AFFINE_NAMES),
        ),
    ),
    "triad": (
        forms.TRIAD,
        written(forms.TRIAD, "triad", TRIAD_NAMES, TRIAD_VALUES, ["1"] * len(TRIAD_NAMES)),
    ),
}


def test_k_of_an_axis_is_the_published_equation():
    """Each axis with the two others that its K8 and K9 multiply, written out."""
    t = TEMPERATURE
    for axis, (second, third) in enumerate(((1, 2), (2, 0), (0, 1))):
        k = K_OF_AXES[axis]
        form, model = MODELS[forms.K_MODELS[axis]]
        expected = (
            INDICATION[:, axis] * (k[0] + k[1] * t + k[2] * t**2 + k[3] * t**3)
            - (k[4] + k[5] * t + k[6] * t**2 + k[7] * t**3)
            - k[8] * INDICATION[:, second]
            - k[9] * INDICATION[:, third]
        )
        np.testing.assert_allclose(form.evaluate(model, AT), expected, rtol=1e-12, atol=1e-12)


def test_q_and_affine_are_what_their_equations_give():
    """The exact matrix of the axes, and M(t) (G − b(t)) with products, entry by entry."""
    form, model = MODELS["q"]
    exact = np.linalg.inv(published.axes_from_angles(SMALL_ANGLES))
    np.testing.assert_allclose(form.evaluate(model, AT), INDICATION @ exact.T, atol=1e-14)
    form, model = MODELS["affine"]
    t, named = TEMPERATURE, dict(zip(AFFINE_NAMES, AFFINE_VALUES, strict=True))
    x, y, z = INDICATION.T - [[named["b_x0"]], [0.0], [0.0]]
    y, z = y - named["b_y1"] * t, z - named["b_z3"] * t**3
    G = INDICATION.T
    expected = np.column_stack(
        [
            (named["m_xx0"] + named["m_xx1"] * t) * x + named["m_xy0"] * y,
            named["m_yy0"] * y,
            named["m_zz0"] * z + named["m_zx2"] * t**2 * x,
        ]
    )
    products = [named["n_x_xx"] * G[0] ** 2, named["n_y_yz"] * G[1] * G[2]]
    expected += np.column_stack([*products, named["n_z_zzz"] * G[2] ** 3])
    np.testing.assert_allclose(form.evaluate(model, AT), expected, atol=1e-15)


@pytest.mark.parametrize("name", MODELS)
def test_the_gradient_is_the_derivative_of_the_result(name):
    """Every coefficient a little larger and smaller, by central differences."""
    form, model = MODELS[name]
    gradient = form.gradient(model, AT)
    for column, coefficient in enumerate(model.coefficients):
        step = 1e-6 * max(abs(coefficient.value), 1e-3)
        moved = []
        for value in (coefficient.value + step, coefficient.value - step):
            others = list(model.coefficients)
            others[column] = replace(coefficient, value=value)
            moved.append(form.evaluate(replace(model, coefficients=tuple(others)), AT))
        slope = (moved[0] - moved[1]) / (2.0 * step)
        scale = np.abs(slope).max()
        np.testing.assert_allclose(gradient[..., column], slope, atol=1e-6 * scale + 1e-9)


@pytest.mark.parametrize("wrong", ["coefficient", "covariance", "residual"])
def test_what_is_not_a_number_is_refused_before_it_reaches_a_file(wrong):
    """A coefficient, a variance or a residual that is not a number is a fit that failed, named by
    its model.
    """
    values, covariance = [1.0, 2.0], np.eye(2)
    if wrong == "coefficient":
        values[1] = float("nan")
    if wrong == "covariance":
        covariance[1, 1] = np.inf
    named = [(name, value, "rad") for name, value in zip(("Q1", "Q2"), values, strict=True)]
    with pytest.raises(FitError, match=r"model 'triad'.*not a number"):
        forms.Q.write(
            "triad",
            named,
            covariance,
            dof=3,
            residual_rms=float("nan") if wrong == "residual" else 1.0,
            residual_unit="g",
            valid={},
        )
