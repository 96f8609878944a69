"""Channels of a static instrument → bias.json: each channel's bias as a polynomial of any abscissa."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.coefficients import Coefficient, Model, StageResult
from calibkit.frame import values
from calibkit.numeric import fit as core
from calibkit.report.bias_temperature import BiasCurve, BiasReport, binned
from calibkit.report.summary import Summary, SummaryTable, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.coefficients import Record
    from calibkit.frame import Log
    from calibkit.recipe import BiasTemperatureRecipe
    from calibkit.recipe.bias_temperature import Polynomials

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BiasFit:
    """One channel's polynomial: raw powers of the abscissa in its own unit, with their covariance."""

    indication: str
    abscissa: str
    coefficients: Array
    covariance: Array
    dof: int
    residual_rms: float
    valid: tuple[float, float]
    curve: BiasCurve


def fit(logs: Sequence[Log], spec: Polynomials) -> list[BiasFit]:
    """Fit each channel's polynomial by least squares on the abscissa mapped to [−1, 1], over the rows of all logs.

    The covariance allows for autocorrelated residuals (Newey & West 1987): a sensor that warms up is not white.
    """
    abscissa = np.concatenate([values(log.frame, spec.abscissa) for log in logs])
    middle, half = core.mapping(abscissa)
    fits = []
    for entry in spec.bias:
        indication = np.concatenate([values(log.frame, entry.indication) for log in logs])
        found, raw, _ = core.polynomial(abscissa, indication, entry.order)
        design = np.vander((abscissa - middle) / half, entry.order + 1, increasing=True)
        to_raw = np.asarray(core.raw_powers(middle, half, entry.order), dtype=np.float64)
        covariance = to_raw @ core.hac_covariance(design, found.residuals) @ to_raw.T
        shown = binned(abscissa, indication)
        curve = BiasCurve(
            entry.indication, *shown, np.asarray(np.polynomial.polynomial.polyval(shown[0], raw), dtype=np.float64)
        )
        fits.append(
            BiasFit(
                entry.indication,
                spec.abscissa,
                raw,
                covariance,
                found.dof,
                found.residual_rms,
                (float(abscissa.min()), float(abscissa.max())),
                curve,
            )
        )
    return fits


def result(fits: Sequence[BiasFit], flags: Sequence[str]) -> StageResult:
    """bias.json: one polynomial/1 model a channel, coefficients ascending, p<k> multiplies the k-th power."""
    return StageResult("bias", models=tuple(map(_model, fits)), flags=tuple(flags))


def _model(found: BiasFit) -> Model:
    """polynomial/1 model of one channel."""
    unit, per = units.column_unit(found.indication), units.column_unit(found.abscissa)
    uncertainty = np.sqrt(np.diag(found.covariance))
    pairs = enumerate(zip(found.coefficients.tolist(), uncertainty.tolist(), strict=True))
    return Model(
        name=found.indication,
        form="polynomial/1",
        coefficients=tuple(Coefficient(f"p{k}", value, _power_unit(unit, per, k), u) for k, (value, u) in pairs),
        covariance=tuple(map(tuple, found.covariance.tolist())),
        dof=found.dof,
        residual_rms=found.residual_rms,
        residual_unit=unit,
        valid={found.abscissa: found.valid},
    )


def _power_unit(unit: str, per: str, power: int) -> str:
    """Unit of the coefficient of a power of the abscissa."""
    return unit if power == 0 else f"{unit}/({per})" if power == 1 else f"{unit}/({per})^{power}"


def summary(title: str, fits: Sequence[BiasFit], flags: Sequence[str]) -> Summary:
    """What the console says: coefficients of every channel, highest power last."""
    rows = []
    for found in fits:
        u = np.sqrt(np.diag(found.covariance))
        for k, (value, error) in enumerate(zip(found.coefficients, u, strict=True)):
            rows.append((found.indication if k == 0 else "", f"p{k}", f"{value:.7g}", f"{error:.1e}"))
        rows.append(("", "residual rms", number(found.residual_rms), ""))
    title_of_table = f"Bias as a polynomial of {fits[0].abscissa}"
    table = SummaryTable(title_of_table, ("channel", "power", "coefficient", "standard uncertainty"), tuple(rows))
    return Summary(title, (table,), tuple(flags), ())


def drawing(title: str, fits: Sequence[BiasFit]) -> BiasReport:  # noqa: ARG001 (the shape of every drawing function)
    """What the figures show."""
    return BiasReport(fits[0].abscissa, tuple(found.curve for found in fits))


def compensated(log: Log, record: Record, spec: BiasTemperatureRecipe) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Channels [rows] without their drift, which is zero at the reference; clamped to the fitted range and flagged.

    The reference is the recipe's temperature where the abscissa is a temperature in °C, else the middle of the range.
    """
    columns, flags = {}, []
    for entry in spec.polynomials.bias:
        model = record.model(entry.indication)
        abscissa = spec.polynomials.abscissa
        low, high = model.valid[abscissa]
        reference = spec.reference_temp_degc if abscissa.endswith("_degc") else (low + high) / 2.0
        powers = [coefficient.value for coefficient in model.coefficients]
        x = values(log.frame, abscissa)
        outside = float(np.mean((x < low) | (x > high)))
        if outside > 0.0:
            flags.append(
                f"{log.file}: {abscissa} clamped to {low:g} … {high:g} over {100.0 * outside:.1f} % of the rows"
            )
        bias = np.polynomial.polynomial.polyval(np.clip(x, low, high), powers)
        zero = np.polynomial.polynomial.polyval(np.clip(reference, low, high), powers)
        columns[entry.indication] = values(log.frame, entry.indication) - (bias - zero)
    return columns, tuple(dict.fromkeys(flags))


def validation_entry(log: Log, record: Record, spec: BiasTemperatureRecipe) -> dict[str, object]:
    """JSON object of one validated log: standard deviation of every channel before and after."""
    columns, flags = compensated(log, record, spec)
    channels = [
        {
            "name": name,
            "unit": units.column_unit(name),
            "before": float(np.std(values(log.frame, name))),
            "after": float(np.std(output)),
        }
        for name, output in columns.items()
    ]
    return {"name": log.file, "sha256": log.sha256, "rows": log.rows, "channels": channels, "flags": list(flags)}


def validation_summary(entries: Sequence[dict[str, object]]) -> Summary:
    """What the console says of a validation."""
    rows, flags = [], []
    for entry in entries:
        channels = entry["channels"]
        assert isinstance(channels, list)  # noqa: S101 (narrows the JSON object made above)
        rows += [(str(entry["name"]), c["name"], number(c["before"]), number(c["after"]), c["unit"]) for c in channels]
        found = entry["flags"]
        assert isinstance(found, list)  # noqa: S101 (as above)
        flags += found
    table = SummaryTable("Standard deviation", ("log", "channel", "before", "after", "unit"), tuple(rows))
    return Summary("", (table,), tuple(flags), ())
