"""Channels of a static instrument → bias.json: each channel's bias as a polynomial of any
abscissa.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit import units
from calibkit.arrays import Array
from calibkit.coefficients import Model, Record, StageResult
from calibkit.forms import POLYNOMIAL, power_unit
from calibkit.frame import Log, values
from calibkit.instruments.bias_temperature.figures import BiasCurve
from calibkit.instruments.bias_temperature.recipe import (
    Bias,
    BiasTemperatureRecipe,
    Polynomials,
)
from calibkit.numeric import chunks
from calibkit.numeric.chunks import mean, ranges_along
from calibkit.numeric.least_squares import fold, hac, polynomial
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table

BINS = 200

Allocate = Callable[[int], Array]


@dataclass(frozen=True, slots=True)
class _BiasFit:
    """One channel's polynomial: raw powers of the abscissa in its own unit, with their
    covariance.
    """

    indication: str
    abscissa: str
    coefficients: Array
    covariance: Array
    effective_dof: Array
    """[p], degrees of freedom of the standard uncertainties of the coefficients."""
    dof: int
    residual_rms: float
    valid: tuple[float, float]
    curve: BiasCurve


def fit(logs: Sequence[Log], spec: Polynomials) -> list[_BiasFit]:
    """Fit each channel's polynomial by least squares on the abscissa mapped to [−1, 1], over the
    rows of all logs.

    The covariance allows for autocorrelated residuals (Newey & West 1987): the noise of a sensor
    that warms up is not white. Few cold rows leave few degrees of freedom.
    """
    allocate = next((log.allocate for log in logs if log.on_disk), np.empty)
    abscissa = _concatenate(logs, spec.abscissa, allocate)
    return [
        _fit_channel(
            entry,
            spec.abscissa,
            abscissa,
            _concatenate(logs, entry.indication, allocate),
            allocate,
        )
        for entry in spec.bias
    ]


def _concatenate(logs: Sequence[Log], column: str, allocate: Allocate) -> Array:
    """A column [n] of all logs, one after the other, in an array that `allocate` makes."""
    parts = [values(log.frame, column) for log in logs]
    if len(parts) == 1:
        return parts[0]
    whole = allocate(sum(part.size for part in parts))
    row = 0
    for part in parts:
        for start, stop in chunks.ranges_along(part):
            whole[row : row + stop - start] = part[start:stop]
            row += stop - start
            chunks.release(whole)
    return whole


def _fit_channel(
    entry: Bias, name: str, abscissa: Array, indication: Array, allocate: Allocate
) -> _BiasFit:
    """One channel's polynomial over the abscissa of that name."""
    design, to_raw = polynomial.mapped_powers(abscissa, entry.order)
    found = fold.linear(
        design, indication, names=[f"p{k}" for k in range(entry.order + 1)], allocate=allocate
    )
    consistent = hac.covariance(
        design, found.residuals, combinations=np.asarray(to_raw, dtype=np.float64)
    )
    raw, covariance = polynomial.in_raw_powers(found.coefficients, consistent.covariance, to_raw)
    shown = _bin_means(abscissa, indication)
    curve = np.asarray(np.polynomial.polynomial.polyval(shown[0], raw), dtype=np.float64)
    return _BiasFit(
        entry.indication,
        name,
        raw,
        covariance,
        consistent.effective_dof,
        found.dof,
        found.residual_rms,
        chunks.extremes(abscissa),
        BiasCurve(entry.indication, *shown, curve),
    )


def result(fits: Sequence[_BiasFit], flags: Sequence[str]) -> StageResult:
    """bias.json: one polynomial/1 model per channel, coefficients ascending, p<k> multiplies the
    k-th power.
    """
    return StageResult("bias", models=tuple(map(_model, fits)), flags=tuple(flags))


def _model(found: _BiasFit) -> Model:
    """polynomial/1 model of one channel."""
    unit, per = units.column_unit(found.indication), units.column_unit(found.abscissa)
    return POLYNOMIAL.write(
        found.indication,
        [
            (f"p{k}", value, power_unit(unit, per, k))
            for k, value in enumerate(found.coefficients.tolist())
        ],
        found.covariance,
        dof=found.dof,
        effective_dof=found.effective_dof,
        residual_rms=found.residual_rms,
        residual_unit=unit,
        valid={found.abscissa: found.valid},
    )


def summary(title: str, fits: Sequence[_BiasFit], flags: Sequence[str]) -> Summary:
    """Summary of a fit: coefficients of every channel, highest power last."""
    rows = []
    for found in fits:
        u = np.sqrt(np.diag(found.covariance))
        for k, (value, error) in enumerate(zip(found.coefficients, u, strict=True)):
            rows.append(
                (found.indication if k == 0 else "", f"p{k}", f"{value:.7g}", f"{error:.1e}")
            )
        rows.append(("", "residual rms", number(found.residual_rms), ""))
    table = Table(
        f"Bias as a polynomial of {fits[0].abscissa}",
        ("channel", "power", "coefficient", "standard uncertainty"),
        tuple(rows),
    )
    return Summary(title, (table,), tuple(flags), ())


def compensate(
    log: Log, record: Record, spec: BiasTemperatureRecipe
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Channels [rows] without their drift, which is zero at the reference; clamped to the fitted
    range and flagged.

    The reference is the recipe's temperature where the abscissa is a temperature in °C, else the
    middle of the range.
    """
    columns, flags = {}, []
    for entry in spec.polynomials.bias:
        model = record.model(entry.indication)
        abscissa = spec.polynomials.abscissa
        low, high = model.valid[abscissa]
        reference = spec.reference_temp_degc if abscissa.endswith("_degc") else (low + high) / 2.0
        x, y, outside = values(log.frame, abscissa), values(log.frame, entry.indication), 0
        zero = POLYNOMIAL.evaluate(model, {abscissa: np.clip([reference], low, high)})
        columns[entry.indication] = made = log.allocate(x.size)
        for a, b in chunks.ranges_along(x, y, made):
            bias = POLYNOMIAL.evaluate(model, {abscissa: np.clip(x[a:b], low, high)})
            made[a:b] = y[a:b] - (bias - zero)
            outside += int(np.count_nonzero((x[a:b] < low) | (x[a:b] > high)))
        if outside:
            share = 100.0 * outside / x.size
            flags.append(
                f"{log.file}: {abscissa} clamped to {low:g} … {high:g} over {share:.1f} % of the"
                " rows"
            )
    return columns, tuple(dict.fromkeys(flags))


def validation_entry(log: Log, record: Record, spec: BiasTemperatureRecipe) -> dict[str, Any]:
    """JSON object of one validated log: standard deviation of every channel before and after."""
    columns, flags = compensate(log, record, spec)
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": [
            {
                "name": name,
                "unit": units.column_unit(name),
                "before": _standard_deviation(values(log.frame, name)),
                "after": _standard_deviation(output),
            }
            for name, output in columns.items()
        ],
        "flags": list(flags),
    }


def validation_summary(entries: Sequence[dict[str, Any]]) -> Summary:
    """Summary of a validation."""
    rows = tuple(
        (entry["name"], c["name"], number(c["before"]), number(c["after"]), c["unit"])
        for entry in entries
        for c in entry["channels"]
    )
    return Summary(
        "",
        (Table("Standard deviation", ("log", "channel", "before", "after", "unit"), rows),),
        tuple(flag for entry in entries for flag in entry["flags"]),
        (),
    )


def _bin_means(abscissa: Array, indication: Array) -> tuple[Array, Array]:
    """Means of abscissa and indication [bins] over equal steps of the abscissa; empty steps are
    left out.
    """
    edges = np.linspace(*chunks.extremes(abscissa), BINS + 1)
    count, sums = np.zeros(BINS, dtype=np.int64), np.zeros((2, BINS))
    for start, stop in chunks.ranges_along(abscissa, indication):
        x, y = abscissa[start:stop], indication[start:stop]
        index = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
        count += np.bincount(index, minlength=BINS)
        sums += [np.bincount(index, weights=values, minlength=BINS) for values in (x, y)]
    full = count > 0
    return sums[0][full] / count[full], sums[1][full] / count[full]


def _standard_deviation(values: Array) -> float:
    """Standard deviation of values [n] about their mean (divided by n)."""
    centre = mean(values)
    square = sum(float(np.sum((values[a:b] - centre) ** 2)) for a, b in ranges_along(values))
    return float(np.sqrt(square / values.size))
