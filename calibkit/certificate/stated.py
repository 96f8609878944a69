"""What the uncertainties of a run's results come from: its files, the type B terms, what errors of
inputs move; and at which conditions results are stated.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from calibkit import units
from calibkit.certificate.accreditation import Scope
from calibkit.certificate.names import name_condition, name_model
from calibkit.certificate.results import Uncertainty
from calibkit.certificate.uncertainty import Part, TypeBTerms
from calibkit.certificate.words import Words
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Model, Record
from calibkit.records.sensitivities import Kind, Sensitivity
from calibkit.units import unit_mark

TRIALS = 20_000
"""Trials of the Monte Carlo intervals, one at each of as many equal probabilities."""

TEMPERATURE = "temp_case_degc"
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0, 20.0, 25.0)
MOST_TEMPERATURES = 8
"""Temperatures that values are stated at where the profile names none."""


@dataclass(frozen=True, slots=True)
class Stated:
    """What every layout needs: the files, the type B terms, the temperatures, the recipe's
    reference temperature.
    """

    records: Mapping[str, Record]
    source: TypeBTerms
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
        influences = {}
        for sensitivity in self.sensitivities:
            derivatives = sensitivity.derivatives
            total = sum(w * derivatives.get(key, 0.0) for key, w in weights.items())
            if total:
                influences[sensitivity.input, sensitivity.error] = total
        return influences

    def of_models(
        self, parts: Sequence[tuple[Model, Array]]
    ) -> tuple[dict[tuple[str, Kind], float], list[Part]]:
        """Derivatives by errors of the inputs of a result made of models with weights [p] of their
        coefficients, and these coefficients.
        """
        weights: dict[str, float] = {}
        coefficients = []
        for model, row in parts:
            stage = next(
                record.stage
                for record in self.records.values()
                if any(entry is model for entry in record.models)
            )
            for c, weight in zip(model.coefficients, row.tolist(), strict=True):
                if weight:
                    names = f"{stage}.{model.name}.{c.name}", f"{model.name}.{c.name}", c.name
                    weights[names[0]] = weight
                    coefficients.append(Part(names, c.value, c.unit, weight))
        return self.influences(weights), coefficients

    def knows(self, name: str) -> bool:
        """Whether the run states what an error of an input moves."""
        return any(entry.input == name for entry in self.sensitivities)

    def grid(self, column: str, low: float, high: float) -> tuple[float, ...]:
        """Values of an input inside its range, of temperatures the profile's, else round ones and
        the reference; none of an unlimited input.
        """
        if not math.isfinite(high - low):
            return ()
        if self.temperatures and column == TEMPERATURE:
            return tuple(t for t in self.temperatures if low <= t <= high)
        points = set(_round_numbers(low, high))
        if column == TEMPERATURE and low <= self.reference_degc <= high:
            points.add(self.reference_degc)
        return tuple(sorted(points))

    def left_out(self, model: Model) -> tuple[Words, ...]:
        """Note on temperatures that the profile asks for and the model does not hold at."""
        low, high = model.valid.get(TEMPERATURE, (-math.inf, math.inf))
        outside = [f"{t:g} °C" for t in self.temperatures if not low <= t <= high]
        if not outside:
            return ()
        temperatures = ", ".join(outside)
        return (
            Words(
                "Nothing is stated at {temperatures}: outside the calibrated range, {low:.1f} °C to"
                " {high:.1f} °C.",
                temperatures=temperatures,
                low=low,
                high=high,
            ),
        )


def _round_numbers(low: float, high: float) -> list[float]:
    """At most eight round numbers from low to high."""
    scale = 10.0 ** math.floor(math.log10(max(high - low, 1e-12)) - 1.0)
    for step in (factor * scale for factor in STEPS):
        first, last = math.ceil(low / step), math.floor(high / step)
        if last - first < MOST_TEMPERATURES:
            return [min(max(k * step, low), high) for k in range(first, last + 1)]
    return []


def input_unit(column: str) -> str:
    """Unit of an input; a gradient is a difference of temperatures."""
    degree = "K" if column.startswith("gradient") else "degC"
    if column.endswith("_degc_min"):
        return f"{degree}/min"
    return degree if column.endswith("_degc") else units.column_unit(column)


def range_words(model: Model) -> Words:
    """Ranges that a model holds in."""
    parts, name = [], name_model(model.name)
    for column, ends in model.valid.items():
        low, high = (f"{end:.4g}".replace("-", "−") for end in ends)
        unit = unit_mark(input_unit(column))
        parts.append(name_condition(column) + Words.literal(f" {low} … {high} {unit}".rstrip()))
    ranges = Words("; ").join(parts)
    return Words("Model {name} holds for {ranges}.", name=name, ranges=ranges)


def residual_words(model: Model) -> Words:
    """What the fit left, called by its name."""
    rms = f"{model.residual_rms:.2g} {unit_mark(model.residual_unit)}".strip()
    name = name_model(model.name)
    return Words(
        "Model {name}: residual rms of the fit {rms}, {dof} degrees of freedom (a descriptor,"
        " not an uncertainty).",
        name=name,
        rms=rms,
        dof=model.dof,
    )


def interval_of_magnitude(value: float, uncertainty: Uncertainty) -> tuple[float, float]:
    """95.45 % coverage interval of a quantity that cannot be negative: |value + u·t| by Monte Carlo
    (JCGM 101).
    """
    dof = uncertainty.effective_dof
    # as wide as U, which may be wider than these degrees of freedom make it
    size = uncertainty.expanded_uncertainty / gum.coverage_factor(dof)
    drawn = _draws(math.floor(dof) if dof < gum.FEW_DOF else 0)
    return gum.shortest_interval(np.abs(value + size * drawn), probability=gum.TWO_SIGMA)


@lru_cache
def _draws(dof: int) -> Array:
    """Equally probable draws [trials] of Student's distribution, of the normal one for 0: the
    same on every machine.
    """
    from scipy.special import ndtri, stdtrit

    probability = (np.arange(TRIALS) + 0.5) / TRIALS
    return np.asarray(stdtrit(dof, probability) if dof else ndtri(probability), dtype=np.float64)
