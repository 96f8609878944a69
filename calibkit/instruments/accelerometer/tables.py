"""Tables of a triad: its coefficients, the uncertainty of a dwell, errors before and after."""

from collections.abc import Mapping, Sequence

from calibkit.coefficients import Figure
from calibkit.instruments.accelerometer.errors import DwellErrors
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
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
    rows = tuple(
        (
            name,
            1e6 * one.residual_rms_g,
            f"{number(angles.inclination_rms_deg, 3)}, {number(angles.inclination_max_deg, 3)}",
            f"{number(angles.toolface_rms_deg, 3)}, {number(angles.toolface_max_deg, 3)}",
            number(angles.toolface_scaled_max_deg, 3),
        )
        for name, one in errors.items()
        if (angles := one.angles) is not None
    )
    return Table(title, heads, rows)


def tabulate_uncertainty(figures: Sequence[Figure]) -> Table:
    """Table of the largest uncertainties of one corrected dwell."""
    rows = tuple((figure.name, number(figure.value, 2), figure.unit) for figure in figures)
    return Table("Uncertainty of one corrected dwell (type A)", ("", "largest", "unit"), rows)


def list_errors(errors: DwellErrors) -> dict[str, object]:
    """JSON object of the errors of one log; the toolface with its inclination range."""
    found: dict[str, object] = {"residual_rms_g": errors.residual_rms_g}
    if errors.angles is not None:
        found |= {
            "inclination_rms_deg": errors.angles.inclination_rms_deg,
            "inclination_max_deg": errors.angles.inclination_max_deg,
            "toolface_rms_deg": number_or_none(errors.angles.toolface_rms_deg),
            "toolface_max_deg": number_or_none(errors.angles.toolface_max_deg),
            "toolface_sin_max_deg": number_or_none(errors.angles.toolface_scaled_max_deg),
            "toolface_inclination_range_deg": list(errors.angles.inclination_range_deg),
        }
    return found
