"""Covariance of linear coefficients whose residuals are autocorrelated, in the memory of a chunk
whatever the rows and the lag.

A Bartlett kernel of lag L weights the product of scores k rows apart by 1 − k/(L + 1). The same sum
is that of the squares of the sums over L + 1 consecutive scores, over L + 1: one pass, however long
the lag.
"""

from collections.abc import Callable

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks
from calibkit.numeric.least_squares import fit, fold

Series = Callable[[int, int], Array]
"""Values [..., stop − first] of the rows first … stop − 1 of a series."""

LAGS = (1 << 14, 1 << 19)
"""Lags that are computed together: first few, then as many at a time as a block has memory for."""
LONGEST_MEMORY = 0.97
"""Of the autoregression that whitens the scores."""


def covariance(
    design: Callable[[slice], Array],
    residuals: Array,
    *,
    lag: int | None = None,
    prewhiten: bool = True,
) -> Array:
    """Covariance [p, p] of linear coefficients when the residuals are autocorrelated (Newey & West
    1987).

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows.
    residuals
        [n], in memory or mapped.
    lag
        Of the kernel. By default three times that at which the autocorrelation of the (prewhitened)
        residuals falls below 2/√n, at least the Newey-West rule 4 (n/100)^(2/9).
    prewhiten
        The scores are prewhitened by a first-order autoregression and recoloured (Andrews & Monahan
        1992), because a kernel alone understates slowly decaying correlation.

    Notes
    -----
    The estimate carries the n/(n − p) small-sample factor.

    """
    rows = residuals.size
    root = fold.triangle(design, rows)
    columns = root.shape[1]
    scores, count = _scores(design, residuals, root), rows
    colour: Array = np.eye(columns)
    memory = 0.0
    if prewhiten and rows > 10 * columns:
        transition = _transition(scores, rows, columns)
        colour = np.asarray(np.linalg.inv(np.eye(columns) - transition), dtype=np.float64)
        memory = _memory(residuals)
        scores, count = _steps(scores, transition), rows - 1
    lag = min(_bandwidth(residuals, memory) if lag is None else lag, rows - 2)
    bread = fit.triangular(root, colour)
    return np.asarray(
        bread @ _meat(scores, count, lag, columns) @ bread.T * (rows / max(rows - columns, 1)),
        dtype=np.float64,
    )


def _scores(design: Callable[[slice], Array], residuals: Array, root: Array) -> Series:
    """Scores [p, m]: columns of length one, made of the design by its triangle [p, p], times the
    residuals.
    """

    def between(first: int, stop: int) -> Array:
        part = slice(first, stop)
        unit = fit.triangular(root, design(part).T, trans="T")
        unit *= residuals[part]
        chunks.release(residuals)
        return unit

    return between


def _steps(series: Series, transition: Array | float) -> Series:
    """What a series does from each value to the next beyond a first-order autoregression; one value
    less.
    """

    def between(first: int, stop: int) -> Array:
        values = series(first, stop + 1)
        before = values[..., :-1]
        expected = (
            transition @ before if isinstance(transition, np.ndarray) else transition * before
        )
        return np.asarray(values[..., 1:] - expected, dtype=np.float64)

    return between


def _transition(scores: Series, rows: int, columns: int) -> Array:
    """First-order autoregression matrix [p, p] of the scores, its singular values kept below
    0.97.
    """
    square, product = np.zeros((columns, columns)), np.zeros((columns, columns))
    for start, stop in chunks.ranges(rows - 1):
        values = scores(start, stop + 1)
        square += values[:, :-1] @ values[:, :-1].T
        product += values[:, 1:] @ values[:, :-1].T
    matrix = product @ np.linalg.pinv(square, rcond=1e-12, hermitian=True)
    u, singular, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag(np.minimum(singular, LONGEST_MEMORY)) @ vt, dtype=np.float64)


def _memory(residuals: Array) -> float:
    """Share [1] of a residual that the next one keeps, from 0 to 0.97."""
    power = product = 0.0
    for start, stop in chunks.ranges_along(residuals):
        values = residuals[start : stop + 1]
        power += float(residuals[start:stop] @ residuals[start:stop])
        product += float(values[1:] @ values[:-1])
    return min(max(product / power, 0.0), LONGEST_MEMORY) if power > 0.0 else 0.0


def _meat(scores: Series, count: int, lag: int, columns: int) -> Array:
    """Sum [p, p] of the products of scores at most `lag` rows apart, weighted by the Bartlett
    kernel.
    """
    meat, before = np.zeros((columns, columns)), np.zeros((columns, 1))
    for start, stop in chunks.ranges(count + lag):
        # sums over the lag + 1 scores that end in each row: they begin and end in zeros
        change = np.zeros((columns, stop - start))
        for behind, sign in ((0, 1.0), (lag + 1, -1.0)):
            low, high = (min(max(row - behind, 0), count) for row in (start, stop))
            if high > low:
                change[:, low + behind - start : high + behind - start] += sign * scores(low, high)
        sums = np.cumsum(change, axis=1) + before
        before = sums[:, -1:]
        meat += sums @ sums.T
    return meat / (lag + 1.0)


def _bandwidth(residuals: Array, memory: float) -> int:
    """Lag of the Bartlett kernel that covers the visible autocorrelation of the residuals [n],
    prewhitened by their memory.
    """

    def plain(first: int, stop: int) -> Array:
        values = np.array(residuals[first:stop])
        chunks.release(residuals)
        return values

    series, count = _steps(plain, memory), residuals.size - 1
    rule = int(np.ceil(4.0 * (count / 100.0) ** (2.0 / 9.0)))
    mean = sum(float(np.sum(series(a, b))) for a, b in chunks.ranges(count)) / count
    power = sum(float(np.sum((series(a, b) - mean) ** 2)) for a, b in chunks.ranges(count))
    if power == 0.0:
        return rule
    most = max(count // 3, 1)
    first = _first_below(
        lambda a, b: series(a, b) - mean, count, most, 2.0 / np.sqrt(count) * power
    )
    return min(max(rule, 3 * first), most)


def _first_below(series: Series, count: int, most: int, limit: float) -> int:
    """First lag at which the sum of products of a series with itself is below a limit; `most` where
    no lag before it is.
    """
    for size in LAGS:
        length = min(size, 1 << count.bit_length())
        for shift in range(0, most if size == LAGS[-1] else 1, length):
            found = np.flatnonzero(_products(series, count, shift, length)[: most - shift] < limit)
            if found.size:
                return shift + int(found[0])
    return most


def _products(series: Series, count: int, shift: int, size: int) -> Array:
    """Sums of products [size] of a series with itself shift, shift + 1, … rows later, by Fourier
    transforms of blocks.
    """
    total = np.zeros(size + 1, dtype=np.complex128)
    for start in range(0, max(count - shift, 0), size):
        later = start + shift
        head = np.fft.rfft(series(start, min(start + size, count)), 2 * size)
        total += np.conj(head) * np.fft.rfft(series(later, min(later + 2 * size, count)), 2 * size)
    return np.asarray(np.fft.irfft(total, 2 * size)[:size], dtype=np.float64)
