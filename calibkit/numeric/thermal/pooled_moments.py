"""Moment matrices of logs with random turn-on biases: pooled, and solved for the coefficients of a
linear model.
"""

import numpy as np

from calibkit.arrays import Array

DEPENDENT = 1e-10
"""Smallest eigenvalue of the columns' correlation matrix (mean 1) below which they count as
linearly dependent.
"""
LEAST_LOGS = 3
"""Fewest logs that show how much turn-on biases differ."""
TURN_ON = np.geomspace(0.01, 1000.0, 41)
"""Grid of standard deviations of the turn-on biases, in white noise of a row."""


def pool(log: Array, alike: float) -> Array:
    """Moment matrix [k + 1, k + 1] of the columns and the indication, from those [logs, k + 2,
    k + 2] of 1 beside them: of the deviations from the mean of each log, and of these means with
    the weight that random turn-on biases leave them.
    """
    away = log[:, 0, 1:] / np.sqrt(log[:, :1, 0])
    found = log[:, 1:, 1:].sum(axis=0) - away.T @ away
    if alike:
        weight, apart = between_logs(log[:, 0, 0], log[:, 0, 1:] / log[:, :1, 0], alike)
        found += (weight * apart.T) @ apart
    return np.asarray(found, dtype=np.float64)


def between_logs(sums: Array, means: Array, alike: float) -> tuple[Array, Array]:
    """Weights [L] of the means of logs whose rows have sums of weights [L], and the means [L, k]
    about their common mean, where the logs differ by random turn-on biases: `alike` is the white
    variance of a row over that of the biases.
    """
    weight = alike * sums / (alike + sums)
    return weight, means - np.average(means, axis=0, weights=weight)


def solve(matrix: Array) -> tuple[Array, float] | None:
    """Coefficients [k] and weighted residual sum of squares from a moment matrix [k + 1, k + 1];
    None if columns are dependent.
    """
    left, right = matrix[:-1, :-1], matrix[:-1, -1]
    square = np.diag(left)
    if not np.all(square > 0.0):
        return None
    length = np.sqrt(square)
    correlation = left / np.outer(length, length)
    if length.size and np.linalg.eigvalsh(correlation)[0] < DEPENDENT:
        return None
    found = np.linalg.solve(correlation, right / length) / length
    rest = matrix[-1, -1] - 2.0 * found @ right + found @ left @ found
    return found, max(float(rest), 0.0)


def find_alike(log: Array, rows: int) -> float:
    """White variance of a row over the variance of the turn-on biases, by restricted maximum
    likelihood from the moment matrices [logs, k + 2, k + 2] of logs with a number of rows; 0,
    biases that are free, for fewer than LEAST_LOGS.

    The variance is the mean over its posterior for a flat prior on the standard deviation: the
    maximum would understate one near zero. Flicker noise and misfit count as turn-on bias, so that
    biases are held less alike than they are.
    """
    sums = log[:, 0, 0]
    likelihood = np.full(TURN_ON.size, np.inf)
    for number, alike in enumerate((TURN_ON**-2.0).tolist()):
        pooled = pool(log, alike)
        found = solve(pooled)
        if sums.size < LEAST_LOGS or found is None or found[1] == 0.0:
            return 0.0
        weight, _ = between_logs(sums, sums[:, None], alike)
        length = np.sqrt(np.diag(pooled)[:-1])
        correlation = pooled[:-1, :-1] / np.outer(length, length)
        likelihood[number] = (
            (rows - length.size - 1) * np.log(found[1])
            + np.linalg.slogdet(correlation)[1]
            + 2.0 * np.sum(np.log(length))
            - np.sum(np.log(weight))
            + np.log(weight.sum())
        )
    share = np.exp(-0.5 * (likelihood - likelihood.min())) * TURN_ON
    return float(share.sum() / (share @ TURN_ON**2))
