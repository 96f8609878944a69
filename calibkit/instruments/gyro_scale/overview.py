"""First screens of gyros on a rate table: scale factors, angles and the largest figures in ppm."""

from collections.abc import Iterable, Sequence

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.instruments.gyro_scale import forms, over_runs, pair_fit, triad_fit
from calibkit.instruments.gyro_scale.acceptance import RUN_LIMITS
from calibkit.instruments.gyro_scale.numeric.gjb_figures import GJB, PPM
from calibkit.report.overview import KeyValue, Overview, concise

_COUNTS = "counts/°"


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


def summarize_rate_table(gyros: Sequence[over_runs.GyroOverRuns], scales: StageResult) -> Overview:
    """Scale factor of each gyro at the reference temperature, and the largest figures."""
    values = []
    for one in gyros:
        degc = float(np.mean(one.temp_degc[one.room]))
        where = f" at {degc:.1f} °C" if np.isfinite(degc) else ""
        name = f"scale factor of {forms.line_name(one.gyro)}{where}"
        values.append(KeyValue(name, float(one.K.value), _COUNTS, float(one.K.u)))
    first = gyros[0].K
    ppm = PPM * float(first.u) / abs(float(first.value))
    (listed,) = _in_words(values)
    sentence = f"{listed.removesuffix('.')} (u {ppm:.2g} ppm)."
    largest = _largest_figures(scales.figures)
    return Overview(sentence, _in_words(largest), (*values, *largest)[:4])


def summarize_pair(fitted: pair_fit.PairFit, scales: StageResult) -> Overview:
    """Angle of a pair, the ratio of its scale factors, and the largest figures."""
    found = fitted.found
    u_N, _, u_gamma, u_alpha = found.standard_uncertainty
    error = KeyValue("orthogonality error 90° − α", found.orthogonality_error_deg, "°", u_alpha)
    ratio = KeyValue("ratio of scale factors N = K_B/K_A", found.N, "1", u_N)
    gamma = KeyValue("γ", found.gamma, "1", u_gamma)
    sentence = (
        f"Angle between the input axes α = {concise(found.alpha_deg, u_alpha)}°: {error.name} ="
        f" {error}."
    )
    largest = _largest_figures(scales.figures)
    facts = (f"N = K_B/K_A = {ratio}; γ = {gamma}.", *_in_words(largest))
    return Overview(sentence, facts, (error, ratio, *largest)[:4])


def summarize_triad(fitted: triad_fit.AxesFit, scales: StageResult) -> Overview:
    """Largest departure of two input axes from 90°, and the scale factor of each gyro."""
    one = fitted.sets[fitted.reference]
    where = f" at {one.temp_degc:.1f} °C" if np.isfinite(one.temp_degc) else ""
    sizes = [
        KeyValue(
            f"scale factor of {gyro}{where}",
            float(one.triad.magnitude.value[at]),
            _COUNTS,
            float(one.triad.magnitude.u[at]),
        )
        for at, gyro in enumerate(fitted.gyros)
    ]
    (listed,) = _in_words(sizes)
    facts = _in_words(_largest_figures(scales.figures))
    if not fitted.pairs:
        return Overview(listed, facts, tuple(sizes[:4]))
    angles, u = one.triad.angles_deg.value, one.triad.angles_deg.u
    g, h = max(fitted.pairs, key=lambda pair: abs(90.0 - angles[pair]))
    name = f"90° − angle between the input axes of {fitted.gyros[g]} and {fitted.gyros[h]}"
    worst = KeyValue(name, float(90.0 - angles[g, h]), "°", float(u[g, h]))
    sentence = f"Largest departure from right angles{where}: {worst.name} is {worst}."
    return Overview(sentence, (listed, *facts), (worst, *sizes)[:4])
