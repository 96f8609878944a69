"""First screen of a static instrument: how far each channel drifts, and what is left."""

from collections.abc import Sequence

import numpy as np

from calibkit import units
from calibkit.certificate.words import unit_mark
from calibkit.instruments.bias_temperature.figures import BiasCurve
from calibkit.report.overview import KeyValue, Overview


def summarize_drifts(channels: Sequence[tuple[BiasCurve, float, float]]) -> Overview:
    """First screen of channels: each with its curve, the rms of its residuals, and this over its
    noise.
    """
    drifts, values = [], []
    for curve, left, over_noise in channels:
        unit, drift = unit_mark(units.column_unit(curve.name)), float(np.ptp(curve.polynomial))
        drifts.append(
            f"{curve.name} drifts by {drift:.3g} {unit} over its range; {left:.3g} {unit} (rms) is"
            f" left, {over_noise:.3g} times the noise."
        )
        values += [
            KeyValue(f"drift of {curve.name}", drift, unit),
            KeyValue(f"residual rms of {curve.name}", left, unit),
        ]
    return Overview(drifts[0], tuple(drifts[1:]), tuple(values[:4]))
