"""What the report of sensors at rest shows: acceptance limits, tables and the first screen; figures
of the deviations over averaging time with the noise terms, and of the indication over time; and the
JSON of a validation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.words import unit_mark
from calibkit.coefficients import Criterion, at_most
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.frame import share_unit
from calibkit.numeric.noise.confidence import TYPES
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table
from calibkit.units import known

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from calibkit.instruments import Fitted
    from calibkit.instruments.gyro_noise.deviations import NoiseFigures
    from calibkit.instruments.gyro_noise.recipe import NoiseAcceptance


def criteria(records: Sequence[NoiseFigures], limits: NoiseAcceptance) -> tuple[Criterion, ...]:
    """Limits tested on each record; of a term that is not observable, on its largest possible
    value.
    """
    tested = []
    for noise in records:
        sensor = noise.sensor
        largest = {name: getattr(limits, key) for name, key in sensor.limits.items()}
        observed = {term.name: term.value for term in noise.terms.terms}
        for law in sensor.laws:
            limit = largest.get(law.name)
            if limit is not None:
                name = f"{law.name} of {noise.name}"
                value = observed.get(law.name)
                if value is None:
                    name += " (not observable: at most)"
                    # no term is larger than the whole of σ² at any averaging time, its upper limit
                    upper, tau = noise.curve.upper, noise.curve.tau_s
                    value = float(np.min(law.scale * upper / tau ** (law.exponent / 2.0)))
                tested.append(at_most(name, value, limit, law.unit))
        if limits.max_residual_over_noise is not None:
            name = f"{noise.name}: residual over noise"
            tested.append(at_most(name, noise.over_noise, limits.max_residual_over_noise, "1"))
        if largest["bias_stability"] is not None:
            tested += [
                at_most(
                    f"bias stability over {entry.block_s:g} s of {noise.name}",
                    entry.value,
                    largest["bias_stability"],
                    sensor.unit,
                )
                for entry in noise.stability
            ]
    return tuple(tested)


def summarize(
    title: str, records: Sequence[NoiseFigures], flags: Sequence[str], limits: NoiseAcceptance
) -> Summary:
    """Mean, noise terms and bias stability of every record, the deviations over averaging time,
    flags and tested limits; the first screen has the terms that are determined.
    """
    rows = []
    for noise in records:
        name, sensor = noise.name, noise.sensor
        rows.append((name, sensor.mean.replace("_", " "), number(noise.mean, 6), "", sensor.unit))
        cells_of_terms = {
            term.name: (number(term.value), number(term.standard_uncertainty, 2))
            for term in noise.terms.terms
        }
        for law in sensor.laws:
            cells = cells_of_terms.get(law.name, ("not observable", ""))
            rows.append((name, f"{law.name} {law.symbol}", *cells, law.unit))
        for entry in noise.stability:
            cells = number(entry.value), number(entry.standard_uncertainty, 2)
            rows.append((name, f"bias stability, {entry.block_s:g} s", *cells, sensor.unit))
    title_of_terms = (
        "Noise (IEEE Std 952) and bias stability (GJB 2426A: standard deviation of block means)"
    )
    heads = ("record", "figure", "value", "standard uncertainty", "unit")
    terms = Table(title_of_terms, heads, tuple(rows))
    # deviations over averaging time with confidence limits, and the exponent α of the noise type
    # that those of the Allan deviation assume
    curves = []
    every_curve = [(entry, c) for entry in records for c in (entry.curve, entry.wavelet)]
    for noise, curve in every_curve:
        columns = {
            "τ [s]": [f"{tau:g}" for tau in curve.tau_s],
            "deviation": map(number, curve.deviation),
            "lower": map(number, curve.lower),
            "upper": map(number, curve.upper),
            "dof": [f"{dof:.{0 if dof >= 100.0 else 1}f}" for dof in curve.dof],
        }
        if curve.noise:
            columns["α"] = [f"{2 - TYPES.index(kind)}" for kind in curve.noise]
        quantity = f"{curve.estimator} deviation [{unit_mark(noise.sensor.unit)}]"
        title_of_curve = f"{noise.name}: {quantity} with {100.0 * curve.probability:g} % limits"
        rows_of_curve = tuple(zip(*columns.values(), strict=True))
        curves.append(Table(title_of_curve, tuple(columns), rows_of_curve))

    first = records[0]
    key_values = [
        KeyValue(
            f"{term.name.replace('_', ' ')} {term.symbol}",
            term.value,
            unit_mark(term.unit),
            term.standard_uncertainty,
        )
        for term in first.terms.terms
    ]
    terms_text = "; ".join(f"{entry.name} {entry}" for entry in key_values)
    terms_text = terms_text or "no term of noise is determined by the Allan deviation"
    key_values += [
        KeyValue(
            f"bias stability, {entry.block_s:g} s",
            entry.value,
            unit_mark(first.sensor.unit),
            entry.standard_uncertainty,
        )
        for entry in first.stability
    ]
    hours = first.curve.samples * first.curve.interval_s / SECONDS_PER_HOUR
    sentence = f"Noise of {first.name} over {hours:.3g} h at rest: {terms_text}."
    determined = replace(terms, rows=tuple(row for row in rows if row[3]))
    overview = Overview(sentence, (), tuple(key_values[:4]), determined)
    tested = criteria(records, limits)
    return Summary(title, (terms, *curves), tuple(flags), tested, overview=overview)


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
        parts: dict[str, list[Any]] = {}
        units = [known(unit_mark(noise.sensor.unit)) for noise in self.records]
        for noise, unit in zip(self.records, units, strict=True):
            curve, model = noise.curve, noise.terms.model
            columns = {
                "record": np.full(curve.tau_s.size, noise.name, dtype=object),
                "unit": np.full(curve.tau_s.size, unit, dtype=object),
                "tau_s": curve.tau_s,
                "deviation": curve.deviation,
                "model": model,
                "residual": curve.deviation / model - 1.0,
            }
            for name, column in columns.items():
                parts.setdefault(name, []).append(column)
        shared = share_unit(("deviation", "model"), units)
        return {name: np.concatenate(columns) for name, columns in parts.items()} | {
            "units": shared
        }


def _deviations(ax: Axes, noise: NoiseFigures, unit: str) -> None:
    """Allan and wavelet deviation with their limits over averaging time, and what each noise term
    makes alone.
    """
    curves = ((noise.curve, "o", INK, INK), (noise.wavelet, "s", ALERT, "none"))
    for curve, mark, colour, face in curves:
        ax.errorbar(
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
    tau, labels = noise.curve.tau_s, []
    ax.plot(tau, noise.terms.model, color=GOOD, label="noise terms together")
    laws = {law.name: law for law in noise.sensor.laws}
    for term in noise.terms.terms:
        law = laws[term.name]
        of_term = term.value / law.scale * tau ** (law.exponent / 2.0)
        ax.plot(tau, of_term, color=MUTED, ls="--", lw=0.8)
        labels.append(f"{term.symbol} {term.value:.3g} {unit_mark(term.unit)}")
    ax.set_xscale("log")
    ax.set_yscale("log")
    lowest_limit = min(float(np.min(curve.lower)) for curve, *_ in curves)
    highest_limit = max(float(np.max(curve.upper)) for curve, *_ in curves)
    ax.set_ylim(0.3 * lowest_limit, 3.0 * highest_limit)
    ax.set(
        xlabel="averaging time τ [s]",
        ylabel=f"deviation [{unit}]",
        title=f"dashed: noise terms that are observable: {', '.join(labels) or 'none'}",
    )
    ax.legend(loc="best")
    ax.grid(visible=True, which="both", color=RAW, alpha=0.3, lw=0.4)


def draw(title: str, fitted: Fitted[NoiseReport]) -> Drawn:
    """Figures and summary of a fit: of each record deviations and terms above, the rate over time
    below.
    """
    pages = []
    for noise in fitted.drawing.records:
        unit = unit_mark(noise.sensor.unit)
        figure, axes = page(2, 1, title=f"{title}: noise of {noise.name}", height=8.5)
        _deviations(axes[0], noise, unit)
        block_s = noise.block * noise.curve.interval_s
        hours = (np.arange(noise.block_means.size) + 0.5) * (block_s / SECONDS_PER_HOUR)
        axes[1].plot(hours, noise.block_means, color=DENOISED, lw=0.8)
        axes[1].set(
            xlabel="time [h]",
            ylabel=f"indication [{unit}]",
            title=f"means of {block_s:g} s; gaps are left open",
        )
        pages.append(figure)
    return Drawn(tuple(pages), fitted.summary)
