"""Fits with errors that rows share: effects chosen by likelihood, outliers left out that no shared
error explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.numeric.least_squares import components
from calibkit.numeric.least_squares.components import Effect, MixedFit

ASKED_FOR = 6.0
"""Fall of −2 × the restricted log-likelihood that keeps an effect: by chance once in 140 tries, a
variance that is 0 half the time and else as χ² with one degree of freedom (Self & Liang 1987).
"""
FALSE_ALARM = 0.005
"""Chance that any faultless row of a fit is called an outlier."""
MOST_OF_A_LEVEL = 0.5
"""Share of the rows of a level that, standing out together, are an effect and no outliers."""
ROUNDS = 8


@dataclass(frozen=True, slots=True)
class SharedFit:
    """A fit with errors that rows share."""

    found: MixedFit
    used: Mask
    """[n], rows that the fit used."""
    effects: tuple[Effect, ...]
    """Effects of the fit, of all rows."""
    residuals: Array
    """[n], indication less design · coefficients of all rows."""


def fit(
    design: Array,
    indication: Array,
    effects: Sequence[Effect],
    candidates: Sequence[Effect] = (),
    *,
    weights: Array,
    channel: Integers,
    used: Mask,
    leave_out: bool,
    names: Sequence[str] = (),
    near: MixedFit | None = None,
) -> SharedFit:
    """Fit indication [n] = design [n, p] · coefficients with errors that rows share.

    Parameters
    ----------
    effects : estimated whatever their size.
    candidates : each kept where the likelihood asks for it.
    weights : [n], proportional to 1/variance of the noise within a channel.
    channel : [n], sensors with a noise of their own.
    used : [n], rows to begin with.
    leave_out : whether rows are left out, and taken in again, by their residuals.
    near : fit to nearly the same rows: the effects that it kept are kept, no other is tried.

    Raises
    ------
    FitError : as `components.fit`.

    """
    from scipy.special import ndtri

    limit = -float(ndtri(FALSE_ALARM / (2.0 * len(indication))))
    balance, kept, trial = weights, list(effects), list(candidates)
    if near is not None:
        kept, trial = [*kept, *_kept_by(near, trial)], []
    for _ in range(ROUNDS):
        kept, trial, found = _grow(design, indication, kept, trial, balance, used, names, near)
        residuals = indication - design @ found.coefficients
        left = residuals - found.shared(kept)
        balance = _balance(left, weights, used, channel)
        if not leave_out:
            break
        size = np.abs(left) * np.sqrt(balance)
        good = size <= limit * _scatter(size, found, balance, used)
        good = _with_whole_levels(good, kept, channel)
        if np.array_equal(good, used):
            break
        used = good
    return SharedFit(found, used, tuple(kept), residuals)


def _grow(
    design: Array,
    indication: Array,
    kept: list[Effect],
    trial: list[Effect],
    weights: Array,
    used: Mask,
    names: Sequence[str],
    near: MixedFit | None,
) -> tuple[list[Effect], list[Effect], MixedFit]:
    """Effects with those candidates that the likelihood asks for, the other candidates, the fit."""

    def solve(effects: list[Effect]) -> MixedFit:
        part = [effect.of_rows(used) for effect in effects]
        return components.fit(
            design[used], indication[used], part, weights=weights[used], names=names, near=near
        )

    found = solve(kept)
    while trial:
        tried = [solve([*kept, effect]) for effect in trial]
        best = int(np.argmin([each.deviance for each in tried]))
        if found.deviance - tried[best].deviance < ASKED_FOR:
            break
        found = tried[best]
        kept, trial = [*kept, trial[best]], [*trial[:best], *trial[best + 1 :]]
    return kept, trial, found


def _kept_by(near: MixedFit, candidates: Sequence[Effect]) -> list[Effect]:
    """Candidates that a fit kept, in its order."""
    by_name = {(effect.group, effect.effect): effect for effect in candidates}
    names = [(component.group, component.effect) for component in near.components]
    return [by_name[name] for name in names if name in by_name]


def _rms(left: Array, balance: Array, used: Mask) -> float:
    """Weighted root mean square of the rows that are used."""
    return float(np.sqrt(np.mean((left**2 * balance)[used])))


def _scatter(size: Array, found: MixedFit, weights: Array, used: Mask) -> Array:
    """Standard deviation [n] of what is left of a faultless row, smaller than the noise where the
    row was fitted, larger where it was not.
    """
    fitted = float(np.mean(size[used] ** 2))
    noise = found.residual_rms**2 * float(np.mean(weights[used]))
    return np.sqrt(np.where(used, fitted, max(2.0 * noise - fitted, fitted)))


def _balance(left: Array, weights: Array, used: Mask, channel: Integers) -> Array:
    """Weights [n] by which the noise of every channel is the same."""
    balance = weights.copy()
    noise = [_rms(left, weights, used & (channel == k)) for k in range(int(channel.max()) + 1)]
    if min(noise) > 0.0:
        balance *= (np.exp(np.mean(np.log(noise))) / np.array(noise)[channel]) ** 2
    return balance


def _with_whole_levels(good: Mask, effects: Sequence[Effect], channel: Integers) -> Mask:
    """Rows [n] to use: those of a level, or of one channel in it, of which most stand out have an
    error of their own, and stay.
    """
    for effect in effects:
        rows = effect.labels >= 0
        labels = effect.labels[rows] * (int(channel.max()) + 1) + channel[rows]
        share = np.bincount(labels, good[rows]) / np.maximum(np.bincount(labels), 1)
        good = good.copy()
        good[rows] |= (share < MOST_OF_A_LEVEL)[labels]
    return good
