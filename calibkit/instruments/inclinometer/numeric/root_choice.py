"""North seeking with uncertainty: the choice between the roots of s, their weight, and the
resulting θ, φ, s and ψ.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.numeric.covariance import covariance, root_slopes
from calibkit.instruments.inclinometer.published import Attitude, Components, Roots
from calibkit.numeric.attitude import wrapped

LIKELIER = 3.0
"""Least difference of log-likelihood between two positive roots for an unambiguous choice: odds of
20 to 1.
"""
DISAGREES = 5.0
"""Difference between a root and its prior, in standard uncertainties, above which it is flagged."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits beyond which a station is refused, or its root of s is not used."""

    latitude_deg: float = 80.0
    """|latitude| above which the earth's horizontal rate is too small for an azimuth."""
    vertical_deg: float = 0.5
    """Inclination below which toolface and azimuth are not separable."""
    horizontal_deg: float = 85.0
    """Inclination above which sensors across the tool determine neither inclination nor azimuth."""
    s_uncertainty: float = 0.02
    """Standard uncertainty of a root above which the prior of s is used instead."""
    separation: float = 6.0
    """Standard uncertainties from the middle of both roots, twice those of the discriminant from
    zero, below which noise alone could have parted the roots.
    """


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class Prior:
    """Value and standard uncertainty of s at each station [n] before its own readings."""

    s: Array
    standard_uncertainty: Array


@dataclass(frozen=True, slots=True)
class Estimates:
    """Both roots of s at n stations with their standard uncertainties; column 0 the + root, column
    1 the − root.
    """

    attitude: Attitude
    roots: Roots
    s: Array
    """[n, 2]."""
    uncertainty: Array
    """[n, 2]."""
    azimuth: Array
    """[n, 2] [rad], azimuth by each root."""
    usable: Mask
    """[n, 2]: positive, certain enough, and far enough from the other for its uncertainty to hold.
    """
    status: tuple[str, ...]
    """[n]: empty, or why the station is refused."""

    def choose_root(
        self, prior: Prior, forced: Integers, rows: slice = slice(None)
    ) -> tuple[Integers, Mask]:
        """Column [m] of the likelier, or forced, root of each selected station, and whether both
        roots are about equally likely.
        """
        usable = self.usable[rows]
        score = _log_likelihood(self.s[rows], self.uncertainty[rows], prior)
        with np.errstate(invalid="ignore"):
            alike = np.abs(score[:, 0] - score[:, 1]) < LIKELIER
        column = np.where(forced >= 0, forced, np.argmax(score, axis=1))
        return column, (forced < 0) & usable.all(axis=1) & alike

    def choose_by_heading(self, heading_deg: Array | None) -> Integers:
        """Column [n] of the root whose azimuth is nearer the heading [n] [°]; −1 without a heading
        or a positive root.
        """
        if heading_deg is None:
            return np.full(len(self.s), -1)
        difference = np.abs(wrapped(np.degrees(self.azimuth) - heading_deg[:, None]))
        difference = np.where(self.s > 0.0, difference, np.inf)
        nearer = np.argmin(np.where(np.isnan(difference), np.inf, difference), axis=1)
        known = np.isfinite(heading_deg) & (self.s > 0.0).any(axis=1)
        return np.where(known, nearer, -1)


@dataclass(frozen=True, slots=True)
class Solution:
    """North seeking of n stations by one sensor pair; results of refused stations are NaN, with the
    reason in `status`.
    """

    inclination_deg: Array
    toolface_deg: Array
    """In (−180, 180]."""
    azimuth_deg: Array
    """In [0, 360)."""
    uncorrected_deg: Array
    """Azimuth with s = 1 [n] [°]."""
    s: Array
    """s that was used [n]."""
    s_root: Array
    """Chosen root [n], before it was shrunk to the prior."""
    s_root_uncertainty: Array
    root: Integers
    """1 for the + root, −1 for the − root, 0 where neither is possible."""
    weight: Array
    """Weight of the root in s [n]; 0 where s is its prior."""
    C: Array
    pair_covariance: Array
    """[n, 4, 4] of inclination [°], toolface [°], s, azimuth [°], by errors that other sensor pairs
    do not share.
    """
    by_latitude: Array
    """[n, 4], changes of the same by an error of the latitude, which all sensor pairs share, as
    large as its standard uncertainty.
    """
    status: tuple[str, ...]
    flags: tuple[tuple[str, ...], ...]

    @property
    def covariance(self) -> Array:
        """[n, 4, 4] of inclination [°], toolface [°], s, azimuth [°]."""
        return self.pair_covariance + outer(self.by_latitude)

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [n, 4] of inclination [°], toolface [°], s, azimuth [°]."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def root_used(self) -> Mask:
        """Mask [n] of the stations whose own root contributes to s."""
        return np.array([not reason for reason in self.status], dtype=np.bool_) & (
            self.weight > 0.0
        )


def outer(changes: Array) -> Array:
    """Covariance [n, k, k] of results that one error changes by [n, k]."""
    return changes[:, :, None] * changes[:, None, :]


def estimate_roots(
    parts: Components,
    latitude_deg: ArrayLike,
    *,
    refused: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> Estimates:
    """Both roots of s with uncertainty and azimuth, and which stations are refused.

    parts : components of n stations; latitude_deg : one or [n]; refused : [n], reasons known
    before, or empty.
    """
    latitude = np.broadcast_to(np.asarray(latitude_deg, dtype=np.float64), parts.accel_x.shape)
    found = published.attitude(parts.accel_x, parts.accel_y)
    roots = published.scale_roots(parts.gyro_x, parts.gyro_y, found, latitude)
    s = np.column_stack((roots.plus, roots.minus))
    spread = np.empty_like(s)
    psi = np.empty_like(s)
    for k in range(2):
        gradient = root_slopes(parts, latitude, np.full(len(s), k == 0))[:, :4]
        with np.errstate(invalid="ignore"):
            spread[:, k] = np.sqrt(np.einsum("ni,nij,nj->n", gradient, parts.covariance, gradient))
        psi[:, k] = published.azimuth(
            parts.accel_x, parts.accel_y, s[:, k] * parts.gyro_x, s[:, k] * parts.gyro_y, latitude
        )
    spread = np.where(np.isfinite(spread) & ~roots.clamped[:, None], spread, np.inf)
    with np.errstate(invalid="ignore"):
        apart = np.abs(roots.half_difference)[:, None] > limits.separation * spread
        usable = (s > 0.0) & (spread <= limits.s_uncertainty) & apart & ~roots.clamped[:, None]
    own = _list_refusals(parts, found, latitude, limits)
    if refused and len(refused) != len(own):
        raise FitError(f"{len(refused)} reasons for {len(own)} stations")
    status = tuple(first or second for first, second in zip(refused or own, own, strict=True))
    return Estimates(found, roots, s, spread, psi, usable, status)


def _log_likelihood(s: Array, uncertainty: Array, prior: Prior) -> Array:
    """Log-likelihood [n, 2] of roots [n, 2] given their priors; −inf for an impossible root."""
    variance = uncertainty**2 + prior.standard_uncertainty[:, None] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        score = -0.5 * (s - prior.s[:, None]) ** 2 / variance - 0.5 * np.log(variance)
    # roots with infinite uncertainty are equally unlikely, negative roots impossible
    score = np.where(np.isfinite(score), score, -1e300)
    return np.where(s > 0.0, score, -np.inf)


def solve(
    parts: Components,
    latitude_deg: ArrayLike,
    prior: Prior,
    *,
    heading_deg: Array | None = None,
    latitude_uncertainty_deg: float = 0.0,
    refused: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> Solution:
    """Solve n stations of one sensor pair: choose the root, shrink it to the prior, correct the
    rates, seek north.

    Parameters
    ----------
    parts : components of the stations and their noise.
    latitude_deg : one or [n].
    prior : of s at each station: its history, or s(T) of a calibration. It chooses between two
        positive roots.
    heading_deg : [n], an outside heading that chooses instead; NaN where there is none.
    latitude_uncertainty_deg : standard uncertainty of the latitude.
    refused : [n], reasons why a station could not be read or fitted, or empty.
    limits : where a station is refused and a root is not used.

    Returns
    -------
    Solution. s = w s_root + (1 − w) s_prior, w by inverse variance, and 0 where the root is not
    usable or both are equally likely. A station that cannot be solved has NaN and a reason; the
    others are not affected.

    Raises
    ------
    FitError
        A prior that is not positive, finite and of the stations' number.

    """
    _require_prior(prior, parts.accel_x.size)
    latitude = np.broadcast_to(np.asarray(latitude_deg, dtype=np.float64), parts.accel_x.shape)
    found = estimate_roots(parts, latitude, refused=refused, limits=limits)
    column, ambiguous = found.choose_root(prior, found.choose_by_heading(heading_deg))
    rows = np.arange(column.size)
    s_root, u_root = found.s[rows, column], found.uncertainty[rows, column]
    possible = s_root > 0.0
    accepted = found.usable[rows, column] & ~ambiguous
    total = u_root**2 + prior.standard_uncertainty**2
    with np.errstate(divide="ignore", invalid="ignore"):
        # inverse-variance weight; where both are exact, they are taken to agree
        share = np.where(total > 0.0, prior.standard_uncertainty**2 / total, 1.0)
    weight = np.where(accepted, share, 0.0)
    s = np.where(accepted, weight * s_root + (1.0 - weight) * prior.s, prior.s)
    root = np.where(possible, 1 - 2 * column, 0)
    flags = _list_flags(
        found, s_root, u_root, prior, possible=possible, accepted=accepted, ambiguous=ambiguous
    )
    spread, by_latitude = covariance(
        parts,
        latitude,
        latitude_uncertainty_deg,
        column == 0,
        weight,
        prior.s,
        prior.standard_uncertainty,
    )
    return _assemble(
        parts, found, latitude, s, s_root, u_root, root, weight, spread, by_latitude, flags
    )


def _require_prior(prior: Prior, count: int) -> None:
    """Raise FitError for a prior of the wrong length, or not positive and finite."""
    values = np.concatenate((prior.s, prior.standard_uncertainty))
    if prior.s.size != count or prior.standard_uncertainty.size != count:
        raise FitError(f"{prior.s.size} priors of s for {count} stations")
    if not (
        np.isfinite(values).all()
        and (prior.s > 0.0).all()
        and (prior.standard_uncertainty >= 0.0).all()
    ):
        raise FitError(
            "a prior of s is not a positive number with an uncertainty",
            hint="begin with 1 and 0.01",
        )


def _list_flags(
    found: Estimates,
    s_root: Array,
    u_root: Array,
    prior: Prior,
    *,
    possible: Mask,
    accepted: Mask,
    ambiguous: Mask,
) -> tuple[tuple[str, ...], ...]:
    """Flags of each station [n]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.asarray(
            np.abs(s_root - prior.s) / np.hypot(u_root, prior.standard_uncertainty),
            dtype=np.float64,
        )
    clamped = "accelerations across the tool exceed gravity: clamped"
    lines = []
    for k, refused in enumerate(found.status):
        flags = [clamped] if found.attitude.clamped[k] else []
        if not refused:
            if found.roots.clamped[k]:
                flags.append("negative discriminant clamped to zero")
            if not possible[k]:
                flags.append("no positive root of s: s is its prior")
            elif ambiguous[k]:
                flags.append("both roots of s are about as likely: s is its prior")
            elif not accepted[k]:
                flags.append(
                    f"s is its prior: the root {s_root[k]:.4g} has a standard uncertainty of"
                    f" {u_root[k]:.2g}, C is near 0"
                )
            elif off[k] > DISAGREES:
                flags.append(
                    f"the root {s_root[k]:.5g} is {off[k]:.0f} standard uncertainties from its"
                    f" prior {prior.s[k]:.5g}"
                )
            if (found.s[k] > 0.0).all():
                flags.append("both roots of s are positive")
        lines.append(tuple(flags))
    return tuple(lines)


def _assemble(
    parts: Components,
    found: Estimates,
    latitude: Array,
    s: Array,
    s_root: Array,
    u_root: Array,
    root: Integers,
    weight: Array,
    spread: Array,
    by_latitude: Array,
    flags: tuple[tuple[str, ...], ...],
) -> Solution:
    """Correct the rates (step E), seek north (step F), and set the results of refused stations to
    NaN.
    """
    solved = np.array([not reason for reason in found.status])
    x, y = s * parts.gyro_x, s * parts.gyro_y
    psi = published.azimuth(parts.accel_x, parts.accel_y, x, y, latitude)
    plain = published.azimuth(parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y, latitude)

    def kept(values: Array) -> Array:
        return np.where(solved, values, np.nan)

    return Solution(
        inclination_deg=np.degrees(found.attitude.inclination),
        toolface_deg=kept(np.degrees(found.attitude.toolface)),
        azimuth_deg=kept(np.degrees(psi)),
        uncorrected_deg=kept(np.degrees(plain)),
        s=kept(s),
        s_root=kept(s_root),
        s_root_uncertainty=kept(u_root),
        root=np.where(solved, root, 0),
        weight=kept(weight),
        C=kept(published.root_label(found.attitude.inclination, psi, latitude)),
        pair_covariance=np.where(solved[:, None, None], spread, np.nan),
        by_latitude=np.where(solved[:, None], by_latitude, np.nan),
        status=found.status,
        flags=flags,
    )


def _list_refusals(
    parts: Components, found: Attitude, latitude: Array, limits: Limits
) -> tuple[str, ...]:
    """Reason [n] why each station is refused, or an empty string."""
    inclination = np.degrees(found.inclination)
    total = np.degrees(published.toolface_plus_azimuth(parts.gyro_x, parts.gyro_y))
    inputs = np.column_stack((parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y, latitude))
    finite = [bool(np.isfinite(row).all()) for row in inputs]
    silent = (parts.gyro_x == 0.0) & (parts.gyro_y == 0.0)
    rows = zip(finite, silent, latitude, inclination, total, strict=True)
    return tuple(
        _refuse_station(a, bool(b), float(c), float(d), float(e), limits) for a, b, c, d, e in rows
    )


def _refuse_station(
    finite: bool,  # noqa: FBT001 - one row of the table of facts above
    silent: bool,  # noqa: FBT001 - the same
    latitude: float,
    inclination: float,
    total: float,
    limits: Limits,
) -> str:
    """Reason to refuse one station, or an empty string."""
    if not finite:
        return "an indication or the latitude is not finite"
    if abs(latitude) > limits.latitude_deg:
        return (
            f"latitude {latitude:g}° is beyond {limits.latitude_deg:g}°: the earth's horizontal"
            " rate is too small for an azimuth"
        )
    if inclination > limits.horizontal_deg:
        return (
            f"inclination {inclination:.2f}° is above {limits.horizontal_deg:g}°: sensors across"
            " the tool give no azimuth there"
        )
    if inclination < limits.vertical_deg:
        return (
            f"inclination {inclination:.3f}° is below {limits.vertical_deg:g}°: toolface and"
            f" azimuth are not separable, their sum is {total:.2f}°"
        )
    return "the gyros show no rate at all" if silent else ""
