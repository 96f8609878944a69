"""Fits of a triad ↔ accel_k.json, accel_q.json, accel_affine.json."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Condition, Figure, Model, Parameter, StageResult
from calibkit.errors import CoefficientError
from calibkit.instruments.accelerometer.numeric import affine as accel_affine
from calibkit.instruments.accelerometer.numeric import k_factor, q_factor
from calibkit.numeric import chunks

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array
    from calibkit.coefficients import Record
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.fit import Triad, TriadFit
    from calibkit.instruments.accelerometer.numeric.k_factor import KAxis
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe


@dataclass(frozen=True, slots=True)
class Correction:
    """A triad's correction as it leaves the files: K [3, 10] and Q [3, 3], or affine parameters by
    name; temperatures [°C].
    """

    k: Array | None
    q: Array | None
    affine: Mapping[str, float]
    temperature: tuple[float, float]

    def __call__(self, indication: Array, temperature: Array) -> Array:
        """Corrected components [n, 3, g]; temperatures [n, °C] are clamped to those of the
        calibration.
        """
        held = np.clip(temperature, *self.temperature)
        if self.k is not None:
            scaled = k_factor.correct(self.k, indication, held)
            return scaled if self.q is None else q_factor.correct(self.q, scaled)
        return accel_affine.correct(self.affine, indication, held)

    def outside(self, temperature: Array) -> float:
        """Share of temperatures [n, °C] that are clamped."""
        low, high = self.temperature
        return (
            chunks.count(temperature, lambda part: (part < low) | (part > high)) / temperature.size
        )


def results(
    fitted: TriadFit,
    dwells: DwellSet,
    gravity_mps2: float | None,
    attitude_figures: tuple[Figure, ...],
) -> tuple[StageResult, ...]:
    """Coefficient files of what was fitted."""
    span = (float(dwells.temperature.min()), float(dwells.temperature.max()))
    conditions = (
        (Condition("local_gravity", gravity_mps2, "m/s^2"),) if gravity_mps2 is not None else ()
    )
    stages = []
    if fitted.k:
        models = tuple(_k_model(axis, span) for axis in fitted.k)
        flags = tuple(flag for flag in fitted.flags if flag.startswith("accel_"))
        stages.append(
            StageResult("accel_k", models, (), (*flags, *_not_fitted(fitted.k)), conditions)
        )
    if fitted.affine is not None:
        flags = tuple(flag for flag in fitted.flags if not flag.startswith("accel_"))
        stages.append(_q_result(fitted, span, flags, conditions))
        stages.append(
            StageResult(
                "accel_affine",
                (_affine_model(fitted.affine, span),),
                attitude_figures,
                flags,
                conditions,
            )
        )
    return tuple(stages)


def _not_fitted(axes: tuple[KAxis, ...]) -> tuple[str, ...]:
    """Which of the ten coefficients were set to zero by the recipe's orders."""
    missing = [
        (axis.axis, [n for k, n in enumerate(k_factor.NAMES) if k not in axis.fitted])
        for axis in axes
    ]
    return tuple(
        f"accel_{axis}: {', '.join(names)} not fitted, taken as 0"
        for axis, names in missing
        if names
    )


def _k_model(axis: KAxis, span: tuple[float, float]) -> Model:
    """accel-k/1 model of one axis."""
    triples = zip(
        k_factor.NAMES, axis.coefficients, k_factor.UNITS, axis.standard_uncertainty, strict=True
    )
    scaled = [
        Parameter(f"scaled_{n}", float(v), "1")
        for n, v in zip(k_factor.NAMES, axis.mapped_coefficients, strict=True)
    ]
    return Model(
        name=f"accel_{axis.axis}",
        form="accel-k/1",
        coefficients=tuple(
            Coefficient(name, float(value), unit, float(u)) for name, value, unit, u in triples
        ),
        covariance=tuple(map(tuple, axis.covariance.tolist())),
        dof=axis.dof,
        residual_rms=axis.residual_rms,
        residual_unit="g",
        valid={"temp_case_degc": span},
        parameters=(
            Parameter("middle", axis.middle, "degC"),
            Parameter("half", axis.half, "degC"),
            *scaled,
        ),
    )


def _q_result(
    fitted: TriadFit,
    span: tuple[float, float],
    flags: tuple[str, ...],
    conditions: tuple[Condition, ...],
) -> StageResult:
    """accel_q.json: the small-angle Q1, Q2, Q3 and, as figures, the exact matrix."""
    uncertainty = np.sqrt(np.diag(fitted.q_covariance))
    affine = fitted.affine
    model = Model(
        name="triad",
        form="accel-q/1",
        coefficients=tuple(
            Coefficient(name, float(value), "rad", float(u))
            for name, value, u in zip(q_factor.NAMES, fitted.q, uncertainty, strict=True)
        ),
        covariance=tuple(map(tuple, fitted.q_covariance.tolist())),
        dof=affine.dof if affine else 0,
        residual_rms=affine.residual_rms if affine else 0.0,
        residual_unit="g",
        valid={"temp_case_degc": span},
        parameters=(Parameter("temperature", fitted.q_temperature, "degC"),),
    )
    axes = q_factor.axes_of(fitted.q)
    slopes = q_factor.derivative(
        lambda q: q_factor.exact(q_factor.axes_of(q)).ravel(), fitted.q, scale=np.ones(3)
    )
    spread = np.sqrt(np.diag(slopes @ fitted.q_covariance @ slopes.T)).reshape(3, 3)
    exact = q_factor.exact(axes)
    figures = tuple(
        Figure(f"Q_exact_{'xyz'[i]}{'xyz'[j]}", float(exact[i, j]), "1", float(spread[i, j]))
        for i in range(3)
        for j in range(i + 1)
    )
    bounds = tuple(
        Figure(f"{name}_{side}_95", float(limit), _nine_unit(name), 0.0)
        for name, interval in fitted.intervals.items()
        for side, limit in zip(("low", "high"), interval, strict=True)
        if np.isfinite(limit)
    )
    return StageResult("accel_q", (model,), (*figures, *bounds), flags, conditions)


def _nine_unit(name: str) -> str:
    """Unit of one of the nine magnitude-only parameters k, b, Q."""
    return {"k": "1", "b": "g"}.get(name[0], "rad")


def _affine_model(affine: Triad, span: tuple[float, float]) -> Model:
    """accel-affine/1 model of the triad."""
    uncertainty = np.sqrt(np.clip(np.diag(affine.covariance), 0.0, None))
    return Model(
        name="triad",
        form="accel-affine/1",
        coefficients=tuple(
            Coefficient(name, float(value), _unit(name), float(u))
            for name, value, u in zip(affine.names, affine.coefficients, uncertainty, strict=True)
        ),
        covariance=tuple(map(tuple, affine.covariance.tolist())),
        dof=affine.dof,
        residual_rms=affine.residual_rms,
        residual_unit="g",
        valid={"temp_case_degc": span},
    )


def _unit(name: str) -> str:
    """Unit of an affine parameter: that of its entry for each power of °C."""
    entry = accel_affine.entry_of(name)
    if entry.kind in ("tilt", "fixture"):
        return "rad"
    base = {"m": "1", "b": "g", "n": "1/g" if len(entry.factors) == 2 else "1/g2"}[entry.kind]
    return (
        base
        if entry.power == 0
        else f"{base}/degC" + ("" if entry.power == 1 else str(entry.power))
    )


def correction(records: Mapping[str, Record], spec: AccelerometerRecipe) -> Correction:
    """Correction that a run's files and recipe name."""
    name = "accel_affine.json" if spec.compensation == "affine" else "accel_k.json"
    if name not in records:
        raise CoefficientError(f"the run holds no {name}", hint="it is not a run of accelerometer")
    models = records[name].models
    span = models[0].valid["temp_case_degc"]
    if spec.compensation == "affine":
        return Correction(None, None, {c.name: c.value for c in models[0].coefficients}, span)
    k = np.array(
        [[records[name].model(f"accel_{axis}").value(n) for n in k_factor.NAMES] for axis in "xyz"]
    )
    if spec.compensation == "k":
        return Correction(k, None, {}, span)
    q = np.array([records["accel_q.json"].model("triad").value(n) for n in q_factor.NAMES])
    return Correction(k, q_factor.exact(q_factor.axes_of(q)), {}, span)


def k_correction(fitted: TriadFit, dwells: DwellSet) -> Correction:
    """Correction by the K-factor of a fit."""
    span = (float(dwells.temperature.min()), float(dwells.temperature.max()))
    return Correction(np.stack([axis.coefficients for axis in fitted.k]), None, {}, span)


def kq_correction(fitted: TriadFit, dwells: DwellSet) -> Correction:
    """Correction by scale and zero of the K-factor, then by the exact Q-factor; the triad's
    mounting stays in the result.
    """
    return replace(k_correction(fitted, dwells), q=q_factor.exact(q_factor.axes_of(fitted.q)))


def affine_correction(affine: Triad, dwells: DwellSet) -> Correction:
    """Correction by the affine triad of a fit."""
    span = (float(dwells.temperature.min()), float(dwells.temperature.max()))
    return Correction(
        None, None, dict(zip(affine.names, affine.coefficients.tolist(), strict=True)), span
    )
