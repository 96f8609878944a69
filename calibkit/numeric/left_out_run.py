"""One run against the others: a value over temperature that the others do not let expect.

    F = e² / (s² (1 + z (XᵀX)⁻¹ zᵀ)) against F(1, ν),   s² = max(RSS/ν, u²)

e is the departure of the left-out run from the polynomial through the others, z its powers of
temperature, RSS and ν those of their fit (deleted residual; Cook & Weisberg 1982).
"""

from collections.abc import Iterator

import numpy as np

from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.least_squares import polynomial

CHANCE, DEGF_CHANCE = 0.001, 1e-4
"""Probability with which a run of a faultless campaign is named, of all its runs together, and with
which a change of unit is, which is refused.

In 2160 sound campaigns of 6 to 12 runs of 1 ppm scatter (straight and bent K(T), sessions 20 and 50
ppm apart, thermometers 0.1 °C off) no unit is called wrong, a run contradicts the others in 5.
"""
SPARE, EXACT = 2, 1e-9
"""Degrees of freedom that are left for the scatter, at least; relative scatter of values that have
none but rounding.
"""


def find(temp_degc: Array, values: Array, u: Array) -> Iterator[tuple[int, float, bool]]:
    """Runs whose value [n] with the standard uncertainty [n] of its noise contradicts the others
    over temperature [n, °C], each left out in turn: number of the run, its value less that of the
    others at its temperature [unit of the values], and whether the rest carries as high an order as
    all runs do: else a bend would explain it.
    """
    from scipy.special import fdtrc

    highest = _order(temp_degc, np.ones(values.size, dtype=np.bool_))
    for run in range(values.size):
        other_runs = np.arange(values.size) != run
        order = _order(temp_degc, other_runs)
        # a slope that hangs on this one run is no evidence against it
        if order < min(max(highest, 0), 1):
            continue
        design = _powers(temp_degc, order)
        coefficients, variance, dof = _fit(design[other_runs], values[other_runs], u[other_runs])
        leverage = (
            design[run] @ np.linalg.pinv(design[other_runs].T @ design[other_runs]) @ design[run]
        )
        departure = float(values[run] - design[run] @ coefficients)
        # Bonferroni: the chance is that of all runs together
        if fdtrc(1, dof, departure**2 / (variance * (1.0 + leverage))) < CHANCE / values.size:
            yield run, departure, order == highest


def find_degf(temp_degc: Array, values: Array, u: Array) -> Mask:
    """Which runs [n] are in °F: one, or all from one on, whose change to °C leaves so little of
    the misfit that it is no chance; none where the runs do not tell.
    """
    from scipy.special import fdtrc

    count = values.size
    # a mistyped unit is that of one run; a changed setting of the logger is that of all later ones
    in_degf = np.concatenate([np.eye(count, dtype=np.bool_), np.tri(count, dtype=np.bool_).T[1:-1]])
    all_runs = np.ones(count, dtype=np.bool_)
    order = _order(temp_degc, all_runs)
    if order < 1:
        return ~all_runs
    _, variance, dof = _fit(_powers(temp_degc, order), values, u)
    chances = []
    for degf_runs in in_degf:
        # what the temperatures would be in °C
        degc = np.where(degf_runs, (temp_degc - 32.0) / 1.8, temp_degc)
        common_order = min(order, _order(degc, all_runs))
        _, degc_variance, degc_dof = _fit(_powers(degc, common_order), values, u)
        chances.append(float(fdtrc(dof, degc_dof, variance / degc_variance)))
    best = int(np.argmin(chances))
    return np.asarray(in_degf[best] & (chances[best] < DEGF_CHANCE / len(chances)), dtype=np.bool_)


def _order(temp_degc: Array, runs: Mask) -> int:
    """Highest order that some runs carry, with degrees of freedom to spare; -1 for none."""
    levels = polynomial.count_levels(temp_degc[runs])
    spare = int(np.count_nonzero(runs)) - 1 - SPARE
    return max(min(polynomial.HIGHEST_ORDER, levels - 1, spare), -1)


def _powers(temp_degc: Array, order: int) -> Array:
    """Powers [n, order + 1] of the mapped temperatures [n]."""
    middle, half = polynomial.middle_and_half(temp_degc)
    return polynomial.powers(temp_degc, order, middle=middle, half=half or 1.0)


def _fit(design: Array, values: Array, u: Array) -> tuple[Array, float, int]:
    """Coefficients, variance of the scatter, of noise at least, and its degrees of freedom."""
    coefficients = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    dof = values.size - design.shape[1]
    scatter = float(np.sum((values - design @ coefficients) ** 2)) / dof
    # runs that agree by chance do not make the next one an outlier
    noise_variance = float(np.mean(u**2) + (EXACT * np.max(np.abs(values))) ** 2)
    return coefficients, max(scatter, noise_variance), dof
