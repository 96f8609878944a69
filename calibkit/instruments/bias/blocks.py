"""Means of blocks of logs: the rows that a bias over an abscissa is fitted to.

    y = X p + b_log + w_log(t) + flicker + white

b_log is the turn-on bias of a log, w_log a wander of its bias with the time t in it. White noise
averages out over a block and is of no interest below it; flicker noise does not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit, solve
from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.flicker import Turned

GROUP, TURN_ON = "log", "turn-on bias"
"""Error that all rows of a log share."""
COURSES = ("drift in time", "bend in time", "wave in time")
"""Polynomials of time, from the first power on, by which a bias is tried to wander in a log."""
BLOCKS = 32
"""Blocks of a log: enough to tell white from flicker noise, with few rows at any length of log."""
STILL = 0.05
"""Range of an abscissa in a log, relative to that of all logs, below which it is the noise of a
thermometer more than a change: such a log has a level alone.
"""
LEAST_LOGS = 4
"""Fewest logs from which the covariance of biases that wander is taken between logs."""
LEAST_SHARE = 0.01
"""Share of a variance that residuals must keep to say something of it."""


@dataclass(frozen=True, slots=True)
class BiasBlocks:
    """Means over consecutive rows of logs."""

    design: Array
    """[m, p]."""
    indication: Array
    """[m]."""
    count: Array
    """[m], rows of each block."""
    log: Integers
    """[m], number of the log."""

    @classmethod
    def of(
        cls,
        designs: Sequence[Callable[[slice], Array]],
        rows: Sequence[tuple[Array, Array]],
        valid: tuple[float, float],
    ) -> "BiasBlocks":
        """Means over the rows of logs, given by the design of a slice of its rows and by its
        abscissa and indication [n]; `valid` is the range of the abscissa in all of them.
        """
        means, counts = [], []
        for design, (abscissa, indication) in zip(designs, rows, strict=True):
            # design and indication are summed over blocks of rows, in spans that fit into memory
            size = -(-indication.size // BLOCKS)
            sums = []
            for start, end in chunks.ranges(indication.size, size * max(chunks.ROWS // size, 1)):
                stacked = np.column_stack([design(slice(start, end)), indication[start:end]])
                sums.append(np.add.reduceat(stacked, np.arange(0, end - start, size), axis=0))
            count = np.full(sum(map(len, sums)), float(size))
            # the last block holds what is left over
            count[-1] = indication.size - size * (count.size - 1)
            block_means = np.concatenate(sums) / count[:, None]
            lowest, highest = chunks.extremes(abscissa)
            # errors of the thermometer would pull its slope towards zero
            if highest - lowest < STILL * (valid[1] - valid[0]):
                block_means[:, :-1] = np.average(block_means[:, :-1], axis=0, weights=count)
            means.append(block_means)
            counts.append(count)
        all_means = np.concatenate(means)
        log = np.repeat(np.arange(len(rows)), [len(block_means) for block_means in means])
        return cls(all_means[:, :-1], all_means[:, -1], np.concatenate(counts), log)

    @property
    def place(self) -> Integers:
        """[m], number of each block in its log."""
        return np.concatenate([np.arange(n) for n in np.bincount(self.log)])

    def wander(self, rotation: Turned, unit: str) -> list[Shared]:
        """Courses of the bias in time of each log, where the likelihood asks for them."""
        # orthogonal courses about the middle of a log leave its level to the turn-on bias
        time = np.concatenate([np.linspace(-1.0, 1.0, n) for n in np.bincount(self.log)])
        courses = rotation.rows(np.polynomial.legendre.legvander(time, len(COURSES)))
        return [
            Shared(
                group=GROUP,
                effect=effect,
                level=self.log,
                loading=courses[:, k : k + 1],
                unit=unit,
                optional=True,
            )
            for k, effect in enumerate(COURSES, start=1)
        ]


def turn_on_bias(unit: str, log: Integers, loading: Array) -> Shared:
    """The turn-on bias of each log, from the number [n] of the log of each row."""
    return Shared(group=GROUP, effect=TURN_ON, level=log, loading=loading[:, None], unit=unit)


def fit_blocks(
    blocks: BiasBlocks, rotation: Turned, unit: str, shared: Sequence[Shared], names: Sequence[str]
) -> Fit:
    """Generalised least squares of turned rows with errors of logs and flicker noise.

    Flicker noise is as large as is most likely, and held so. Left to be estimated, its few slow
    waves would make the degrees of freedom of a level those of one value; held, 95 % intervals of
    level and slope of one log cover 90 to 100 % at white, autoregressive and flicker noise.
    """
    J, y = rotation.rows(blocks.design), rotation.rows(blocks.indication)
    flicker = Shared(
        group=GROUP,
        effect="flicker",
        level=np.arange(y.size),
        loading=np.sqrt(rotation.flicker)[:, None],
        unit=unit,
    )

    def fit_with(noise: Shared) -> Fit:
        # the equation is linear: one step from anywhere
        start = np.zeros(J.shape[1])
        return solve(lambda p: J @ p - y, start, [*shared, noise], names=names)

    (size,) = (
        shared_size.value
        for shared_size in fit_with(flicker).shared
        if shared_size.error is flicker
    )
    return fit_with(replace(flicker, size=size))


def between_logs(fitted: Fit, J: Array, log: Integers, combinations: Array) -> tuple[Array, Array]:
    """Covariance [p, p] by what the residuals of each log move the coefficients by, whatever their
    course, and degrees of freedom of combinations [k, p] of them.

    With the estimator G and the residuals r_j of log j, V = Σ_j (F G r_j)(F G r_j)ᵀ. The factor F
    makes its mean that of the errors that the fit found (Bell & McCaffrey 2002), and the degrees of
    freedom are those of such errors (Satterthwaite 1946).
    """
    G = fitted.gain
    # what each log moves the coefficients by
    parts = G[:, None, :] * (log == np.arange(log[-1] + 1)[:, None])
    rows = np.arange(len(log))
    effects = [size.error.design(rows) * size.value for size in fitted.mixed]
    errors = np.column_stack([*effects, np.diag(fitted.noise)])
    coefficient_errors = G @ errors
    # what an error of each kind moves the part of each log by
    kinds = parts @ (errors - J @ coefficient_errors)
    # F with F · expected · Fᵀ = G Σ Gᵀ, the same whatever the columns' units
    values, vectors = np.linalg.eigh(coefficient_errors @ coefficient_errors.T)
    root, inverse = vectors * np.sqrt(values) @ vectors.T, vectors / np.sqrt(values) @ vectors.T
    expected = np.einsum("pqr,sqr->ps", kinds, kinds)
    shares, axes = np.linalg.eigh(inverse @ expected @ inverse)
    factor = root @ (axes / np.sqrt(np.maximum(shares, LEAST_SHARE)) @ axes.T) @ inverse
    log_effects = factor @ (parts @ fitted.residual)
    products = np.einsum("kp,pqr->kqr", combinations @ factor, kinds)
    products = products @ np.swapaxes(products, 1, 2)
    # (Σ λ)²/Σ λ² of the eigenvalues, by traces
    dof = np.trace(products, axis1=1, axis2=2) ** 2 / np.sum(products**2, axis=(1, 2))
    # less than one would state U that nobody can use
    return log_effects @ log_effects.T, np.maximum(dof, 1.0)
