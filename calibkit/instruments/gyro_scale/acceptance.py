"""Criteria of the limits that a recipe states: on the largest figure of each kind over all gyros
and runs of a fit (of GJB 2426A by `published`, of the angles between gyros by `coefficient_files`),
on the residuals of the lines over their noise, and on the largest error in unseen runs, which
`corrections` finds.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from calibkit.coefficients import Criterion, Figure, at_most
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.published import IEEE, FigureName, Line
from calibkit.instruments.gyro_scale.recipe import LineAcceptance

LIMITS = {
    "nonlinearity_full_scale": ("nonlinearity over full scale", "max_nonlinearity_ppm", "ppm"),
    "asymmetry": ("asymmetry", "max_asymmetry_ppm", "ppm"),
    "repeatability": ("repeatability", "max_repeatability_ppm", "ppm"),
    "temperature_sensitivity": (
        "temperature sensitivity",
        "max_temperature_sensitivity_ppm_degc",
        "ppm/degC",
    ),
    "orthogonality_error_deg": ("orthogonality error", "max_orthogonality_error_deg", "deg"),
    "gamma": ("standard uncertainty of gamma", "max_gamma_uncertainty", "1"),
    "angle_deg": ("standard uncertainty of an angle", "max_angle_uncertainty_deg", "deg"),
}
"""Figure of runs (GJB 2426A), or between gyros → name, recipe key and unit of its limit."""
UNSEEN_LIMITS = {
    "scale_factor_error_ppm": ("scale-factor error", "max_scale_factor_error_ppm", "ppm"),
    "nonlinearity_full_scale_ppm": LIMITS["nonlinearity_full_scale"],
    "rate_error_max_ppm_of_full_scale": ("rate error", "max_rate_error_ppm", "ppm"),
    "cross_axis_max_ppm_of_full_scale": (
        "rate across the turned axis",
        "max_cross_axis_ppm",
        "ppm",
    ),
}
"""Error in unseen runs → name, recipe key and unit of its limit."""
LINE_KEYS = r"gyro_scale\.(nonlinearity_full_scale|asymmetry)\.GJB 2426A\..+"
"""Pattern of the key figures of lines."""


def judge_figures(figures: Sequence[Figure], limits: LineAcceptance) -> tuple[Criterion, ...]:
    """Criteria on the largest figure of each kind, of γ and angles on their standard uncertainties;
    raises FitError where a limit is stated but no run gives the figure.
    """
    values_of: dict[str, list[float]] = {}
    for figure in figures:
        kind, standard, _ = FigureName.of(figure.name)
        if standard != IEEE:
            limited_u = kind in ("gamma", "angle_deg")
            value = figure.standard_uncertainty if limited_u else abs(figure.value)
            values_of.setdefault(kind, []).append(value)
    for kind, (_, key, _) in LIMITS.items():
        if getattr(limits, key, None) is not None and kind not in values_of:
            raise FitError(
                f"acceptance.{key} = {getattr(limits, key):g}: these logs cannot show that figure",
                hint="add the runs that it needs, or take the limit out of the recipe",
            )
    return _judge(limits, LIMITS, values_of)


def judge_noise(lines: Iterable[Line], limits: LineAcceptance) -> tuple[Criterion, ...]:
    """Criterion on the residuals of the lines of runs over the noise of their held rates, the
    largest of all gyros, where the recipe limits it and noise was measured.
    """
    ratios = np.array([line.residual_over_noise for line in lines])
    limit = ("residual over noise", "max_residual_over_noise", "1")
    return _judge(limits, {"noise": limit}, {"noise": ratios[np.isfinite(ratios)].tolist()})


def judge_unseen(
    errors: Sequence[Mapping[str, Any]], limits: LineAcceptance
) -> tuple[Criterion, ...]:
    """Criteria on the largest error of each kind in unseen runs."""
    values_of = {
        kind: [abs(error[kind]) for error in errors if kind in error] for kind in UNSEEN_LIMITS
    }
    return _judge(limits, UNSEEN_LIMITS, values_of)


def _judge(
    limits: LineAcceptance,
    names: Mapping[str, tuple[str, str, str]],
    values_of: Mapping[str, Sequence[float]],
) -> tuple[Criterion, ...]:
    """Criteria that the largest values do not exceed their limits; a limit that the recipe does not
    state is left out.
    """
    criteria = []
    for kind, (name, key, unit) in names.items():
        values, limit = values_of.get(kind), getattr(limits, key, None)
        if values and limit is not None:
            criteria.append(at_most(name, max(values), limit, unit))
    return tuple(criteria)
