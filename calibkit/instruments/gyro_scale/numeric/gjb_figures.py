"""Figures of a gyro's scale factor as defined by GJB 2426A and IEEE Std 952, in ppm, labelled with
the standard.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.constants import ARCSECONDS_PER_DEGREE
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric.scale_factor import ScaleFactor
from calibkit.numeric.least_squares.fit import rank

PPM = 1e6
GJB, IEEE = "GJB 2426A", "IEEE Std 952"
"""Standards that define the figures."""
HALF = 0.5
"""Share of the expected output from which a rate or step counts as detected (GJB 2426A, IEEE Std
952: threshold, resolution).
"""
SEEN = 4.0
"""Least significance of a response, in standard uncertainties."""


@dataclass(frozen=True, slots=True)
class _Figure:
    """A value with its standard uncertainty (type A), its unit and the standard that defines it."""

    name: str
    value: float
    standard_uncertainty: float
    unit: str
    standard: str


def _nonlinearity_full_scale(scale: ScaleFactor) -> float:
    """Nonlinearity [ppm]: max |F_j − F̂_j| over the largest one-sided output max |F_j| (GJB
    2426A).
    """
    largest = float(np.max(np.abs(scale.indication)))
    if largest == 0.0:
        raise FitError("every indication is zero", hint="check the column of the gyro")
    return float(np.max(np.abs(scale.residuals))) / largest * PPM


def nonlinearity_per_point(scale: ScaleFactor, standard_uncertainty: Array | None = None) -> Array:
    """Relative deviation (F_j − F̂_j)/|K Ω_j| of each plateau [p] [ppm]; NaN at rest, and where the
    noise [p] of the means, if it is given, hides the turn: a table that stops still turns by its
    encoder's noise.
    """
    expected = np.abs(scale.K * scale.rate_dps)
    noise = np.zeros_like(expected) if standard_uncertainty is None else standard_uncertainty
    seen = _turning(scale.rate_dps) & (noise * SEEN < HALF * expected)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(seen, scale.residuals / expected * PPM, np.nan)


def _asymmetry_gjb(scale: ScaleFactor) -> float:
    """Asymmetry |K₊ − K₋|/K̄ [ppm]: separate straight lines for positive and negative rates, K̄
    their mean (GJB 2426A).

    Raises FitError where a side has fewer than two rates.
    """
    positive, negative = (float(row @ scale.indication) for row in _slopes_of_sides(scale.rate_dps))
    return abs(positive - negative) / abs((positive + negative) / 2.0) * PPM


def _asymmetry_ieee(scale: ScaleFactor) -> float:
    """Asymmetry |K₊ − K₋|/K [ppm]: slopes for positive and negative rates with a common intercept,
    K over the whole range (IEEE Std 952).

    Raises FitError where the rates are not of both signs or are too few.
    """
    positive, negative = (
        float(row @ scale.indication) for row in _slopes_about_intercept(scale.rate_dps)
    )
    return abs(positive - negative) / abs(scale.K) * PPM


def _slopes_of_sides(rate_dps: Array) -> Array:
    """Matrix [2, p] from indications to the slopes of positive and of negative rates, each with its
    own intercept.
    """
    solver = np.zeros((2, rate_dps.size))
    for row, side, name in ((0, rate_dps > 0.0, "positive"), (1, rate_dps < 0.0, "negative")):
        if np.unique(np.round(rate_dps[side], 9)).size < 2:
            raise FitError(
                f"asymmetry needs two {name} rates or more", hint="run the table both ways"
            )
        solver[row, side] = np.linalg.pinv(
            np.column_stack((rate_dps[side], np.ones(int(side.sum()))))
        )[0]
    return solver


def _slopes_about_intercept(rate_dps: Array) -> Array:
    """Matrix [2, p] from indications to the slopes of positive and negative rates that share one
    intercept.
    """
    design = np.column_stack(
        (np.maximum(rate_dps, 0.0), np.minimum(rate_dps, 0.0), np.ones_like(rate_dps))
    )
    if rank(design) < 3:
        raise FitError(
            "asymmetry needs rates of both signs, three or more", hint="run the table both ways"
        )
    return np.asarray(np.linalg.pinv(design)[:2], dtype=np.float64)


def repeatability(K: Array) -> float:
    """Repeatability sd(K_i)/K̄ [ppm] of the scale factors K [Q] of Q runs (GJB 2426A); FitError for
    one run.
    """
    if K.size < 2:
        raise FitError(
            "repeatability needs two runs or more", hint="repeat the run at the same temperature"
        )
    return float(np.std(K, ddof=1) / abs(np.mean(K))) * PPM


def temperature_sensitivity(K: Array, temp_degc: Array, room_degc: float) -> float:
    """Temperature sensitivity max |K_i − K_m|/(K_m |T_i − T_m|) [ppm/°C] (GJB 2426A).

    K [q] and temperatures [q] [°C]; K_m and T_m are the means of the runs nearest room temperature,
    within 5 °C of it.
    """
    at_room = np.abs(temp_degc - room_degc) <= 5.0
    if not at_room.any() or at_room.all():
        raise FitError(
            f"temperature sensitivity needs runs within 5 °C of {room_degc:g} °C and others"
            " outside",
            hint="add runs, or state the room temperature",
        )
    K_m, T_m = float(K[at_room].mean()), float(temp_degc[at_room].mean())
    relative = np.abs(K[~at_room] - K_m) / (abs(K_m) * np.abs(temp_degc[~at_room] - T_m))
    return float(np.max(relative)) * PPM


def _threshold_dps(scale: ScaleFactor, standard_uncertainty: Array) -> float:
    """Threshold: smallest tested rate [°/s] from which the output is at least half of the expected
    one; NaN where noise hides it.

    An upper limit of the threshold: smaller rates were not tested. `standard_uncertainty` [p] is of
    the plateau means.
    """
    expected = np.abs(scale.K * scale.rate_dps)
    turning = _turning(scale.rate_dps)
    share = (scale.indication - scale.F0)[turning] / (scale.K * scale.rate_dps)[turning]
    seen = standard_uncertainty[turning] * SEEN < HALF * expected[turning]
    rates = np.abs(scale.rate_dps[turning])
    return _smallest_from_which(rates, seen & (share >= HALF))


def _resolution_dps(scale: ScaleFactor, standard_uncertainty: Array) -> float:
    """Resolution: smallest tested step of rate [°/s] from which the output changes by at least half
    of the expected change; NaN where noise hides it.
    """
    order = np.argsort(scale.rate_dps, kind="stable")
    step = np.diff(scale.rate_dps[order])
    change = np.diff(scale.indication[order])
    noise = np.hypot(standard_uncertainty[order][1:], standard_uncertainty[order][:-1])
    real = step > 1e-9
    share = change[real] / (scale.K * step[real])
    seen = noise[real] * SEEN < HALF * np.abs(scale.K) * step[real]
    return _smallest_from_which(step[real], seen & (share >= HALF))


def _dead_zone_dps(scale: ScaleFactor, standard_uncertainty: Array) -> tuple[float, float]:
    """Dead zone: width [°/s] of the rates through zero without response, and its standard
    uncertainty from the steps between the tested rates; NaN where a direction has no fine rate
    without response that noise does not hide.
    """
    width, variance = 0.0, 0.0
    seen = standard_uncertainty * SEEN < HALF * np.abs(scale.K * scale.rate_dps)
    for direction in (1.0, -1.0):
        own = seen & (direction * scale.rate_dps > 0.0)
        rates = np.abs(scale.rate_dps[own])
        share = (scale.indication - scale.F0)[own] / (scale.K * scale.rate_dps)[own]
        first = _smallest_from_which(rates, share >= HALF)
        below = rates[rates < first]
        if not below.size:
            return float("nan"), float("nan")
        step = first - float(below.max())
        width, variance = width + first - step / 2.0, variance + step**2 / 12.0
    return width, float(np.sqrt(variance))


def figures(scale: ScaleFactor, standard_uncertainty: Array) -> tuple[_Figure, ...]:
    """All figures that one run determines, labelled; figures that its rates do not determine are
    left out.

    `standard_uncertainty` [p] is of the plateau means; each figure's uncertainty is propagated
    from it.
    """
    u_K = float(scale.standard_uncertainty[0])
    pulse = ARCSECONDS_PER_DEGREE / abs(scale.K)
    # tested rates have no uncertainty, but noise may hide the response
    tested = {
        "threshold": _threshold_dps(scale, standard_uncertainty),
        "resolution": _resolution_dps(scale, standard_uncertainty),
    }
    dead, u_dead = _dead_zone_dps(scale, standard_uncertainty)
    return (
        _Figure("scale_factor_gjb", scale.K, u_K, "1/deg", GJB),
        _Figure("scale_factor_ieee", pulse, pulse * u_K / abs(scale.K), "arcsec", IEEE),
        *_nonlinearities(scale, standard_uncertainty),
        *_asymmetries(scale, standard_uncertainty),
        *(
            _Figure(name, value, 0.0, "deg/s", GJB)
            for name, value in tested.items()
            if np.isfinite(value)
        ),
        *([_Figure("dead_zone", dead, u_dead, "deg/s", GJB)] if np.isfinite(dead) else []),
    )


def _nonlinearities(scale: ScaleFactor, standard_uncertainty: Array) -> list[_Figure]:
    """Nonlinearity over full scale and per point, with the noise of the point that decides it."""
    worst = int(np.argmax(np.abs(scale.residuals)))
    of_full = PPM / float(np.max(np.abs(scale.indication)))
    full = float(standard_uncertainty[worst]) * of_full
    rms = scale.residual_rms / abs(scale.K)
    u_rms = float(np.sqrt(np.mean(standard_uncertainty**2) / (2.0 * scale.rate_dps.size))) / abs(
        scale.K
    )
    found = [
        _Figure("nonlinearity_full_scale", _nonlinearity_full_scale(scale), full, "ppm", GJB),
        _Figure("linearity_error_rms", rms, u_rms, "deg/s", IEEE),
    ]
    per_point = np.abs(nonlinearity_per_point(scale, standard_uncertainty))
    if np.isfinite(per_point).any():
        point = int(np.nanargmax(per_point))
        u = float(standard_uncertainty[point] / abs(scale.K * scale.rate_dps[point])) * PPM
        found.insert(1, _Figure("nonlinearity_per_point", float(per_point[point]), u, "ppm", GJB))
    return found


def _asymmetries(scale: ScaleFactor, standard_uncertainty: Array) -> list[_Figure]:
    """Asymmetry by both definitions, where the rates determine it."""
    rate = scale.rate_dps
    if any(np.unique(np.round(side, 9)).size < 2 for side in (rate[rate > 0.0], rate[rate < 0.0])):
        return []
    gjb, ieee = (
        float(np.linalg.norm((rows[0] - rows[1]) * standard_uncertainty)) / abs(scale.K) * PPM
        for rows in (_slopes_of_sides(rate), _slopes_about_intercept(rate))
    )
    return [
        _Figure("asymmetry_gjb", _asymmetry_gjb(scale), gjb, "ppm", GJB),
        _Figure("asymmetry_ieee", _asymmetry_ieee(scale), ieee, "ppm", IEEE),
    ]


def _turning(rate_dps: Array) -> Mask:
    """Mask [p] of the plateaus that are not at rest."""
    return np.asarray(
        np.abs(rate_dps) > 1e-9 * np.max(np.abs(rate_dps), initial=0.0), dtype=np.bool_
    )


def _smallest_from_which(sizes: Array, responds: Mask) -> float:
    """Smallest size for which it and all larger sizes respond; NaN where the largest does not."""
    order = np.argsort(sizes, kind="stable")
    silent = np.flatnonzero(~responds[order])
    first = int(silent[-1]) + 1 if silent.size else 0
    return float(sizes[order][first]) if first < sizes.size else float("nan")
