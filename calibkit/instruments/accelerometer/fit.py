"""Dwells of a triad → models of its K-factor, Q-factor and of the triad over temperature."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure, Model, Parameter
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.forms import components_of
from calibkit.instruments.accelerometer import forms, published
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Terms
from calibkit.instruments.accelerometer.numeric import k_factor, magnitude, q_factor
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import ZERO
from calibkit.instruments.accelerometer.triad import (
    Triad,
    require_terms,
    residual_of,
    solve_triad,
)
from calibkit.numeric.least_squares import polynomial
from calibkit.recipe.shared_errors import warn_of_few_levels

WORSE = 1.1
"""Ratio of median absolute residuals above which one fit is worse than the other: on clean data the
two differ by chance.
"""
WORSE_THAN_NONE = 1.3
"""Ratio of the median absolute residual of least squares to that of no correction above which no
fit is exported: a triad that needs no correction differs by less, by chance.
"""
ROUNDING_G = 1e-9
"""Difference of median absolute residuals [g] that is rounding."""
POOR_Q, POOR_SHARE = np.radians(0.25), 5e-3
"""95 % half-widths that are flagged as too wide: of a Q [rad]; of a relative scale factor, or of a
zero relative to gravity.
"""
ILL_CONDITIONED = 20.0
"""Condition number above which the attitudes determine some combination of parameters poorly; the
six-position tumble has 1.7.
"""
OUTSTANDING = 6.0
"""Error of an attitude or a soak, over the median of all, above which it is flagged; the largest of
50 normal ones is 3 times the median.
"""
FEW_DOF = 5
"""Degrees of freedom below which the residuals are too few to judge the uncertainty."""


@dataclass(frozen=True, slots=True)
class TriadFit:
    """Models fitted to a set of dwells, with their flags."""

    triad: Triad
    k: tuple[Model, ...]
    """K models of the three axes; empty where the recipe does not enable K."""
    k_not_fitted: tuple[str, ...]
    """Coefficients fixed at zero by the recipe's orders, one text per axis."""
    q: Model | None
    affine: Model | None
    """The triad over temperature."""
    intervals: tuple[Figure, ...]
    """Ends of the 95 % profile intervals of the nine magnitude-only parameters; empty unless the
    solver is lmfit.
    """
    flags: tuple[str, ...]


def fit_triad(dwells: DwellSet, spec: AccelerometerRecipe) -> TriadFit:
    """Fit the models that the recipe enables; raises FitError naming the coefficients that the
    dwells do not determine.
    """
    lengths = spec.reference.kind == "magnitude"
    by_lmfit = lengths and spec.reference.solver == "lmfit"
    if spec.k.enabled and not lengths:
        published.require_k(spec.k.axes, dwells.reference, dwells.temperature)
    terms, flags = choose_terms(dwells, spec)
    if lengths:
        uncorrected: Array = np.linalg.norm(dwells.indication, axis=1) - 1.0
    else:
        uncorrected = dwells.indication - dwells.reference
    triad, doubts = choose_loss(
        partial(solve_triad, dwells, terms, spec),
        "least_squares" if by_lmfit else spec.loss,
        uncorrected,
    )
    flags += (*doubts, *triad.flags)
    zeros_of_soaks = {ZERO: 1 + max(term.power for term in terms.listed if term.kind == "z")}
    flags += warn_of_few_levels(triad.fit.shared, zeros_of_soaks)
    flags += tuple(
        f"triad: suspect dwell {dwells.place[k]}, {np.abs(triad.residuals[k]).max():.3g} g off,"
        " left out"
        for k in triad.suspects
    )
    flags += _flag_outstanding_levels(triad, dwells)
    k, k_not_fitted, q, affine = list_models(dwells, spec, triad)
    intervals: tuple[Figure, ...] = ()
    if lengths:
        flags += _warn_of_lengths(triad, dwells, _reference_temperature(dwells, spec))
    if by_lmfit:
        intervals, doubts = _profile_intervals(dwells)
        flags += doubts
    return TriadFit(triad, k, k_not_fitted, q, affine, intervals, flags)


def list_models(
    dwells: DwellSet, spec: AccelerometerRecipe, triad: Triad
) -> tuple[tuple[Model, ...], tuple[str, ...], Model | None, Model | None]:
    """K models and what they lack, the model of Q and that of the triad, as the recipe enables
    them.
    """
    lengths = spec.reference.kind == "magnitude"
    k: tuple[Model, ...] = ()
    not_fitted: list[str] = []
    if not lengths and spec.k.enabled:
        chosen = spec.k.axes
        k = published.fit_k(dwells, chosen, triad)
        for name, part in zip(forms.K_MODELS, chosen, strict=True):
            missing = [K for n, K in enumerate(k_factor.NAMES) if n not in part.fitted]
            if missing:
                not_fitted.append(f"{name}: {', '.join(missing)} not fitted, taken as 0")
    if not (lengths or spec.affine.enabled):
        return k, tuple(not_fitted), None, None
    q = published.fit_q(dwells, triad, _reference_temperature(dwells, spec))
    return k, tuple(not_fitted), q, _triad_model(dwells, triad)


def choose_terms(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Terms, tuple[str, ...]]:
    """Terms of the equation that the recipe asks for, and a flag where the dwells do not show how
    cross-axis terms change with temperature. Raises FitError for other terms that the dwells do
    not determine.
    """
    terms = asked_terms(spec)
    if spec.reference.kind == "magnitude":
        return terms, ()
    try:
        require_terms(terms, dwells)
    except FitError as error:
        constant = Terms(tuple(t for t in terms.listed if t.kind != "c" or not t.power))
        try:
            require_terms(constant, dwells)
        except FitError:
            raise error from None
        flag = "cross-axis terms are constant over temperature: these dwells do not show their"
        return constant, (f"{flag} change",)
    return terms, ()


def choose_loss(
    fit_with: Callable[..., Triad], loss: str, uncorrected: Array
) -> tuple[Triad, tuple[str, ...]]:
    """Fit with the recipe's loss, and flags; `uncorrected` are the residuals [n] or [n, m, g] of
    the raw dwells.

    Plain least squares stands in where a robust fit does not converge, or leaves a median absolute
    residual that is 10 % larger than that of least squares or of no correction. Where the two fits
    differ by more than U, both values are flagged. Raises FitError where no fit is better than
    none.
    """
    plain = fit_with(loss="least_squares")
    other, raw = _median_length(plain.residuals), _median_length(uncorrected)
    flags = list[str]()
    if loss == "robust":
        try:
            tough = fit_with(loss="robust")
        except FitError as error:
            worse = error.message
        else:
            left = _median_length(tough.residuals)
            if left <= WORSE * min(other, raw) + ROUNDING_G:
                return tough, _flag_differences(tough, plain)
            # without suspects the two differ by chance
            worse = (
                f"the robust fit leaves a median residual of {left:.2e} g, least squares"
                f" {other:.2e} g, no correction {raw:.2e} g: look for an error that dwells share"
                if tough.suspects
                else ""
            )
        if worse:
            flags.append(f"triad: {worse}; plain least squares was used, outliers are not left out")
    if other > WORSE_THAN_NONE * raw + ROUNDING_G:
        raise FitError(
            f"triad: the median residual is {other:.2e} g after correction by least squares,"
            f" {raw:.2e} g before, expected a smaller one",
            hint="look for wrong rows or references: gross errors move such a fit",
        )
    return plain, tuple(flags)


def _median_length(residuals: Array) -> float:
    """Median absolute residual [g] of dwells, over their components together: alone, most may be
    zero at the attitudes that were held.
    """
    return float(np.median(np.linalg.norm(residuals.reshape(len(residuals), -1), axis=1)))


def _flag_differences(tough: Triad, plain: Triad) -> tuple[str, ...]:
    """Flag for robust and least-squares fits that differ by more than U, with both values of the
    coefficient that differs most.
    """
    to_raw = tough.to_degrees
    value = tough.fit.of(lambda p: to_raw @ p)
    beside, expanded = to_raw @ plain.fit.parameters, value.expanded
    share = np.abs(value.value - beside) / np.where(expanded > 0.0, expanded, np.inf)
    if np.max(share) <= 1.0 or np.max(np.abs(tough.residuals)) <= ROUNDING_G:
        return ()
    k, count = int(np.argmax(share)), int(np.sum(share > 1.0)) - 1
    others = f", and {count} more coefficients differ" if count else ""
    flag = (
        f"triad: the fits differ by more than U: {tough.terms.names[k]} is {value.value[k]:.7g} ±"
        f" {expanded[k]:.1e} by the robust fit, which is exported, {beside[k]:.7g} by least"
        f" squares{others}; look at the suspects before you rely on it"
    )
    return (flag,)


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


def _reference_temperature(dwells: DwellSet, spec: AccelerometerRecipe) -> float:
    """Temperature [°C] at which Q is stated: that of the recipe or the dwell's nearest to it; the
    mean of the dwells where the triad knows none.
    """
    if not spec.affine.enabled:
        return float(dwells.temperature.mean())
    return float(np.clip(spec.reference_temp_degc, *dwells.valid[forms.TEMPERATURE]))


def _triad_model(dwells: DwellSet, triad: Triad) -> Model:
    """Model of the triad in powers of °C."""
    to_raw = triad.terms.in_degrees(triad.middle, triad.half)
    values, covariance = polynomial.in_raw_powers(
        triad.fit.parameters, triad.fit.total_covariance, to_raw
    )
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
        effective_dof=triad.fit.dof_along(triad.to_degrees),
        components=components_of(triad.fit.shared),
    )


def _flag_outstanding_levels(triad: Triad, dwells: DwellSet) -> tuple[str, ...]:
    """Flags on an attitude that is set up wrong the same way every time, and on a soak whose zero
    has moved: their error is far larger than that of the others.
    """
    flags = []
    for shared in triad.fit.shared:
        size = np.linalg.norm(shared.errors, axis=1)
        if shared.error.optional or size.max(initial=0.0) <= OUTSTANDING * np.median(size):
            continue
        worst = int(np.argmax(size))
        rows = np.flatnonzero(shared.error.level == worst) // triad.residuals.shape[1]
        where = f"{dwells.temperature[rows].mean():.3g} °C"
        if shared.error.group == "attitude":
            angles = dwells.inclination[rows[0]], dwells.toolface[rows[0]]
            where = "inclination {:.6g}°, toolface {:.6g}°".format(*angles)
        flags.append(
            f"triad: the {shared.error.name} of {where} is {size[worst]:.2g} {shared.error.unit},"
            f" of most others {np.median(size):.2g} {shared.error.unit}: no outliers, its"
            f" {np.unique(rows).size} dwells are kept in the fit"
        )
    return tuple(flags)


def _warn_of_lengths(triad: Triad, dwells: DwellSet, temperature: float) -> tuple[str, ...]:
    """Flags for poorly determined parameters, poorly spread attitudes and unchecked dwells."""
    t, terms, fit = triad.mapped(temperature), triad.terms, triad.fit

    def results(p: Numbers) -> Numbers:
        scale, zero = terms.scale_and_zero(p, np.array([t]))
        return np.concatenate([scale[0], zero[0], terms.small_angles(p, float(t))])

    width = fit.of(results).expanded
    flags: list[str] = []
    if fit.dof < FEW_DOF:
        flags.append(
            f"{len(triad.residuals)} dwells for {len(terms.listed)} parameters leave {fit.dof}"
            " degrees of freedom: the residuals cannot vouch for these numbers"
        )
    # scale factors, zeros and angles as lengths at the attitudes see them: the fit's own columns
    # have the prior of the angles, and depend on the size of the zeros
    of_dwells = triad.mapped(dwells.temperature)
    down = terms.corrected(fit.parameters, dwells.indication, of_dwells)
    design = np.column_stack([down**2, down, down * np.roll(down, 1, axis=1)])
    condition = float(np.linalg.cond(design / np.linalg.norm(design, axis=0)))
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
    # change of a fitted residual by its own reference: near 1, no other dwell checks it
    jacobian = derivative(residual_of(dwells, terms, of_dwells, lengths=True), fit.parameters)
    alone = np.flatnonzero(np.einsum("np,pn->n", jacobian, fit.gain) > 0.99)
    if alone.size:
        flags.append(
            f"no other dwell checks dwell {', '.join(str(i) for i in alone)} (leverage above 0.99)"
        )
    return tuple(f"magnitude: {flag}" for flag in flags)


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
