"""Which coefficients the temperatures and attitudes of the dwells determine, and which further
dwells would determine the rest.

The rank is computed from the reference attitudes and temperatures, because the noise of the
indications gives any design matrix full rank; and from singular values, so that no grid of dwells
is assumed and temperature sweeps at a few attitudes are judged correctly.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.equation import AXES, Term, Terms
from calibkit.numeric import attitude
from calibkit.numeric.least_squares import fold, polynomial

TEMPERATURE_STEP_DEGC = 1.0
"""Temperatures closer than this [°C] count as one level."""
WEAK = 1e-3
"""Smallest singular value, relative to the largest after column scaling, that counts as determined;
it corresponds to 0.06° of attitude.
"""
TUMBLE_DEG = np.array(
    [[90.0, 0.0], [90.0, 90.0], [90.0, 180.0], [90.0, -90.0], [0.0, 0.0], [180.0, 0.0]]
)
"""Inclination and toolface [°] of the six-position tumble test, proposed first."""


def require_determined(
    terms: Terms, names: Sequence[str], reference: Array, temperature: Array, *, lower: str
) -> None:
    """Raise FitError where a coefficient is undetermined, stating which, why, and which dwells to
    add.

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
    half = half or 1.0
    t = (level - middle) / half
    axes, faults = [], []
    for axis, letter in enumerate(AXES):
        ranked = sorted(terms.of_axis(axis), key=lambda k: _importance(terms.listed[k]))
        axes.append([terms.listed[k] for k in ranked])
        dependent = _find_dependent(axes[axis], reference, t)
        undetermined = sorted(names[ranked[place]] for place in dependent)
        if undetermined:
            faults.append(f"accel_{letter}: {', '.join(undetermined)}")
    if not faults:
        return
    needed = terms.order + 1
    add = _propose_dwells(axes, reference, t, (_offered_levels(levels, needed) - middle) / half)
    add[:, 0] = middle + half * add[:, 0]
    shown = (
        ", ".join(f"{value:.4g}" for value in levels)
        if levels.size <= 6
        else f"{levels[0]:.4g} … {levels[-1]:.4g}"
    )
    raise FitError(
        f"the data cannot determine {'; '.join(faults)}: {len(temperature)} dwells at"
        f" {levels.size} distinct temperatures ({shown} °C; order {terms.order} needs {needed}) in"
        f" attitudes of which {affine_rank(reference)} are affinely independent (cross-axis terms"
        " need 4)",
        hint=f"add dwells at {_describe_dwells(add)}; or {lower}",
    )


def _importance(term: Term) -> tuple[int, int, int]:
    """Order of the coefficients of an axis, of which the later ones are called undetermined: low
    powers first, then the axis itself, its zero, the other axes in turn, and products.
    """
    turn = (term.factors[0] - term.axis) % 3 if term.kind == "c" else 0
    return term.power, "kzcn".index(term.kind), turn


def _design(listed: Sequence[Term], reference: Array, t: Array) -> Array:
    """Derivatives [n, p] of an axis of a triad without an error, but for their signs."""
    columns = [np.prod(reference[:, term.factors], axis=1) * t**term.power for term in listed]
    return np.column_stack(columns)


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


def _find_dependent(listed: Sequence[Term], reference: Array, t: Array) -> list[int]:
    """Places of the terms of an axis whose columns depend linearly on those before them."""
    design = fold.triangle(lambda rows: _design(listed, reference[rows], t[rows]), len(t))
    dependent: list[int] = []
    kept = np.zeros((design.shape[0], 0))
    for place, column in enumerate(design.T):
        wider = np.column_stack([kept, column])
        if _rank(wider) < wider.shape[1]:
            dependent.append(place)
        else:
            kept = wider
    return dependent


def _propose_dwells(
    axes: Sequence[Sequence[Term]], reference: Array, t: Array, offered: Array
) -> Array:
    """Further dwells [m, 3] (mapped temperature, inclination [°], toolface [°]) at offered mapped
    temperatures [k] that determine every coefficient of every axis; dwells proposed for one axis
    count for the next.
    """
    angle = np.tile(TUMBLE_DEG, (offered.size, 1))
    dwells = np.column_stack([np.repeat(offered, len(TUMBLE_DEG)), angle])
    vectors = attitude.gravity_vector(*angle.T)
    chosen: list[int] = []
    for listed in axes:
        choice = _design(listed, vectors, dwells[:, 0])
        rows = _design(
            listed,
            np.concatenate([reference, vectors[chosen]]),
            np.concatenate([t, dwells[chosen, 0]]),
        )
        length = np.linalg.norm(np.concatenate([rows, choice]), axis=0)
        choice = choice / length
        rows = np.asarray(np.linalg.qr(rows / length, mode="r"), dtype=np.float64)
        for _ in range(rows.shape[1]):
            _, singular, vt = np.linalg.svd(rows)
            padded = np.zeros(rows.shape[1])
            padded[: singular.size] = singular
            null = vt[padded <= WEAK * padded[0]]
            if not len(null):
                break
            # rounded, so that equally good dwells are taken in the order of the table everywhere
            gain = np.round(np.linalg.norm(choice @ null.T, axis=1), 9)
            chosen.append(int(np.argmax(gain)))
            rows = np.concatenate([rows, choice[chosen[-1:]]])
    return np.asarray(dwells[chosen], dtype=np.float64)


def _describe_dwells(dwells: Array) -> str:
    """Text of dwells [m, 3] (temperature [°C], inclination, toolface [°]) for an error message."""
    parts = []
    for level in np.unique(dwells[:, 0]):
        spots = [f"{tilt:g}°/{roll:g}°" for _, tilt, roll in dwells[dwells[:, 0] == level]]
        parts.append(f"{level:.4g} °C at inclination/toolface {', '.join(spots)}")
    return "; ".join(parts)


def _offered_levels(levels: Array, needed: int) -> Array:
    """Temperatures [°C] to propose: the levels of the data, and further levels in the widest gaps
    where there are fewer than needed.
    """
    offered = (
        np.array([levels[0] - 20.0, levels[0], levels[0] + 20.0]) if levels.size == 1 else levels
    )
    while offered.size < needed:
        gaps = np.diff(offered)
        widest = int(np.argmax(gaps))
        offered = np.insert(offered, widest + 1, offered[widest] + gaps[widest] / 2.0)
    return np.asarray(offered, dtype=np.float64)


def _rank(design: Array) -> int:
    length = np.linalg.norm(design, axis=0)
    singular = np.linalg.svd(design / np.where(length > 0.0, length, 1.0), compute_uv=False)
    return int(np.sum(singular > WEAK * singular[0])) if singular[0] > 0.0 else 0
