"""Models of coefficient files → results: a weighted sum of coefficients with the uncertainty that
the covariance gives it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from calibkit.arrays import Array
from calibkit.certificate.accreditation import Scope
from calibkit.certificate.names import name_condition, name_model
from calibkit.certificate.results import GridTable, ListTable, Result, Uncertainty
from calibkit.certificate.uncertainty import TYPE_A, Influences, Part, Source
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Figure, Model, Record
from calibkit.numeric import gum
from calibkit.sensitivities import Kind, Sensitivity

TRIALS = 20_000
"""Trials of the Monte Carlo intervals, one at each of as many equal probabilities."""

TEMPERATURE = "temp_case_degc"
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0, 20.0, 25.0)
MOST_TEMPERATURES = 8
"""Temperatures that values are stated at where the profile names none."""
COEFFICIENTS = Words("Coefficients", "系数")
COEFFICIENT_NOTE = Words(
    "Rounded values cannot be recombined: their uncertainties are correlated. Compute with the"
    " attached file.",
    "系数之间相关，修约后的数值不可重新组合计算；计算请使用所附文件。",
)


@dataclass(frozen=True, slots=True)
class Stated:
    """What every layout needs: the files, the type B terms, the temperatures, the recipe's
    reference temperature.
    """

    records: Mapping[str, Record]
    source: Source
    temperatures: tuple[float, ...]
    reference_degc: float
    sensitivities: tuple[Sensitivity, ...] = ()
    """Of the run's coefficients and figures to errors of its inputs."""
    scope: Scope = field(default_factory=Scope)
    """Of the laboratory's accreditation."""

    def influences(self, weights: Mapping[str, float]) -> dict[tuple[str, Kind], float]:
        """Derivatives of Σ w_i of coefficients and figures by errors of the inputs; weights by the
        names of `Sensitivity`.
        """
        return {
            (one.input, one.kind): total
            for one in self.sensitivities
            if (total := sum(w * one.derivatives.get(key, 0.0) for key, w in weights.items()))
        }

    def of_models(
        self, parts: Sequence[tuple[Model, Array]], record: Record | None = None
    ) -> tuple[dict[tuple[str, Kind], float], list[Part]]:
        """Derivatives by errors of the inputs of a result made of models with weights [p] of their
        coefficients, and these coefficients; of one record, or of any of the run's.
        """
        weights: dict[str, float] = {}
        found = []
        for model, row in parts:
            own = record or next(
                r for r in self.records.values() if any(m is model for m in r.models)
            )
            for c, w in zip(model.coefficients, row.tolist(), strict=True):
                if w:
                    names = _names(own, model, c.name)
                    weights[names[0]] = w
                    found.append(Part(names, c.value, c.unit, w))
        return self.influences(weights), found

    def knows(self, name: str) -> bool:
        """Whether the run states what an error of an input moves."""
        return any(one.input == name for one in self.sensitivities)

    def grid(self, model: Model, column: str = TEMPERATURE) -> tuple[float, ...]:
        """Temperatures [°C] inside a model's range: the profile's, else round ones and the
        reference.
        """
        if column not in model.valid:
            return ()
        low, high = model.valid[column]
        if self.temperatures and column == TEMPERATURE:
            return tuple(t for t in self.temperatures if low <= t <= high)
        found = set(_round_numbers(low, high))
        if column == TEMPERATURE and low <= self.reference_degc <= high:
            found.add(self.reference_degc)
        return tuple(sorted(found))

    def left_out(self, model: Model) -> tuple[Words, ...]:
        """Note on temperatures that the profile asks for and the model does not hold at."""
        low, high = model.valid.get(TEMPERATURE, (-math.inf, math.inf))
        outside = [f"{t:g} °C" for t in self.temperatures if not low <= t <= high]
        if not outside:
            return ()
        listed = ", ".join(outside)
        return (
            Words(
                f"Nothing is stated at {listed}: outside the calibrated range, {low:.1f} °C to"
                f" {high:.1f} °C.",
                f"{listed} 超出校准范围（{low:.1f} °C 至 {high:.1f} °C），不给出结果。",
            ),
        )

    def result(
        self,
        file: str,
        quantity: str,
        symbol: str,
        name: Words,
        value: float,
        unit: str,
        *,
        type_a: float,
        dof: float,
        called: Sequence[str] = (),
        influences: Influences | None = None,
        at: tuple[tuple[str, float, str], ...] = (),
        standard: str = "",
        magnitude: bool = False,
        principal: bool = False,
        condition: str = "",
        more: tuple[tuple[Words, float, float], ...] = (),
        parts_of: Sequence[Part] = (),
    ) -> Result:
        """Result with its expanded uncertainty; `called` are other names that type B terms may use,
        `more` is type A too.
        """
        plain = Result(
            *(quantity, file, symbol, name, value, unit),
            at=at,
            standard=standard,
            principal=principal,
            condition=condition,
        )
        fit = ((TYPE_A, type_a, dof), *more)
        found = self.source.uncertainty(
            (plain.key, *called), value, unit, fit, influences or {}, parts_of
        )
        raised = self.scope.raise_to_floor(replace(plain, uncertainty=found))
        if raised.uncertainty is None or not magnitude:
            return raised
        return replace(raised, interval=_magnitude_interval(value, raised.uncertainty))

    def linear(
        self,
        record: Record,
        model: Model,
        name: str,
        words: Words,
        weights: Mapping[str, float],
        unit: str,
        *,
        at: float | None = None,
        influences: Influences | None = None,
        symbol: str = "",
        principal: bool = False,
        condition: tuple[str, str] = (TEMPERATURE, "degC"),
        more: tuple[tuple[Words, float, float], ...] = (),
        also: Sequence[str] = (),
    ) -> Result:
        """Σ w_i c_i of a model's coefficients with u² = wᵀ C w, and what the run knows of its
        sensitivities; `influences` are further ones, `also` are further names of it.
        """
        w = np.array([weights.get(c.name, 0.0) for c in model.coefficients])
        value, type_a, dof = _weighted(model, w)
        known, parts_of = self.of_models(((model, w),), record)
        quantity = f"{record.stage}.{model.name}.{name}"
        return self.result(
            f"{record.stage}.json",
            quantity,
            symbol or name,
            words,
            value,
            unit,
            type_a=type_a,
            dof=dof,
            called=[one for own in (name, *also) for one in _names(record, model, own)],
            influences={**known, **(influences or {})},
            at=() if at is None else ((condition[0], at, condition[1]),),
            principal=principal,
            condition="" if at is None else f"{at:g}",
            more=more,
            parts_of=parts_of,
        )

    def figure(
        self,
        record: Record,
        figure: Figure,
        words: Words,
        dof: float,
        *,
        standard: str = "",
        magnitude: bool = False,
        principal: bool = False,
        influences: Influences | None = None,
    ) -> Result:
        """A figure of a coefficient file; one whose uncertainty was not determined is a
        descriptor.
        """
        quantity = f"{record.stage}.{figure.name}"
        return self.result(
            f"{record.stage}.json",
            quantity,
            "",
            words,
            figure.value,
            figure.unit,
            type_a=figure.standard_uncertainty,
            dof=figure.effective_dof or dof,
            called=(figure.name,),
            influences={**self.influences({quantity: 1.0}), **(influences or {})},
            standard=standard,
            magnitude=magnitude,
            principal=principal,
        )

    def coefficients(
        self,
        record: Record,
        model: Model,
        title: Words = COEFFICIENTS,
        more: Mapping[str, tuple[tuple[Words, float, float], ...]] = MappingProxyType({}),
        also: Mapping[str, Sequence[str]] = MappingProxyType({}),
    ) -> ListTable:
        """Every fitted coefficient of a model; `more` is further type A of some of them, `also`
        further names: a coefficient of power 0 is the value at 0.
        """
        results = tuple(
            self.linear(
                record,
                model,
                c.name,
                Words(""),
                {c.name: 1.0},
                c.unit,
                more=more.get(c.name, ()),
                also=also.get(c.name, ()),
            )
            for c in model.coefficients
            if c.value or c.standard_uncertainty
        )
        return ListTable(title, results, COEFFICIENT_NOTE)

    def over(
        self,
        title: Words,
        temperatures: Sequence[float],
        columns: Sequence[tuple[Words, str, Callable[[float], Result | None]]],
        *,
        row_head: Words | None = None,
        note: Words | None = None,
    ) -> GridTable:
        """Table of quantities (head, unit, function of temperature) at temperatures."""
        return GridTable(
            title,
            row_head or Words("T [°C]"),
            tuple(head for head, _, _ in columns),
            tuple(unit for _, unit, _ in columns),
            tuple(f"{t:g}" for t in temperatures),
            tuple(tuple(value(t) for _, _, value in columns) for t in temperatures),
            note,
        )


def _names(record: Record, model: Model, name: str) -> tuple[str, ...]:
    """Names that type B terms may call a result of a model by."""
    return f"{record.stage}.{model.name}.{name}", f"{model.name}.{name}", name


def _weighted(model: Model, w: Array) -> tuple[float, float, float]:
    """Σ w_i c_i of a model's coefficients by weights [p], its type A standard uncertainty from the
    covariance, and the degrees of freedom of that.
    """
    values = np.array([c.value for c in model.coefficients])
    dof = np.array([float(model.dof_of(c)) for c in model.coefficients])
    covariance = np.array(model.covariance)
    type_a = math.sqrt(max(float(w @ covariance @ w), 0.0))
    return float(w @ values), type_a, gum.degrees_of_freedom(w, covariance, dof)


def powers(
    prefix: str, model: Model, x: float, first: int = 0
) -> tuple[dict[str, float], dict[str, float]]:
    """Weights of prefix<first>, prefix<first + 1>, … as ascending powers of x, and their
    derivatives by x.
    """
    names = {c.name for c in model.coefficients}
    weights, slope, k = {}, {}, 0
    while f"{prefix}{first + k}" in names:
        weights[f"{prefix}{first + k}"] = x**k
        slope[f"{prefix}{first + k}"] = k * x ** (k - 1) if k else 0.0
        k += 1
    return weights, slope


def _round_numbers(low: float, high: float) -> list[float]:
    """At most eight round numbers from low to high."""
    scale = 10.0 ** math.floor(math.log10(max(high - low, 1e-12)) - 1.0)
    for step in (factor * scale for factor in STEPS):
        first, last = math.ceil(low / step), math.floor(high / step)
        if last - first < MOST_TEMPERATURES:
            return [min(max(k * step, low), high) for k in range(first, last + 1)]
    return []


QUANTITIES = {
    "temp_case_degc": (Words("case temperature", "壳温"), "°C"),
    "temp_rate_degc_min": (Words("temperature rate", "温变速率"), "°C/min"),
    "gradient_degc": (Words("temperature difference", "温差"), "K"),
    "gradient_rate_degc_min": (Words("rate of the temperature difference", "温差变化率"), "K/min"),
    "table_rate_dps": (Words("table rate", "转台角速率"), "°/s"),
}
"""Columns of ranges in words, with their units."""


def range_words(model: Model) -> Words:
    """Ranges that a model holds in."""
    parts, name = [], name_model(model.name)
    for column, ends in model.valid.items():
        words, unit = QUANTITIES.get(column, (name_condition(column), ""))
        low, high = (f"{end:.4g}".replace("-", "−") for end in ends)
        parts.append(words + Words(f" {low} … {high} {unit}".rstrip()))
    return Words(
        f"Model {name.en} holds for {'; '.join(part.en for part in parts)}.",
        f"模型 {name.zh or name.en} 适用范围：{'；'.join(part.zh or part.en for part in parts)}。",
    )


def residual_words(model: Model) -> Words:
    """What the fit left, called by its name."""
    rms = f"{model.residual_rms:.2g} {unit_mark(model.residual_unit)}".strip()
    name = name_model(model.name)
    return Words(
        f"Model {name.en}: residual rms of the fit {rms}, {model.dof}"
        " degrees of freedom (a descriptor, not an uncertainty).",
        f"模型 {name.zh or name.en}：拟合残差均方根 {rms}，自由度 {model.dof}（仅为描述量，"
        "并非不确定度）。",
    )


def _magnitude_interval(value: float, uncertainty: Uncertainty) -> tuple[float, float]:
    """95.45 % coverage interval of a quantity that cannot be negative: |value + u·t| by Monte Carlo
    (JCGM 101).
    """
    dof = uncertainty.effective_dof
    # as wide as U, which may be wider than these degrees of freedom make it
    size = uncertainty.expanded_uncertainty / gum.coverage_factor(dof)
    found = gum.monte_carlo(
        lambda drawn: np.abs(value + size * drawn[:, 0]),
        _draws(math.floor(dof) if dof < gum.FEW_DOF else 0),
        probability=gum.TWO_SIGMA,
    )
    return found.low, found.high


@lru_cache
def _draws(dof: int) -> Array:
    """Equally probable draws [trials, 1] of Student's distribution, of the normal one for 0: the
    same on every machine.
    """
    from scipy.special import ndtri, stdtrit

    probability = (np.arange(TRIALS) + 0.5) / TRIALS
    return np.asarray(stdtrit(dof, probability) if dof else ndtri(probability), dtype=np.float64)[
        :, None
    ]
