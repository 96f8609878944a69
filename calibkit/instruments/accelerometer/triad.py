"""Dwells → the triad over temperature, by gravity vectors or by the length of gravity alone.

    r = C(G, t; p) - g                    vectors, g of the attitude            [n, 3]       (1)
    r = R(fixture) C(G, t; p) - g(tilt)   the same in a fixture, on a tilted table           (2)
    r = |C(G, t; p)| - 1                  lengths, in units of local gravity    [n, 1]       (3)

C is what indications G mean at temperature t, a = k G - z with cross-axis terms: `equation`, (1)
and (2). Errors that dwells share (`shared_errors`) are fitted beside p by `solve`.
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.fit import robust
from calibkit.fit.complex_step import Numbers, length
from calibkit.fit.shared import Prior, Shared
from calibkit.fit.solve import Fit, solve, stand_out_together
from calibkit.instruments.accelerometer import determination, shared_errors
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import Terms, rotation, tilted_gravity
from calibkit.instruments.accelerometer.forms import TEMPERATURE
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.logs.nameless import find_sphere
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array

Loss = Literal["least_squares", "robust"]
OF_LENGTHS = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z", "Q1", "Q2", "Q3")
"""What the length of gravity determines at one temperature."""
ENOUGH_TO_START = 20_000
"""Dwells, evenly spread over more, from which the fit to lengths starts."""
LARGEST_ANGLE = 0.01
"""Misalignment [rad] beyond that of any good triad, where lengths do not see the angles."""


@dataclass(frozen=True, slots=True)
class Triad:
    """Equation (1), (2) or (3) fitted to n dwells."""

    terms: Terms
    fit: Fit
    """For temperature mapped to [-1, 1]."""
    middle: float
    """Middle of the temperature range [°C]."""
    half: float
    """Half-width of the temperature range [°C]; 1 when the temperature was constant."""
    reference_degc: float
    """Temperature of Q [°C]: the recipe's, or that of the dwells which is nearest to it; the mean
    of the dwells where the triad knows no temperature.
    """
    residuals: Array
    """[n, 3], corrected less reference, or [n, 1] of the lengths [g]."""
    suspects: tuple[int, ...]
    """Dwells that were left out, worst first."""
    bounds: tuple[Shared, ...]
    """Errors that are in U below a bound."""
    flags: tuple[str, ...]
    residual_rms: float
    """Root of the sum of squares of the residuals used over the degrees of freedom [g]; shared
    errors are part of it.
    """
    noise: Array
    """Standard deviation of the noise of a dwell [m] along each axis, or of its length [g]."""
    to_degrees: np.ndarray
    """Matrix [p, p], in extended precision, from the parameters to those in powers of °C."""

    def mapped(self, temperature: Array | float) -> Array:
        """Temperatures [°C], any number of them, in the unit of the parameters."""
        return np.asarray((temperature - self.middle) / self.half)


def solve_triad(dwells: DwellSet, terms: Terms, spec: AccelerometerRecipe, *, loss: Loss) -> Triad:
    """Fit the equation to gravity vectors, of dwells that determine its terms (`choose_terms`), or
    to the length of gravity.

    Raises FitError for lengths that do not determine them: says why and what to add.
    """
    lengths = spec.reference.kind == "magnitude"
    per_dwell = 1 if lengths else 3
    low, high = dwells.valid[TEMPERATURE]
    middle, half = (low + high) / 2.0, (high - low) / 2.0 or 1.0
    t = (dwells.temperature - middle) / half
    reference_degc = spec.reference_temp_degc if spec.affine.enabled else dwells.temperature.mean()
    equation = partial(residual, dwells=dwells, terms=terms, t=t, lengths=lengths)
    noise, used = dwells.relative_noise(lengths=lengths), np.ones(len(t) * per_dwell, dtype=bool)

    # 1. Least squares; where outliers are to be left out, a robust start: each component is fitted
    # by the parameters of its own axis, as the others hardly move it, while angles of table and
    # fixture stay. Where most of a soak or an attitude stand apart, it has an error of its own.
    priors: tuple[Prior, ...] = ()
    if lengths:
        start, priors = _start_of_lengths(dwells, terms)
    else:
        # a straight line of each axis by its own indication, from which cross-axis terms follow
        scale, zero = np.zeros((2, 3))
        for axis, (G, g) in enumerate(zip(dwells.indication.T, dwells.reference.T, strict=True)):
            if np.ptp(G) < 0.1 * np.max(np.abs(G)):  # one value alone has a slope and no zero
                scale[axis] = G @ g / (G @ G)
            else:
                scale[axis], zero[axis] = np.polyfit(G, g, 1)
        start = terms.start(scale, -zero)
    solve_from = partial(solve, equation, priors=priors, noise=noise, names=terms.names)
    first = solve_from(start)
    if loss == "robust":
        levels = [shared_errors.number_soaks(dwells.temperature, dwells.log)]
        if lengths:  # what they do not see of angles is known by the prior alone
            of_components = [np.isin(terms.kind, [*("kz" if priors else "kzcn")])]
        else:
            of_axes = np.where(np.isin(terms.kind, [*"kzcn"]), terms.axis, -1)
            of_components = [of_axes == axis for axis in range(3)]
            levels.append(shared_errors.number_attitudes(dwells.reference))
        left, jacobian = first.residual / noise, first.jacobian / noise[:, None]
        for component, of_component in enumerate(of_components):
            rows = slice(component, None, per_dwell)
            good = robust.linear(jacobian[rows, of_component], -left[rows]).row_weights > 0.0
            # rows of a level that stands apart as a whole stay in, though the start leaves them out
            used[rows] = np.any(
                [good, *(stand_out_together(good, level) for level in levels)], axis=0
            )
        if not used.all():
            first = solve_from(first.parameters, used=used)

    # 2. The fit with the errors that dwells share. Errors of a dwell act on its gravity vector, of
    # which a length is the part along gravity.
    directions, gravity = np.broadcast_to(np.eye(3), (len(t), 3, 3)), dwells.reference
    if lengths:
        gravity = terms.corrected(first.parameters, dwells.indication, t)
        directions = (gravity / length(gravity)[:, None])[:, None, :]
    candidates = shared_errors.state_errors(dwells, gravity, directions, spec)
    # Of optional errors those are offered of which the parameters leave enough; chance makes the
    # others large, and the parameters wrong by as much.
    Q, _ = np.linalg.qr(first.jacobian / np.linalg.norm(first.jacobian, axis=0))
    offered = []
    for error in candidates:
        if error.optional:
            Z = error.design(np.arange(len(Q)))
            if np.sum((Z - Q @ (Q.T @ Z)) ** 2) <= shared_errors.SEEN**2 * np.sum(Z**2):
                continue
        offered.append(error)
    fit = solve_from(
        first.parameters,
        offered,
        channel=np.tile(np.arange(per_dwell), len(t)),
        used=used,
        leave_out=loss == "robust",
    )

    # 3. Errors that are in U alone.
    by_scale = (directions * gravity[:, None, :]).reshape(-1, 3)
    bounds, flags = shared_errors.bounded_errors(fit, candidates, by_scale, per_dwell)
    if not fit.converged:
        flags += ("the fit did not come to rest: look at the residuals before you rely on it",)
    residuals = fit.residual.reshape(-1, per_dwell)
    out = np.flatnonzero(~fit.used.reshape(-1, per_dwell).all(axis=1))
    worst_first = np.argsort(-np.max(np.abs(residuals[out]), axis=1), kind="stable")
    used_residuals = fit.residual[fit.used]
    return Triad(
        terms=terms,
        fit=fit.bounded_by(bounds),
        middle=middle,
        half=half,
        reference_degc=float(np.clip(reference_degc, low, high)),
        residuals=residuals,
        suspects=tuple(out[worst_first].tolist()),
        bounds=bounds,
        flags=flags,
        residual_rms=float(np.sqrt(used_residuals @ used_residuals / max(fit.dof, 1))),
        noise=np.sqrt(np.mean(fit.noise.reshape(residuals.shape) ** 2, axis=0)),
        to_degrees=terms.to_degrees(middle, half),
    )


def residual(p: Numbers, dwells: DwellSet, terms: Terms, t: Array, *, lengths: bool) -> Numbers:
    """What (1) or (2) leaves of gravity vectors [n, 3], or (3) of the length of gravity [n, 1]."""
    corrected = terms.corrected(p, dwells.indication, t)
    if lengths:
        return length(corrected) - 1.0
    tilt, fixture = terms.kind == "tilt", terms.kind == "fixture"
    if fixture.any():
        corrected = corrected @ rotation(p[fixture]).T
    if tilt.any():
        tool_rotation = attitude.tool_rotation(dwells.inclination, dwells.toolface)
        return corrected - tilted_gravity(tool_rotation, p[tilt])
    return corrected - dwells.reference


def _start_of_lengths(dwells: DwellSet, terms: Terms) -> tuple[Array, tuple[Prior, ...]]:
    """Parameters [p] from which the fit to the length of gravity starts, and the bound of angles
    that it does not see.
    """
    if len(dwells.indication) < len(OF_LENGTHS):
        raise FitError(
            f"{len(dwells.indication)} dwells for {len(OF_LENGTHS)} parameters"
            f" ({', '.join(OF_LENGTHS)})",
            hint="hold at least 12 different attitudes, better 18, spread over the whole sphere",
        )
    levels, _ = determination.distinct_temperatures(dwells.temperature)
    order = max(terms.power)
    if levels.size <= order:
        raise FitError(
            f"{levels.size} distinct temperatures do not determine order {order}",
            hint="lower the orders",
        )
    if not np.isfinite(dwells.indication).all():
        raise FitError(
            "a value that is not finite reached the fit", hint="exclude the rows that hold it"
        )
    *centre, radius = find_sphere(dwells.indication[:: 1 + len(dwells.place) // ENOUGH_TO_START])
    direction = (dwells.indication - centre) / radius
    if determination.rank(np.column_stack([np.ones(len(direction)), direction])) < 4:
        raise FitError(
            "dwells on one cone or plane cannot determine the triad by the length of gravity",
            hint="hold it in attitudes that are spread over the whole sphere",
        )
    start = terms.start(1.0 / radius, np.array(centre) / radius)
    cross = np.flatnonzero(terms.kind == "c")
    # an angle moves lengths by the product of two components of their directions, of which squares
    # and components leave nothing at six faces
    product = direction * np.roll(direction, 1, axis=1)
    determined = np.hstack([direction**2, direction])
    left = product - determined @ np.linalg.lstsq(determined, product, rcond=None)[0]
    if not cross.size or np.sqrt(np.mean(left**2, axis=0)).min() > shared_errors.SEEN:
        return start, ()
    return start, (Prior(name="angles", block=slice(cross[0], cross[-1] + 1), size=LARGEST_ANGLE),)
