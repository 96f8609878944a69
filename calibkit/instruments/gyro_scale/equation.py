"""Gyros on a rate table, about one axis or several.

    F = K(T) Ω + Σ_k c_k(T) s_k(Ω) + F0(T) + Σ_g Z_g b_g + e                               (1)

F indication of a gyro at a held rate [1/s], Ω table rate [°/s], K and F0 polynomials of x, the
temperature T mapped to [-1, 1], s_k shapes of a response that is no straight line (powers of the
rate to the seventh, or |Ω|), b errors that held rates share, e noise. c_k is constant, follows the
scale factor, c_k K(T)/K(x = 0), or is c_k + d_k x + e_k x². Without the square, what the sine of an
open-loop gyro leaves looks like zeros that drift within the runs, and puts K(T) farther off at the
ends of the range than its U. The published K and F0 are those of the best straight
line over the held rates, which takes its part of the shapes.

The terms that the runs of one gyro ask for, the order over temperature and powers of the rate, are
chosen on runs that are left out:

    e_r = F_r − (fit of the other runs)_r,   less its own line in K and F0 of run r          (2)

Powers are taken where the rms of e over all runs falls below `MARGIN` of that with fewer; with a
single run each rate is left out. A fibre-optic gyro without feedback is a sine whose constants
follow temperature: to ± 150 °/s a cubic leaves 0.11 °/s of it, the fifth power with coefficients
that are linear in temperature 0.03 °/s; with their squares K(T) is right too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from calibkit.fit import orders
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit, solve
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import rank

ONE_PPM = 1e-6
SCALE, ZERO = 0, 1
"""Number of K among the results of a line, and of F0."""
LOWEST_ORDER = 1
"""Of K and F0 over temperature: that a slope is not seen is no proof that there is none."""
SAME_RATE = 0.01
"""Relative difference below which two held rates are one."""
LEAST_RATES = 6
"""Fewest rates of a line with an asymmetry: three beyond its coefficients."""
POWERS = ((3,), (2, 3), (2, 3, 4, 5), (2, 3, 4, 5, 6, 7))
"""What is compared with the line alone, the simplest first."""
MARGIN = 0.9
"""Factor by which more powers must lower the error: of 40 straight lines one standard error of the
difference by groups, as drift models are chosen by, lets more than four be bent, this factor fewer.
"""
ASYMMETRY = 1
"""Number of the shape |Ω|; the others are powers of the rate."""


def turns_both_ways(rate_dps: Array) -> bool:
    """Whether rates of both directions are among [n]."""
    return bool(rate_dps.min() < 0.0 < rate_dps.max())


@dataclass(frozen=True, slots=True)
class RateRows:
    """Held rates [n] of gyros in all runs, with the indications as logged; `run` is the number of
    the run of each row, another one for each gyro in it, `line` that of what has a K and F0 of its
    own, `channel` that of gyro and table axis, which have a noise and a response.
    """

    rate_dps: Array
    indication: Array
    run: Integers
    row_degc: Array
    """NaN where it is not known."""
    hours: Array
    """From the middle of the run; 0 where times are not known."""
    line: Integers
    channel: Integers

    @property
    def temp_degc(self) -> Array:
        """Mean temperature [r] of each run."""
        return np.bincount(self.run, self.row_degc) / np.bincount(self.run)

    @property
    def both_ways(self) -> bool:
        """Whether every run turned both ways."""
        return all(turns_both_ways(self.rate_dps[self.run == k]) for k in range(self.run.max() + 1))

    @property
    def shows_asymmetry(self) -> bool:
        """Whether an asymmetry is no zero of a direction, rates of several sizes both ways, and
        leaves enough rates of each line over.
        """
        size = np.abs(self.rate_dps)
        several_sizes = bool(np.ptp(size) > SAME_RATE * size.max())
        enough_rates = bool(np.bincount(self.line).min() >= LEAST_RATES)
        return self.both_ways and several_sizes and enough_rates

    @property
    def slopes(self) -> Array:
        """Least-squares slope [lines] of each line."""
        count = np.bincount(self.line)
        # about the mean rate: the earth's rate and the bias are in every indication
        off_mean = self.rate_dps - (np.bincount(self.line, self.rate_dps) / count)[self.line]
        products = np.bincount(self.line, off_mean * self.indication)
        return np.asarray(products / np.bincount(self.line, off_mean**2))

    @classmethod
    def of_line(cls, rate_dps: Array, row_degc: Array) -> "RateRows":
        """Rates [n] at temperatures [n] of one line, whose indications are not known."""
        unknown, number = np.full(rate_dps.size, np.nan), np.zeros(rate_dps.size, dtype=np.int64)
        return cls(rate_dps, unknown, number, row_degc, unknown, number, number)

    def of_lines(self, line_mask: Mask) -> "RateRows":
        """Rows of some lines [lines] as one, runs numbered anew."""
        rows = line_mask[self.line]
        run = np.unique(self.run[rows], return_inverse=True)[1].reshape(-1)
        rate, F, degc, hours = (
            column[rows] for column in (self.rate_dps, self.indication, self.row_degc, self.hours)
        )
        return RateRows(rate, F, run, degc, hours, np.zeros_like(run), np.zeros_like(run))


class ResponseFit(NamedTuple):
    """Equation (1) of some rows."""

    fit: Fit
    rows: RateRows
    terms: "ResponseTerms"

    def refit(self, rows: RateRows) -> "ResponseFit":
        """The values for rows with small errors of rate, time or thermometer, the weights held.

        dp = −(Jᵀ V⁻¹ J)⁻¹ (Jᵀ V⁻¹ dr + dJᵀ V⁻¹ r); such errors change J by combinations of its
        columns, to which V⁻¹ r is perpendicular: the second term is 0.
        """
        p, terms = self.fit.parameters, self.terms
        change = residual(p, rows, terms) - residual(p, self.rows, terms)
        return ResponseFit(self.fit.without_errors(p - self.fit.gain @ change), rows, terms)


@dataclass(frozen=True, slots=True)
class ResponseTerms:
    """Terms of equation (1), the same of each line.

    Attributes
    ----------
    order : of the polynomials of K and F0.
    middle_half : middle and half-width [°C] of the temperatures.
    shapes : numbers of the shapes: `ASYMMETRY`, and powers of the rate.
    fastest_dps : rate that powers of the rate are relative to.
    bends : how the shapes change with temperature.

    """

    lines: int = 1
    order: int = 0
    middle_half: tuple[float, float] = (0.0, 1.0)
    shapes: tuple[int, ...] = ()
    fastest_dps: float = 1.0
    bends: Literal["constant", "as K", "polynomial"] = "constant"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of a line."""
        names = [f"{letter} T^{k}" for letter in ("K", "F0") for k in range(self.order + 1)]
        for k in range(self.bend_order + 1):
            names += [f"shape {number} T^{k}" for number in self.shapes]
        return tuple(names)

    @property
    def start(self) -> Array:
        """Parameters [p] of gyros whose scale factor is 1."""
        return np.tile(np.eye(len(self.names))[0], self.lines)

    @property
    def bend_order(self) -> int:
        """Highest power of x of the coefficients of the shapes."""
        return min(2, self.order) if self.bends == "polynomial" else 0

    def split(self, p: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """K and F0 [lines, order + 1] and c_k(T) [lines, k, order + 1] of each line, polynomials in
        powers of x, from the parameters [p].
        """
        count = self.order + 1
        K, F0, bends = np.split(p.reshape(self.lines, -1), [count, 2 * count], axis=1)
        by_power = bends.reshape(self.lines, self.bend_order + 1, len(self.shapes))
        if self.bends == "as K":
            # a bend that is a share of the scale factor follows it over temperature
            by_power = by_power * (K / K[:, :1])[:, :, None]
        return K, F0, np.swapaxes(by_power, 1, 2)

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] mapped to [-1, 1]."""
        middle, half = self.middle_half
        return (degc - middle) / half

    def shape(self, rate_dps: Array) -> Array:
        """Shapes [n, k] at rates [n]."""
        columns = np.empty((rate_dps.size, len(self.shapes)))
        for k, number in enumerate(self.shapes):
            if number == ASYMMETRY:
                columns[:, k] = np.abs(rate_dps)
            else:
                # relative to the fastest rate, so that coefficients of all powers are of one size
                columns[:, k] = (rate_dps / self.fastest_dps) ** number
        return columns

    @property
    def powers(self) -> tuple[int, ...]:
        """Powers of the rate that the response has beside the line, and nothing else."""
        if self.bends == "as K" or ASYMMETRY in self.shapes:
            return ()
        return self.shapes


def evaluate_polynomials(polynomials: Numbers, x: Array) -> Numbers:
    """Polynomials [n, ..., order + 1] at x [n]: [n, ...]."""
    powers = polynomial.powers(x, polynomials.shape[-1] - 1)
    return np.asarray(np.einsum("n...k,nk->n...", polynomials, powers))


def response(p: Numbers, rows: RateRows, terms: ResponseTerms) -> Numbers:
    """F [n] of equation (1) without its errors."""
    (K, F0, _), x, line = terms.split(p), terms.mapped(rows.row_degc), rows.line
    K_of_row, F0_of_row = evaluate_polynomials(K[line], x), evaluate_polynomials(F0[line], x)
    straight = K_of_row * rows.rate_dps + F0_of_row
    return np.asarray(straight + bend(p, rows, terms))


def bend(p: Numbers, rows: RateRows, terms: ResponseTerms) -> Numbers:
    """Σ c_k(T) s_k(Ω) [n], what the response is beside the line."""
    _, _, c = terms.split(p)
    bends = evaluate_polynomials(c[rows.line], terms.mapped(rows.row_degc))
    return np.asarray(np.sum(bends * terms.shape(rows.rate_dps), axis=1))


def residual(p: Numbers, rows: RateRows, terms: ResponseTerms) -> Numbers:
    """What equation (1) leaves of held rates [n] [1/s]."""
    return response(p, rows, terms) - rows.indication


def best_line(
    terms: ResponseTerms, rate_dps: Array
) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Function from parameters to the polynomials [lines, order + 1] of K and of F0 of the best
    straight line over rates [n].
    """
    line = np.column_stack((rate_dps, np.ones_like(rate_dps)))
    # what the straight line over these rates takes of each shape
    share = np.linalg.pinv(line) @ terms.shape(rate_dps)

    def line_of(p: Numbers) -> tuple[Numbers, Numbers]:
        K, F0, bends = terms.split(p)
        bent = np.einsum("sk,lko->slo", share, bends)
        K, F0, count = K.copy(), F0.copy(), bent.shape[2]
        K[:, :count] += bent[SCALE]
        F0[:, :count] += bent[ZERO]
        return K, F0

    return line_of


def shared_errors(rows: RateRows, terms: ResponseTerms, K: Array, own_K: Array) -> Iterator[Shared]:
    """What differs from run to run, what changes during a run, what the response at a rate is off
    the line in every run, and what differs between the sides of the table, where the likelihood
    asks for it.

    Sizes are relative to the scale factors [channels] of the gyros about the table axes, or about
    their own axes where the error does not act along the turned one.
    """
    # a scale error acts in proportion to the turned rate, a zero along the gyro's own axis
    ppm = K[rows.channel] * ONE_PPM * rows.rate_dps
    dph = own_K[rows.channel] / DPH_PER_DPS
    errors = [
        ("run", "scale", rows.run, ppm, "ppm"),
        ("run", "zero", rows.run, dph, "deg/h"),
    ]
    timed = bool(rows.hours.any())
    if timed:
        errors.append(("run", "zero drift", rows.run, dph * rows.hours, "deg/h/h"))
    # about the mean of the run: K of a run is that at its mean temperature
    warmer = rows.row_degc - rows.temp_degc[rows.run]
    logged = bool(np.isfinite(warmer).all())
    if logged and warmer.any() and not terms.order:
        errors.append(("run", "scale over temperature", rows.run, ppm * warmer, "ppm/degC"))
    elif not logged and timed:
        errors.append(("run", "scale drift", rows.run, ppm * rows.hours, "ppm/h"))
    if rows.both_ways:
        pattern = response_pattern(rows)
        if pattern.size:
            of_rates = (np.abs(K)[rows.channel] / DPH_PER_DPS)[:, None] * pattern
            errors.append(("rate", "response", rows.channel, of_rates, "deg/h"))
        # an error of the table, not of the gyro: each side of each run has its own
        side = 2 * rows.run + (rows.rate_dps < 0.0)
        errors.append(("side", "zero", side, dph, "deg/h"))
        errors.append(("side", "scale", rows.run, np.abs(ppm), "ppm"))
    for group, effect, level, loading, unit in errors:
        yield Shared(
            group=group,
            effect=effect,
            level=level,
            loading=loading.reshape(level.size, -1),
            unit=unit,
            optional=group == "side",
        )


def fit(rows: RateRows, terms: ResponseTerms, shared: Sequence[Shared]) -> ResponseFit:
    """Average of equation (1) over the orders of its polynomials, all with the optional errors that
    the highest asks for; each channel has a noise of its own.
    """

    def fit_order(order: int, errors: Sequence[Shared]) -> Fit:
        # polynomials of K and F0 of this order, and all shapes
        # all orders are fitted in the parameters of the highest, so that their average is one
        # polynomial
        of_line = np.ones(len(terms.names), dtype=np.bool_)
        of_line[: 2 * terms.order + 2] = np.tile(np.arange(terms.order + 1) <= order, 2)
        return solve(
            partial(residual, rows=rows, terms=terms),
            terms.start,
            errors,
            channel=rows.channel,
            free=np.tile(of_line, terms.lines),
            names=terms.names * terms.lines,
        )

    of_highest = fit_order(terms.order, shared)
    # the same errors in all orders: likelihoods of different errors could not be compared
    selected_errors = [replace(size.error, optional=False) for size in of_highest.shared]
    lower = range(min(LOWEST_ORDER, terms.order), terms.order)
    fits = [of_highest, *(fit_order(order, selected_errors) for order in lower)]
    return ResponseFit(orders.average(fits) if lower else of_highest, rows, terms)


@dataclass(frozen=True, slots=True)
class Fits:
    """Fits of equation (1) by their names; where there were fits of nearly the same rows, their
    values with the weights held.
    """

    earlier: Mapping[str, ResponseFit] = field(default_factory=dict)
    by_name: dict[str, ResponseFit] = field(default_factory=dict)

    def fit(
        self, name: str, rows: RateRows, terms: ResponseTerms, shared: Sequence[Shared]
    ) -> ResponseFit:
        """`fit`, or `ResponseFit.refit` of the earlier fit of this name."""
        earlier = self.earlier.get(name)
        self.by_name[name] = earlier.refit(rows) if earlier else fit(rows, terms, shared)
        return self.by_name[name]


def response_pattern(rows: RateRows) -> Array:
    """Columns [n, k] of what the runs of a channel have in common at each rate that two of them
    held, beside a straight line over the rates of all.
    """
    order = np.argsort(rows.rate_dps, kind="stable")
    rate = rows.rate_dps[order]
    far = np.diff(rate) > SAME_RATE * np.abs(rate[1:]) + 1e-6 * np.max(np.abs(rate))
    level = np.empty(rate.size, dtype=np.int64)
    level[order] = np.concatenate(([0], np.cumsum(far)))
    level_and_run = np.unique(np.column_stack((level, rows.channel, rows.run)), axis=0)
    _, first, runs = np.unique(level_and_run[:, :2], axis=0, return_index=True, return_counts=True)
    repeated = np.unique(level_and_run[first[runs > 1], 0])
    at_level = (level[:, None] == repeated).astype(np.float64)
    line, _ = np.linalg.qr(np.column_stack((rows.rate_dps, np.ones(rate.size))))
    left, spread, _ = np.linalg.svd(at_level - line @ (line.T @ at_level), full_matrices=False)
    return np.asarray((left * spread)[:, spread > SAME_RATE], dtype=np.float64)


def find_terms(rows: RateRows, *, varies: bool, bent: bool) -> ResponseTerms:
    """Terms for runs of one gyro: polynomials of temperature where it `varies`, powers of the rate
    where they are wanted (`bent`) and lower the error, and what is beside a straight line.

    Where every run turns both ways, what they have of the response is part of the best straight
    line, and what differs is an error. Runs of one direction each need the powers to share a line.
    """
    levels = polynomial.count_levels(rows.temp_degc) if varies else 1
    order = orders.orders(rows.temp_degc.size, levels, polynomial.HIGHEST_ORDER)[-1]
    # three temperatures show a slope of K and F0
    if levels >= 3:
        order = max(order, LOWEST_ORDER)
    terms = ResponseTerms(
        order=order,
        middle_half=polynomial.middle_and_half(rows.row_degc) if order else (0.0, 1.0),
        fastest_dps=float(np.max(np.abs(rows.rate_dps))),
    )
    if bent:
        # coefficients of powers are polynomials of temperature where K and F0 are
        bends: Literal["constant", "polynomial"] = "polynomial" if order else "constant"
        bent_terms = [replace(terms, shapes=powers, bends=bends) for powers in POWERS]
        best_terms = _best(rows, [terms, *bent_terms], MARGIN)
        if best_terms.powers:
            return best_terms
    asymmetry: tuple[int, ...] = (ASYMMETRY,)
    if rows.both_ways:
        return replace(terms, shapes=asymmetry * rows.shows_asymmetry)
    # |Ω| tells runs of one direction from those of the other only
    asymmetry *= turns_both_ways(rows.rate_dps)
    # and each run hardly tells an odd power from the even one beside it; where the direction goes
    # with the temperature each costs much of K(T), so that it must halve the error
    candidates = [replace(terms, shapes=powers, bends="as K") for powers in ((), *POWERS[1:])]
    best_terms = _best(rows, candidates, 0.5)
    return replace(best_terms, shapes=asymmetry + best_terms.shapes)


def _best(rows: RateRows, candidates: Sequence[ResponseTerms], margin: float) -> ResponseTerms:
    """The first candidate whose rms of e, (2), no later one brings below `margin` times it; it is
    infinite where the rest of the runs does not determine the equation.
    """
    single = not rows.run.any()
    groups = np.round(rows.rate_dps, 3) if single else rows.run
    best_terms, smallest_rms = candidates[0], np.inf
    for terms in candidates:
        design = derivative(partial(residual, rows=rows, terms=terms), terms.start)
        errors = []
        for label in np.unique(groups):
            out = groups == label
            if rank(design[~out]) < design.shape[1]:
                break
            coefficients = np.linalg.lstsq(design[~out], rows.indication[~out])[0]
            error = rows.indication[out] - design[out] @ coefficients
            if not single:
                # K and F0 of a run differ from those of the others: its line tells nothing of the
                # bend
                line = np.column_stack((rows.rate_dps[out], np.ones(error.size)))
                error = error - line @ np.linalg.lstsq(line, error)[0]
            errors.append(error)
        else:
            left_out_rms = rms(np.concatenate(errors))
            if left_out_rms < margin * smallest_rms:
                best_terms, smallest_rms = terms, left_out_rms
    return best_terms
