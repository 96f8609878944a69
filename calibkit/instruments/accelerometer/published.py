"""K0 … K9 as published (Zhou, Hu & Fu 2010), by plain least squares.

Per axis, x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) - (K4 + K5 t + K6 t² + K7 t³) - K8 G_y - K9 G_z

K = P g, P the pseudo-inverse of the design: exact on data that the form made. What K is uncertain
by, P V Pᵀ, comes from the errors of the triad's own fit.
"""

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
    t = triad.mapped_all(dwells.temperature)
    used = triad.fit.used.reshape(-1, 3)
    weights = np.ones(used.shape) if dwells.weights is None else dwells.weights
    fitted = [part.fitted for part in terms]
    ends = np.cumsum([0, *map(len, fitted)])
    blocks = [slice(a, b) for a, b in pairwise(ends.tolist())]
    P = np.zeros((ends[-1], len(t), 3))
    designs = []
    for axis, (numbers, block) in enumerate(zip(fitted, blocks, strict=True)):
        design = k_factor.columns(dwells.indication, t, axis, numbers)
        root = np.sqrt(weights[:, axis]) * used[:, axis]
        P[block, :, axis] = np.linalg.pinv(design * root[:, None]) * root
        designs.append(design)
    whole = triad.fit.linear(P.reshape(ends[-1], -1), dwells.reference.ravel())
    whole = whole.bounded_by(triad.bounds)
    corrected = triad.terms.corrected(triad.fit.parameters, dwells.indication, t)
    axes = []
    for axis, (numbers, block) in enumerate(zip(fitted, blocks, strict=True)):
        form = designs[axis] @ whole.parameters[block]
        kept = used[:, axis]
        left = (dwells.reference[:, axis] - form)[kept]
        spare = max(int(kept.sum()) - len(numbers), 1)
        axes.append(
            _in_degrees(
                whole,
                block,
                numbers,
                triad,
                float(np.sqrt(left @ left / spare)),
                rms((form - corrected[:, axis])[kept]),
            )
        )
    return tuple(axes)


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
    to_raw = np.eye(10, dtype=np.longdouble)
    to_raw[:4, :4] = to_raw[4:8, 4:8] = polynomial.to_raw_powers(triad.middle, triad.half, 3)
    raw, raw_covariance = polynomial.in_raw_powers(mapped, covariance, to_raw)
    inner = np.asarray(to_raw, dtype=np.float64)[np.ix_(places, places)]
    dof[places] = whole.of(lambda p: inner @ p[block]).dof
    return KAxis(raw, raw_covariance, dof, mapped, residual_rms, lack_of_fit)
