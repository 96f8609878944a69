"""Dwells of a triad → K-factor, Q-factor and affine fits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import affine as accel_affine
from calibkit.instruments.accelerometer.numeric import k_factor, magnitude
from calibkit.instruments.accelerometer.numeric.affine import AffineTerms
from calibkit.instruments.accelerometer.numeric.k_factor import KTerms
from calibkit.instruments.accelerometer.numeric.q_factor import derivative
from calibkit.numeric import attitude

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.numeric.affine import AffineFit
    from calibkit.instruments.accelerometer.numeric.k_factor import KAxis
    from calibkit.instruments.accelerometer.numeric.magnitude import MagnitudeFit
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe, AffineSpec, KSpec


AXES = "xyz"
LEAST_GROUPS = 12
"""Logs below which leaving out one at a time gives no covariance: six sweeps understated it
fivefold in simulation.
"""
Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class Triad:
    """An affine triad by the names of its parameters, for temperatures in °C, with their covariance
    [p, p].
    """

    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    dof: int
    residual_rms: float
    condition: float


@dataclass(frozen=True, slots=True)
class TriadFit:
    """What was fitted to a set of dwells: K of the three axes (or none), the affine triad, Q1, Q2,
    Q3 with covariance.

    `intervals` are 95 % profile intervals of the nine magnitude-only parameters where lmfit was
    asked for, else empty.
    """

    k: tuple[KAxis, ...]
    affine: Triad | None
    q: Array
    q_covariance: Array
    q_temperature: float
    intervals: Mapping[str, tuple[float, float]]
    flags: tuple[str, ...]


def fit(dwells: DwellSet, spec: AccelerometerRecipe) -> TriadFit:
    """Fit what the recipe asks for; raises FitError naming the coefficients that the dwells cannot
    determine.
    """
    if spec.reference.kind == "magnitude":
        return _fit_magnitude(dwells, spec)
    flags = list(dwells.flags)
    axes: tuple[KAxis, ...] = ()
    logs = int(np.unique(dwells.log).size)
    if spec.k.enabled and spec.k.groups == "log" and logs < LEAST_GROUPS:
        raise FitError(
            f"k.groups = 'log' with {logs} logs, expected at least {LEAST_GROUPS}",
            hint=(
                "the covariance of so few groups is not to be trusted: measure more attitudes, or"
                " leave groups at 'none'"
            ),
        )
    if spec.k.enabled:
        k_fit = partial(
            k_factor.fit,
            dwells.indication,
            dwells.temperature,
            dwells.reference,
            terms=k_terms(spec.k),
            weights=dwells.weights,
            groups=dwells.log if spec.k.groups == "log" else None,
        )
        axes = _settled(k_fit, spec.loss, "K-factor", flags)
        flags += [
            f"accel_{axis.axis}: suspect dwell {dwells.place[i]}"
            for axis in axes
            for i in axis.suspects
        ]
    if not spec.affine.enabled:
        return TriadFit(
            axes,
            None,
            np.full(3, np.nan),
            np.zeros((3, 3)),
            np.nan,
            {},
            tuple(dict.fromkeys(flags)),
        )
    affine_fit = partial(
        accel_affine.fit,
        dwells.indication,
        dwells.temperature,
        dwells.reference,
        terms=affine_terms(spec.affine),
        weights=dwells.weights,
        tool_rotation=(
            attitude.tool_rotation(dwells.inclination, dwells.toolface)
            if spec.affine.tilt
            else None
        ),
    )
    affine = _settled(affine_fit, spec.loss, "affine", flags)
    flags += [f"affine: suspect dwell {dwells.place[i]}" for i in affine.suspects]
    return _with_q(axes, affine, dwells, spec, flags, {})


def _settled(fit_with: Callable[..., Found], loss: str, what: str, flags: list[str]) -> Found:
    """A fit with the recipe's loss; where a robust fit cannot settle, the plain one, flagged for
    what it is not.
    """
    try:
        return fit_with(loss=loss)
    except FitError as error:
        if loss == "least_squares":
            raise
        plain = fit_with(
            loss="least_squares"
        )  # raises again where the dwells do not determine the model
        flags.append(
            f"{what}: {error.message}; plain least squares was used, wild dwells are not left out"
        )
        return plain


def _with_q(
    axes: tuple[KAxis, ...],
    affine: AffineFit,
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    flags: list[str],
    intervals: Mapping[str, tuple[float, float]],
) -> TriadFit:
    """Q at the reference temperature, clamped to the dwells' own, as the affine triad has it."""
    at = float(
        np.clip(spec.reference_temp_degc, dwells.temperature.min(), dwells.temperature.max())
    )
    q, q_covariance = accel_affine.as_q(affine, at)
    triad = Triad(
        affine.names,
        affine.coefficients,
        affine.covariance,
        affine.dof,
        affine.residual_rms,
        affine.condition,
    )
    return TriadFit(axes, triad, q, q_covariance, at, intervals, tuple(dict.fromkeys(flags)))


def _fit_magnitude(dwells: DwellSet, spec: AccelerometerRecipe) -> TriadFit:
    """Scale factor, bias and Q from the length of gravity alone; over temperature where affine is
    enabled.
    """
    noise = None if dwells.weights is None else np.sqrt(np.mean(dwells.noise**2, axis=1))
    flags = list(dwells.flags)
    intervals: Mapping[str, tuple[float, float]] = {}
    if spec.reference.solver == "lmfit":
        found, intervals = magnitude.fit_bounded(dwells.indication, 1.0, noise=noise)
        open_ended = [name for name, ends in intervals.items() if not np.isfinite(ends).all()]
        flags += [
            f"magnitude: the 95 % interval of {name} has no end within its bounds"
            for name in open_ended
        ]
        flags.append("magnitude: lmfit solves by plain least squares, wild dwells are not left out")
    else:
        found = _settled(
            partial(magnitude.fit, dwells.indication, 1.0, noise=noise),
            spec.loss,
            "magnitude",
            flags,
        )
    flags += [f"magnitude: {flag}" for flag in found.flags]
    flags += [f"magnitude: suspect dwell {dwells.place[i]}" for i in found.suspects]
    if not spec.affine.enabled:
        at = float(dwells.temperature.mean())
        q, q_covariance = found.parameters[6:9], found.covariance[6:9, 6:9]
        return TriadFit(
            (), _nine(found), q, q_covariance, at, intervals, tuple(dict.fromkeys(flags))
        )
    affine_fit = partial(
        accel_affine.fit_magnitude,
        dwells.indication,
        dwells.temperature,
        1.0,
        terms=affine_terms(spec.affine),
        weights=None if noise is None else 1.0 / noise**2,
    )
    affine = _settled(affine_fit, spec.loss, "affine", flags)
    flags += [f"affine: suspect dwell {dwells.place[i]}" for i in affine.suspects]
    return _with_q((), affine, dwells, spec, flags, intervals)


def _nine(found: MagnitudeFit) -> Triad:
    """The nine parameters of a magnitude-only fit as an affine triad without temperature."""

    def entries(parameters: Array) -> Array:
        matrix = magnitude.correction_matrix(parameters)
        return np.concatenate([matrix[np.tril_indices(3)], parameters[3:6]])

    slopes = derivative(entries, found.parameters, scale=np.maximum(np.abs(found.parameters), 1e-3))
    names = [f"m_{AXES[i]}{AXES[j]}0" for i, j in zip(*np.tril_indices(3), strict=True)]
    return Triad(
        (*names, *(f"b_{axis}0" for axis in AXES)),
        entries(found.parameters),
        slopes @ found.covariance @ slopes.T,
        found.dof,
        found.residual_rms,
        found.condition,
    )


def k_terms(spec: KSpec) -> tuple[KTerms, KTerms, KTerms]:
    """Orders of the three axes."""
    parts = [getattr(spec, axis) or spec for axis in AXES]
    x, y, z = (KTerms(part.scale_order, part.zero_order, part.cross) for part in parts)
    return x, y, z


def affine_terms(spec: AffineSpec) -> AffineTerms:
    """Parameters of the affine triad."""
    return AffineTerms(
        scale_order=spec.scale_order,
        cross_order=spec.cross_order,
        bias_order=spec.bias_order,
        second_order=spec.second_order,
        third_order=spec.third_order,
        tilt=spec.tilt,
        fixture=spec.fixture,
    )
