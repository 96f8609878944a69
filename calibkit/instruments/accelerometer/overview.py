"""First screens of a triad: errors of the dwells before and after correction."""

from collections.abc import Mapping

from calibkit.instruments.accelerometer.errors import DwellErrors
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.table import Table


def summarize_errors(
    found: Mapping[str, DwellErrors], after: str, dwells: int, table: Table, where: str = ""
) -> Overview:
    """First screen of dwells before and after the correction that is called `after`."""
    raw, left = found["indication"], found[after]
    sentence = (
        f"Residual of {dwells} dwells{where} (rms): {1e6 * raw.residual_rms_g:.0f} µg before,"
        f" {1e6 * left.residual_rms_g:.0f} µg after the {after} correction."
    )
    facts, values = [], []
    if raw.angles is not None and left.angles is not None:
        facts.append(
            f"Largest inclination error: {raw.angles.inclination_max_deg:.3f}° before,"
            f" {left.angles.inclination_max_deg:.3f}° after; largest toolface error times"
            f" sin(inclination): {left.angles.toolface_scaled_max_deg:.3f}° after."
        )
        values.append(
            KeyValue("largest inclination error, after", left.angles.inclination_max_deg, "°")
        )
    if left.noise_g > 0.0:
        facts.append(f"Noise of the dwells alone gives {1e6 * left.noise_g:.0f} µg.")
        values.append(KeyValue("noise of the dwells", 1e6 * left.noise_g, "µg"))
    values = [
        KeyValue("residual rms, before", 1e6 * raw.residual_rms_g, "µg"),
        KeyValue("residual rms, after", 1e6 * left.residual_rms_g, "µg"),
        *values,
    ]
    return Overview(sentence, tuple(facts), tuple(values), table)
