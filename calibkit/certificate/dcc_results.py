"""Results of a certificate as quantities of D-SI: values with U, lists over temperature, parameters
with their covariance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from calibkit.certificate import dcc_xml as xml, names
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import node
from calibkit.certificate.results import GridTable, ListTable
from calibkit.certificate.words import AS_FOUND, AS_LEFT, HEADINGS, Words, unit_mark
from calibkit.errors import OutputError
from calibkit.numeric import gum

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lxml.etree import _Element

    from calibkit.certificate.dcc_units import DccUnit
    from calibkit.certificate.dcc_xml import Notation
    from calibkit.certificate.results import Result, Uncertainty
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


def tabulate_results(table: ListTable | GridTable, notation: Notation) -> _Element | None:
    """A table as one result: single quantities, and a column of one unit as one list of values;
    None for an empty table.
    """
    if isinstance(table, ListTable):
        heads, columns = [table.title], [table.results]
    else:
        heads = list(table.heads)
        columns = [tuple(filter(None, column)) for column in zip(*table.cells, strict=True)]
    if not any(columns):
        return None
    ratio = notation.gravity is None and any(dsi(r.unit).gravity for c in columns for r in c)
    notes = [*([table.note] if table.note else []), *([RATIO] if ratio else [])]
    elements: list[_Element] = []
    for head, column in zip(heads, columns, strict=True):
        certain = tuple(r for r in column if not r.by_definition)
        series = len(certain) > 1 and _uniform(certain)
        elements += [_quantity(r, notation) for r in column if r.by_definition or not series]
        if series:
            elements.append(_series(certain, head, notation))
    return notation.named(
        "dcc:result",
        table.title,
        notation.rich("dcc:description", notes),
        node("dcc:data", node("dcc:list", *elements)),
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
        uncertainty = _coverage_interval(u, result.interval, unit.factor)
    elif u is not None:
        uncertainty = _expanded_uncertainty(
            u.expanded_uncertainty * unit.factor, u.coverage_factor, u.probability
        )
    conditions = [influence(*condition, notation) for condition in result.at]
    facts = _scope((result,), notation)
    if unit.text == r"\one" and dsi(result.unit).gravity:
        facts.append(
            node(
                "dcc:metaData",
                node("dcc:nonSIDefinition", "local gravity at the place of calibration"),
                node("dcc:nonSIUnit", "g"),
            )
        )
    return notation.named(
        "dcc:quantity",
        name,
        _real(result.value, unit, result.key, uncertainty),
        node("dcc:influenceConditions", *conditions) if conditions else None,
        node("dcc:measurementMetaData", *facts) if facts else None,
        refType=MEASURED,
    )


def _scope(results: Sequence[Result], notation: Notation) -> list[_Element]:
    """Whether results are in the scope of the accreditation; nothing without one."""
    if not notation.accredited:
        return []
    inside = " ".join(str(not result.outside_scope).lower() for result in results)
    name = "dcc:valid" if len(results) == 1 else "dcc:validXMLList"
    return [node("dcc:metaData", node(name, inside), refType="basic_isInCMC")]


def typed(tag: str, value: float, unit: str, notation: Notation, types: str) -> _Element:
    """A number as a quantity of types."""
    return node(tag, _real(value, notation.unit(unit)), refType=types)


def influence(name: str, value: float, unit: str, notation: Notation, u: float = 0.0) -> _Element:
    """An influence condition that is a number, with its standard uncertainty."""
    dcc_unit, uncertainty = notation.unit(unit), None
    if u > 0.0:
        u_element = node("si:valueStandardMU", _format_number(u * dcc_unit.factor))
        uncertainty = node("si:measurementUncertaintyUnivariate", node("si:standardMU", u_element))
    quantity = node("dcc:quantity", _real(value, dcc_unit, uncertainty=uncertainty))
    return notation.named(
        "dcc:influenceCondition", names.name_condition(name), node("dcc:data", quantity)
    )


def _series(column: Sequence[Result], head: Words, notation: Notation) -> _Element:
    """A column over its conditions: the conditions as lists of their own, then values with expanded
    uncertainties.
    """
    first, unit, count = column[0], notation.unit(column[0].unit), len(column)
    conditions = [
        notation.named(
            "dcc:quantity",
            names.name_condition(condition),
            _real_list([r.at[k][1] for r in column], [notation.unit(condition_unit)] * count),
            refType=f"basic_tableIndex{k}",
        )
        for k, (condition, _, condition_unit) in enumerate(first.at)
    ]
    uncertainties = [r.uncertainty for r in column if r.uncertainty is not None]
    values = _real_list(
        [r.value for r in column],
        [unit] * count,
        [r.key for r in column],
        _expanded_uncertainties(uncertainties, unit.factor),
    )
    name = first.name if first.name.en else head
    facts = _scope(column, notation)
    scope = node("dcc:measurementMetaData", *facts) if facts else None
    quantity = notation.named("dcc:quantity", name, values, scope, refType=MEASURED)
    kind = f"basic_{len(conditions)}IndexTable"
    return notation.named("dcc:list", head, *conditions, quantity, refType=kind)


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
    values = _real_list(
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


def _covariance(model: Model, units: Sequence[DccUnit]) -> _Element:
    """Covariance of all parameters of a model, column by column, with the factor of its region.

    One triangle is written twice: in raw units the other differs by rounding, up to 2e-9 of the
    standard uncertainties.
    """
    columns = []
    for j, second in enumerate(units):
        column = []
        for i, first in enumerate(units):
            covariance = model.covariance[max(i, j)][min(i, j)] * first.factor * second.factor
            value = node("si:valueXMLList", _format_number(covariance))
            unit = node("si:unitXMLList", (first * second).text)
            column.append(node("si:covarianceXMLList", value, unit))
        columns.append(node("si:columnXMLList", *column))
    factor = _format_factor(_region_factor(len(units), min(map(model.dof_of, model.coefficients))))
    return node(
        "si:measurementUncertaintyMultivariateXMLList",
        node(
            "si:ellipsoidalRegionMUXMLList",
            node("si:covarianceMatrixXMLList", *columns),
            node("si:coverageFactorXMLList", factor),
            node("si:coverageProbabilityXMLList", _format_probability(REGION)),
        ),
    )


def _region_factor(parameters: int, dof: float) -> float:
    """Factor of the ellipsoid that holds all parameters at once with 95 %: √(n·F) (JCGM 102,
    6.5).
    """
    from scipy.special import fdtri

    return math.sqrt(parameters * float(fdtri(parameters, max(dof, 1.0), REGION)))


def as_found_as_left(validation: AsFoundAsLeft | None, notation: Notation) -> _Element:
    """As-found and as-left results of a validation, descriptors but for those that state an
    uncertainty.
    """
    rows = () if validation is None else (*validation.rows, *validation.check_points)
    before = [(row, row.as_found, None) for row in rows if row.as_found is not None]
    after = [
        (row, row.as_left, (row.left_u, row.left_k) if row.left_u and row.left_k else None)
        for row in rows
        if row.as_left is not None
    ]
    results = [
        notation.named(
            "dcc:result",
            head,
            node(
                "dcc:data",
                *(_validated(*row, notation) for row in state_rows),
                None if state_rows else notation.text("dcc:text", xml.NOT_STATED),
            ),
            refType=kind,
        )
        for head, state_rows, kind in (
            (AS_FOUND, before, "calibkit_asFound"),
            (AS_LEFT, after, "calibkit_asLeft"),
        )
    ]
    return notation.named(
        "dcc:measurementResult", HEADINGS["as_found"], node("dcc:results", *results)
    )


def _validated(
    row: BeforeAfter, value: float, expanded: tuple[float, float] | None, notation: Notation
) -> _Element:
    """One value of a validation, with its expanded uncertainty and coverage factor where it has
    them.
    """
    unit, uncertainty = notation.unit(row.unit), None
    if expanded is not None:
        uncertainty = _expanded_uncertainty(expanded[0] * unit.factor, expanded[1], gum.TWO_SIGMA)
    return notation.named(
        "dcc:quantity",
        (Words(f"{row.log}: ") if row.log else Words("")) + row.quantity,
        _real(value, unit, uncertainty=uncertainty),
        refType=MEASURED,
    )


def _format_number(value: float) -> str:
    """A decimal number with all its digits and a decimal point."""
    if not math.isfinite(value):
        raise OutputError(
            f"{value} is no number that a certificate can state", hint="this is a bug"
        )
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"


def _format_factor(value: float) -> str:
    """A coverage factor: at least 1, without an exponent."""
    return f"{max(value, 1.0):.12f}".rstrip("0").ljust(3, "0")


def _format_probability(value: float) -> str:
    """A coverage probability: 0 to 1, without an exponent."""
    return f"{value:.12f}".rstrip("0").ljust(3, "0")


def _label(key: str) -> str:
    """A key as an item of an XML list, which blanks would split."""
    return xml.one_line(key).replace(" ", "_")


def _real(
    value: float, unit: DccUnit, key: str = "", uncertainty: _Element | None = None
) -> _Element:
    """`si:real` of a value, converted to its D-SI unit, with its uncertainty."""
    return node(
        "si:real",
        node("si:label", xml.one_line(key)) if key else None,
        node("si:value", _format_number(value * unit.factor)),
        node("si:unit", unit.text),
        uncertainty,
    )


def _real_list(
    values: Iterable[float],
    units: Sequence[DccUnit],
    keys: Sequence[str] = (),
    uncertainty: _Element | None = None,
) -> _Element:
    """`si:realListXMLList` of values, each converted to its D-SI unit, with their uncertainty."""
    scaled = [
        _format_number(value * unit.factor) for value, unit in zip(values, units, strict=True)
    ]
    texts = [unit.text for unit in units]
    return node(
        "si:realListXMLList",
        node("si:labelXMLList", " ".join(map(_label, keys))) if keys else None,
        node("si:valueXMLList", " ".join(scaled)),
        node("si:unitXMLList", " ".join(texts[:1] if len({*texts}) == 1 else texts)),
        uncertainty,
    )


def _expanded_uncertainty(U: float, coverage_factor: float, coverage: float) -> _Element:
    """Expanded uncertainty of one value with its coverage factor and probability."""
    return node(
        "si:measurementUncertaintyUnivariate",
        node(
            "si:expandedMU",
            node("si:valueExpandedMU", _format_number(U)),
            node("si:coverageFactor", _format_factor(coverage_factor)),
            node("si:coverageProbability", _format_probability(coverage)),
        ),
    )


def _coverage_interval(
    uncertainty: Uncertainty, ends: tuple[float, float], scale: float
) -> _Element:
    """Coverage interval of one value."""
    return node(
        "si:measurementUncertaintyUnivariate",
        node(
            "si:coverageIntervalMU",
            node("si:valueStandardMU", _format_number(uncertainty.standard_uncertainty * scale)),
            node("si:intervalMin", _format_number(ends[0] * scale)),
            node("si:intervalMax", _format_number(ends[1] * scale)),
            node("si:coverageProbability", _format_probability(uncertainty.probability)),
        ),
    )


def _expanded_uncertainties(uncertainties: Sequence[Uncertainty], scale: float) -> _Element:
    """Expanded uncertainties of a list of values."""
    columns = {
        "si:valueExpandedMUXMLList": [
            _format_number(u.expanded_uncertainty * scale) for u in uncertainties
        ],
        "si:coverageFactorXMLList": [_format_factor(u.coverage_factor) for u in uncertainties],
        "si:coverageProbabilityXMLList": [
            _format_probability(u.probability) for u in uncertainties
        ],
    }
    return node(
        "si:measurementUncertaintyUnivariateXMLList",
        node(
            "si:expandedMUXMLList",
            *(node(name, " ".join(column)) for name, column in columns.items()),
        ),
    )
