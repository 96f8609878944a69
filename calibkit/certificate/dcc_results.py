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
from calibkit.certificate.words import Words, unit_mark

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml.etree import _Element

    from calibkit.certificate.results import Result
    from calibkit.certificate.words import Lang
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


def table(
    parent: _Element, shown: ListTable | GridTable, gravity: float | None, lang: Lang
) -> None:
    """A table as one result: a list of quantities, a column of one unit as one list of values."""
    columns = [shown.results] if isinstance(shown, ListTable) else list(_columns(shown))
    if not any(columns):
        return
    made = add(parent, "dcc:result")
    xml.text(made, "dcc:name", shown.title, lang)
    found = [result for column in columns for result in column]
    xml.rich(
        made,
        "dcc:description",
        [*([shown.note] if shown.note else []), *_ratio(found, gravity)],
        lang,
    )
    into = add(add(made, "dcc:data"), "dcc:list")
    for k, column in enumerate(columns):
        certain = tuple(r for r in column if not r.by_definition)
        if len(certain) > 1 and _uniform(certain):
            for result in column:
                if result.by_definition:
                    real(into, result, gravity, lang)
            _series(
                into,
                certain,
                shown.heads[k] if isinstance(shown, GridTable) else shown.title,
                gravity,
                lang,
            )
        else:
            for result in column:
                real(into, result, gravity, lang)


def _columns(grid: GridTable) -> list[tuple[Result, ...]]:
    """Columns of a grid without what is absent."""
    return [
        tuple(cell for cell in column if cell is not None)
        for column in zip(*grid.cells, strict=True)
    ]


def _uniform(column: Sequence[Result]) -> bool:
    """Whether results have one unit, an expanded uncertainty each, and are values of one quantity
    at conditions.
    """
    kinds = {(r.key.partition("@")[0], r.unit, tuple(name for name, _, _ in r.at)) for r in column}
    return (
        len(kinds) == 1
        and bool(column[0].at)
        and all(r.uncertainty is not None and r.interval is None for r in column)
    )


def _ratio(results: Sequence[Result], gravity: float | None) -> tuple[Words, ...]:
    """Note that values in g are ratios, where they are."""
    return (RATIO,) if gravity is None and any(dsi(r.unit).gravity for r in results) else ()


def real(parent: _Element, result: Result, gravity: float | None, lang: Lang) -> None:
    """One result with its uncertainty and the conditions that it holds at."""
    unit = dsi(result.unit).at(gravity)
    made = add(parent, "dcc:quantity", refType=MEASURED)
    name = result.name if result.name.en else Words(result.symbol or result.key)
    xml.text(
        made, "dcc:name", name + Words(f" ({result.standard})") if result.standard else name, lang
    )
    value = add(made, "si:real")
    add(value, "si:label", xml.line(result.key))
    add(value, "si:value", xml.number(result.value * unit.factor))
    add(value, "si:unit", unit.text)
    if result.uncertainty is not None and result.interval is not None:
        xml.interval(value, result.uncertainty, result.interval, unit.factor)
    elif result.uncertainty is not None:
        xml.expanded(value, result.uncertainty, unit.factor)
    if result.at:
        conditions = add(made, "dcc:influenceConditions")
        for condition, number, of in result.at:
            influence(conditions, condition, number, of, gravity, lang)
    if unit.text == r"\one" and dsi(result.unit).gravity:
        meta = add(add(made, "dcc:measurementMetaData"), "dcc:metaData")
        add(meta, "dcc:nonSIDefinition", "local gravity at the place of calibration")
        add(meta, "dcc:nonSIUnit", "g")


def influence(
    parent: _Element,
    name: str,
    value: float,
    unit: str,
    gravity: float | None,
    lang: Lang,
    u: float = 0.0,
) -> None:
    """An influence condition that is a number."""
    found = dsi(unit).at(gravity)
    made = add(parent, "dcc:influenceCondition")
    xml.text(made, "dcc:name", Words(name.replace("_", " ")), lang)
    shown = add(add(add(made, "dcc:data"), "dcc:quantity"), "si:real")
    add(shown, "si:value", xml.number(value * found.factor))
    add(shown, "si:unit", found.text)
    if u > 0.0:
        standard = add(add(shown, "si:measurementUncertaintyUnivariate"), "si:standardMU")
        add(standard, "si:valueStandardMU", xml.number(u * found.factor))


def _series(
    parent: _Element, column: Sequence[Result], head: Words, gravity: float | None, lang: Lang
) -> None:
    """A column over its conditions: the conditions as lists of their own, then values with expanded
    uncertainties.
    """
    into = add(parent, "dcc:list")
    xml.text(into, "dcc:name", head, lang)
    for k, (name, _, of) in enumerate(column[0].at):
        numbers = [r.at[k][1] for r in column]
        quantity = add(into, "dcc:quantity")
        xml.text(quantity, "dcc:name", Words(name.replace("_", " ")), lang)
        _values(quantity, numbers, of, (), gravity)
    quantity = add(into, "dcc:quantity", refType=MEASURED)
    xml.text(quantity, "dcc:name", column[0].name if column[0].name.en else head, lang)
    values = _values(
        quantity, [r.value for r in column], column[0].unit, [r.key for r in column], gravity
    )
    scale = dsi(column[0].unit).at(gravity).factor
    xml.expanded_list(values, [r.uncertainty for r in column if r.uncertainty is not None], scale)


def _values(
    parent: _Element, values: Sequence[float], unit: str, keys: Sequence[str], gravity: float | None
) -> _Element:
    """`si:realListXMLList` of values of one unit."""
    found = dsi(unit).at(gravity)
    made = add(parent, "si:realListXMLList")
    if keys:
        add(made, "si:labelXMLList", " ".join(map(xml.label, keys)))
    add(made, "si:valueXMLList", " ".join(xml.number(value * found.factor) for value in values))
    add(made, "si:unitXMLList", " ".join([found.text] * len(values)))
    return made


def parameters(
    parent: _Element, stage: str, model: Model, gravity: float | None, lang: Lang
) -> None:
    """Every parameter of a model as it is in the coefficient file, with the covariance of the
    fit.
    """
    made = add(parent, "dcc:result")
    name = Words(f"{model.name}: parameters ({model.form})", f"{model.name}：参数（{model.form}）")
    xml.text(made, "dcc:name", name, lang)
    spread = Words(
        f"Residual rms of the fit {model.residual_rms:.6g} {unit_mark(model.residual_unit)}, "
        f"{model.dof} degrees of freedom: a descriptor, not an uncertainty.",
        f"拟合残差均方根 {model.residual_rms:.6g} {unit_mark(model.residual_unit)}，自由度"
        f" {model.dof}（仅为描述量）。",
    )
    ranges = Words(
        "; ".join(f"{column}: {low!r} … {high!r}" for column, (low, high) in model.valid.items())
    )
    xml.rich(made, "dcc:description", [PARAMETERS, spread, ranges], lang)
    units = [dsi(c.unit) for c in model.coefficients]
    at = [unit.at(gravity) for unit in units]
    quantity = add(add(made, "dcc:data"), "dcc:quantity")
    values = add(quantity, "si:realListXMLList")
    add(
        values,
        "si:labelXMLList",
        " ".join(xml.label(f"{stage}.{model.name}.{c.name}") for c in model.coefficients),
    )
    numbers = (
        xml.number(c.value * unit.factor) for c, unit in zip(model.coefficients, at, strict=True)
    )
    add(values, "si:valueXMLList", " ".join(numbers))
    add(values, "si:unitXMLList", " ".join(unit.text for unit in at))
    region = add(
        add(values, "si:measurementUncertaintyMultivariateXMLList"), "si:ellipsoidalRegionMUXMLList"
    )
    matrix = add(region, "si:covarianceMatrixXMLList")
    for j, second in enumerate(at):
        column = add(matrix, "si:columnXMLList")
        for i, first in enumerate(at):
            entry = add(column, "si:covarianceXMLList")
            add(
                entry,
                "si:valueXMLList",
                xml.number(model.covariance[i][j] * first.factor * second.factor),
            )
            add(entry, "si:unitXMLList", (first * second).text)
    add(region, "si:coverageFactorXMLList", xml.factor(region_factor(len(at), model.dof)))
    add(region, "si:coverageProbabilityXMLList", xml.probability(REGION))


def region_factor(parameters: int, dof: float) -> float:
    """Factor of the ellipsoid that holds all parameters at once with 95 %: √(n·F) (JCGM 102,
    6.5).
    """
    from scipy.special import fdtri

    return math.sqrt(parameters * float(fdtri(parameters, max(dof, 1.0), REGION)))
