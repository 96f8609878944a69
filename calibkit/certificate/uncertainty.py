"""Uncertainty of each result: type A from the fit, type B from recipe and profile, combined after
the fit (JCGM 100).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

from calibkit import units
from calibkit.certificate.results import Contribution, Uncertainty
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.recipe import TypeB, type_b
from calibkit.records.sensitivities import Kind

Influences = Mapping[tuple[str, Kind], float]
"""Input and kind of its error → derivative of a result by it."""
TYPE_A = Words("fit to the logs")
"""Name of the type A contribution: the fit's covariance."""


@dataclass(frozen=True, slots=True)
class Part:
    """A coefficient that a result is made of: names that terms may call it by, value, unit, and its
    weight in the result.
    """

    names: tuple[str, ...]
    value: float
    unit: str
    weight: float


@dataclass(frozen=True, slots=True)
class TypeBTerms:
    """The type B terms of a certificate."""

    terms: tuple[TypeB, ...]

    @classmethod
    def merge(cls, recipe: Sequence[TypeB], profile: Sequence[TypeB]) -> Self:
        """Terms of both; of two with one name the profile's counts."""
        return cls(tuple({term.name: term for term in (*recipe, *profile)}.values()))

    def uncertainty(
        self,
        names: Sequence[str],
        estimate: float,
        unit: str,
        type_a: Sequence[tuple[Words, float, float]],
        influences: Influences,
        parts_of: Sequence[Part] = (),
    ) -> Uncertainty | None:
        """Combined and expanded uncertainty of a result, None where none is known.

        names are those a term may call the result by; parts_of are the coefficients that it is made
        of, through which terms on them enter; type_a holds names, standard uncertainties
        and degrees of freedom. Below one degree of freedom there is no coverage factor: a result
        with such a contribution is stated without an uncertainty, which it would make too small.
        """
        contributions = [
            Contribution(name, "A", "", u, "", "normal", dof) for name, u, dof in type_a if u > 0.0
        ]
        # one degree less a rounding error is one
        if any(part.dof < 1.0 - 1e-9 for part in contributions):
            return None
        contributions = [replace(part, dof=max(part.dof, 1.0)) for part in contributions]
        for term in self.terms:
            derivatives = _derivative(term, influences)
            if {term.quantity, term.result} & {*names, *derivatives}:
                contributions += _apply(term, names, estimate, unit, derivatives)
                continue
            for part in parts_of:
                if {term.quantity, term.result} & {*part.names}:
                    for entry in _apply(term, part.names, part.value, part.unit, {}):
                        through_part = part.weight * entry.sensitivity
                        contributions.append(replace(entry, sensitivity=through_part))
        return Uncertainty.of(contributions) if contributions else None


def _derivative(term: TypeB, influences: Influences) -> dict[str, tuple[float, float]]:
    """Derivative of a result by the quantity of a term, in the form of `type_b.terms_of`: by an
    error in proportion to the readings where the term is relative, else by one that is the same in
    all or that grows over their span, whichever moves the result more.
    """
    kinds: tuple[Kind, ...] = ("scale",) if term.unit in type_b.RELATIVE else ("offset", "span")
    keys = [(term.quantity, kind) for kind in kinds]
    derivatives = [influences[key] for key in keys if key in influences]
    return {term.quantity: (1.0, max(derivatives, key=abs))} if derivatives else {}


def _apply(
    stated_term: TypeB,
    names: Sequence[str],
    estimate: float,
    unit: str,
    sensitivities: Mapping[str, tuple[float, float]],
) -> list[Contribution]:
    """Contributions that a result has from a type B term."""
    result_unit = unit if stated_term.quantity in names else None
    term = _in_base(stated_term, result_unit)
    result_name = next((name for name in names if name in (term.quantity, term.result)), names[0])
    unit_of_part, share = _unit(term, result_unit), 1.0
    if term.quantity != result_name and term.sensitivity is None and term.unit in type_b.RELATIVE:
        # the derivative is by an error in proportion to the readings: the budget states it in ppm
        unit_of_part, share = term.unit, type_b.RELATIVE[term.unit]
    return [
        Contribution(
            Words.literal(part.name),
            part.kind,
            term.quantity,
            part.standard_uncertainty / share,
            unit_of_part,
            part.distribution,
            part.dof,
            part.sensitivity * share,
        )
        for part in type_b.terms_of((term,), result_name, estimate, sensitivities)
        if part.sensitivity
    ]


def _unit(term: TypeB, result_unit: str | None) -> str:
    """Unit that a component of the term is in: of a stated sensitivity the term's own, else the
    quantity's.
    """
    if term.sensitivity is not None:
        return term.unit
    return type_b.quantity_unit(term.quantity) or result_unit or units.column_unit(term.quantity)


def _in_base(term: TypeB, result_unit: str | None) -> TypeB:
    """The term in the unit of the result that it is stated of; RecipeError where the unit is of
    another dimension.
    """
    if (
        term.sensitivity is not None
        or term.unit in type_b.RELATIVE
        or type_b.quantity_unit(term.quantity) is not None
    ):
        return term
    target = result_unit or units.column_unit(term.quantity)
    if term.unit == target:
        return term
    if term.unit not in units.TABLE or target not in units.TABLE:
        raise RecipeError(
            f"[[type_b]] '{term.name}' is in '{term.unit}', {term.quantity} in '{target}'",
            hint="state it in the unit of the result, in ppm or in %",
        )
    factor = units.difference_factor(term.unit, target)
    uncertainty_keys = ("standard_uncertainty", "half_width", "expanded_uncertainty")
    scaled = {
        key: value * factor for key in uncertainty_keys if (value := getattr(term, key)) is not None
    }
    return term.model_copy(update={"unit": target, **scaled})
