"""Fit of an equation to rows that share errors.

    r(p) = J (p - p0) + Σ_g Z_g b_g + e

r is what the equation leaves of the rows, p its parameters, b_g errors that all rows of a level
share, e noise, of each sensor its own. The sizes of all errors are the most likely ones
(`likelihood`), p follows by generalised least squares, and every result is a function of p:
`Fit.of` states its uncertainty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibkit.errors import FitError, UsageError
from calibkit.fit import likelihood
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.fit.likelihood import KnownVariances, MixedRows, MixedSolution
from calibkit.fit.shared import Prior, Residual, Shared
from calibkit.fit.value import Value
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.least_squares import fit as least_squares

ASKED_FOR = 6.0
"""Fall of -2 log L that keeps an optional error: by chance once in 140 tries, a variance that is 0
half the time and else as χ² with one degree of freedom (Self & Liang 1987). An error that is not
asked for may be as large as that (`accelerometer.shared_errors.bounded_errors`).
"""
OUTLIER_CHANCE = 0.005
"""Chance that any faultless row of a fit is called an outlier."""
MANY = 1e9
"""Degrees of freedom of what is known."""
HESITANT = 12.0
"""How much less than asked for the first step of an optional error may promise: it is the whole
fall for an error that is about as large as its u, and too little for larger ones.
"""
MOST_OF_A_LEVEL = 0.5
"""Share of the rows of a level that, standing out together, have an error and are no outliers."""
SETTLED = 1e-3
"""Step of a parameter, in its standard uncertainty, that ends the iteration."""
STEPS = 30
HALVINGS = 30
ROUNDING = 1e-11
"""Residuals this small, relative to what the parameters explain, are rounding: no size is estimated
of them.
"""
ROUNDING_FAR = 10.0
"""Rounding of a residual, over what counts as such, of which no outlier is made."""
CHUNK = 4000
"""Rows of [J Z y] that stand in memory at once."""


@dataclass(frozen=True, slots=True)
class SharedSize:
    """Size of a shared error in a fit."""

    error: Shared
    value: float
    u: float
    dof: int
    """Levels less what the parameters take from them; 0 where the rows cannot tell the error from
    the parameters.
    """
    errors: Array
    """[levels, k], of each level as the rows show them; empty where each has one row."""

    @property
    def known(self) -> bool:
        """Whether the size was stated, not estimated alone."""
        return self.error.size is not None


@dataclass(frozen=True, slots=True)
class Fit:
    """Parameters with what is known of them."""

    parameters: Array
    """[p]."""
    covariance: Array
    """[p, p], type A, with what the estimation of the sizes adds."""
    residual: Array
    """[n], what the equation leaves; shared errors are part of it."""
    noise_residual: Array
    """[n], the residual without the shared errors, as the rows show them."""
    used: Mask
    """[n], residuals that are no outliers."""
    dof: int
    """Residuals used less parameters."""
    condition: float
    """Of the scaled Jacobian."""
    shared: tuple[SharedSize, ...]
    """Errors that the fit kept, with their sizes."""
    converged: bool
    variances: Array = field(repr=False)
    """[v], of the noise of each channel, of priors, and of `shared`."""
    variance_covariance: Array = field(repr=False)
    """[v, v]; 0 for a variance that is held."""
    slopes: Array = field(repr=False)
    """[v, p, p], derivatives of the covariance by the variances."""
    noise_shares: Array = field(repr=False)
    """[parts, n], what the first variances add to the variance of the noise of each residual."""
    jacobian: Array = field(repr=False)
    """[n, p], derivatives of the residuals by the parameters that were solved for; 0 by one that
    was not free.
    """
    gain: Array = field(repr=False)
    """[p, n], change of the parameters by a change of what the residuals should be."""
    bounds: Array = field(repr=False)
    """[p, k], changes of the parameters by errors as large as their bounds allow."""
    solution: MixedSolution = field(repr=False)
    """At the most likely sizes, in orthonormal columns."""
    members: tuple["Fit", ...] = field(default=(), repr=False)
    """Of an average: the fits of single orders."""
    weights: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    """[members]."""

    @property
    def noise(self) -> Array:
        """[n], standard deviation of the noise of each residual."""
        parts = len(self.noise_shares)
        return np.asarray(np.sqrt(self.variances[:parts] @ self.noise_shares))

    @property
    def mixed(self) -> tuple[SharedSize, ...]:
        """Errors that several residuals share, in the order of their variances, the last of all."""
        return tuple(size for size in self.shared if not size.error.is_noise)

    @property
    def total_covariance(self) -> Array:
        """[p, p], with the errors that are as large as their bounds."""
        return self.covariance + self.bounds @ self.bounds.T

    def of(self, function: Callable[[Numbers], Numbers]) -> Value:
        """A function [...] of the parameters with its uncertainty: the one way to state a result.

        Degrees of freedom are 2 v²/var(v) of the estimated variance v (Satterthwaite 1946;
        Giesbrecht & Burns 1985), at least 1 and at most those of the rows.
        """
        value = np.asarray(function(self.parameters), dtype=np.float64)
        G = self._slopes_of(function).reshape(-1, len(self.parameters))
        variance = np.einsum("ip,pq,iq->i", G, self.covariance, G)
        bound = np.sum((G @ self.bounds) ** 2, axis=1)
        u = np.sqrt(np.maximum(variance, 0.0) + bound).reshape(value.shape)
        return Value(value, u, self.dof_along(G).reshape(value.shape))

    def dof_along(self, G: Array) -> Array:
        """Effective degrees of freedom [m] of combinations [m, p] of the parameters; those of an
        average are the average of the members'.
        """
        if self.members:
            return np.asarray(self.weights @ [member.dof_along(G) for member in self.members])
        by_size = np.einsum("ip,vpq,iq->vi", G, self.slopes, G)
        spread = np.einsum("vi,vw,wi->i", by_size, self.variance_covariance, by_size)
        # where all sizes are known the variance is known too: infinite degrees of freedom
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(spread > 0.0, 2.0 * (self.variances @ by_size) ** 2 / spread, np.inf)
        return np.clip(dof, 1.0, max(self.dof, 1))

    def combined(self, G: Array) -> "Fit":
        """The fit of combinations G p [m] of the parameters, with their covariance."""
        return replace(
            self,
            parameters=G @ self.parameters,
            covariance=G @ self.covariance @ G.T,
            slopes=G @ self.slopes @ G.T,
            gain=G @ self.gain,
            bounds=G @ self.bounds,
            members=tuple(member.combined(G) for member in self.members),
        )

    def restated(self, function: Callable[[Numbers], Numbers]) -> "Fit":
        """The fit of other parameters, a function [m] of these, with their covariance."""
        return replace(
            replace(self, members=()).combined(self._slopes_of(function)),
            parameters=np.asarray(function(self.parameters), dtype=np.float64),
            members=tuple(member.restated(function) for member in self.members),
        )

    def _slopes_of(self, function: Callable[[Numbers], Numbers]) -> Array:
        """Derivatives [..., p] of a function of the parameters; 0 where these have no errors."""
        if self.variances.size:
            return derivative(function, self.parameters)
        return np.zeros((*np.shape(function(self.parameters)), len(self.parameters)))

    def without_errors(self, parameters: Array) -> "Fit":
        """The same equation with other parameters, which have no errors: values alone are stated,
        in less time.
        """
        p, n = len(parameters), len(self.residual)
        return replace(
            self,
            parameters=parameters,
            covariance=np.zeros((p, p)),
            variances=np.zeros(0),
            variance_covariance=np.zeros((0, 0)),
            slopes=np.zeros((0, p, p)),
            noise_shares=np.zeros((0, n)),
            gain=np.zeros((p, 0)),
            bounds=np.zeros((p, 0)),
            members=(),
        )

    def part(self, places: Sequence[int] | Integers | slice) -> "Fit":
        """The fit of some of the parameters."""
        return self.restated(lambda p: p[places])

    def linear(self, P: Array, y: Array) -> "Fit":
        """Parameters P y [m] of a published form by plain least squares, with the covariance of the
        errors of this fit, P R Pᵀ + Σ θ (P Z)(P Z)ᵀ; P [m, n] is 0 and y [n] is not read where a
        row is not used.
        """
        by_variance = [(P * share) @ P.T for share in self.noise_shares]
        for size in self.mixed:
            PZ = size.error.gathered(P.T).T
            by_variance.append(PZ @ PZ.T)
        slopes = np.array(by_variance)
        return replace(
            self,
            parameters=P @ np.where(self.used, y, 0.0),
            covariance=np.tensordot(self.variances, slopes, 1),
            slopes=slopes,
            gain=P,
            bounds=np.zeros((len(P), 0)),
            members=tuple(member.linear(P, y) for member in self.members),
        )

    def bounded_by(self, errors: Sequence[Shared]) -> "Fit":
        """The fit whose U holds errors of a stated largest size, which are no part of the noise."""
        columns = [error.gathered(self.gain.T).T * error.size for error in errors if error.size]
        return replace(self, bounds=np.hstack([self.bounds, *columns]))

    def widened_by(self, errors: Sequence[Shared]) -> "Fit":
        """The fit whose U holds errors of stated sizes that the rows do not tell from the
        parameters; one without errors stays so.
        """
        if not self.variances.size:
            return self
        size = np.array([error.size or 0.0 for error in errors])
        # variance of an estimated variance θ with ν degrees of freedom: 2 θ²/ν
        of_size = 2.0 * size**4 / np.array([error.size_dof for error in errors])
        products = [error.gathered(self.gain.T).T for error in errors]
        added = np.array([PZ @ PZ.T for PZ in products]).reshape(-1, *self.covariance.shape)
        count = len(self.variances)
        spread = np.zeros((count + len(size),) * 2)
        spread[:count, :count] = self.variance_covariance
        spread[np.arange(count, len(spread)), np.arange(count, len(spread))] = of_size
        return replace(
            self,
            covariance=self.covariance + np.tensordot(size**2, added, 1),
            variances=np.concatenate((self.variances, size**2)),
            variance_covariance=spread,
            slopes=np.concatenate((self.slopes, added)),
            members=tuple(member.widened_by(errors) for member in self.members),
        )

    def precision(self, F: Array) -> Array:
        """V⁻¹ F [n, k], V of the noise and the shared errors of the rows used; 0 of the others."""
        R = self.noise[:, None] ** 2
        weighted = np.where(self.used[:, None], F / R, 0.0)
        sizes = [size for size in self.mixed if size.value > 0.0]
        if not sizes:
            return weighted
        q = sum(size.error.levels * size.error.width for size in sizes)
        ZRF, inner = np.zeros((q, F.shape[1])), np.eye(q)

        def loadings(rows: Integers) -> Array:
            return np.hstack([size.error.design(rows) * size.value for size in sizes])

        rows = np.flatnonzero(self.used)
        for chunk in _chunks(rows):
            Z = loadings(chunk)
            ZRF += Z.T @ weighted[chunk]
            inner += Z.T @ (Z / R[chunk])
        # V⁻¹ = R⁻¹ - R⁻¹ Z (I + Zᵀ R⁻¹ Z)⁻¹ Zᵀ R⁻¹ (Woodbury 1950)
        shares = np.linalg.solve(inner, ZRF)
        for chunk in _chunks(rows):
            weighted[chunk] -= loadings(chunk) @ shares / R[chunk]
        return weighted

    def further_error(self, jacobian: Array, loading: Array) -> tuple[Array, Array]:
        """Errors [k] that all rows would share by a loading [n, k], and their standard
        uncertainties, beside the parameters with derivatives [n, p] and what the fit has.
        """
        VL, VJ = self.precision(loading), self.precision(jacobian)
        JL = jacobian.T @ VL
        information = loading.T @ VL - JL.T @ np.linalg.solve(jacobian.T @ VJ, JL)
        inverse = np.linalg.inv(information)
        return -inverse @ (VL.T @ self.residual), np.sqrt(np.diag(inverse))


def solve(
    residual: Residual,
    start: Array,
    shared: Sequence[Shared] = (),
    *,
    priors: Sequence[Prior] = (),
    channel: Integers | None = None,
    noise: Array | None = None,
    estimate_noise: bool = True,
    used: Mask | None = None,
    leave_out: bool = False,
    free: Mask | None = None,
    names: Sequence[str] = (),
) -> Fit:
    """Fit by Gauss-Newton steps, each at the most likely sizes of the errors.

    Parameters
    ----------
    residual : what the equation leaves [n] or [n, m] at parameters [p]; see `complex_step`.
    start : [p].
    shared : errors that residuals share; the optional ones are kept where the likelihood asks.
    priors : parameters that are known beforehand.
    channel : [n], number of the sensor of each residual, from 0; each has a noise of its own.
    noise : [n], standard deviation of the noise of each residual, or what is proportional to it
        within each channel where `estimate_noise`.
    used : [n], residuals that are no outliers, to begin with.
    leave_out : whether residuals are left out, and taken in again, by their size.
    free : [p], parameters that are fitted; the others stay as they start.
    names : [p], what an error calls the parameters.

    Raises
    ------
    FitError : parameters that the rows do not determine, by name; no residual left over.

    """
    problem = _Problem(residual, start, shared, priors, channel, noise, free, names)
    active = [g for g, error in enumerate(problem.mixed) if not error.optional]
    optional_errors = [g for g, error in enumerate(problem.mixed) if error.optional]
    used = np.ones(problem.n, dtype=np.bool_) if used is None else used
    p = problem.start[problem.free]
    near_variances, converged = None, False
    for step in range(STEPS):
        linear_form = problem.linearise(
            p, used, noise_known=noise is not None and not estimate_noise
        )
        solution = likelihood.maximise(linear_form.rows.of_groups(active), near_variances)
        if step == 1:  # where the equation is already straight
            solution = _take_optional(linear_form, solution, active, optional_errors)
        near_variances = solution.variances
        # -r = J Δp + Σ Z_g b_g + e at the most likely sizes: Δp, b, and what is left of the noise
        change = linear_form.basis @ solution.coefficients
        shared_part = np.zeros(len(linear_form.y))
        for g, b in problem.errors_of_levels(solution, active).items():
            shared_part[: problem.n] += problem.mixed[g].along(b) / problem.relative
        noise_residual = (linear_form.y - linear_form.J @ change - shared_part)[: problem.n]
        good = used
        if leave_out:  # residuals that are rounding are no outliers
            good = problem.find_good(noise_residual, linear_form, solution, used, active)
            good |= noise_residual**2 <= ROUNDING_FAR**2 * linear_form.rows.known.noise_floor
        p = p + problem.shortened(p, change, shared_part, linear_form, solution, used)
        # done where the step is small against u, and no residual came in or went out
        half = linear_form.basis @ np.linalg.cholesky(solution.inverse[: len(p), : len(p)])
        u = np.linalg.norm(half, axis=1)
        rounding = np.finfo(np.float64).eps * np.abs(p)
        converges = bool(np.all(np.abs(change) <= SETTLED * u + rounding))
        if converges and step > 0 and np.array_equal(good, used):
            converged = True
            break
        used = good
    fit = problem.result(p, linear_form, solution, active, used)
    return replace(fit, noise_residual=-noise_residual * problem.relative, converged=converged)


def _take_optional(
    linear_form: "_Linearised",
    solution: MixedSolution,
    active: list[int],
    optional_errors: list[int],
) -> MixedSolution:
    """Solution with those errors that the likelihood asks for, the one of the largest fall first;
    they move from the optional ones to the active ones.
    """
    parts = len(linear_form.rows.shares)
    while True:
        wider: dict[int, MixedSolution] = {}
        for g in optional_errors:
            if not linear_form.rows.known.free[parts + g]:
                continue
            Z = linear_form.rows.Z[:, linear_form.rows.group == g]
            variance, fall = likelihood.first_step(solution, Z)
            if fall < ASKED_FOR / HESITANT:
                continue
            with_error = likelihood.maximise(
                linear_form.rows.of_groups([*active, g]), np.append(solution.variances, variance)
            )
            # An error that takes most of the residuals that show the noise leaves little of them by
            # chance: of six degrees of freedom three are left, and -2 log L falls by more than
            # ASKED_FOR once in 90 tries. The limit grows by the ratio of the degrees of freedom,
            # which is 1 for many rows.
            fall = solution.deviance - with_error.deviance
            if fall * with_error.noise_degrees >= ASKED_FOR * solution.noise_degrees:
                wider[g] = with_error
        if not wider:
            return solution
        best = min(wider, key=lambda g: wider[g].deviance)
        solution = wider[best]
        active.append(best)
        optional_errors.remove(best)


def predict(
    residual: Residual,
    p: Array,
    shared: Sequence[Shared] = (),
    *,
    priors: Sequence[Prior] = (),
    noise: Array,
    names: Sequence[str] = (),
) -> Fit:
    """Fit of rows that are imagined at parameters [p]: all sizes as they are stated, degrees of
    freedom by the expected information.

    Parameters
    ----------
    residual, p, shared, priors, names : as of `solve`; an optional error of no stated size is left
        out.
    noise : [n], standard deviation of the noise of each residual.

    Raises
    ------
    UsageError : an error of no stated size, by name.
    FitError : parameters that the rows do not determine, by name.

    """
    required = [error for error in shared if not error.optional or error.size is not None]
    for error in required:
        if error.size is None:
            raise UsageError(
                f"the size of the error '{error.effect}' of group '{error.group}' is not known",
                hint="state it in [device] of the equipment file or in [[errors.component]]",
            )
    # a stated size of 0 says that the error is not there
    present = [error for error in required if error.size]
    problem = _Problem(residual, p, present, priors, None, noise, None, names)
    used = np.ones(problem.n, dtype=np.bool_)
    linear_form = problem.linearise(p, used, noise_known=False)
    sizes = [1.0, *(prior.size for prior in priors)]
    sizes += [error.size or 0.0 for error in (*problem.noises, *problem.mixed)]
    solution = MixedSolution(linear_form.rows, np.array(sizes) ** 2)
    fit = problem.result(p, linear_form, solution, range(len(problem.mixed)), used)
    # the sizes are stated: their estimation adds nothing
    embed = problem.embed(linear_form)
    covariance = embed @ solution.inverse[: len(p), : len(p)] @ embed.T
    return replace(fit, covariance=covariance, converged=True)


def sensitivities(residual: Residual, shifted: Sequence[Residual], fit: Fit) -> list[Array]:
    """Changes [p] of the parameters where an input of the rows is off, for each of several errors,
    the weights held.

    dβ = -(Jᵀ V⁻¹ J)⁻¹ (Jᵀ V⁻¹ dr + dJᵀ V⁻¹ r), dr and dJ the changes of the residuals and of their
    derivatives.
    """
    if fit.members:
        by_member = [sensitivities(residual, shifted, member) for member in fit.members]
        return list(np.tensordot(fit.weights, by_member, 1))
    p = fit.parameters
    J, Vr = _jacobian(residual, p), fit.precision(fit.residual[:, None])[:, 0]
    # (Jᵀ V⁻¹ J)⁻¹ = G V Gᵀ, 0 for a parameter that is not fitted
    # slopes are G V_i Gᵀ: summed with the variances they are G V Gᵀ
    inverse = np.tensordot(fit.variances, fit.slopes, 1)
    changes = []
    for shifted_rows in shifted:
        dJ, dr = _jacobian(shifted_rows, p) - J, (shifted_rows(p) - residual(p)).ravel()
        changes.append(np.asarray(-(fit.gain @ dr + inverse @ (dJ.T @ Vr)), dtype=np.float64))
    return changes


def stand_out_together(good: Mask, level: Integers) -> Mask:
    """Rows [n] of the levels [n] of which most are not `good`, of levels of several rows."""
    # an error of a level is no outlier: a face that is set up wrong has all its rows off
    count = np.bincount(level)
    share = np.bincount(level, good) / np.maximum(count, 1)
    return np.asarray(((share < MOST_OF_A_LEVEL) & (count > 1))[level])


def _jacobian(residual: Residual, p: Array) -> Array:
    """Derivatives [n, p] of the residuals, one after the other."""
    return derivative(lambda q: residual(q).ravel(), p)


def _chunks(rows: Integers) -> list[Integers]:
    """Row numbers in parts of which [J Z y] fits in memory."""
    return np.array_split(rows, -(-len(rows) // CHUNK)) if len(rows) else []


@dataclass(frozen=True, slots=True)
class _Linearised:
    """Equation (1) of `likelihood` about some parameters."""

    J: Array
    """[N, p], rows of the priors last; divided by the noise of each row where it is given."""
    y: Array
    """[N]."""
    basis: Array
    """[p, p], what turns coefficients of orthonormal columns into changes of the parameters."""
    rows: MixedRows
    degrees: tuple[int, ...]
    """Levels of each mixed error that the parameters leave apart."""
    condition: float


class _Problem:
    """Equation, errors and rows of one fit; residuals are divided by `relative`.

    Attributes
    ----------
    residual : [p free] → [n].
    noises, mixed, bounds : errors with one residual a level, which are parts of the noise; those
        that several residuals share; those of a stated largest size.
    relative : [n], noise of a residual relative to that of its channel.
    shares : [parts, N], what channels, priors and noises add to the variance of a row, in units of
        `relative`²; rows of the priors stand last.

    """

    def __init__(
        self,
        residual: Residual,
        start: Array,
        shared: Sequence[Shared],
        priors: Sequence[Prior],
        channel: Integers | None,
        noise: Array | None,
        free: Mask | None,
        names: Sequence[str],
    ) -> None:
        self.start = np.asarray(start, dtype=np.float64)
        self.free = np.ones(len(start), dtype=np.bool_) if free is None else free
        self.residual: Residual = lambda p: residual(self._all_parameters(p)).ravel()
        self.n = n = len(self.residual(self.start[self.free]))
        self.priors = tuple(priors)
        inside = [error for error in shared if not error.bound]
        self.noises = tuple(error for error in inside if error.is_noise)
        self.mixed = tuple(error for error in inside if not error.is_noise)
        self.bounds = tuple(error for error in shared if error.bound)
        self.relative = np.ones(n) if noise is None else np.asarray(noise, dtype=np.float64)
        self.channel = np.zeros(n, dtype=np.int64) if channel is None else channel
        self.channels = int(self.channel.max()) + 1
        names = tuple(names) or tuple(f"parameter {k}" for k in range(len(start)))
        self.names = [name for name, is_free in zip(names, self.free, strict=True) if is_free]
        ends = n + np.cumsum([0, *(len(prior.rows(self.start)) for prior in priors)])
        self.shares = np.zeros((self.channels + len(priors) + len(self.noises), ends[-1]))
        self.shares[self.channel, np.arange(n)] = 1.0
        for k in range(len(priors)):
            self.shares[self.channels + k, ends[k] : ends[k + 1]] = 1.0
        for k, error in enumerate(self.noises, start=self.channels + len(priors)):
            square = np.sum(error.loading**2, axis=1) / self.relative**2
            self.shares[k, :n] = np.where(error.level >= 0, square, 0.0)
        # rows of equal noise are turned into few together
        self.patterns, pattern = np.unique(self.shares, axis=1, return_inverse=True)
        self.pattern = pattern.reshape(-1)

    def _all_parameters(self, p: Numbers) -> Numbers:
        """Parameters of which those that are fitted are p [p free]."""
        parameters = self.start.astype(p.dtype)
        parameters[self.free] = p
        return parameters

    def stacked_residuals(self, p: Numbers) -> Numbers:
        """Residuals [N] in units of `relative`, and below them those of the priors."""
        priors = [prior.rows(self._all_parameters(p)) for prior in self.priors]
        return np.concatenate([self.residual(p) / self.relative, *priors])

    def fitted_rows(self, used: Mask) -> Mask:
        """Rows [N] that are used: residuals [n], and all priors."""
        return np.append(used, np.ones(self.shares.shape[1] - self.n, dtype=np.bool_))

    def linearise(self, p: Array, used: Mask, *, noise_known: bool) -> _Linearised:
        """The equation about p, its used rows turned into few."""
        y, J = -self.stacked_residuals(p), derivative(self.stacked_residuals, p)
        fitted_rows = self.fitted_rows(used)
        count = int(fitted_rows.sum())
        if count <= len(p):
            raise FitError(
                f"{count} rows for {len(p)} coefficients leave no residual",
                hint="add data or lower the order",
            )
        J_rows, Z, y_rows, shares, counts = self._triangles(J, y, fitted_rows)
        # refuses, by name, parameters that the rows do not determine
        least_squares_fit = least_squares.linear(J_rows, y_rows, names=self.names)
        # orthonormal columns in each block: parameters in whatever units are solved for alike
        Q, basis = np.zeros_like(J_rows), np.zeros((len(p), len(p)))
        for block in likelihood.blocks(np.hstack([J_rows, Z])):
            columns = block.columns[block.columns < len(p)]
            crossings = np.ix_(block.rows, columns)
            Q[crossings], R = np.linalg.qr(J_rows[crossings])
            basis[np.ix_(columns, columns)] = least_squares.triangular(R, np.eye(len(columns)))
        widths = [error.levels * error.width for error in self.mixed]
        group = np.repeat(np.arange(len(self.mixed)), widths)
        # the target of a linear equation: y = target - J p
        largest = float(np.max(np.abs(y + J @ p)[fitted_rows]))
        least_variance = max((ROUNDING * largest) ** 2, float(np.finfo(np.float64).tiny))
        # residuals that are rounding alone show no error of any size
        exact = float(np.sum(least_squares_fit.residuals**2)) / (count - len(p)) <= least_variance
        degrees = tuple(
            0 if exact else likelihood.degrees(Q, Z[:, group == g]) for g in range(len(self.mixed))
        )
        known = self._known_variances(degrees, least_variance, noise_known=noise_known)
        rows = MixedRows(Q, Z, y_rows, shares, counts, group, len(self.mixed), known)
        return _Linearised(J, y, basis, rows, degrees, least_squares_fit.condition)

    def _triangles(
        self, J: Array, y: Array, fitted_rows: Mask
    ) -> tuple[Array, Array, Array, Array, Array]:
        """J, Z, y, shares and counts of the rows, those of equal noise turned into each other."""
        p, triangles, shares, counts = J.shape[1], [], [], []
        for k, of_pattern in enumerate(self.patterns.T):
            rows = np.flatnonzero((self.pattern == k) & fitted_rows)
            if not len(rows):
                continue
            triangle = np.empty((0, 0))
            for chunk in _chunks(rows):
                block = np.hstack([J[chunk], self._loadings(chunk), y[chunk, None]])
                triangle = np.vstack([triangle.reshape(-1, block.shape[1]), block])
                felt = np.any(triangle != 0.0, axis=0)
                if len(triangle) > np.sum(felt):
                    triangle_of_felt = np.zeros((int(np.sum(felt)), triangle.shape[1]))
                    triangle_of_felt[:, felt] = np.linalg.qr(triangle[:, felt], mode="r")
                    triangle = triangle_of_felt
            count = np.ones(len(triangle))
            noise_alone = len(rows) - len(triangle)
            if noise_alone:  # zero in J, Z and y: one row stands for all of them
                triangle = np.vstack([triangle, np.zeros(triangle.shape[1])])
                count = np.append(count, float(noise_alone))
            triangles.append(triangle)
            counts.append(count)
            shares.append(np.repeat(of_pattern[:, None], len(triangle), axis=1))
        stacked = np.concatenate(triangles)
        return (
            stacked[:, :p],
            stacked[:, p:-1],
            stacked[:, -1],
            np.hstack(shares),
            np.concatenate(counts),
        )

    def _loadings(self, rows: Integers) -> Array:
        """Z [m, q] of all mixed errors in some rows, in units of `relative`; 0 in priors."""
        Z = np.zeros((len(rows), sum(error.levels * error.width for error in self.mixed)))
        inside = rows[rows < self.n]
        if self.mixed and len(inside):
            parts = [error.design(inside) for error in self.mixed]
            Z[rows < self.n] = np.hstack(parts) / self.relative[inside, None]
        return Z

    def _known_variances(
        self, degrees: Sequence[int], least_variance: float, *, noise_known: bool
    ) -> KnownVariances:
        """What is known of the variances. Where the rows tell nothing of an error, its size is as
        stated, with the degrees of freedom that are stated, and 0 if it is not.
        """
        # residuals are divided by the stated noise, whose variance is then held at 1
        known = [(1.0, np.inf) if noise_known else (0.0, 0.0)] * self.channels
        known += [(prior.size, prior.size_dof) for prior in self.priors]
        ranks = [*(1 for _ in self.noises), *degrees]
        for error, rank in zip((*self.noises, *self.mixed), ranks, strict=True):
            if error.size is None:
                known.append((0.0, 0.0 if rank else np.inf))
            else:
                known.append((error.size, error.size_dof if error.size else np.inf))
        size, dof = np.array(known).T
        limits = [np.inf] * len(self.shares) + [error.largest for error in self.mixed]
        return KnownVariances(size**2, dof, np.array(limits) ** 2, least_variance)

    def errors_of_levels(self, solution: MixedSolution, active: Sequence[int]) -> dict[int, Array]:
        """Shared errors b [levels · k], as the rows show them, of each mixed error that is kept."""
        widths = [self.mixed[g].levels * self.mixed[g].width for g in active]
        return dict(zip(active, np.split(solution.errors, np.cumsum(widths)[:-1]), strict=False))

    def columns(
        self,
        rows: Integers,
        linear_form: _Linearised,
        solution: MixedSolution,
        active: Sequence[int],
    ) -> Array:
        """[J Z θ^½] of some rows, the columns that `solution.inverse` is of."""
        Z = np.hstack([np.empty((len(rows), 0)), *(self.mixed[g].design(rows) for g in active)])
        Z = Z / self.relative[rows, None] * solution.root
        return np.hstack([linear_form.J[rows] @ linear_form.basis, Z])

    def find_good(
        self,
        noise_residual: Array,
        linear_form: _Linearised,
        solution: MixedSolution,
        used: Mask,
        active: Sequence[int],
    ) -> Mask:
        """Residuals [n] that are no outliers: the noise of a faultless one exceeds the limit with a
        chance of 0.5 % in the whole fit.

        What is left of a residual that was fitted is smaller than its noise, of one that was not
        larger. Over the noise s of ν degrees of freedom, the latter is Student's t; the former has
        its part in s, so t √(ν/(ν - 1 + t²)) with t of ν - 1 (Thompson 1935). Those of a level, or
        of one channel in it, of which most stand out together have an error of their own, and stay.
        """
        from scipy.special import stdtrit

        # where the noise is stated it is taken as known
        estimated = bool(solution.rows.known.free[: self.channels].all())
        dof = max(solution.noise_degrees / self.channels, 2.0) if estimated else MANY
        apart, t = -stdtrit([dof, dof - 1.0], OUTLIER_CHANCE / (2.0 * self.n))
        of_fitted = float(t * np.sqrt(dof / (dof - 1.0 + t**2)))
        limit = np.where(used, of_fitted, float(apart))
        R = solution.noise_along(self.shares)[: self.n]
        scaled = np.abs(noise_residual) / np.sqrt(R)
        # the leverage, a solution for each row, is needed of rows near the limit alone
        good = scaled <= 0.5 * limit
        # the variance of what is left over that of the noise, of those that may be beyond
        doubtful = np.flatnonzero(~good)
        if not doubtful.size:
            return good
        T = self.columns(doubtful, linear_form, solution, active)
        leverage = np.einsum("ij,jk,ik->i", T, solution.inverse, T) / R[doubtful]
        spread = np.where(used[doubtful], np.maximum(1.0 - leverage, 0.0), 1.0 + leverage)
        good[doubtful] = scaled[doubtful] <= limit[doubtful] * np.sqrt(spread)
        for g in active:
            level = self.mixed[g].level
            if level.ndim > 1:
                continue
            felt = level >= 0
            label = level[felt] * self.channels + self.channel[felt]
            good[felt] |= stand_out_together(good[felt], label)
        return good

    def shortened(
        self,
        p: Array,
        change: Array,
        shared_part: Array,
        linear_form: _Linearised,
        solution: MixedSolution,
        used: Mask,
    ) -> Array:
        """The step, halved where the equation bends until eᵀ R⁻¹ e falls, e what the shared errors
        [N] at their most likely values leave of the residuals.
        """
        weights = np.where(self.fitted_rows(used), 1.0 / solution.noise_along(self.shares), 0.0)
        # what the linear equation misses at the end of the step
        bend = self.stacked_residuals(p + change) + linear_form.y - linear_form.J @ change
        if np.max(bend**2 * weights) < SETTLED**2:
            return change
        before = weights @ (shared_part - linear_form.y) ** 2
        for _ in range(HALVINGS):
            if weights @ (self.stacked_residuals(p + change) + shared_part) ** 2 < before:
                break
            change = 0.5 * change
        return change

    def embed(self, linear_form: _Linearised) -> Array:
        """[all parameters, p free], from coefficients of orthonormal columns to the parameters."""
        return np.eye(len(self.start))[:, self.free] @ linear_form.basis

    def result(
        self,
        p: Array,
        linear_form: _Linearised,
        solution: MixedSolution,
        active: Sequence[int],
        used: Mask,
    ) -> Fit:
        """The finished fit, in the units of the residuals and in all parameters."""
        covariance, slopes, variance_covariance = likelihood.uncertainty(solution)
        variances, embed = solution.variances, self.embed(linear_form)
        R = solution.noise_along(self.shares)[: self.n]
        half = embed @ solution.inverse[: len(p)]
        gain = np.zeros((len(self.start), self.n))
        for rows in _chunks(np.flatnonzero(used)):
            T = self.columns(rows, linear_form, solution, active)
            gain[:, rows] = half @ (T / R[rows, None]).T / self.relative[rows]
        first = self.channels + len(self.priors)
        theta = variances[first:]
        u = np.sqrt(np.maximum(np.diag(variance_covariance)[first:], 0.0))
        # u of a standard deviation from that of its square; near 0 the square alone tells
        size_u = np.where(theta > u, u / (2.0 * np.sqrt(np.where(theta > 0, theta, 1.0))), u**0.5)
        errors_of_sizes = [
            (error, error.levels, np.empty((0, error.width))) for error in self.noises
        ]
        for g, b in self.errors_of_levels(solution, active).items():
            error = self.mixed[g]
            errors_of_sizes.append((error, linear_form.degrees[g], b.reshape(error.levels, -1)))
        sizes = zip(errors_of_sizes, np.sqrt(theta).tolist(), size_u.tolist(), strict=True)
        parameters = self.start.copy()
        parameters[self.free] = p
        jacobian = np.zeros((self.n, len(self.start)))
        jacobian[:, self.free] = linear_form.J[: self.n] * self.relative[:, None]
        fit = Fit(
            parameters=parameters,
            covariance=embed @ covariance @ embed.T,
            residual=self.residual(p),
            noise_residual=np.empty(0),
            used=used,
            dof=int(used.sum()) - len(p),
            condition=linear_form.condition,
            shared=tuple(SharedSize(error, s, su, rank, b) for (error, rank, b), s, su in sizes),
            converged=False,
            variances=variances,
            variance_covariance=variance_covariance,
            slopes=embed @ slopes @ embed.T,
            noise_shares=self.shares[:, : self.n] * self.relative**2,
            jacobian=jacobian,
            gain=gain,
            bounds=np.zeros((len(self.start), 0)),
            solution=solution,
        )
        return fit.bounded_by(self.bounds)
