"""Head of a power-on in which a bias settles by itself, beside what its temperature explains.

    y = Σ_k c_k x_k + b_j + w_j(t) + flicker + white,   w_j = Σ_m i_jm exp(−t/θ_m)

x_k are all terms of a level model, b_j is the level of power-on j and t the time since it began. A
power-on settles where i_j' C⁻¹ i_j, C the covariance of its three decays, is beyond chance; it has
settled once w_j is below the noise of a mean over ten blocks.
"""

import numpy as np

from calibkit.numeric.thermal.fits import level_basis
from calibkit.numeric.thermal.left_out import FIGURE_BLOCKS
from calibkit.numeric.thermal.pooled_fit import Stack

DECAYS_S = np.array([100.0, 300.0, 1000.0])
BY_CHANCE = 1e-6
"""Chance at which a faultless power-on is said to settle: as small as this, because a thermometer
that lags looks slightly like it.
"""


def find_settling(stacked: Stack) -> list[tuple[float, float]]:
    """Seconds that each power-on takes to settle, and by how much the bias does so, in its unit;
    zeros where none is seen.
    """
    from scipy.special import chdtrc  # slow to import: logs can be read meanwhile

    settling = [(0.0, 0.0)] * len(stacked.logs)
    basis = level_basis(stacked)
    terms = basis.design(np.zeros(0))[:, 1:]
    terms = terms[:, np.ptp(terms, axis=0) > 0.0]
    fading = [np.exp(-(log.time - log.time[0])[:, None] / DECAYS_S) for log in stacked.logs]
    of_log = stacked.level_columns[:, :, None] * np.concatenate(fading)[:, None, :]
    columns = np.column_stack([terms, of_log.reshape(len(terms), -1)])
    rows = basis.rows.at_noise_of(stacked.indication, columns)
    solved = rows.solve(columns)
    if solved is None:
        return settling
    noise = np.hypot(rows.noise.flicker, np.sqrt(rows.noise.white_variance / FIGURE_BLOCKS))
    for number, (log, decays) in enumerate(zip(stacked.logs, fading, strict=True)):
        first = solved.logs + terms.shape[1] + number * DECAYS_S.size
        own = slice(first, first + DECAYS_S.size)
        i, C = solved.parameters[own], solved.covariance[own, own]
        if chdtrc(DECAYS_S.size, i @ np.linalg.solve(C, i)) < BY_CHANCE:
            unsettled = np.flatnonzero(np.abs(decays @ i) > noise)
            last = int(unsettled[-1]) if unsettled.size else 0
            settling[number] = float(log.time[last] - log.time[0]), float(decays[0] @ i)
    return settling
