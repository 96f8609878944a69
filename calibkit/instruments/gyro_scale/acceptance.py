"""Acceptance limits of a recipe on the figures of fits and of unseen runs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from calibkit.coefficients import Criterion, Figure, at_most
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import forms, pair_fit, triad_fit
from calibkit.instruments.gyro_scale.numeric.gjb_figures import GJB, Line
from calibkit.instruments.gyro_scale.recipe import (
    LineAcceptance,
    PairAcceptance,
    TriadAcceptance,
)

LINE_LIMITS = {
    "nonlinearity_full_scale": ("nonlinearity over full scale", "max_nonlinearity_ppm", "ppm"),
    "asymmetry": ("asymmetry", "max_asymmetry_ppm", "ppm"),
}
"""Figure of a line (GJB 2426A) → name, recipe key and unit of its limit."""
RUN_LIMITS = LINE_LIMITS | {
    "repeatability": ("repeatability", "max_repeatability_ppm", "ppm"),
    "temperature_sensitivity": (
        "temperature sensitivity",
        "max_temperature_sensitivity_ppm_degc",
        "ppm/degC",
    ),
}
LINE_KEYS = r"gyro_scale\.(nonlinearity_full_scale|asymmetry)\.GJB 2426A\..+"
"""Pattern of the key figures of lines."""
UNSEEN_LINE_LIMITS = {
    "scale_factor_error_ppm": ("scale-factor error", "max_scale_factor_error_ppm", "ppm"),
    "nonlinearity_full_scale_ppm": LINE_LIMITS["nonlinearity_full_scale"],
}
UNSEEN_BASE_LIMITS = {
    "rate_error_max_ppm_of_full_scale": ("rate error", "max_rate_error_ppm", "ppm"),
    "cross_axis_max_ppm_of_full_scale": (
        "rate across the turned axis",
        "max_cross_axis_ppm",
        "ppm",
    ),
}


def _judge(
    limits: LineAcceptance, *found: tuple[tuple[str, str, str], float]
) -> tuple[Criterion, ...]:
    """Criteria that values do not exceed their limits; a limit that the recipe does not state is
    left out.
    """
    return tuple(
        at_most(name, value, getattr(limits, key), unit)
        for (name, key, unit), value in found
        if getattr(limits, key) is not None
    )


def judge_figures(
    figures: Sequence[Figure],
    kinds: Mapping[str, tuple[str, str, str]],
    limits: LineAcceptance,
) -> tuple[Criterion, ...]:
    """Criteria on the largest figure of each kind; raises FitError where a limit is stated but no
    run gives the figure.
    """
    found = []
    for what, limit in kinds.items():
        shown = [
            figure.value
            for figure in figures
            if forms.read_figure_name(figure.name)[:2] == (what, GJB)
        ]
        value = getattr(limits, limit[1])
        if value is not None and not shown:
            raise FitError(
                f"acceptance.{limit[1]} = {value:g}: these logs cannot show that figure",
                hint="add the runs that it needs, or take the limit out of the recipe",
            )
        found.append((limit, max(shown, default=0.0)))
    return _judge(limits, *found)


def judge_noise(lines: Iterable[Line], limits: LineAcceptance) -> tuple[Criterion, ...]:
    """Criterion on the residuals of the lines of runs over the noise of their held rates, the
    largest of all gyros, where the recipe limits it and noise was measured.
    """
    ratios = np.array([line.residual_over_noise for line in lines])
    known = ratios[np.isfinite(ratios)]
    limit = ("residual over noise", "max_residual_over_noise", "1")
    return _judge(limits, (limit, float(known.max()))) if known.size else ()


def judge_pair(
    fitted: pair_fit.PairFit, figures: Sequence[Figure], limits: PairAcceptance
) -> tuple[Criterion, ...]:
    """Criteria on the lines of a pair's gyros about their own axes, and on the angle between the
    gyros.
    """
    u_gamma = float(fitted.found.standard_uncertainty[2])
    error = abs(fitted.found.orthogonality_error_deg)
    return judge_figures(figures, LINE_LIMITS, limits) + _judge(
        limits,
        (("standard uncertainty of gamma", "max_gamma_uncertainty", "1"), u_gamma),
        (("orthogonality error", "max_orthogonality_error_deg", "deg"), error),
    )


def judge_triad(
    fitted: triad_fit.AxesFit, figures: Sequence[Figure], limits: TriadAcceptance
) -> tuple[Criterion, ...]:
    """Criteria on the lines about the main axes, and on the angles of every set of runs."""
    angles = [
        (
            abs(90.0 - float(one.triad.angles_deg.value[pair])),
            float(one.triad.angles_deg.u[pair]),
        )
        for one in fitted.sets
        for pair in fitted.pairs
    ]
    error, u = (max(found) for found in zip(*(angles or [(0.0, 0.0)]), strict=True))
    return judge_figures(figures, LINE_LIMITS, limits) + _judge(
        limits,
        (("orthogonality error", "max_orthogonality_error_deg", "deg"), error),
        (("standard uncertainty of an angle", "max_angle_uncertainty_deg", "deg"), u),
    )


def judge_unseen(
    errors: Sequence[Mapping[str, Any]],
    kinds: Mapping[str, tuple[str, str, str]],
    limits: LineAcceptance,
) -> tuple[Criterion, ...]:
    """Criteria on the largest error of each kind in unseen runs."""
    return _judge(
        limits,
        *((limit, max(abs(one[key]) for one in errors)) for key, limit in kinds.items()),
    )
