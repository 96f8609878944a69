"""Autoregression of a series: what each value does beyond what the values before it foretell."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array

Series = Callable[[int, int], Array]
"""Values [..., stop − first] of the rows first … stop − 1 of a series."""

LONGEST_RESPONSE = 1 << 14
"""Rows after which the effect of an innovation is taken as over."""
OVER = 1e-9
"""Effect of an innovation below which it is over."""


@dataclass(frozen=True, slots=True)
class Autoregression:
    """Linear predictors of 0, 1, … m values: the last of all rows, the others of the first rows,
    which have fewer before them.
    """

    predictors: tuple[Array, ...]
    """Coefficients [0], [1], … [m], that of the nearest value first."""
    variances: tuple[float, ...]
    """Variance of what each of them leaves."""

    @property
    def order(self) -> int:
        """Number m of values that a value is foretold from."""
        return len(self.predictors) - 1

    @classmethod
    def choose(cls, products: Array, rows: int) -> Self:
        """Autoregression for the autocovariances [most + 1] of a series of `rows` values, of the
        order with the least information criterion (Akaike 1974); by Levinson's recursion.
        """
        predictor, variance = np.zeros(0), float(products[0])
        predictors, variances = [predictor], [variance]
        while len(predictors) < products.size and variance > 0.0:
            k = len(predictors)
            last = (float(products[k]) - float(predictor @ products[k - 1 : 0 : -1])) / variance
            predictor = np.append(predictor - last * predictor[::-1], last)
            variance *= 1.0 - last * last
            predictors.append(predictor)
            variances.append(variance)
        with np.errstate(divide="ignore"):
            criterion = rows * np.log(np.array(variances)) + 2.0 * np.arange(len(variances))
        count = int(np.argmin(criterion)) + 1 if products[0] > 0.0 else 1
        return cls(tuple(predictors[:count]), tuple(variances[:count]))

    def whiten(self, series: Series) -> Series:
        """Innovations of a series, of equal variance from the first row on."""
        taps = np.append(1.0, -self.predictors[-1])

        def between(first: int, stop: int) -> Array:
            begin = max(first - self.order, 0)
            values = series(begin, stop)
            found = np.empty_like(values)
            for index in np.ndindex(values.shape[:-1]):
                found[index] = np.convolve(values[index], taps)[: values.shape[-1]]
            for row in range(first, min(self.order, stop)):
                found[..., row - begin] = values[..., : row + 1] @ self._head(row)
            return np.asarray(found[..., first - begin :], dtype=np.float64)

        return between

    def whiten_adjoint(self, series: Series, rows: int) -> Series:
        """Series a for which Σ a·ε = Σ s·x, where s is a series of `rows` values, x a series with
        this autoregression and ε its innovations.
        """
        order = self.order
        if not order:
            return series
        response = self._response(min(rows, LONGEST_RESPONSE))

        def later(first: int, stop: int) -> Array:
            values = series(first, min(stop + response.size - 1, rows))
            size = _fast_length(values.shape[-1] + response.size)
            product = np.fft.rfft(values, size) * np.conj(np.fft.rfft(response, size))
            return np.asarray(np.fft.irfft(product, size)[..., : stop - first], dtype=np.float64)

        # the first rows are foretold otherwise: a small system of equations
        own, cross = np.zeros((order, order)), np.zeros((order, order))
        for row in range(order):
            own[row, : row + 1] = self._head(row)
            cross[row, row:] = -self.predictors[-1][::-1][: order - row]
        wanted = series(0, order) - later(order, 2 * order) @ cross
        head = np.linalg.solve(own.T, wanted.T).T

        def between(first: int, stop: int) -> Array:
            found = later(first, stop)
            if first < order:
                found[..., : order - first] = head[..., first:stop]
            return found

        return between

    def _head(self, row: int) -> Array:
        """What the innovation of one of the first rows is made of: [row + 1]."""
        ratio = np.sqrt(self.variances[-1] / self.variances[row])
        return np.asarray(ratio * np.append(-self.predictors[row][::-1], 1.0), dtype=np.float64)

    def _response(self, most: int) -> Array:
        """Effect [k] of an innovation on its row and the following ones."""
        found = [1.0]
        taps = self.predictors[-1].tolist()
        while len(found) < most and taps:
            found.append(sum(a * b for a, b in zip(taps, reversed(found), strict=False)))
            if max(map(abs, found[-len(taps) :])) < OVER:
                break
        return np.array(found)

    def relative_variance(self, rows: int) -> float:
        """Relative variance of the variance of a mean, for what `rows` values leave unknown of the
        predictor.
        """
        gains = np.array([1.0 - predictor.sum() for predictor in self.predictors])
        known = np.sum(gains[:-1] ** 2 / self.variances[:-1])
        return float(4.0 * self.variances[-1] * known / (rows * gains[-1] ** 2))


def _fast_length(least: int) -> int:
    """Length of a Fourier transform that is fast: two, or three, times a power of two."""
    whole = 1 << (least - 1).bit_length()
    return whole * 3 // 4 if least <= whole * 3 // 4 else whole
