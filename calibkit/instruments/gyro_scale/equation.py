"""Gyros on a rate table, about one axis or several.

    F = K(T) Ω + Σ_k c_k(T) s_k(Ω) + F0(T) + Σ_g Z_g b_g + e                               (1)

F indication of a gyro at a held rate [1/s], Ω table rate [°/s], K and F0 polynomials of x, the
temperature T mapped to [-1, 1], s_k shapes of a response that is no straight line, b errors that
held rates share, e noise. c_k is constant, follows the scale factor, c_k K(T)/K(x = 0), or is
linear, c_k + d_k x. The published K and F0 are those of the best straight line over the held
rates, which takes its part of the shapes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import DPH_PER_DPS
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.numeric.least_squares import polynomial

PPM = 1e-6
SCALE, ZERO = 0, 1
"""Number of K among the results of a line, and of F0."""
SAME_RATE = 0.01
"""Relative difference below which two held rates are one."""
TINY = 1e-6
"""Difference below which two held rates are one, relative to the largest rate."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Held rates of all runs of one gyro."""

    rate_dps: Array
    """[n]."""
    indication: Array
    """[n], as logged."""
    run: Integers
    """[n], number of the run of each row."""
    row_degc: Array
    """[n], NaN where it is not known."""
    hours: Array
    """[n], from the middle of the run; 0 where times are not known."""

    @property
    def temp_degc(self) -> Array:
        """Mean temperature [r] of each run."""
        return np.bincount(self.run, self.row_degc) / np.bincount(self.run)

    @property
    def both_ways(self) -> bool:
        """Whether every run turned both ways."""
        return all(
            line_terms.turns_both_ways(self.rate_dps[self.run == k])
            for k in range(self.run.max() + 1)
        )

    @property
    def shows_asymmetry(self) -> bool:
        """Whether an asymmetry is no zero of a direction: rates of several sizes, both ways."""
        size = np.abs(self.rate_dps)
        return self.both_ways and bool(np.ptp(size) > SAME_RATE * size.max())


class Parameters(NamedTuple):
    """Parameters of equation (1) by name."""

    K: Numbers
    """[order + 1], of the powers of x."""
    F0: Numbers
    """[order + 1]."""
    bend: Numbers
    """c [k]."""
    bend_slope: Numbers
    """d [k], or none where the bends are not linear in x."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Terms of equation (1)."""

    orders: tuple[int, int] = (0, 0)
    """Of the polynomials of K and F0."""
    middle_half: tuple[float, float] = (0.0, 1.0)
    """Middle and half-width [°C] of the temperatures."""
    shapes: tuple[str, ...] = ()
    """Names of the shapes, as `line_terms.shapes` has them."""
    fastest_dps: float = 1.0
    """Rate that powers of the rate are relative to."""
    bends: Literal["constant", "as K", "linear"] = "constant"
    """How the shapes change with temperature."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        letters = zip(("K", "F0"), self.orders, strict=True)
        change = [f"{name} T" for name in self.shapes if self.bends == "linear"]
        powers = [f"{letter} T^{k}" for letter, order in letters for k in range(order + 1)]
        return (*powers, *self.shapes, *change)

    def split(self, p: Numbers) -> Parameters:
        """Parameters [p] by name."""
        sizes = [order + 1 for order in self.orders] + [len(self.shapes)]
        return Parameters(*np.split(p, np.cumsum(sizes)))

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] mapped to [-1, 1]."""
        middle, half = self.middle_half
        return (degc - middle) / half

    def shape(self, rate_dps: Array) -> Array:
        """Shapes [n, k] at rates [n]."""
        known = line_terms.shapes(rate_dps, self.fastest_dps)
        return np.column_stack([np.empty((rate_dps.size, 0)), *(known[s] for s in self.shapes)])

    def bend_polynomials(self, p: Numbers) -> Numbers:
        """c_k(T) [k, order + 1] in powers of x."""
        of = self.split(p)
        if self.bends == "as K":
            return np.asarray(of.bend[:, None] * (of.K / of.K[0]))
        if self.bends == "linear":
            return np.stack((of.bend, of.bend_slope), axis=1)
        return of.bend[:, None]


def _at(coefficients: Numbers, x: Array) -> Numbers:
    """Polynomials [..., order + 1] at x [n]: [..., n]."""
    return np.asarray(coefficients @ polynomial.powers(x, coefficients.shape[-1] - 1).T)


def response(p: Numbers, rate_dps: Array, degc: Array, terms: Terms) -> Numbers:
    """F [n] of equation (1) without its errors."""
    of, x = terms.split(p), terms.mapped(degc)
    bent = np.sum(terms.shape(rate_dps).T * _at(terms.bend_polynomials(p), x), axis=0)
    return np.asarray(_at(of.K, x) * rate_dps + bent + _at(of.F0, x))


def residual(p: Numbers, rows: Rows, terms: Terms) -> Numbers:
    """What equation (1) leaves of held rates [n] [1/s]."""
    return response(p, rows.rate_dps, rows.row_degc, terms) - rows.indication


def best_line(terms: Terms, rate_dps: Array) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Function from parameters to the polynomials of K and of F0 of the best straight line over
    rates [n].
    """
    line = np.column_stack((rate_dps, np.ones_like(rate_dps)))
    share = np.linalg.pinv(line) @ terms.shape(rate_dps)

    def of(p: Numbers) -> tuple[Numbers, Numbers]:
        parts = terms.split(p)
        bent = share @ terms.bend_polynomials(p)
        return _add(parts.K, bent[SCALE]), _add(parts.F0, bent[ZERO])

    return of


def _add(a: Numbers, b: Numbers) -> Numbers:
    """Sum of two polynomials."""
    order = max(len(a), len(b))
    return np.asarray(np.pad(a, (0, order - len(a))) + np.pad(b, (0, order - len(b))))


def shared_errors(rows: Rows, terms: Terms, K: float) -> Iterator[Shared]:
    """What differs from run to run, what changes during a run, what the response at a rate is off
    the line in every run, and what differs between the sides of the table, where the likelihood
    asks for it. Sizes are relative to a scale factor K.
    """
    ppm, dph = abs(K) * PPM * rows.rate_dps, np.full(rows.run.size, abs(K) / DPH_PER_DPS)

    def of_runs(effect: str, loading: Array, unit: str) -> Shared:
        return Shared(
            group="run", effect=effect, level=rows.run, loading=loading[:, None], unit=unit
        )

    yield of_runs("scale", ppm, "ppm")
    yield of_runs("zero", dph, "deg/h")
    if rows.hours.any():
        yield of_runs("zero drift", dph * rows.hours, "deg/h/h")
    warmer = rows.row_degc - rows.temp_degc[rows.run]
    if not terms.orders[SCALE] and np.isfinite(warmer).all() and warmer.any():
        yield of_runs("scale over temperature", ppm * warmer, "ppm/degC")
    elif rows.hours.any() and not np.isfinite(warmer).all():
        yield of_runs("scale drift", ppm * rows.hours, "ppm/h")
    if not rows.both_ways:
        return
    pattern = dph[:, None] * response_pattern(rows)
    if pattern.size:
        every = np.zeros_like(rows.run)
        yield Shared(group="rate", effect="response", level=every, loading=pattern, unit="deg/h")
    side = 2 * rows.run + (rows.rate_dps < 0.0)
    for effect, level, loading, unit in (
        ("zero", side, dph, "deg/h"),
        ("scale", rows.run, np.abs(ppm), "ppm"),
    ):
        yield Shared(
            group="side",
            effect=effect,
            level=level,
            loading=loading[:, None],
            unit=unit,
            optional=True,
        )


def response_pattern(rows: Rows) -> Array:
    """Columns [n, k] of what the runs have in common at each rate that two of them held, beside a
    straight line over the rates of all.
    """
    order = np.argsort(rows.rate_dps, kind="stable")
    rate = rows.rate_dps[order]
    far = np.diff(rate) > SAME_RATE * np.abs(rate[1:]) + TINY * np.max(np.abs(rate))
    level = np.empty(rate.size, dtype=np.int64)
    level[order] = np.concatenate(([0], np.cumsum(far)))
    repeated = [k for k in range(level.max() + 1) if np.unique(rows.run[level == k]).size > 1]
    at_level = (level[:, None] == repeated).astype(np.float64)
    line, _ = np.linalg.qr(np.column_stack((rows.rate_dps, np.ones(rate.size))))
    left, spread, _ = np.linalg.svd(at_level - line @ (line.T @ at_level), full_matrices=False)
    return np.asarray((left * spread)[:, spread > SAME_RATE], dtype=np.float64)
