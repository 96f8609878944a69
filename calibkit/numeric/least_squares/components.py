"""Linear least squares with errors that observations share: variance components.

    y = X β + Σ_g Z_g b_g + ε,   b_g ~ N(0, θ_g I),   ε ~ N(0, σ² W⁻¹)

Variances by restricted maximum likelihood (Patterson & Thompson 1971), coefficients by generalised
least squares, covariance corrected for the estimation of the variances (Kenward & Roger 1997),
degrees of freedom of a combination of coefficients by Satterthwaite's rule. What is needed of n
rows is reduced to matrices of the size of the groups, so that cost grows as n (p + q)², q the
number of levels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit as least_squares
from calibkit.numeric.least_squares.restricted import Prior, Reduced, Solution

ROUNDING = 1e-11
"""Residuals this small, relative to the indications, are rounding: nothing is estimated of them."""
LEAST_DOF = 1.0
"""Fewest effective degrees of freedom: below, an interval is not wider but meaningless."""


@dataclass(frozen=True, slots=True)
class Known:
    """A standard deviation that is stated, or pooled from earlier runs."""

    value: float
    """[unit of the indication, or per unit of the loading]."""
    dof: float = float("inf")
    """Degrees of freedom of the value; infinite where it is taken as exact."""
    bound: bool = False
    """Whether the value is merely larger than the error can be: then it is no result."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An error that all rows of a level share, as a random effect."""

    group: str
    """What the rows of a level have in common: "soak", "run", "attitude"."""
    effect: str
    """What differs from level to level: "zero", "scale", "index"."""
    labels: Integers
    """[n], level of each row, from 0; −1 for a row that has none."""
    loading: Array
    """[n] or [n, k], derivative of the indication by the effect; k effects of one variance."""
    known: Known | None = None

    @property
    def width(self) -> int:
        """Effects of one level."""
        return 1 if self.loading.ndim == 1 else self.loading.shape[1]

    def of_rows(self, rows: Mask) -> "Effect":
        """The effect on some of the rows [n]."""
        return Effect(self.group, self.effect, self.labels[rows], self.loading[rows], self.known)


@dataclass(frozen=True, slots=True)
class Component:
    """Standard deviation of an error that rows share."""

    group: str
    effect: str
    value: float
    standard_uncertainty: float
    groups: int
    """Number of levels."""
    dof: int
    """Levels less what the coefficients take from them; 0 where the data cannot tell the effect
    from the coefficients.
    """
    known: bool
    """Whether its size was stated or pooled, not estimated alone."""


@dataclass(frozen=True, slots=True)
class MixedFit:
    """A finished fit with variance components."""

    coefficients: Array
    covariance: Array
    """[p, p], type A, with what the estimation of the variances adds."""
    residuals: Array
    """[n], indication less design · coefficients: shared errors are part of them."""
    dof: int
    residual_rms: float
    """Standard deviation of the errors that are not shared, for a row of weight 1."""
    condition: float
    components: tuple[Component, ...]
    deviance: float
    """−2 × restricted log-likelihood, for fits of the same design to the same rows."""
    predicted: tuple[Array, ...]
    """Shared errors [levels, k] of each effect, as the rows show them."""
    _solution: Solution

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [p] of the coefficients, type A."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def variances(self) -> Array:
        """Variance of the noise and of each effect [1 + g]."""
        return self._solution.variances

    @property
    def effective_dof(self) -> Array:
        """Effective degrees of freedom [p] of the coefficients."""
        return self.effective_dof_of(np.eye(len(self.coefficients)))

    def shared(self, effects: Sequence[Effect]) -> Array:
        """Shared errors [m] of any rows of the same effects; 0 for a level that the fit has not
        seen.
        """
        total = np.zeros(len(effects[0].labels)) if effects else np.zeros(1)
        for effect, part in zip(effects, self.predicted, strict=True):
            seen = (effect.labels >= 0) & (effect.labels < len(part))
            loading = effect.loading.reshape(len(total), -1)[seen]
            total[seen] += np.sum(loading * part[effect.labels[seen]], axis=1)
        return total

    def effective_dof_of(self, combinations: Array) -> Array:
        """Effective degrees of freedom [m] of combinations [m, p] of the coefficients: 2 v²/var(v)
        (Satterthwaite 1946; Giesbrecht & Burns 1985), at least 1 and at most those of the rows.
        """
        found = self._solution
        slopes = np.einsum("mp,ipq,mq->im", combinations, found.slopes, combinations)
        variance = found.variances @ slopes
        spread = np.einsum("im,ij,jm->m", slopes, found.variance_covariance, slopes)
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(spread > 0.0, 2.0 * variance**2 / spread, self.dof)
        return np.clip(dof, LEAST_DOF, max(self.dof, LEAST_DOF))


def fit(
    design: Array,
    indication: Array,
    effects: Sequence[Effect],
    *,
    weights: Array | None = None,
    names: Sequence[str] = (),
    near: MixedFit | None = None,
) -> MixedFit:
    """Fit indication = design · coefficients with errors that rows share.

    Parameters
    ----------
    design : [n, p].
    indication : [n].
    effects : shared errors; one that the data cannot tell from the coefficients and whose size is
        not known has no part in the covariance, and a component with 0 degrees of freedom.
    weights : [n], proportional to 1/variance of the errors that are not shared.
    names : what an error calls the coefficients that the data cannot determine.
    near : fit of the same effects to nearly the same rows, from whose variances the search begins.

    Raises
    ------
    FitError : as `fit.linear`; n = p.

    """
    plain = least_squares.linear(design, indication, weights=weights, names=names)
    if not plain.dof:
        raise FitError(
            f"{len(indication)} rows for {design.shape[1]} coefficients leave no residual",
            hint="add data or lower the order",
        )
    root = np.ones(len(indication)) if weights is None else np.sqrt(weights)
    reduced = _reduce(design, plain, effects, root)
    exact = plain.residual_rms <= ROUNDING * float(np.max(np.abs(indication)))
    dof = [0 if exact else reduced.degrees(g) for g in range(len(effects))]
    priors = [_prior(effect, rank) for effect, rank in zip(effects, dof, strict=True)]
    found = reduced.solve(plain.coefficients, priors, near.variances if near else None)
    levels = [_levels(effect) for effect in effects]
    return MixedFit(
        coefficients=found.coefficients,
        covariance=found.covariance,
        residuals=indication - design @ found.coefficients,
        dof=plain.dof,
        residual_rms=float(np.sqrt(found.variances[0] * len(root) / np.sum(root**2))),
        condition=plain.condition,
        components=_components(effects, levels, dof, found),
        deviance=found.deviance,
        predicted=tuple(
            found.shared[reduced.member == g].reshape(-1, effect.width)
            for g, effect in enumerate(effects)
        ),
        _solution=found,
    )


def _components(
    effects: Sequence[Effect], levels: Sequence[int], dof: Sequence[int], found: Solution
) -> tuple[Component, ...]:
    """Standard deviations of the effects."""
    variances = found.variances[1:]
    spread = np.sqrt(np.maximum(np.diag(found.variance_covariance)[1:], 0.0))
    return tuple(
        Component(
            effect.group,
            effect.effect,
            float(np.sqrt(theta)),
            # of a standard deviation from that of its square; near 0 the square alone tells
            float(u / (2.0 * np.sqrt(theta)) if theta > u else np.sqrt(u)),
            count,
            degrees,
            effect.known is not None,
        )
        for effect, count, degrees, theta, u in zip(
            effects, levels, dof, variances, spread, strict=True
        )
        if effect.known is None or not effect.known.bound
    )


def _prior(effect: Effect, degrees: int) -> Prior:
    """What is known of an effect; without degrees of freedom the data do not add to it, and what is
    not known is held at 0.
    """
    known = effect.known
    if known is not None and known.value > 0.0 and degrees:
        return Prior(known.value**2, known.dof)
    if known is not None:
        return Prior(known.value**2, np.inf)
    return Prior() if degrees else Prior(0.0, np.inf)


def _levels(effect: Effect) -> int:
    """Number of levels of an effect."""
    return int(effect.labels.max(initial=-1)) + 1


def _spread(effects: Sequence[Effect], root: Array) -> Any:  # noqa: ANN401 (a sparse array)
    """Sparse loadings [n, q] of effects on rows times `root` [n]; the k effects of a level stand
    side by side.
    """
    from scipy import sparse

    values, rows, columns, first = [np.empty(0)], [], [], 0
    for effect in effects:
        width, seen = effect.width, np.flatnonzero(effect.labels >= 0)
        values.append((effect.loading[seen].T * root[seen]).T.ravel())
        rows.append(np.repeat(seen, width))
        columns.append((first + effect.labels[seen, None] * width + np.arange(width)).ravel())
        first += _levels(effect) * width
    none = np.empty(0, np.intp)
    at = np.concatenate([none, *rows]), np.concatenate([none, *columns])
    return sparse.csr_array((np.concatenate(values), at), shape=(len(root), first))


def _reduce(
    design: Array, plain: least_squares.LinearFit, effects: Sequence[Effect], root: Array
) -> Reduced:
    """Rows weighted by `root`² [n] reduced to the levels of the effects."""
    shared = _spread(effects, root)
    products = (shared.T @ shared).toarray()
    weighted = design * root[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    q, r = np.linalg.qr(weighted / scale)
    across = np.asarray(shared.T @ q).T
    left = plain.residuals * root
    largest = float(np.max(np.abs(weighted @ plain.coefficients + left)))
    inverse = least_squares.triangular(r, np.eye(len(scale))) / scale[:, None]
    return Reduced(
        whole=np.diag(products),
        between=products - across.T @ across,
        target=np.asarray(shared.T @ left),
        square=float(left @ left),
        spare=plain.dof,
        least=max((ROUNDING * largest) ** 2, float(np.finfo(np.float64).tiny)),
        member=np.repeat(np.arange(len(effects)), [_levels(e) * e.width for e in effects]),
        into=inverse @ across,
        basis=inverse @ inverse.T,
    )
