"""Dwells → the triad over temperature, by gravity vectors or by the length of gravity alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative, length
from calibkit.fit.shared import Prior, Residual, Shared
from calibkit.fit.solve import Fit, sensitivities, solve
from calibkit.instruments.accelerometer import circumstances, equation
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Terms
from calibkit.instruments.accelerometer.numeric import common_errors, determination, magnitude
from calibkit.instruments.accelerometer.numeric.common_errors import CommonError
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import (
    Unexplained,
    beside,
    find_unexplained,
    lacking_terms,
    possible_drift,
)
from calibkit.numeric.least_squares import polynomial, robust
from calibkit.numeric.least_squares.structure import Structure

Loss = Literal["least_squares", "robust"]
MOST_TO_START = 1_000
"""Dwells, evenly spread over more, to which the robust fit is made that others start from."""
FAR = 6.0
"""Residual over the noise beyond which a dwell beside these is left out to begin with."""
LARGEST_ANGLE = 0.01
"""Misalignment [rad] beyond that of any good triad, where lengths do not see the angles."""
SEEN = 0.05
"""What is left of the product of two components of a direction where lengths see their angle: 0.02
in six faces that are set up within 2°, 0.24 in 26 attitudes.
"""


@dataclass(frozen=True, slots=True)
class Triad:
    """The equation fitted to n dwells."""

    terms: Terms
    fit: Fit
    """For temperature mapped to [-1, 1]."""
    middle: float
    """Middle of the temperature range [°C]."""
    half: float
    """Half-width of the temperature range [°C]; 1 when the temperature was constant."""
    residuals: Array
    """[n, 3], corrected less reference, or [n, 1] of the lengths [g]."""
    suspects: tuple[int, ...]
    """Dwells that were left out, worst first."""
    common_errors: tuple[CommonError, ...]
    """Dwells that stand apart together and were kept."""
    lack_of_fit: tuple[Unexplained, ...]
    bounds: tuple[Shared, ...]
    """Errors that are in U below a bound."""
    leverage: Array
    """[n · m], change of a fitted residual by its own reference: near 1, no other checks it."""
    flags: tuple[str, ...]

    @property
    def to_degrees(self) -> Array:
        """Matrix [p, p] from the parameters to those in powers of °C."""
        return np.asarray(self.terms.in_degrees(self.middle, self.half), dtype=np.float64)

    def in_degrees(self) -> tuple[Array, Array, Array]:
        """Parameters [p] in powers of °C, their covariance [p, p] and degrees of freedom [p]."""
        to_raw = self.terms.in_degrees(self.middle, self.half)
        values, covariance = polynomial.in_raw_powers(
            self.fit.parameters, self.fit.total_covariance, to_raw
        )
        return values, covariance, self.fit.of(lambda p: self.to_degrees @ p).dof

    def shifted(self, dwells: DwellSet, shifted: Sequence[DwellSet]) -> "list[Triad]":
        """The triads as they would be with the dwells shifted by errors of inputs, the weights
        held.
        """
        lengths = self.residuals.shape[1] == 1
        residual, *moved = (
            residual_of(one, self.terms, self.mapped(one.temperature), lengths=lengths)
            for one in (dwells, *shifted)
        )
        return [
            replace(self, fit=replace(self.fit, parameters=self.fit.parameters + change))
            for change in sensitivities(residual, moved, self.fit)
        ]

    def mapped(self, temperature: Array | float) -> Array:
        """Temperatures [°C], any number of them, in the unit of the parameters."""
        return np.asarray((temperature - self.middle) / self.half)

    @property
    def residual_rms(self) -> float:
        """Root of the sum of squares of the residuals used over the degrees of freedom [g]; shared
        errors are part of it.
        """
        used = self.residuals.ravel()[self.fit.used]
        return float(np.sqrt(used @ used / max(self.fit.dof, 1)))

    @property
    def noise(self) -> Array:
        """Standard deviation of the noise of a dwell [m] along each axis, or of its length [g]."""
        per_dwell = self.residuals.shape[1]
        variance = np.mean(self.fit.noise.reshape(-1, per_dwell) ** 2, axis=0)
        return np.asarray(np.sqrt(variance))


def solve_triad(dwells: DwellSet, terms: Terms, spec: AccelerometerRecipe, *, loss: Loss) -> Triad:
    """Fit the equation to gravity vectors, or to the length of gravity.

    Raises FitError where the dwells do not determine a parameter: names it, says why and which
    dwells to add.
    """
    lengths = spec.reference.kind == "magnitude"
    middle, half = polynomial.middle_and_half(dwells.temperature)
    half = half or 1.0
    t = (dwells.temperature - middle) / half
    per_dwell = 1 if lengths else 3
    residual = residual_of(dwells, terms, t, lengths=lengths)
    priors: tuple[Prior, ...] = ()
    if lengths:
        start, priors = _start_of_lengths(dwells, terms)
    else:
        _require_determined(terms, dwells.reference, dwells.temperature)
        start = _start_of_vectors(dwells, terms)
    root = _root_weights(dwells, lengths=lengths)
    plain = solve(residual, start, priors=priors, noise=1.0 / root, names=terms.names)
    values = plain.parameters
    used, structured = np.ones(root.size, dtype=np.bool_), tuple[Structure, ...]()
    if loss == "robust":
        labels = common_errors.label(
            dwells.temperature, None if lengths else dwells.reference, per_dwell
        )

        # evenly spread dwells are enough to start from: the solver judges all of them
        spread = np.arange(len(t)) % (1 + (len(t) - 1) // MOST_TO_START) == 0
        rows = np.flatnonzero(np.repeat(spread, per_dwell))

        def weighted(p: Numbers) -> Numbers:
            return (residual(p).ravel() * root)[rows]

        tough_values, tough = robust.nonlinear(
            lambda p: (weighted(p), derivative(weighted, p)),
            values,
            names=terms.names,
            groups=[label[rows] for label in labels],
        )
        # six faces leave the angles to what is known of them, which such a fit does not know
        if all(np.all(np.abs(prior.rows(tough_values)) < 5.0 * prior.size) for prior in priors):
            values = tough_values
            structured = tuple(
                replace(one, rows=np.flatnonzero(labels[one.group] == one.level))
                for one in tough.structured
            )
            used = np.abs(residual(values).ravel() * root) <= FAR * tough.scale
            for one in structured:
                used[one.rows] = True
            used[rows] = True
            used[rows[list(tough.suspects)]] = False
    along, gravity = np.broadcast_to(np.eye(3), (len(t), 3, 3)), dwells.reference
    if lengths:
        gravity = terms.corrected(values, dwells.indication, t)
        along = (gravity / length(gravity)[:, None])[:, None, :]
    where = circumstances.find_circumstances(dwells, gravity, spec)
    shared = circumstances.state_errors(where, along, spec)
    fit = solve(
        residual,
        values,
        shared,
        priors=priors,
        channel=np.tile(np.arange(per_dwell), len(t)),
        noise=1.0 / root,
        used=used,
        leave_out=loss == "robust",
        names=terms.names,
    )
    jacobian = derivative(lambda p: residual(p).ravel(), fit.parameters)
    scale = (along * gravity[:, None, :]).reshape(-1, 3)
    bounds, flags = possible_drift(fit, shared, jacobian)
    bounds += lacking_terms(fit, shared, jacobian, scale, per_dwell)
    if not fit.converged:
        flags = (
            *flags,
            "the fit did not come to rest: look at the residuals before you rely on it",
        )
    residuals = fit.residual.reshape(-1, per_dwell)
    out = np.flatnonzero(~fit.used.reshape(-1, per_dwell).all(axis=1))
    worst_first = np.argsort(-np.max(np.abs(residuals[out]), axis=1), kind="stable")
    return Triad(
        terms,
        fit.bounded_by(bounds),
        middle,
        half,
        residuals,
        tuple(out[worst_first].tolist()),
        common_errors.read(structured, residuals),
        find_unexplained(where, fit, jacobian, per_dwell),
        tuple(bounds),
        np.einsum("np,pn->n", jacobian, fit.gain),
        flags,
    )


def residual_of(dwells: DwellSet, terms: Terms, t: Array, *, lengths: bool) -> Residual:
    """Residual against gravity vectors, or against the length of gravity."""
    indication = dwells.indication
    if lengths:
        return lambda p: length(terms.corrected(p, indication, t)) - 1.0
    reference = dwells.reference
    tilt, fixture = terms.of_kind("tilt"), terms.of_kind("fixture")
    tool_rotation = _tool_rotation(dwells) if tilt else None

    def of_vectors(p: Numbers) -> Numbers:
        corrected = terms.corrected(p, indication, t)
        if fixture:
            corrected = corrected @ equation.rotation(p[fixture]).T
        if tool_rotation is not None:
            return corrected - equation.tilted_gravity(tool_rotation, p[tilt])
        return corrected - reference

    return of_vectors


def _root_weights(dwells: DwellSet, *, lengths: bool) -> Array:
    """[n · m], one over the standard error of each residual, or 1 where it was not measured."""
    if dwells.weights is None:
        return np.ones(len(dwells.temperature) * (1 if lengths else 3))
    if lengths:
        return np.asarray(1.0 / np.sqrt(np.mean(dwells.noise**2, axis=1)))
    return np.sqrt(dwells.weights).ravel()


def _start_of_vectors(dwells: DwellSet, terms: Terms) -> Array:
    """Parameters [p] from which the fit to gravity vectors starts."""
    indication, reference = dwells.indication, dwells.reference
    # each axis by its own indication; cross-axis terms follow from there in two steps
    start = np.zeros(len(terms.listed))
    for k, term in enumerate(terms.listed):
        if term.power == 0 and term.kind in ("k", "z"):
            G = indication[:, term.axis]
            slope, zero = _line(G, reference[:, term.axis])
            start[k] = slope if term.kind == "k" else -zero
    return start


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and zero of a straight line; one value alone has a slope and no zero."""
    if np.ptp(x) < 0.1 * np.max(np.abs(x)):
        return float(x @ y / (x @ x)), 0.0
    slope, zero = np.polyfit(x, y, 1)
    return float(slope), float(zero)


def _start_of_lengths(dwells: DwellSet, terms: Terms) -> tuple[Array, tuple[Prior, ...]]:
    """Parameters [p] from which the fit to the length of gravity starts, and the bound of angles
    that it does not see.
    """
    magnitude.require_enough(dwells.indication)
    levels, _ = determination.distinct_temperatures(dwells.temperature)
    if levels.size <= terms.order:
        raise FitError(
            f"{levels.size} distinct temperatures do not determine order {terms.order}",
            hint="lower the orders",
        )
    sphere = magnitude.fit_sphere(dwells.indication, 1.0)
    direction = (dwells.indication - sphere[3:6]) / sphere[:3]
    if determination.affine_rank(direction) < 4:
        raise FitError(
            "dwells on one cone or plane cannot determine the triad by the length of gravity",
            hint="hold it in attitudes that are spread over the whole sphere",
        )
    start = np.zeros(len(terms.listed))
    for k, term in enumerate(terms.listed):
        if term.power == 0 and term.kind == "k":
            start[k] = 1.0 / sphere[term.axis]
        elif term.power == 0 and term.kind == "z":
            start[k] = sphere[3 + term.axis] / sphere[term.axis]
    cross = terms.of_kind("c")
    priors: tuple[Prior, ...] = ()
    if cross and not _sees_angles(direction):
        block = slice(cross[0], cross[-1] + 1)
        priors = (Prior(name="angles", block=block, size=LARGEST_ANGLE),)
    return start, priors


def determines(dwells: DwellSet, terms: Terms) -> bool:
    """Whether attitudes and temperatures of the dwells determine every term."""
    try:
        _require_determined(terms, dwells.reference, dwells.temperature)
    except FitError:
        return False
    return True


def _require_determined(terms: Terms, reference: Array, temperature: Array) -> None:
    """Raise FitError where the dwells do not determine a term of an axis."""
    if reference.size <= len(terms.listed):
        raise FitError(
            f"{len(reference)} dwells for {len(terms.listed)} parameters",
            hint="add dwells or lower the orders",
        )
    parts = []
    for axis in range(3):
        places = [
            k
            for k, term in enumerate(terms.listed)
            if term.axis == axis and term.kind in ("k", "z", "c", "n")
        ]
        # low powers first, then the axis itself and its zero, then the other axes and higher orders
        places.sort(key=lambda k: (terms.listed[k].power, terms.listed[k].kind not in "kz", k))

        def design(
            vectors: Array, mapped: Array, axis: int = axis, places: list[int] = places
        ) -> Array:
            return terms.slopes(terms.nominal, vectors, mapped)[:, axis, places]

        names = tuple(terms.names[k] for k in places)
        parts.append(determination.Part(f"accel_{AXES[axis]}", names, design))
    determination.require_determined(
        parts,
        reference,
        temperature,
        order=terms.order,
        lower="lower scale_order, cross_order and bias_order, or leave out higher-order terms",
    )


def _sees_angles(direction: Array) -> bool:
    """Whether lengths in directions [n, 3] show the angles between the axes: an angle moves them by
    the product of two components, of which squares and components leave nothing at six faces.
    """
    product = direction * np.roll(direction, 1, axis=1)
    left = beside(np.hstack([direction**2, direction]), product)
    return bool(np.sqrt(np.mean(left**2, axis=0)).min() > SEEN)


def _tool_rotation(dwells: DwellSet) -> Array:
    """Passive rotations R_z(φ) R_y(θ) [n, 3, 3] from the table's base to the tool; their last
    column is the gravity vector [g].
    """
    theta, phi = np.radians(dwells.inclination), np.radians(dwells.toolface)
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    rows = ((ct * cp, sp, -st * cp), (-ct * sp, cp, st * sp), (st, np.zeros_like(st), ct))
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
