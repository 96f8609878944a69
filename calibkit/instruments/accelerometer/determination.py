"""Which coefficients the temperatures and attitudes of the dwells determine.

The rank is computed from the reference attitudes and temperatures, because the noise of the
indications gives any design matrix full rank; and from singular values, so that no grid of dwells
is assumed and temperature sweeps at a few attitudes are judged correctly.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.equation import AXES, Terms
from calibkit.numeric.least_squares import polynomial

TEMPERATURE_STEP_DEGC = 1.0
"""Temperatures closer than this [°C] count as one level."""
WEAK = 1e-3
"""Smallest singular value, relative to the largest after column scaling, that counts as determined;
it corresponds to 0.06° of attitude.
"""


def require_determined(
    terms: Terms, names: Sequence[str], reference: Array, temperature: Array, *, lower: str
) -> None:
    """Raise FitError where a coefficient is undetermined, stating which and why.

    Parameters
    ----------
    terms
        Coefficients that are asked for.
    names
        [p], what a message calls them.
    reference
        [n, 3] [g].
    temperature
        [n] [°C].
    lower
        What to ask less of, in the recipe's words.

    Raises
    ------
    FitError
        Naming the coefficients that cannot be separated from the ones before them in the order of
        importance.

    """
    if reference.size <= len(terms.listed):
        raise FitError(
            f"{len(reference)} dwells for {len(terms.listed)} parameters",
            hint="add dwells or lower the orders",
        )
    levels, level = distinct_temperatures(temperature)
    middle, half = polynomial.middle_and_half(levels)
    t = (level - middle) / (half or 1.0)
    faults = []
    for axis, letter in enumerate(AXES):
        # Of columns that depend on each other the later ones are called undetermined: low powers
        # stand first, then the axis itself, its zero, the other axes in turn, and products.
        ranked = []
        for place in terms.of_axis(axis):
            term = terms.listed[place]
            turn = (term.factors[0] - axis) % 3 if term.kind == "c" else 0
            ranked.append((term.power, "kzcn".index(term.kind), turn, place))
        places = [place for *_, place in sorted(ranked)]
        # derivatives of the axis of a triad without an error, but for their signs
        ranked_terms = [terms.listed[place] for place in places]
        columns = [np.prod(reference[:, q.factors], axis=1) * t**q.power for q in ranked_terms]
        design = np.asarray(np.linalg.qr(np.column_stack(columns), mode="r"))
        independent, undetermined = np.zeros((len(design), 0)), []
        for place, column in zip(places, design.T, strict=True):
            wider = np.column_stack([independent, column])
            if _rank(wider) < wider.shape[1]:
                undetermined.append(names[place])
            else:
                independent = wider
        if undetermined:
            faults.append(f"accel_{letter}: {', '.join(sorted(undetermined))}")
    if not faults:
        return
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
    raise FitError(
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
    while (
        following := int(
            np.searchsorted(ascending, ascending[openings[-1]] + TEMPERATURE_STEP_DEGC)
        )
    ) < ascending.size:
        openings.append(following)
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
