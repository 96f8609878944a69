"""Which coefficients the temperatures and attitudes of the dwells determine, and which further
dwells would determine the rest.

The rank is computed from the reference attitudes and temperatures, because the noise of the
indications gives any design matrix full rank; and from singular values, so that no grid of dwells
is assumed and temperature sweeps at a few attitudes are judged correctly.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
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


@dataclass(frozen=True, slots=True)
class Part:
    """Coefficients of one axis and their design matrix."""

    label: str
    """Name of the axis in error messages."""
    names: tuple[str, ...]
    """Names of the p coefficients, the most important first: of two that the data cannot separate,
    the later one is undetermined.
    """
    design: Callable[[Array, Array], Array]
    """Design matrix [n, p] from reference vectors [n, 3] and mapped temperatures [n]."""


def require_determined(
    parts: Sequence[Part],
    reference: Array,
    temperature: Array,
    *,
    order: int,
    lower: str,
) -> None:
    """Raise FitError where a coefficient is undetermined, stating which, why, and which dwells to
    add.

    Parameters
    ----------
    parts
        One per axis.
    reference
        [n, 3] [g].
    temperature
        [n] [°C].
    order
        Highest power of temperature that is asked for.
    lower
        What to ask less of, in the recipe's words.

    Raises
    ------
    FitError
        Naming the coefficients that cannot be separated from the ones before them in the order of
        importance.

    """
    levels, (middle, half), mapped = _mapped_levels(temperature)
    undetermined = {part.label: _undetermined(part, reference, mapped) for part in parts}
    if not any(undetermined.values()):
        return
    offered = (_offered_levels(levels, order + 1) - middle) / half
    add = _propose_dwells(parts, reference, mapped, offered)
    add[:, 0] = middle + half * add[:, 0]
    shown = (
        ", ".join(f"{value:.4g}" for value in levels)
        if levels.size <= 6
        else f"{levels[0]:.4g} … {levels[-1]:.4g}"
    )
    faults = "; ".join(
        f"{label}: {', '.join(sorted(names))}" for label, names in undetermined.items() if names
    )
    raise FitError(
        f"the data cannot determine {faults}: {len(temperature)} dwells at {levels.size} distinct"
        f" temperatures ({shown} °C; order {order} needs {order + 1}) in attitudes of which"
        f" {affine_rank(reference)} are affinely independent (cross-axis terms need 4)",
        hint=f"add dwells at {_describe_dwells(add)}; or {lower}",
    )


def _mapped_levels(temperature: Array) -> tuple[Array, tuple[float, float], Array]:
    """Distinct temperatures [k] [°C], their middle and half-width, and for each temperature [n] its
    level mapped to [−1, 1].
    """
    levels, level = distinct_temperatures(temperature)
    middle, half = polynomial.middle_and_half(levels)
    half = half or 1.0
    return levels, (middle, half), (level - middle) / half


def distinct_temperatures(
    temperature: Array, step: float = TEMPERATURE_STEP_DEGC
) -> tuple[Array, Array]:
    """Temperature levels [k] [°C] at least `step` apart, and the index [n] of the level that each
    temperature [n] belongs to.

    A level opens at the lowest temperature that is a step above the last one's opening, so a sweep
    counts as many levels as it has steps, and the scatter of a chamber about its set point counts
    as one.
    """
    ascending = np.sort(temperature)
    openings = [0]
    while (
        following := int(np.searchsorted(ascending, ascending[openings[-1]] + step))
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


def _undetermined(part: Part, reference: Array, mapped: Array) -> list[str]:
    """Names of the coefficients whose columns depend linearly on earlier columns."""
    design = fold.triangle(lambda rows: part.design(reference[rows], mapped[rows]), len(mapped))
    undetermined: list[str] = []
    kept = np.zeros((design.shape[0], 0))
    for name, column in zip(part.names, design.T, strict=True):
        wider = np.column_stack([kept, column])
        if _rank(wider) < wider.shape[1]:
            undetermined.append(name)
        else:
            kept = wider
    return undetermined


def _propose_dwells(
    parts: Sequence[Part], reference: Array, mapped: Array, offered: Array
) -> Array:
    """Further dwells [m, 3] (mapped temperature, inclination [°], toolface [°]) at offered mapped
    temperatures [k] that determine every column of every part; dwells proposed for one part count
    for the next.
    """
    angle = np.tile(TUMBLE_DEG, (offered.size, 1))
    dwells = np.column_stack([np.repeat(offered, len(TUMBLE_DEG)), angle])
    vectors = attitude.gravity_vector(*angle.T)
    chosen: list[int] = []
    for part in parts:
        choice = part.design(vectors, dwells[:, 0])
        rows = part.design(
            np.concatenate([reference, vectors[chosen]]),
            np.concatenate([mapped, dwells[chosen, 0]]),
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
