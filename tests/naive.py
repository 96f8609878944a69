"""Loop-only twins of the numeric core: slow, short, and written from the equations alone."""

from __future__ import annotations

import math

import numpy as np


def compensate(indication, gradient, rate, c):
    """Recursive and one-step outputs of CN102095419A step 4 for one set of polynomials c[j][m],
    term by term.
    """
    recursive, one_step, level = [indication[0]], [0.0], 0.0
    for k in range(1, len(indication)):
        a = [sum(c[j][m] * rate[k - 1] ** m for m in range(len(c[j]))) for j in range(3)]
        delta = a[0] + a[1] * gradient[k - 1] + a[2] * gradient[k - 1] ** 2
        level += delta
        recursive.append(indication[k] - level)
        one_step.append(indication[k] - (indication[k - 1] + delta))
    return recursive, one_step


def block_means(time, values, interval):
    """Means of the values whose time falls into each interval, by a dictionary."""
    bins = {}
    for t, v in zip(time, values, strict=True):
        bins.setdefault(math.floor((t - time[0]) / interval), []).append(v)
    return [sum(bins[k]) / len(bins[k]) for k in sorted(bins)]


def corrected_newey_west(design, residuals, combinations):
    """HAC covariance of coefficients, degrees of freedom of combinations of them, and the order of
    the autoregression, by whole matrices.

    The autoregression is fitted by solving the Yule-Walker equations of each order.
    """
    import numpy as np

    n = len(design)
    unit = np.linalg.qr(design)[0]

    def whitening(missing):
        c = np.array([residuals[k:] @ residuals[: n - k] for k in range(n // 10 + 1)]) / n
        c = c + missing * (1.0 - np.arange(c.size) / n)
        predictors, variances = [], []
        for order in range(min(int(10 * np.log10(n)), n // 10) + 1):
            table = np.array([[c[abs(i - j)] for j in range(order)] for i in range(order)])
            phi = np.linalg.solve(table, c[1 : order + 1]) if order else np.zeros(0)
            predictors.append(phi)
            variances.append(c[0] - phi @ c[1 : order + 1])
        m = int(np.argmin([n * np.log(v) + 2 * k for k, v in enumerate(variances)]))
        matrix = np.eye(n)
        for t in range(n):
            k = min(t, m)
            for j in range(k):
                matrix[t, t - 1 - j] = -predictors[k][j]
            matrix[t] *= np.sqrt(variances[m] / variances[k])
        gain = [1.0 - phi.sum() for phi in predictors]
        spread = 4 * variances[m] * sum(gain[k] ** 2 / variances[k] for k in range(m))
        return matrix, m, variances[m], spread / (n * gain[m] ** 2)

    matrix, order, variance, spread = whitening(0.0)
    if order:
        a = np.linalg.solve(matrix.T, unit)
        matrix, order, variance, spread = whitening(variance * np.trace(a.T @ a) / n)
    a = np.linalg.solve(matrix.T, unit)
    left = np.eye(n) - matrix @ unit @ a.T
    covered = left @ left.T
    weighed = a / np.sqrt(np.diag(covered))[:, None]
    innovations = matrix @ residuals
    first = innovations - innovations.mean()
    first = [(first[k:] @ first[: n - k]) < 2 / np.sqrt(n) * (first @ first) for k in range(n)]
    lag = 3 * (first.index(True) - 1)
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    kernel = np.maximum(1.0 - apart / (lag + 1.0), 0.0)
    scores = weighed * innovations[:, None]
    wanted, expected = a.T @ a, weighed.T @ (kernel * covered) @ weighed

    def power(square, exponent):
        values, vectors = np.linalg.eigh(square)
        return vectors @ np.diag(values**exponent) @ vectors.T

    half, inverse = power(wanted, 0.5), power(wanted, -0.5)
    correction = half @ power(inverse @ expected @ inverse, -0.5) @ inverse
    bread = np.linalg.solve(unit.T @ design, correction)
    dof = []
    for row in combinations @ bread:
        form = np.outer(weighed @ row, weighed @ row) * kernel @ covered
        own = np.trace(form) ** 2 / np.trace(form @ form)
        dof.append(1.0 / (1.0 / own + spread / 2.0))
    return bread @ scores.T @ kernel @ scores @ bread.T, np.array(dof), order


def sensitivities(function, estimate, standard_uncertainty):
    """Jacobian of a function by central differences of ± one standard uncertainty (JCGM 100 5.1.3
    note 2); an input without one is stepped by a millionth of itself.
    """
    columns = []
    for i, uncertainty in enumerate(standard_uncertainty):
        step = float(uncertainty) or 1e-6 * max(abs(float(estimate[i])), 1.0)
        up, down = np.array(estimate, dtype=float), np.array(estimate, dtype=float)
        up[i] += step
        down[i] -= step
        difference = np.atleast_1d(np.asarray(function(up)) - np.asarray(function(down)))
        columns.append(difference / (up[i] - down[i]))
    return np.stack(columns, axis=1)
