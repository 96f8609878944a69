"""What a noise run states: acceptance limits, tables, JSON and figures of each record."""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Criterion, at_most
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.instruments.gyro_noise.deviations import NoiseFigures, stability_uncertainty
from calibkit.instruments.gyro_noise.figures import NoiseView
from calibkit.instruments.gyro_noise.recipe import NoiseAcceptance
from calibkit.numeric.noise import allan, allan_fit
from calibkit.report.summary import number
from calibkit.report.table import Table

LIMITS = {
    "angle_random_walk": "max_angle_random_walk",
    "bias_instability": "max_bias_instability_dph",
    "rate_random_walk": "max_rate_random_walk",
}
"""Noise term → key of its acceptance limit."""


def criteria(found: Sequence[NoiseFigures], limits: NoiseAcceptance) -> tuple[Criterion, ...]:
    """Limits tested on each record; of a term that is not observable, on its largest possible
    value.
    """
    tested = []
    for one in found:
        observed = {term.name: term.value for term in one.terms.terms}
        for law in allan_fit.LAWS:
            limit = getattr(limits, LIMITS[law.name]) if law.name in LIMITS else None
            if limit is not None:
                name = f"{law.name} of {one.record.name}"
                value = observed.get(law.name)
                if value is None:
                    name += " (not observable: at most)"
                    value = _largest_possible(one.curve, law)
                tested.append(at_most(name, value, limit, law.unit))
        if limits.max_bias_stability_dph is not None:
            tested += [
                at_most(
                    f"bias stability over {entry.block_s:g} s of {one.record.name}",
                    entry.value_dph,
                    limits.max_bias_stability_dph,
                    "deg/h",
                )
                for entry in one.stability
            ]
    return tuple(tested)


def tables(found: Sequence[NoiseFigures]) -> tuple[Table, ...]:
    """Noise terms and bias stability of every record, and the deviations over averaging time."""
    rows = []
    for one in found:
        shown = {
            term.name: (number(term.value), number(term.standard_uncertainty, 2))
            for term in one.terms.terms
        }
        for law in allan_fit.LAWS:
            cells = shown.get(law.name, ("not observable", ""))
            rows.append((one.record.name, f"{law.name} {law.symbol}", *cells, law.unit))
        rows += [
            (
                one.record.name,
                f"bias stability, {s.block_s:g} s",
                number(s.value_dph),
                number(stability_uncertainty(s), 2),
                "deg/h",
            )
            for s in one.stability
        ]
    return (
        Table(
            "Noise (IEEE Std 952) and bias stability (GJB 2426A: standard deviation of block"
            " means)",
            ("record", "figure", "value", "standard uncertainty", "unit"),
            tuple(rows),
        ),
        *(_curve_table(one) for one in found),
    )


def _curve_table(one: NoiseFigures) -> Table:
    """Deviations of one record over averaging time with confidence limits."""
    wavelet = dict(
        zip(one.wavelet.factor.tolist(), one.wavelet.deviation_dph.tolist(), strict=True)
    )
    rows = tuple(
        (
            f"{tau:g}",
            number(deviation),
            number(low),
            number(high),
            f"{dof:.0f}",
            number(wavelet[factor]) if factor in wavelet else "",
        )
        for tau, deviation, low, high, dof, factor in zip(
            one.curve.tau_s,
            one.curve.deviation_dph,
            one.curve.lower_dph,
            one.curve.upper_dph,
            one.curve.dof,
            one.curve.factor.tolist(),
            strict=True,
        )
    )
    share = f"{100.0 * one.curve.probability:g} %"
    title = (
        f"{one.record.name}: overlapping Allan deviation [°/h] with {share} limits, and"
        f" {one.wavelet.estimator} deviation"
    )
    return Table(title, ("τ [s]", "deviation", "lower", "upper", "dof", "wavelet"), rows)


def validation_entry(one: NoiseFigures) -> dict[str, object]:
    """JSON object of one record's figures."""
    curves = {
        key: {
            "estimator": curve.estimator,
            "tau_s": curve.tau_s.tolist(),
            "deviation": curve.deviation_dph.tolist(),
            "lower": curve.lower_dph.tolist(),
            "upper": curve.upper_dph.tolist(),
            "probability": curve.probability,
            "unit": "deg/h",
        }
        for key, curve in (("allan_deviation", one.curve), ("wavelet_deviation", one.wavelet))
    }
    return {
        "name": one.record.name,
        "interval_s": one.record.interval_s,
        "missing": one.missing,
        "mean": one.mean_dph,
        "terms": [
            {
                "name": t.name,
                "symbol": t.symbol,
                "value": t.value,
                "unit": t.unit,
                "standard_uncertainty": t.standard_uncertainty,
            }
            for t in one.terms.terms
        ],
        "not_observable": [
            {"name": t.name, "symbol": t.symbol, "reason": t.reason}
            for t in one.terms.not_observable
        ],
        "bias_stability": [
            {"block_s": s.block_s, "value": s.value_dph, "unit": "deg/h", "blocks": s.blocks}
            for s in one.stability
        ],
        **curves,
    }


def view(one: NoiseFigures) -> NoiseView:
    """Page of one record; the lower panel has some 600 means."""
    record, curve = one.record, one.curve
    size = max(1, record.rate.size // 600)
    blocks = record.rate[: record.rate.size // size * size].reshape(-1, size)
    shares = [
        (f"{term.symbol} {term.value:.3g} {term.unit}", _share(term, curve.tau_s))
        for term in one.terms.terms
    ]
    return NoiseView(
        record.name,
        curve.tau_s,
        curve.deviation_dph,
        curve.lower_dph,
        curve.upper_dph,
        one.terms.model_dph,
        one.wavelet.estimator,
        one.wavelet.tau_s,
        one.wavelet.deviation_dph,
        tuple(shares),
        np.asarray(
            (np.arange(blocks.shape[0]) + 0.5) * (size * record.interval_s / SECONDS_PER_HOUR),
            dtype=np.float64,
        ),
        np.asarray(blocks.mean(axis=1), dtype=np.float64),
        size * record.interval_s,
    )


def _share(term: allan_fit.NoiseTerm, tau: Array) -> Array:
    """Deviation [m, °/h] that one term makes alone."""
    law = next(law for law in allan_fit.LAWS if law.name == term.name)
    return np.asarray(term.value / law.scale * tau ** (law.exponent / 2.0), dtype=np.float64)


def _largest_possible(curve: allan.DeviationCurve, law: allan_fit.PowerLaw) -> float:
    """Largest value that a noise term can have: no term is larger than the whole of σ² at any
    averaging time, its upper limit taken.
    """
    return float(np.min(law.scale * curve.upper_dph / curve.tau_s ** (law.exponent / 2.0)))
