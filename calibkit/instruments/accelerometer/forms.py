"""Model forms of a triad: K-factor of one axis, Q-factor, and the affine triad over temperature."""

import numpy as np

from calibkit.fit.complex_step import Numbers
from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.equation import read_terms
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Model
from calibkit.records.forms import Form, Inputs

COMPONENTS = ("accel_x_g", "accel_y_g", "accel_z_g")
TEMPERATURE = "temp_case_degc"
K_MODELS = ("accel_x", "accel_y", "accel_z")
"""Names of the K models, one per axis."""
SCALE_FACTOR, ZERO_OFFSET, CROSS = (
    published.K_NAMES[:4],
    published.K_NAMES[4:8],
    published.K_NAMES[8:],
)
"""Names of K0 … K3 (scale factor) and K4 … K7 (zero offset) in ascending powers of temperature, and
of K8, K9 (cross-axis terms): the numbering of the source, to which no power can be added.
"""


def inputs(indication: Array, temperature: Array) -> Inputs:
    """Inputs of a form from indications [n, 3, g] and temperatures [n, °C]."""
    return {**dict(zip(COMPONENTS, indication.T, strict=True)), TEMPERATURE: temperature}


def _indication(inputs: Inputs) -> Array:
    """Indications [n, 3, g] of the three axes, stacked."""
    return np.column_stack([inputs[component] for component in COMPONENTS])


def _corrected(model: Model, p: Numbers, inputs: Inputs) -> Numbers:
    """Corrected components [n, 3, g] by `equation`."""
    terms = read_terms(tuple(c.name for c in model.coefficients))
    return terms.corrected(p, _indication(inputs), inputs[TEMPERATURE])


K = Form(
    "accel-k/1",
    lambda model, at: published.columns(
        _indication(at), at[TEMPERATURE], K_MODELS.index(model.name)
    ),
    # 0 in files of 0.2
    further=lambda model, at: np.full(
        len(at[TEMPERATURE]), sum(p.value for p in model.parameters if p.name == "lack_of_fit")
    ),
)
"""One corrected component [n, g]: G (K0 + K1 t + K2 t² + K3 t³) − (K4 + K5 t + K6 t² + K7 t³)
− K8 G′ − K9 G″, G′ and G″ the indications of the two other axes; its lack of fit is the size [g] of
what it corrects otherwise than the triad.
"""
Q = Form.of_equation(
    "accel-q/1",
    lambda _, angles, at: _indication(at) @ published.exact_matrix(angles).T,
    meaning=("temperature",),
)
"""Orthogonal components [n, 3, g] by the exact matrix of the small angles Q1, Q2, Q3 [rad]."""
TRIAD = Form.of_equation("accel-triad/1", _corrected)
"""Corrected components [n, 3, g], cross-axis terms on compensated values."""
AFFINE = Form.of_equation("accel-affine/1", _corrected)
"""Corrected components [n, 3, g]: M(t) (G − b(t)) with higher orders of the indications."""
FORMS = (K, Q, AFFINE, TRIAD)
BY_NAME = {form.name: form for form in FORMS}
