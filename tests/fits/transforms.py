"""A whole wavelet transform of an extended signal, level by level, and back."""

from __future__ import annotations

import numpy as np

from calibkit.numeric.wavelet.denoise import beyond, extend as extend_signal
from calibkit.numeric.wavelet.lifting import clean_spans, find_wavelet


def extend(signal, name, levels, extension="symmetric"):
    """Signal with a margin at both ends, and the length of the margin."""
    period = 1 << levels
    margin = find_wavelet(name).length * period
    return extend_signal(signal, extension, margin, period, 3 * period // 2), margin


def extend_by(signal, count, extension="symmetric", window=12):
    """Signal with so many samples more at both ends."""
    ends = [beyond(side, extension, count, window) for side in (signal, signal[::-1])]
    return np.concatenate([ends[0], signal, ends[1][::-1]])


def forward(signal, name, levels, extension="symmetric"):
    """Approximations of the last level, and details of all, the finest first."""
    approximations, _ = extend(signal, name, levels, extension)
    details = []
    for _ in range(levels):
        approximations, detail = find_wavelet(name).analyse(approximations)
        details.append(detail)
    return approximations, details


def inverse(approximations, details, name, length, shrink=lambda _level, detail: detail):
    """The signal again."""
    for level in range(len(details) - 1, -1, -1):
        shrunk = shrink(level, details[level])
        approximations = find_wavelet(name).synthesise(approximations, shrunk)
    margin = find_wavelet(name).length << len(details)
    return approximations[margin : margin + length]


def clean_details(signal, name, levels, extension="symmetric"):
    """Details of each level that no extension touches, and the index of the first of each."""
    _, details = forward(signal, name, levels, extension)
    margin = find_wavelet(name).length << levels
    spans = clean_spans(find_wavelet(name), signal.size, levels)[1:]
    return [
        (detail[(margin >> level) + low : (margin >> level) + high], low)
        for level, (detail, (low, high)) in enumerate(zip(details, spans, strict=True), start=1)
    ]
