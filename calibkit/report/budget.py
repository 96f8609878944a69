"""Type B terms that name a coefficient or a figure of a run → its combined and expanded
uncertainty, beside its type A one.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from calibkit.numeric import gum
from calibkit.recipe import TypeB, type_b
from calibkit.records.coefficients import Coefficient, StageResult
from calibkit.report.table import number_or_none


def _iterate_results(
    results: Sequence[StageResult],
) -> Iterator[tuple[str, str, Coefficient, float]]:
    """Stage, full name, coefficient or figure, and type A degrees of freedom of everything that a
    run found.
    """
    for result in results:
        for model in result.models:
            for coefficient in model.coefficients:
                dof = float(max(model.dof_of(coefficient), 1))
                yield result.stage, f"{model.name}.{coefficient.name}", coefficient, dof
        for figure in result.figures:
            yield result.stage, figure.name, figure, figure.effective_dof or float("inf")


def name_results(results: Sequence[StageResult]) -> set[str]:
    """Names of all that a fit found: figures, and coefficients by themselves and as
    model.coefficient.
    """
    return {name for _, full, entry, _ in _iterate_results(results) for name in (full, entry.name)}


def combine_results(
    results: Sequence[StageResult],
    terms: Sequence[TypeB],
    stated_uncertainties: Iterable[Mapping[str, Any]],
) -> list[Mapping[str, Any]]:
    """Combined uncertainties that the procedure states itself, then one of every other coefficient
    and figure that a type B term names, as JSON objects.
    """
    combined = list(stated_uncertainties)
    already = {entry["result"] for entry in combined}
    for stage, name, entry, dof in _iterate_results(results):
        parts = [
            part
            for result_name in dict.fromkeys((name, entry.name))
            for part in type_b.terms_of(terms, result_name, entry.value)
        ]
        if parts and f"{stage}: {name}" not in already:
            type_a = gum.UncertaintyComponent(
                "type A", entry.value, entry.standard_uncertainty, "A", dof=dof
            )
            combined.append(combine(f"{stage}: {name}", entry.unit, [type_a, *parts]))
    return combined


def combine(
    result: str, unit: str, components: Sequence[gum.UncertaintyComponent]
) -> dict[str, Any]:
    """JSON object of a result: its value, which is that of its first component, components, u,
    effective degrees of freedom, k and U.
    """
    combined = gum.combine_cautiously(components)
    return {
        "result": result,
        "unit": unit,
        "value": components[0].estimate,
        "components": [
            {
                "name": part.name,
                "kind": part.kind,
                "standard_uncertainty": abs(part.sensitivity) * part.standard_uncertainty,
            }
            for part in components
        ],
        "standard_uncertainty": combined.standard_uncertainty,
        "effective_dof": number_or_none(combined.effective_dof),
        "coverage_factor": combined.coverage_factor,
        "expanded_uncertainty": combined.expanded_uncertainty,
        "probability": combined.probability,
    }
