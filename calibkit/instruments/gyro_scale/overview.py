"""First screen of gyros on a rate table: what is between the gyros, else the scale factor of each,
and the largest figures of GJB 2426A in ppm.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.coefficients import StageResult
from calibkit.instruments.gyro_scale.acceptance import RUN_LIMITS
from calibkit.instruments.gyro_scale.coefficient_files import CampaignFit
from calibkit.instruments.gyro_scale.published import GJB, PPM, FigureName
from calibkit.report.overview import KeyValue, Overview, concise


def summarize(campaign: CampaignFit, scales: StageResult) -> Overview:
    """Sentence, facts and values of a fit; `scales` is what gyro_scale.json will hold."""
    largest = []
    for kind, (name, _, _) in RUN_LIMITS.items():
        kind_figures = [
            figure for figure in scales.figures if FigureName.of(figure.name)[:2] == (kind, GJB)
        ]
        if kind_figures:
            worst = max(kind_figures, key=lambda figure: abs(figure.value))
            unit = worst.unit.replace("degC", "°C")
            label = f"largest {name} (GJB 2426A)"
            largest.append(KeyValue(label, worst.value, unit, worst.standard_uncertainty))
    facts = _in_words(largest)
    if campaign.pair is not None:
        N, _, gamma, alpha = campaign.pair.coefficients
        u_alpha = alpha.standard_uncertainty
        error = KeyValue("orthogonality error 90° − α", 90.0 - alpha.value, "°", u_alpha)
        ratio = KeyValue("ratio of scale factors N = K_B/K_A", N.value, "1", N.standard_uncertainty)
        of_gamma = KeyValue("γ", gamma.value, "1", gamma.standard_uncertainty)
        sentence = (
            f"Angle between the input axes α = {concise(alpha.value, u_alpha)}°: {error.name} ="
            f" {error}."
        )
        facts = (f"N = K_B/K_A = {ratio}; γ = {of_gamma}.", *facts)
        return Overview(sentence, facts, (error, ratio, *largest)[:4])
    at_reference = _where(campaign.reference.temp_degc) if campaign.sets else ""
    scale_factors = []
    for channel in campaign.own_channels:
        if channel.mean is not None:
            K, of_runs = channel.mean.coefficients[0], channel.repeated
            gyro_label = channel.name + _where(float(np.mean([run.temp_degc for run in of_runs])))
        else:
            K = campaign.reference.figures[f"scale_factor.{channel.gyro}"]
            gyro_label = channel.gyro + at_reference
        label = f"scale factor of {gyro_label}"
        scale_factors.append(KeyValue(label, K.value, "counts/°", K.standard_uncertainty))
    (scale_factor_text,) = _in_words(scale_factors)
    if not campaign.sets:
        first = scale_factors[0]
        ppm = PPM * first.standard_uncertainty / abs(first.value)
        sentence = f"{scale_factor_text.removesuffix('.')} (u {ppm:.2g} ppm)."
        return Overview(sentence, facts, (*scale_factors, *largest)[:4])
    angles = [
        figure
        for name, figure in campaign.reference.figures.items()
        if name.startswith("orthogonality_error")
    ]
    if not angles:
        return Overview(scale_factor_text, facts, tuple(scale_factors[:4]))
    worst = max(angles, key=lambda figure: abs(figure.value))
    of_both = worst.name.partition(".")[2].replace("_", " and ")
    label = f"90° − angle between the input axes of {of_both}"
    error = KeyValue(label, worst.value, "°", worst.standard_uncertainty)
    sentence = f"Largest departure from right angles{at_reference}: {label} is {error}."
    return Overview(sentence, (scale_factor_text, *facts), (error, *scale_factors)[:4])


def _where(degc: float) -> str:
    """Where a value holds, if the temperature is known."""
    return f" at {degc:.1f} °C" if np.isfinite(degc) else ""


def _in_words(values: Sequence[KeyValue]) -> tuple[str, ...]:
    """Values as one line."""
    text = "; ".join(f"{value.name} = {value}" for value in values)
    return (f"{text[0].upper()}{text[1:]}.",) if text else ()
