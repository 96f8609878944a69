"""Dwells of a triad → models of its K-factor, Q-factor and affine triad."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Component, Figure, Model, Parameter
from calibkit.errors import FitError
from calibkit.forms import Form
from calibkit.instruments.accelerometer import forms, robust_choice
from calibkit.instruments.accelerometer.circumstances import SHARED_UNITS, refine_with
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.numeric import (
    affine,
    k_factor,
    k_together,
    magnitude,
    magnitude_together,
    q_factor,
)
from calibkit.instruments.accelerometer.numeric.affine_model import AffineTerms
from calibkit.instruments.accelerometer.numeric.affine_solve import AffineFit
from calibkit.instruments.accelerometer.numeric.dwell_fit import DwellFit
from calibkit.instruments.accelerometer.numeric.shared_errors import Unexplained
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.recipe.shared_errors import list_components, warn_of_few_groups

LEAST_GROUPS = 12
"""Fewest logs for a leave-one-log-out covariance: with six sweeps it was five times too small in
simulation.
"""


@dataclass(frozen=True, slots=True)
class TriadFit:
    """Models fitted to a set of dwells, with their flags."""

    k: tuple[Model, ...] = ()
    """K models of the three axes; empty where the recipe does not enable K."""
    k_flags: tuple[str, ...] = ()
    k_not_fitted: tuple[str, ...] = ()
    """Coefficients fixed at zero by the recipe's orders, one text per axis."""
    q: Model | None = None
    affine: Model | None = None
    affine_flags: tuple[str, ...] = ()
    """Flags of the Q-factor and the affine triad."""
    intervals: tuple[Figure, ...] = ()
    """Ends of the 95 % profile intervals of the nine magnitude-only parameters; empty unless the
    solver is lmfit.
    """
    left_out: frozenset[int] = frozenset()
    """Suspect dwells that a fit left out."""
    lack_of_fit: tuple[Unexplained, ...] = ()
    """Residuals of the exported models that differ from group to group."""


def fit_triad(
    dwells: DwellSet, spec: AccelerometerRecipe, held: TriadFit | None = None
) -> TriadFit:
    """Fit the models that the recipe enables; raises FitError naming the coefficients that the
    dwells do not determine. The errors that dwells share keep the sizes of the fit `held`.
    """
    if spec.reference.kind == "magnitude":
        return _fit_lengths(dwells, spec, held)
    of_axes = _fit_k(dwells, spec, held) if spec.k.enabled else TriadFit()
    if not spec.affine.enabled:
        return of_axes
    rotation = _tool_rotation(dwells.inclination, dwells.toolface) if spec.affine.tilt else None
    affine_fit = partial(
        affine.fit,
        dwells.indication,
        dwells.temperature,
        dwells.reference,
        terms=_affine_terms(spec),
        weights=dwells.weights,
        tool_rotation=rotation,
        refine=refine_with(dwells, spec, affine=True, held=_sizes(held.affine if held else None)),
    )
    off = dwells.indication - dwells.reference
    found, flags = robust_choice.choose(affine_fit, spec.loss, ["affine"], off)
    flags += (*found.flags, *warn_of_few_groups(found.components, _taken(spec.affine.bias_order)))
    model, q = _affine_models(found, dwells, spec)
    flags += (*_name_suspects("affine", found, dwells), *_name_common("affine", found, dwells))
    left_out = of_axes.left_out.union(found.left_out)
    lack = of_axes.lack_of_fit if spec.compensation == "k" else found.lack_of_fit
    return replace(
        of_axes, q=q, affine=model, affine_flags=flags, left_out=left_out, lack_of_fit=lack
    )


def _sizes(model: Model | None) -> tuple[Component, ...] | None:
    """Errors that dwells share in a fit before, None where there was none."""
    return None if model is None else model.components


def _fit_k(dwells: DwellSet, spec: AccelerometerRecipe, held: TriadFit | None = None) -> TriadFit:
    """K-factor of the three axes, its flags, and the coefficients that are not fitted."""
    by_log, logs = spec.k.groups == "log", np.unique(dwells.log).size
    if by_log and logs < LEAST_GROUPS:
        raise FitError(
            f"k.groups = 'log' with {logs} logs, expected at least {LEAST_GROUPS}",
            hint=(
                "the covariance of so few groups is not to be trusted: measure more attitudes, or"
                " leave groups at 'none'"
            ),
        )
    k_fit = partial(
        k_together.fit,
        dwells.indication,
        dwells.temperature,
        dwells.reference,
        terms=[k_factor.KTerms(a.scale_order, a.zero_order, a.cross) for a in spec.k.axes],
        weights=dwells.weights,
        groups=dwells.log if by_log else None,
        refine=refine_with(dwells, spec, held=_sizes(held.k[0] if held else None)),
    )
    off = dwells.indication - dwells.reference
    axes, flags = robust_choice.choose(k_fit, spec.loss, forms.K_MODELS, off)
    most = max(axis.zero_order for axis in spec.k.axes)
    flags += (*axes[0].flags, *warn_of_few_groups(axes[0].components, _taken(most)))
    for name, axis in zip(forms.K_MODELS, axes, strict=True):
        flags += _name_suspects(name, axis, dwells)
        flags += _name_common(name, axis, dwells)
    not_fitted = [
        f"{name}: {', '.join(missing)} not fitted, taken as 0"
        for name, axis in zip(forms.K_MODELS, axes, strict=True)
        if (missing := [k for n, k in enumerate(k_factor.NAMES) if n not in axis.fitted])
    ]
    left_out = frozenset(dwell for axis in axes for dwell in axis.left_out)
    models = tuple(map(partial(_k_model, dwells), forms.K_MODELS, axes))
    # the axes are fitted together
    lack = axes[0].lack_of_fit
    return TriadFit(models, flags, tuple(not_fitted), left_out=left_out, lack_of_fit=lack)


def _k_model(dwells: DwellSet, name: str, axis: k_factor.KAxis) -> Model:
    """K model of an axis, with its coefficients in scaled temperature."""
    scaled = zip(k_factor.NAMES, axis.mapped_coefficients.tolist(), strict=True)
    mapping = (
        Parameter("middle", axis.middle, "degC"),
        Parameter("half", axis.half, "degC"),
        *(Parameter(f"scaled_{k}", value, "1") for k, value in scaled),
    )
    named = k_factor.NAMES, axis.coefficients, forms.K_UNITS
    return _model(forms.K, name, named, axis.covariance, axis, dwells, mapping, axis.effective_dof)


def _fit_lengths(
    dwells: DwellSet, spec: AccelerometerRecipe, held: TriadFit | None = None
) -> TriadFit:
    """Fit scale factors, biases and Q to the magnitude of gravity alone; over temperature where
    affine is enabled.
    """
    noise = None if dwells.weights is None else np.sqrt(np.mean(dwells.noise**2, axis=1))
    off = np.linalg.norm(dwells.indication, axis=1) - 1.0
    sizes = _sizes(held.affine if held else None)
    found, intervals, flags = _fit_constant(dwells, spec, noise, off, sizes)
    flags += tuple(f"magnitude: {flag}" for flag in found.flags)
    over_temperature: AffineFit | None = None
    if spec.affine.enabled:
        affine_fit = partial(
            affine.fit_magnitude,
            dwells.indication,
            dwells.temperature,
            1.0,
            terms=_affine_terms(spec),
            weights=None if noise is None else 1.0 / noise**2,
            refine=refine_with(dwells, spec, affine=True, held=sizes),
        )
        over_temperature, more = robust_choice.choose(affine_fit, spec.loss, ["affine"], off)
        model, q = _affine_models(over_temperature, dwells, spec)
        flags += (*more, *over_temperature.flags)
        taken = _taken(spec.affine.bias_order)
        flags += warn_of_few_groups(over_temperature.components, taken)
        flags += _name_suspects("affine", over_temperature, dwells)
        flags += _name_common("affine", over_temperature, dwells)
    else:
        model, q = _constant_models(found, dwells)
        flags += _name_suspects("magnitude", found, dwells)
    return TriadFit(
        q=q,
        affine=model,
        affine_flags=flags,
        intervals=intervals,
        left_out=frozenset((over_temperature or found).left_out),
        lack_of_fit=(over_temperature or found).lack_of_fit,
    )


def _fit_constant(
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    noise: Array | None,
    off: Array,
    held: tuple[Component, ...] | None = None,
) -> tuple[magnitude.MagnitudeFit, tuple[Figure, ...], tuple[str, ...]]:
    """Magnitude-only fit that knows no temperature, the ends of its 95 % intervals by lmfit, and
    its flags; `off` are the lengths [n] less 1 g.
    """
    if spec.reference.solver == "lmfit":
        return _fit_bounded(dwells, noise)
    length_fit = partial(
        magnitude_together.fit,
        dwells.indication,
        1.0,
        noise=noise,
        # over temperature the affine fit stands in the files
        refine=None if spec.affine.enabled else refine_with(dwells, spec, held=held),
    )
    found, flags = robust_choice.choose(length_fit, spec.loss, ["magnitude"], off)
    return found, (), (*flags, *warn_of_few_groups(found.components, _taken(0)))


def _taken(order: int) -> dict[tuple[str, str], int]:
    """Coefficients that a zero of an order over temperature takes from the soaks of each axis."""
    return {("soak", "zero"): order + 1}


def _fit_bounded(
    dwells: DwellSet, noise: Array | None
) -> tuple[magnitude.MagnitudeFit, tuple[Figure, ...], tuple[str, ...]]:
    """Magnitude-only fit by lmfit, the ends of its 95 % intervals, and its flags."""
    found, intervals = magnitude.fit_bounded(dwells.indication, 1.0, noise=noise)
    units = dict(zip(magnitude.NAMES, ("1",) * 3 + ("g",) * 3 + ("rad",) * 3, strict=True))
    figures = tuple(
        Figure(f"{name}_{side}_95", end, units[name], 0.0)
        for name, interval in intervals.items()
        for side, end in zip(("low", "high"), interval, strict=True)
        if np.isfinite(end)
    )
    flags = [
        f"magnitude: the 95 % interval of {name} has no end within its bounds"
        for name, interval in intervals.items()
        if not np.isfinite(interval).all()
    ]
    plain = "magnitude: lmfit solves by plain least squares, outliers are not left out"
    return found, figures, (*flags, plain)


def _name_suspects(what: str, found: DwellFit, dwells: DwellSet) -> tuple[str, ...]:
    """Flags that name the dwells which were found to be outliers, and whether they were left out,
    and one that counts what was left out beside them.
    """
    residuals = found.residuals.reshape(len(dwells.place), -1)
    flags = tuple(
        f"{what}: suspect dwell {dwells.place[k]}, {np.abs(residuals[k]).max():.3g} g off,"
        f" {'left out' if k in found.left_out else 'kept with little weight'}"
        for k in found.suspects
    )
    others = sorted(set(found.left_out) - set(found.suspects))
    if others:
        first = dwells.place[others[0]]
        why = "the tail of all residuals is as long"
        flags += (f"{what}: left out beside the suspects: {len(others)}, first {first}; {why}",)
    return flags


def _name_common(what: str, found: DwellFit, dwells: DwellSet) -> tuple[str, ...]:
    """Flags on dwells that stand apart together, one for attitudes and one for temperatures."""
    flags = []
    for common in dict.fromkeys(error.common for error in found.common_errors):
        errors = [error for error in found.common_errors if error.common == common]
        worst = max(errors, key=lambda error: abs(error.size))
        first, count = worst.dwells[0], len({error.dwells for error in errors})
        where = (
            f"{dwells.temperature[list(worst.dwells)].mean():.3g} °C"
            if common == "temperature"
            else f"inclination {dwells.inclination[first]:.6g}°,"
            f" toolface {dwells.toolface[first]:.6g}°"
        )
        along = "" if found.residuals.ndim == 1 else f" along {'xyz'[worst.component]}"
        flags.append(
            f"{what}: dwells of one {common} are off together, by more than their scatter, at"
            f" {count} {common}s; most at {where}: {len(worst.dwells)} dwells by"
            f" {1e6 * worst.size:+.3g} µg{along}. An error of the {common}, not outliers: they are"
            " kept in the fit"
        )
    return tuple(flags)


def _affine_terms(spec: AccelerometerRecipe) -> AffineTerms:
    """Parameters of the affine triad that the recipe enables."""
    return AffineTerms(**spec.affine.model_dump(exclude={"enabled"}))


def _affine_models(
    found: AffineFit, dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[Model, Model]:
    """Affine model, and Q model at the reference temperature, or at the dwell temperature nearest
    to it.
    """
    low, high = dwells.valid[forms.TEMPERATURE]
    at = float(np.clip(spec.reference_temp_degc, low, high))
    named = found.names, found.coefficients, found.covariance, found.effective_dof
    angles = (*found.evaluate_q(at), found.q_dof(at))
    return _triad_models(*named, found, angles, at, dwells)


def _constant_models(found: magnitude.MagnitudeFit, dwells: DwellSet) -> tuple[Model, Model]:
    """Affine and Q model of a fit that knows no temperature, at the mean of the dwells."""
    own = None if found.effective_dof is None else found.effective_dof[6:9]
    angles = found.parameters[6:9], found.covariance[6:9, 6:9], own
    affine_dof = None if found.mixed is None else found.mixed.effective_dof
    at = float(dwells.temperature.mean())
    return _triad_models(*found.as_affine(), affine_dof, found, angles, at, dwells)


def _triad_models(
    names: Sequence[str],
    values: Array,
    covariance: Array,
    effective_dof: Array | None,
    found: DwellFit,
    angles: tuple[Array, Array, Array | None],
    temperature: float,
    dwells: DwellSet,
) -> tuple[Model, Model]:
    """Model of affine parameters in powers of °C, and model of Q1, Q2, Q3 [3, rad] with their
    covariance [3, 3] and degrees of freedom at a temperature [°C]; both hold the residual of the
    fit.
    """
    named = names, values, [forms.affine_unit(name) for name in names]
    small = q_factor.NAMES, angles[0], ("rad",) * 3
    at = (Parameter("temperature", temperature, "degC"),)
    return (
        _model(forms.AFFINE, "triad", named, covariance, found, dwells, (), effective_dof),
        _model(forms.Q, "triad", small, angles[1], found, dwells, at, angles[2]),
    )


def _model(
    form: Form,
    name: str,
    coefficients: tuple[Sequence[str], Array, Sequence[str]],
    covariance: Array,
    found: DwellFit,
    dwells: DwellSet,
    parameters: tuple[Parameter, ...] = (),
    effective_dof: Array | None = None,
) -> Model:
    """Model of a form from the names, values and units of its coefficients, the residual of the fit
    and the temperature range of the dwells.
    """
    names, values, units = coefficients
    return form.write(
        name,
        list(zip(names, values.tolist(), units, strict=True)),
        covariance,
        dof=found.dof,
        residual_rms=found.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=parameters,
        effective_dof=effective_dof,
        components=list_components(found.components, SHARED_UNITS),
    )


def _tool_rotation(inclination_deg: Array, toolface_deg: Array) -> Array:
    """Passive rotations R_z(φ) R_y(θ) [n, 3, 3] from the table's base to the tool; their last
    column is the gravity vector [g].
    """
    theta, phi = np.radians(inclination_deg), np.radians(toolface_deg)
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    rows = ((ct * cp, sp, -st * cp), (-ct * sp, cp, st * sp), (st, np.zeros_like(st), ct))
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
