"""Dwells of a triad → models of its K-factor, Q-factor and of the triad over temperature.

`fit_triad` tells the story: which terms the dwells determine, the equation fitted with the errors
that dwells share (`triad`), K and Q as published (`published`), and what is doubtful (`findings`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure, Model, Parameter
from calibkit.errors import FitError
from calibkit.forms import components_of
from calibkit.instruments.accelerometer import findings, forms, published
from calibkit.instruments.accelerometer.determination import require_determined
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Terms
from calibkit.instruments.accelerometer.numeric import k_factor, magnitude
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.triad import Triad, solve_triad
from calibkit.numeric.least_squares import polynomial

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

    # 1. Terms of the equation: those of the recipe, if the dwells determine them.
    terms, flags = choose_terms(dwells, spec)

    # 2. The triad, by least squares and without outliers, with the errors that dwells share.
    if lengths:
        uncorrected: Array = np.linalg.norm(dwells.indication, axis=1) - 1.0
    else:
        uncorrected = dwells.indication - dwells.reference
    loss = "least_squares" if by_lmfit else spec.loss
    triad, doubts = choose_loss(partial(solve_triad, dwells, terms, spec), loss, uncorrected)
    flags += (*doubts, *findings.flag_fit(triad, dwells))

    # 3. The models of the coefficient files: K and Q as published, and the triad in powers of °C.
    k, q, affine = list_models(dwells, spec, triad)
    k_not_fitted = []
    for model, orders in zip(k, spec.k.axes, strict=False):
        missing = [K for n, K in enumerate(k_factor.NAMES) if n not in orders.fitted]
        if missing:
            k_not_fitted.append(f"{model.name}: {', '.join(missing)} not fitted, taken as 0")

    # 4. What is doubtful.
    intervals: tuple[Figure, ...] = ()
    if lengths and q is not None:
        flags += findings.flag_lengths(triad, dwells, q.value("temperature"))
    if by_lmfit:
        intervals, doubts = _profile_intervals(dwells)
        flags += doubts
    return TriadFit(triad, k, tuple(k_not_fitted), q, affine, intervals, flags)


def list_models(
    dwells: DwellSet, spec: AccelerometerRecipe, triad: Triad
) -> tuple[tuple[Model, ...], Model | None, Model | None]:
    """K models, the model of Q and that of the triad, as the recipe enables them."""
    lengths, terms, fit = spec.reference.kind == "magnitude", triad.terms, triad.fit
    k = published.fit_k(dwells, spec.k.axes, triad) if spec.k.enabled and not lengths else ()
    if not (lengths or spec.affine.enabled):
        return k, None, None
    # Q at the recipe's temperature, or that of the dwells which is nearest to it; at the mean of
    # the dwells where the triad knows no temperature
    q_degc = float(dwells.temperature.mean())
    if spec.affine.enabled:
        q_degc = float(np.clip(spec.reference_temp_degc, *dwells.valid[forms.TEMPERATURE]))
    q = published.fit_q(dwells, triad, q_degc)
    to_raw = terms.in_degrees(triad.middle, triad.half)
    values, covariance = polynomial.in_raw_powers(fit.parameters, fit.total_covariance, to_raw)
    noise = triad.noise.tolist()
    axes = ("length",) if lengths else AXES
    affine = forms.TRIAD.write(
        "triad",
        [(t.name, v, t.unit) for t, v in zip(terms.listed, values.tolist(), strict=True)],
        covariance,
        dof=fit.dof,
        residual_rms=triad.residual_rms,
        residual_unit="g",
        valid=dwells.valid,
        parameters=tuple(
            Parameter(f"noise_{axis}", size, "g") for axis, size in zip(axes, noise, strict=True)
        ),
        effective_dof=fit.dof_along(triad.to_degrees),
        components=components_of(fit.shared),
    )
    return k, q, affine


def choose_terms(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Terms, tuple[str, ...]]:
    """Terms of the equation that the recipe asks for, and a flag where the dwells do not show how
    cross-axis terms change with temperature. Raises FitError for other terms, and for a K, that the
    dwells do not determine.
    """
    terms = asked_terms(spec)
    if spec.reference.kind == "magnitude":  # the start of that fit says what it needs
        return terms, ()
    reference, temperature = dwells.reference, dwells.temperature
    if spec.k.enabled:
        published.require_k(spec.k.axes, reference, temperature)
    lower = "lower scale_order, cross_order and bias_order, or leave out higher-order terms"
    try:
        require_determined(terms, terms.names, reference, temperature, lower=lower)
    except FitError as error:
        constant = Terms(tuple(t for t in terms.listed if t.kind != "c" or not t.power))
        try:
            require_determined(constant, constant.names, reference, temperature, lower=lower)
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
    least_squares = fit_with(loss="least_squares")
    left_by_plain, raw = _median_length(least_squares.residuals), _median_length(uncorrected)
    tough, worse = None, ""
    if loss == "robust":
        try:
            tough = fit_with(loss="robust")
        except FitError as error:
            worse = error.message
    if tough is not None:
        left = _median_length(tough.residuals)
        if left > WORSE * min(left_by_plain, raw) + ROUNDING_G:
            if tough.suspects:  # without them the two differ by chance
                worse = (
                    f"the robust fit leaves a median residual of {left:.2e} g, least squares"
                    f" {left_by_plain:.2e} g, no correction {raw:.2e} g: look for an error that"
                    " dwells share"
                )
            tough = None
    if tough is None:
        if left_by_plain > WORSE_THAN_NONE * raw + ROUNDING_G:
            raise FitError(
                f"triad: the median residual is {left_by_plain:.2e} g after correction by least"
                f" squares, {raw:.2e} g before, expected a smaller one",
                hint="look for wrong rows or references: gross errors move such a fit",
            )
        used = "plain least squares was used, outliers are not left out"
        return least_squares, (f"triad: {worse}; {used}",) if worse else ()
    # where the fits differ by more than U, both values of the coefficient that differs most
    to_raw = tough.to_degrees
    value = tough.fit.of(lambda p: to_raw @ p)
    plain_values, expanded = to_raw @ least_squares.fit.parameters, value.expanded
    share = np.abs(value.value - plain_values) / np.where(expanded > 0.0, expanded, np.inf)
    if np.max(share) <= 1.0 or np.max(np.abs(tough.residuals)) <= ROUNDING_G:
        return tough, ()
    k, count = int(np.argmax(share)), int(np.sum(share > 1.0)) - 1
    further = f", and {count} more coefficients differ" if count else ""
    flag = (
        f"triad: the fits differ by more than U: {tough.terms.names[k]} is {value.value[k]:.7g} ±"
        f" {expanded[k]:.1e} by the robust fit, which is exported, {plain_values[k]:.7g} by least"
        f" squares{further}; look at the suspects before you rely on it"
    )
    return tough, (flag,)


def _median_length(residuals: Array) -> float:
    """Median absolute residual [g] of dwells, over their components together: alone, most may be
    zero at the attitudes that were held.
    """
    return float(np.median(np.linalg.norm(residuals.reshape(len(residuals), -1), axis=1)))


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
    remark = "magnitude: lmfit solves by plain least squares, outliers are not left out"
    return figures, (*open_ends, remark)
