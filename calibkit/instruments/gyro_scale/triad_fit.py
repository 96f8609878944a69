"""Table runs about three axes of one base → sensitivities of any number of gyros and angles between
them, also over temperature.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import FitError, advise_exclude
from calibkit.fit.complex_step import Numbers, arctan2, length
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.frame import Remark
from calibkit.instruments.gyro_scale import (
    contradictions,
    equation,
    forms,
    lines,
    ordering,
    over_runs,
    table_runs,
)
from calibkit.instruments.gyro_scale.campaign import (
    AxesSet,
    Campaign,
    Channel,
    Triad,
    stated_components,
)
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.numeric.least_squares import polynomial

COLLINEAR = 4.0
"""Distance of an angle from 0° or 180°, in standard uncertainties, below which its first-order
uncertainty is flagged.
"""
PARALLEL = 1e-12
"""Sine of an angle below which every direction across the axes is possible."""
ONE_SET_DEGC = 5.0
"""Largest difference in temperature [°C] between the runs of one set."""


def fit_axes(
    spec: GyroTriadRecipe,
    runs: Mapping[str, tuple[table_runs.TableRun, ...]],
    near: Campaign | None = None,
) -> Campaign:
    """Fit sensitivities and angles of each set of runs, and each sensitivity over temperature where
    the temperature varies; `near` is a fit of nearly the same runs.

    Raises FitError for a table axis without a run at some temperature.
    """
    every = [run for axis in forms.AXES for run in runs[axis]]
    logged = bool(np.isfinite([run.temp_degc for run in every]).all())
    groups = _groups(runs) if logged else [dict(runs)]
    run_lines = lines.Lines.of(
        [
            [(a, run) for a, axis in enumerate(forms.AXES) for run in group[axis]]
            for group in groups
        ],
        near.run_lines if near else None,
    )
    known = spec.known_errors()
    run_scale, mounting = run_lines.run_scale(known.get("scale")), None
    if "angle" in known:
        S = run_lines.sensitivity()
        # a tilt toward one of the other axes
        across = np.array([np.delete(S, axis, axis=1) for axis in range(S.shape[1])])
        mounting = run_lines.mounting(np.swapaxes(across, 0, 1), known["angle"])
    stated = [error for error in (run_scale, mounting) if error]
    vertical = table_runs.vertical_rate_dps(spec)
    sets = [_fit_set(run_lines, stated, vertical, group, s) for s, group in enumerate(groups)]
    for one in sets:
        _require_own_axes(one, spec.gyros)
    reference = 0
    if logged:
        off = [abs(one.temp_degc - spec.reference_temp_degc) for one in sets]
        reference = int(np.argmin(off))
    sets[reference] = replace(sets[reference], suffix="")
    over: equation.Fitted | None = None
    curves: list[Model] = []
    if len(sets) > 1:
        over = _fit_polynomials(run_lines, run_scale, near.over if near else None)
        curves = list(_list_curves(over, spec.gyros, every, mounting, vertical))
    main = np.argmax(np.abs(sets[reference].triad.sensitivity), axis=1)
    channels = [
        Channel(gyro, axis, own=a == main[g], runs=runs[axis], curves=tuple(curves[at : at + 1]))
        for at, ((g, gyro), (a, axis)) in enumerate(
            product(enumerate(spec.gyros), enumerate(forms.AXES))
        )
    ]
    flags: list[str] = []
    if not near:
        flags = [flag for run in every for flag in run.flags]
        if not logged and len(every) > len(forms.AXES):
            flags.append(over_runs.UNLOGGED)
        flags += _flag_lines(spec, groups, run_lines)
        flags += _flag_sets(spec, sets, mounting)
        if run_scale is None:
            flags.append(Remark(lines.WITHIN))
    return Campaign(
        tuple(channels),
        run_lines,
        tuple(dict.fromkeys(flags)),
        stated_components(run_scale, mounting),
        sets=tuple(sets),
        over=over,
        bias_curves=tuple(curves[len(channels) :]),
    )


def _flag_lines(
    spec: GyroTriadRecipe,
    groups: Sequence[Mapping[str, tuple[table_runs.TableRun, ...]]],
    run_lines: lines.Lines,
) -> Iterator[str]:
    """Flags of the lines of single runs: what changed during a run, runs that contradict the
    others, time.
    """
    yield from run_lines.flag_drifts()
    in_order = [(axis, run) for group in groups for axis in forms.AXES for run in group[axis]]
    main = np.abs(run_lines.sensitivity()).argmax(axis=1)
    for gyro, most in zip(spec.gyros, main, strict=True):
        axis = forms.AXES[most]
        about = [run for turned, run in in_order if turned == axis]
        name = forms.line_name(gyro, axis)
        yield from contradictions.flag_runs(name, about, run_lines.of_runs(about, gyro))
    yield from contradictions.flag_shares(run_lines, [run for _, run in in_order], spec.gyros)
    for change in run_lines.in_time:
        name = forms.line_name(spec.gyros[change.gyro])
        yield from ordering.flag(name, change.decided, run_lines.K[change.lines].mean())


def _fit_set(
    run_lines: lines.Lines,
    stated: Sequence[Shared],
    vertical_dps: float | None,
    group: Mapping[str, tuple[table_runs.TableRun, ...]],
    number: int,
) -> AxesSet:
    """Triad and biases F0 − K ω of one set of runs, ω the earth's rate about the table's axis."""
    chosen, gyros = run_lines.set_of == number, int(run_lines.gyro_of.max()) + 1
    means = run_lines.means(chosen).reshape(3 * gyros, -1)
    every = tuple(run for axis in forms.AXES for run in group[axis])
    degc = float(np.mean([run.temp_degc for run in every]))
    suffix = f".at_{degc:.0f}"
    if vertical_dps is None:
        fit = run_lines.combined(means, np.zeros_like(means)).widened_by(stated)
        return AxesSet(every, degc, suffix, fit, find_triad(fit), None)
    unit = np.eye(chosen.size)
    bias = run_lines.combined(-vertical_dps * unit, unit).of(lambda p: p)
    zeros = [run_lines.run_zero(g, chosen, bias) for g in range(gyros)]
    of_gyro = chosen & (run_lines.gyro_of == np.arange(gyros)[:, None])
    mean = of_gyro / np.sum(of_gyro, axis=1, keepdims=True)
    fit = run_lines.combined(
        np.vstack((means, -vertical_dps * mean)),
        np.vstack((np.zeros_like(means), mean)),
    ).widened_by([*stated, *zeros])
    triad = find_triad(fit.weighted(np.eye(4 * gyros)[: 3 * gyros]))
    return AxesSet(every, degc, suffix, fit, triad, fit.of(lambda p: p[3 * gyros :]))


def _list_curves(
    over: equation.Fitted,
    gyros: Sequence[str],
    runs: Sequence[table_runs.TableRun],
    mounting: Shared | None,
    vertical_dps: float | None,
) -> Iterator[Model]:
    """Sensitivities and biases over temperature."""
    fit, rows, terms = over
    line = equation.best_line(terms, rows.rate_dps)
    K = fit.restated(lambda p: line(p)[equation.SCALE].ravel())
    K = K.widened_by([mounting] if mounting else [])
    powers = max(terms.orders) + 1
    for number, (gyro, axis) in enumerate(product(gyros, forms.AXES)):
        name = forms.curve_name(forms.line_name(gyro, axis), "K")
        places = np.arange(powers) + powers * number
        of_line = K.weighted(np.eye(K.parameters.size)[places])
        yield over_runs.curve_model(name, "1/deg", of_line, terms, runs)
    for g, gyro in enumerate(gyros if vertical_dps is not None else ()):

        def bias(p: Numbers, g: int = g) -> Numbers:
            scale, zero = line(p)
            return np.asarray(np.mean((zero - vertical_dps * scale)[3 * g : 3 * g + 3], axis=0))

        name = forms.curve_name(gyro, "bias")
        yield over_runs.curve_model(name, "1/s", fit.restated(bias), terms, runs)


def _fit_polynomials(
    run_lines: lines.Lines, run_scale: Shared | None, near: equation.Fitted | None
) -> equation.Fitted:
    """Equation (1) of all runs with polynomials over temperature."""
    S, rows = run_lines.sensitivity(), replace(run_lines.rows, line=run_lines.rows.channel)
    if near:
        return near.refit(rows)
    order = max(min(polynomial.HIGHEST_ORDER, int(run_lines.set_of.max()) - 1), 0)
    terms = equation.Terms(
        S.size,
        (order, order),
        polynomial.middle_and_half(rows.row_degc),
        (line_terms.ASYMMETRY,) if rows.shows_asymmetry else (),
    )
    own = np.repeat(np.linalg.norm(S, axis=1), S.shape[1])
    shared = [
        replace(one, size=run_scale.size, size_dof=run_scale.size_dof)
        if run_scale and one.name == run_scale.name
        else one
        for one in equation.shared_errors(rows, terms, S.ravel(), own)
    ]
    return equation.Fitted(equation.fit(rows, terms, shared), rows, terms)


def _require_own_axes(one: AxesSet, gyros: Sequence[str]) -> None:
    """Raise FitError where a gyro named x, y or z senses another of these axes most: logs or
    columns are exchanged.
    """
    for gyro, row in zip(gyros, one.triad.misalignment.value, strict=True):
        most = forms.AXES[int(np.argmax(np.abs(row)))]
        if gyro in forms.AXES and most != gyro:
            raise FitError(
                f"{_place(one)}gyro {gyro} senses table axis {most} most"
                f" ({row[forms.AXES.index(most)]:+.3f})",
                hint=(
                    "logs are exchanged under [axes], or columns; gyros that are not mounted so"
                    " need other names"
                ),
            )


def _place(one: AxesSet) -> str:
    """Beginning of the flags of a set."""
    return f"{one.temp_degc:.0f} °C: " if np.isfinite(one.temp_degc) else ""


def _groups(
    runs: Mapping[str, tuple[table_runs.TableRun, ...]],
) -> list[dict[str, tuple[table_runs.TableRun, ...]]]:
    """Runs grouped by temperature, coldest first, each group with every axis."""
    pairs = sorted(
        ((run.temp_degc, axis, run) for axis in forms.AXES for run in runs[axis]),
        key=lambda pair: pair[0],
    )
    groups: list[dict[str, tuple[table_runs.TableRun, ...]]] = []
    last = float("-inf")
    for degc, axis, run in pairs:
        if degc - last > ONE_SET_DEGC:
            groups.append({})
        groups[-1][axis] = (*groups[-1].get(axis, ()), run)
        last = degc
    for group in groups:
        if missing := [axis for axis in forms.AXES if axis not in group]:
            there = ", ".join(run.log.file for axis in group for run in group[axis])
            degc = float(np.mean([run.temp_degc for axis in group for run in group[axis]]))
            raise FitError(
                f"no log about table axis {missing[0]} near {degc:.1f} °C, where there are {there}",
                hint=(
                    "each temperature needs a run about each axis; leave the others out:"
                    f" {advise_exclude(there.split(', ')[0])}"
                ),
            )
    return groups


def _flag_sets(
    spec: GyroTriadRecipe, sets: Sequence[AxesSet], mounting: Shared | None
) -> Iterator[str]:
    """Flags for left-handed input axes, poorly determined scale factors, and biases that are
    inconsistent or unknown.
    """
    for one in sets:
        yield from (f"{_place(one)}{flag}" for flag in one.triad.flags)
    directions = [one.triad.misalignment.value for one in sets]
    if len(spec.gyros) == len(forms.AXES) and (np.linalg.det(directions) < 0.0).any():
        yield "the input axes make a left-handed system: logs or signs may be exchanged"
    for one in sets:
        shares = one.triad.magnitude.u / one.triad.magnitude.value
        for gyro, share in zip(spec.gyros, shares, strict=True):
            if not share < table_runs.UNCERTAIN:
                yield (
                    f"{_place(one)}{gyro}: the scale factor is known to {100.0 * share:.2g} % only:"
                    " hold faster rates, or longer"
                )
    if mounting is None and len(spec.gyros) > 1:
        yield Remark(
            "the errors of mounting are not in u of the angles and unit vectors: state how a"
            ' mounting repeats in [[errors.component]] group = "mounting", effect = "angle"'
        )
    if spec.site.latitude_deg is None:
        yield (
            "the latitude is not known ([site] latitude_deg): the bias stays mixed with the earth's"
            " rate about each table axis, and `apply` is refused"
        )
    for one in sets:
        # a bias that differs between the attitudes depends on acceleration, or the earth's rate is
        # wrong
        u = 0.0 if one.bias is None else one.bias.u / one.triad.magnitude.value
        largest = float(np.max(u)) * DPH_PER_DPS
        if largest > 1.0:
            yield (
                f"{_place(one)}the bias is known to {largest:.2g} °/h only: it differs between the"
                " table axes (latitude, table axis, or a bias that depends on acceleration)"
            )


def _unit(p: Numbers) -> Numbers:
    """Unit vectors [g, 3] of sensitivities [3 g]."""
    s = p.reshape(-1, 3)
    return s / length(s)[:, None]


def find_triad(fit: Fit) -> Triad:
    """Angles and misalignment of g gyros from their scale factors about three orthogonal table
    axes, s_g gyro by gyro [3 g].

    Raises
    ------
    FitError
        Values that are not finite, or a gyro that senses none of the axes.

    """
    sensitivity = fit.parameters.reshape(-1, 3)
    count = len(sensitivity)
    if not (np.isfinite(sensitivity).all() and np.isfinite(fit.covariance).all()):
        raise FitError("a sensitivity is not finite", hint="check the run about each axis")
    size = np.linalg.norm(sensitivity, axis=1)
    if not (size > 0.0).all():
        raise FitError(f"gyro {int(np.argmin(size)) + 1} senses none of the three table axes")
    angles, u, dof = (np.zeros((count, count)) for _ in range(3))
    dof += np.inf
    for g in range(count):
        for h in range(g + 1, count):
            one = _value_of_angle(fit, g, h)
            for matrix, number in ((angles, one.value), (u, one.u), (dof, one.dof)):
                matrix[g, h] = matrix[h, g] = float(number)
    near = np.minimum(angles, 180.0 - angles) < COLLINEAR * u
    flags = [
        f"gyros {g + 1} and {h + 1} are collinear within noise"
        for g, h in np.argwhere(np.triu(near, 1))
    ]
    if np.linalg.matrix_rank(sensitivity / size[:, None], tol=1e-6) < 3:
        flags.append("the gyros do not span three axes: the compensation leaves rates out")
    return Triad(
        fit,
        fit.of(lambda p: length(p.reshape(-1, 3))),
        fit.of(_unit),
        Value(angles, u, dof),
        tuple(flags),
    )


def _value_of_angle(fit: Fit, g: int, h: int) -> Value:
    """Angle [°] between two input axes."""
    a, b = _unit(fit.parameters)[[g, h]]
    if np.linalg.norm(np.cross(a, b)) > PARALLEL:

        def angle_deg(p: Numbers) -> Numbers:
            """atan2(|u_g × u_h|, u_g · u_h), which loses no digits near 0° and 180°."""
            u_g, u_h = _unit(p)[[g, h]]
            return arctan2(length(np.cross(u_g, u_h)), np.sum(u_g * u_h)) * 180.0 / np.pi

        return fit.of(angle_deg)
    # every direction across the axis is possible: that of the largest u counts, which is the main
    # axis of the ellipse of the difference, whose covariance follows from three variances
    across = np.linalg.svd(a[None])[2][1:] * 180.0 / np.pi

    def apart(directions: Array) -> Value:
        """Difference [°] of both axes along directions [m, 2] across them."""
        return fit.of(lambda p: directions @ across @ (_unit(p)[g] - _unit(p)[h] * np.sign(a @ b)))

    along_1, along_2, along_both = apart(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])).u ** 2
    mixed = (along_both - along_1 - along_2) / 2.0
    _, main_axes = np.linalg.eigh([[along_1, mixed], [mixed, along_2]])
    worst = apart(main_axes[:, -1:].T)
    angle = np.asarray(0.0 if a @ b > 0.0 else 180.0)
    return Value(angle, worst.u[0], worst.dof[0])
