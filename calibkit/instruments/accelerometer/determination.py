"""Which terms of the equation a recipe asks for, and whether the dwells determine them.

The rank is computed from the reference attitudes and temperatures, because the noise of the
indications gives any design matrix full rank; and from singular values, so that no grid of dwells
is assumed and temperature sweeps at a few attitudes are judged correctly.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Orders, Terms
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe, KAxisSpec

TEMPERATURE_STEP_DEGC = 1.0
"""Temperatures closer than this [°C] count as one level."""
WEAK = 1e-3
"""Smallest singular value, relative to the largest after column scaling, that counts as determined;
it corresponds to 0.06° of attitude.
"""


def asked_terms(spec: AccelerometerRecipe) -> Terms:
    """Terms of the equation that a recipe asks for: of the triad, or as many as K has."""
    triad, lengths = spec.affine, spec.reference.kind == "magnitude"
    if not (triad.enabled or lengths):
        return Terms.of_orders(*_orders_of_k(spec.k.axes, cross=1))
    orders = [0, 0, 0]
    if triad.enabled:
        orders = [triad.scale_order, triad.bias_order, min(triad.cross_order, 1)]
    scale, zero, cross = ((order,) * 3 for order in orders)
    return Terms.of_orders(
        *(scale, zero, cross),
        triangular=lengths or triad.fixture,
        second_order=triad.enabled and triad.second_order,
        third_order=triad.enabled and triad.third_order,
        tilt=triad.enabled and triad.tilt,
        fixture=triad.enabled and triad.fixture,
    )


def _orders_of_k(axes: Sequence[KAxisSpec], cross: int) -> tuple[Orders, Orders, Orders]:
    """Orders of the scale factors, zeros and cross-axis terms (`cross`, or none) of x, y and z."""
    return (
        [axis.scale_order for axis in axes],
        [axis.zero_order for axis in axes],
        [cross if axis.cross else -1 for axis in axes],
    )


def choose_terms(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Terms, tuple[str, ...]]:
    """Terms of the equation that the recipe asks for, and a flag where the dwells do not show how
    cross-axis terms change with temperature. Raises FitError for other terms, and for a K, that the
    dwells do not determine.
    """
    terms, conditions = asked_terms(spec), (dwells.reference, dwells.temperature)
    if spec.reference.kind == "magnitude":  # the start of that fit says what it needs
        return terms, ()
    if spec.k.enabled:
        # of a triad without an error K are what the terms of its equation are
        of_k, names = Terms.of_orders(*_orders_of_k(spec.k.axes, cross=0)), []
        for term in of_k.listed:
            cross = 8 + published.CROSS[term.axis].index(term.factors[0]) if term.kind == "c" else 0
            names.append(published.K_NAMES[cross or term.power + 4 * (term.kind == "z")])
        lower = "lower scale_order and zero_order, or set cross to false"
        fault = find_undetermined(of_k, names, *conditions, lower=lower)
        if fault is not None:
            raise fault
    lower = "lower scale_order, cross_order and bias_order, or leave out higher-order terms"
    fault = find_undetermined(terms, terms.names, *conditions, lower=lower)
    if fault is None:
        return terms, ()
    constant = Terms(tuple(t for t in terms.listed if t.kind != "c" or not t.power))
    if find_undetermined(constant, constant.names, *conditions, lower=lower) is not None:
        raise fault
    flag = "cross-axis terms are constant over temperature: these dwells do not show their change"
    return constant, (flag,)


def find_undetermined(
    terms: Terms, names: Sequence[str], reference: Array, temperature: Array, *, lower: str
) -> FitError | None:
    """Error that names the terms which references [n, 3] [g] and temperatures [n] [°C] do not
    separate from those before them in the order of importance; None where all are determined.

    `names` [p] are what the error calls them, `lower` what to ask less of, in the recipe's words.
    """
    if reference.size <= len(terms.listed):
        return FitError(
            f"{len(reference)} dwells for {len(terms.listed)} parameters",
            hint="add dwells or lower the orders",
        )
    levels, level = distinct_temperatures(temperature)
    t = (2.0 * level - levels[0] - levels[-1]) / (np.ptp(levels) or 1.0)
    faults = []
    for axis, letter in enumerate(AXES):
        # Of columns that depend on each other the later ones are called undetermined: low powers
        # stand first, then the axis itself, its zero, the other axes in turn, and products.
        ranked = []
        for place in terms.of_axis(axis):
            term = terms.listed[place]
            turn = (term.factors[0] - axis) % 3 if term.kind == "c" else 0
            # derivative of the axis of a triad without an error, but for its sign
            column = np.prod(reference[:, term.factors], axis=1) * t**term.power
            ranked.append((term.power, "kzcn".index(term.kind), turn, names[place], column))
        ranked.sort(key=lambda entry: entry[:3])
        design = np.asarray(np.linalg.qr(np.column_stack([r[-1] for r in ranked]), mode="r"))
        independent, dependent = np.zeros((len(design), 0)), []
        for (*_, name, _), column in zip(ranked, design.T, strict=True):
            wider = np.column_stack([independent, column])
            if _rank(wider) < wider.shape[1]:
                dependent.append(name)
            else:
                independent = wider
        if dependent:
            faults.append(f"accel_{letter}: {', '.join(sorted(dependent))}")
    if not faults:
        return None
    shown_levels = (
        ", ".join(f"{value:.4g}" for value in levels)
        if levels.size <= 6
        else f"{levels[0]:.4g} … {levels[-1]:.4g}"
    )
    levels_needed = terms.order + 1
    add = (
        "at more temperatures"
        if levels.size < levels_needed
        else "on the six faces at each temperature"
    )
    return FitError(
        f"the data cannot determine {'; '.join(faults)}: {len(temperature)} dwells at"
        f" {levels.size} distinct temperatures ({shown_levels} °C; order {terms.order} needs"
        f" {levels_needed}) in attitudes of which {affine_rank(reference)} are affinely"
        " independent (cross-axis terms need 4)",
        hint=f"add dwells {add} (calibkit plan --have finds the cheapest), or {lower}",
    )


def distinct_temperatures(temperature: Array) -> tuple[Array, Array]:
    """Temperature levels [k] [°C] that are distinct, and the level [n] [°C] that each temperature
    [n] belongs to.

    A level opens at the lowest temperature that is a step above the last one's opening, so a sweep
    counts as many levels as it has steps, and the scatter of a chamber about its set point counts
    as one.
    """
    ascending = np.sort(temperature)
    openings = [0]
    while ascending[-1] >= ascending[openings[-1]] + TEMPERATURE_STEP_DEGC:
        step_up = ascending[openings[-1]] + TEMPERATURE_STEP_DEGC
        openings.append(int(np.searchsorted(ascending, step_up)))
    label = np.searchsorted(ascending[openings], temperature, side="right") - 1
    levels = np.bincount(label, weights=temperature) / np.bincount(label)
    return levels, levels[label]


def affine_rank(reference: Array) -> int:
    """Affine rank of the attitudes [n, 3]: 4 when they span space, 3 when they lie on one cone or
    plane.
    """
    return _rank(np.column_stack([np.ones(len(reference)), reference]))


def _rank(design: Array) -> int:
    length = np.linalg.norm(design, axis=0)
    singular = np.linalg.svd(design / np.where(length > 0.0, length, 1.0), compute_uv=False)
    return int(np.sum(singular > WEAK * singular[0])) if singular[0] > 0.0 else 0
