"""Figures as data → what the PDF's template draws: ticks with labels, and curves in shares of the
plot's width and height.
"""

import math
from dataclasses import replace
from typing import Any

from calibkit.certificate.results import CertificateFigure, Series
from calibkit.certificate.words import Lang

MARGIN = 0.06
"""Share of a span that is left free around the curves."""
MOST_TICKS = 6
STEPS = (1.0, 2.0, 5.0, 10.0)


def lay_out_figure(figure: CertificateFigure, lang: Lang) -> dict[str, Any]:
    """JSON object of a figure; the template draws it as vectors, in the certificate's own fonts."""
    plotted, ticks = (_logarithmic(figure), _decades) if figure.log else (figure, _ticks)
    x_span = _span([x for series in plotted.series for x in series.x])
    y_span = _span([y for series in plotted.series for edge in _edges(series) for y in edge])
    return {
        "title": figure.title.of(lang),
        "x_label": figure.x_label.of(lang),
        "y_label": figure.y_label.of(lang),
        "x_ticks": ticks(*x_span),
        "y_ticks": ticks(*y_span),
        "series": [_curve(series, x_span, y_span, lang) for series in plotted.series if series.x],
    }


def _logarithmic(figure: CertificateFigure) -> CertificateFigure:
    """The same figure of decimal logarithms; bars become those of the upper side."""
    series = []
    for s in figure.series:
        x, y = tuple(map(math.log10, s.x)), tuple(map(math.log10, s.y))
        pairs = zip(s.y, s.y_u, strict=True) if s.y_u else ()
        y_u = tuple(math.log10((value + u) / value) for value, u in pairs)
        ends = tuple((math.log10(low), math.log10(high)) for low, high in s.ends)
        series.append(replace(s, x=x, y=y, y_u=y_u, ends=ends))
    return replace(figure, series=tuple(series))


def _edges(series: Series) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Lower and upper edge of a curve."""
    if not (series.y_u or series.ends):
        return series.y, series.y
    pairs = series.ends or [(y - u, y + u) for y, u in zip(series.y, series.y_u, strict=True)]
    return tuple(low for low, _ in pairs), tuple(high for _, high in pairs)


def _curve(
    series: Series, x_span: tuple[float, float], y_span: tuple[float, float], lang: Lang
) -> dict[str, Any]:
    """One series in shares of the plot, y upwards."""
    low, high = ([_share(y, y_span) for y in edge] for edge in _edges(series))
    return {
        "label": series.label.of(lang),
        "style": series.style,
        "points": [
            [_share(x, x_span), _share(y, y_span)] for x, y in zip(series.x, series.y, strict=True)
        ],
        "low": low,
        "high": high,
        "bars": bool(series.y_u or series.ends),
    }


def _share(value: float, span: tuple[float, float]) -> float:
    """Place of a value in a span, to a ten-thousandth."""
    return round((value - span[0]) / (span[1] - span[0]), 4)


def _span(values: list[float]) -> tuple[float, float]:
    """Range of values with a margin; never empty."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    width = (high - low) or abs(high) or 1.0
    return low - MARGIN * width, high + MARGIN * width


def _decades(low: float, high: float) -> list[dict[str, Any]]:
    """Ticks at powers of ten between two logarithms."""
    return [
        {"at": _share(k, (low, high)), "label": f"{10.0**k:g}"}
        for k in range(math.ceil(low), math.floor(high) + 1)
    ]


def _ticks(low: float, high: float) -> list[dict[str, Any]]:
    """At most six round numbers inside a span, with their places and labels."""
    scale = 10.0 ** math.floor(math.log10((high - low) / MOST_TICKS))
    step = next(f * scale for f in STEPS if (high - low) / (f * scale) <= MOST_TICKS)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step), math.floor(high / step)
    return [
        {"at": _share(k * step, (low, high)), "label": f"{k * step:.{decimals}f}".replace("-", "−")}
        for k in range(first, last + 1)
    ]
