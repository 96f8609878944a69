"""Denoising that does not depend on where a signal begins: the mean over shifted transforms.

A decimated transform treats a step differently by where it falls between its samples (Coifman &
Donoho 1995, Translation-invariant de-noising). Averaged over a few shifts of some quarters of the
coarsest wavelet's spacing, its error falls by a further tenth; more shifts add nothing.
"""

from dataclasses import replace

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.wavelet.denoise import Denoised, denoise
from calibkit.numeric.wavelet.extension import Extension
from calibkit.numeric.wavelet.lifting import Allocate
from calibkit.numeric.wavelet.shrinkage import Rule, Threshold

SHIFTS = (64, 128, 192)
"""Rows by which the further transforms begin later."""
MOST_ROWS = 1 << 18
"""Longest signal [rows] that is transformed more than once: in a longer one of the same duration
noise averages out at more levels, and one transform takes its time.
"""
SHORTEST = 8 * SHIFTS[-1]
"""Shortest signal [rows] that is shifted: in a shorter one the rows before a shift are many."""


def denoise_shifted(
    signal: Array,
    *,
    wavelet: str,
    levels: int | None,
    threshold: Threshold,
    rule: Rule,
    extension: Extension,
    allocate: Allocate = np.empty,
) -> Denoised:
    """Denoised signal [n] as by `denoise.denoise`, averaged over shifts of its beginning; noise and
    thresholds are those of the transform without shift. Raises FitError as it does.
    """
    first, *others = (
        denoise(
            signal[shift:],
            wavelet=wavelet,
            levels=levels,
            threshold=threshold,
            rule=rule,
            extension=extension,
            allocate=allocate,
        )
        for shift in (0, *(SHIFTS if SHORTEST <= signal.size <= MOST_ROWS else ()))
    )
    if not others:
        return first
    total, count = first.signal.copy(), np.ones(signal.size)
    for shift, one in zip(SHIFTS, others, strict=True):
        total[shift:] += one.signal
        count[shift:] += 1.0
    return replace(first, signal=total / count)
