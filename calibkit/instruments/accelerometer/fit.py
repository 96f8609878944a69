"""Dwells of a triad → models of its K-factor, Q-factor and of the triad over temperature."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure, Model, Parameter
from calibkit.forms import components_of
from calibkit.instruments.accelerometer import forms, published, robust_choice
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Terms
from calibkit.instruments.accelerometer.numeric import k_factor, magnitude, q_factor
from calibkit.instruments.accelerometer.numeric.k_factor import KTerms
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import ZERO, Unexplained
from calibkit.instruments.accelerometer.triad import Triad, determines, solve_triad
from calibkit.recipe.shared_errors import warn_of_few_levels


@dataclass(frozen=True, slots=True)
class TriadFit:
    """Models fitted to a set of dwells, with their flags."""

    k: tuple[Model, ...]
    """K models of the three axes; empty where the recipe does not enable K."""
    k_not_fitted: tuple[str, ...]
    """Coefficients fixed at zero by the recipe's orders, one text per axis."""
    q: Model | None
    affine: Model | None
    """The triad over temperature."""
    flags: tuple[str, ...]
    intervals: tuple[Figure, ...]
    """Ends of the 95 % profile intervals of the nine magnitude-only parameters; empty unless the
    solver is lmfit.
    """
    left_out: frozenset[int]
    """Dwells that the fit left out."""
    lack_of_fit: tuple[Unexplained, ...]
    """Residuals that differ from group to group."""
    triad: Triad


def fit_triad(dwells: DwellSet, spec: AccelerometerRecipe) -> TriadFit:
    """Fit the models that the recipe enables; raises FitError naming the coefficients that the
    dwells do not determine.
    """
    lengths = spec.reference.kind == "magnitude"
    bounded = lengths and spec.reference.solver == "lmfit"
    if spec.k.enabled and not lengths:
        k_factor.require_determined(dwells.reference, dwells.temperature, k_terms(spec))
    terms, flags = choose_terms(dwells, spec)
    if lengths:
        uncorrected: Array = np.linalg.norm(dwells.indication, axis=1) - 1.0
    else:
        uncorrected = dwells.indication - dwells.reference
    fit_with = partial(solve_triad, dwells, terms, spec)
    loss = "least_squares" if bounded else spec.loss
    triad, doubts = robust_choice.choose(fit_with, loss, uncorrected)
    flags += (*doubts, *triad.flags)
    taken = {ZERO: 1 + max(term.power for term in terms.listed if term.kind == "z")}
    flags += warn_of_few_levels(triad.fit.shared, taken)
    flags += (*_name_suspects(triad, dwells), *_name_common(triad, dwells))
    if lengths:
        flags += _warn_of_lengths(triad, dwells, _reference_temperature(dwells, spec))
    intervals: tuple[Figure, ...] = ()
    if bounded:
        intervals, doubts = _profile_intervals(dwells)
        flags += doubts
    return TriadFit(
        *list_models(dwells, spec, triad),
        flags,
        intervals,
        frozenset(triad.suspects),
        triad.lack_of_fit,
        triad,
    )


def list_models(
    dwells: DwellSet, spec: AccelerometerRecipe, triad: Triad
) -> tuple[tuple[Model, ...], tuple[str, ...], Model | None, Model | None]:
    """K models and what they lack, the model of Q and that of the triad, as the recipe enables
    them.
    """
    lengths = spec.reference.kind == "magnitude"
    k: tuple[Model, ...] = ()
    not_fitted: tuple[str, ...] = ()
    if not lengths and spec.k.enabled:
        chosen = k_terms(spec)
        named = zip(forms.K_MODELS, published.fit_k(dwells, chosen, triad), strict=True)
        k = tuple(_k_model(dwells, triad, name, axis) for name, axis in named)
        not_fitted = _list_not_fitted(chosen)
    if not (lengths or spec.affine.enabled):
        return k, not_fitted, None, None
    q = _q_model(dwells, triad, _reference_temperature(dwells, spec))
    return k, not_fitted, q, _triad_model(dwells, triad)


def choose_terms(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Terms, tuple[str, ...]]:
    """Terms of the equation that the recipe asks for, and a flag where the dwells do not show how
    cross-axis terms change with temperature.
    """
    terms = asked_terms(spec)
    if spec.reference.kind == "magnitude" or not terms.cross_changes or determines(dwells, terms):
        return terms, ()
    constant = terms.with_constant_cross()
    flag = "cross-axis terms are constant over temperature: these dwells do not show their change"
    return (constant, (flag,)) if determines(dwells, constant) else (terms, ())


def asked_terms(spec: AccelerometerRecipe) -> Terms:
    """Terms of the equation that a recipe asks for."""
    triad, lengths = spec.affine, spec.reference.kind == "magnitude"
    scale = zero = cross = (0, 0, 0)
    if triad.enabled:
        scale, zero = (triad.scale_order,) * 3, (triad.bias_order,) * 3
        cross = (min(triad.cross_order, 1),) * 3
    elif not lengths:
        x, y, z = spec.k.axes
        scale = x.scale_order, y.scale_order, z.scale_order
        zero = x.zero_order, y.zero_order, z.zero_order
        cross = 2 * x.cross - 1, 2 * y.cross - 1, 2 * z.cross - 1
    return Terms.of_orders(
        *(scale, zero, cross),
        triangular=lengths or (triad.enabled and triad.fixture),
        second_order=triad.enabled and triad.second_order,
        third_order=triad.enabled and triad.third_order,
        tilt=triad.enabled and triad.tilt,
        fixture=triad.enabled and triad.fixture,
    )


def k_terms(spec: AccelerometerRecipe) -> tuple[KTerms, ...]:
    """Coefficients K of the three axes that the recipe asks for."""
    return tuple(KTerms(a.scale_order, a.zero_order, a.cross) for a in spec.k.axes)


def _reference_temperature(dwells: DwellSet, spec: AccelerometerRecipe) -> float:
    """Temperature [°C] at which Q is stated: that of the recipe or the dwell's nearest to it; the
    mean of the dwells where the triad knows none.
    """
    if not spec.affine.enabled:
        return float(dwells.temperature.mean())
    return float(np.clip(spec.reference_temp_degc, *dwells.valid[forms.TEMPERATURE]))


def _triad_model(dwells: DwellSet, triad: Triad) -> Model:
    """Model of the triad in powers of °C."""
    values, covariance, dof = triad.in_degrees()
    named = [(term.name, term.unit) for term in triad.terms.listed]
    axes = AXES if len(triad.noise) == 3 else ("length",)
    noise = tuple(
        Parameter(f"noise_{axis}", float(size), "g")
        for axis, size in zip(axes, triad.noise, strict=True)
    )
    return forms.TRIAD.write(
        "triad",
        [(name, float(v), unit) for (name, unit), v in zip(named, values, strict=True)],
        covariance,
        dof=triad.fit.dof,
        residual_rms=triad.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=noise,
        effective_dof=dof,
        components=components_of(triad.fit.shared),
    )


def _q_model(dwells: DwellSet, triad: Triad, temperature: float) -> Model:
    """Q1, Q2, Q3 of the fitted axes at a temperature [°C]."""
    t, p = float(triad.mapped(temperature)), triad.fit.parameters
    matrix = np.eye(3)
    scale = np.zeros(3)
    for value, term in zip(p, triad.terms.listed, strict=True):
        if term.kind == "c":
            matrix[term.axis, term.factors[0]] -= value * t**term.power
        elif term.kind == "k":
            scale[term.axis] += value * t**term.power
    # refuses a left-handed triad and axes in one plane
    q_factor.axes_from_sensitivity(np.asarray(np.linalg.inv(matrix * scale), dtype=np.float64))
    return forms.Q.write_fit(
        "triad",
        triad.fit.restated(lambda q: triad.terms.small_angles(q, t)),
        [(name, "rad") for name in q_factor.NAMES],
        residual_rms=triad.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=(Parameter("temperature", temperature, "degC"),),
    )


def _k_model(dwells: DwellSet, triad: Triad, name: str, axis: published.KAxis) -> Model:
    """K model of an axis, with its coefficients in scaled temperature."""
    mapping = [("middle", triad.middle, "degC"), ("half", triad.half, "degC")]
    scaled = zip(k_factor.NAMES, axis.mapped.tolist(), strict=True)
    mapping += [(f"scaled_{k}", value, "1") for k, value in scaled]
    mapping.append(("lack_of_fit", axis.lack_of_fit, "g"))
    return forms.K.write(
        name,
        list(zip(k_factor.NAMES, axis.coefficients.tolist(), forms.K_UNITS, strict=True)),
        axis.covariance,
        dof=triad.fit.dof,
        residual_rms=axis.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=tuple(Parameter(*entry) for entry in mapping),
        effective_dof=axis.dof,
        components=components_of(triad.fit.shared),
    )


def _list_not_fitted(chosen: Sequence[KTerms]) -> tuple[str, ...]:
    """Coefficients fixed at zero, one text per axis."""
    texts = []
    for name, terms in zip(forms.K_MODELS, chosen, strict=True):
        missing = [k for n, k in enumerate(k_factor.NAMES) if n not in terms.fitted]
        if missing:
            texts.append(f"{name}: {', '.join(missing)} not fitted, taken as 0")
    return tuple(texts)


def _profile_intervals(dwells: DwellSet) -> tuple[tuple[Figure, ...], tuple[str, ...]]:
    """Ends of the 95 % profile intervals of lengths by lmfit, and flags."""
    noise = None if dwells.weights is None else np.sqrt(np.mean(dwells.noise**2, axis=1))
    intervals = magnitude.profile_intervals(dwells.indication, 1.0, noise=noise)
    units = dict(zip(magnitude.NAMES, ("1",) * 3 + ("g",) * 3 + ("rad",) * 3, strict=True))
    figures = tuple(
        Figure(f"{name}_{side}_95", end, units[name], 0.0)
        for name, interval in intervals.items()
        for side, end in zip(("low", "high"), interval, strict=True)
        if np.isfinite(end)
    )
    open_ends = tuple(
        f"magnitude: the 95 % interval of {name} has no end within its bounds"
        for name, interval in intervals.items()
        if not np.isfinite(interval).all()
    )
    plain = "magnitude: lmfit solves by plain least squares, outliers are not left out"
    return figures, (*open_ends, plain)


POOR_Q, POOR_SHARE = np.radians(0.25), 5e-3
"""95 % half-widths that are flagged as too wide: of a Q [rad]; of a relative scale factor, or of a
zero relative to gravity.
"""
ILL_CONDITIONED = 20.0
"""Condition number above which the attitudes determine some combination of parameters poorly; the
six-position tumble has 1.7.
"""
FEW_DOF = 5
"""Degrees of freedom below which the residuals are too few to judge the uncertainty."""


def _attitude_condition(triad: Triad, dwells: DwellSet) -> float:
    """Condition number of scale factors, zeros and angles as lengths at the attitudes see them;
    that of the fit's own columns has the prior of the angles, and depends on the size of the zeros.
    """
    t = triad.mapped(dwells.temperature)
    down = triad.terms.corrected(triad.fit.parameters, dwells.indication, t)
    design = np.column_stack([down**2, down, down * np.roll(down, 1, axis=1)])
    return float(np.linalg.cond(design / np.linalg.norm(design, axis=0)))


def _warn_of_lengths(triad: Triad, dwells: DwellSet, temperature: float) -> tuple[str, ...]:
    """Flags for poorly determined parameters, poorly spread attitudes and unchecked dwells."""
    t, fit, listed = float(triad.mapped(temperature)), triad.fit, triad.terms.listed

    def results(p: Array) -> Array:
        scale_and_zero = np.zeros(6, dtype=p.dtype)
        for value, term in zip(p, listed, strict=True):
            if term.kind in "kz":
                scale_and_zero["kz".index(term.kind) * 3 + term.axis] += value * t**term.power
        return np.concatenate([scale_and_zero, triad.terms.small_angles(p, t)])

    width = fit.of(results).expanded
    flags: list[str] = []
    if fit.dof < FEW_DOF:
        flags.append(
            f"{len(triad.residuals)} dwells for {len(listed)} parameters leave {fit.dof} degrees"
            " of freedom: the residuals cannot vouch for these numbers"
        )
    condition = _attitude_condition(triad, dwells)
    if condition > ILL_CONDITIONED:
        flags.append(
            f"ill-conditioned: condition number {condition:.3g}, six faces have 1.7; add other"
            " attitudes"
        )
    flags += [
        f"{name} is known to ±{np.degrees(w):.2g}° only (95 %)"
        for name, w in zip(q_factor.NAMES, width[6:], strict=True)
        if w > POOR_Q
    ]
    names = [f"{kind}_{axis}" for kind in "kz" for axis in AXES]
    flags += [
        f"{name} is known to ±{100.0 * w:.2g} % of {'itself' if name[0] == 'k' else 'gravity'}"
        " only (95 %)"
        for name, w in zip(names, width[:6], strict=True)
        if w > POOR_SHARE
    ]
    alone = np.flatnonzero(triad.leverage > 0.99)
    if alone.size:
        flags.append(
            f"no other dwell checks dwell {', '.join(str(i) for i in alone)} (leverage above 0.99)"
        )
    return tuple(f"magnitude: {flag}" for flag in flags)


def _name_suspects(triad: Triad, dwells: DwellSet) -> tuple[str, ...]:
    """Flags that name the dwells which were left out as outliers."""
    return tuple(
        f"triad: suspect dwell {dwells.place[k]}, {np.abs(triad.residuals[k]).max():.3g} g off,"
        " left out"
        for k in triad.suspects
    )


def _name_common(triad: Triad, dwells: DwellSet) -> tuple[str, ...]:
    """Flags on dwells that stand apart together, one for attitudes and one for temperatures."""
    flags = []
    for common in dict.fromkeys(error.common for error in triad.common_errors):
        errors = [error for error in triad.common_errors if error.common == common]
        worst = max(errors, key=lambda error: abs(error.size))
        first, count = worst.dwells[0], len({error.dwells for error in errors})
        where = (
            f"{dwells.temperature[list(worst.dwells)].mean():.3g} °C"
            if common == "temperature"
            else f"inclination {dwells.inclination[first]:.6g}°,"
            f" toolface {dwells.toolface[first]:.6g}°"
        )
        along = "" if triad.residuals.shape[1] == 1 else f" along {AXES[worst.component]}"
        flags.append(
            f"triad: dwells of one {common} are off together, by more than their scatter, at"
            f" {count} {common}s; most at {where}: {len(worst.dwells)} dwells by"
            f" {1e6 * worst.size:+.3g} µg{along}. An error of the {common}, not outliers: they are"
            " kept in the fit"
        )
    return tuple(flags)
