"""Average over the orders of a polynomial (Buckland, Burnham & Augustin 1997).

    w_k ∝ exp(-½ AIC_k),   AIC_k = -2 log L_k + 2 (coefficients + sizes)                    (1)
    β̄ = Σ w_k β_k,   V̄ = Σ w_k [V_k + (β_k - β̄)(β_k - β̄)ᵀ],   ν(c) = Σ w_k ν_k(c)           (2)

An order that is chosen, by whatever test, is taken for the true one: intervals of s(T) then hold
52 to 93 % of the truth where the true slope is as large as its noise, those of (2) 93 to 97 %. β̄ is
one polynomial of the highest order, with one covariance.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibkit.fit import likelihood
from calibkit.fit.solve import Fit
from calibkit.numeric.arrays import Array

SPARE = 2
"""Fewest runs, stations or logs that an order leaves over: with one, its residuals, and so its
likelihood, say nothing of the noise.
"""


def orders(count: int, levels: int, highest: int) -> range:
    """Orders, from 0, of which an average is made: of `count` runs, stations or logs that stand at
    `levels` different values.
    """
    return range(max(min(highest, levels - 1, count - 1 - SPARE), 0) + 1)


def average(fits: Sequence[Fit]) -> Fit:
    """Average of the fits of several orders to the same rows, each in the parameters of the highest
    order (`solve(…, free=mask)`); `Fit.of` states its uncertainty.

    Raises ValueError for fits of different rows, or with different optional errors.
    """
    first = fits[0]
    for fit in fits:
        if not np.array_equal(fit.used, first.used) or fit.slopes.shape != first.slopes.shape:
            raise ValueError("orders are compared on the same rows, with the same shared errors")
    aic = np.zeros(len(fits))
    for k, fit in enumerate(fits):
        coefficients = int(fit.used.sum()) - fit.dof
        sizes = int(np.sum(fit.solution.rows.known.free))
        # not the restricted likelihood, which cannot be compared between designs
        aic[k] = likelihood.unrestricted(fit.solution) + 2.0 * (coefficients + sizes)
    weights = np.exp(-0.5 * (aic - aic.min()))
    weights /= weights.sum()

    def mean(field: str) -> Array:
        return np.tensordot(weights, [getattr(fit, field) for fit in fits], 1)

    parameters = mean("parameters")
    spread = np.array([fit.parameters - parameters for fit in fits])
    likeliest, shared = fits[int(np.argmax(weights))], []
    for members in zip(*(fit.shared for fit in fits), strict=True):
        # the variance of a shared error is the mean of the members'
        value = float(np.sqrt(weights @ [size.value**2 for size in members]))
        u, dof = float(weights @ [size.u for size in members]), min(size.dof for size in members)
        shared.append(replace(members[0], value=value, u=u, dof=dof))
    return replace(
        likeliest,
        parameters=parameters,
        covariance=mean("covariance") + (weights[:, None] * spread).T @ spread,
        residual=mean("residual"),
        noise_residual=mean("noise_residual"),
        shared=tuple(shared),
        converged=all(fit.converged for fit in fits),
        variances=mean("variances"),
        variance_covariance=mean("variance_covariance"),
        slopes=mean("slopes"),
        gain=mean("gain"),
        bounds=mean("bounds"),
        members=tuple(fits),
        weights=weights,
    )
