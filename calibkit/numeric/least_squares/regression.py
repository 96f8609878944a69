"""Nonlinear regression of any model, by two solvers of scipy from several starts: the lowest sum of
squares that is proved a minimum, or no answer.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

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
UNDETERMINED = 1e-11
"""Smallest singular value of the derivatives, scaled to unit length, below which the data do not
determine the parameters.
"""
IMAGINARY = 1e-30
"""Step of complex differentiation, relative to the parameter: exact to rounding (Squire & Trapp
1998).
"""
ALIKE = 1e-4
"""Largest relative difference of complex from ordinary derivatives of a model that takes complex
parameters.
"""
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
    if isinstance(start, Mapping):
        names, begin = tuple(start), np.array(list(start.values()), dtype=np.float64)
    else:
        begin = np.atleast_1d(np.array(start, dtype=np.float64))
        names = tuple(f"p{k}" for k in range(begin.size))
    response = np.asarray(y, dtype=np.float64)
    _require(response, begin)
    problem = _Problem.of(model, np.asarray(x), response, begin)
    found = [problem.attempt(one, method) for one, method in _starts(begin)]
    squares = np.array([problem.square(one) for one in found])
    # of equals the first: terms that change places fit as well, and the given start names them
    equal = squares <= squares.min() * (1.0 + EQUAL) + (ROUNDING * rms(response)) ** 2
    best = found[int(np.argmax(equal))]
    for method in (*METHODS, METHODS[0]):
        best = min(best, problem.attempt(best, method), key=problem.square)
    return problem.prove(best, names)


def _require(response: Array, begin: Array) -> None:
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
        moved = np.where(begin == 0.0, rng.normal(size=begin.size), begin * factor)
        yield moved, METHODS[number % len(METHODS)]


@dataclass(frozen=True, slots=True)
class _Problem:
    """A model with its data."""

    model: Model
    x: Array
    y: Array
    size: Array
    """[p], what parameters are counted in."""
    complex_steps: bool = False

    @classmethod
    def of(cls, model: Model, x: Array, y: Array, begin: Array) -> "_Problem":
        """Problem whose derivatives are complex steps where the model takes them."""
        plain = cls(model, x, y, np.where(begin == 0.0, 1.0, np.abs(begin)))
        plain.values(begin)
        exact = replace(plain, complex_steps=True)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # of a model that takes the real part
                fine, coarse = exact.slopes(begin), plain.slopes(begin)
        except (TypeError, ValueError):
            return plain
        size = np.max(np.abs(coarse), axis=0)
        return exact if (np.max(np.abs(fine - coarse), axis=0) <= ALIKE * size).all() else plain

    def values(self, parameters: Array) -> Array:
        """Model [n] at parameters [p]; raises FitError for one of another shape."""
        with np.errstate(all="ignore"):
            found = np.asarray(self.model(self.x, *parameters))
        if found.shape != self.y.shape:
            raise FitError(
                f"the model gives {found.shape} for a response of {self.y.shape}",
                hint="model(x, *parameters) gives one value for each of the response",
            )
        return np.asarray(found.real, dtype=np.float64)

    def left(self, parameters: Array) -> Array:
        """Model less response [n], huge where the model is not finite."""
        values = self.values(parameters) - self.y
        huge = BEYOND * max(float(np.max(np.abs(self.y))), np.finfo(np.float64).tiny)
        return np.where(np.isfinite(values), np.clip(values, -huge, huge), huge)

    def square(self, parameters: Array) -> float:
        """Sum of squares."""
        left = self.left(parameters)
        return float(left @ left)

    def slopes(self, parameters: Array) -> Array:
        """Derivatives [n, p] of the model."""
        columns = []
        for k, value in enumerate(parameters.tolist()):
            size = abs(value) or self.size[k]
            if self.complex_steps:
                moved = parameters.astype(np.complex128)
                moved[k] += 1j * IMAGINARY * size
                columns.append(np.imag(self.model(self.x, *moved)) / (IMAGINARY * size))
                continue
            step = np.cbrt(np.finfo(np.float64).eps) * size
            ahead, back = (parameters + s * step * np.eye(self.size.size)[k] for s in (1, -1))
            columns.append((self.values(ahead) - self.values(back)) / (ahead[k] - back[k]))
        with np.errstate(all="ignore"):
            found = np.nan_to_num(np.column_stack(columns), posinf=0.0, neginf=0.0)
        return np.asarray(found, dtype=np.float64)

    def attempt(self, begin: Array, method: Literal["lm", "trf"]) -> Array:
        """Parameters where a solver ends."""
        from scipy.optimize import least_squares

        with np.errstate(all="ignore"):
            try:
                found = least_squares(
                    self.left,
                    begin,
                    self.slopes,
                    method=method,
                    x_scale="jac",
                    ftol=1e-15,
                    xtol=1e-15,
                    gtol=1e-15,
                    max_nfev=EVALUATIONS,
                ).x
            except (ValueError, np.linalg.LinAlgError, FloatingPointError):
                return begin
        return np.asarray(found, dtype=np.float64) if np.isfinite(found).all() else begin

    def prove(self, found: Array, names: tuple[str, ...]) -> Regression:
        """Regression at parameters that are a minimum; raises FitError where they are not."""
        with np.errstate(all="ignore"):
            left, slopes = self.left(found), self.slopes(found)
        length = np.linalg.norm(slopes, axis=0)
        scaled = slopes / np.where(length > 0.0, length, 1.0)
        u, spread, vt = np.linalg.svd(scaled, full_matrices=False)
        if not spread[-1] > UNDETERMINED * spread[0]:
            name = names[int(np.argmax(np.abs(vt[-1])))]
            raise FitError(
                f"the data do not determine the parameters, most of all '{name}'",
                hint="fix it, or begin nearer to the answer",
            )
        explained, dof = u.T @ left, left.size - found.size
        rest = left - u @ explained
        share = np.linalg.norm(explained) / np.sqrt(found.size)
        noise = np.linalg.norm(rest) / np.sqrt(dof)
        if share > CONVERGED * noise and rms(left) > ROUNDING * rms(self.y):
            raise FitError(
                f"no minimum was reached: the derivatives explain {share / noise:.1g} of what noise"
                " would",
                hint="begin nearer to the answer, or scale the parameters",
            )
        inverse = (vt.T / spread) / length[:, None]
        return Regression(names, found, inverse @ inverse.T * float(left @ left) / dof, dof, -left)
