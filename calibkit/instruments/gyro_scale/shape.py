"""Response of a gyro over rate ↔ gyro-response/1 models: what bends the straight line, and its
inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Model, Parameter
from calibkit.errors import CoefficientError, FitError
from calibkit.instruments.gyro_scale.numeric import response as gyro_response
from calibkit.instruments.gyro_scale.runs import RATE
from calibkit.numeric.dispersion import rms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.numeric.response import Response
    from calibkit.instruments.gyro_scale.recipe import OwnAxisRecipe
    from calibkit.instruments.gyro_scale.runs import TableRun


GRID = 20001
"""Rates on which a response is turned around before one Newton step."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Response (F − F0)/K [°/s] over the rate [°/s], within the fitted rates."""

    names: tuple[str, ...]
    coefficients: tuple[float, ...]
    sine: bool
    limits: tuple[float, float]

    def at(self, rate: Array) -> Array:
        """Indicated rate [n] at rates [n]."""
        if self.sine:
            zero, slope, scale = self.coefficients
            return np.asarray(zero + slope * scale * np.sin(rate / scale))
        powers = [0 if name == "F0" else int(name[1:]) for name in self.names]
        return np.asarray(sum(c * rate**k for c, k in zip(self.coefficients, powers, strict=True)))

    def inverse(self, indicated: Array) -> Array:
        """Rates [n] of indicated rates [n]; beyond the fitted rates the correction of their end is
        held.
        """
        grid = np.linspace(*self.limits, GRID)
        curve = self.at(grid)
        if not (np.diff(curve) > 0.0).all():
            raise CoefficientError(
                "the response is not monotonic over its rates", hint="fit with response = 'line'"
            )
        rate = np.interp(indicated, curve, grid)
        step = 1e-4 * (self.limits[1] - self.limits[0])
        slope = (self.at(rate + step) - self.at(rate - step)) / (2.0 * step)
        inside = rate - (self.at(rate) - indicated) / slope
        outside = rate + (indicated - np.clip(indicated, curve[0], curve[-1]))
        return np.where((indicated >= curve[0]) & (indicated <= curve[-1]), inside, outside)


def choose(spec: OwnAxisRecipe, runs: Sequence[tuple[TableRun, str]]) -> Response | None:
    """Response over rate, (F − F0)/K [°/s] against the table rate, of runs together: chosen by
    leave-one-rate-out error.

    None where the recipe asks for the line alone, or the line is the best.
    """
    if spec.response == "line":
        return None
    rate = np.concatenate([run.plateaus.rate_dps for run, _ in runs])
    lines = [run.scale(gyro) for run, gyro in runs]
    indicated = np.concatenate([(line.indication - line.F0) / line.K for line in lines])
    # runs repeat their rates: a rate is left out only when it is left out of all of them
    group = np.round(rate, 3)
    levels = [group == level for level in np.unique(group)]
    means = [np.array([x[level].mean() for level in levels]) for x in (rate, indicated)]
    try:
        chosen, _ = gyro_response.choose(*means)
    except FitError:
        return None
    return None if chosen.form == "odd-polynomial" and chosen.order == 1 else chosen


def model(name: str, response: Response, run: TableRun) -> Model:
    """gyro-response/1 model: indicated rate over table rate, an odd polynomial or the sine of an
    open-loop gyro.
    """
    u = np.sqrt(np.diag(response.covariance))
    sine, rate = response.form == "sine", run.plateaus.rate_dps
    units = (
        ("deg/s", "1", "deg/s")
        if sine
        else ("deg/s", *("1" if k == 1 else f"1/(deg/s)^{k - 1}" for k in _powers(response)))
    )
    return Model(
        name=name,
        form="gyro-response/1",
        coefficients=tuple(
            Coefficient(letter, float(value), unit, float(error))
            for letter, value, unit, error in zip(
                response.names, response.coefficients, units, u, strict=True
            )
        ),
        covariance=tuple(map(tuple, response.covariance.tolist())),
        dof=response.dof,
        residual_rms=rms(response.residuals),
        residual_unit="deg/s",
        valid={RATE: (float(rate.min()), float(rate.max()))},
        parameters=(
            Parameter("sine", float(sine), "1"),
            Parameter("order", float(response.order), "1"),
            Parameter("left_out_rms", response.left_out_rms, "deg/s"),
        ),
    )


def _powers(response: Response) -> range:
    """Odd powers of a polynomial response."""
    return range(1, response.order + 1, 2)


def shape_of(model: Model) -> Shape:
    """Shape of a gyro-response/1 model."""
    names = tuple(c.name for c in model.coefficients)
    return Shape(
        names,
        tuple(c.value for c in model.coefficients),
        bool(model.value("sine")),
        model.valid[RATE],
    )
