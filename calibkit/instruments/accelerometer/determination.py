"""Which terms of the equation a recipe asks for, and whether the dwells determine them.

The rank is computed from the reference attitudes and temperatures, because the noise of the
indications gives any design matrix full rank; and from singular values, so that no grid of dwells
is assumed and temperature sweeps at a few attitudes are judged correctly.
"""

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES, Terms, name_terms, read_terms
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric.arrays import Array

TEMPERATURE_STEP_DEGC = 1.0
"""Temperatures closer than this [°C] count as one level."""
WEAK = 1e-3
"""Smallest singular value, relative to the largest after column scaling, that counts as determined;
it corresponds to 0.06° of attitude.
"""


def asked_terms(spec: AccelerometerRecipe) -> tuple[Terms, Terms]:
    """Terms of the equation that a recipe asks for: of the triad, or as many as K has; and those
    that K has.
    """
    triad, lengths, axes = spec.affine, spec.reference.kind == "magnitude", spec.k.axes
    scale, zero = [axis.scale_order for axis in axes], [axis.zero_order for axis in axes]
    of_k = name_terms(scale, zero, [0 if axis.cross else -1 for axis in axes])
    if not (triad.enabled or lengths):
        return name_terms(scale, zero, [1 if axis.cross else -1 for axis in axes]), of_k
    orders = [0, 0, 0]
    if triad.enabled:
        orders = [triad.scale_order, triad.bias_order, min(triad.cross_order, 1)]
    terms = name_terms(
        *((order,) * 3 for order in orders),
        triangular=lengths or triad.fixture,
        second_order=triad.enabled and triad.second_order,
        third_order=triad.enabled and triad.third_order,
        tilt=triad.enabled and triad.tilt,
        fixture=triad.enabled and triad.fixture,
    )
    return terms, of_k


def choose_terms(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[Terms, tuple[str, ...]]:
    """Terms of the equation that the recipe asks for, and a flag where the dwells do not show how
    cross-axis terms change with temperature. Raises FitError for other terms, and for a K, that the
    dwells do not determine.
    """
    (terms, of_k), conditions = asked_terms(spec), (dwells.reference, dwells.temperature)
    if spec.reference.kind == "magnitude":  # the start of that fit says what it needs
        return terms, ()
    if spec.k.enabled:
        # of a triad without an error K are what the terms of its equation are
        fault = find_undetermined(of_k, *conditions, published=True)
        if fault is not None:
            raise fault
    fault = find_undetermined(terms, *conditions)
    if fault is None:
        return terms, ()
    constant = read_terms(tuple(name for name in terms.names if not name.startswith("d_")))
    if find_undetermined(constant, *conditions) is not None:
        raise fault
    flag = "cross-axis terms are constant over temperature: these dwells do not show their change"
    return constant, (flag,)


def find_undetermined(
    terms: Terms, reference: Array, temperature: Array, *, published: bool = False
) -> FitError | None:
    """Error that names the terms which references [n, 3] [g] and temperatures [n] [°C] do not
    separate from those before them in the order of importance; None where all are determined. Terms
    are called by their names, or K0 … K9 as `published`.
    """
    if reference.size <= len(terms.names):
        return FitError(
            f"{len(reference)} dwells for {len(terms.names)} parameters",
            hint="add dwells or lower the orders",
        )
    levels, level = distinct_temperatures(temperature)
    t = (2.0 * level - levels[0] - levels[-1]) / (np.ptp(levels) or 1.0)
    faults = []
    for axis, letter in enumerate(AXES):
        # Of columns that depend on each other the later ones are called undetermined: low powers
        # stand first, then the axis itself, its zero, the other axes in turn, and products.
        ranked = []
        for place in np.flatnonzero((terms.axis == axis) & np.isin(terms.kind, [*"kzcn"])):
            kind, power, factors = terms.kind[place], terms.power[place], terms.factors[place]
            turn = (factors[0] - axis) % 3 if kind == "c" else 0
            name = terms.names[place]
            if published:  # K8 and K9 are of the next axis in turn and the one after
                name = f"K{power + {'k': 0, 'z': 4, 'c': 7 + turn}[kind]}"
            # derivative of the axis of a triad without an error, but for its sign
            column = np.prod(reference[:, factors], axis=1) * t**power
            ranked.append((power, "kzcn".index(kind), turn, name, column))
        ranked.sort(key=lambda entry: entry[:3])
        design = np.asarray(np.linalg.qr(np.column_stack([r[-1] for r in ranked]), mode="r"))
        independent, dependent = np.zeros((len(design), 0)), []
        for (*_, name, _), column in zip(ranked, design.T, strict=True):
            wider = np.column_stack([independent, column])
            if rank(wider) < wider.shape[1]:
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
    order = max(terms.power)
    add = "at more temperatures" if levels.size <= order else "on the six faces at each temperature"
    affine_rank = rank(np.column_stack([np.ones(len(reference)), reference]))
    lower = "lower scale_order, cross_order and bias_order, or leave out higher-order terms"
    if published:
        lower = "lower scale_order and zero_order, or set cross to false"
    return FitError(
        f"the data cannot determine {'; '.join(faults)}: {len(temperature)} dwells at"
        f" {levels.size} distinct temperatures ({shown_levels} °C; order {order} needs"
        f" {order + 1}) in attitudes of which {affine_rank} are affinely"
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


def rank(design: Array) -> int:
    """Number of columns of a design [n, p] that are independent, each scaled to the same length."""
    length = np.linalg.norm(design, axis=0)
    singular = np.linalg.svd(design / np.where(length > 0.0, length, 1.0), compute_uv=False)
    return int(np.sum(singular > WEAK * singular[0])) if singular[0] > 0.0 else 0
