"""Results of a certificate as quantities of D-SI: values with U, lists over temperature, parameters
with their covariance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from calibkit.certificate import dcc_xml as xml
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import add
from calibkit.certificate.results import GridTable, ListTable
from calibkit.certificate.words import AS_FOUND, AS_LEFT, HEADINGS, Words, unit_mark
from calibkit.numeric import gum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml.etree import _Element

    from calibkit.certificate.as_found import AsFoundAsLeft
    from calibkit.certificate.dcc_units import Unit
    from calibkit.certificate.dcc_xml import Notation
    from calibkit.certificate.results import Result
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


def table(parent: _Element, shown: ListTable | GridTable, notation: Notation) -> None:
    """A table as one result: a list of quantities, a column of one unit as one list of values."""
    if isinstance(shown, ListTable):
        heads, columns = [shown.title], [shown.results]
    else:
        heads = list(shown.heads)
        columns = [tuple(filter(None, column)) for column in zip(*shown.cells, strict=True)]
    if not any(columns):
        return
    made = xml.named(parent, "dcc:result", shown.title, notation.lang)
    ratio = notation.gravity is None and any(dsi(r.unit).gravity for c in columns for r in c)
    notes = [*([shown.note] if shown.note else []), *([RATIO] if ratio else [])]
    xml.rich(made, "dcc:description", notes, notation.lang)
    into = add(add(made, "dcc:data"), "dcc:list")
    for head, column in zip(heads, columns, strict=True):
        certain = tuple(r for r in column if not r.by_definition)
        listed = len(certain) > 1 and _uniform(certain)
        for result in column:
            if result.by_definition or not listed:
                _quantity(into, result, notation)
        if listed:
            _series(into, certain, head, notation)


def _uniform(column: Sequence[Result]) -> bool:
    """Whether results have one unit, an expanded uncertainty each, and are values of one quantity
    at conditions.
    """
    return (
        len({(r.quantity, r.unit, tuple(name for name, _, _ in r.at)) for r in column}) == 1
        and bool(column[0].at)
        and all(r.uncertainty is not None and r.interval is None for r in column)
    )


def _quantity(parent: _Element, result: Result, notation: Notation) -> None:
    """One result with its uncertainty and the conditions that it holds at."""
    unit, u = notation.unit(result.unit), result.uncertainty
    name = result.name if result.name.en else Words(result.symbol or result.key)
    if result.standard:
        name += Words(f" ({result.standard})")
    made = xml.named(parent, "dcc:quantity", name, notation.lang, refType=MEASURED)
    value = xml.real(made, result.value, unit, result.key)
    if u is not None and result.interval is not None:
        xml.interval(value, u, result.interval, unit.factor)
    elif u is not None:
        xml.expanded(value, u.expanded_uncertainty * unit.factor, u.coverage_factor, u.probability)
    if result.at:
        conditions = add(made, "dcc:influenceConditions")
        for condition in result.at:
            influence(conditions, *condition, notation)
    if unit.text == r"\one" and dsi(result.unit).gravity:
        meta = add(add(made, "dcc:measurementMetaData"), "dcc:metaData")
        add(meta, "dcc:nonSIDefinition", "local gravity at the place of calibration")
        add(meta, "dcc:nonSIUnit", "g")


def influence(
    parent: _Element, name: str, value: float, unit: str, notation: Notation, u: float = 0.0
) -> None:
    """An influence condition that is a number, with its standard uncertainty."""
    found = notation.unit(unit)
    made = xml.named(parent, "dcc:influenceCondition", Words(name.replace("_", " ")), notation.lang)
    shown = xml.real(add(add(made, "dcc:data"), "dcc:quantity"), value, found)
    if u > 0.0:
        standard = add(add(shown, "si:measurementUncertaintyUnivariate"), "si:standardMU")
        add(standard, "si:valueStandardMU", xml.number(u * found.factor))


def _series(parent: _Element, column: Sequence[Result], head: Words, notation: Notation) -> None:
    """A column over its conditions: the conditions as lists of their own, then values with expanded
    uncertainties.
    """
    first, lang, count = column[0], notation.lang, len(column)
    into = xml.named(parent, "dcc:list", head, lang)
    for k, (condition, _, unit) in enumerate(first.at):
        quantity = xml.named(into, "dcc:quantity", Words(condition.replace("_", " ")), lang)
        xml.real_list(quantity, [r.at[k][1] for r in column], [notation.unit(unit)] * count)
    name = first.name if first.name.en else head
    quantity = xml.named(into, "dcc:quantity", name, lang, refType=MEASURED)
    found = notation.unit(first.unit)
    values = xml.real_list(
        quantity, [r.value for r in column], [found] * count, [r.key for r in column]
    )
    uncertainties = [r.uncertainty for r in column if r.uncertainty is not None]
    xml.expanded_list(values, uncertainties, found.factor)


def parameters(parent: _Element, stage: str, model: Model, notation: Notation) -> None:
    """Every parameter of a model as it is in the coefficient file, with the covariance of the
    fit.
    """
    name = Words(f"{model.name}: parameters ({model.form})", f"{model.name}：参数（{model.form}）")
    made = xml.named(parent, "dcc:result", name, notation.lang)
    rms = f"{model.residual_rms:.6g} {unit_mark(model.residual_unit)}"
    spread = Words(
        f"Residual rms of the fit {rms}, {model.dof} degrees of freedom: a descriptor, not an"
        " uncertainty.",
        f"拟合残差均方根 {rms}，自由度 {model.dof}（仅为描述量）。",
    )
    ranges = Words(
        "; ".join(f"{column}: {low!r} … {high!r}" for column, (low, high) in model.valid.items())
    )
    xml.rich(made, "dcc:description", [PARAMETERS, spread, ranges], notation.lang)
    units = [notation.unit(c.unit) for c in model.coefficients]
    values = xml.real_list(
        add(add(made, "dcc:data"), "dcc:quantity"),
        [c.value for c in model.coefficients],
        units,
        [f"{stage}.{model.name}.{c.name}" for c in model.coefficients],
    )
    _covariance(values, model, units)


def _covariance(parent: _Element, model: Model, units: Sequence[Unit]) -> None:
    """Covariance of all parameters of a model, column by column, with the factor of its region."""
    region = add(
        add(parent, "si:measurementUncertaintyMultivariateXMLList"), "si:ellipsoidalRegionMUXMLList"
    )
    matrix = add(region, "si:covarianceMatrixXMLList")
    for j, second in enumerate(units):
        column = add(matrix, "si:columnXMLList")
        for i, first in enumerate(units):
            entry = add(column, "si:covarianceXMLList")
            covariance = model.covariance[i][j] * first.factor * second.factor
            add(entry, "si:valueXMLList", xml.number(covariance))
            add(entry, "si:unitXMLList", (first * second).text)
    add(region, "si:coverageFactorXMLList", xml.factor(_region_factor(len(units), model.dof)))
    add(region, "si:coverageProbabilityXMLList", xml.probability(REGION))


def _region_factor(parameters: int, dof: float) -> float:
    """Factor of the ellipsoid that holds all parameters at once with 95 %: √(n·F) (JCGM 102,
    6.5).
    """
    from scipy.special import fdtri

    return math.sqrt(parameters * float(fdtri(parameters, max(dof, 1.0), REGION)))


def as_found(parent: _Element, found: AsFoundAsLeft | None, notation: Notation) -> None:
    """As-found and as-left results of a validation, descriptors but for those that state an
    uncertainty.
    """
    lang = notation.lang
    made = xml.named(parent, "dcc:measurementResult", HEADINGS["as_found"], lang)
    results = add(made, "dcc:results")
    rows = () if found is None else (*found.rows, *found.check_points)
    before = [(row, row.found, None) for row in rows if row.found is not None]
    after = [(row, row.left, row.left_u) for row in rows if row.left is not None]
    for head, stated in ((AS_FOUND, before), (AS_LEFT, after)):
        data = add(xml.named(results, "dcc:result", head, lang), "dcc:data")
        if not stated:
            xml.text(data, "dcc:text", xml.NOT_STATED, lang)
        for row, value, U in stated:
            unit = notation.unit(row.unit)
            name = (Words(f"{row.log}: ") if row.log else Words("")) + row.what
            quantity = xml.named(data, "dcc:quantity", name, lang, refType=MEASURED)
            real = xml.real(quantity, value, unit)
            if U:
                xml.expanded(real, U * unit.factor, 2.0, gum.TWO_SIGMA)
