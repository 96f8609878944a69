"""Dwells that physics contradicts: a length far from 1 g, a wrong attitude, axes reversed or
exchanged.

A sensor that was never calibrated passes: indications are compared with what its own scale factors,
biases and axes, fitted robustly to all dwells, make of the reference.
"""

from collections.abc import Iterable
from itertools import permutations, product

import numpy as np

from calibkit.errors import FitError, FrameError
from calibkit.fit import robust
from calibkit.instruments.accelerometer import dwells as triad_dwells
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.forms import COMPONENTS, TEMPERATURE
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.logs import stated_segments
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.dispersion import mad_sigma
from calibkit.records.frame import Examined, Finding, Held, Log, refuse

LEAST_G = 0.03
"""Departure [g] below which no dwell is implausible: 1.7° of a table, the robust fit judges it."""
FAR = 10.0
"""Departure, in standard deviations of those of all dwells, above which a dwell is implausible."""
LARGEST_SHARE = 0.2
"""Share of implausible dwells above which the campaign is at fault, not a dwell."""
NAMED = 5
"""Implausible dwells that a refusal names one by one."""
FEW, LONE_DEGC, LONE_SHARE = 12, 5.0, 0.2
"""Dwells below which any may be alone at its temperature; distance [°C], and share of the range of
all others, from which on a dwell is.
"""
ENOUGH = 20_000
"""Dwells, evenly spread over more, that the preliminary fit uses."""
TWICE = 2.0
"""Factor by which another order of the axes must agree better, and a length is never off."""


def examine(spec: AccelerometerRecipe, log: Log) -> Examined:
    """Findings of a log, implausible dwells among them, and the dwells of a continuous log."""
    findings = tuple(triad_dwells.find_faults(log, spec))
    if any(finding.refused for finding in findings):
        return Examined(findings)
    try:
        dwells, rows = triad_dwells.read_dwells(log, spec)
    except (FitError, FrameError) as error:
        return Examined((*findings, Finding.of(error)))
    findings += find_implausible(dwells, spec)[1]
    if spec.dwells.mode == "rows":
        return Examined(findings)
    pinned = stated_segments.stated_rows(log, spec, ["dwell"]) is not None
    lengths = np.linalg.norm(dwells.indication, axis=1).tolist()
    dwell_rows = zip(rows.tolist(), lengths, strict=True)
    return Examined(
        findings, tuple(Held("dwell", a, b, length, "g", pinned) for (a, b), length in dwell_rows)
    )


def read_plausible(logs: Iterable[Log], spec: AccelerometerRecipe) -> DwellSet:
    """Dwells of the logs of a campaign without the implausible ones, which their flags name; raises
    FrameError where a fit must not go on without them.
    """
    dwells = triad_dwells.collect_dwells(logs, spec)
    rows, findings = find_implausible(dwells, spec)
    refuse(findings)
    return dwells.without(rows, map(str, findings)) if findings else dwells


def find_implausible(
    dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[Integers, tuple[Finding, ...]]:
    """Rows of the implausible dwells, and a finding on each or on the axes.

    A few are left out; they are refused where a fit by least squares would use them, where they are
    many, and where they are all dwells of an attitude.
    """
    by_attitude = spec.reference.kind == "attitude"
    if by_attitude and (turned_axes := _find_turned_axes(dwells, spec)) is not None:
        return np.zeros(0, dtype=np.int64), (turned_axes,)

    # 1. Dwells whose indication is far from what the triad shows at all others.
    expected, scatter = _predict(dwells, by_attitude=by_attitude)
    departure = np.linalg.norm(dwells.indication - expected, axis=1)
    # The coldest and the hottest dwell where all others are far from it: a polynomial would run
    # through it alone.
    lone: dict[int, str] = {}
    order = np.argsort(dwells.temperature, kind="stable")
    for coldest_first in (order, order[::-1]) if order.size >= FEW else ():
        row, nearest, *_, last = coldest_first.tolist()
        lone_degc, *others_degc = dwells.temperature[[row, nearest, last]].tolist()
        low, high = sorted(others_degc)
        if abs(lone_degc - others_degc[0]) > max(LONE_DEGC, LONE_SHARE * (high - low)):
            lone[row] = f"a temperature near the others, {low:.4g} to {high:.4g} °C"
    departure[[*lone]] = np.inf
    rows = np.flatnonzero(departure > max(LEAST_G, FAR * scatter))

    # 2. They are left out, or refused with the reason why not.
    refused = ""
    angles = np.column_stack([dwells.inclination, dwells.toolface])
    if spec.loss == "least_squares":
        refused = 'loss = "least_squares" leaves no dwell out'
    elif rows.size > LARGEST_SHARE * departure.size:
        refused = f"{rows.size} of {departure.size} dwells are implausible"
    elif by_attitude:
        for tilt, roll in np.unique(angles[rows], axis=0).tolist():
            repeats = np.flatnonzero((angles == (tilt, roll)).all(axis=1))
            if repeats.size > 1 and np.isin(repeats, rows).all():
                refused = f"all dwells at inclination {tilt:g}°, toolface {roll:g}° are"
                break
    advice = "a fit leaves it out: correct the row, or repeat the dwell"
    rows_named = rows
    if refused:
        advice = f"correct these rows or take them out of the log: {refused}"
        rows_named = rows[np.argsort(-departure[rows], kind="stable")][:NAMED]
    findings = []
    for row in rows_named.tolist():
        if row in lone:
            degc, column = float(dwells.temperature[row]), TEMPERATURE
            fault, due, figure = f"{column} is {degc:.4g} °C", lone[row], degc
        else:
            fault, due, column = _describe_dwell(dwells, expected, row, by_attitude=by_attitude)
            figure = float(departure[row])
        # finding implausible: a dwell that its attitude and the other dwells contradict
        findings.append(
            Finding(
                *(dwells.place[row], fault, due, advice),
                severity="refuse" if refused else "warn",
                name="implausible",
                figure=figure,
                column=column,
            )
        )
    return rows, tuple(findings)


def _find_turned_axes(dwells: DwellSet, spec: AccelerometerRecipe) -> Finding | None:
    """Finding where most dwells agree with their reference only after axes are reversed or
    exchanged.

    It is refused where the triad is left-handed, and where K0 … K3 would multiply another axis; a
    mounting that the recipe fits may be any.
    """
    sample = slice(None, None, 1 + len(dwells.place) // ENOUGH)
    indication, reference = dwells.indication[sample], dwells.reference[sample]
    ways = list(product(permutations((0, 1, 2)), product((1.0, -1.0), repeat=3)))
    medians = []
    for order, sign in ways:
        departure = indication[:, order] * np.array(sign) - reference
        medians.append(float(np.median(np.linalg.norm(departure, axis=1))))
    order, sign = ways[int(np.argmin(medians))]
    usual, best = medians[0], min(medians)  # as they are, the first way, and turned
    if spec.affine.fixture or usual < TWICE * max(best, 0.1):
        return None
    handed = float(np.linalg.det(np.eye(3)[list(order)])) * sign[0] * sign[1] * sign[2]
    axes_shown = ", ".join(
        f"{COMPONENTS[k]} shows {'−' if sign[axis] < 0.0 else ''}{'xyz'[axis]}"
        for axis, k in enumerate(order)
        if k != axis or sign[axis] < 0.0
    )
    # finding sign: axes of the triad have the wrong sign or order
    return Finding(
        dwells.place[0].rpartition(":")[0],
        f"axes of wrong sign or order: {axes_shown} (as they are, they disagree with the"
        f" attitudes by {usual:.2f} g, so by {best:.2f} g; medians)",
        "each axis to show its own component of gravity",
        "state sign and from in [columns], or reference.convention; or correct sense and zero of"
        " toolface",
        "refuse" if handed < 0.0 or spec.k.enabled else "warn",
        "sign",
        figure=usual,
    )


def _predict(dwells: DwellSet, *, by_attitude: bool) -> tuple[Array, float]:
    """Indications [n, 3, g] that the attitudes let expect of this triad, and the scatter [g] of a
    component about them; without attitudes, points on the sphere that most indications lie on, in
    the directions of the indications, and the scatter of the lengths about it.
    """
    indication = dwells.indication
    if by_attitude:
        # the reference is the regressor: its length is 1 g whatever was typed, so that no row has
        # leverage over all others
        sample = slice(None, None, 1 + len(dwells.place) // ENOUGH)
        warm = dwells.temperature - dwells.temperature.mean()
        constant = np.column_stack([np.ones(len(warm)), dwells.reference])
        for design in (np.column_stack([constant, constant * warm[:, None]]), constant):
            try:
                fits = [robust.linear(design[sample], axis) for axis in indication[sample].T]
            except FitError:
                continue
            expected = design @ np.column_stack([fit.coefficients for fit in fits])
            return expected, max(mad_sigma(fit.residuals) for fit in fits)
        # too few dwells: a nominal sensor, with any bias and scale factor that one may have
        return dwells.reference, 0.25 / FAR
    length = np.linalg.norm(indication, axis=1)
    usual = float(np.median(length))
    on_sphere = np.flatnonzero(np.abs(np.log(length / usual)) < np.log(TWICE))
    points = indication[on_sphere[:: 1 + on_sphere.size // ENOUGH]]
    try:
        # |v|² = 2 v·c + r² − |c|², linear in centre and radius
        design = np.column_stack([2.0 * points, np.ones(len(points))])
        *centre, constant = robust.linear(design, np.sum(points**2, axis=1)).coefficients
        radius = float(np.sqrt(constant + np.sum(np.square(centre))))
        scatter = mad_sigma(np.linalg.norm(points - centre, axis=1) - radius)
    except FitError:
        centre, radius, scatter = [0.0, 0.0, 0.0], usual, usual / TWICE / FAR
    direction = indication - centre
    return centre + radius * direction / np.linalg.norm(direction, axis=1)[:, None], scatter


def _describe_dwell(
    dwells: DwellSet, expected: Array, row: int, *, by_attitude: bool
) -> tuple[str, str, str]:
    """What a dwell shows, what is expected of it, and the column that is furthest off: its length,
    or beside a reference attitude a component, or the attitude that all three show.
    """
    indication, expected_g = dwells.indication[row], expected[row]
    axis = int(np.argmax(np.abs(indication - expected_g)))
    departure = float(np.linalg.norm(indication - expected_g))
    length, usual = float(np.linalg.norm(indication)), float(np.linalg.norm(expected_g))
    reads = f"{COMPONENTS[axis]} reads {indication[axis]:.4g} g"
    attitude_words = f"inclination {dwells.inclination[row]:g}°, toolface {dwells.toolface[row]:g}°"
    if not by_attitude:
        fault = f"the length is {length:.4g} g ({reads})"
        due_words = f"{usual:.4g} g, as the other dwells in this direction"
    elif abs(length - usual) > 0.5 * departure:
        fault = f"{reads}, the length is {length:.4g} g"
        due_words = f"{expected_g[axis]:.4g} g and {usual:.4g} g at {attitude_words}"
    else:
        gravity_shown = indication - expected_g + dwells.reference[row]
        toolface_off = attitude.wrapped(attitude.toolface(gravity_shown) - dwells.toolface[row])
        fault = (
            f"the triad shows about inclination {float(attitude.inclination(gravity_shown)):.0f}°,"
            f" toolface {float(dwells.toolface[row] + toolface_off):.0f}° ({reads})"
        )
        due_words = f"{attitude_words} as the reference states ({expected_g[axis]:.4g} g)"
    return fault, due_words, COMPONENTS[axis]
