"""Covariance of linear coefficients whose residuals are autocorrelated, in the memory of a chunk
whatever the rows and the lag.

Residuals are whitened by an autoregression. What is left is weighed by a Bartlett kernel: products
of scores k rows apart by 1 − k/(L + 1), which is the sum of the squares of the sums over L + 1
consecutive scores, over L + 1: one pass, however long the lag.

A fit draws the residuals of rows with leverage towards zero, the few cold rows of a warm-up first
of all. So the residuals and the sum are divided by what they would be of white innovations, and the
degrees of freedom are those of that sum (Bell & McCaffrey 2002).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks
from calibkit.numeric.least_squares import fit, fold
from calibkit.numeric.least_squares.autoregression import Autoregression, Series

LAGS = (1 << 14, 1 << 19)
"""Lags that are computed together: first few, then as many at a time as a block has memory for."""
FEW = 1 << 17
"""Rows up to which what a fit takes from a single residual is allowed for."""
HIGHEST_ORDER = 20
"""Of the autoregression; the kernel takes what correlation is longer."""
DETAILED = 512
"""Rows up to which the correction is computed row by row; of more, from as many blocks."""
LEAST_SHARE = 0.01
"""Variance of a residual, relative to an innovation's, below which it says nothing."""


@dataclass(frozen=True, slots=True)
class _Consistent:
    """Covariance [p, p] of coefficients, and degrees of freedom [m] of the variances of
    combinations of them.
    """

    covariance: Array
    effective_dof: Array


def covariance(
    design: Callable[[slice], Array], residuals: Array, *, combinations: Array | None = None
) -> _Consistent:
    """Covariance of linear coefficients when the residuals are autocorrelated (Newey & West 1987,
    Andrews & Monahan 1992), without bias and with its degrees of freedom for white innovations.

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows.
    residuals
        [n], in memory or mapped.
    combinations
        [m, p], of the coefficients, whose degrees of freedom are asked for; by default the
        coefficients.

    """
    rows = residuals.size
    root = fold.triangle(design, rows)
    columns = root.shape[1]
    unit, plain = _held(_unit(design, root), rows), _plain(residuals)
    model = _choose(plain, rows, columns)
    power = _power(model.whiten_adjoint(unit, rows), rows)
    if model.order and rows <= FEW:
        # what the fit took from the residuals, it took from the slow ones
        model = _choose(plain, rows, columns, model.variances[-1] * np.trace(power) / rows)
        power = _power(model.whiten_adjoint(unit, rows), rows)
    innovations = _held(model.whiten(plain), rows)
    lag = min(_bandwidth(innovations, rows), rows - 2)
    a, f = (
        _held(series, rows) for series in (model.whiten_adjoint(unit, rows), model.whiten(unit))
    )
    both = _Columns(a, f, power, rows > FEW)
    meat = _meat(
        _held(lambda a, b: both.weighed(a, b) * innovations(a, b), rows), rows, lag, columns
    )
    working = _Working.of(both, rows, lag)
    bread = fit.triangular(root, working.correction)
    if combinations is None:
        combinations = np.eye(columns)
    dof = working.effective_dof(combinations @ bread)
    spread = model.relative_variance(rows)
    return _Consistent(
        np.asarray(bread @ meat @ bread.T, dtype=np.float64), 1.0 / (1.0 / dof + spread / 2.0)
    )


def _held(series: Series, rows: int) -> Series:
    """Series of a chunk of rows, computed once; a longer one, computed where it is asked for."""
    if rows > chunks.ROWS:
        return series
    values = series(0, rows)
    return lambda first, stop: values[..., first:stop]


def _unit(design: Callable[[slice], Array], root: Array) -> Series:
    """Columns [p, m] of length one, made of the design by its triangle [p, p]."""
    return lambda first, stop: fit.triangular(root, design(slice(first, stop)).T, trans="T")


def _plain(residuals: Array) -> Series:
    """Residuals [m], copied, so that the pages of a file are released."""

    def between(first: int, stop: int) -> Array:
        values = np.array(residuals[first:stop])
        chunks.release(residuals)
        return values

    return between


def _choose(plain: Series, rows: int, columns: int, missing: float = 0.0) -> Autoregression:
    """Autoregression of the residuals, to whose autocovariances is added what is missing."""
    length = min(1 << 14, 1 << rows.bit_length())
    most = min(HIGHEST_ORDER, int(10.0 * np.log10(rows)), rows // 10)
    most = most if rows > 10 * columns else 0
    products = _products(plain, rows, 0, length)[: most + 1] / rows
    return Autoregression.choose(products + missing * (1.0 - np.arange(most + 1) / rows), rows)


def _power(series: Series, rows: int) -> Array:
    """Sum [p, p] of the products of a series [p, n] with itself."""
    return np.asarray(
        sum(part @ part.T for part in (series(a, b) for a, b in chunks.ranges(rows))),
        dtype=np.float64,
    )


@dataclass(frozen=True, slots=True)
class _Columns:
    """What coefficients are made of, and what a fit takes from innovations ε: the coefficients are
    Σ a ε, the whitened residuals (1 − f aᵀ) ε.
    """

    a: Series
    f: Series
    power: Array
    """Σ a aᵀ [p, p]."""
    many: bool
    """Whether rows are so many that none keeps less than the others."""

    def weighed(self, first: int, stop: int) -> Array:
        """Columns a [p, m] over the root of the share of an innovation's variance that is left."""
        a = self.a(first, stop)
        if self.many:
            return a
        f = self.f(first, stop)
        share = 1.0 - 2.0 * np.sum(a * f, axis=0) + np.sum(f * (self.power @ f), axis=0)
        return np.asarray(a / np.sqrt(np.maximum(share, LEAST_SHARE)), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Working:
    """The estimate where innovations are white: G = 1 + U S Uᵀ is the covariance of the whitened
    residuals.
    """

    weighed: Array
    """[p, k], of rows or of blocks of rows."""
    taken: Array
    """Uᵀ [2 p, k]."""
    core: Array
    """S [2 p, 2 p]."""
    kernel: Array
    """Weights [k] of the kernel by distance."""
    squares: Array
    """The same of its square."""
    correction: Array
    """Matrix [p, p] C for which C meat Cᵀ is expected to be the covariance."""

    @classmethod
    def of(cls, columns: _Columns, rows: int, lag: int) -> "_Working":
        """Sums over blocks of rows; single rows where they are few."""
        size = -(-rows // DETAILED)
        parts = []
        for first, stop in chunks.ranges(rows, size * max(chunks.ROWS // size, 1)):
            stacked = np.concatenate(
                [columns.weighed(first, stop), columns.f(first, stop), columns.a(first, stop)]
            )
            parts.append(np.add.reduceat(stacked, np.arange(0, stop - first, size), axis=1))
        blocks = np.concatenate(parts, axis=1) / np.sqrt(size)
        p, count = len(columns.power), blocks.shape[1]
        weighed, taken = blocks[:p], blocks[p:]
        core = np.block([[columns.power, -np.eye(p)], [-np.eye(p), np.zeros((p, p))]])
        weights, squares = _kernel(count, size, lag + 1.0)
        products = (weighed[:, None, :] * taken).reshape(-1, count)
        sums = (products @ _smoothed(weights, products).T).reshape(p, 2 * p, p, 2 * p)
        expected = weighed @ weighed.T + np.einsum("ikjl,kl->ij", sums, core)
        return cls(weighed, taken, core, weights, squares, matching_factor(columns.power, expected))

    def effective_dof(self, combinations: Array) -> Array:
        """Degrees of freedom [m] of the variances of combinations [m, p] of the weighed columns
        (Satterthwaite 1946).
        """
        found = []
        for alpha in combinations @ self.weighed:
            across = alpha * _smoothed(self.kernel, alpha * self.taken)
            turned = self.core @ self.taken @ across.T
            square = (alpha**2) @ _smoothed(self.squares, alpha**2)
            mean = float(alpha @ alpha + np.trace(turned))
            spread = square + np.trace(2.0 * self.core @ across @ across.T + turned @ turned)
            found.append(mean**2 / float(spread) if spread > 0.0 else np.inf)
        return np.array(found)


def _kernel(count: int, size: int, width: float) -> tuple[Array, Array]:
    """Means of the Bartlett kernel and of its square [count] over pairs of rows of two blocks of
    `size` rows, by distance of the blocks.
    """
    if size == 1:
        weights = np.maximum(1.0 - np.arange(count) / width, 0.0)
        return weights, weights**2
    # second differences of the functions whose second derivative the kernel and its square are
    at = size * np.arange(-1.0, count + 1.0)
    inside, beyond = np.minimum(np.abs(at), width), np.maximum(np.abs(at) - width, 0.0)
    single = inside**2 / 2.0 - inside**3 / (6.0 * width) + beyond * width / 2.0
    double = (
        inside**2 / 2.0
        - inside**3 / (3.0 * width)
        + inside**4 / (12.0 * width**2)
        + beyond * width / 3.0
    )
    return np.diff(single, 2) / size**2, np.diff(double, 2) / size**2


def _smoothed(weights: Array, values: Array) -> Array:
    """Sums [..., k] of values [..., k] near each row, weighted by weights [k] of their distance."""
    size = 2 * weights.size
    both = np.concatenate([weights, [0.0], weights[:0:-1]])
    product = np.fft.rfft(both) * np.fft.rfft(values, size)
    return np.asarray(np.fft.irfft(product, size)[..., : weights.size], dtype=np.float64)


def matching_factor(wanted: Array, expected: Array) -> Array:
    """Matrix [p, p] C with C · expected · Cᵀ = wanted, the same whatever the columns' units."""
    values, vectors = np.linalg.eigh(wanted)
    root, inverse = vectors * np.sqrt(values) @ vectors.T, vectors / np.sqrt(values) @ vectors.T
    shares, axes = np.linalg.eigh(inverse @ expected @ inverse)
    scaled = axes / np.sqrt(np.maximum(shares, LEAST_SHARE)) @ axes.T
    return np.asarray(root @ scaled @ inverse, dtype=np.float64)


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


def _bandwidth(series: Series, count: int) -> int:
    """Lag of the Bartlett kernel for what autocorrelation of a whitened series of `count` values is
    left: 0 where the first falls below 2/√n, three times the lags that do not.
    """
    mean = sum(float(np.sum(series(a, b))) for a, b in chunks.ranges(count)) / count
    power = sum(float(np.sum((series(a, b) - mean) ** 2)) for a, b in chunks.ranges(count))
    if power == 0.0:
        return 0
    most = max(count // 3, 1)
    first = _first_below(
        lambda a, b: series(a, b) - mean, count, most, 2.0 / np.sqrt(count) * power
    )
    return min(3 * max(first - 1, 0), most)


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
