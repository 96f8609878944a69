"""Nonlinear regression of any model by Levenberg-Marquardt steps (MINPACK) from several starts: the
lowest sum of squares that is proved a minimum, or no answer.

    proved where |Uᵀ r| / √p  ≤ 1e-4 |r - U Uᵀ r| / √(n - p)                (Bates & Watts 1981)

r are the residuals, U the directions of the model's derivatives, scaled to unit length.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibkit.errors import FitError
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import rms

RESTARTS = 6
"""Starts beside the given one, drawn about it."""
SPREAD = 1.0
"""Standard deviation of the logarithms of their parameters over the given ones."""
EVALUATIONS = 1000
"""Most evaluations of the model in one attempt."""
CONVERGED = 1e-4
"""Largest share of the residuals that the derivatives may still explain, over what noise alone
would (Bates & Watts 1981): below, no figure of an uncertainty changes.
"""
ROUNDING = 1e-10
"""Residuals this small, relative to the response, are rounding."""
EQUAL = 1e-6
"""Relative difference below which two sums of squares are one."""
UNDETERMINED = 1e-9
"""Smallest singular value of the derivatives, scaled to unit length, below which the data do not
determine the parameters: ten times the rounding of differences.
"""
STEP = float(np.cbrt(np.finfo(np.float64).eps))
"""Half the step of a derivative, relative to the parameter."""
BEYOND = 1e20
"""Residual, relative to the response, that stands for a value that is not finite."""

Model = Callable[..., ArrayLike]


@dataclass(frozen=True, slots=True)
class Regression:
    """A finished regression with p parameters."""

    names: tuple[str, ...]
    parameters: Array
    """[p]."""
    covariance: Array
    """[p, p], of independent errors of equal variance."""
    dof: int
    residuals: Array
    """[n], response less model."""

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [p] of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_width_95(self) -> Array:
        """Half-widths [p] of 95 % intervals, by Student's t."""
        return gum.coverage_factor(self.dof, probability=0.95) * self.standard_uncertainty


def regress(
    model: Model, x: ArrayLike, y: ArrayLike, start: ArrayLike | Mapping[str, float]
) -> Regression:
    """Fit the parameters of any model to a response by least squares.

    Parameters
    ----------
    model : called as `model(x, *parameters)`, gives [n].
    x : whatever the model takes.
    y : [n], response.
    start : [p] where to begin, or name → value. Starts are drawn about it, too.

    Returns
    -------
    Regression, of the lowest minimum that any attempt reaches; of minima alike, of that which the
    given start leads to. Weights: divide response and model by the errors' standard deviation.

    Raises
    ------
    FitError
        Fewer values than parameters, values that are not finite, parameters that the data do not
        determine, or no minimum that is proved: nothing is returned that is not one.

    """
    from scipy.optimize import least_squares

    if isinstance(start, Mapping):
        names, given_start = tuple(start), np.array(list(start.values()), dtype=np.float64)
    else:
        given_start = np.atleast_1d(np.array(start, dtype=np.float64))
        names = tuple(f"p{k}" for k in range(given_start.size))
    response, abscissa = np.asarray(y, dtype=np.float64), np.asarray(x)
    if response.ndim != 1 or not (np.isfinite(response).all() and np.isfinite(given_start).all()):
        raise FitError(
            "response and start are not all finite numbers in one row",
            hint="leave out rows without a value",
        )
    dof = response.size - given_start.size
    if dof <= 0:
        raise FitError(
            f"{response.size} values for {given_start.size} parameters leave nothing to judge by",
            hint="add values or fix parameters",
        )
    huge = BEYOND * max(float(np.max(np.abs(response))), np.finfo(np.float64).tiny)
    size = np.where(given_start == 0.0, 1.0, np.abs(given_start))

    def values(p: Array) -> Array:
        """Model [n]."""
        predicted = np.asarray(model(abscissa, *p), dtype=np.float64)
        if predicted.shape != response.shape:
            raise FitError(
                f"the model gives {predicted.shape} for a response of {response.shape}",
                hint="model(x, *parameters) gives one value for each of the response",
            )
        return predicted

    def misfit(p: Array) -> Array:
        """Model less response [n], huge where the model is not finite."""
        difference = values(p) - response
        return np.where(np.isfinite(difference), np.clip(difference, -huge, huge), huge)

    def slopes(p: Array) -> Array:
        """Derivatives [n, p] of the model, by differences on both sides."""
        columns = []
        for step in np.diag(STEP * np.where(p == 0.0, size, np.abs(p))):
            ahead, back = p + step, p - step
            columns.append((values(ahead) - values(back)) / np.sum(ahead - back))
        return np.asarray(np.nan_to_num(np.column_stack(columns), posinf=0.0, neginf=0.0))

    # The lowest of the sums of squares where the solver ends, from the given start and from starts
    # about it. Of equals the first: terms that change places fit as well, and the given start names
    # them.
    rng = np.random.default_rng(0)
    drawn = np.exp(SPREAD * rng.normal(size=(RESTARTS, given_start.size)))
    starts = np.where(given_start == 0.0, np.log(drawn), given_start * drawn)
    options: dict[str, Any] = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
    rounding = ROUNDING * rms(response)
    p, square = given_start, np.inf
    with np.errstate(all="ignore"):
        for begin in (given_start, *starts):
            try:
                end = least_squares(
                    misfit,
                    begin,
                    slopes,
                    method="lm",
                    x_scale="jac",
                    max_nfev=EVALUATIONS,
                    **options,
                ).x
            except (ValueError, np.linalg.LinAlgError, FloatingPointError):
                continue
            square_at_end = float(np.sum(misfit(end) ** 2))
            if np.isfinite(end).all() and square_at_end * (1.0 + EQUAL) + rounding**2 < square:
                p, square = end, square_at_end
        residuals, derivatives = -misfit(p), slopes(p)

    length = np.linalg.norm(derivatives, axis=0)
    scaled = derivatives / np.where(length > 0.0, length, 1.0)
    U, spread, vt = np.linalg.svd(scaled, full_matrices=False)
    if not spread[-1] > UNDETERMINED * spread[0]:
        name = names[int(np.argmax(np.abs(vt[-1])))]
        raise FitError(
            f"the data do not determine the parameters, most of all '{name}'",
            hint="fix it, or begin nearer to the answer",
        )
    explained = U.T @ residuals
    share = np.linalg.norm(explained) / np.sqrt(p.size)
    noise = np.linalg.norm(residuals - U @ explained) / np.sqrt(dof)
    if share > CONVERGED * noise and rms(residuals) > rounding:
        raise FitError(
            f"no minimum was reached: the derivatives explain {share / noise:.1g} of what noise"
            " would",
            hint="begin nearer to the answer, or scale the parameters",
        )
    inverse = (vt.T / spread) / length[:, None]
    covariance = inverse @ inverse.T * float(residuals @ residuals) / dof
    return Regression(names, p, covariance, dof, residuals)
