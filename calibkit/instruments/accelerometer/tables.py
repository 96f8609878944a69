"""Tables of a triad: its coefficients, the uncertainty of a dwell, errors before and after."""

from collections.abc import Mapping, Sequence

from calibkit.coefficients import Figure
from calibkit.instruments.accelerometer.errors import DwellErrors
from calibkit.instruments.accelerometer.fit import TriadFit
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.report.run import list_components
from calibkit.report.summary import number
from calibkit.report.table import Column, Number, Table, number_or_none


def tabulate_fit(fitted: TriadFit) -> list[Table]:
    """K of the three axes and Q with standard uncertainties."""
    tables = []
    if fitted.k:
        title = "K-factor for °C (± standard uncertainty, type A)"
        by_number = zip(*(model.coefficients for model in fitted.k), strict=True)
        rows = tuple(
            (
                same[0].name,
                *(Number(c.value, ".6e", c.standard_uncertainty, ".0e") for c in same),
            )
            for same in by_number
        )
        tables.append(Table(title, ("", *(model.name for model in fitted.k)), rows))
    if fitted.q is not None:
        title = f"Q-factor at {fitted.q.value('temperature'):.1f} °C [mrad]"
        rows = tuple(
            (c.name, Number(1e3 * c.value, ".4f", 1e3 * c.standard_uncertainty, ".4f"))
            for c in fitted.q.coefficients
        )
        tables.append(Table(title, ("", "small-angle"), rows))
    model = fitted.affine or fitted.k[0]
    shared = list_components("Errors that dwells share", [model])
    return [*tables, shared] if shared.rows else tables


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
