"""A gyro at rest for hours: angle random walk, flicker, rate random walk, whole pulses, and a
recorder that lost some rows.

    y = ω_e sin α + bias + N + B + K noise, rounded to whole pulses                   at 1 Hz
"""

import numpy as np

from calibkit.numeric.constants import EARTH_RATE_DPH, SECONDS_PER_HOUR
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign

LATITUDE_DEG = 34.2
DECIMALS = {"gyro_dph": 3}
GAP_S = (120, 400)
"""Shortest and longest gap."""


def campaign(seed: int, *, hours: float = 6.0) -> Campaign:
    """Log one gyro at rest at 1 Hz with one gap; the truth has its noise terms.

    Parameters
    ----------
    seed : what gyro and noise are drawn from.
    hours : length of the record.

    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    count = round(hours * SECONDS_PER_HOUR)
    terms = {
        "N": float(rng.uniform(0.003, 0.006)),
        "B": float(rng.uniform(0.02, 0.04)),
        "K": float(rng.uniform(0.0, 0.02)),
        "resolution_dph": 0.02,
        "bias_dph": float(rng.normal(0.0, 0.5)),
    }
    rate = (
        EARTH_RATE_DPH * np.sin(np.radians(LATITUDE_DEG))
        + terms["bias_dph"]
        + noise.angle_random_walk(terms["N"], count, rng)
        + noise.flicker(terms["B"], count, rng)
        + noise.rate_random_walk(terms["K"], count, rng)
    )
    indication = noise.pulses(rate, terms["resolution_dph"])
    start, length = int(rng.integers(count // 4, count // 2)), int(rng.integers(*GAP_S))
    recorded = np.ones(count, dtype=bool)
    recorded[start : start + length] = False
    columns = {
        "time_s": np.arange(count, dtype=np.int64)[recorded],
        "gyro_dph": indication[recorded],
    }
    units = {
        "N": "deg/sqrt(h)",
        "B": "deg/h",
        "K": "deg/h/sqrt(h)",
        "resolution_dph": "deg/h",
        "bias_dph": "deg/h",
    }
    truth = {
        "procedure": "gyro_noise",
        "seed": seed,
        "terms": terms,
        "units": units,
        "gap": {"from_s": start, "rows": length},
    }
    return Campaign({"static.csv": columns}, DECIMALS, truth)


CAMPAIGNS = {"gyro_noise": campaign}
