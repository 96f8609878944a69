"""Terms of `equation`, (1), that the runs of one gyro ask for: the order over temperature, and
powers of the rate, chosen on runs that are left out.

    e_r = F_r − (fit of the other runs)_r,   less its own line in K and F0 of run r          (1)

Powers are taken where the rms of e over all runs falls below `MARGIN` of that with fewer; with a
single run each rate is left out. A fibre-optic gyro without feedback is a sine whose constants
follow temperature: to ± 150 °/s a cubic leaves 0.11 °/s of it, the fifth power with coefficients
that are linear in temperature 0.03 °/s; with their squares K(T) is right too (`equation`).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from calibkit.fit import orders
from calibkit.fit.complex_step import derivative
from calibkit.instruments.gyro_scale import equation
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import rank

POWERS = ((3,), (2, 3), (2, 3, 4, 5), (2, 3, 4, 5, 6, 7))
"""What is compared with the line alone, the simplest first."""
MARGIN = 0.9
"""Factor by which more powers must lower the error: of 40 straight lines one standard error of the
difference by groups, as drift models are chosen by, lets more than four be bent, this factor fewer.
"""


def find_terms(rows: equation.RateRows, *, varies: bool, bent: bool) -> equation.ResponseTerms:
    """Terms for runs of one gyro: polynomials of temperature where it `varies`, powers of the rate
    where they are wanted (`bent`) and lower the error, and what is beside a straight line.

    Where every run turns both ways, what they have of the response is part of the best straight
    line, and what differs is an error. Runs of one direction each need the powers to share a line.
    """
    levels = np.unique(np.round(rows.temp_degc)).size if varies else 1
    order = orders.orders(rows.temp_degc.size, levels, polynomial.HIGHEST_ORDER)[-1]
    # three temperatures show a slope of K and F0
    if levels >= 3:
        order = max(order, equation.LOWEST_ORDER)
    terms = equation.ResponseTerms(
        order=order,
        middle_half=polynomial.middle_and_half(rows.row_degc) if order else (0.0, 1.0),
        fastest_dps=float(np.max(np.abs(rows.rate_dps))),
    )
    if bent:
        bent_terms = choose(rows, terms)
        if bent_terms.powers:
            return bent_terms
    asymmetry: tuple[int, ...] = (equation.ASYMMETRY,)
    if rows.both_ways:
        return replace(terms, shapes=asymmetry * rows.shows_asymmetry)
    # |Ω| tells runs of one direction from those of the other only
    asymmetry *= equation.turns_both_ways(rows.rate_dps)
    # and each run hardly tells an odd power from the even one beside it
    candidates = [replace(terms, shapes=powers, bends="as K") for powers in ((), *POWERS[1:])]
    best_terms = _best(rows, candidates, 0.5)
    return replace(best_terms, shapes=asymmetry + best_terms.shapes)


def choose(rows: equation.RateRows, terms: equation.ResponseTerms) -> equation.ResponseTerms:
    """Terms with the powers that the runs of one gyro ask for; their coefficients are polynomials
    of temperature where K and F0 are.
    """
    bends: Literal["constant", "polynomial"] = "polynomial" if terms.order else "constant"
    bent = [replace(terms, shapes=powers, bends=bends) for powers in POWERS]
    return _best(rows, [terms, *bent], MARGIN)


def _best(
    rows: equation.RateRows, candidates: Sequence[equation.ResponseTerms], margin: float
) -> equation.ResponseTerms:
    """The first candidate whose rms error at left-out runs (at left-out rates of a single run) no
    later one brings below `margin` times it.
    """
    best_terms, smallest_rms = candidates[0], _left_out_rms(rows, candidates[0])
    for terms in candidates[1:]:
        error = _left_out_rms(rows, terms)
        if error < margin * smallest_rms:
            best_terms, smallest_rms = terms, error
    return best_terms


def _left_out_rms(rows: equation.RateRows, terms: equation.ResponseTerms) -> float:
    """Root mean square error at runs, or rates of a single run, that are left out; infinite where
    the rest does not determine the equation.
    """
    design = derivative(partial(equation.residual, rows=rows, terms=terms), terms.start)
    single = not rows.run.any()
    groups = np.round(rows.rate_dps, 3) if single else rows.run
    errors = []
    for label in np.unique(groups):
        out = groups == label
        if rank(design[~out]) < design.shape[1]:
            return np.inf
        coefficients = np.linalg.lstsq(design[~out], rows.indication[~out])[0]
        error = rows.indication[out] - design[out] @ coefficients
        if not single:
            # K and F0 of a run differ from those of the others: its line tells nothing of the bend
            line = np.column_stack((rows.rate_dps[out], np.ones(error.size)))
            error = error - line @ np.linalg.lstsq(line, error)[0]
        errors.append(error)
    return rms(np.concatenate(errors))
