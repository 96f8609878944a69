"""Figures as data → what the PDF's template draws: ticks with labels, and curves in shares of the
plot's width and height.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibkit.certificate.results import Figure, Series
    from calibkit.certificate.words import Lang

MARGIN = 0.06
"""Share of a span that is left free around the curves."""
MOST_TICKS = 6
STEPS = (1.0, 2.0, 5.0, 10.0)


def drawing(figure: Figure, lang: Lang) -> dict[str, Any]:
    """JSON object of a figure; the template draws it as vectors, in the certificate's own fonts."""
    if figure.log:
        return drawing(_logarithmic(figure), lang) | {
            "x_ticks": _decades(figure, 0),
            "y_ticks": _decades(figure, 1),
        }
    x = [value for series in figure.series for value in series.x]
    y = [edge for series in figure.series for edge in (*_lower(series), *_upper(series))]
    x_span, y_span = _span(x), _span(y)
    return {
        "title": figure.title.of(lang),
        "x_label": figure.x_label.of(lang),
        "y_label": figure.y_label.of(lang),
        "x_ticks": _ticks(*x_span),
        "y_ticks": _ticks(*y_span),
        "series": [_curve(series, x_span, y_span, lang) for series in figure.series if series.x],
    }


def _logarithmic(figure: Figure) -> Figure:
    """The same figure of decimal logarithms; bars become those of the upper side."""
    series = tuple(
        replace(
            s,
            x=tuple(map(math.log10, s.x)),
            y=tuple(map(math.log10, s.y)),
            y_u=(
                tuple(math.log10((y + u) / y) for y, u in zip(s.y, s.y_u, strict=True))
                if s.y_u
                else ()
            ),
        )
        for s in figure.series
    )
    return replace(figure, series=series, log=False)


def _decades(figure: Figure, axis: int) -> list[dict[str, Any]]:
    """Ticks at powers of ten."""
    plain = _logarithmic(figure)
    if axis == 0:
        span = _span([value for series in plain.series for value in series.x])
    else:
        span = _span(
            [edge for series in plain.series for edge in (*_lower(series), *_upper(series))]
        )
    return [
        {"at": _share(k, span), "label": f"{10.0**k:g}"}
        for k in range(math.ceil(span[0]), math.floor(span[1]) + 1)
    ]


def _lower(series: Series) -> tuple[float, ...]:
    """Lower edge of a curve."""
    return (
        tuple(y - u for y, u in zip(series.y, series.y_u, strict=True)) if series.y_u else series.y
    )


def _upper(series: Series) -> tuple[float, ...]:
    """Upper edge of a curve."""
    return (
        tuple(y + u for y, u in zip(series.y, series.y_u, strict=True)) if series.y_u else series.y
    )


def _curve(
    series: Series, x_span: tuple[float, float], y_span: tuple[float, float], lang: Lang
) -> dict[str, Any]:
    """One series in shares of the plot, y upwards."""
    x = [_share(value, x_span) for value in series.x]
    return {
        "label": series.label.of(lang),
        "style": series.style,
        "points": [[a, _share(b, y_span)] for a, b in zip(x, series.y, strict=True)],
        "low": [_share(value, y_span) for value in _lower(series)],
        "high": [_share(value, y_span) for value in _upper(series)],
        "bars": bool(series.y_u),
    }


def _share(value: float, span: tuple[float, float]) -> float:
    """Place of a value in a span, to a ten-thousandth."""
    return round((value - span[0]) / (span[1] - span[0]), 4)


def _span(values: list[float]) -> tuple[float, float]:
    """Range of values with a margin; never empty."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    width = (high - low) or abs(high) or 1.0
    return low - MARGIN * width, high + MARGIN * width


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
