"""Errors of dwells before and after correction, as a table, on the first screen of a fit, and in a
validation.json.
"""

from collections.abc import Mapping, Sequence

from calibkit.coefficients import Figure
from calibkit.instruments.accelerometer.errors import DwellErrors
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import number
from calibkit.report.table import Column, Table, number_or_none


def tabulate_errors(
    errors: Mapping[str, DwellErrors], spec: AccelerometerRecipe, title: str
) -> Table:
    """Table of errors, a row for each correction; toolface with its inclination range."""
    if spec.reference.kind == "magnitude":
        lengths = tuple((name, 1e6 * one.residual_rms_g) for name, one in errors.items())
        return Table(title, ("", Column("| |G| - g | rms [µg]", ".1f")), lengths)
    low, high = spec.toolface_range_deg
    heads = (
        "",
        Column("residual rms [µg]", ".1f"),
        "inclination rms, max [°]",
        f"toolface rms, max [°], {low:g}-{high:g}°",
        "max toolface·sin(incl.) [°]",
    )
    rows: list[tuple[str | float, ...]] = []
    for name, one in errors.items():
        if one.angles is not None:
            shown = [number(figure, 3) for figure in one.angles.figures.values()]
            pairs = ", ".join(shown[:2]), ", ".join(shown[2:4])
            rows.append((name, 1e6 * one.residual_rms_g, *pairs, shown[4]))
    return Table(title, heads, tuple(rows))


def tabulate_uncertainty(figures: Sequence[Figure]) -> Table:
    """Table of the largest uncertainties of one corrected dwell."""
    rows = tuple((figure.name, number(figure.value, 2), figure.unit) for figure in figures)
    return Table("Uncertainty of one corrected dwell (type A)", ("", "largest", "unit"), rows)


def list_errors(errors: DwellErrors, spec: AccelerometerRecipe) -> dict[str, object]:
    """JSON object of the errors of one log; the toolface with its inclination range."""
    entries: dict[str, object] = {"residual_rms_g": errors.residual_rms_g}
    if errors.angles is not None:
        entries |= {name: number_or_none(x) for name, x in errors.angles.figures.items()}
        entries["toolface_inclination_range_deg"] = list(spec.toolface_range_deg)
    return entries


def summarize_errors(
    raw: DwellErrors, corrected: DwellErrors, correction: str, table: Table, where: str
) -> Overview:
    """First screen of dwells before and after a correction."""
    before, after = (1e6 * errors.residual_rms_g for errors in (raw, corrected))
    sentence = (
        f"Residual of {len(raw.residual)} dwells{where} (rms): {before:.0f} µg before,"
        f" {after:.0f} µg after the {correction} correction."
    )
    facts = []
    values = [
        KeyValue("residual rms, before", before, "µg"),
        KeyValue("residual rms, after", after, "µg"),
    ]
    if raw.angles is not None and corrected.angles is not None:
        tilt = corrected.angles.figures["inclination_max_deg"]
        facts.append(
            f"Largest inclination error: {raw.angles.figures['inclination_max_deg']:.3f}° before,"
            f" {tilt:.3f}° after; largest toolface error times sin(inclination):"
            f" {corrected.angles.figures['toolface_sin_max_deg']:.3f}° after."
        )
        values.append(KeyValue("largest inclination error, after", tilt, "°"))
    if corrected.noise_g > 0.0:
        noise = 1e6 * corrected.noise_g
        facts.append(f"Noise of the dwells alone gives {noise:.0f} µg.")
        values.append(KeyValue("noise of the dwells", noise, "µg"))
    return Overview(sentence, tuple(facts), tuple(values), table)
