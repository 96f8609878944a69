"""A whole wavelet transform of a signal, level by level, and back."""

from __future__ import annotations

from calibkit.numeric.wavelet import lifting
from calibkit.numeric.wavelet.extension import Coefficients, Ends
from calibkit.numeric.wavelet.lifting import clean_spans, find_wavelet


def ends_of(signal, name, extension, window=12):
    """How a signal goes on."""
    return Ends.fit(signal, extension, find_wavelet(name).delay, window)


def forward(signal, name, levels, extension="symmetric", window=12):
    """Approximations of the last level, and details of all, the finest first."""
    approximations, details = Coefficients(signal, 0, 0), []
    ends = ends_of(signal, name, extension, window)
    for _ in range(levels):
        approximations, detail = lifting.analyse(approximations, find_wavelet(name), ends)
        details.append(detail)
    return approximations, details


def inverse(approximations, details, name, length, shrink=lambda _level, detail: detail):
    """The signal again."""
    spans = [(0, length), *(detail.span for detail in details)]
    for detail, span in zip(details[::-1], spans[-2::-1], strict=True):
        approximations = lifting.synthesise(
            approximations, detail, span, find_wavelet(name), shrink
        )
    return approximations.values


def clean_details(signal, name, levels, extension="symmetric"):
    """Details of each level that no extension touches, and the index of the first of each."""
    _, details = forward(signal, name, levels, extension)
    spans = clean_spans(find_wavelet(name), signal.size, levels)[1:]
    return [(detail.part(span), span[0]) for detail, span in zip(details, spans, strict=True)]
