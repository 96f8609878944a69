"""First screen of gyros on a rate table: scale factors, angles and the largest figures in ppm."""

from collections.abc import Iterable, Sequence

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.instruments.gyro_scale.acceptance import RUN_LIMITS
from calibkit.instruments.gyro_scale.campaign import Campaign
from calibkit.instruments.gyro_scale.published import GJB, PPM, FigureName
from calibkit.report.overview import KeyValue, Overview, concise

_COUNTS = "counts/°"


def summarize(campaign: Campaign, scales: StageResult) -> Overview:
    """What is between the gyros, else the scale factor of each, and the largest figures."""
    largest = _largest_figures(scales.figures)
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
    sizes = _list_scales(campaign)
    (listed,) = _in_words(sizes)
    if not campaign.sets:
        first = sizes[0]
        ppm = PPM * first.standard_uncertainty / abs(first.value)
        sentence = f"{listed.removesuffix('.')} (u {ppm:.2g} ppm)."
        return Overview(sentence, facts, (*sizes, *largest)[:4])
    # the largest departure of two input axes from a right angle
    of_axes = campaign.reference.figures
    errors = {name: one for name, one in of_axes.items() if name.startswith("orthogonality_error")}
    if not errors:
        return Overview(listed, facts, tuple(sizes[:4]))
    name, largest_error = max(errors.items(), key=lambda entry: abs(entry[1].value))
    of_both = name.partition(".")[2].replace("_", " and ")
    name = f"90° − angle between the input axes of {of_both}"
    worst = KeyValue(name, largest_error.value, "°", largest_error.standard_uncertainty)
    where = _at(campaign.reference.temp_degc)
    sentence = f"Largest departure from right angles{where}: {worst.name} is {worst}."
    return Overview(sentence, (listed, *facts), (worst, *sizes)[:4])


def _list_scales(campaign: Campaign) -> list[KeyValue]:
    """Scale factor of each gyro at the reference temperature, of a triad about its input axis."""
    if campaign.sets:
        where = _at(campaign.reference.temp_degc)
        of_axes = [
            (channel.gyro + where, campaign.reference.figures[f"scale_factor.{channel.gyro}"])
            for channel in campaign.own
        ]
    else:
        of_axes = []
        for channel in campaign.channels:
            where = _at(float(np.mean([run.temp_degc for run in channel.repeated])))
            if channel.mean is not None:
                of_axes.append((channel.name + where, channel.mean.coefficients[0]))
    return [
        KeyValue(f"scale factor of {name}", K.value, _COUNTS, K.standard_uncertainty)
        for name, K in of_axes
    ]


def _at(degc: float) -> str:
    """Where a value holds, if the temperature is known."""
    return f" at {degc:.1f} °C" if np.isfinite(degc) else ""


def _largest_figures(figures: Iterable[Figure]) -> tuple[KeyValue, ...]:
    """Largest of each figure of GJB 2426A over the runs and gyros."""
    largest: dict[str, Figure] = {}
    for figure in figures:
        what, standard, _ = FigureName.of(figure.name)
        if standard == GJB and what in RUN_LIMITS:
            largest[what] = max(largest.get(what, figure), figure, key=lambda one: abs(one.value))
    return tuple(
        KeyValue(
            f"largest {name} (GJB 2426A)",
            largest[what].value,
            largest[what].unit.replace("degC", "°C"),
            largest[what].standard_uncertainty,
        )
        for what, (name, _, _) in RUN_LIMITS.items()
        if what in largest
    )


def _in_words(values: Sequence[KeyValue]) -> tuple[str, ...]:
    """Values as one line."""
    if not values:
        return ()
    text = "; ".join(f"{one.name} = {one}" for one in values)
    return (f"{text[0].upper()}{text[1:]}.",)
