"""Overlapping Allan deviation of a log before and after compensation: what the drift term leaves at
each averaging time.
"""

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.noise import allan

UNEVEN = 0.05
"""Deviation of a sampling step from the usual one, relative to it, from which a log is not evenly
sampled.
"""


def residual(time: Array, before: Array, after: Array) -> dict[str, object]:
    """Allan deviations [°/h] of the indication and of the compensated rate [n], or why there are
    none.

    Nothing is denoised or resampled: an Allan deviation of either would be that of the filter.
    """
    step = np.diff(time)
    usual = float(np.median(step))
    if np.abs(step - usual).max() > UNEVEN * usual:
        return {"not_available": "the log is not evenly sampled"}
    raw, left = (allan.overlapping(rate, usual) for rate in (before, after))
    return {
        "estimator": "overlapping Allan deviation",
        "unit": "deg/h",
        "tau_s": left.tau_s.tolist(),
        "before": raw.deviation_dph.tolist(),
        "after": left.deviation_dph.tolist(),
        "after_lower": left.lower_dph.tolist(),
        "after_upper": left.upper_dph.tolist(),
        "probability": left.probability,
    }
