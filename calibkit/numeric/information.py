"""What a planned campaign will tell of coefficients, beside errors that its rows share.

    y = X β + Z b + ε,   b_j ~ N(0, 1/d_j),   ε ~ N(0, σ²)
    M = [X Z]ᵀ [X Z] / σ² + diag(0, d),   cov(β, b − b_predicted) = M⁻¹

Shared errors and errors of the equipment are parameters with priors, so that the covariance of β is
that of generalised least squares, (Xᵀ V⁻¹ X)⁻¹. It is the sum M⁻¹ (data + Σ priors) M⁻¹ of what
noise and each source of errors leave.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric.least_squares.components import Effect

NOISE = "noise"
"""Source of what is not shared."""
UNDETERMINED = 1e-11
"""Smallest eigenvalue of the scaled information, relative to the largest, that determines all."""


@dataclass(frozen=True, slots=True)
class Information:
    """Information of rows on p coefficients and on the errors that they share."""

    data: Array
    """[q, q], the p coefficients first."""
    prior: Array
    """[q], precision of each error; 0 for the coefficients."""
    source: Integers
    """[q], number of the source of each error among `sources`; −1 for the coefficients."""
    sources: tuple[str, ...]

    @property
    def determined(self) -> bool:
        """Whether all coefficients are determined."""
        whole = self.data + np.diag(self.prior)
        size = np.sqrt(np.diag(whole))
        if not (size > 0.0).all():
            return False
        values = np.linalg.eigvalsh(whole / np.outer(size, size))
        return bool(values[0] > UNDETERMINED * values[-1])

    @property
    def covariance(self) -> Array:
        """Covariance [p, p] of the coefficients; LinAlgError where they are not determined."""
        count = int(np.sum(self.source < 0))
        return invert(self.data + np.diag(self.prior))[:count, :count]

    def join(self, other: "Information") -> "Information":
        """Information of these rows and of others that share none of their errors."""
        p, q = int(np.sum(self.source < 0)), self.source.size
        at = np.concatenate([np.arange(p), np.arange(q, q + other.source.size - p)])
        data = np.zeros((q + other.source.size - p,) * 2)
        data[:q, :q] += self.data
        data[np.ix_(at, at)] += other.data
        sources = tuple(dict.fromkeys([*self.sources, *other.sources]))
        number = np.array([sources.index(one) for one in other.sources], dtype=np.int64)
        return Information(
            data,
            np.concatenate([self.prior, other.prior[p:]]),
            np.concatenate([self.source, number[other.source[p:]]]),
            sources,
        )

    def variances(self, slopes: Array) -> dict[str, Array]:
        """Variance [m] that noise and each source leave in combinations [m, p] of the
        coefficients; their sum is the variance of the combination.
        """
        pull = invert(self.data + np.diag(self.prior))[:, : slopes.shape[1]] @ slopes.T
        found = {NOISE: np.einsum("qm,qr,rm->m", pull, self.data, pull)}
        for number, name in enumerate(self.sources):
            own = self.source == number
            found[name] = np.sum(self.prior[own, None] * pull[own] ** 2, axis=0)
        return found


def invert(matrix: Array) -> Array:
    """Inverse [..., q, q] of information matrices whose columns differ in size."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    outer = size[..., :, None] * size[..., None, :]
    return np.asarray(np.linalg.inv(matrix / outer) / outer, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Stacked:
    """Derivatives of rows by coefficients and by the errors that they share, in units of noise."""

    rows: Array
    """[n, q]."""
    prior: Array
    """[q], as in `Information`."""
    source: Integers
    sources: tuple[str, ...]


def stack(design: Array, noise: float, effects: Sequence[Effect]) -> Stacked:
    """Rows of a design [n, p] with a noise [unit of the rows] and effects whose sizes are known; an
    effect of size 0, or of unknown size, is absent.
    """
    count = design.shape[1]
    blocks, prior, source = [design], [np.zeros(count)], [np.full(count, -1)]
    sources: list[str] = []
    for effect in effects:
        size = 0.0 if effect.known is None else effect.known.value
        if size > 0.0:
            blocks.append(_spread_levels(effect))
            width = blocks[-1].shape[1]
            prior.append(np.full(width, size**-2.0))
            source.append(np.full(width, len(sources)))
            sources.append(f"{effect.effect} of the {effect.group}")
    return Stacked(
        np.column_stack(blocks) / noise,
        np.concatenate(prior),
        np.concatenate(source),
        tuple(sources),
    )


def find_information(design: Array, noise: float, effects: Sequence[Effect]) -> Information:
    """Information of rows, given as for `stack`."""
    found = stack(design, noise, effects)
    return Information(found.rows.T @ found.rows, found.prior, found.source, found.sources)


def _spread_levels(effect: Effect) -> Array:
    """Loadings [n, levels · k] of an effect; the k effects of a level stand side by side."""
    width, rows = effect.width, np.flatnonzero(effect.labels >= 0)
    found = np.zeros((len(effect.labels), (int(effect.labels.max(initial=-1)) + 1) * width))
    at = effect.labels[rows, None] * width + np.arange(width)
    found[rows[:, None], at] = effect.loading[rows].reshape(rows.size, width)
    return found
