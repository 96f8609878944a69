"""K0 … K9 and Q1, Q2, Q3 as published (Zhou, Hu & Fu 2010).

Per axis, x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) - (K4 + K5 t + K6 t² + K7 t³) - K8 G_y - K9 G_z

K = P g, P the pseudo-inverse of the design: exact on data that the form made. What K is uncertain
by, P V Pᵀ, comes from the errors of the triad's own fit. Q are the angles between the axes of the
triad at one temperature.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model, Parameter
from calibkit.forms import components_of
from calibkit.instruments.accelerometer import determination, forms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.numeric import k_factor, q_factor
from calibkit.instruments.accelerometer.recipe import KAxisSpec
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial


def require_k(orders_of_axes: Sequence[KAxisSpec], reference: Array, temperature: Array) -> None:
    """Raise FitError where references [n, 3] and temperatures [n] [°C] leave a K undetermined.

    Of a triad without an error K are what the terms of its equation are.
    """
    x, y, z = orders_of_axes
    terms = Terms.of_orders(
        (x.scale_order, y.scale_order, z.scale_order),
        (x.zero_order, y.zero_order, z.zero_order),
        (x.cross - 1, y.cross - 1, z.cross - 1),
    )
    numbers = []
    for term in terms.listed:
        cross = 8 + k_factor.CROSS[term.axis].index(term.factors[0]) if term.kind == "c" else 0
        numbers.append(cross or term.power + (4 if term.kind == "z" else 0))
    names = [k_factor.NAMES[number] for number in numbers]
    lower = "lower scale_order and zero_order, or set cross to false"
    determination.require_determined(terms, names, reference, temperature, lower=lower)


def fit_k(dwells: DwellSet, orders_of_axes: Sequence[KAxisSpec], triad: Triad) -> tuple[Model, ...]:
    """K models of the three axes from the dwells that the triad's fit kept."""
    t = triad.mapped(dwells.temperature)
    used = triad.fit.used.reshape(-1, 3)
    weights = np.ones(used.shape) if dwells.weights is None else dwells.weights
    form = corrections(orders_of_axes, dwells.indication, t)
    P = pseudo_inverse(form, np.sqrt(weights) * used)
    fit = triad.fit.linear(P, dwells.reference.ravel()).bounded_by(triad.bounds)
    by_triad = triad.terms.corrected(triad.fit.parameters, dwells.indication, t)
    by_form = form @ fit.parameters
    to_raw = to_degrees(triad.middle, triad.half)
    models = []
    for axis, (name, orders) in enumerate(zip(forms.K_MODELS, orders_of_axes, strict=True)):
        block = slice(10 * axis, 10 * axis + 10)
        mapped, of_mapped = fit.parameters[block], fit.total_covariance[block, block]
        # in extended precision, because K3 and K7 lose digits in double
        raw, covariance = polynomial.in_raw_powers(mapped, of_mapped, to_raw)
        in_degrees = np.zeros((10, 30))
        in_degrees[:, block] = to_raw
        used_rows = used[:, axis]
        left = (dwells.reference - by_form)[used_rows, axis]
        lack_of_fit = rms((by_form - by_triad)[used_rows, axis])
        scaled = zip(k_factor.NAMES, mapped.tolist(), strict=True)
        model = forms.K.write(
            name,
            list(zip(k_factor.NAMES, raw.tolist(), forms.K_UNITS, strict=True)),
            covariance,
            dof=fit.dof,
            residual_rms=float(np.sqrt(left @ left / max(len(left) - len(orders.fitted), 1))),
            residual_unit="g",
            valid=dwells.valid,
            parameters=(
                Parameter("middle", triad.middle, "degC"),
                Parameter("half", triad.half, "degC"),
                *(Parameter(f"scaled_{name}", value, "1") for name, value in scaled),
                Parameter("lack_of_fit", lack_of_fit, "g"),
            ),
            effective_dof=fit.dof_along(in_degrees),
            components=components_of(triad.fit.shared),
        )
        models.append(model)
    return tuple(models)


def corrections(orders_of_axes: Sequence[KAxisSpec], indication: Array, t: Array) -> Array:
    """Design [n, 3, 30] of corrected components by K0 … K9 of x, y and z, 0 of those that are not
    fitted, for temperatures t [n] in the unit that K is meant for.
    """
    design = np.zeros((len(t), 3, 30))
    for axis, orders in enumerate(orders_of_axes):
        fitted = list(orders.fitted)
        columns = k_factor.columns(indication, t, axis, fitted)
        design[:, axis, [10 * axis + number for number in fitted]] = columns
    return design


def pseudo_inverse(design: Array, root: Array) -> Array:
    """P [30, n · 3] of rows of a design [n, 3, 30] with weights root² [n, 3]; 0 for a K that is not
    fitted.
    """
    rows = design.reshape(-1, design.shape[2]) * root.reshape(-1, 1)
    fitted = np.any(rows != 0.0, axis=0)
    P = np.zeros(rows.T.shape)
    P[fitted] = np.linalg.pinv(rows[:, fitted]) * root.ravel()
    return P


def to_degrees(middle: float, half: float) -> np.ndarray:
    """Matrix [10, 10], in extended precision, from K for temperature mapped to [-1, 1] to K in
    powers of °C.
    """
    matrix = np.eye(10, dtype=np.longdouble)
    matrix[:4, :4] = matrix[4:8, 4:8] = polynomial.to_raw_powers(middle, half, 3)
    return matrix


def fit_q(dwells: DwellSet, triad: Triad, temperature: float) -> Model:
    """Q1, Q2, Q3 of the fitted axes at a temperature [°C]; raises FitError for axes in one plane
    and for a left-handed triad.
    """
    t, terms, p = float(triad.mapped(temperature)), triad.terms, triad.fit.parameters
    scale, _ = terms.scale_and_zero(p, np.array([t]))
    q_factor.axes_from_sensitivity(np.asarray(terms.axes(p, t) / scale.T, dtype=np.float64))
    return forms.Q.write_fit(
        "triad",
        triad.fit.restated(lambda q: terms.small_angles(q, t)),
        [(name, "rad") for name in q_factor.NAMES],
        residual_rms=triad.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=(Parameter("temperature", temperature, "degC"),),
    )
