"""Optimal design of experiments: what each dwell, held rate or station that a plan may take tells
of the parameters.

    y = J p + Z b + e,   b ~ N(0, size²),   e ~ N(0, σ²)        one row of J and Z an observation
    M = Rᵀ R + diag(0, I),   R = [J, Z size] / σ                 information of p and of b/size

Shared errors are parameters with priors, in units of their sizes, so that the inverse of M holds
the covariance of generalised least squares, and the information of rows adds up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.exchange import Pool

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.fit.shared import Shared


def pool(
    jacobian: Array,
    shared: Sequence[Shared],
    single: Sequence[Shared],
    noise: Array,
    candidate: Integers,
    slopes: Array,
) -> Pool:
    """Candidates, each of the same number of rows; the search makes the mean variance of m
    combinations of the parameters small (I-optimality).

    Parameters
    ----------
    jacobian : [n, p].
    shared, single : errors that candidates share, and that each has of its own, with their sizes.
    noise : [n].
    candidate : [n], number of the candidate of each row.
    slopes : [m, p].

    """
    p = jacobian.shape[1]
    every = np.arange(len(noise))
    columns = [error.design(every) * (error.size or 0.0) for error in shared]
    rows = np.hstack([jacobian, *columns]) / noise[:, None]
    order, count = np.argsort(candidate, kind="stable"), int(candidate.max()) + 1
    parts = rows[order].reshape(count, -1, rows.shape[1])
    single_loadings = [error.loading * (error.size or 0.0) / noise[:, None] for error in single]
    z = np.hstack([np.zeros((len(rows), 0)), *single_loadings])[order].reshape(*parts.shape[:2], -1)
    # (I + z zᵀ)⁻¹ = I - z (I + zᵀ z)⁻¹ zᵀ
    across = np.einsum("crk,crq->ckq", z, parts)
    inner = np.einsum("crk,crl->ckl", z, z) + np.eye(z.shape[2])
    each = np.einsum("crq,crs->cqs", parts, parts)
    each -= np.einsum("ckq,ckl,cls->cqs", across, np.linalg.inv(inner), across)
    start = np.diag(np.arange(rows.shape[1]) >= p).astype(np.float64)
    target = np.zeros_like(start)
    target[:p, :p] = slopes.T @ slopes / len(slopes)
    return Pool(start, each, target)


def spread_apart(directions: Array, taken: Sequence[int], count: int) -> list[int]:
    """Directions [count] of unit vectors [c, 3] that lie farthest from those that are taken."""
    chosen, near = [], (directions @ directions[list(taken)].T).max(axis=1)
    for _ in range(min(count, len(directions) - len(taken))):
        chosen.append(int(np.argmin(np.round(near, 9))))
        near = np.maximum(near, directions @ directions[chosen[-1]])
    return chosen
