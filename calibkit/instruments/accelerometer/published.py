"""K0 … K9 as published (Zhou, Hu & Fu 2010), by plain least squares.

Per axis, x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) - (K4 + K5 t + K6 t² + K7 t³) - K8 G_y - K9 G_z

K = P g, P the pseudo-inverse of the design: exact on data that the form made. What K is uncertain
by, P V Pᵀ, comes from the errors of the triad's own fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibkit.arrays import Array
from calibkit.fit.solve import Fit
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.numeric import k_factor
from calibkit.instruments.accelerometer.numeric.k_factor import KTerms
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial


@dataclass(frozen=True, slots=True)
class KAxis:
    """K0 … K9 of one axis, 0 where not fitted."""

    coefficients: Array
    """[10], in powers of °C."""
    covariance: Array
    """[10, 10]."""
    dof: Array
    """[10], effective degrees of freedom."""
    mapped: Array
    """[10], for temperature mapped to [-1, 1]."""
    residual_rms: float
    """Of reference less corrected component [g]."""
    lack_of_fit: float
    """Root mean square [g] of what the form corrects otherwise than the triad."""


def fit_k(dwells: DwellSet, terms: tuple[KTerms, ...], triad: Triad) -> tuple[KAxis, ...]:
    """K of the three axes from the dwells that the triad's fit kept."""
    t = triad.mapped(dwells.temperature)
    used = triad.fit.used.reshape(-1, 3)
    weights = np.ones(used.shape) if dwells.weights is None else dwells.weights
    fitted, blocks = [part.fitted for part in terms], blocks_of(terms)
    form = corrections(terms, dwells.indication, t)
    P = pseudo_inverse(form, np.sqrt(weights) * used)
    whole = triad.fit.linear(P, dwells.reference.ravel()).bounded_by(triad.bounds)
    corrected = triad.terms.corrected(triad.fit.parameters, dwells.indication, t)
    by_form = form @ whole.parameters
    axes = []
    for axis, (numbers, block) in enumerate(zip(fitted, blocks, strict=True)):
        kept, component = used[:, axis], by_form[:, axis]
        left = (dwells.reference[:, axis] - component)[kept]
        spare = max(int(kept.sum()) - len(numbers), 1)
        axes.append(
            _in_degrees(
                whole,
                block,
                numbers,
                triad,
                float(np.sqrt(left @ left / spare)),
                rms((component - corrected[:, axis])[kept]),
            )
        )
    return tuple(axes)


def blocks_of(terms: Sequence[KTerms]) -> list[slice]:
    """Places of the fitted K of each axis among those of all."""
    ends = np.cumsum([0, *(len(part.fitted) for part in terms)])
    return [slice(a, b) for a, b in pairwise(ends.tolist())]


def corrections(terms: Sequence[KTerms], indication: Array, t: Array) -> Array:
    """Design [n, 3, k] of corrected components by the fitted K of all axes, for temperatures t [n]
    in the unit that K is meant for.
    """
    blocks = blocks_of(terms)
    design = np.zeros((len(t), 3, blocks[-1].stop))
    for axis, (part, block) in enumerate(zip(terms, blocks, strict=True)):
        design[:, axis, block] = k_factor.columns(indication, t, axis, part.fitted)
    return design


def pseudo_inverse(design: Array, root: Array) -> Array:
    """P [k, n · 3] of rows of a design [n, 3, k] with weights root² [n, 3]."""
    rows = design.reshape(-1, design.shape[2])
    return np.asarray(np.linalg.pinv(rows * root.reshape(-1, 1)) * root.ravel())


def to_degrees(middle: float, half: float) -> np.ndarray:
    """Matrix [10, 10], in extended precision, from K for temperature mapped to [-1, 1] to K in
    powers of °C.
    """
    matrix = np.eye(10, dtype=np.longdouble)
    matrix[:4, :4] = matrix[4:8, 4:8] = polynomial.to_raw_powers(middle, half, 3)
    return matrix


def _in_degrees(
    whole: Fit,
    block: slice,
    numbers: tuple[int, ...],
    triad: Triad,
    residual_rms: float,
    lack_of_fit: float,
) -> KAxis:
    """One axis in powers of °C, in extended precision because K3 and K7 lose digits in double."""
    mapped, covariance, dof = np.zeros(10), np.zeros((10, 10)), np.full(10, float(whole.dof))
    places = list(numbers)
    mapped[places] = whole.parameters[block]
    covariance[np.ix_(places, places)] = whole.total_covariance[block, block]
    to_raw = to_degrees(triad.middle, triad.half)
    raw, raw_covariance = polynomial.in_raw_powers(mapped, covariance, to_raw)
    inner = np.asarray(to_raw, dtype=np.float64)[np.ix_(places, places)]
    dof[places] = whole.of(lambda p: inner @ p[block]).dof
    return KAxis(raw, raw_covariance, dof, mapped, residual_rms, lack_of_fit)
