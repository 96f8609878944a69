"""Results of a certificate as quantities of D-SI: values with U, lists over temperature, parameters
with their covariance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from calibkit.certificate import dcc_xml as xml
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import node
from calibkit.certificate.results import GridTable, ListTable
from calibkit.certificate.words import AS_FOUND, AS_LEFT, HEADINGS, Words, unit_mark
from calibkit.numeric import gum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml.etree import _Element

    from calibkit.certificate.dcc_units import Unit
    from calibkit.certificate.dcc_xml import Notation
    from calibkit.certificate.results import Result
    from calibkit.certificate.run_files import AsFoundAsLeft, BeforeAfter
    from calibkit.coefficients import Model

MEASURED = "basic_measuredValue"
REGION = 0.95
"""Coverage probability of the region that the covariance of parameters spans."""
PARAMETERS = Words(
    "All parameters of the model with their covariance: type A, from the fit alone. Type B"
    " contributions are in the expanded uncertainties of the other results.",
    "模型全部参数及其协方差（仅含拟合的 A 类分量）；B 类分量计入其他结果的扩展不确定度。",
)
RATIO = Words(
    "Accelerations are ratios to the local gravity, which was not stated.",
    "加速度以当地重力加速度的比值给出（未说明当地重力值）。",
)


def tabulate_results(shown: ListTable | GridTable, notation: Notation) -> _Element | None:
    """A table as one result: single quantities, and a column of one unit as one list of values;
    None for an empty table.
    """
    if isinstance(shown, ListTable):
        heads, columns = [shown.title], [shown.results]
    else:
        heads = list(shown.heads)
        columns = [tuple(filter(None, column)) for column in zip(*shown.cells, strict=True)]
    if not any(columns):
        return None
    ratio = notation.gravity is None and any(dsi(r.unit).gravity for c in columns for r in c)
    notes = [*([shown.note] if shown.note else []), *([RATIO] if ratio else [])]
    listed: list[_Element] = []
    for head, column in zip(heads, columns, strict=True):
        certain = tuple(r for r in column if not r.by_definition)
        series = len(certain) > 1 and _uniform(certain)
        listed += [_quantity(r, notation) for r in column if r.by_definition or not series]
        if series:
            listed.append(_series(certain, head, notation))
    return notation.named(
        "dcc:result",
        shown.title,
        notation.rich("dcc:description", notes),
        node("dcc:data", node("dcc:list", *listed)),
    )


def _uniform(column: Sequence[Result]) -> bool:
    """Whether results have one unit, an expanded uncertainty each, and are values of one quantity
    at conditions.
    """
    return (
        len({(r.quantity, r.unit, tuple(name for name, _, _ in r.at)) for r in column}) == 1
        and bool(column[0].at)
        and all(r.uncertainty is not None and r.interval is None for r in column)
    )


def _quantity(result: Result, notation: Notation) -> _Element:
    """One result with its uncertainty and the conditions that it holds at."""
    unit, u, uncertainty = notation.unit(result.unit), result.uncertainty, None
    name = result.name if result.name.en else Words(result.symbol or result.key)
    if result.standard:
        name += Words(f" ({result.standard})")
    if u is not None and result.interval is not None:
        uncertainty = xml.coverage_interval(u, result.interval, unit.factor)
    elif u is not None:
        uncertainty = xml.expanded_uncertainty(
            u.expanded_uncertainty * unit.factor, u.coverage_factor, u.probability
        )
    conditions = [influence(*condition, notation) for condition in result.at]
    gravity = None
    if unit.text == r"\one" and dsi(result.unit).gravity:
        gravity = node(
            "dcc:measurementMetaData",
            node(
                "dcc:metaData",
                node("dcc:nonSIDefinition", "local gravity at the place of calibration"),
                node("dcc:nonSIUnit", "g"),
            ),
        )
    return notation.named(
        "dcc:quantity",
        name,
        xml.real(result.value, unit, result.key, uncertainty),
        node("dcc:influenceConditions", *conditions) if conditions else None,
        gravity,
        refType=MEASURED,
    )


def influence(name: str, value: float, unit: str, notation: Notation, u: float = 0.0) -> _Element:
    """An influence condition that is a number, with its standard uncertainty."""
    found, uncertainty = notation.unit(unit), None
    if u > 0.0:
        stated = node("si:valueStandardMU", xml.format_number(u * found.factor))
        uncertainty = node("si:measurementUncertaintyUnivariate", node("si:standardMU", stated))
    shown = node("dcc:quantity", xml.real(value, found, uncertainty=uncertainty))
    return notation.named(
        "dcc:influenceCondition", Words(name.replace("_", " ")), node("dcc:data", shown)
    )


def _series(column: Sequence[Result], head: Words, notation: Notation) -> _Element:
    """A column over its conditions: the conditions as lists of their own, then values with expanded
    uncertainties.
    """
    first, unit, count = column[0], notation.unit(column[0].unit), len(column)
    conditions = [
        notation.named(
            "dcc:quantity",
            Words(condition.replace("_", " ")),
            xml.real_list([r.at[k][1] for r in column], [notation.unit(own)] * count),
        )
        for k, (condition, _, own) in enumerate(first.at)
    ]
    uncertainties = [r.uncertainty for r in column if r.uncertainty is not None]
    values = xml.real_list(
        [r.value for r in column],
        [unit] * count,
        [r.key for r in column],
        xml.expanded_uncertainties(uncertainties, unit.factor),
    )
    name = first.name if first.name.en else head
    quantity = notation.named("dcc:quantity", name, values, refType=MEASURED)
    return notation.named("dcc:list", head, *conditions, quantity)


def parameters(stage: str, model: Model, notation: Notation) -> _Element:
    """Every parameter of a model as it is in the coefficient file, with the covariance of the
    fit.
    """
    name = Words(f"{model.name}: parameters ({model.form})", f"{model.name}：参数（{model.form}）")
    rms = f"{model.residual_rms:.6g} {unit_mark(model.residual_unit)}"
    spread = Words(
        f"Residual rms of the fit {rms}, {model.dof} degrees of freedom: a descriptor, not an"
        " uncertainty.",
        f"拟合残差均方根 {rms}，自由度 {model.dof}（仅为描述量）。",
    )
    ranges = Words(
        "; ".join(f"{column}: {low!r} … {high!r}" for column, (low, high) in model.valid.items())
    )
    units = [notation.unit(c.unit) for c in model.coefficients]
    values = xml.real_list(
        [c.value for c in model.coefficients],
        units,
        [f"{stage}.{model.name}.{c.name}" for c in model.coefficients],
        _covariance(model, units),
    )
    return notation.named(
        "dcc:result",
        name,
        notation.rich("dcc:description", [PARAMETERS, spread, ranges]),
        node("dcc:data", node("dcc:quantity", values)),
    )


def _covariance(model: Model, units: Sequence[Unit]) -> _Element:
    """Covariance of all parameters of a model, column by column, with the factor of its region."""
    columns = [
        node(
            "si:columnXMLList",
            *(
                node(
                    "si:covarianceXMLList",
                    node(
                        "si:valueXMLList",
                        xml.format_number(model.covariance[i][j] * first.factor * second.factor),
                    ),
                    node("si:unitXMLList", (first * second).text),
                )
                for i, first in enumerate(units)
            ),
        )
        for j, second in enumerate(units)
    ]
    factor = xml.format_factor(_region_factor(len(units), model.dof))
    return node(
        "si:measurementUncertaintyMultivariateXMLList",
        node(
            "si:ellipsoidalRegionMUXMLList",
            node("si:covarianceMatrixXMLList", *columns),
            node("si:coverageFactorXMLList", factor),
            node("si:coverageProbabilityXMLList", xml.format_probability(REGION)),
        ),
    )


def _region_factor(parameters: int, dof: float) -> float:
    """Factor of the ellipsoid that holds all parameters at once with 95 %: √(n·F) (JCGM 102,
    6.5).
    """
    from scipy.special import fdtri

    return math.sqrt(parameters * float(fdtri(parameters, max(dof, 1.0), REGION)))


def as_found_as_left(found: AsFoundAsLeft | None, notation: Notation) -> _Element:
    """As-found and as-left results of a validation, descriptors but for those that state an
    uncertainty.
    """
    rows = () if found is None else (*found.rows, *found.check_points)
    before = [(row, row.found, None) for row in rows if row.found is not None]
    after = [(row, row.left, row.left_u) for row in rows if row.left is not None]
    results = [
        notation.named(
            "dcc:result",
            head,
            node(
                "dcc:data",
                *(_validated(*row, notation) for row in stated),
                None if stated else notation.text("dcc:text", xml.NOT_STATED),
            ),
        )
        for head, stated in ((AS_FOUND, before), (AS_LEFT, after))
    ]
    return notation.named(
        "dcc:measurementResult", HEADINGS["as_found"], node("dcc:results", *results)
    )


def _validated(row: BeforeAfter, value: float, U: float | None, notation: Notation) -> _Element:
    """One value of a validation, with its expanded uncertainty where it has one."""
    unit = notation.unit(row.unit)
    uncertainty = xml.expanded_uncertainty(U * unit.factor, 2.0, gum.TWO_SIGMA) if U else None
    return notation.named(
        "dcc:quantity",
        (Words(f"{row.log}: ") if row.log else Words("")) + row.what,
        xml.real(value, unit, uncertainty=uncertainty),
        refType=MEASURED,
    )
