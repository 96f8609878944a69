"""Nonlinear least squares by Gauss-Newton steps over blocks of rows, with a guard on every step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.least_squares import fold, gram

ITERATIONS = 200
STEP_TOLERANCE = 1e-13
"""A step smaller than this share of the parameters changes no digit."""
FLAT = 1e-6
"""A step this small, in the residuals or in the parameters, is too small for the sum of squares to
judge.
"""
POLISHING_STEPS = 40
ROUNDING = 1e-30
"""Square of a residual that counts as 0."""
RANK_TOLERANCE = 1e-10


_Residuals = Callable[[Array, slice], tuple[Array, Array]]
"""Weighted residuals [m] and their derivatives [m, p] of a block of rows at parameters [p]; several
residuals of one row are stacked in any fixed order.
"""


@dataclass(frozen=True, slots=True)
class _NonlinearFit:
    """A finished nonlinear fit."""

    parameters: Array
    """[p]."""
    normal_inverse: Array
    """[p, p], (JᵀJ)⁻¹ at the solution; times the residual variance it is the covariance."""
    square: float
    """Sum of the squared weighted residuals."""
    residual_count: int
    condition: float
    """Of the Jacobian with columns scaled to unit length."""

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return self.residual_count - self.parameters.size

    @property
    def covariance(self) -> Array:
        """[p, p], scaled by the residual variance; 0 when there are no degrees of freedom."""
        return self.normal_inverse * (self.square / self.dof if self.dof > 0 else 0.0)


@dataclass(frozen=True, slots=True)
class _Linearised:
    """The triangle of all blocks: R [p, p], Qᵀr [p], sum of squares, number of residuals."""

    triangle: Array
    target: Array
    square: float
    count: int


def fit(
    residuals: _Residuals,
    start: Array,
    rows: int,
    *,
    names: Sequence[str] = (),
    block_rows: int = fold.BLOCK_ROWS,
    weakest: float = RANK_TOLERANCE,
) -> _NonlinearFit:
    """Minimise a sum of squares by Gauss-Newton steps; memory does not grow with the number of
    rows.

    Every block is folded into one triangle by orthogonal factorisation, and those of many
    well-conditioned rows by their moments, four times as fast. A step that does not lower the sum
    of squares is shortened and turned towards the gradient (Levenberg 1944, Marquardt 1963) until
    it does.

    Parameters
    ----------
    residuals
        Weighted residuals and Jacobian of a block of rows.
    start
        [p].
    rows
        How many rows there are.
    names
        [p], what the error calls parameters that the data leave undetermined.
    block_rows
        Rows evaluated at one time.
    weakest
        Smallest singular value of the scaled Jacobian, relative to the largest, that counts as
        determined.

    Raises
    ------
    FitError
        For fewer residuals than parameters, a singular Jacobian, or no convergence in 200
        iterations.

    """
    parameters = np.asarray(start, dtype=np.float64)
    linearise = partial(_linearise, residuals, rows=rows, block_rows=block_rows)
    here = linearise(parameters)
    if not np.isfinite(here.square):
        raise FitError(
            "a value that is not finite reached the fit", hint="exclude the rows that hold it"
        )
    if here.count < start.size:
        raise FitError(
            f"{here.count} residuals for {start.size} parameters", hint="add data or fix parameters"
        )
    damping, scale = 0.0, np.zeros(start.size)
    for _ in range(ITERATIONS):
        # the longest column so far (Moré 1978): a parameter without effect here must not run away
        scale = np.maximum(scale, _column_lengths(here.triangle))
        step = _step(here, scale, damping)
        if min(_relative(here, scale, step, parameters)) <= FLAT and damping < 1e-6:
            here, parameters = _polished(linearise, parameters, here, rows)
            return _finished(here, parameters, names, weakest)
        there = linearise(parameters + step)
        if there.square <= here.square:
            parameters, here = parameters + step, there
            damping = 0.0 if damping < 1e-9 else damping / 10.0
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e12:
                break
    raise FitError(
        f"no convergence in {ITERATIONS} iterations",
        hint="check units and start, or lower the orders",
    )


def fit_some_rows(residuals: _Residuals, start: Array, rows: int, *, enough: int) -> Array:
    """Parameters [p] fitted to `enough` evenly spread rows of many, so that few passes over all of
    them remain.

    The start where there are not many, or where these rows determine nothing: all of them still
    may.
    """
    every = rows // enough
    if every < 4:
        return start

    def spread(parameters: Array, rows: slice) -> tuple[Array, Array]:
        return residuals(parameters, slice(rows.start * every, rows.stop * every, every))

    try:
        return fit(spread, start, rows // every).parameters
    except FitError:
        return start


def _linearise(residuals: _Residuals, parameters: Array, rows: int, block_rows: int) -> _Linearised:
    """Fold all blocks into one triangle of Jacobian and residual."""
    tall = _by_moments(residuals, parameters, rows) if rows >= gram.TALL else None
    if tall is not None:
        return tall
    width = parameters.size + 1
    triangle = np.zeros((0, width))
    count = 0
    for part in gram.blocks(rows, block_rows):
        residual, slope = residuals(parameters, part)
        count += residual.size
        stacked = np.concatenate([triangle, np.column_stack([slope, residual])])
        if not np.isfinite(stacked).all():
            # a block far from the solution may overflow: an infinite sum of squares refuses the
            # step
            return _Linearised(np.zeros((width - 1, width - 1)), np.zeros(width - 1), np.inf, count)
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    padded = np.zeros((width, width))
    padded[: triangle.shape[0]] = triangle
    square = float(padded[:, -1] @ padded[:, -1])
    return _Linearised(padded[:-1, :-1], padded[:-1, -1], square, count)


def _by_moments(residuals: _Residuals, parameters: Array, rows: int) -> _Linearised | None:
    """The same for many rows by the Gram matrix of the Jacobian; None where its condition number
    would cost digits.

    The steps correct themselves, so that the Gram matrix bears on how soon they end, not on where.
    """
    width = parameters.size
    moments, gradient, square, count = np.zeros((width, width)), np.zeros(width), 0.0, 0
    for part in gram.blocks(rows, gram.block_rows(width)):
        residual, slope = residuals(parameters, part)
        moments += gram.product(slope, slope)
        gradient += slope.T @ residual
        square += float(residual @ residual)
        count += residual.size
    if not (np.isfinite(moments).all() and np.isfinite(square)):
        return _Linearised(np.zeros((width, width)), np.zeros(width), np.inf, count)
    scale = np.sqrt(np.diag(moments))
    if not (scale > 0.0).all():
        return None
    scaled = moments / scale / scale[:, None]
    values = np.linalg.eigvalsh(scaled)
    if values[0] * gram.WORST_CONDITION**2 <= values[-1]:
        return None
    lower = np.asarray(np.linalg.cholesky(scaled) * scale[:, None], dtype=np.float64)
    return _Linearised(
        lower.T, np.asarray(np.linalg.solve(lower, gradient), dtype=np.float64), square, count
    )


def _column_lengths(triangle: Array) -> Array:
    length = np.linalg.norm(triangle, axis=0)
    return np.where(length > 0.0, length, 1.0)


def _step(here: _Linearised, scale: Array, damping: float) -> Array:
    """Solve the linearised problem, least norm along directions that the rows do not see."""
    u, singular, vt = np.linalg.svd(here.triangle / scale)
    seen = singular > RANK_TOLERANCE * singular[0]
    factor = np.where(seen, singular, 0.0) / np.where(seen, singular**2 + damping, 1.0)
    return np.asarray(-(vt.T @ (factor * (u.T @ here.target))) / scale, dtype=np.float64)


def _relative(
    here: _Linearised, scale: Array, step: Array, parameters: Array
) -> tuple[float, float]:
    """Size of a step relative to the parameters, and of its effect relative to the residuals."""
    size, effect = np.linalg.norm(scale * step), np.linalg.norm(here.triangle @ step)
    whole, left = np.linalg.norm(scale * parameters), np.sqrt(here.square)
    return float(size) / max(float(whole), 1e-300), float(effect) / max(float(left), 1e-300)


def _polished(
    linearise: Callable[[Array], _Linearised], parameters: Array, here: _Linearised, rows: int
) -> tuple[_Linearised, Array]:
    """Take full steps as long as they shrink: near the minimum the sum of squares is flat to
    rounding, steps are not.
    """
    last = np.inf
    for _ in range(POLISHING_STEPS):
        scale = _column_lengths(here.triangle)
        step = _step(here, scale, 0.0)
        share, _ = _relative(here, scale, step, parameters)
        if share >= 0.9 * last:
            break
        if share <= STEP_TOLERANCE and rows >= gram.TALL:
            # another pass over many rows would change nothing
            return here, parameters + step
        there = linearise(parameters + step)
        if not there.square <= here.square * (1.0 + 1e-9) + ROUNDING * here.count:
            break
        parameters, here, last = parameters + step, there, share
        if share <= STEP_TOLERANCE:
            break
    return here, parameters


def _finished(
    here: _Linearised, parameters: Array, names: Sequence[str], weakest: float
) -> _NonlinearFit:
    """Inverse normal matrix at the solution, or a refusal that names what the data leave
    undetermined.
    """
    names = tuple(names) or tuple(f"parameter {j}" for j in range(parameters.size))
    scale = _column_lengths(here.triangle)
    scaled = here.triangle / scale
    _, singular, vt = np.linalg.svd(scaled)
    if singular[-1] <= weakest * singular[0]:
        null = vt[singular <= weakest * singular[0]]
        involved = np.any(np.abs(null) > 1e-3, axis=0)
        loose = [name for name, loose in zip(names, involved, strict=True) if loose]
        raise FitError(
            f"the data cannot determine {', '.join(loose)}",
            hint="add different attitudes or temperatures, or fix them",
        )
    inverse = np.linalg.inv(scaled) / scale[:, None]
    return _NonlinearFit(
        parameters=parameters,
        normal_inverse=inverse @ inverse.T,
        square=here.square,
        residual_count=here.count,
        condition=float(singular[0] / singular[-1]),
    )
