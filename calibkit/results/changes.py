"""Changes of results between two runs: their uncertainties, and how large the largest of several is
where nothing changed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.certificate.quantities import At, Point, Quantity
from calibkit.certificate.results import Contribution, Result
from calibkit.numeric import gum

STATED = ("quantity", "standard_uncertainty", "unit", "distribution", "dof")
"""What two runs state of a type B term of the same equipment."""
DRAWS = 4000
"""Draws of the coverage factor of the largest change."""


@dataclass(frozen=True, slots=True)
class Change:
    """A result at one point, then and now: the difference and its uncertainty (None: not known)."""

    at: At
    then: Result
    now: Result
    u: float | None
    expanded: float | None

    @property
    def difference(self) -> float:
        """Now less then."""
        return self.now.value - self.then.value


def contributions(found: Result) -> tuple[Contribution, ...]:
    """Contributions to the uncertainty of a result."""
    return () if found.uncertainty is None else found.uncertainty.contributions


def combine_both(then: Result, now: Result, *, same: bool) -> Iterator[gum.Component]:
    """Contributions to the uncertainty of the difference: of both runs as independent; type B terms
    that they state alike once, by the difference of their sensitivities, where the equipment is
    the same.
    """
    shared = {one.name.en: one for one in contributions(then) if one.kind == "B"}
    for part in contributions(now):
        other = shared.get(part.name.en)
        alike = (
            same
            and other is not None
            and all(getattr(part, fact) == getattr(other, fact) for fact in STATED)
        )
        taken = shared.pop(part.name.en).sensitivity if alike else 0.0
        yield _component(part, part.sensitivity - taken)
    for part in contributions(then):
        if part.kind == "A" or part.name.en in shared:
            yield _component(part, part.sensitivity)


def _component(part: Contribution, sensitivity: float) -> gum.Component:
    """A contribution as an independent input."""
    return gum.Component(
        part.name.en,
        0.0,
        part.standard_uncertainty,
        "A" if part.kind == "A" else "B",
        sensitivity,
        part.dof,
    )


def factor_of_largest(quantity: Quantity, earlier: Quantity, changes: Sequence[Change]) -> float:
    """Coverage factor of the largest of several changes, by simulation: what errors of the
    coefficients and type B terms have in common from point to point counts once, model errors are
    taken as independent.
    """
    loadings = [
        _load(earlier.point(earlier.complete(one.at)), one.then, "then")
        | _load(quantity.point(one.at), one.now, "now")
        for one in changes
    ]
    keys = list(dict.fromkeys(key for row in loadings for key in row))
    matrix = np.array([[row.get(key, 0.0) for key in keys] for row in loadings])
    own = np.array([sum(u**2 for u in _further(quantity, earlier, one)) for one in changes])
    size = np.sqrt((matrix**2).sum(axis=1) + own)
    held = size > 0.0
    draw = np.random.default_rng(0).standard_normal
    z = draw((DRAWS, len(keys))) @ (matrix[held] / size[held, None]).T
    z += draw(z.shape) * np.sqrt(own[held]) / size[held]
    widest = max((one.expanded or 0.0) / one.u for one in changes if one.u)
    largest = np.abs(z).max(axis=1)
    return float(np.quantile(largest, gum.TWO_SIGMA)) * max(widest / 2.0, 1.0)


def _load(point: Point, found: Result, when: str) -> dict[tuple[str, str, int], float]:
    """Change of a result by one standard uncertainty of each independent direction of its
    coefficients, and of each type B term.
    """
    made: dict[tuple[str, str, int], float] = {}
    for model, weights in point.parts:
        along = gum.square_root(np.array(model.covariance)).T @ weights
        made |= {(when, model.name, k): float(x) for k, x in enumerate(along)}
    for part in contributions(found):
        if part.kind == "B":
            made[when, part.name.en, -1] = part.sensitivity * part.standard_uncertainty
    return made


def _further(quantity: Quantity, earlier: Quantity, one: Change) -> Iterator[float]:
    """Uncertainties of both results that belong to no coefficient."""
    points = quantity.point(one.at), earlier.point(earlier.complete(one.at))
    yield from (u for point in points for _, u, _ in point.more)
