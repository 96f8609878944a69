"""Dwells of a triad → coefficient files of its K-factor, Q-factor and of the triad over
temperature.

`fit_triad` tells the story: which terms the dwells determine (`determination`), the equation fitted
with the errors that dwells share (`triad`), what is doubtful (`findings`), and K and Q as published
(`list_results`).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.solve import sensitivities
from calibkit.instruments.accelerometer import findings, forms, profile_intervals, published
from calibkit.instruments.accelerometer.corrections import FIELDS
from calibkit.instruments.accelerometer.determination import choose_terms
from calibkit.instruments.accelerometer.dwells import ATTITUDE, DwellSet
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import angle_slopes
from calibkit.instruments.accelerometer.triad import Triad, residual, solve_triad
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array
from calibkit.numeric.least_squares import polynomial
from calibkit.records.coefficients import Condition, Figure, Parameter, StageResult
from calibkit.records.sensitivities import InputError, Sensitivity, differentiate, of_thermometer

WORSE = 1.1
"""Ratio of median absolute residuals above which one fit is worse than the other: on clean data the
two differ by chance.
"""
WORSE_THAN_NONE = 1.3
"""Ratio of the median absolute residual of least squares to that of no correction above which no
fit is exported: a triad that needs no correction differs by less, by chance.
"""
ANGLE_STEP_DEG, GRAVITY_STEP = 1e-3, 1e-5
"""Errors of the table's angles and of local gravity (relative) that sensitivities are taken by."""
ROUNDING_G = 1e-9
"""Difference of median absolute residuals [g] that is rounding."""


def fit_triad(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Triad, tuple[StageResult, ...]]:
    """The triad with all its flags, and the coefficient files that the recipe enables; raises
    FitError naming the coefficients that the dwells do not determine.
    """
    lengths = spec.reference.kind == "magnitude"
    by_lmfit = lengths and spec.reference.solver == "lmfit"

    # 1. Terms of the equation: those of the recipe, if the dwells determine them.
    terms, flags = choose_terms(dwells, spec)

    # 2. The triad, by least squares and without outliers, with the errors that dwells share.
    no_change = np.zeros(len(dwells.place))
    uncorrected = residual(terms.start(), dwells, terms, no_change, lengths=lengths)
    robust, failure = None, ""
    if spec.loss == "robust" and not by_lmfit:
        try:
            robust = solve_triad(dwells, terms, spec, loss="robust")
        except FitError as error:
            failure = error.message
    plain = robust  # a robust fit that leaves no dwell out is that of least squares
    if plain is None or plain.suspects:
        plain = solve_triad(dwells, terms, spec, loss="least_squares")
    triad, doubts = choose_fit(robust, plain, failure, uncorrected)
    flags += (*doubts, *findings.flag_fit(triad, dwells))
    if lengths:
        flags += findings.flag_lengths(triad, dwells)

    # 3. By lmfit, intervals of the nine parameters that a length determines.
    ends: tuple[Figure, ...] = ()
    if by_lmfit:
        ends, doubts = profile_intervals.find_intervals(triad, dwells)
        flags += doubts

    triad = replace(triad, flags=flags)
    of_angles = state_angles(triad, dwells, spec)
    return triad, list_results(triad, dwells, spec, intervals=ends, of_angles=of_angles)


def state_angles(triad: Triad, dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Figure, ...]:
    """Largest standard uncertainties [°] of the inclination, and of the toolface times
    sin(inclination) within the recipe's range, of the dwells that were fitted.

    u² = u²(p) along s + σ² |s|², s the direction in which gravity moves with the angle.
    """
    used = np.setdiff1d(np.arange(len(dwells.place)), triad.suspects)
    t, indication = triad.mapped(dwells.temperature[used]), dwells.indication[used]
    vector = triad.terms.corrected(triad.fit.parameters, indication, t)
    tilt, roll = attitude.inclination(vector), attitude.toolface(vector)
    # by the vector: of the toolface times sin(inclination), which has one at the poles too
    slopes = np.array(angle_slopes(np.radians(tilt), np.radians(roll)))
    slopes /= np.linalg.norm(vector, axis=1)[:, None]
    by_coefficients = triad.fit.of(
        lambda p: np.sum(slopes * triad.terms.corrected(p, indication, t), axis=2)
    ).u
    by_residual = triad.residual_rms * np.linalg.norm(slopes, axis=2)
    u_inclination, u_toolface_sin = np.degrees(np.hypot(by_coefficients, by_residual))
    low, high = spec.toolface_range_deg
    u_toolface_sin = u_toolface_sin[(tilt >= low) & (tilt <= high)]
    return tuple(
        Figure(f"{name}_standard_uncertainty_max", float(u.max()), "deg", 0.0)
        for name, u in (("inclination", u_inclination), ("toolface_sin", u_toolface_sin))
        if u.size
    )


def choose_fit(
    robust: Triad | None, plain: Triad, failure: str, uncorrected: Array
) -> tuple[Triad, tuple[str, ...]]:
    """The fit that is exported, and flags: of a robust one, if there is one (`failure` says why
    not), and of one by least squares to all dwells; `uncorrected` are the residuals [n] or
    [n, m, g] of the raw dwells.

    Least squares stands in where a robust fit does not converge, or leaves a median absolute
    residual that is 10 % larger than that of least squares or of no correction. Where the two fits
    differ by more than U, both values are flagged. Raises FitError where no fit is better than
    none.
    """
    # median absolute residuals [g] of dwells, over their components together: alone, most may be
    # zero at the attitudes that were held
    medians = []
    for residuals in (uncorrected, plain.residuals, (robust or plain).residuals):
        of_dwells = np.linalg.norm(residuals.reshape(len(residuals), -1), axis=1)
        medians.append(float(np.median(of_dwells)))
    raw, left_by_plain, left = medians
    robust = None if robust is plain else robust
    if robust is not None and left > WORSE * min(left_by_plain, raw) + ROUNDING_G:
        failure = (
            f"the robust fit leaves a median residual of {left:.2e} g, least squares"
            f" {left_by_plain:.2e} g, no correction {raw:.2e} g: look for an error that dwells"
            " share"
        )
    if robust is None or failure:
        if left_by_plain > WORSE_THAN_NONE * raw + ROUNDING_G:
            raise FitError(
                f"triad: the median residual is {left_by_plain:.2e} g after correction by least"
                f" squares, {raw:.2e} g before, expected a smaller one",
                hint="look for wrong rows or references: gross errors move such a fit",
            )
        used = "plain least squares was used, outliers are not left out"
        return plain, (f"triad: {failure}; {used}",) if failure else ()
    # where the fits differ by more than U, both values of the coefficient that differs most
    to_raw = robust.to_degrees.astype(np.float64)
    value = robust.fit.of(lambda p: to_raw @ p)
    plain_values, expanded = to_raw @ plain.fit.parameters, value.expanded
    share = np.abs(value.value - plain_values) / np.where(expanded > 0.0, expanded, np.inf)
    if np.max(share) <= 1.0 or np.max(np.abs(robust.residuals)) <= ROUNDING_G:
        return robust, ()
    k, count = int(np.argmax(share)), int(np.sum(share > 1.0)) - 1
    further = f", and {count} more coefficients differ" if count else ""
    flag = (
        f"triad: the fits differ by more than U: {robust.terms.names[k]} is {value.value[k]:.7g} ±"
        f" {expanded[k]:.1e} by the robust fit, which is exported, {plain_values[k]:.7g} by least"
        f" squares{further}; look at the suspects before you rely on it"
    )
    return robust, (flag,)


def list_results(
    triad: Triad,
    dwells: DwellSet,
    spec: AccelerometerRecipe,
    *,
    intervals: tuple[Figure, ...] = (),
    of_angles: tuple[Figure, ...] = (),
) -> tuple[StageResult, ...]:
    """Coefficient files of a triad: K, Q, and the triad in powers of °C, as the recipe enables
    them; raises FitError for axes in one plane and for a left-handed triad.
    """
    lengths, terms, fit = spec.reference.kind == "magnitude", triad.terms, triad.fit
    t, p, gravity = triad.mapped(dwells.temperature), fit.parameters, spec.site.local_gravity()
    site = () if gravity is None else (Condition("local_gravity", gravity, "m/s^2"),)
    flags = tuple(dict.fromkeys((*dwells.flags, *triad.flags)))
    residual_and_range: dict[str, Any] = {"residual_unit": "g", "valid": dwells.valid}
    results = []

    # 1. K = P g of the dwells that the triad's fit kept. What K is uncertain by, P V Pᵀ, comes from
    # the errors of the triad's own fit.
    if spec.k.enabled and not lengths:
        used = fit.used.reshape(-1, 3)
        weight = used / dwells.relative_noise(lengths=False).reshape(-1, 3)
        by_triad, models = terms.corrected(p, dwells.indication, t), []
        # in extended precision, because K3 and K7 lose digits in double
        to_raw = np.eye(10, dtype=np.longdouble)
        to_raw[:4, :4] = to_raw[4:8, 4:8] = polynomial.to_raw_powers(triad.middle, triad.half, 3)
        for axis, (name, orders) in enumerate(zip(forms.K_MODELS, spec.k.axes, strict=True)):
            design, numbers = published.columns(dwells.indication, t, axis), [*orders.fitted]
            P, root = np.zeros((10, 3 * len(t))), weight[:, axis]
            P[numbers, axis::3] = np.linalg.pinv(design[:, numbers] * root[:, None]) * root
            fit_of_k = fit.linear(P, dwells.reference.ravel()).bounded_by(triad.bounds)
            by_k, rows = design @ fit_of_k.parameters, used[:, axis]
            left = (dwells.reference[:, axis] - by_k)[rows]
            # what K corrects otherwise than the triad
            lack_of_fit = float(np.sqrt(np.mean((by_k - by_triad[:, axis])[rows] ** 2)))
            scaled = zip(published.K_NAMES, fit_of_k.parameters.tolist(), strict=True)
            model = forms.K.write_fit(
                name,
                fit_of_k,
                [*zip(published.K_NAMES, published.K_UNITS, strict=True)],
                residual_rms=float(np.sqrt(left @ left / max(len(left) - len(numbers), 1))),
                parameters=(
                    Parameter("middle", triad.middle, "degC"),
                    Parameter("half", triad.half, "degC"),
                    *(Parameter(f"scaled_{name}", value, "1") for name, value in scaled),
                    Parameter("lack_of_fit", lack_of_fit, "g"),
                ),
                to_raw=to_raw,
                **residual_and_range,
            )
            models.append(model)
        results.append(
            StageResult("accel_k", tuple(models), (), (*flags, *spec.k.not_fitted), site)
        )
    if not (lengths or spec.affine.enabled):
        return tuple(results)

    # 2. Q of the axes at one temperature, and its exact matrix.
    q_t = float(triad.mapped(triad.reference_degc))
    q = forms.Q.write_fit(
        "triad",
        fit.restated(lambda p: terms.at_temperature(p, q_t)[6:]),
        [(name, "rad") for name in published.Q_NAMES],
        residual_rms=triad.residual_rms,
        parameters=(Parameter("temperature", triad.reference_degc, "degC"),),
        **residual_and_range,
    )
    exact = fit.of(lambda p: published.exact_matrix(terms.at_temperature(p, q_t)[6:]))
    q_exact = [
        Figure(f"Q_exact_{row}{column}", float(exact.value[i, j]), "1", float(exact.u[i, j]))
        for i, row in enumerate(AXES)
        for j, column in enumerate(AXES[: i + 1])
    ]
    results.append(StageResult("accel_q", (q,), (*q_exact, *intervals), flags, site))

    # 3. The triad over temperature.
    axes = ("length",) if lengths else AXES
    noises = zip(axes, triad.noise.tolist(), strict=True)
    affine = forms.TRIAD.write_fit(
        "triad",
        fit,
        [*zip(terms.names, terms.units, strict=True)],
        residual_rms=triad.residual_rms,
        parameters=tuple(Parameter(f"noise_{axis}", size, "g") for axis, size in noises),
        to_raw=triad.to_degrees,
        **residual_and_range,
    )
    results.append(StageResult("accel_affine", (affine,), of_angles, flags, site))
    return tuple(results)


def find_sensitivities(
    triad: Triad, results: Sequence[StageResult], dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[Sensitivity, ...]:
    """Sensitivities of the coefficients of a fit to `dwells`, by fits to dwells that are shifted by
    an error of the thermometer, of the table's angles and, where it divides what is logged, of
    local gravity.
    """
    errors = [*of_thermometer(forms.TEMPERATURE, *dwells.valid[forms.TEMPERATURE])]
    if spec.reference.kind == "attitude":
        errors += [InputError(name, "offset", ANGLE_STEP_DEG) for name in ATTITUDE]
    gravity = spec.site.local_gravity()
    units = [spec.columns[name].unit for name in forms.COMPONENTS if name in spec.columns]
    if gravity is not None and "m/s^2" in units:
        errors.append(InputError("gravity_mps2", "offset", GRAVITY_STEP * gravity))
    shifted = []
    for error in errors:
        field = FIELDS.get(error.input, "indication")
        values = getattr(dwells, field)
        # what is logged in m/s² is a smaller multiple of a larger gravity
        with_error = values / (1.0 + GRAVITY_STEP) if field == "indication" else error.shift(values)
        shifted.append(replace(dwells, **{field: with_error}))
    equation, *shifted_equations = (
        partial(
            residual,
            dwells=rows,
            terms=triad.terms,
            t=triad.mapped(rows.temperature),
            lengths=spec.reference.kind == "magnitude",
        )
        for rows in (dwells, *shifted)
    )
    refits = {}
    changes = sensitivities(equation, shifted_equations, triad.fit)
    for error, shifted_dwells, change in zip(errors, shifted, changes, strict=True):
        fit = replace(triad.fit, parameters=triad.fit.parameters + change)
        refits[error] = list_results(replace(triad, fit=fit), shifted_dwells, spec)
    return differentiate(errors, results, refits.__getitem__)
