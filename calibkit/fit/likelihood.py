"""Restricted likelihood of the sizes of errors (Patterson & Thompson 1971).

    y = J β + Σ_g Z_g b_g + e,    b_g ~ N(0, θ_g I),    e ~ N(0, R),    R = Σ_i θ_i diag(d_i)    (1)
    C = Tᵀ R⁻¹ T + diag(0, I),    T = [J, Z √θ]                      (Henderson 1975)            (2)
    P = R⁻¹ - R⁻¹ T C⁻¹ Tᵀ R⁻¹,   -2 log L = ln|R| + ln|C| + yᵀ P y                              (3)

Without restriction -2 log L is less by ln|Jᵀ V⁻¹ J|: that compares fits of different J, and lacks
what the coefficients take from the sizes.

The columns of [R^-½ T; 0 I] are turned into orthonormal ones, B in the rows of R^-½ T: then
P = R^-½ (I - B Bᵀ) R^-½. A product with C⁻¹ in its place loses as many digits as θ Zᵀ R⁻¹ Z has:
all of them where runs differ by a thousand times their noise.

No matrix is n × n. Residuals of equal noise may be turned into each other: the triangle of a QR of
[J Z y] keeps what they tell, and (2) and (3) are solved on as many rows as it has. Gyros that have
no coefficient and no error in common are blocks of T and of C, each of which is solved alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calibkit.numeric.arrays import Array, Integers, Mask

ITERATIONS = 60
HALVINGS = 30
SETTLED = 1e-9
"""Fall of -2 log L that ends the search."""
DETERMINED = 1e-6
"""Share of an error's square that the coefficients must leave for a level to count."""
CUT_AT_ZERO = float(np.sqrt(0.5 - 0.5 / np.pi))
"""Standard deviation of a normal estimate about 0 that is cut off there, relative to that of one
that is not.
"""
RANK = 1e-15
"""Eigenvalue of the scaled information, over its largest, below which a combination of sizes is not
determined.
"""


@dataclass(frozen=True, slots=True)
class KnownVariances:
    """What is known of the variances θ [v] before the fit: ν s²/θ is distributed as χ² with ν
    degrees of freedom; ν = 0 where nothing is known, ∞ where the variance is held at s².
    """

    square: Array
    dof: Array
    largest: Array
    """[v], variances beyond which none is sought."""
    noise_floor: float = 0.0
    """Least variance of the noise."""

    @property
    def free(self) -> Mask:
        """[v], variances that the data have a say in."""
        return self.dof < np.inf

    @property
    def prior_dof(self) -> Array:
        """[v], ν, and 0 where the variance is held."""
        return np.where(self.free, self.dof, 0.0)

    def deviance(self, theta: Array) -> float:
        """-2 log of the densities, up to a constant."""
        prior = self.prior_dof > 0.0
        if np.any(theta[prior] <= 0.0):
            return float("inf")
        theta, square = theta[prior], self.square[prior]
        return float(self.dof[prior] @ (np.log(theta) + square / theta))

    def score(self, theta: Array) -> Array:
        """Derivatives [v] of the log density."""
        safe = np.where(self.prior_dof > 0.0, theta, 1.0)
        return np.asarray(-0.5 * self.prior_dof * (1.0 - self.square / safe) / safe)

    def information(self, theta: Array) -> Array:
        """Information [v, v] that the statements add."""
        safe = np.where(self.prior_dof > 0.0, theta, 1.0)
        return np.diag(0.5 * self.prior_dof / safe**2)


@dataclass(frozen=True)
class MixedRows:
    """Rows of (1) with independent noise, and the directions of β in which J has unit columns."""

    J: Array
    """[n, p]."""
    Z: Array
    """[n, q]."""
    y: Array
    """[n]."""
    shares: Array
    """d [parts, n], what each part of the noise adds to the variance of a row."""
    count: Array
    """[n], residuals that a row stands for; more than 1 where they are noise alone, which the other
    rows hold: J, Z and y of such a row are 0.
    """
    group: Integers
    """[q], number of the shared error of each column of Z."""
    groups: int
    known: KnownVariances
    """Of the parts of the noise, and of the shared errors."""

    @cached_property
    def blocks(self) -> list["DiagonalBlock"]:
        """Blocks of [J Z]."""
        return blocks(np.hstack([self.J, self.Z]))

    def of_groups(self, numbers: Sequence[int]) -> "MixedRows":
        """The same rows with some of the shared errors, numbered anew."""
        parts, count = len(self.shares), len(numbers)
        variances = np.array([*range(parts), *(parts + g for g in numbers)], dtype=np.intp)
        columns = [np.flatnonzero(self.group == g) for g in numbers]
        columns_of_groups = np.concatenate([*columns, np.empty(0, np.intp)]).astype(np.intp)
        return replace(
            self,
            Z=self.Z[:, columns_of_groups],
            group=np.repeat(np.arange(count), [len(c) for c in columns]),
            groups=count,
            known=replace(
                self.known,
                square=self.known.square[variances],
                dof=self.known.dof[variances],
                largest=self.known.largest[variances],
            ),
        )


def degrees(J: Array, Z: Array) -> int:
    """Levels of a shared error with loadings Z [n, k] that coefficients with derivatives J [n, p]
    leave apart.
    """
    largest_square = np.max(np.sum(Z**2, axis=0), initial=0.0)
    if largest_square == 0.0:
        return 0
    # what the coefficients explain of the loadings shows nothing of the error
    Q = np.linalg.qr(J)[0]
    Z_apart = Z - Q @ (Q.T @ Z)
    values = np.linalg.eigvalsh(Z_apart.T @ Z_apart)
    return int(np.sum(values > DETERMINED * largest_square))


class DiagonalBlock(NamedTuple):
    """Rows and columns of a matrix outside of whose crossings both are 0."""

    rows: Integers
    columns: Integers


def blocks(design: Array) -> list[DiagonalBlock]:
    """Blocks of a matrix [n, k]."""
    filled = design != 0.0
    diagonal_blocks, unassigned = [], filled.any(axis=0)
    while unassigned.any():
        columns, before = np.arange(unassigned.size) == np.argmax(unassigned), 0
        while before < np.count_nonzero(columns):
            before = int(np.count_nonzero(columns))
            rows = filled[:, columns].any(axis=1)
            columns = filled[rows].any(axis=0)
        diagonal_blocks.append(DiagonalBlock(np.flatnonzero(rows), np.flatnonzero(columns)))
        unassigned &= ~columns
    return diagonal_blocks


class MixedSolution:
    """Equations (2) and (3) solved at variances θ [parts + groups]."""

    def __init__(self, rows: MixedRows, variances: Array, *, restricted: bool = True) -> None:
        parts, p = len(rows.shares), rows.J.shape[1]
        self.rows, self.variances, self.restricted = rows, variances, restricted
        # R of (1): each part of the noise adds its share to the variance of a row
        self.R: Array = variances[:parts] @ rows.shares
        self.noise = np.sqrt(self.R)
        self.root = np.sqrt(variances[parts:])[rows.group]
        # T of (2) in rows of unit noise. Loadings are multiplied by √θ, where Henderson divides
        # the identity by θ: so θ = 0 is no special case
        T = np.hstack([rows.J, rows.Z * self.root]) / self.noise[:, None]
        y = rows.y / self.noise
        self.inverse = np.zeros((T.shape[1], T.shape[1]))  # C⁻¹
        self.solution = np.zeros(T.shape[1])
        # rows of each block, its B [rows, columns], and how many columns, the first, are of errors
        self.bases: list[tuple[Integers, Array, int]] = []
        self.deviance = float(rows.count @ np.log(self.R)) + rows.known.deviance(variances)
        for block in rows.blocks:
            # errors first: without the columns behind them P is V⁻¹
            columns = np.roll(block.columns, -int(np.count_nonzero(block.columns < p)))
            errors = int(np.count_nonzero(columns >= p))
            unit_rows = np.eye(errors, columns.size)
            # the unit rows below T are the identity of (2), b/√θ ~ N(0, I): C = Sᵀ S with the
            # triangle S
            Q, S = np.linalg.qr(np.vstack([T[np.ix_(block.rows, columns)], unit_rows]))
            B, inverse = Q[: block.rows.size], np.linalg.inv(S)
            self.bases.append((block.rows, B, errors))
            self.inverse[np.ix_(columns, columns)] = inverse @ inverse.T
            self.solution[columns] = inverse @ (B.T @ y[block.rows])
            # ln|C| of (3); without restriction that of the errors alone, whose columns come first
            determined = np.abs(np.diag(S)[: None if restricted else errors])
            self.deviance += 2.0 * float(np.sum(np.log(determined)))
        self.Py = self.projected(rows.y[:, None])[:, 0]
        b = self.solution[p:]
        # yᵀ P y as a sum of squares: the product of y and P y loses its digits where θ is large
        self.deviance += float(self.Py @ (self.R * self.Py) + b @ b)

    @property
    def coefficients(self) -> Array:
        """β [p]."""
        return self.solution[: self.rows.J.shape[1]]

    @property
    def errors(self) -> Array:
        """Shared errors b [q], as the rows show them."""
        return self.solution[self.rows.J.shape[1] :] * self.root

    def noise_along(self, shares: Array) -> Array:
        """Variance [n] of the noise of rows with shares [parts, n]."""
        return np.asarray(self.variances[: len(shares)] @ shares)

    @cached_property
    def noise_degrees(self) -> float:
        """Degrees of freedom in which the rows show noise and nothing else, tr(P R P R), with those
        of stated noise.
        """
        noise = self.variances[: len(self.rows.shares)]
        information = self.information()[: len(noise), : len(noise)]
        return 2.0 * float(noise @ information @ noise)

    def projected(self, F: Array) -> Array:
        """P F [n, k]."""
        # P = R^-½ (I - B Bᵀ) R^-½, block by block
        projection = F / self.noise[:, None]
        for rows, B, _ in self.bases:
            projection[rows] -= B @ (B.T @ projection[rows])
        return np.asarray(projection / self.noise[:, None])

    def _traces(self) -> tuple[Array, Array]:
        """Diagonals of I - R^½ P R^½ [n], and of Zᵀ P Z [q]; without restriction of V⁻¹ for P."""
        Z = self.rows.Z / self.noise[:, None]
        leverage, of_errors = np.zeros(len(Z)), np.sum(Z**2, axis=0)
        for rows, B, errors in self.bases:
            basis = B if self.restricted else B[:, :errors]
            leverage[rows] = np.sum(basis**2, axis=1)
            of_errors -= np.sum((basis.T @ Z[rows]) ** 2, axis=0)
        return leverage, of_errors

    def _member(self) -> Array:
        """[q, groups], 1 where a column of Z belongs to a shared error."""
        member = self.rows.group[:, None] == np.arange(self.rows.groups)
        return np.asarray(member, dtype=np.float64)

    def score(self) -> tuple[Array, Array]:
        """Derivatives [v] of log L by the variances, and the mean of its observed and expected
        information, ½ yᵀ P V_i P V_j P y (Gilmour, Thompson & Cullis 1995).
        """
        Z, shares, member = self.rows.Z, self.rows.shares, self._member()
        leverage, of_errors = self._traces()
        noise_trace = shares @ ((self.rows.count - leverage) / self.R)
        trace = np.concatenate([noise_trace, of_errors @ member])
        VPy = np.hstack([(shares * self.Py).T, (Z * (Z.T @ self.Py)) @ member])
        known, theta = self.rows.known, self.variances
        # ∂ log L/∂θ_i = ½ (yᵀ P V_i P y - tr P V_i), and what statements of sizes add
        score = 0.5 * (VPy.T @ self.Py - trace) + known.score(theta)
        return score, 0.5 * VPy.T @ self.projected(VPy) + known.information(theta)

    def information(self) -> Array:
        """Expected information [v, v] of the variances, ½ tr(P V_i P V_j)."""
        Z, shares, R = self.rows.Z, self.rows.shares, self.R
        member, PZ = self._member(), self.projected(Z)
        leverage, _ = self._traces()
        # ½ tr(P V_i P V_j) of two parts of the noise, without a matrix n × n: P = R⁻¹ less B Bᵀ,
        # squared
        noise = (shares * ((self.rows.count - 2.0 * leverage) / R**2)) @ shares.T
        for rows, B, _ in self.bases:
            inner = [(B.T * d) @ B for d in shares[:, rows] / R[rows]]
            noise += np.array([[np.sum(a * b) for b in inner] for a in inner])
        cross = shares @ PZ**2 @ member
        mixed = member.T @ (Z.T @ PZ) ** 2 @ member
        of_all = np.block([[noise, cross], [cross.T, mixed]])
        return 0.5 * of_all + self.rows.known.information(self.variances)


def maximise(rows: MixedRows, near: Array | None = None) -> MixedSolution:
    """The most likely variances, from those that are near [v], or from starts that are far apart
    where these are not of the same errors.
    """
    starts = _starts(rows)
    if near is not None and near.shape == starts[0].shape:
        starts = [np.minimum(near, rows.known.largest)]
    ends = [_ascend(MixedSolution(rows, variances)) for variances in starts]
    return min(ends, key=lambda end: end.deviance)


def first_step(solution: MixedSolution, Z: Array) -> tuple[float, float]:
    """Variance of a further error with loadings Z [n, k] by one scoring step from 0, and the fall
    of -2 log L that the step promises.
    """
    PZ = solution.projected(Z)
    score = 0.5 * float(np.sum((Z.T @ solution.Py) ** 2) - np.sum(Z * PZ))
    information = 0.5 * float(np.sum((Z.T @ PZ) ** 2))
    if score <= 0.0 or information <= 0.0:
        return 0.0, 0.0
    return score / information, score**2 / information


def unrestricted(solution: MixedSolution) -> float:
    """Least -2 log L without restriction, by its own variances, of the fit of a solution."""
    return _ascend(MixedSolution(solution.rows, solution.variances, restricted=False)).deviance


def uncertainty(solution: MixedSolution) -> tuple[Array, Array, Array]:
    """Covariance [p, p] of the coefficients with what the estimation of the variances adds, its
    derivatives [v, p, p] by the variances, and their covariance [v, v], 0 for one that is held.
    """
    rows, variances = solution.rows, solution.variances
    spread = _inverse(solution.information(), rows.known.free)
    p, T = rows.J.shape[1], np.hstack([rows.J, rows.Z * solution.root])
    # G = (Jᵀ V⁻¹ J)⁻¹ Jᵀ V⁻¹ [p, n], change of β by a change of y
    G = solution.inverse[:p] @ (T / solution.R[:, None]).T
    # Φ + 2 Σ w_ij G V_i P V_j Gᵀ (Kenward & Roger 1997), V_i Gᵀ = D_i Gᵀ or Z_i Z_iᵀ Gᵀ
    VG = [d[:, None] * G.T for d in rows.shares]
    for g in range(rows.groups):
        Z = rows.Z[:, rows.group == g]
        VG.append(Z @ (Z.T @ G.T))
    PVG = np.array([solution.projected(part) for part in VG])
    # A variance at zero is on average above the true one: what it adds is in the estimate.
    w = np.where(np.outer(variances, variances) > 0.0, spread, 0.0)
    covariance = solution.inverse[:p, :p].copy()
    for part, weights in zip(VG, w, strict=True):
        covariance += 2.0 * part.T @ np.tensordot(weights, PVG, 1)
    cut = np.where(variances > 0.0, 1.0, CUT_AT_ZERO)
    slopes = np.stack([G @ part for part in VG])
    return covariance, slopes, spread * np.outer(cut, cut)


def _starts(rows: MixedRows) -> list[Array]:
    """Variances to start from: shared errors that are small, or large, against the noise, whatever
    is stated with few degrees of freedom: such a statement can make the likelihood bimodal.
    """
    # ordinary residuals show how large noise and shared errors are together
    residuals = rows.y - rows.J @ np.linalg.lstsq(rows.J, rows.y, rcond=None)[0]
    typical = np.sum(residuals**2) / max(rows.count.sum() - rows.J.shape[1], 1.0)
    weight = rows.shares @ rows.count
    scatter = (rows.shares > 0.0) @ residuals**2 / np.where(weight > 0.0, weight, 1.0)
    noise = np.where(weight > 0.0, scatter, typical)
    loading = np.array(
        [np.mean(np.sum(rows.Z[:, rows.group == g] ** 2, axis=0)) for g in range(rows.groups)]
    )
    mixed = typical / np.maximum(loading, 1e-200)
    starts = []
    # a statement of few degrees of freedom makes two maxima; from its own size the search ended at
    # 0 where the error was large
    for share in (0.1, 10.0):
        start = np.concatenate([np.maximum(noise, rows.known.noise_floor), share * mixed])
        start = np.minimum(start, rows.known.largest)
        starts.append(np.where(rows.known.free, start, rows.known.square))
    return starts if rows.groups else starts[:1]


def _ascend(now: MixedSolution) -> MixedSolution:
    """Where scoring of the likelihood ends, from a solution."""
    rows, known, parts = now.rows, now.rows.known, len(now.rows.shares)
    # Noise that is the only one of some row cannot be zero, nor can that of the first sensor.
    only_noise = np.zeros(len(now.variances), dtype=np.bool_)
    only = np.sum(rows.shares > 0.0, axis=0) == 1
    only_noise[:parts] = np.any((rows.shares > 0.0) & only, axis=1)
    only_noise[0] = True
    floor = np.where(only_noise & known.free, known.noise_floor, 0.0)
    for _ in range(ITERATIONS):
        score, information = now.score()
        adjustable = known.free & ((now.variances > 0.0) | (score > 0.0))
        step = _inverse(information, adjustable) @ np.where(adjustable, score, 0.0)
        # a variance that cannot be 0 falls by at most a decade a step: at 0 nothing is likely
        falling = 0.1 * now.variances
        lowest = np.maximum(np.where(only_noise | (known.prior_dof > 0.0), falling, 0.0), floor)
        for halving in range(HALVINGS):
            trial = np.maximum(now.variances + step * 0.5**halving, lowest)
            # from far above, a step of whatever length passes the maximum: fall by decades
            lowest = np.maximum(lowest, falling)
            trial = np.where(
                known.free,
                np.minimum(trial, known.largest),
                known.square,
            )
            try:
                reached = MixedSolution(rows, trial, restricted=now.restricted)
            except np.linalg.LinAlgError:  # rounding makes (2) singular
                continue
            if reached.deviance <= now.deviance:
                break
            if score @ step < SETTLED:
                # the whole step promises less than ends the search: it rose by rounding, as its
                # half would
                return now
        else:
            break
        fall, now = now.deviance - reached.deviance, reached
        if fall < SETTLED:
            break
    return now


def _inverse(information: Array, free: Mask) -> Array:
    """Inverse [v, v] of the information of the free variances, zero elsewhere."""
    diagonal = np.diag(information)
    free = free & (diagonal > 0.0)
    # unit diagonal first: variances in (°/h)² and in ppm² differ by decades, and RANK is relative
    size = np.sqrt(np.where(free, diagonal, 1.0))
    free_pairs = free & free[:, None]
    scaled = np.where(free_pairs, information / np.outer(size, size), np.eye(len(size)))
    values, vectors = np.linalg.eigh(scaled)
    determined = values > RANK * values[-1]
    vectors = vectors[:, determined] / size[:, None]
    return np.where(free_pairs, vectors / values[determined] @ vectors.T, 0.0)
