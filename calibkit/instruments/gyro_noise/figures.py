"""What the report of sensors at rest shows: acceptance limits, tables and the first screen; figures
of the deviations over averaging time with the noise terms, and of the indication over time; and the
JSON of a validation.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.instruments import Fitted
from calibkit.instruments.gyro_noise import certificate
from calibkit.instruments.gyro_noise.deviations import NoiseFigures, list_figures
from calibkit.instruments.gyro_noise.forms import read_name
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe, NoiseAcceptance
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.noise.confidence import TYPES
from calibkit.records.coefficients import Criterion, StageResult, at_most
from calibkit.records.frame import share_unit
from calibkit.records.sensitivities import Sensitivity
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary
from calibkit.units import known, unit_mark


def criteria(records: Sequence[NoiseFigures], limits: NoiseAcceptance) -> tuple[Criterion, ...]:
    """Limits tested on each record; of a term that is not observable, on its largest possible
    value.
    """
    tested = []
    for noise in records:
        name, sensor, curve = noise.name, noise.sensor, noise.curve
        observed = {term.name: term.value for term in noise.terms.terms}
        results = []  # name of the limit, words, value, unit
        for law in sensor.laws:
            words = f"{law.name} of {name}"
            if law.name not in observed:
                words += " (not observable: at most)"
            # no term is larger than the whole of σ² at any averaging time, its upper limit
            most = float(np.min(law.scale * curve.upper / curve.tau_s ** (law.exponent / 2.0)))
            results.append((law.name, words, observed.get(law.name, most), law.unit))
        residual = f"{name}: residual over noise"
        results.append(("residual_over_noise", residual, noise.over_noise, "1"))
        for entry in noise.stability:
            words = f"bias stability over {entry.block_s:g} s of {name}"
            results.append(("bias_stability", words, entry.value, sensor.unit))
        for limit_name, words, value, unit in results:
            limit = getattr(limits, sensor.limits.get(limit_name, ""), None)
            if limit is not None:
                tested.append(at_most(words, value, limit, unit))
    return tuple(tested)


def summarize(
    title: str,
    records: Sequence[NoiseFigures],
    result: StageResult,
    sensitivities: Sequence[Sensitivity],
    spec: GyroNoiseRecipe,
) -> Summary:
    """The tables of the certificate, flags and tested limits; the first screen has the terms that
    the first record shows.
    """
    tables = tabulate_fit([result], spec, sensitivities, certificate.blocks)
    first = records[0]
    key_values = []
    for figure in list_figures(first)[1:]:  # behind the mean
        name, u = read_name(figure.name), figure.standard_uncertainty
        if name.tau_s is None:
            words = certificate.name_term(name.term).en
            unit, dof = unit_mark(figure.unit), figure.effective_dof
            key_values.append(KeyValue.of(words, figure.value, unit, u, dof))
    terms = "; ".join(f"{entry.name} {entry}" for entry in key_values[: len(first.terms.terms)])
    terms = terms or "no term of noise is determined by the Allan deviation"
    hours = first.curve.samples * first.curve.interval_s / SECONDS_PER_HOUR
    sentence = f"Noise of {first.name} over {hours:.3g} h at rest: {terms}."
    overview = Overview(sentence, (), tuple(key_values[:4]), tables[0])
    tested = criteria(records, spec.acceptance)
    return Summary(title, tuple(tables), result.flags, tested, overview=overview)


def validation_entry(noise: NoiseFigures) -> dict[str, object]:
    """JSON object of one record's figures."""
    unit = noise.sensor.unit
    curves = {
        key: {
            "estimator": curve.estimator,
            "tau_s": curve.tau_s.tolist(),
            "deviation": curve.deviation.tolist(),
            "lower": curve.lower.tolist(),
            "upper": curve.upper.tolist(),
            "dof": curve.dof.tolist(),
            "noise": list(curve.noise),
            "probability": curve.probability,
            "unit": unit,
        }
        for key, curve in (("allan_deviation", noise.curve), ("wavelet_deviation", noise.wavelet))
    }
    return {
        "name": noise.name,
        "interval_s": noise.curve.interval_s,
        "missing": noise.missing,
        "mean": noise.mean,
        "unit": unit,
        "terms": [asdict(term) for term in noise.terms.terms],
        "not_observable": [asdict(term) for term in noise.terms.not_observable],
        "bias_stability": [asdict(stability) | {"unit": unit} for stability in noise.stability],
        **curves,
    }


@dataclass(frozen=True, slots=True)
class NoiseReport:
    """All that the figures show."""

    records: tuple[NoiseFigures, ...]

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per averaging time of a record: Allan deviation, the
        noise terms together, in the record's unit, and how far it is from them relative to them.
        """
        curves = [noise.curve for noise in self.records]
        units = [known(unit_mark(noise.sensor.unit)) for noise in self.records]
        counts = [curve.tau_s.size for curve in curves]
        deviation = np.concatenate([curve.deviation for curve in curves])
        model = np.concatenate([noise.terms.model for noise in self.records])
        names = np.array([noise.name for noise in self.records], dtype=object)
        return {
            "record": np.repeat(names, counts),
            "unit": np.repeat(np.array(units, dtype=object), counts),
            "tau_s": np.concatenate([curve.tau_s for curve in curves]),
            "deviation": deviation,
            "model": model,
            "residual": deviation / model - 1.0,
            "units": share_unit(("deviation", "model"), units),
        }


def draw(title: str, fitted: Fitted[NoiseReport]) -> Drawn:
    """Figures and summary of a fit: of each record above Allan and wavelet deviation with their
    limits over averaging time and what each noise term makes alone, below the indication over time.
    """
    pages = []
    for noise in fitted.drawing.records:
        unit, tau = unit_mark(noise.sensor.unit), noise.curve.tau_s
        figure, (above, below) = page(2, 1, title=f"{title}: noise of {noise.name}", height=8.5)
        curves = ((noise.curve, "o", INK, INK), (noise.wavelet, "s", ALERT, "none"))
        for curve, mark, colour, face in curves:
            above.errorbar(
                curve.tau_s,
                curve.deviation,
                np.stack([curve.deviation - curve.lower, curve.upper - curve.deviation]),
                fmt=mark,
                ms=4,
                mfc=face,
                capsize=3,
                color=colour,
                label=f"{curve.estimator} deviation",
            )
        # the exponent α of the noise type that the limits of each Allan deviation assume
        tops = zip(tau, noise.curve.upper, strict=True)
        for top, kind in zip(tops, noise.curve.noise, strict=True):
            exponent = f"{2 - TYPES.index(kind)}"
            above.annotate(exponent, top, (0, 3), textcoords="offset points", ha="center")
        above.plot(tau, noise.terms.model, color=GOOD, label="noise terms together")
        laws, labels = {law.name: law for law in noise.sensor.laws}, []
        for term in noise.terms.terms:
            law = laws[term.name]
            # what this term alone makes: σ² ∝ τ^exponent; the scale goes back from the unit of the
            # term
            of_term = term.value / law.scale * tau ** (law.exponent / 2.0)
            above.plot(tau, of_term, color=MUTED, ls="--", lw=0.8)
            labels.append(f"{term.symbol} {term.value:.3g} {unit_mark(term.unit)}")
        above.set(
            xscale="log",
            yscale="log",
            ylim=(
                0.3 * min(float(np.min(curve.lower)) for curve, *_ in curves),
                3.0 * max(float(np.max(curve.upper)) for curve, *_ in curves),
            ),
            xlabel="averaging time τ [s]",
            ylabel=f"deviation [{unit}]",
            title=f"dashed: noise terms that are observable: {', '.join(labels) or 'none'}",
        )
        above.legend(loc="best")
        above.grid(visible=True, which="both", color=RAW, alpha=0.3, lw=0.4)
        block_s = noise.block * noise.curve.interval_s
        hours = (np.arange(noise.block_means.size) + 0.5) * (block_s / SECONDS_PER_HOUR)
        below.plot(hours, noise.block_means, color=DENOISED, lw=0.8)
        below.set(
            xlabel="time [h]",
            ylabel=f"indication [{unit}]",
            title=f"means of {block_s:g} s; gaps are left open",
        )
        pages.append(figure)
    return Drawn(tuple(pages), fitted.summary)
