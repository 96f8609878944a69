"""Type B terms: what a laboratory knows of its equipment from certificates and data sheets, in a
recipe or its own profile.

    [[type_b]]
    name = "case thermometer"
    quantity = "temp_case_degc"
    unit = "degC"
    half_width = 0.1

How a certificate uses them: `loads(run.document["type_b"])`, the profile's terms behind, then for
every printed result `terms_of(terms, result, …)` gives the components that stand beside its type A
one in `numeric.gum.combine`.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from calibkit import units
from calibkit.errors import CoefficientError, RecipeError, did_you_mean
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.recipe.strict import Positive, Table
from calibkit.records.frame import is_canonical

RELATIVE = {unit: units.SHARES[unit] for unit in ("ppm", "%")}
"""Units of an uncertainty that is a share of the quantity itself."""
SITE = {
    "latitude_deg": "deg",
    "gravity_mps2": "m/s^2",
    "input_axis_elevation_deg": "deg",
    "input_axis_azimuth_deg": "deg",
}
"""Influence quantities that are facts of the site, with the unit of their names."""
Words = Annotated[str, Field(min_length=1)]


class TypeB(Table):
    """One type B term: an influence quantity or a result, and how far it may be off (JCGM 100,
    4.3).

    `quantity` is a canonical column, a site value (latitude_deg, gravity_mps2), or a result by its
    name (a figure, a coefficient, or a column that the procedure gives). Exactly one of
    standard_uncertainty, half_width and expanded_uncertainty (with its coverage_factor) is stated,
    in `unit`: one of the quantity's dimension, or "ppm" or "%" of the quantity. `sensitivity` is
    what `result` changes by for one `unit`; without the two the procedure's own derivative is used,
    or 1 where the quantity is the result itself. Without `dof` the degrees of freedom are infinite.
    """

    #: Name on the certificate; a term of the profile replaces one of the recipe with the same
    #: name.
    name: Words
    #: Canonical column, site value, or result that may be off.
    quantity: Words
    #: Unit of the size below: one of the quantity's kind, or ppm or % of it.
    unit: Words
    #: Size as a standard uncertainty.
    standard_uncertainty: Positive | None = None
    #: Size as half the width of the distribution.
    half_width: Positive | None = None
    #: Size as an expanded uncertainty, with its coverage factor.
    expanded_uncertainty: Positive | None = None
    #: Coverage factor k of `expanded_uncertainty`.
    coverage_factor: Annotated[float, Field(ge=1.0)] | None = None
    #: Distribution; without it rectangular for a half width, else normal.
    distribution: Literal["normal", "rectangular", "triangular", "arcsine"] | None = None
    #: Degrees of freedom; infinite where not stated.
    dof: Positive | None = None
    #: Change of `result` for one `unit`; without it the procedure's own derivative.
    sensitivity: float | None = None
    #: Result that `sensitivity` is of.
    result: str = ""

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        # a result may have a unit that no log has, °/h/K say; it is compared with the result's own
        return units.ALIASES.get(unit, unit)

    @model_validator(mode="after")
    def _one_statement(self) -> Self:
        statements = [
            name
            for name in ("standard_uncertainty", "half_width", "expanded_uncertainty")
            if getattr(self, name) is not None
        ]
        if len(statements) != 1:
            statements_text = " and ".join(statements) or "none"
            raise ValueError(
                f"'{self.name}' states {statements_text}; state one of standard_uncertainty,"
                " half_width, expanded_uncertainty"
            )
        if (self.coverage_factor is None) == ("expanded_uncertainty" in statements):
            raise ValueError(
                f"'{self.name}': coverage_factor belongs to expanded_uncertainty, and to nothing"
                " else"
            )
        if "half_width" in statements and self.distribution == "normal":
            raise ValueError(
                f"'{self.name}': a normal distribution has no half_width; state the"
                " standard_uncertainty"
            )
        if "expanded_uncertainty" in statements and self.shape != "normal":
            raise ValueError(
                f"'{self.name}': an expanded_uncertainty with a coverage_factor is that of a"
                " normal one"
            )
        if bool(self.result) == (self.sensitivity is None):
            raise ValueError(
                f"'{self.name}': a sensitivity and the result that it leads to are stated together"
            )
        target = quantity_unit(self.quantity)
        if target is None or self.unit in RELATIVE:
            return self
        if self.quantity == "time_s":
            raise ValueError(
                f"'{self.name}' is in '{self.unit}', an error of the time base is a share of the"
                " time; state it in ppm or %"
            )
        try:
            units.difference_factor(self.unit, target)
        except RecipeError as error:
            raise ValueError(f"'{self.name}': {error}") from None
        return self

    @property
    def shape(self) -> Literal["normal", "rectangular", "triangular", "arcsine"]:
        """Distribution: as stated, else rectangular between limits and normal otherwise."""
        return self.distribution or ("rectangular" if self.half_width is not None else "normal")

    @property
    def u(self) -> float:
        """Standard uncertainty in the term's own unit: as stated, a/√3, a/√6, a/√2, or U/k (JCGM
        100, 4.3.3 to 4.3.9).
        """
        if self.half_width is not None:
            return float(self.half_width / gum.HALF_WIDTH[self.shape])
        if self.expanded_uncertainty is not None and self.coverage_factor is not None:
            return self.expanded_uncertainty / self.coverage_factor
        assert self.standard_uncertainty is not None  # noqa: S101 (narrows what the validator has made sure of)
        return self.standard_uncertainty

    def u_of(self, estimate: float) -> float:
        """Standard uncertainty in the base unit of the quantity (that of its column's name), at an
        estimate in that unit.
        """
        if self.unit in RELATIVE:
            return self.u * RELATIVE[self.unit] * abs(estimate)
        target = quantity_unit(self.quantity)
        return self.u if target is None else self.u * units.difference_factor(self.unit, target)

    def component(self, estimate: float, sensitivity: float) -> gum.UncertaintyComponent:
        """Component of a combination: the quantity's estimate in its base unit, sensitivity of the
        result to that unit.
        """
        dof = float("inf") if self.dof is None else self.dof
        return gum.UncertaintyComponent(
            self.name, estimate, self.u_of(estimate), "B", sensitivity, dof, self.shape
        )


def quantity_unit(quantity: str) -> str | None:
    """Unit of an influence quantity by its name: that of the column, or of the site value; None of
    any other result.
    """
    return SITE.get(quantity) or (units.column_unit(quantity) if is_canonical(quantity) else None)


THERMOMETER_STEP_DEGC = 0.05
"""Change of a temperature for the numerical derivative of a drift along a log."""


def enters(term: TypeB, result: str, thermometers: Collection[str]) -> bool:
    """Whether a term says something of a result along a log that depends on these thermometers."""
    if term.sensitivity is not None:
        return term.result == result
    return term.unit not in RELATIVE and (term.quantity == result or term.quantity in thermometers)


def effects_along(
    terms: Iterable[TypeB],
    result: str,
    rows: int,
    thermometers: Mapping[str, Callable[[float], Array]],
) -> list[tuple[str, Array, float]]:
    """Names of the terms that enter a result along a log, effects [rows] of one standard
    uncertainty on it, and degrees of freedom.

    Parameters
    ----------
    terms : from the recipe.
    result : column of the result, which a term may name as its quantity or as its `result`.
    rows : of the log.
    thermometers : column → result [rows] where that thermometer reads so much more [°C].

    """
    effects = []
    for term in terms:
        if not enters(term, result, thermometers):
            continue
        if term.sensitivity is not None:
            effect = np.full(rows, term.u * term.sensitivity)
        elif term.quantity in thermometers:
            shifted, step = thermometers[term.quantity], THERMOMETER_STEP_DEGC
            effect = (shifted(step) - shifted(-step)) / (2.0 * step) * term.u_of(0.0)
        else:
            effect = np.full(rows, term.u_of(0.0))
        effects.append((term.name, effect, float("inf") if term.dof is None else term.dof))
    return effects


def terms_of(
    terms: Sequence[TypeB],
    result: str,
    estimate: float,
    sensitivities: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[gum.UncertaintyComponent, ...]:
    """Components of one result; none of a term that says nothing of it.

    Parameters
    ----------
    terms : from the recipe and the laboratory's profile; two of one name are one effect, the later
        one counts.
    result : name of the result, which a term may name as its quantity (sensitivity 1) or as its
        `result`.
    estimate : of the result, in its own unit: what ppm and % of it are taken of.
    sensitivities : influence quantity → (its estimate, derivative of the result by it), in the unit
        of the quantity's name.

    """
    components = []
    for term in {term.name: term for term in terms}.values():
        quantity_estimate, derivative = (sensitivities or {}).get(term.quantity, (0.0, None))
        if term.quantity == result:
            components.append(term.component(estimate, 1.0))
        elif term.sensitivity is not None and term.result == result:
            dof = float("inf") if term.dof is None else term.dof
            components.append(
                gum.UncertaintyComponent(
                    term.name, quantity_estimate, term.u, "B", term.sensitivity, dof, term.shape
                )
            )
        elif derivative is not None and term.sensitivity is None:
            components.append(term.component(quantity_estimate, derivative))
    return tuple(components)


def combine_terms(
    terms: Sequence[TypeB],
    names: Sequence[str],
    estimate: float,
    unit: str,
    sensitivities: Mapping[str, tuple[float, float]] | None = None,
) -> float:
    """Type B standard uncertainty of a result in its unit; `names` are those that terms may call it
    by, the rest is that of `terms_of`.
    """
    variance = 0.0
    for term in {term.name: term for term in terms}.values():
        of_quantity = term.quantity in names
        result_name = next(
            (name for name in names if name in (term.quantity, term.result)), names[0]
        )
        # a result has no column that would state its unit
        needs_conversion = of_quantity and term.unit not in (*RELATIVE, unit)
        factor = units.difference_factor(term.unit, unit) if needs_conversion else 1.0
        for part in terms_of((term,), result_name, estimate, sensitivities):
            variance += (part.sensitivity * part.standard_uncertainty * factor) ** 2
    return float(np.sqrt(variance))


def require_known(terms: Iterable[TypeB], names: Iterable[str]) -> None:
    """Raise RecipeError for a term whose quantity or result is neither a canonical column, a site
    value nor one of the names: the results of a run and the columns that its recipe names.
    """
    valid_names = [*names, *SITE]
    for term in terms:
        for key, name in (("quantity", term.quantity), ("result", term.result)):
            if name and not is_canonical(name) and name not in valid_names:
                raise RecipeError(
                    f"[[type_b]] '{term.name}': {key} = '{name}' is no column and no result",
                    hint=did_you_mean(
                        name,
                        [*valid_names, "temp_case_degc", "temp_env_degc"],
                        "name a canonical column or a result of this run",
                    ),
                )


def dumps(terms: Sequence[TypeB]) -> list[dict[str, Any]]:
    """Terms as JSON objects, with what is stated and nothing else."""
    return [term.model_dump(exclude_none=True, exclude_defaults=True) for term in terms]


def loads(entries: Iterable[Mapping[str, Any]]) -> tuple[TypeB, ...]:
    """Terms of a run.json (`document.get("type_b", [])`); raises CoefficientError for one that is
    none.
    """
    try:
        return tuple(TypeB.model_validate(dict(entry)) for entry in entries)
    except ValidationError as error:
        raise CoefficientError(f"run.json: not a type B term: {error.errors()[0]['msg']}") from None
    except (TypeError, ValueError):
        raise CoefficientError("run.json: 'type_b' is no list of type B terms") from None
