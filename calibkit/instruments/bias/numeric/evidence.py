"""Linear regression with Gaussian priors whose variances follow from the marginal likelihood
(MacKay 1992, Neural Computation 4:415; with a flat prior on a column it is REML).

    y = Z β + e,  e ~ N(0, I) after whitening
    β_j ~ N(0, shape_j · v_g(j)),  ln v = M θ,  θ ~ N(m, S²)

Why not `fit.solve` with `Prior`: the logs of a bank leave some variances open by decades, so that
results are averaged over θ, where `solve` takes the most likely variances; and one posterior takes
it 170 ms instead of 6 (eight ramps), of which the choice of a bank needs some twenty.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.numeric.arrays import Array, Integers

ITERATIONS = 40
LARGEST_STEP = 1.5
"""Largest change of the logarithm of a variance in one iteration."""
CLOSE = 1e-3
"""Increase of the logarithm of the evidence below which the iteration ends."""
HALVINGS = 8
FLAT = -1
"""Group of a column with a flat prior."""


@dataclass(frozen=True, slots=True)
class Gram:
    """Moments of rows whose noise has variance 1: Z'Z [p, p], Z'y [p] and y'y."""

    matrix: Array
    right: Array
    square: float

    @classmethod
    def of(cls, Z: Array, y: Array) -> "Gram":
        """Of rows Z [n, p] and y [n]."""
        return cls(Z.T @ Z, Z.T @ y, float(y @ y))


@dataclass(frozen=True, slots=True)
class VariancePrior:
    """Groups of the columns, shapes of their variances, and what is known of the variances."""

    group: Integers
    """[p], index of a variance, or FLAT."""
    shape: Array
    """[p]."""
    mixing: Array
    """M [variances, θ]."""
    mean: Array
    """[θ]."""
    spread: Array
    """[θ], standard deviations of θ."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Coefficients [p] with covariance [p, p] at θ, logarithm of the evidence with the prior of θ,
    and the covariance of θ (Laplace).
    """

    theta: Array
    coefficients: Array
    covariance: Array
    log_evidence: float
    theta_covariance: Array

    @property
    def log_integral(self) -> float:
        """Logarithm of the evidence integrated over θ (Laplace), up to a constant."""
        # ∫ exp(f) ≈ exp(f_max) √det(2π C); 2π is the same for models of equal θ
        return self.log_evidence + 0.5 * float(np.linalg.slogdet(self.theta_covariance)[1])


def log_variances(prior: VariancePrior, theta: Array) -> Array:
    """Logarithms of the prior variances [p]; infinite for a flat prior."""
    has_variance = prior.group != FLAT
    log_v = np.full(prior.group.size, np.inf)
    log_v[has_variance] = (prior.mixing @ theta)[prior.group[has_variance]] + np.log(
        prior.shape[has_variance]
    )
    return log_v


def condition(gram: Gram, prior: VariancePrior, theta: Array) -> tuple[Array, Array, float]:
    """Coefficients [p], covariance [p, p] and logarithm of the evidence (with the prior of θ) for
    given variances.
    """
    log_v = log_variances(prior, theta)
    # columns in units of their prior, flat ones in units of their length
    scale = np.where(np.isinf(log_v), 1.0 / np.sqrt(np.maximum(np.diag(gram.matrix), 1e-300)), 0.0)
    scale[scale == 0.0] = np.exp(0.5 * log_v[scale == 0.0])
    # so scaled, prior variances of many decades leave the matrix well conditioned
    information = gram.matrix * np.outer(scale, scale)
    information[np.diag_indices_from(information)] += np.isfinite(log_v)
    root = np.linalg.cholesky(information)
    inverse = np.linalg.inv(root)
    whitened = inverse @ (gram.right * scale)
    covariance = inverse.T @ inverse * np.outer(scale, scale)
    log_evidence = -0.5 * (
        gram.square - whitened @ whitened + 2.0 * np.sum(np.log(np.diag(root)))
    ) - 0.5 * np.sum(((theta - prior.mean) / prior.spread) ** 2)
    return inverse.T @ whitened * scale, covariance, float(log_evidence)


def _score(
    prior: VariancePrior, theta: Array, mean: Array, covariance: Array
) -> tuple[Array, Array]:
    """Gradient [θ] of the logarithm of the evidence by θ, and its expected information [θ, θ],
    both with the prior.
    """
    columns = np.flatnonzero(prior.group != FLAT)
    root = np.exp(0.5 * log_variances(prior, theta)[columns])
    left = np.eye(columns.size) - covariance[np.ix_(columns, columns)] / np.outer(root, root)
    members = (prior.group[columns] == np.arange(prior.mixing.shape[0])[:, None]).astype(np.float64)
    gradient = 0.5 * members @ ((mean[columns] / root) ** 2 - np.diag(left))
    information = 0.5 * members @ left**2 @ members.T
    precision = prior.spread**-2.0
    return (
        prior.mixing.T @ gradient - (theta - prior.mean) * precision,
        prior.mixing.T @ information @ prior.mixing + np.diag(precision),
    )


def maximise(gram: Gram, prior: VariancePrior, start: Array | None = None) -> Posterior:
    """Variances of the largest evidence by Fisher scoring, and the posterior at them."""
    theta = prior.mean.copy() if start is None else start.copy()
    mean, covariance, value = condition(gram, prior, theta)
    for _ in range(ITERATIONS):
        gradient, information = _score(prior, theta, mean, covariance)
        step = np.linalg.solve(information, gradient)
        # far from the maximum a full step goes astray: variances are known to decades at the start
        step *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(step))), 1e-300))
        for _ in range(HALVINGS):
            candidate = condition(gram, prior, theta + step)
            if candidate[2] > value:
                break
            step *= 0.5
        else:
            break
        gain, theta = candidate[2] - value, theta + step
        mean, covariance, value = candidate
        # a thousandth of a logarithm changes no weight of the average
        if gain < CLOSE:
            break
    theta_covariance = np.linalg.inv(_score(prior, theta, mean, covariance)[1])
    return Posterior(theta, mean, covariance, value, np.asarray(theta_covariance))


def average(
    gram: Gram, prior: VariancePrior, best: Posterior, points: Array
) -> tuple[Array, Array]:
    """Coefficients [p] and covariance [p, p] averaged over θ, importance-sampled about its maximum
    at standard normal points [m, θ].
    """
    root = np.linalg.cholesky(best.theta_covariance)
    drawn = [condition(gram, prior, best.theta + root @ point) for point in points]
    means, covariances, values = map(np.array, zip(*drawn, strict=True))
    # evidence over the density that the points are drawn from
    log_weight = values + 0.5 * np.sum(points**2, axis=1)
    # relative to the largest, as evidences themselves underflow
    share = np.exp(log_weight - log_weight.max())
    share /= share.sum()
    mean = share @ means
    deviations = means - mean
    mean_covariance = np.einsum("m,mij->ij", share, covariances)
    # law of total variance: mean of the variances and variance of the means
    return mean, mean_covariance + (deviations * share[:, None]).T @ deviations
