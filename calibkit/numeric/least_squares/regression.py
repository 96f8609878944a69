"""Nonlinear regression of any model, by two solvers of scipy from several starts: the lowest sum of
squares that is proved a minimum, or no answer.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms

METHODS: tuple[Literal["lm", "trf"], ...] = ("lm", "trf")
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
        names, begin = tuple(start), np.array(list(start.values()), dtype=np.float64)
    else:
        begin = np.atleast_1d(np.array(start, dtype=np.float64))
        names = tuple(f"p{k}" for k in range(begin.size))
    response, abscissa = np.asarray(y, dtype=np.float64), np.asarray(x)
    _require_enough(response, begin)
    huge = BEYOND * max(float(np.max(np.abs(response))), np.finfo(np.float64).tiny)
    size = np.where(begin == 0.0, 1.0, np.abs(begin))

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

    def attempt(begin: Array, method: Literal["lm", "trf"]) -> tuple[float, Array]:
        """Sum of squares, and parameters, where a solver ends."""
        options: dict[str, Any] = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
        try:
            end = least_squares(
                misfit, begin, slopes, method=method, x_scale="jac", max_nfev=EVALUATIONS, **options
            ).x
        except (ValueError, np.linalg.LinAlgError, FloatingPointError):
            end = begin
        end = end if np.isfinite(end).all() else begin
        return float(np.sum(misfit(end) ** 2)), end

    with np.errstate(all="ignore"):
        ends = [attempt(*attempt_start) for attempt_start in _starts(begin)]
        squares = np.array([square for square, _ in ends])
        # of equals the first: terms that change places fit as well, and the given start names them
        equal = squares <= squares.min() * (1.0 + EQUAL) + (ROUNDING * rms(response)) ** 2
        best = ends[int(np.argmax(equal))]
        for method in (*METHODS, METHODS[0]):
            best = min(best, attempt(best[1], method), key=lambda end: end[0])
        return _prove(best[1], misfit(best[1]), slopes(best[1]), rms(response), names)


def _require_enough(response: Array, begin: Array) -> None:
    """Raise FitError for data that no regression can take."""
    if response.ndim != 1 or not np.isfinite(response).all() or not np.isfinite(begin).all():
        raise FitError(
            "response and start are not all finite numbers in one row",
            hint="leave out rows without a value",
        )
    if response.size <= begin.size:
        raise FitError(
            f"{response.size} values for {begin.size} parameters leave nothing to judge by",
            hint="add values or fix parameters",
        )


def _starts(begin: Array) -> Iterator[tuple[Array, Literal["lm", "trf"]]]:
    """The given start with each solver, then starts about it."""
    for method in METHODS:
        yield begin, method
    rng = np.random.default_rng(0)
    for number in range(RESTARTS):
        factor = np.exp(SPREAD * rng.normal(size=begin.size))
        start = np.where(begin == 0.0, rng.normal(size=begin.size), begin * factor)
        yield start, METHODS[number % len(METHODS)]


def _prove(
    p: Array, misfit: Array, slopes: Array, size: float, names: tuple[str, ...]
) -> Regression:
    """Regression at parameters [p] that are a minimum, of what the model leaves [n] of a response
    of that rms and its derivatives [n, p]; raises FitError where they are none.
    """
    length = np.linalg.norm(slopes, axis=0)
    scaled = slopes / np.where(length > 0.0, length, 1.0)
    u, spread, vt = np.linalg.svd(scaled, full_matrices=False)
    if not spread[-1] > UNDETERMINED * spread[0]:
        name = names[int(np.argmax(np.abs(vt[-1])))]
        raise FitError(
            f"the data do not determine the parameters, most of all '{name}'",
            hint="fix it, or begin nearer to the answer",
        )
    explained, dof = u.T @ misfit, misfit.size - p.size
    share = np.linalg.norm(explained) / np.sqrt(p.size)
    noise = np.linalg.norm(misfit - u @ explained) / np.sqrt(dof)
    if share > CONVERGED * noise and rms(misfit) > ROUNDING * size:
        raise FitError(
            f"no minimum was reached: the derivatives explain {share / noise:.1g} of what noise"
            " would",
            hint="begin nearer to the answer, or scale the parameters",
        )
    inverse = (vt.T / spread) / length[:, None]
    return Regression(names, p, inverse @ inverse.T * float(misfit @ misfit) / dof, dof, -misfit)
