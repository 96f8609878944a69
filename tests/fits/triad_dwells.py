"""Dwells of a triad and recipes, as the tests of its fit state them."""

from types import SimpleNamespace

import numpy as np
from scipy import stats

from calibkit.instruments.accelerometer import fit
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe

WHITE = {
    "component": [
        {"group": group, "effect": effect, "value": 0.0, "unit": unit, "dof": 1000.0}
        for group, effect, unit in (("soak", "zero", "g"), ("attitude", "index", "rad"))
    ]
}
"""Statement that dwells share no error."""


def recipe(**tables):
    """Recipe with the tables stated."""
    start = {"procedure": "accelerometer", "title": "a triad", "logs": {"files": ["a.csv"]}}
    return AccelerometerRecipe.model_validate(start | tables, strict=False)


def collect(indication, temperature=25.0, angles=None, *, noise=None, log=None):
    """Dwells with indications [n, 3] [g] at temperatures [n] [°C] and, where attitudes are known,
    inclinations and toolfaces [n, 2] [°]; standard errors [n], [n, 3] or a number [g].
    """
    count, unknown = len(indication), np.full(len(indication), np.nan)
    error = np.full((count, 3), np.nan)
    if noise is not None:
        error[:] = np.reshape(noise, (-1, 1)) if np.ndim(noise) < 2 else noise
    inclination, toolface = (unknown, unknown) if angles is None else np.transpose(angles)
    return DwellSet(
        np.array(indication, dtype=np.float64),
        np.array(np.broadcast_to(temperature, count), dtype=np.float64),
        np.array(inclination, dtype=np.float64),
        np.array(toolface, dtype=np.float64),
        error,
        unknown,
        np.zeros(count, dtype=np.int64) if log is None else log,
        tuple(f"a.csv:{row}" for row in range(count)),
        (),
    )


def fit_triad(dwells, spec):
    """Triad, its flags, coefficient files and the models in them: K of each axis, Q, the triad."""
    triad, results = fit.fit_triad(dwells, spec)
    models = {result.stage: result.models for result in results}
    (q,), (affine,) = (models.get(stage, (None,)) for stage in ("accel_q", "accel_affine"))
    return SimpleNamespace(
        triad=triad,
        results=results,
        flags=triad.flags,
        k=models.get("accel_k", ()),
        q=q,
        affine=affine,
    )


def values(model):
    """Coefficients [p] of a model."""
    return np.array([one.value for one in model.coefficients])


def uncertainties(model):
    """Standard uncertainties [p] of a model's coefficients."""
    return np.array([one.standard_uncertainty for one in model.coefficients])


def expanded(model):
    """Half-widths [p] of the 95 % intervals of a model's coefficients."""
    dof = np.array([model.dof_of(one) for one in model.coefficients])
    return stats.t.ppf(0.975, dof) * uncertainties(model)


def nine(triad):
    """Scale factors, biases and Q [9] of a triad of constant terms, with 95 % half-widths."""

    def parameters(p):
        k, z = p[:3], p[3:6]
        inverse = np.eye(3, dtype=p.dtype)
        inverse[(1, 2, 2), (0, 0, 1)] = -p[6:]
        # g = (I - C) diag(k) (G - b), whose inverse is the sensitivity
        row = np.linalg.inv(inverse)
        stretch = np.sqrt(np.sum(row * row, axis=1))
        return np.concatenate([stretch / k, z / k, triad.terms.at_temperature(p, 0.0)[6:]])

    value = triad.fit.of(parameters)
    return value.value, stats.t.ppf(0.975, value.dof) * value.u
