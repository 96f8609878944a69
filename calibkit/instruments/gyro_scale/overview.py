"""First screen of gyros on a rate table: scale factors, angles and the largest figures in ppm."""

from collections.abc import Iterable, Sequence

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.acceptance import RUN_LIMITS
from calibkit.instruments.gyro_scale.campaign import Campaign
from calibkit.instruments.gyro_scale.numeric.gjb_figures import GJB, PPM
from calibkit.report.overview import KeyValue, Overview, concise

_COUNTS = "counts/°"


def summarize(campaign: Campaign, scales: StageResult) -> Overview:
    """What is between the gyros, else the scale factor of each, and the largest figures."""
    largest = _largest_figures(scales.figures)
    facts = _in_words(largest)
    if campaign.pair is not None:
        found = campaign.pair
        u_N, _, u_gamma, u_alpha = found.standard_uncertainty
        error = KeyValue("orthogonality error 90° − α", found.orthogonality_error_deg, "°", u_alpha)
        ratio = KeyValue("ratio of scale factors N = K_B/K_A", found.N, "1", u_N)
        gamma = KeyValue("γ", found.gamma, "1", u_gamma)
        sentence = (
            f"Angle between the input axes α = {concise(found.alpha_deg, u_alpha)}°: {error.name} ="
            f" {error}."
        )
        facts = (f"N = K_B/K_A = {ratio}; γ = {gamma}.", *facts)
        return Overview(sentence, facts, (error, ratio, *largest)[:4])
    sizes = _list_scales(campaign)
    (listed,) = _in_words(sizes)
    if not campaign.sets:
        first = campaign.channels[0].K
        ppm = PPM * float(first.u) / abs(float(first.value))
        sentence = f"{listed.removesuffix('.')} (u {ppm:.2g} ppm)."
        return Overview(sentence, facts, (*sizes, *largest)[:4])
    triad = campaign.reference.triad
    if not triad.pairs:
        return Overview(listed, facts, tuple(sizes[:4]))
    # the largest departure of two input axes from a right angle
    angles, u = triad.angles_deg.value, triad.angles_deg.u
    g, h = max(triad.pairs, key=lambda pair: abs(90.0 - angles[pair]))
    of_both = " and ".join(campaign.own[number].gyro for number in (g, h))
    name = f"90° − angle between the input axes of {of_both}"
    worst = KeyValue(name, float(90.0 - angles[g, h]), "°", float(u[g, h]))
    where = _at(campaign.reference.temp_degc)
    sentence = f"Largest departure from right angles{where}: {worst.name} is {worst}."
    return Overview(sentence, (listed, *facts), (worst, *sizes)[:4])


def _list_scales(campaign: Campaign) -> list[KeyValue]:
    """Scale factor of each gyro at the reference temperature, of a triad about its input axis."""
    if campaign.sets:
        one = campaign.reference
        size, where = one.triad.magnitude, _at(one.temp_degc)
        found = zip(campaign.own, size.value.tolist(), size.u.tolist(), strict=True)
        return [
            KeyValue(f"scale factor of {channel.gyro}{where}", K, _COUNTS, u)
            for channel, K, u in found
        ]
    values = []
    for channel in campaign.channels:
        where = _at(float(np.mean([run.temp_degc for run in channel.repeated])))
        K, u = float(channel.K.value), float(channel.K.u)
        values.append(KeyValue(f"scale factor of {channel.name}{where}", K, _COUNTS, u))
    return values


def _at(degc: float) -> str:
    """Where a value holds, if the temperature is known."""
    return f" at {degc:.1f} °C" if np.isfinite(degc) else ""


def _largest_figures(figures: Iterable[Figure]) -> tuple[KeyValue, ...]:
    """Largest of each figure of GJB 2426A over the runs and gyros."""
    found: dict[str, Figure] = {}
    for figure in figures:
        what, standard, _ = forms.read_figure_name(figure.name)
        if standard == GJB and what in RUN_LIMITS:
            found[what] = max(found.get(what, figure), figure, key=lambda one: abs(one.value))
    return tuple(
        KeyValue(
            f"largest {name} (GJB 2426A)",
            found[what].value,
            found[what].unit.replace("degC", "°C"),
            found[what].standard_uncertainty,
        )
        for what, (name, _, _) in RUN_LIMITS.items()
        if what in found
    )


def _in_words(values: Sequence[KeyValue]) -> tuple[str, ...]:
    """Values as one line."""
    if not values:
        return ()
    text = "; ".join(f"{one.name} = {one}" for one in values)
    return (f"{text[0].upper()}{text[1:]}.",)
